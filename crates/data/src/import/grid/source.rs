//! An opened grid: what it says about itself, and its samples in boxes of any size.

use super::super::ImportError;
use super::layout::Layout;
use super::scratch::Storage;
use crate::model::{Grid, Region};
use std::path::{Path, PathBuf};

/// The most channels of a sample that are read.
pub(super) const MOST_CHANNELS: usize = 4096;

/// What an opened grid says about itself.
#[derive(Clone, Debug, PartialEq)]
pub struct GridDescription {
    /// The file that was named.
    pub path: PathBuf,
    /// The format's name: `nrrd`, `nifti`, `png`, ...
    pub format: String,
    /// Number of files of the source.
    pub files: usize,
    /// Size of all of them, bytes.
    pub bytes: u64,
    /// The grid.
    pub grid: Grid,
    /// What the import assumed or left out, one sentence each.
    pub notes: Vec<String>,
}

impl GridDescription {
    /// One file that holds `grid`.
    pub(super) fn new(path: &Path, format: &str, bytes: u64, grid: Grid) -> GridDescription {
        GridDescription { path: path.into(), format: format.into(), files: 1, bytes, grid, notes: Vec::new() }
    }
}

/// An array of a file that may have several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GridArray {
    /// Its name, with those of the groups that it is in.
    pub name: String,
    /// Samples along each axis, the slowest first.
    pub shape: Vec<u64>,
    /// The unit of its values as the file writes it; empty where there is none.
    pub unit: String,
}

/// An opened grid. Several threads may read at once; nothing is in memory but small grids that had to be decoded.
pub struct GridSource {
    about: GridDescription,
    storage: Storage,
    layout: Layout,
}

impl std::fmt::Debug for GridSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GridSource").field("about", &self.about).field("layout", &self.layout).finish_non_exhaustive()
    }
}

impl GridSource {
    /// A grid whose samples lie in `storage` as `layout` says.
    pub(super) fn new(about: GridDescription, storage: Storage, layout: Layout) -> GridSource {
        GridSource { about, storage, layout }
    }

    /// Adds a sentence of what was assumed.
    pub(super) fn note(&mut self, note: String) {
        self.about.notes.push(note);
    }

    /// What the source holds.
    pub fn description(&self) -> &GridDescription {
        &self.about
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.about.grid
    }

    /// How many bytes of it are in memory as long as it is open.
    pub fn memory_bytes(&self) -> u64 {
        match &self.storage {
            Storage::Memory(bytes) => bytes.len() as u64,
            Storage::File(_) | Storage::Pieces(_) => 0,
        }
    }

    /// Reads the samples of a box into `out`: x fastest, then y, z; the channels of a sample side by side; bit for bit those of
    /// the file, in its type and this machine's byte order. `out` must hold exactly that many bytes.
    ///
    /// # Errors
    /// [`ImportError`] when the file cannot be read there, or the box is not in the grid.
    pub fn read(&self, region: &Region, out: &mut [u8]) -> Result<(), ImportError> {
        let grid = &self.about.grid;
        let is_inside = (0..3).all(|axis| region.min[axis] < region.max[axis] && region.max[axis] <= grid.shape[axis]);
        let bytes = region.shape().iter().try_fold(grid.sample_bytes(), |bytes, &count| bytes.checked_mul(count));
        if !is_inside || bytes != Some(out.len() as u64) {
            let asked = format!("samples {:?} to {:?} in {} bytes", region.min, region.max, out.len());
            return Err(ImportError::malformed(
                &self.about.path,
                "region",
                asked,
                format!("a part of {}", grid.described()),
            ));
        }
        self.layout.gather(grid, &self.storage, &self.about.path, region, out)
    }

    /// The whole grid in boxes of about `bytes` bytes (at least one sample), which follow each other as they are stored.
    pub fn chunks(&self, bytes: u64) -> Vec<Region> {
        let grid = &self.about.grid;
        let mut axes = [0, 1, 2];
        axes.sort_by_key(|&axis| std::cmp::Reverse(self.layout.strides[axis + 1]));
        let mut chunks = Vec::new();
        split(grid.region(), &axes, grid.sample_bytes(), bytes, &mut chunks);
        chunks
    }
}

/// Cuts a box into pieces of at most `most` bytes, first along the first of `axes`.
fn split(region: Region, axes: &[usize], sample_bytes: u64, most: u64, into: &mut Vec<Region>) {
    let shape = region.shape();
    let layer = axes.iter().skip(1).fold(sample_bytes, |bytes, &axis| bytes.saturating_mul(shape[axis]));
    let Some((&axis, others)) = axes.split_first() else {
        into.push(region);
        return;
    };
    let layers = (most / layer.max(1)).max(1);
    let (mut start, end) = (region.min[axis], region.max[axis]);
    while start < end {
        let next = end.min(start.saturating_add(layers));
        let piece = region.with(axis, start..next);
        if layer > most {
            split(piece, others, sample_bytes, most, into);
        } else {
            into.push(piece);
        }
        start = next;
    }
}

/// Checks what every format has to hold true, before anything is allocated: how many samples there are, and that their places
/// differ. The size of all samples, bytes.
///
/// # Errors
/// What is wrong, with the names of the format's own fields for shape and directions.
pub(super) fn checked(path: &Path, grid: &Grid, shape: &str, directions: &str) -> Result<u64, ImportError> {
    let found = || grid.shape[..grid.dimensions].iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
    if grid.shape.contains(&0) {
        return Err(ImportError::malformed(path, shape, found(), "at least one sample along each axis"));
    }
    if grid.channels.is_empty() || grid.channels.len() > MOST_CHANNELS {
        let expected = format!("1 to {MOST_CHANNELS} values a sample");
        return Err(ImportError::malformed(path, shape, grid.channels.len(), expected));
    }
    let bytes = grid.bytes().filter(|&bytes| i64::try_from(bytes).is_ok());
    let Some(bytes) = bytes else {
        return Err(ImportError::malformed(path, shape, found(), "fewer than 2^63 bytes of samples"));
    };
    let matrix = grid.to_world.matrix3;
    if !grid.to_world.is_finite() {
        return Err(ImportError::malformed(path, directions, "numbers that are not finite", "finite numbers"));
    }
    let lengths = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(glam::DVec3::length);
    let volume = lengths.iter().product::<f64>();
    if !(volume.is_finite() && volume > 0.0 && matrix.determinant().abs() > 1e-9 * volume) {
        return Err(ImportError::Singular { path: path.into(), field: directions.into() });
    }
    Ok(bytes)
}
