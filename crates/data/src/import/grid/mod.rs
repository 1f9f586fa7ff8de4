//! Images and volumes: one file per format and a line in [`FORMATS`]. Nothing outside this room knows a format.
//!
//! [`open_grid`] gives a [`GridSource`], whose samples are read in boxes; [`summarize_grid`] what `info` prints.

mod ascii;
pub(super) mod base64;
mod choice;
mod content;
mod conventions;
mod exr;
mod fields;
mod fits;
mod hdf5;
pub mod head;
mod layout;
mod metaimage;
mod netcdf;
mod nifti;
mod npy;
mod npy_header;
mod npz;
mod nrrd;
mod numpy_arrays;
mod part_name;
mod picture;
mod raw;
pub(super) mod scratch;
mod slices;
mod source;
mod summary;
#[cfg(test)]
mod tests;
mod tiff;
pub mod voxels;
mod vti;
mod vtk;
mod vtk_array;
mod xml;

pub(super) use content::Content;
pub(super) use fields::{Entry, sample_type};
pub(super) use hdf5::variable;
pub use npy_header::NpyHeader;
pub(super) use numpy_arrays::NumpyArrays;
pub use raw::RawGrid;
pub(super) use slices::is_stack;
pub use source::{GridArray, GridDescription, GridSource};
pub use summary::{ChannelSummary, GridSummary, HISTOGRAM, summarize_grid};
pub(super) use voxels::Voxels;
pub(super) use vtk::{TYPES as VTK_TYPES, is_of_points as is_vtk_of_points};
pub(super) use vtk_array::{VtkArray, XML_POINTS, XML_TYPES, xml_data_set};
pub(super) use xml::{Element, elements as xml_elements};

use super::folder::is_of_slices;
use super::guarded::guarded;
use super::hdf5::is_hdf5;
use super::{ImportError, UnpackedOnce};
use crate::model::ReadMethod;
use std::path::Path;

/// A format of grids.
struct GridFormat {
    /// Its name in messages.
    name: &'static str,
    /// How its files usually end, without the dot.
    extensions: &'static [&'static str],
    /// Whether a file has several arrays, one of which can be named.
    has_parts: bool,
    /// Whether a file claims to be of this format. Damaged files may be recognised; opening them finds the damage.
    detect: fn(&Content) -> bool,
    /// Opens a file that was recognised.
    open: fn(&Content) -> Result<GridSource, ImportError>,
}

/// The formats, asked in this order.
static FORMATS: &[GridFormat] = &[
    nrrd::NRRD,
    npy::NPY,
    npz::NPZ,
    picture::PNG,
    picture::JPEG,
    exr::EXR,
    nifti::NIFTI,
    metaimage::METAIMAGE,
    vtk::VTK,
    vti::VTI,
    fits::FITS,
    tiff::TIFF,
    hdf5::HDF5,
    netcdf::NETCDF,
];

/// How grids are opened.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridOptions {
    /// What a file without a header holds; such a file is opened whatever its content looks like.
    pub raw: Option<RawGrid>,
    /// How files are read.
    pub read: ReadMethod,
}

/// Opens the image or volume at `path`, or the array that is named behind a file's name, in whatever format its content shows; of a folder the slices in it. What is compressed is decoded once, into memory or a
/// temporary file; the rest is read in place.
///
/// # Errors
/// [`ImportError`] when the file cannot be read, is of no known format, or is damaged.
pub fn open_grid(path: &Path, options: &GridOptions) -> Result<GridSource, ImportError> {
    if path.is_dir() {
        return slices::open(path, options);
    }
    let content = Content::open(path, options.read)?;
    let _held = UnpackedOnce::of(&content.path);
    if let Some(raw) = &options.raw {
        return raw.open(&content);
    }
    // A grid is asked for: what of particles, or of damage, keeps an HDF5 file from being told as one shows when it is opened.
    let hdf5 = is_hdf5(&content.head).then_some(&hdf5::HDF5);
    if let Some(format) = format_of(&content).or(hdf5) {
        if let Some(part) = content.part.as_ref().filter(|_| !format.has_parts) {
            let found = format!("{} ({})", choice::shown(part), format.name);
            return Err(ImportError::malformed(
                &content.path,
                "#",
                found,
                "a format whose files have arrays with names",
            ));
        }
        // What a library says nothing of, and gives up on.
        let damaged = || {
            let expected = format!("an intact file ({})", format.name);
            Err(ImportError::malformed(&content.path, "content", "damage that its reader gave up on", expected))
        };
        return guarded(|| (format.open)(&content)).unwrap_or_else(damaged);
    }
    if raw::is_raw(path) {
        return raw::open_described(&content);
    }
    Err(ImportError::Unrecognised { path: path.into(), expected: grid_names() })
}

/// The format that a file claims to be of.
fn format_of(content: &Content) -> Option<&'static GridFormat> {
    FORMATS.iter().find(|format| (format.detect)(content))
}

/// The name of the format of grids that the file at `path` claims to be of, by its content; a folder by the pictures in it where it holds nothing else that can be opened, a file without a header by `.raw` at the
/// end of its name, or by a description beside it.
///
/// # Errors
/// [`ImportError`] when the file cannot be read.
pub fn grid_format(path: &Path) -> Result<Option<&'static str>, ImportError> {
    if path.is_dir() {
        return Ok(is_of_slices(path)?.then_some(slices::NAME));
    }
    Ok(match grid_content(path)? {
        None if raw::is_raw(path) => Some(raw::NAME),
        found => found,
    })
}

/// The arrays of a NetCDF or HDF5 file, none of particles, that are images or volumes; their samples are not read. Empty for files of other formats.
///
/// # Errors
/// [`ImportError`] when the file cannot be read, or is damaged.
pub fn grid_arrays(path: &Path) -> Result<Vec<GridArray>, ImportError> {
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let content = Content::open(path, ReadMethod::Positioned)?;
    let list = || match () {
        () if is_hdf5(&content.head) => hdf5::arrays(&content),
        () if (netcdf::NETCDF.detect)(&content) => netcdf::arrays(&content),
        () => Ok(Vec::new()),
    };
    // What its library gives up on shows when it is opened.
    guarded(list).unwrap_or_else(|| Ok(Vec::new()))
}

/// The same by content alone.
pub(super) fn grid_content(path: &Path) -> Result<Option<&'static str>, ImportError> {
    // Folders and pipes hold no grid, and reading a pipe would take from it.
    if !part_name::parts(path).0.is_file() {
        return Ok(None);
    }
    let content = Content::open(path, ReadMethod::Positioned)?;
    Ok(format_of(&content).map(|format| format.name))
}

/// The file that a name stands for, without that of an array in it.
pub(super) fn file_of_part(path: &Path) -> &Path {
    part_name::parts(path).0
}

/// The names of the formats of grids, for messages.
pub fn grid_names() -> String {
    let names: Vec<&str> = FORMATS.iter().map(|format| format.name).chain([raw::NAME, slices::NAME]).collect();
    names.join(", ")
}

/// How files of grids usually end, without dots; `nii.gz` and the like are told by their content.
pub fn grid_extensions() -> Vec<&'static str> {
    FORMATS.iter().flat_map(|format| format.extensions).copied().chain(["raw"]).collect()
}
