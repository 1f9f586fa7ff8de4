//! A table as a source of particles.

use super::columns::{Column, Opened, Table, shown};
use super::sky::{self, Recipe};
use super::{STANDARD, ids};
use crate::import::hdf5::VELOCITIES;
use crate::import::{Description, FamilyInfo, Field, FieldKind, ImportError, Source, units};
use crate::model::{FamilyName, Unit};
use std::ops::Range;
use std::path::Path;

/// A table as a source of one family: `stars` if it has magnitudes or directions on the sky, else `dark`.
pub(super) struct Catalogue {
    description: Description,
    table: Box<dyn Table>,
    /// Where each field of the description comes from.
    origins: Vec<Origin>,
}

/// Where a field comes from; columns are indices.
enum Origin {
    Position(Recipe),
    Vector([usize; 3]),
    /// A column, and what it is multiplied by.
    Column(usize, f64),
}

impl Catalogue {
    /// Finds positions and known quantities among the columns of a table.
    ///
    /// # Errors
    /// When it has no positions or no rows, or states a unit that is not known, or cannot be read.
    pub(super) fn new(path: &Path, opened: Opened) -> Result<Catalogue, ImportError> {
        let Opened { table, format, bytes, mut notes } = opened;
        let positions = sky::positions(path, &*table)?.ok_or_else(|| sky::missing(path))?;
        let count = table.rows();
        if count == 0 {
            return Err(ImportError::NoParticles { path: path.into(), field: "rows".into() });
        }
        notes.extend(positions.note);
        let mut described = vec![Field {
            name: "position".into(),
            stored_as: positions.stored_as,
            unit: positions.unit.clone(),
            components: 3,
            kind: FieldKind::Position,
        }];
        let mut used: Vec<usize> = match &positions.recipe {
            Recipe::Cartesian { axes, .. } => axes.to_vec(),
            Recipe::Vector(column) => vec![*column],
            Recipe::Equatorial { .. } => Vec::new(),
        };
        let from_sky = positions.recipe.is_of_sky();
        let mut origins = vec![Origin::Position(positions.recipe)];
        if let Some((field, origin, columns)) = velocity(table.columns()) {
            described.push(field);
            origins.push(origin);
            used.extend(columns);
        }
        for (index, column) in table.columns().iter().enumerate() {
            if used.contains(&index) || table.is_blank(index) {
                continue;
            }
            let key = column.key();
            let free = |name: &str| !described.iter().any(|field: &Field| field.name == name);
            let standard = STANDARD
                .iter()
                .find(|(names, name, ..)| names.contains(&key.as_str()) && free(name) && column.components == 1);
            // Rows of which some have no id cannot be asked for by it.
            let lacks_ids = standard.is_some_and(|(_, _, kind, _)| *kind == FieldKind::Id) && table.lacks_ids(index);
            if lacks_ids {
                notes.push(format!("{} is no id, as it is not a whole number in every row", column.name));
            }
            let standard = standard.filter(|_| !lacks_ids);
            let (name, kind, unit) =
                standard.map_or((&*column.name, FieldKind::Other, ""), |(_, name, kind, unit)| (*name, *kind, *unit));
            // Names are counted, so that many of one name are not all tried for each.
            let same = described.iter().filter(|field| field.stored_as == column.name).count().max(1);
            let numbered = || (same + 1..).map(|number| format!("{name}-{number}")).find(|name| free(name));
            let other = (!free(name)).then(numbered).flatten();
            if let Some(other) = &other {
                notes.push(format!("there is another {}, called {}", shown(name), shown(other)));
            }
            let name = other.unwrap_or_else(|| name.to_owned());
            let mut unit = Unit::new(if column.unit.is_empty() { unit } else { &column.unit });
            let mut factor = 1.0;
            // Lengths of one table are compared: smoothing lengths take the unit of the positions.
            if kind == FieldKind::SmoothingLength {
                factor = units::conversion(path, &column.name, &unit.0, &positions.unit.0)?;
                if factor != 1.0 {
                    notes.push(format!("{} is converted from {unit} to {}", column.name, positions.unit));
                }
                unit = positions.unit.clone();
            }
            let (stored_as, components) = (column.name.clone(), column.components);
            described.push(Field { name, stored_as, unit, components, kind });
            origins.push(Origin::Column(index, factor));
        }
        let stars = from_sky || described.iter().any(|field| field.name == "magnitude");
        let mass_unit = described.iter().find(|field| field.kind == FieldKind::Mass).map(|field| field.unit.clone());
        let name = if stars { FamilyName::Stars } else { FamilyName::Dark };
        let description = Description {
            length_unit: positions.unit,
            mass_unit: mass_unit.unwrap_or_default(),
            notes,
            families: vec![FamilyInfo { name, count, fields: described }],
            ..Description::unitless(path, format, bytes)
        };
        Ok(Catalogue { description, table, origins })
    }

