//! What every opened source can tell and read, whatever its format.

use super::ImportError;
use crate::model::{Cosmology, Epoch, FamilyName, Kernel, Motion, Unit};
use serde::Serialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What a field is to the import. Everything else about it is its name and unit. Fields are listed in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FieldKind {
    /// Particle positions, 3 components, length unit.
    Position,
    /// Velocities, 3 components.
    Velocity,
    /// Masses.
    Mass,
    /// Smoothing lengths as support radius (converted where the source means another convention).
    SmoothingLength,
    /// Mass densities.
    Density,
    /// Whole numbers that name particles.
    Id,
    /// Any other quantity.
    Other,
}

/// One field of one family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Field {
    /// Standard name in kebab case (`position`, `smoothing-length`, `internal-energy`), or the source's own name where
    /// there is no standard one.
    pub name: String,
    /// The source's own name for it: block label, path of the data set, column.
    pub stored_as: String,
    /// Unit of the values as [`Source::read`] gives them; empty when unknown.
    pub unit: Unit,
    /// Values per particle, at least 1.
    pub components: usize,
    /// What it is to the import.
    #[serde(skip)]
    pub kind: FieldKind,
}

/// One family of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyInfo {
    /// Which family.
    pub name: FamilyName,
    /// Number of particles, all files together; at least 1.
    pub count: u64,
    /// Its fields; exactly one has [`FieldKind::Position`], the other kinds but `Other` occur at most once.
    pub fields: Vec<Field>,
}

impl FamilyInfo {
    /// Index of the first field of `kind`.
    pub fn find(&self, kind: FieldKind) -> Option<usize> {
        self.fields.iter().position(|field| field.kind == kind)
    }

    /// Index of the field named `name`, by its standard name or by the source's own.
    pub fn named(&self, name: &str) -> Option<usize> {
        let standard = self.fields.iter().position(|field| field.name == name);
        standard.or_else(|| self.fields.iter().position(|field| field.stored_as == name))
    }
}

/// What a source says about itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Description {
    /// The file that was named.
    #[serde(skip)]
    pub path: PathBuf,
    /// The format's name: `gadget`, `gadget-hdf5`, `hdf5`, `swift`, `tipsy`, `csv`, ...
    pub format: String,
    /// Size of all files of the source, bytes.
    pub bytes: u64,
    /// Number of files of the source.
    pub files: usize,
    /// Unit of positions and smoothing lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// Kernel that the source's smoothing lengths belong to.
    pub kernel: Kernel,
    /// Simulation time, where the source says so.
    pub time: Option<f64>,
    /// Redshift, where the source says so.
    pub redshift: Option<f64>,
    /// Scale factor of a comoving snapshot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale_factor: Option<f64>,
    /// The universe around a comoving snapshot, where the source says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cosmology: Option<Cosmology>,
    /// What stored velocities mean.
    #[serde(skip)]
    pub motion: Motion,
    /// How many steps are in the file, of which this is one.
    #[serde(skip_serializing_if = "is_one")]
    pub steps: u64,
    /// Whether particles without ids stand in the same order at every step, as the format promises.
    #[serde(skip)]
    pub keeps_rows: bool,
    /// Edge of the periodic box, where there is one.
    pub box_size: Option<f64>,
    /// What the import assumed or converted, one sentence each.
    pub notes: Vec<String>,
    /// The families that hold particles, in Gadget's order.
    #[serde(skip)]
    pub families: Vec<FamilyInfo>,
}

/// Most files hold one step, which goes without saying.
fn is_one(steps: &u64) -> bool {
    *steps == 1
}

