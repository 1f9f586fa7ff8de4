//! The formats that can be imported, each recognised by its content.

use super::{ImportError, Source};
use crate::model::ReadMethod;
use std::io::Read;
use std::path::Path;

/// A file format. Adding one takes a file in this room and a line in [`FORMATS`].
pub trait Format: Sync {
    /// The format's name in messages.
    fn name(&self) -> &'static str;

    /// Whether a file that begins with `head` (up to [`HEAD`] bytes, the whole file if it is shorter) and is `length`
    /// bytes long claims to be of this format. Damaged files may be recognised; [`Format::open`] finds the damage.
    fn recognise(&self, head: &[u8], length: u64) -> bool;

    /// Opens the source that `path` belongs to. Files that are read by byte range are read in the way `method`.
    ///
    /// # Errors
    /// [`ImportError`] when the file is damaged, incomplete or holds nothing to draw.
    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError>;
}

/// How many bytes of a file [`Format::recognise`] sees.
pub const HEAD: usize = 4096;

/// Every format, asked in this order.
pub const FORMATS: &[&dyn Format] = &[
    &super::hdf5::Hdf5,
    &super::gadget::Gadget,
    &super::tipsy::Tipsy,
    &super::table::GeoJson,
    &super::table::KStars,
    &super::table::Csv,
];

/// Opens a source in whatever format its content shows.
///
/// # Errors
/// [`ImportError`] when the file cannot be read, is of no known format, or is damaged.
pub fn open(path: &Path) -> Result<Box<dyn Source>, ImportError> {
    open_with(path, ReadMethod::default())
}

/// The same, read in the way `method`.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
    let io = |source| ImportError::io(path, "file", source);
    let file = std::fs::File::open(path).map_err(io)?;
    let metadata = file.metadata().map_err(io)?;
    if metadata.is_dir() {
        return Err(ImportError::malformed(path, "file", "a folder", "a file"));
    }
    let mut head = Vec::with_capacity(HEAD);
    file.take(HEAD as u64).read_to_end(&mut head).map_err(io)?;
    match FORMATS.iter().find(|format| format.recognise(&head, metadata.len())) {
        Some(format) => format.open(path, method),
        None => {
            let names: Vec<&str> = FORMATS.iter().map(|format| format.name()).collect();
            Err(ImportError::Unrecognised { path: path.into(), expected: names.join(", ") })
        }
    }
}
