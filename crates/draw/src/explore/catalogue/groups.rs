//! Group catalogues of Gadget-4, AREPO and SUBFIND: friends-of-friends groups and their subhaloes.

use super::properties::Kept;
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::{Field, FieldKind, Source, open};
use crate::model::Unit;
use glam::DVec3;
use std::path::Path;

/// What objects are called, and the data sets of their masses and radii, the preferred first.
struct Kind {
    name: &'static str,
    position: &'static str,
    mass: &'static [&'static str],
    radius: &'static [&'static str],
}

const KINDS: [Kind; 2] = [
    Kind {
        name: "Group",
        position: "GroupPos",
        mass: &["GroupMass", "Group_M_Crit200", "Group_M_Mean200"],
        radius: &["Group_R_Crit200", "Group_R_Mean200", "Group_R_TopHat200"],
    },
    Kind { name: "Subhalo", position: "SubhaloPos", mass: &["SubhaloMass"], radius: &["SubhaloHalfmassRad"] },
];

/// The subhaloes of a catalogue in their order, and the unit of their masses.
pub(in crate::explore) fn subhaloes(path: &Path, source: &dyn Source) -> Result<(Vec<Object>, Unit), ExploreError> {
    let mut catalogue = read_kinds(path, source, &KINDS[1..], &mut Kept::nothing())?;
    Ok((std::mem::take(&mut catalogue.objects), catalogue.mass_unit))
}

pub(super) fn read(path: &Path, kept: &mut Kept) -> Result<Catalogue, ExploreError> {
    let catalogue = read_kinds(path, open(path)?.as_ref(), &KINDS, kept)?;
    if catalogue.objects.is_empty() {
        let expected = "groups or subhaloes with data sets GroupPos or SubhaloPos";
        return Err(ExploreError::missing(path, "objects", expected));
    }
    Ok(catalogue)
}

/// Objects of these kinds.
fn read_kinds(path: &Path, source: &dyn Source, kinds: &[Kind], kept: &mut Kept) -> Result<Catalogue, ExploreError> {
    let about = source.description();
    let mut catalogue = Catalogue {
        path: path.into(),
        format: "groups",
        length_unit: about.length_unit.clone(),
        mass_unit: Unit::default(),
        box_size: about.box_size,
        left_out: 0,
        objects: Vec::new(),
        properties: Vec::new(),
        is_in_plane: false,
        tree: None,
    };
    for (index, info) in about.families.iter().enumerate() {
        let position = info.find(FieldKind::Position).map(|field| (field, info.fields[field].stored_as.as_str()));
        let Some((position, kind)) =
            position.and_then(|(field, name)| Some((field, kinds.iter().find(|kind| kind.position == name)?)))
        else {
            continue;
        };
        if info.count > MOST_OBJECTS {
            let expected = format!("at most {MOST_OBJECTS}");
            return Err(ExploreError::malformed(path, kind.name, format!("{} objects", info.count), expected));
        }
        let count = info.count as usize;
        let stored =
            |name: &&str| info.fields.iter().position(|field| field.stored_as == **name && field.components == 1);
        let mut positions = vec![[0.0; 3]; count];
        source.read(index, position, 0..info.count, positions.as_flattened_mut())?;
        let column = |names: &[&str]| -> Result<Option<(usize, Vec<f64>)>, ExploreError> {
            let Some(field) = names.iter().find_map(stored) else { return Ok(None) };
            let mut values = vec![0.0; count];
            source.read(index, field, 0..info.count, &mut values)?;
            Ok(Some((field, values)))
        };
        let (mass, radius) = (column(kind.mass)?, column(kind.radius)?);
        let own = [Some(position), mass.as_ref().map(|(field, _)| *field), radius.as_ref().map(|(field, _)| *field)];
        let naming = |field: &Field| (field.stored_as.clone(), FieldKind::Other);
        kept.read(path, source, (index, info), &own, catalogue.objects.len(), naming)?;
        if let Some((field, _)) = mass.as_ref().filter(|_| catalogue.mass_unit.is_unknown()) {
            catalogue.mass_unit = info.fields[*field].unit.clone();
        }
        let of = |column: &Option<(usize, Vec<f64>)>, i: usize| column.as_ref().map(|(_, values)| values[i]);
        catalogue.objects.extend(positions.iter().enumerate().map(|(i, at)| Object {
            name: format!("{} {i}", kind.name),
            position: DVec3::from_array(*at),
            radius: of(&radius, i),
            mass: of(&mass, i),
        }));
    }
    catalogue.properties = kept.finished(catalogue.objects.len());
    Ok(catalogue)
}
