//! Which scalar attributes a load brings along, and how they come out of a source's fields.

use super::check::chunks;
use super::{AttributeChoice, Description, FamilyInfo, FieldKind, ImportError, LoadOptions, Source};
use crate::model::Unit;
use std::collections::BTreeSet;

/// The attributes of [`AttributeChoice::Usual`].
const USUAL: [&str; 5] = ["velocity-dispersion", "temperature", "internal-energy", "magnitude", "color-index"];

/// What tells kinds of particles apart; kept beside the usual ones.
pub(super) const KINDS: [&str; 3] = ["atomic-number", "particle-type", "species"];

/// How many runs of values, evenly spread, are looked at to tell whether single precision holds an attribute.
const LOOKED_AT: usize = 8;

/// How one number comes out of a field's components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// One component.
    Component(usize),
    /// The length of the vector.
    Length,
}

impl Part {
    /// The number, from the components of one particle.
    pub(super) fn of(self, values: &[f64]) -> f32 {
        match self {
            Part::Component(index) => values.get(index).map_or(f32::NAN, |value| *value as f32),
            Part::Length => values.iter().map(|value| value * value).sum::<f64>().sqrt() as f32,
        }
    }

    /// The same in double precision.
    pub(super) fn exact(self, values: &[f64]) -> f64 {
        match self {
            Part::Component(index) => values.get(index).copied().unwrap_or(f64::NAN),
            Part::Length => values.iter().map(|value| value * value).sum::<f64>().sqrt(),
        }
    }
}

/// One attribute to load.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Planned {
    /// Its name in the dataset.
    pub name: String,
    /// The name that it is asked for by: that one, or the source's own.
    pub asked: String,
    /// Its unit.
    pub unit: Unit,
    /// The field it comes from.
    pub field: usize,
    /// What of the field.
    pub part: Part,
}

/// The attributes of one family, without those that are left out.
pub(super) fn plan(about: &Description, info: &FamilyInfo, options: &LoadOptions) -> Vec<Planned> {
    let is_kept = |name: &&str| !options.without.iter().any(|other| other == name);
    let names: Vec<String> = match &options.attributes {
        AttributeChoice::Usual => {
            let usual = USUAL.iter().filter(|name| info.named(name).is_some() && is_kept(name));
            let usual: Vec<String> = usual.map(|name| name.to_string()).collect();
            let usual = if usual.is_empty() { vec!["speed".into()] } else { usual };
            let has = |kind: &&&str| info.fields.iter().any(|field| field.name == **kind);
            usual.into_iter().chain(KINDS.iter().filter(has).map(|kind| kind.to_string())).collect()
        }
        AttributeChoice::All => scalars(info).chain(["speed".into()]).collect(),
        AttributeChoice::Named(names) => names.clone(),
    };
    let mut planned: Vec<Planned> = Vec::with_capacity(names.len());
    for name in names.into_iter().filter(|name| is_kept(&name.as_str())) {
        if let Some(attribute) = named(about, info, &name)
            && !planned.iter().any(|other| other.name == attribute.name)
        {
            planned.push(Planned { asked: name, ..attribute });
        }
    }
    planned
}

/// The attribute of that name in a family, if the family has it.
pub(super) fn named(about: &Description, info: &FamilyInfo, name: &str) -> Option<Planned> {
    let planned = |field: usize, part, name: &str| Planned {
        name: name.into(),
        asked: name.into(),
        unit: match info.fields[field].kind {
            FieldKind::Position => about.length_unit.clone(),
            _ => info.fields[field].unit.clone(),
        },
        field,
        part,
    };
    if let Some(field) = info.named(name).filter(|field| info.fields[*field].components == 1) {
        return Some(planned(field, Part::Component(0), &info.fields[field].name));
    }
    if name == "speed" {
        return info.find(FieldKind::Velocity).map(|field| planned(field, Part::Length, name));
    }
    let (vector, axis) = name.rsplit_once('-')?;
    let component = ["x", "y", "z"].iter().position(|letter| *letter == axis)?;
    let field = info.named(vector).filter(|field| info.fields[*field].components == 3)?;
    Some(planned(field, Part::Component(component), name))
}

/// Looks whether single precision holds an attribute of a family: where it holds none of its values, there would be nothing but their
/// stand-ins.
///
/// # Errors
/// [`ImportError`] where it does not, or when the source cannot be read.
pub(super) fn check_precision(
    source: &dyn Source,
    family: usize,
    info: &FamilyInfo,
    planned: &Planned,
) -> Result<(), ImportError> {
    let components = info.fields[planned.field].components;
    let chunks = chunks(info.count);
    let (mut values, mut lost) = (Vec::new(), None);
    for range in chunks.iter().step_by(chunks.len().div_ceil(LOOKED_AT).max(1)) {
        values.resize((range.end - range.start) as usize * components, 0.0);
        source.read(family, planned.field, range.clone(), &mut values)?;
        for value in values.chunks_exact(components).map(|values| planned.part.exact(values)) {
            let held = value as f32;
            if held.is_finite() && held != 0.0 {
                return Ok(());
            }
            lost = lost.or(Some(value).filter(|value| value.is_finite() && *value != 0.0));
        }
    }
    let refused = |value| {
        let field = format!("{} of {}", planned.name, info.name);
        Err(ImportError::beyond_precision(&source.description().path, field, value))
    };
    lost.map_or(Ok(()), refused)
}

/// Names of the scalar fields that are attributes.
fn scalars(info: &FamilyInfo) -> impl Iterator<Item = String> {
    let fields = info.fields.iter().filter(|field| field.components == 1 && field.kind == FieldKind::Other);
    fields.map(|field| field.name.clone())
}

/// Whether a family of the source has an attribute of that name, or one can be made of its vectors.
pub fn has_attribute(about: &Description, name: &str) -> bool {
    about.families.iter().any(|info| named(about, info, name).is_some())
}

/// The names that could be asked for in one family: its scalar fields, and the speed.
pub(super) fn available_in(info: &FamilyInfo) -> BTreeSet<String> {
    let speed = info.find(FieldKind::Velocity).map(|_| "speed".to_owned());
    scalars(info).chain(speed).collect()
}

/// Every name that could be asked for, in any family, in order.
pub(super) fn available(about: &Description) -> BTreeSet<String> {
    about.families.iter().flat_map(available_in).collect()
}