impl Description {
    /// One file without units, time or particles yet, with the cubic spline as its kernel.
    pub fn unitless(path: &Path, format: &str, bytes: u64) -> Description {
        Description {
            path: path.into(),
            format: format.into(),
            bytes,
            files: 1,
            length_unit: Unit::default(),
            mass_unit: Unit::default(),
            kernel: Kernel::CubicSpline,
            time: None,
            redshift: None,
            scale_factor: None,
            cosmology: None,
            motion: Motion::Unknown,
            steps: 1,
            keeps_rows: false,
            box_size: None,
            notes: Vec::new(),
            families: Vec::new(),
        }
    }

    /// Number of particles in all families.
    pub fn particles(&self) -> u64 {
        self.families.iter().map(|family| family.count).sum()
    }

    /// The source's place in time, and what its velocities mean.
    pub fn epoch(&self) -> Epoch {
        Epoch { time: self.time, scale_factor: self.scale_factor, cosmology: self.cosmology, motion: self.motion }
    }

    /// The field that a read asks for, after a look at whether it and the range exist and the buffer fits.
    ///
    /// # Errors
    /// [`ImportError`] when not.
    pub fn check_range(
        &self,
        family: usize,
        field: usize,
        range: &Range<u64>,
        values: usize,
    ) -> Result<&Field, ImportError> {
        let info = self.families.get(family);
        let found = info.and_then(|info| info.fields.get(field));
        let (Some(info), Some(found)) = (info, found) else {
            let name = format!("family {family}, field {field}");
            return Err(ImportError::missing(&self.path, name, "an index into the source's description"));
        };
        let rows = range.end.checked_sub(range.start).filter(|_| range.end <= info.count);
        if rows.and_then(|rows| rows.checked_mul(found.components as u64)) != Some(values as u64) {
            let asked = format!("particles {} to {} in a buffer of {values}", range.start, range.end);
            let expected = format!("{} values for each of {} particles", found.components, info.count);
            return Err(ImportError::malformed(&self.path, &*found.name, asked, expected));
        }
        Ok(found)
    }
}

/// An opened source: its description, and its fields in ranges of any size. Nothing is held in memory but what the
/// description needs; several threads may read at once.
pub trait Source: Send + Sync {
    /// What the source holds.
    fn description(&self) -> &Description;

    /// Reads the particles `range` of field `field` of family `family` (indices into the description) into `out`, particle
    /// by particle, `components` values each. `out` must hold exactly that many values. Whole numbers above 2^53 are
    /// rounded; undefined values come as NaN.
    ///
    /// # Errors
    /// [`ImportError`] when the file cannot be read there or its content is damaged, or the range does not exist.
    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError>;

    /// Says that all particles of some fields of a family are about to be read, maybe more than once. What takes long to read in ranges may be
    /// brought to where it does not when one of these fields is read.
    fn announce(&self, _family: usize, _fields: &[usize]) {}

    /// The row behind those that are at hand once a field of the row `row` is, where one field takes as long to read as all: who reads many fields
    /// is to read all of them up to there before any goes on. `None` where each is read for itself.
    fn at_hand_until(&self, _family: usize, _row: u64) -> Option<u64> {
        None
    }

    /// Reads the particles `range` of field `field`, which is one of ids, into `out`, exactly to all 64 bits. Formats that hold
    /// whole numbers as such, or as text, read them so; what holds them as floats has no ids above 2^53.
    ///
    /// # Errors
    /// As [`Source::read`], and where a value is not a whole number that is held exactly.
    fn read_ids(&self, family: usize, field: usize, range: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        let mut values = vec![0.0; out.len()];
        self.read(family, field, range, &mut values)?;
        for (id, value) in out.iter_mut().zip(values) {
            *id = exact_id(value).ok_or_else(|| {
                ImportError::malformed(&self.description().path, "ids", value, "whole numbers from 0 to 2^53")
            })?;
        }
        Ok(())
    }
}

/// The whole number that a float stands for, where it stands for that number alone.
pub(super) fn exact_id(value: f64) -> Option<u64> {
    (value.fract() == 0.0 && (0.0..=9_007_199_254_740_992.0).contains(&value)).then_some(value as u64)
}