    /// The same of a table in so many files.
    pub(super) fn in_files(path: &Path, opened: Opened, files: usize) -> Result<Catalogue, ImportError> {
        let mut catalogue = Catalogue::new(path, opened)?;
        catalogue.description.files = files;
        Ok(catalogue)
    }
}

/// How the three columns of velocities are called, the second of AHF's.
pub(super) const VELOCITY_AXES: [[&str; 2]; 3] = [["vx", "vxc"], ["vy", "vyc"], ["vz", "vzc"]];

/// The columns `vx`, `vy`, `vz` (`vxc` and so on of AHF) as one field, else one of three numbers, and where it comes from.
fn velocity(columns: &[Column]) -> Option<(Field, Origin, Vec<usize>)> {
    let find = |names: &[&str], components: usize| {
        let is_called = |name: &&str| columns.iter().position(|own| own.key() == *name && own.components == components);
        names.iter().find_map(is_called)
    };
    let axes = VELOCITY_AXES.map(|names| find(&names, 1));
    let (origin, used) = match (axes, find(&VELOCITIES, 3)) {
        ([Some(x), Some(y), Some(z)], _) => (Origin::Vector([x, y, z]), vec![x, y, z]),
        (_, Some(column)) => (Origin::Column(column, 1.0), vec![column]),
        _ => return None,
    };
    let field = Field {
        name: "velocity".into(),
        stored_as: used.iter().map(|index| &*columns[*index].name).collect::<Vec<_>>().join(","),
        unit: Unit::new(&*columns[used[0]].unit),
        components: 3,
        kind: FieldKind::Velocity,
    };
    Some((field, origin, used))
}

impl Source for Catalogue {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        self.description.check_range(family, field, &range, out.len())?;
        match &self.origins[field] {
            Origin::Position(recipe) => recipe.read(&*self.table, range, out),
            Origin::Vector(columns) => {
                let out = out.as_chunks_mut::<3>().0;
                let mut values = vec![0.0; out.len()];
                for (axis, column) in columns.iter().enumerate() {
                    self.table.read(*column, range.clone(), &mut values)?;
                    out.iter_mut().zip(&values).for_each(|(vector, value)| vector[axis] = *value);
                }
                Ok(())
            }
            Origin::Column(column, factor) => {
                self.table.read(*column, range, out)?;
                if *factor != 1.0 {
                    out.iter_mut().for_each(|value| *value *= factor);
                }
                Ok(())
            }
        }
    }

    fn announce(&self, _family: usize, fields: &[usize]) {
        let columns = fields.iter().filter_map(|field| match self.origins.get(*field) {
            Some(Origin::Column(column, _)) => Some(*column),
            // Made of columns that every table has at hand.
            Some(Origin::Position(_) | Origin::Vector(_)) | None => None,
        });
        self.table.announce(&columns.collect::<Vec<usize>>());
    }

    fn at_hand_until(&self, _family: usize, row: u64) -> Option<u64> {
        self.table.at_hand_until(row)
    }

    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let about = self.description.check_range(family, field, &range, out.len())?;
        let wrong = |place: &str, found: String| {
            let field = format!("{}{place}", shown(&about.stored_as));
            ImportError::malformed(&self.description.path, field, found, "whole numbers from 0")
        };
        let (Origin::Column(column, _), 1) = (&self.origins[field], about.components) else {
            return Err(wrong("", format!("{} numbers a row", about.components)));
        };
        let found = ids::read(&*self.table, *column, range.clone())?;
        for ((row, place), id) in range.zip(out).zip(found) {
            *place = match id {
                Some(id) => id,
                None => {
                    let mut value = [f64::NAN];
                    self.table.read(*column, row..row + 1, &mut value)?;
                    let found = if value[0].is_nan() { "no number".to_owned() } else { value[0].to_string() };
                    return Err(wrong(&format!(" in row {}", row + 1), found));
                }
            };
        }
        Ok(())
    }
}
