//! What a field holds: the content of `info --json`.

use super::proportions;
use super::source::is_masked;
use super::suspects::Suspects;
use super::{HeightDescription, HeightSource};
use crate::model::facts::facts_by;
use crate::model::{Facts, HeightGrid, Invalid, PhotoAbout, Plane, Window};
use deepfield_data::import::ImportError;
use deepfield_data::model::{SampleType, Unit};
use serde::Serialize;
use std::path::Path;

/// A colour plane's name.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaneSummary {
    /// `red`, `green`, `blue`, or the source's own; of a photo `texture`.
    pub name: String,
    /// Of a photo what is known of it.
    #[serde(flatten)]
    pub photo: Option<PhotoSummary>,
}

/// What `info` says of a photo.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhotoSummary {
    /// Pixels of a row.
    pub columns: u64,
    /// Rows.
    pub rows: u64,
    /// The file that it is from.
    pub source: String,
    /// x and y of its first and its last corner, in `xy_unit`.
    pub corners: [[f64; 2]; 2],
}

impl PlaneSummary {
    /// Of a colour plane.
    fn of(plane: &Plane) -> PlaneSummary {
        PlaneSummary { name: plane.name.clone(), photo: None }
    }

    /// Of a photo over a grid.
    pub(crate) fn of_photo(about: &PhotoAbout, grid: &HeightGrid) -> PlaneSummary {
        let ([rows, columns], place) = (about.size, about.place);
        let corners = [0, 1].map(|end| grid.place(place.rows[end], place.columns[end]));
        let source = about.path.display().to_string();
        PlaneSummary { name: "texture".into(), photo: Some(PhotoSummary { columns, rows, source, corners }) }
    }
}

/// Everything that `info --json` says about a field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeightSummary {
    /// `heights`.
    pub kind: &'static str,
    /// The file.
    pub path: String,
    /// The format's name.
    pub format: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Samples of a row.
    pub columns: u64,
    /// Rows.
    pub rows: u64,
    /// Number of samples.
    pub samples: u64,
    /// Those that were measured.
    pub valid: u64,
    /// Their share.
    pub valid_share: f64,
    /// The others, by what stands in their place.
    pub invalid: Invalid,
    /// Measured samples that are in no triangle.
    pub lone: u64,
    /// Where sample (0, 0) is, in `xy_unit`.
    pub origin: [f64; 2],
    /// From a column to the next, and from a row to the next, with signs.
    pub spacing: [f64; 2],
    /// Unit of places; empty when unknown.
    pub xy_unit: Unit,
    /// Unit of heights; empty when unknown.
    pub height_unit: Unit,
    /// How a sample is stored: `i16`, `f32`, ...
    pub sample_type: &'static str,
    /// The least height.
    pub min: f64,
    /// The largest height.
    pub max: f64,
    /// The mean of all heights.
    pub mean: f64,
    /// Colour planes.
    pub planes: Vec<PlaneSummary>,
    /// The coordinate reference system as the source names it.
    pub crs: Option<String>,
    /// What the import assumed or left out, a sentence each.
    pub notes: Vec<String>,
}

impl HeightSummary {
    /// Of a file of this format and so many bytes, by what its samples say.
    pub(crate) fn of(
        (path, format, bytes): (&Path, &str, u64),
        grid: &HeightGrid,
        facts: &Facts,
        invalid: Invalid,
        notes: Vec<String>,
    ) -> HeightSummary {
        HeightSummary {
            kind: "heights",
            path: path.display().to_string(),
            format: format.to_owned(),
            bytes,
            columns: grid.columns,
            rows: grid.rows,
            samples: grid.samples(),
            valid: facts.valid,
            valid_share: facts.valid as f64 / grid.samples() as f64,
            invalid,
            lone: facts.lone,
            origin: grid.origin,
            spacing: grid.step,
            xy_unit: grid.xy_unit.clone(),
            height_unit: grid.height_unit.clone(),
            sample_type: short_name(grid.sample_type),
            min: facts.min,
            max: facts.max,
            mean: facts.mean,
            planes: grid.planes.iter().map(PlaneSummary::of).collect(),
            crs: grid.crs.clone(),
            notes,
        }
    }
}

/// Reads all samples once, in bounded bands.
///
/// # Errors
/// [`ImportError`] when the source cannot be read, or none of its samples was measured.
pub fn summarize_heights(source: &HeightSource) -> Result<HeightSummary, ImportError> {
    let HeightDescription { path, format, bytes, grid, mut notes, .. } = source.description().clone();
    let no_data = source.no_data();
    let read = |window: Window, out: &mut [f64]| source.read(window, out);
    // What was not measured is counted by kind, and made NaN.
    let is_measured = |stored: f64| stored.is_finite() && !no_data.is(stored);
    let see = |rows: &mut [f64], is_counted: bool| {
        let mut invalid = Invalid::default();
        let mut suspects = Suspects::none();
        if is_counted {
            suspects = Suspects::among(rows.iter().copied().filter(|stored| is_measured(*stored)));
        }
        for sample in rows.iter_mut() {
            let stored = *sample;
            if is_measured(stored) {
                continue;
            }
            let kind = if is_masked(stored) || no_data.is(stored) {
                &mut invalid.no_data
            } else if stored.is_nan() {
                &mut invalid.nan
            } else {
                &mut invalid.infinite
            };
            *kind += 1;
            *sample = f64::NAN;
        }
        (invalid, suspects)
    };
    let (facts, seen) = facts_by(&grid, read, see)?;
    let (mut invalid, mut suspects) = (Invalid::default(), Suspects::none());
    for (more, others) in &seen {
        (invalid, suspects) = (invalid.and(*more), suspects.and(others));
    }
    if facts.valid == 0 {
        let expected = format!("at least one that was measured ({}, {})", grid.described(), told(&invalid));
        return Err(ImportError::malformed(&path, "valid samples", format!("0 of {}", grid.samples()), expected));
    }
    notes.extend(suspects.note(&grid));
    notes.extend(proportions::note(&grid, [facts.min, facts.max]));
    Ok(HeightSummary::of((&path, format, bytes), &grid, &facts, invalid, notes))
}

/// Counts in words.
fn told(invalid: &Invalid) -> String {
    format!("{} no data, {} NaN, {} infinite", invalid.no_data, invalid.nan, invalid.infinite)
}

/// A type's name as it is in `info`.
pub fn short_name(sample_type: SampleType) -> &'static str {
    match sample_type {
        SampleType::I8 => "i8",
        SampleType::U8 => "u8",
        SampleType::I16 => "i16",
        SampleType::U16 => "u16",
        SampleType::I32 => "i32",
        SampleType::U32 => "u32",
        SampleType::I64 => "i64",
        SampleType::U64 => "u64",
        SampleType::F32 => "f32",
        SampleType::F64 => "f64",
    }
}
