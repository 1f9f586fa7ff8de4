//! The rows of a source as it has them: every quantity in double precision, ids as whole numbers, and which rows count. For
//! whoever looks closer than a picture needs.

use super::attributes::{self, Part};
use super::check::{Flaws, chunks};
use super::choice::Chosen;
use super::{Description, FamilyInfo, FieldKind, ImportError, Smoothing, Source};
use crate::model::Unit;
use std::ops::Range;

/// One number per row: a scalar field, a component of a vector or its length.
#[derive(Clone, Debug, PartialEq)]
pub struct Scalar {
    /// Its name, as attributes are named: `temperature`, `speed`, `velocity-x`.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    field: usize,
    part: Part,
}

impl Scalar {
    /// The quantity of that name in a family, by standard name or the source's own; `speed` and `velocity-x` and so on come out
    /// of vectors.
    pub fn named(about: &Description, info: &FamilyInfo, name: &str) -> Option<Scalar> {
        let planned = attributes::named(about, info, name)?;
        // Ids are names, not quantities.
        (info.fields[planned.field].kind != FieldKind::Id).then_some(Scalar {
            name: planned.name,
            unit: planned.unit,
            field: planned.field,
            part: planned.part,
        })
    }

    /// Every scalar field of a family, and the speed.
    pub fn all(about: &Description, info: &FamilyInfo) -> Vec<Scalar> {
        let scalar = |field: &&super::Field| field.components == 1 && field.kind != FieldKind::Id;
        let names = info.fields.iter().filter(scalar).map(|field| field.name.as_str()).chain(["speed"]);
        names.filter_map(|name| Scalar::named(about, info, name)).collect()
    }
}

/// The rows of one family of an opened source.
pub struct FamilyRows<'a> {
    source: &'a dyn Source,
    family: usize,
    info: &'a FamilyInfo,
    chosen: Chosen,
}

impl<'a> FamilyRows<'a> {
    /// The rows of family `family` of the source's description.
    ///
    /// # Errors
    /// When the source cannot be read, or there is no such family or it has no positions.
    pub fn new(source: &'a dyn Source, family: usize) -> Result<FamilyRows<'a>, ImportError> {
        let chosen = Chosen::of(source, family, &Smoothing::Auto)?;
        Ok(FamilyRows { source, family, info: &source.description().families[family], chosen })
    }

    /// The family.
    pub fn info(&self) -> &'a FamilyInfo {
        self.info
    }

    /// Whether the source has masses; each row counts 1 where it has not.
    pub fn has_masses(&self) -> bool {
        self.chosen.mass.is_some()
    }

    /// All rows in ranges of bounded length.
    pub fn ranges(&self) -> Vec<Range<u64>> {
        chunks(self.info.count)
    }

    /// Reads positions.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub fn positions(&self, range: Range<u64>, out: &mut Vec<[f64; 3]>) -> Result<(), ImportError> {
        out.resize(length(&range), [0.0; 3]);
        self.source.read(self.family, self.chosen.position, range, out.as_flattened_mut())
    }

    /// Reads masses, and drops from `rows` (numbers within the range, ascending) those that a load leaves out: with a position
    /// that is not finite, or a mass or smoothing length that is not positive.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub fn masses(
        &self,
        range: Range<u64>,
        positions: &[[f64; 3]],
        rows: &mut Vec<u32>,
        mass: &mut Vec<f64>,
    ) -> Result<(), ImportError> {
        let count = length(&range);
        let mut lengths = Vec::new();
        if let Some(field) = self.chosen.smoothing_length {
            lengths.resize(count, 0.0);
            self.source.read(self.family, field, range.clone(), &mut lengths)?;
        }
        mass.clear();
        mass.resize(count, 1.0);
        if let Some(field) = self.chosen.mass {
            self.source.read(self.family, field, range, mass)?;
        }
        rows.retain(|&row| {
            let row = row as usize;
            let of = |values: &[f64]| values.get(row).map(|&value| value as f32);
            positions.get(row).is_some_and(|&at| Flaws::of(at, of(mass), of(&lengths)).none())
        });
        Ok(())
    }

    /// Reads a scalar of the rows `rows` (numbers within the range) of a range; `buffer` is room to work in.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub fn scalar(
        &self,
        scalar: &Scalar,
        range: Range<u64>,
        rows: &[u32],
        buffer: &mut Vec<f64>,
        out: &mut Vec<f64>,
    ) -> Result<(), ImportError> {
        let components = self.field(scalar.field, range, buffer)?;
        let of = |&row: &u32| buffer.get(row as usize * components..(row as usize + 1) * components);
        out.clear();
        out.extend(rows.iter().map(|row| of(row).map_or(f64::NAN, |values| scalar.part.exact(values))));
        Ok(())
    }

    /// Reads every component of field `field` of the rows `rows` of a range, row by row.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub fn vector(
        &self,
        field: usize,
        range: Range<u64>,
        rows: &[u32],
        buffer: &mut Vec<f64>,
        out: &mut Vec<f64>,
    ) -> Result<(), ImportError> {
        let components = self.field(field, range, buffer)?;
        out.clear();
        for &row in rows {
            let values = buffer.get(row as usize * components..(row as usize + 1) * components);
            out.extend_from_slice(values.unwrap_or_default());
        }
        Ok(())
    }

    fn field(&self, field: usize, range: Range<u64>, buffer: &mut Vec<f64>) -> Result<usize, ImportError> {
        let components = self.info.fields.get(field).map_or(1, |field| field.components);
        buffer.resize(length(&range) * components, 0.0);
        self.source.read(self.family, field, range, buffer)?;
        Ok(components)
    }

    /// Whether the family has ids.
    pub fn has_ids(&self) -> bool {
        self.info.find(FieldKind::Id).is_some()
    }

    /// Reads the ids of a range, exactly.
    ///
    /// # Errors
    /// When the source has none, cannot be read, or has something else than whole numbers from 0 in their place.
    pub fn ids(&self, range: Range<u64>, out: &mut Vec<u64>) -> Result<(), ImportError> {
        let Some(field) = self.info.find(FieldKind::Id) else {
            let path = &self.source.description().path;
            return Err(ImportError::missing(path, format!("ids of {}", self.info.name), "a field of particle ids"));
        };
        out.resize(length(&range), 0);
        self.source.read_ids(self.family, field, range, out)
    }
}

fn length(range: &Range<u64>) -> usize {
    range.end.saturating_sub(range.start) as usize
}
