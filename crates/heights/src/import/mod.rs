//! From a file of heights to its samples: one file a format and a line in [`FORMATS`]. Nothing outside this room knows a format.
//!
//! [`open_heights`] gives a [`HeightSource`], whose samples are read in windows; [`summarize_heights`] what `info` prints.

mod al3d;
mod archive;
mod content;
mod dimensions;
mod esri_ascii;
mod flt;
mod frt;
mod geotiff;
mod gwy;
mod hgt;
mod in_memory;
pub(crate) mod md5;
mod netcdf;
mod numpy;
mod options;
pub mod photo;
mod plu;
mod plux;
mod png16;
pub mod proportions;
mod raw;
mod source;
pub mod summary;
mod sur;
mod surfer;
pub mod suspects;
#[cfg(test)]
mod tests;
mod told;
mod units;
mod unpack;
mod x3p;
mod xml;

pub use options::HeightOptions;
pub use photo::{Photo, PhotoChoice};
pub use source::{HeightDescription, HeightSource, NoData, Samples, is_masked};
pub use summary::{HeightSummary, summarize_heights};
pub(crate) use told::NO_SPACING;

use content::Content;
use deepfield_data::import::ImportError;
use deepfield_data::import::guarded::guarded;
use deepfield_data::model::SampleType;
use std::path::Path;

/// A format of height fields.
struct HeightFormat {
    /// Its name in messages.
    name: &'static str,
    /// How its files usually end, without the dot.
    extensions: &'static [&'static str],
    /// Whether a file of it can be nothing but heights, so that it is told from images and tables by its content alone ([`always`]). What is not
    /// sure is opened as heights where that is asked for.
    is_sure: fn(&Content) -> bool,
    /// Whether a file claims to be of this format. Damaged files may be recognised; opening them finds the damage.
    detect: fn(&Content) -> bool,
    /// Opens a file that was recognised.
    open: fn(&Content) -> Result<HeightSource, ImportError>,
}

/// The formats, asked in this order.
static FORMATS: &[HeightFormat] = &[
    sur::SUR,
    al3d::AL3D,
    frt::FRT,
    x3p::X3P,
    plux::PLUX,
    surfer::SURFER,
    gwy::GWY,
    numpy::NPY,
    numpy::NPZ,
    geotiff::GEOTIFF,
    netcdf::NETCDF,
    png16::PNG16,
    esri_ascii::ESRI_ASCII,
    hgt::HGT,
    flt::FLT,
    plu::PLU,
];

/// Of formats that hold nothing but heights.
fn always(_: &Content) -> bool {
    true
}

/// The format that a file's content tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Told {
    /// The format's name.
    pub format: &'static str,
    /// Whether the file can hold nothing but heights. One that could be an image as well is opened as heights where that is asked for.
    pub is_sure: bool,
}

/// Opens the heights at `path` in whatever format its content shows. What is compressed is decoded once; the rest is read in place.
///
/// # Errors
/// [`ImportError`] when the file cannot be read, is of no known format, is damaged, or holds no heights unless these are asked for.
pub fn open_heights(path: &Path, options: &HeightOptions) -> Result<HeightSource, ImportError> {
    options.check(path)?;
    let content = Content::open(path, options)?;
    let Some(format) = format_of(&content) else {
        return Err(ImportError::Unrecognised { path: path.into(), expected: height_names() });
    };
    // What a library says nothing of, and gives up on.
    let damaged = || {
        let expected = format!("an intact file ({})", format.name);
        Err(content.malformed("content", "damage that its reader gave up on", expected))
    };
    let mut source = guarded(|| (format.open)(&content)).unwrap_or_else(damaged)?;
    let grid = &source.description().grid;
    if matches!(grid.sample_type, SampleType::I8 | SampleType::U8) && !options.is_asked {
        let found = format!("{}, which may be an image", grid.described());
        return Err(content.malformed("samples", found, "--kind heights where they are heights"));
    }
    dimensions::check_grid(&content, grid)?;
    told::overrule(&mut source, options);
    if let Some(texture) = &options.texture {
        source.lay(Photo::open(texture, &source.description().grid, options.read)?);
    }
    Ok(source)
}

/// The format that a file claims to be of.
fn format_of(content: &Content) -> Option<&'static HeightFormat> {
    FORMATS.iter().find(|format| guarded(|| (format.detect)(content)).unwrap_or(false))
}

/// The format of heights that the file at `path` claims to be of, by its content; `None` of other files, folders and pipes.
///
/// # Errors
/// [`ImportError`] when the file cannot be read.
pub fn height_format(path: &Path) -> Result<Option<Told>, ImportError> {
    // Folders and pipes hold no heights, and reading a pipe would take from it.
    if !path.is_file() {
        return Ok(None);
    }
    let content = Content::open(path, &HeightOptions::default())?;
    Ok(format_of(&content).map(|format| {
        let is_sure = guarded(|| (format.is_sure)(&content)).unwrap_or(false);
        Told { format: format.name, is_sure }
    }))
}

/// The names of the formats of heights, for messages.
pub fn height_names() -> String {
    FORMATS.iter().map(|format| format.name).collect::<Vec<_>>().join(", ")
}

/// How files of heights usually end, without dots.
pub fn height_extensions() -> Vec<&'static str> {
    let mut found: Vec<&str> = FORMATS.iter().flat_map(|format| format.extensions).copied().collect();
    found.dedup();
    found
}
