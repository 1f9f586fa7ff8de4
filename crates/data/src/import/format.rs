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

/// What formats are recognised by.
pub(super) struct Head {
    /// The first bytes, at most [`HEAD`].
    pub bytes: Vec<u8>,
    /// Length of the file, bytes.
    pub length: u64,
}

impl Head {
    /// Reads the beginning of a file.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(super) fn read(path: &Path) -> Result<Head, ImportError> {
        let io = |source| ImportError::io(path, "file", source);
        let file = std::fs::File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut bytes = Vec::with_capacity(HEAD);
        file.take(HEAD as u64).read_to_end(&mut bytes).map_err(io)?;
        Ok(Head { bytes, length })
    }
}

/// The format that a file claims to be of.
pub(super) fn format_of(head: &Head) -> Option<&'static dyn Format> {
    FORMATS.iter().find(|format| format.recognise(&head.bytes, head.length)).copied()
}

/// Opens a source in whatever format its content shows; of a folder, the one source in it (see [`super::file_in`]).
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
    open_file(&super::file_in(path, &[])?, method)
}

/// [`open_with`] of a file.
pub(super) fn open_file(path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
    match format_of(&Head::read(path)?) {
        Some(format) => format.open(path, method),
        None => {
            let names: Vec<&str> = FORMATS.iter().map(|format| format.name()).collect();
            Err(ImportError::Unrecognised { path: path.into(), expected: names.join(", ") })
        }
    }
}
