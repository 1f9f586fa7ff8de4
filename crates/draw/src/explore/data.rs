//! The two kinds of data that can be asked: a page file and a source.

use super::error::ExploreError;
use crate::import::{FamilyInfo, FieldKind, Scalar, Source, find_source, open_with};
use crate::model::{Bounds, FamilyName, PeriodicBox, Unit, is_url};
use crate::store::{FamilyMetadata, PageFile, Tree};
use std::path::{Path, PathBuf};

/// What is asked. Cheap to copy.
#[derive(Clone, Copy)]
pub enum Data<'a> {
    /// A tree: fast; of a page file positions and values within its quantisation error.
    Pages(&'a dyn Tree),
    /// The source: exact, each of its particles is looked at.
    Source(&'a dyn Source),
}

/// A quantity and its unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldAbout {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
}

/// Positions that are looked at to tell whether a source is periodic.
const SAMPLE_RANGES: u64 = 32;
const SAMPLE_LENGTH: u64 = 512;

impl<'a> Data<'a> {
    /// The file.
    pub fn path(&self) -> &'a Path {
        match self {
            Data::Pages(file) => file.path(),
            Data::Source(source) => &source.description().path,
        }
    }

    /// Whether answers are exact.
    pub fn is_exact(&self) -> bool {
        matches!(self, Data::Source(_))
    }

    /// Unit of positions.
    pub fn length_unit(&self) -> &'a Unit {
        match self {
            Data::Pages(file) => &file.metadata().length_unit,
            Data::Source(source) => &source.description().length_unit,
        }
    }

    /// Unit of masses.
    pub fn mass_unit(&self) -> &'a Unit {
        match self {
            Data::Pages(file) => &file.metadata().mass_unit,
            Data::Source(source) => &source.description().mass_unit,
        }
    }

    /// The families and their numbers of particles, in the data's order.
    pub fn families(&self) -> Vec<(FamilyName, u64)> {
        match self {
            Data::Pages(file) => file.metadata().families.iter().map(|family| (family.name, family.count)).collect(),
            Data::Source(source) => {
                source.description().families.iter().map(|family| (family.name, family.count)).collect()
            }
        }
    }

    /// The quantities of family number `family` that regions, probes and histograms can name. Of a source, components of its vectors
    /// can be named too (`velocity-x`), but are not listed.
    pub fn fields(&self, family: usize) -> Vec<FieldAbout> {
        match self {
            Data::Pages(file) => file.metadata().families.get(family).map_or_else(Vec::new, |family| {
                let all = family.quantities.iter().chain(&family.attributes);
                all.map(|info| FieldAbout { name: info.name.clone(), unit: info.unit.clone() }).collect()
            }),
            Data::Source(source) => {
                let about = source.description();
                let info = about.families.get(family);
                let all = info.map_or_else(Vec::new, |info| Scalar::all(about, info));
                all.into_iter().map(|scalar| FieldAbout { name: scalar.name, unit: scalar.unit }).collect()
            }
        }
    }

    /// The unit of a quantity, of the first family that has it.
    pub fn unit_of(&self, field: &str) -> Option<Unit> {
        match self {
            Data::Pages(file) => {
                file.metadata().families.iter().find_map(|family| Some(column(family, field)?.1.clone()))
            }
            Data::Source(source) => {
                let about = source.description();
                about.families.iter().find_map(|info| Some(Scalar::named(about, info, field)?.unit))
            }
        }
    }

    /// Its time: of comoving data the scale factor, where it says that.
    pub fn time(&self) -> Option<f64> {
        match self {
            Data::Pages(file) => file.metadata().provenance.time,
            Data::Source(source) => source.description().scale_factor.or(source.description().time),
        }
    }

    /// The edge of the periodic box that the particles fill: the box size that the data states, if the particles lie within
    /// that box (of a source, a sample of them). Codes write a box size for isolated systems too, which lie around the origin.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub fn periodic_edge(&self) -> Result<Option<f64>, ExploreError> {
        let of = match self {
            Data::Pages(file) => file.metadata().periodic_box(),
            Data::Source(source) => match source.description().box_size {
                Some(stated) => PeriodicBox::of(Some(stated), sampled_bounds(*source)?),
                None => None,
            },
        };
        Ok(of.map(|of| of.edge))
    }

    /// An error about a field that no family has; names those that there are.
    pub(super) fn no_field(&self, field: &str) -> ExploreError {
        let mut names: Vec<String> = Vec::new();
        for family in 0..self.families().len() {
            for about in self.fields(family) {
                if !names.contains(&about.name) {
                    names.push(about.name);
                }
            }
        }
        ExploreError::missing(self.path(), format!("field {field}"), format!("one of {}", names.join(", ")))
    }
}

