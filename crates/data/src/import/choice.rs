//! Which fields of a family give positions, masses, smoothing lengths and densities: one choice, and one wording of it, for
//! loads, streams, rows and summaries.

use super::check::{chunks, drawable};
use super::{DEFAULT_NEIGHBOURS, FamilyInfo, FieldKind, ImportError, Smoothing, Source};
use crate::model::FamilyName;

/// The chosen fields of a family, by index.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chosen {
    /// Positions.
    pub position: usize,
    /// Masses; each particle counts 1 without.
    pub mass: Option<usize>,
    /// Smoothing lengths; they are estimated without.
    pub smoothing_length: Option<usize>,
    /// Densities; they are estimated without, or where they are not positive.
    pub density: Option<usize>,
    /// How many neighbours estimates reach to.
    pub neighbours: usize,
    /// What is assumed or estimated, one sentence each.
    pub notes: Vec<String>,
}

impl Chosen {
    /// Chooses the fields of family `family` of the source's description. A field without any positive value is none.
    ///
    /// # Errors
    /// When the source cannot be read, or there is no such family or it lacks positions or the field of smoothing lengths that is
    /// named, or single precision holds none of its positive masses or smoothing lengths.
    pub(super) fn of(source: &dyn Source, family: usize, smoothing: &Smoothing) -> Result<Chosen, ImportError> {
        let about = source.description();
        let Some(info) = about.families.get(family) else {
            let families = format!("a family below {}", about.families.len());
            return Err(ImportError::missing(&about.path, format!("family {family}"), families));
        };
        let name = info.name;
        let Some(position) = info.find(FieldKind::Position) else {
            return Err(ImportError::missing(&about.path, format!("positions of {name}"), "coordinates"));
        };
        let find = |field: Option<usize>| -> Result<(Option<usize>, Option<f64>), ImportError> {
            let Some(field) = field else { return Ok((None, None)) };
            let (is_drawable, positive) = any_drawable(source, family, info, field)?;
            Ok((is_drawable.then_some(field), positive))
        };
        // To count each particle as 1, or to estimate, in place of values that are there would be wrong without a word.
        let usable = |field: Option<usize>, what: &str| -> Result<Option<usize>, ImportError> {
            let (usable, positive) = find(field)?;
            match positive.filter(|_| usable.is_none()) {
                Some(value) => Err(ImportError::beyond_precision(&about.path, format!("{what} of {name}"), value)),
                None => Ok(usable),
            }
        };
        let (stated, neighbours) = match smoothing {
            Smoothing::Auto => (info.find(FieldKind::SmoothingLength), DEFAULT_NEIGHBOURS),
            Smoothing::Field(field) => (Some(named_scalar(source, info, field)?), DEFAULT_NEIGHBOURS),
            Smoothing::Knn(k) => (None, *k),
        };
        let smoothing_length = usable(stated, "smoothing length")?;
        let stated_mass = info.find(FieldKind::Mass);
        let mass = usable(stated_mass, "mass")?;
        let (density, _) = find(info.find(FieldKind::Density))?;
        let mut notes = Vec::new();
        if stated.is_some() && smoothing_length.is_none() {
            notes.push(format!("{name}: no smoothing length is positive, so they are estimated"));
        }
        if smoothing_length.is_none() {
            notes.push(format!("{name}: smoothing length is the distance to neighbour {neighbours}"));
        }
        if density.is_none() {
            let that = if smoothing_length.is_some() { "" } else { "that " };
            notes.push(format!("{name}: density from mass and {that}smoothing length"));
        }
        if mass.is_none() {
            let why = if stated_mass.is_some() { "no mass is positive" } else { "no masses" };
            notes.push(format!("{name}: {why}, each particle counts 1"));
        }
        Ok(Chosen { position, mass, smoothing_length, density, neighbours, notes })
    }
}

/// The note about densities of a family that are replaced, where others are not: known once all particles have been read.
pub fn replaced_densities(family: FamilyName, count: u64) -> String {
    format!("{family}: {count} densities are not positive and are replaced by estimates")
}

/// The field that [`Smoothing::Field`] names: scalar, of this family.
fn named_scalar(source: &dyn Source, info: &FamilyInfo, name: &str) -> Result<usize, ImportError> {
    let scalar = |index: &usize| info.fields[*index].components == 1;
    info.named(name).filter(scalar).ok_or_else(|| {
        let fields = info.fields.iter().filter(|field| field.components == 1);
        let names: Vec<&str> = fields.map(|field| field.name.as_str()).collect();
        let expected = format!("a scalar field of {}: {}", info.name, names.join(", "));
        ImportError::missing(&source.description().path, format!("smoothing length {name}"), expected)
    })
}

/// Whether a scalar field has a value that can be drawn, and the first positive one that it has before that; reads until it finds one
/// that can.
fn any_drawable(
    source: &dyn Source,
    family: usize,
    info: &FamilyInfo,
    field: usize,
) -> Result<(bool, Option<f64>), ImportError> {
    let (mut values, mut positive) = (Vec::new(), None);
    for range in chunks(info.count) {
        values.resize((range.end - range.start) as usize, 0.0);
        source.read(family, field, range, &mut values)?;
        if values.iter().any(|&value| drawable(value as f32)) {
            return Ok((true, positive));
        }
        positive = positive.or_else(|| values.iter().copied().find(|value| *value > 0.0 && value.is_finite()));
    }
    Ok((false, positive))
}
