//! NumPy's arrays (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>). The last axis is x.

use super::content::Content;
use super::layout::Layout;
use super::npy_header::NpyHeader;
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid};
use std::path::Path;

/// Arrays of two axes are images, as are those whose third axis holds colours; others of three are volumes, and of four volumes whose last axis is
/// that of values.
pub(super) const NPY: GridFormat = GridFormat {
    name: "npy",
    extensions: &["npy"],
    has_parts: false,
    detect: |content| content.head.starts_with(NpyHeader::MAGIC),
    open,
};

/// The axes of arrays that are grids.
const AXES: &str =
    "2 axes (an image), 3 (a volume, or an image with colours last), or 4, the last of at most 4096 values";

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let array = Array::read(&content.path, &content.head)?;
    let storage = content.samples(array.start, array.bytes, &array.grid)?;
    let layout = array.layout(if content.is_packed { 0 } else { array.start });
    Ok(GridSource::new(GridDescription::new(&content.path, NPY.name, content.length, array.grid), storage, layout))
}

/// What the header of an array says.
pub(super) struct Array {
    /// The grid.
    pub grid: Grid,
    /// Size of its samples, bytes.
    pub bytes: u64,
    /// The byte behind the header.
    pub start: u64,
    /// Its axes, the fastest first: 1 to 3 are x, y and z, 0 is that of values.
    axes: [usize; 4],
    order: Order,
}

impl Array {
    /// Samples that begin at byte `offset` of what is read.
    pub(super) fn layout(&self, offset: u64) -> Layout {
        Layout::packed(&self.grid, self.axes, offset, self.order)
    }

    /// Reads the header that an array begins with.
    ///
    /// # Errors
    /// What is wrong with it, or with the array as a grid.
    pub(super) fn read(path: &Path, head: &[u8]) -> Result<Array, ImportError> {
        let header = NpyHeader::read(path, head)?;
        let kind = header.kind;
        let grid = match header.sizes[..] {
            [y, x] => Grid::image([x, y], kind, Channel::numbered(1)),
            // Colours of pixels, as pictures lie in arrays.
            [y, x, colors @ 2..=4] if colors < y.min(x) => Grid::image([x, y], kind, Channel::of_picture(colors)),
            // Nobody can tell planes of colours from three slices.
            [3, y, x] if y.min(x) > 3 => {
                let expected =
                    format!("({y}, {x}, 3) of an image's colours, or (3, {y}, {x}, 1) of a volume's 3 slices");
                return Err(header.wrong_shape(path, &expected));
            }
            [z, y, x] => Grid::volume([x, y, z], kind, Channel::numbered(1)),
            [z, y, x, channels @ 1..=4096] => Grid::volume([x, y, z], kind, Channel::numbered(channels)),
            // Vectors in time and space.
            [_, _, _, _, 2 | 3] => {
                let expected = format!("{AXES}; deepfield build --trace reads a velocity field");
                return Err(header.wrong_shape(path, &expected));
            }
            _ => return Err(header.wrong_shape(path, AXES)),
        };
        Array::of(path, &header, grid)
    }

    /// An array whose numbers are the samples of `grid`.
    ///
    /// # Errors
    /// What is wrong with it as a grid.
    pub(super) fn of(path: &Path, header: &NpyHeader, grid: Grid) -> Result<Array, ImportError> {
        let bytes = checked(path, &grid, "shape", "shape")?;
        let axes = match (header.is_fortran, grid.dimensions) {
            (false, _) => [0, 1, 2, 3],
            (true, 2) => [2, 1, 0, 3],
            (true, _) => [3, 2, 1, 0],
        };
        Ok(Array { grid, bytes, start: header.start, axes, order: header.order })
    }
}
