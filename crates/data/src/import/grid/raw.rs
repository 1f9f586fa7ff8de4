//! Samples without a header: what they are is said by the user, or by a file `NAME.ron` beside them.

use super::content::Content;
use super::layout::{INTERLEAVED, Layout};
use super::source::checked;
use super::{GridDescription, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType, Unit, ron_file};
use glam::{DAffine3, DVec3};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The format's name in messages.
pub(super) const NAME: &str = "raw";

/// What a file without a header holds.
#[derive(Clone, Debug, PartialEq)]
pub struct RawGrid {
    /// Samples along each axis, the fastest first; two of an image, three of a volume.
    pub shape: Vec<u64>,
    /// How each is stored.
    pub sample_type: SampleType,
    /// Distance of samples along each axis, as many as `shape` has; empty for 1.
    pub spacing: Vec<f64>,
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
    /// Values of a sample, side by side.
    pub channels: u64,
    /// Bytes before the first sample.
    pub offset: u64,
    /// Unit of the spacing; empty when unknown.
    pub length_unit: Unit,
}

/// The same, as a file beside the samples says it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    shape: Vec<u64>,
    r#type: String,
    #[serde(default)]
    spacing: Vec<f64>,
    #[serde(default)]
    big_endian: bool,
    #[serde(default = "one")]
    channels: u64,
    #[serde(default)]
    offset: u64,
    #[serde(default)]
    length_unit: String,
}

fn one() -> u64 {
    1
}

/// The file that describes the samples at `path`.
fn description_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".ron");
    name.into()
}

/// Whether a file is one of samples without a header: its name ends in `.raw`, or a description lies beside it.
pub(super) fn is_raw(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("raw")) || description_of(path).is_file()
}

/// Opens samples as the file beside them says.
///
/// # Errors
/// [`ImportError`] where there is none, it is wrong, or the file is too short.
pub(super) fn open_described(content: &Content) -> Result<GridSource, ImportError> {
    let description = description_of(&content.path);
    if !description.is_file() {
        let name = description.file_name().unwrap_or_default().to_string_lossy().into_owned();
        return Err(ImportError::missing(
            &content.path,
            "shape",
            format!("{name} beside it, or --shape of info, build or reconstruct"),
        ));
    }
    let wrong = |message: String| ImportError::malformed(&content.path, "description", message, "one that can be read");
    let read: Described = ron_file::read(&description).map_err(|error| wrong(error.to_string()))?;
    let sample_type = read.r#type.parse();
    let sample_type =
        sample_type.map_err(|expected: String| ImportError::malformed(&description, "type", &read.r#type, expected))?;
    let Described { shape, spacing, big_endian, channels, offset, length_unit, .. } = read;
    let length_unit = Unit::new(length_unit);
    let mut source =
        RawGrid { shape, sample_type, spacing, big_endian, channels, offset, length_unit }.open(content)?;
    source.note(format!("described by {}", description.file_name().unwrap_or_default().to_string_lossy()));
    Ok(source)
}

impl RawGrid {
    /// Opens samples that are what this says.
    ///
    /// # Errors
    /// [`ImportError`] where this cannot be, or the file is too short.
    pub(super) fn open(&self, content: &Content) -> Result<GridSource, ImportError> {
        let path = &*content.path;
        let channels = self.channels.min(4097);
        let mut grid = match self.shape[..] {
            [x, y] => Grid::image([x, y], self.sample_type, Channel::of_picture(channels)),
            [x, y, z] => Grid::volume([x, y, z], self.sample_type, Channel::numbered(channels)),
            _ => {
                let found = format!("{} axes", self.shape.len());
                return Err(ImportError::malformed(path, "shape", found, "2 (an image) or 3 (a volume)"));
            }
        };
        let count = self.shape.len();
        if !self.spacing.is_empty() {
            if self.spacing.len() != count || self.spacing.iter().any(|step| !(*step > 0.0 && step.is_finite())) {
                let found = self.spacing.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
                return Err(ImportError::malformed(path, "spacing", found, format!("{count} positive numbers")));
            }
            let step = |axis: usize| self.spacing.get(axis).copied().unwrap_or(1.0);
            let scale = DAffine3::from_scale(DVec3::new(step(0), step(1), step(2)));
            grid.to_world = scale * grid.to_world;
        }
        grid.length_unit = self.length_unit.clone();
        let bytes = checked(path, &grid, "shape", "spacing")?;
        let storage = content.samples(self.offset, bytes, &grid)?;
        let order = if self.big_endian { Order::Big } else { Order::Little };
        let layout = Layout::packed(&grid, INTERLEAVED, if content.is_packed { 0 } else { self.offset }, order);
        let mut about = GridDescription::new(path, NAME, content.length, grid);
        let left = content.length.saturating_sub(self.offset).saturating_sub(bytes);
        if !content.is_packed && left > 0 {
            about.notes.push(format!("{left} bytes behind the samples are left out"));
        }
        Ok(GridSource::new(about, storage, layout))
    }
}
