//! An opened height field: what it says about itself, and its samples in windows.

use super::content::Content;
use super::photo::Photo;
use crate::model::{HeightError, HeightGrid, Heights, Window};
use deepfield_data::import::ImportError;
use std::path::PathBuf;

/// What an opened field says about itself.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightDescription {
    /// The file that was named.
    pub path: PathBuf,
    /// The format's name: `sur`, `x3p`, `geotiff`, ...
    pub format: &'static str,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// The grid.
    pub grid: HeightGrid,
    /// Whether the source says how far samples are apart.
    pub has_spacing: bool,
    /// What the import assumed or left out, one sentence each.
    pub notes: Vec<String>,
}

impl HeightDescription {
    /// A file that holds `grid`, in messages and in `info`; distances are not stated.
    pub(super) fn new(content: &Content, format: &'static str, grid: HeightGrid) -> HeightDescription {
        let (path, bytes) = (content.path.clone(), content.length);
        HeightDescription { path, format, bytes, grid, has_spacing: false, notes: Vec::new() }
    }
}

/// What is read in place of samples that a mask beside them declares as not measured: a NaN of its own, so that it is told from those that a file
/// stores.
pub(super) const MASKED: f64 = f64::from_bits(0x7ff8_6d61_736b_6564);

/// Whether this is [`MASKED`].
pub fn is_masked(stored: f64) -> bool {
    stored.to_bits() == MASKED.to_bits()
}

/// What stands for samples that were not measured, beside what is no finite number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum NoData {
    /// Nothing.
    #[default]
    Nothing,
    /// One stored value.
    Value(f64),
    /// Stored values from the first up to the second.
    Range(f64, f64),
}

impl NoData {
    /// Whether a stored value is no data.
    pub fn is(self, stored: f64) -> bool {
        match self {
            NoData::Nothing => false,
            NoData::Value(value) => stored == value,
            NoData::Range(low, high) => (low..=high).contains(&stored),
        }
    }
}

/// Samples as a file holds them.
pub trait Samples: Send + Sync {
    /// Reads the samples of a window, which is in the grid, as they are stored: what stands for no data is among them.
    ///
    /// # Errors
    /// Where they cannot be read.
    fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError>;

    /// Reads a colour plane's values of a window.
    ///
    /// # Errors
    /// Where they cannot be read.
    fn read_plane(&self, _plane: usize, _window: Window, _out: &mut [u8]) -> Result<(), ImportError> {
        Ok(())
    }
}

/// An opened field. Several threads may read at once.
pub struct HeightSource {
    about: HeightDescription,
    samples: Box<dyn Samples>,
    no_data: NoData,
    photo: Option<Photo>,
}

impl std::fmt::Debug for HeightSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("HeightSource")
            .field("about", &self.about)
            .field("no_data", &self.no_data)
            .finish_non_exhaustive()
    }
}

impl HeightSource {
    /// A field whose samples lie in `samples`.
    pub(super) fn new(about: HeightDescription, samples: Box<dyn Samples>, no_data: NoData) -> HeightSource {
        HeightSource { about, samples, no_data, photo: None }
    }

    /// What the source says about itself.
    pub fn description(&self) -> &HeightDescription {
        &self.about
    }

    /// The same to change, while it is opened.
    pub(super) fn description_mut(&mut self) -> &mut HeightDescription {
        &mut self.about
    }

    /// The same with a note.
    #[must_use]
    pub fn noting(mut self, note: String) -> HeightSource {
        self.about.notes.push(note);
        self
    }

    /// What stands for samples that were not measured.
    pub fn no_data(&self) -> NoData {
        self.no_data
    }

    /// Sets it: the user knows better.
    pub(super) fn set_no_data(&mut self, no_data: NoData) {
        self.no_data = no_data;
    }

    /// The photo that lies over it.
    pub fn photo(&self) -> Option<&Photo> {
        self.photo.as_ref()
    }

    /// Lays a photo over it.
    pub(super) fn lay(&mut self, photo: Photo) {
        self.photo = Some(photo);
    }

    /// Reads samples as the file holds them, what stands for no data among them.
    ///
    /// # Errors
    /// Where they cannot be read, or the window is not in the grid.
    pub fn read(&self, window: Window, out: &mut [f64]) -> Result<(), ImportError> {
        self.check(window, out.len())?;
        self.samples.read(window, out)
    }

    fn check(&self, window: Window, len: usize) -> Result<(), ImportError> {
        let grid = &self.about.grid;
        if window.is_in(grid) && window.samples() == len as u64 {
            return Ok(());
        }
        let found =
            format!("{} x {} from row {}, column {} in {len}", window.columns, window.rows, window.row, window.column);
        Err(ImportError::malformed(&self.about.path, "window", found, format!("a part of {}", grid.described())))
    }
}

impl Heights for HeightSource {
    fn grid(&self) -> &HeightGrid {
        &self.about.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.read(window, out)?;
        let no_data = self.no_data;
        for value in out.iter_mut().filter(|value| !value.is_finite() || no_data.is(**value)) {
            *value = f64::NAN;
        }
        Ok(())
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.check(window, out.len())?;
        Ok(self.samples.read_plane(plane, window, out)?)
    }
}
