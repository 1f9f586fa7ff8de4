//! NumPy's arrays of two axes: `.npy` (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>), and
//! the largest of an `.npz`.

mod axes;
mod header;
mod npz;
#[cfg(test)]
mod tests;

pub(super) use npz::NPZ;

use super::content::Content;
use super::dimensions::dimensions;
use super::raw::RawSamples;
use super::{HeightDescription, HeightFormat, HeightSource, NoData};
use crate::model::HeightGrid;
use deepfield_data::import::ImportError;
use header::Header;

/// An array of rows and columns, read in place.
pub(super) const NPY: HeightFormat = HeightFormat {
    name: "npy",
    extensions: &["npy"],
    // Arrays of three axes are volumes, and bytes may be images.
    is_sure: |content| Header::read(content, &content.head).is_ok_and(|header| header.holds_heights()),
    detect: |content| content.head.starts_with(header::MAGIC),
    open,
};

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let header = Header::read(content, &content.head)?;
    let grid = grid_of(content, "shape", &header)?;
    let size = [grid.columns, grid.rows];
    let samples = RawSamples::new(content, "samples", header.layout(size, header.start))?;
    let mut about = HeightDescription::new(content, NPY.name, grid);
    let behind = content.length - header.start - about.grid.samples() * header.sample_type.size() as u64;
    if behind > 0 {
        about.notes.push(format!("{behind} bytes behind the samples are left out"));
    }
    Ok(HeightSource::new(about, Box::new(samples), NoData::Nothing))
}

/// An array as a grid; `field` names it in messages.
///
/// # Errors
/// Where it has no two axes, or too few or too many samples.
fn grid_of(content: &Content, field: &str, header: &Header) -> Result<HeightGrid, ImportError> {
    let &[rows, columns] = &header.sizes[..] else {
        let found = format!("{} axes {}", header.sizes.len(), header.shape());
        return Err(content.malformed(field, found, "2 axes: rows and columns of heights"));
    };
    let [columns, rows] = dimensions(content, (field, columns.into()), (field, rows.into()), header.sample_type)?;
    Ok(HeightGrid::new(columns, rows, header.sample_type))
}
