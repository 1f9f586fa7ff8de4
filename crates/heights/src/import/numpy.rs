//! NumPy's arrays of two axes: `.npy` (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>), and
//! the largest of an `.npz`.

mod axes;
mod npz;
#[cfg(test)]
mod tests;

pub(super) use npz::NPZ;

use super::content::Content;
use super::dimensions::dimensions;
use super::raw::{Layout, RawSamples, decode};
use super::{HeightDescription, HeightFormat, HeightSource, NoData};
use crate::model::HeightGrid;
use deepfield_data::import::ImportError;
use deepfield_data::import::grid::NpyHeader;

/// An array of rows and columns, read in place.
pub(super) const NPY: HeightFormat = HeightFormat {
    name: "npy",
    extensions: &["npy"],
    // Arrays of three axes are volumes, and bytes may be images.
    is_sure: |content| NpyHeader::read(&content.path, &content.head).is_ok_and(|header| holds_heights(&header)),
    detect: |content| content.head.starts_with(NpyHeader::MAGIC),
    open,
};

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let header = NpyHeader::read(&content.path, &content.head)?;
    let grid = grid_of(content, "shape", &header)?;
    let size = [grid.columns, grid.rows];
    let samples = RawSamples::new(content, "samples", layout(&header, size, header.start))?;
    let mut about = HeightDescription::new(content, NPY.name, grid);
    let behind = content.length - header.start - about.grid.samples() * header.kind.size() as u64;
    if behind > 0 {
        about.notes.push(format!("{behind} bytes behind the samples are left out"));
    }
    Ok(HeightSource::new(about, Box::new(samples), NoData::Nothing))
}

/// An array as a grid; `field` names it in messages.
///
/// # Errors
/// Where it has no two axes, or too few or too many samples.
fn grid_of(content: &Content, field: &str, header: &NpyHeader) -> Result<HeightGrid, ImportError> {
    let &[rows, columns] = &header.sizes[..] else {
        let found = format!("{} axes {}", header.sizes.len(), header.shape);
        return Err(content.malformed(field, found, "2 axes: rows and columns of heights"));
    };
    let [columns, rows] = dimensions(content, (field, columns.into()), (field, rows.into()), header.kind)?;
    Ok(HeightGrid::new(columns, rows, header.kind))
}

/// Whether an array can hold nothing but heights: two axes, and more than a byte a number.
fn holds_heights(header: &NpyHeader) -> bool {
    header.sizes.len() == 2 && header.kind.size() > 1
}

/// The samples of an array of two axes, from byte `offset` on.
fn layout(header: &NpyHeader, size: [u64; 2], offset: u64) -> Layout {
    let of = if header.is_fortran { Layout::by_columns } else { Layout::packed };
    of(size, offset, header.kind, header.order)
}

/// The numbers of an array with one axis or none, whose bytes are these.
fn numbers(header: &NpyHeader, bytes: &[u8]) -> Vec<f64> {
    let size = header.kind.size();
    let bytes = bytes.get(header.start as usize..).unwrap_or_default();
    let mut numbers = vec![0.0; bytes.len() / size];
    decode(header.kind, header.order, bytes, size, &mut numbers, |number| number);
    numbers
}
