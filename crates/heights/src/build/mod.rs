//! Building the page file of a height field, in one pass over its rows and without temporary files.

mod bands;
mod coarse_chunk;
mod pass;
mod photo;
#[cfg(test)]
mod tests;

use crate::codec::heights;
use crate::codec::values::Values;
use crate::hierarchy::chunks::Lattice;
use crate::hierarchy::chunks::deviation::Range;
use crate::import::HeightSource;
use crate::import::suspects::Suspects;
use crate::model::{HeightError, HeightGrid, Heights, Invalid, PhotoRows, Window, units};
use crate::store::{HeightAbout, Rounded};
use deepfield_data::model::progress::Progress;
use deepfield_data::store::StoreError;
use std::path::{Path, PathBuf};

/// How a file of heights is built.
#[derive(Clone, Debug, Default)]
pub struct HeightBuildOptions {
    /// Memory that the build may take, bytes; the file is the same whatever it is. Nothing: as much as it needs.
    pub memory: Option<u64>,
    /// How many threads work; nothing: one a core. The file is the same with any number.
    pub threads: Option<usize>,
    /// How far heights may be from the source's, in their unit, so that the file is smaller; nothing: they are the source's own.
    pub height_error: Option<f64>,
    /// Whether the file goes with the program, so that nobody waits until the disk has it.
    pub is_temporary: bool,
}

impl HeightBuildOptions {
    /// What there is to tell where heights may be off, but rounding them makes no difference to what was built.
    pub fn not_rounded(&self, built: &HeightAbout) -> Option<String> {
        let error = self.height_error.filter(|_| built.rounded.is_none())?;
        let kept = built.grid.sample_type;
        Some(format!("heights stay as they are: an error of {error} is less than {kept} samples can be rounded by"))
    }
}

/// Where heights come from, as the file tells it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeightOrigin {
    /// The file that was named.
    pub path: PathBuf,
    /// Its format's name.
    pub format: String,
    /// Its size, bytes.
    pub bytes: u64,
    /// Whether it says how far samples are apart.
    pub has_spacing: bool,
    /// What the import assumed, one sentence each.
    pub notes: Vec<String>,
    /// Of a page file, whose samples are built again, how they were rounded.
    pub rounded: Option<Rounded>,
}

/// What is seen of samples while they are read.
#[derive(Clone, Debug)]
pub struct Seen {
    /// What was not measured, by kind.
    pub invalid: Invalid,
    /// Values that look as if they were not.
    pub suspects: Suspects,
    /// Of samples that are rounded, the range before that.
    pub range: Range,
}

impl Seen {
    /// Nothing yet.
    pub fn none() -> Seen {
        Seen { invalid: Invalid::default(), suspects: Suspects::none(), range: Range::NONE }
    }

    /// These, and those of other samples.
    pub fn and(self, other: &Seen) -> Seen {
        let mut range = self.range;
        range.join(other.range);
        Seen { invalid: self.invalid.and(other.invalid), suspects: self.suspects.and(&other.suspects), range }
    }
}

/// Heights that tell why samples were not measured, and which photo lies over them. Several threads may read at once.
pub trait Measured: Heights {
    /// Reads as [`Heights::stored`] does, and counts what was not measured, and what looks so.
    ///
    /// # Errors
    /// As [`Heights::stored`].
    fn measured(&self, window: Window, out: &mut [f64]) -> Result<Seen, HeightError> {
        self.stored(window, out)?;
        let nan = out.iter().filter(|value| value.is_nan()).count() as u64;
        Ok(Seen { invalid: Invalid { nan, ..Invalid::default() }, ..Seen::none() })
    }

    /// The photo that lies over them.
    fn photo_rows(&self) -> Option<Box<dyn PhotoRows + '_>> {
        None
    }
}

impl Measured for crate::model::HeightField {}

impl Measured for crate::store::HeightFile {
    fn photo_rows(&self) -> Option<Box<dyn PhotoRows + '_>> {
        crate::store::PhotoOfFile::of(self).map(|photo| Box::new(photo) as Box<dyn PhotoRows>)
    }
}

impl Measured for HeightSource {
    fn measured(&self, window: Window, out: &mut [f64]) -> Result<Seen, HeightError> {
        self.read(window, out)?;
        let mut invalid = Invalid::default();
        let no_data = self.no_data();
        for value in out.iter_mut() {
            if no_data.is(*value) || crate::import::is_masked(*value) {
                invalid.no_data += 1;
            } else if value.is_nan() {
                invalid.nan += 1;
            } else if value.is_infinite() {
                invalid.infinite += 1;
            } else {
                continue;
            }
            *value = f64::NAN;
        }
        let suspects = Suspects::among(out.iter().copied().filter(|value| !value.is_nan()));
        Ok(Seen { invalid, suspects, ..Seen::none() })
    }

    fn photo_rows(&self) -> Option<Box<dyn PhotoRows + '_>> {
        self.photo().map(|photo| Box::new(photo) as Box<dyn PhotoRows>)
    }
}