/// Where the source is that a page file was built from, as [`find_source`] has it. `None` where it is not there any more, or where
/// there are several.
pub fn source_path(file: &PageFile) -> Option<PathBuf> {
    // One source does not say what several files hold, nor where a file lies that was moved; and what comes from afar names no file here.
    if !file.is_as_its_source() || is_url(file.path()) {
        return None;
    }
    let source = &file.metadata().provenance;
    find_source(&source.path, file.path(), source.bytes)
}

/// Opens a source at `path`, from which a page file was built.
///
/// # Errors
/// [`ExploreError`] where it cannot be opened, or has another size than it had.
pub fn open_source(path: &Path, file: &PageFile) -> Result<Box<dyn Source>, ExploreError> {
    let source = open_with(path, file.read_method())?;
    let (found, built) = (source.description().bytes, file.metadata().provenance.bytes);
    if found != built {
        let expected = format!("{built}, of which {} was built", file.path().display());
        return Err(ExploreError::malformed(path, "size in bytes", found, expected));
    }
    Ok(source)
}

/// Opens the source that a page file was built from, where it is still there.
///
/// # Errors
/// [`ExploreError`] where it is not, and as [`open_source`].
pub fn source_of(file: &PageFile) -> Result<Box<dyn Source>, ExploreError> {
    if !file.is_as_its_source() {
        let expected = "one dataset in its own coordinates: its source is asked where it is open alone";
        return Err(ExploreError::missing(
            file.path(),
            "the source of several datasets, or of one that was moved",
            expected,
        ));
    }
    let source = file.metadata().provenance.path.display();
    let there = source_path(file).ok_or_else(|| {
        ExploreError::missing(file.path(), format!("its source {source}"), "the file that it was built from")
    })?;
    open_source(&there, file)
}

/// The box around finite positions spread evenly over each family.
fn sampled_bounds(source: &dyn Source) -> Result<Bounds, ExploreError> {
    let mut bounds = Bounds::EMPTY;
    let mut positions = Vec::new();
    for (family, info) in source.description().families.iter().enumerate() {
        let Some(field) = info.find(FieldKind::Position) else { continue };
        for part in 0..SAMPLE_RANGES {
            let start = (u128::from(info.count) * u128::from(part) / u128::from(SAMPLE_RANGES)) as u64;
            let end = info.count.min(start + SAMPLE_LENGTH);
            positions.resize((end - start) as usize, [0.0; 3]);
            source.read(family, field, start..end, positions.as_flattened_mut())?;
            let finite = positions.iter().filter(|at| at.iter().all(|x| x.is_finite()));
            bounds = bounds.union(Bounds::of(finite.copied()));
        }
    }
    Ok(bounds)
}

/// A column of a page file's codebooks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Column {
    Mass,
    Density,
    SmoothingLength,
    Attribute(usize),
}

impl Column {
    /// Its values by code.
    pub(super) fn of(self, codebook: &crate::codec::Codebook) -> &[f32] {
        match self {
            Column::Mass => &codebook.mass,
            Column::Density => &codebook.density,
            Column::SmoothingLength => &codebook.smoothing_length,
            Column::Attribute(index) => codebook.attributes.get(index).map_or(&[], Vec::as_slice),
        }
    }

    /// Its place among the errors of a codebook.
    pub(super) fn error_index(self) -> usize {
        match self {
            Column::Mass => 0,
            Column::Density => 1,
            Column::SmoothingLength => 2,
            Column::Attribute(index) => 3 + index,
        }
    }
}

/// The column of that name and its unit.
pub(super) fn column<'a>(family: &'a FamilyMetadata, field: &str) -> Option<(Column, &'a Unit)> {
    let own = [Column::Mass, Column::Density, Column::SmoothingLength];
    let quantity = family.quantities.iter().zip(own).find(|(info, _)| info.name == field);
    let attribute = || family.attribute(field).map(|(index, info)| (Column::Attribute(index), &info.unit));
    quantity.map(|(info, column)| (column, &info.unit)).or_else(attribute)
}

/// What the errors of a column of a page file are relative to: the value itself, or this range.
pub(super) fn error_scale(family: &FamilyMetadata, column: Column) -> Option<f64> {
    let Column::Attribute(index) = column else { return None };
    let info = family.attributes.get(index)?;
    let by_value = info.min > 0.0 && info.merge == crate::store::AttributeMerge::Mean;
    (!by_value).then_some(if info.max > info.min { info.max - info.min } else { 1.0 })
}

/// The scalars of a family that a source has under these names.
pub(super) fn scalars(source: &dyn Source, info: &FamilyInfo, names: &[String]) -> Vec<Option<Scalar>> {
    names.iter().map(|name| Scalar::named(source.description(), info, name)).collect()
}
