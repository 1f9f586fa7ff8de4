//! Tables and catalogues: text with a row per particle or star. The numbers are read in one pass into columns; the text
//! itself is never held.

mod columns;
mod csv;
mod geojson;
mod kstars;
mod sky;
mod text;

pub(super) use csv::Csv;
pub(super) use geojson::GeoJson;
pub(super) use kstars::KStars;
pub(super) use text::head as text_head;

use super::{Description, FamilyInfo, Field, FieldKind, ImportError, Source, units};
use crate::model::{FamilyName, Unit};
use columns::Column;
use std::ops::Range;
use std::path::Path;

/// Standard name, kind and unit of the columns that have one, by name in lower case.
const STANDARD: &[(&[&str], &str, FieldKind, &str)] = &[
    (&["mass", "m", "masses"], "mass", FieldKind::Mass, ""),
    (&["h", "hsml", "smoothing_length", "smoothinglength"], "smoothing-length", FieldKind::SmoothingLength, ""),
    (&["rho", "density"], "density", FieldKind::Density, ""),
    (&["id", "particle_id", "ids"], "id", FieldKind::Id, ""),
    (&["mag", "vmag", "magnitude", "phot_g_mean_mag"], "magnitude", FieldKind::Other, "mag"),
    (&["ci", "bv", "b_v", "color_index", "bp_rp"], "color-index", FieldKind::Other, "mag"),
    (&["absmag", "absolute_magnitude"], "absolute-magnitude", FieldKind::Other, "mag"),
    (&["lum", "luminosity"], "luminosity", FieldKind::Other, ""),
    (&["temperature", "temp", "teff"], "temperature", FieldKind::Other, "K"),
    (&["u", "internal_energy"], "internal-energy", FieldKind::Other, ""),
    (&["velocity_dispersion"], "velocity-dispersion", FieldKind::Other, ""),
    (&["metallicity"], "metallicity", FieldKind::Other, ""),
    (&["parallax", "plx"], "parallax", FieldKind::Other, "mas"),
];

/// A table as a source of one family: `stars` if it has magnitudes or directions on the sky, else `dark`.
struct Catalogue {
    description: Description,
    /// By field, `components` values per row.
    fields: Vec<Vec<f64>>,
}

impl Catalogue {
    /// Finds positions and known quantities among the columns, which all have the same length.
    fn new(path: &Path, format: &str, bytes: u64, columns: Vec<Column>) -> Result<Catalogue, ImportError> {
        let Some(positions) = sky::positions(path, &columns)? else {
            let expected = "columns x, y, z, or ra, dec and possibly dist or parallax";
            return Err(ImportError::missing(path, "positions", expected));
        };
        let count = positions.values.len() as u64;
        if count == 0 {
            return Err(ImportError::NoParticles { path: path.into(), field: "rows".into() });
        }
        let axes: Vec<String> = positions.stored_as.split(',').map(str::to_owned).collect();
        let mut described = vec![Field {
            name: "position".into(),
            stored_as: positions.stored_as,
            unit: positions.unit.clone(),
            components: 3,
            kind: FieldKind::Position,
        }];
        let mut fields = vec![positions.values.into_flattened()];
        if let Some((field, values)) = velocity(&columns) {
            described.push(field);
            fields.push(values);
        }
        let used = |column: &Column| {
            let velocity = ["vx", "vy", "vz"].contains(&&*column.key()) && described.len() > 1;
            velocity || (!positions.from_sky && axes.contains(&column.name))
        };
        let mut notes: Vec<String> = positions.note.into_iter().collect();
        let holds_numbers = |column: &Column| column.values.iter().any(|value| value.is_finite());
        let rest: Vec<Column> = columns.into_iter().filter(|column| !used(column) && holds_numbers(column)).collect();
        for mut column in rest {
            let key = column.key();
            let free = |name: &str| !described.iter().any(|field: &Field| field.name == name);
            let standard = STANDARD.iter().find(|(names, name, ..)| names.contains(&key.as_str()) && free(name));
            let (name, kind, unit) =
                standard.map_or((&*column.name, FieldKind::Other, ""), |(_, name, kind, unit)| (*name, *kind, *unit));
            let mut unit = Unit::new(if column.unit.is_empty() { unit } else { &column.unit });
            // Lengths of one table are compared: smoothing lengths take the unit of the positions.
            if kind == FieldKind::SmoothingLength {
                let factor = units::conversion(path, &column.name, &unit.0, &positions.unit.0)?;
                if factor != 1.0 {
                    column.values.iter_mut().for_each(|value| *value *= factor);
                    notes.push(format!("{} is converted from {unit} to {}", column.name, positions.unit));
                }
                unit = positions.unit.clone();
            }
            described.push(Field { name: name.into(), stored_as: column.name.clone(), unit, components: 1, kind });
            fields.push(column.values);
        }
        let stars = positions.from_sky || described.iter().any(|field| field.name == "magnitude");
        let mass_unit = described.iter().find(|field| field.kind == FieldKind::Mass).map(|field| field.unit.clone());
        let name = if stars { FamilyName::Stars } else { FamilyName::Dark };
        let description = Description {
            length_unit: positions.unit,
            mass_unit: mass_unit.unwrap_or_default(),
            notes,
            families: vec![FamilyInfo { name, count, fields: described }],
            ..Description::unitless(path, format, bytes)
        };
        Ok(Catalogue { description, fields })
    }
}

/// The columns `vx`, `vy`, `vz` as one field.
fn velocity(columns: &[Column]) -> Option<(Field, Vec<f64>)> {
    let [x, y, z] = ["vx", "vy", "vz"].map(|name| columns.iter().find(|column| column.key() == name));
    let (x, y, z) = (x?, y?, z?);
    let values = x.values.iter().zip(&y.values).zip(&z.values).flat_map(|((x, y), z)| [*x, *y, *z]).collect();
    let field = Field {
        name: "velocity".into(),
        stored_as: "vx,vy,vz".into(),
        unit: Unit::new(&*x.unit),
        components: 3,
        kind: FieldKind::Velocity,
    };
    Some((field, values))
}

impl Source for Catalogue {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let components = self.description.check_range(family, field, &range, out.len())?.components;
        let first = range.start as usize * components;
        match self.fields[field].get(first..first + out.len()) {
            Some(values) => out.copy_from_slice(values),
            None => out.fill(f64::NAN),
        }
        Ok(())
    }
}