impl HeightOrigin {
    /// Of an opened source.
    pub fn of(source: &HeightSource) -> HeightOrigin {
        let about = source.description();
        HeightOrigin {
            path: about.path.clone(),
            format: about.format.into(),
            bytes: about.bytes,
            has_spacing: about.has_spacing,
            notes: about.notes.clone(),
            rounded: None,
        }
    }
}

/// Why a file of heights cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum HeightBuildError {
    /// The source cannot be read.
    #[error(transparent)]
    Heights(#[from] HeightError),
    /// The file cannot be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The samples are of a type that heights have not.
    #[error("{path}: samples: found {found}, expected whole numbers of at most 32 bits, or floats")]
    Type {
        /// The source.
        path: PathBuf,
        /// Their type.
        found: String,
    },
    /// Nothing was measured.
    #[error("{path}: samples: found {invalid} of {samples} that were not measured, expected some that were")]
    Nothing {
        /// The source.
        path: PathBuf,
        /// Samples that were not measured.
        invalid: u64,
        /// All samples.
        samples: u64,
    },
    /// Heights cannot be rounded like this.
    #[error("{path}: --height-error: found {found}, expected {expected}")]
    Rounding {
        /// The source.
        path: PathBuf,
        /// What was asked for.
        found: String,
        /// What may be.
        expected: String,
    },
    /// The build needs more memory than it may take.
    #[error(
        "{path}: memory: rows of {columns} samples{photo} take about {needed} MiB, found {allowed} MiB that the build may take"
    )]
    Memory {
        /// The output.
        path: PathBuf,
        /// Samples of a row.
        columns: u64,
        /// What else there is: of a photo its size, else nothing.
        photo: String,
        /// Mebibytes needed.
        needed: u64,
        /// Mebibytes allowed.
        allowed: u64,
    },
    /// Threads cannot be started.
    #[error("starting {threads} threads: {reason}")]
    Threads {
        /// How many.
        threads: usize,
        /// Why not.
        reason: String,
    },
}

/// Builds the page file of a field at `output`: reads each row once, in order, and writes chunks of all levels, children before their parents.
///
/// The file is the same, byte for byte, for any number of threads and any memory.
///
/// # Errors
/// Where the source cannot be read or has nothing in it, the file cannot be written, or the memory is too little. Nothing is left behind then.
pub fn build_heights(
    source: &dyn Measured,
    origin: &HeightOrigin,
    options: &HeightBuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<HeightAbout, HeightBuildError> {
    let grid = source.grid();
    if !heights::is_coded(grid.sample_type) {
        return Err(HeightBuildError::Type { path: origin.path.clone(), found: grid.sample_type.to_string() });
    }
    let rounded = rounded(grid, origin, options.height_error)?;
    let lattice = Lattice::new(grid.rows, grid.columns);
    let work = || pass::build(source, origin, options, rounded, lattice, output, progress);
    match options.threads {
        None => work(),
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let failed =
                |error: rayon::ThreadPoolBuildError| HeightBuildError::Threads { threads, reason: error.to_string() };
            pool.map_err(failed)?.install(work)
        }
    }
}

/// How samples are rounded where heights may be off by an error; nothing where all values of the type are left.
fn rounded(grid: &HeightGrid, origin: &HeightOrigin, error: Option<f64>) -> Result<Option<Rounded>, HeightBuildError> {
    let Some(error) = error else { return Ok(origin.rounded) };
    let wrong = |found: String, expected: &str| {
        Err(HeightBuildError::Rounding { path: origin.path.clone(), found, expected: expected.into() })
    };
    if let Some(own) = origin.rounded {
        let found = format!("{error} for a page file that is within {} of this source", own.error);
        return wrong(found, "the source itself to build from");
    }
    if error.is_nan() || error.is_infinite() || error <= 0.0 {
        return wrong(error.to_string(), "a number above 0");
    }
    let values = Values::within(grid.sample_type, grid.scale, error);
    Ok(values.step().map(|_| Rounded { error, values }))
}

/// Metres of a degree of a sphere's great circle as large as the Earth.
const METRES_OF_DEGREE: f64 = 6_371_008.8 * std::f64::consts::PI / 180.0;

/// What turns differences of stored samples along columns and rows into slopes in space. Degrees are those of the Earth, of longitude at the
/// middle of the field; where units are not known, places and heights are taken as in one unit.
pub fn slopes(grid: &HeightGrid) -> [f64; 2] {
    let heights = units::metres(&grid.height_unit);
    let degrees = units::is_degrees(&grid.xy_unit);
    let places = if degrees { Some(METRES_OF_DEGREE) } else { units::metres(&grid.xy_unit) };
    let lift = match (heights, places) {
        (Some(heights), Some(places)) => heights / places,
        (None, Some(places)) if degrees => 1.0 / places,
        _ => 1.0,
    };
    let [_, middle] = grid.place((grid.rows - 1) as f64 / 2.0, 0.0);
    let narrow = if degrees { libm::cos(middle.to_radians()).abs().max(0.01) } else { 1.0 };
    [grid.scale.slope * lift / (grid.step[0] * narrow), grid.scale.slope * lift / grid.step[1]]
}
