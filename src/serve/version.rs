//! Which version of a file is open: its length, when it was written, and of page files the checksum of the footer.

use crate::model::{ReadFile, ReadMethod, http_date};
use crate::store::PageFile;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where headers of page files have the checksum of the footer (docs/page-file.md).
const FOOTER_CRC: std::ops::Range<usize> = 40..44;

/// A version of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Version {
    /// Bytes.
    pub(super) length: u64,
    /// Seconds after the beginning of 1970 at which it was written; `None` where the system does not know.
    pub(super) modified: Option<i64>,
    /// The strong entity tag, with its quotation marks.
    pub(super) tag: String,
}

/// An open file.
pub(super) struct Opened {
    /// Its bytes.
    pub(super) file: Arc<ReadFile>,
    /// Which they are.
    pub(super) version: Version,
}

/// Opens a regular file.
///
/// # Errors
/// What the system answers; [`io::ErrorKind::NotFound`] for what is no regular file.
pub(super) fn open(path: &Path) -> io::Result<Opened> {
    // A pipe would be waited for.
    let is_regular = |about: &std::fs::Metadata| match about.is_file() {
        true => Ok(()),
        false => Err(io::Error::from(io::ErrorKind::NotFound)),
    };
    is_regular(&std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    let about = file.metadata()?;
    is_regular(&about)?;
    let (length, modified) = (about.len(), about.modified().ok());
    let file = ReadFile::new(file, ReadMethod::Positioned);
    let mut head = [0; FOOTER_CRC.end];
    let is_pages = file.read_exact_at(&mut head, 0).is_ok() && PageFile::recognises(&head);
    let since = modified.map(since_1970);
    let footer = is_pages.then(|| head[FOOTER_CRC].iter().rev().map(|byte| format!("{byte:02x}")).collect::<String>());
    let footer = footer.map(|crc| format!("-{crc}")).unwrap_or_default();
    let tag = format!("\"{length:x}-{:x}{footer}\"", since.unwrap_or(0));
    let modified = since.map(|nanoseconds| nanoseconds.div_euclid(1_000_000_000) as i64);
    Ok(Opened { file: Arc::new(file), version: Version { length, modified, tag } })
}

impl Version {
    /// The value of `Last-Modified`.
    pub(super) fn date(&self) -> Option<String> {
        self.modified.map(http_date::written)
    }
}

/// Nanoseconds after the beginning of 1970.
fn since_1970(time: SystemTime) -> i128 {
    match time.duration_since(UNIX_EPOCH) {
        Ok(after) => after.as_nanos() as i128,
        Err(before) => -(before.duration().as_nanos() as i128),
    }
}
