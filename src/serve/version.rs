//! Which version of a file is open: its length, when it was written, and of built files the checksum of what tells of all of it.

use crate::heights::store::HeightFile;
use crate::model::{ReadFile, ReadMethod, http_date};
use crate::store::{GridFile, PageFile, RunFile};
use std::fs::{File, Metadata};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where headers of built files have the checksum of the footer (docs/page-file.md), those of runs that of the directory (docs/series-file.md).
const FOOTER_CRC: std::ops::Range<usize> = 40..44;

/// A version of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Version {
    /// Bytes.
    pub(super) length: u64,
    /// Seconds after the beginning of 1970 at which it was written; `None` where the system does not know, or a clock was wrong.
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

/// Opens a regular file, whose path has no symbolic links.
///
/// # Errors
/// What the system answers; [`io::ErrorKind::NotFound`] for what is no regular file; where another is in its place by then.
pub(super) fn open(path: &Path) -> io::Result<Opened> {
    // A pipe would be waited for.
    let is_regular = |about: &Metadata| match about.is_file() {
        true => Ok(()),
        false => Err(io::Error::from(io::ErrorKind::NotFound)),
    };
    is_regular(&std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    let about = file.metadata()?;
    is_regular(&about)?;
    // Whoever else may write there could have put a link to what is not served in its place, or in that of a folder on the way.
    if path.canonicalize()? != *path || !is_same(&about, &std::fs::symlink_metadata(path)?) {
        return Err(io::Error::other("it was replaced while it was opened"));
    }
    let (length, modified) = (about.len(), about.modified().ok());
    let file = ReadFile::new(file, ReadMethod::Positioned);
    let mut head = [0; FOOTER_CRC.end];
    let kinds = [PageFile::recognises, RunFile::recognises, GridFile::recognises, HeightFile::recognises];
    let is_built = file.read_exact_at(&mut head, 0).is_ok() && kinds.iter().any(|recognises| recognises(&head));
    let since = modified.map(since_1970);
    let footer = is_built.then(|| head[FOOTER_CRC].iter().rev().map(|byte| format!("{byte:02x}")).collect::<String>());
    let footer = footer.map(|crc| format!("-{crc}")).unwrap_or_default();
    let tag = format!("\"{length:x}-{:x}{footer}\"", since.unwrap_or(0));
    let seconds = |nanoseconds: i128| nanoseconds.div_euclid(1_000_000_000) as i64;
    // A time that is yet to come is none that HTTP may tell (RFC 9110, 8.8.2.1).
    let now = seconds(since_1970(SystemTime::now()));
    let modified = since.map(seconds).filter(|modified| *modified <= now);
    Ok(Opened { file: Arc::new(file), version: Version { length, modified, tag } })
}

impl Version {
    /// The value of `Last-Modified`.
    pub(super) fn date(&self) -> Option<String> {
        self.modified.map(http_date::written)
    }
}

/// Whether both are of one file, as far as the system tells files apart.
fn is_same(opened: &Metadata, there: &Metadata) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        (opened.dev(), opened.ino()) == (there.dev(), there.ino())
    }
    #[cfg(not(unix))]
    {
        opened.len() == there.len() && opened.modified().ok() == there.modified().ok()
    }
}

/// Nanoseconds after the beginning of 1970.
fn since_1970(time: SystemTime) -> i128 {
    match time.duration_since(UNIX_EPOCH) {
        Ok(after) => after.as_nanos() as i128,
        Err(before) => -(before.duration().as_nanos() as i128),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn nothing_is_opened_by_way_of_a_link() {
        let around = tempfile::tempdir().unwrap();
        let root = around.path().canonicalize().unwrap();
        std::fs::create_dir(root.join("steps")).unwrap();
        std::fs::write(root.join("steps/a.df"), "x").unwrap();
        for (target, link) in [("steps/a.df", "a.df"), ("steps", "other")] {
            symlink(target, root.join(link)).unwrap();
        }
        assert_eq!(open(&root.join("steps/a.df")).map(|opened| opened.version.length).unwrap(), 1);
        assert!(open(&root.join("a.df")).is_err() && open(&root.join("other/a.df")).is_err());
    }
}
