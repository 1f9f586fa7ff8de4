//! Where a page file's bytes come from: an open file, or whatever else answers positioned reads, and what has become of
//! it since it was opened.
//!
//! A file that is open may be deleted, replaced, rewritten or cut short by somebody else. Reads of it then end with an
//! error or break a checksum; [`Disk::change`] finds out why.

use crate::model::{ReadFile, ReadMethod};
use std::fmt;
use std::fs::{File, Metadata};
use std::io;
use std::path::{Path, PathBuf};

/// Something that bytes are read from, by several threads at a time.
pub trait Disk: fmt::Debug + Send + Sync {
    /// Fills `buffer` from `offset`, without a shared cursor.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] where the bytes end before the buffer does; whatever else the system answers.
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()>;

    /// How many bytes there are now.
    ///
    /// # Errors
    /// What the system answers.
    fn size(&self) -> io::Result<u64>;

    /// What has become of the file since it was opened, where that can be told without reading it.
    fn change(&self) -> Option<Change>;
}

/// What has become of a file that is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Its name is gone. Some systems go on serving what is open.
    Deleted,
    /// Its name belongs to another file. Some systems go on serving what is open.
    Replaced,
    /// It is shorter than it was.
    Shortened {
        /// Bytes that it had.
        from: u64,
        /// Bytes that it has.
        to: u64,
    },
    /// It holds something else.
    Rewritten,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Change::Deleted => f.write_str("the file was deleted while it was open"),
            Change::Replaced => f.write_str("the file was replaced by another one while it was open"),
            Change::Shortened { from, to } => {
                write!(f, "the file was cut from {from} to {to} bytes while it was open")
            }
            Change::Rewritten => f.write_str("the file was rewritten while it was open"),
        }
    }
}

/// A file of the operating system.
#[derive(Debug)]
pub struct LocalFile {
    path: PathBuf,
    file: ReadFile,
    len: u64,
    identity: Identity,
}

impl LocalFile {
    /// Opens a file that is read in the way `method`; `None` if it is there but not a regular file.
    ///
    /// # Errors
    /// What the system answers.
    pub fn open(path: &Path, method: ReadMethod) -> io::Result<Option<LocalFile>> {
        let file = File::open(path)?;
        let about = file.metadata()?;
        let (len, identity) = (about.len(), identity(&about));
        Ok(about.is_file().then(|| LocalFile {
            path: path.to_path_buf(),
            file: ReadFile::new(file, method),
            len,
            identity,
        }))
    }
}

impl Disk for LocalFile {
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.file.read_exact_at(buffer, offset)
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.file.file().metadata()?.len())
    }

    fn change(&self) -> Option<Change> {
        match std::fs::metadata(&self.path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Some(Change::Deleted),
            Ok(about) if identity(&about) != self.identity => return Some(Change::Replaced),
            // A folder that cannot be looked into says nothing about the file.
            _ => {}
        }
        let to = self.file.file().metadata().ok()?.len();
        (to < self.len).then_some(Change::Shortened { from: self.len, to })
    }
}

/// What tells a file from another one of the same name, and outlives writing to it. Times of change do not: the cache
/// of page files sets them as files are used.
#[cfg(unix)]
type Identity = (u64, u64);
/// What tells a file from another one of the same name, and outlives writing to it.
#[cfg(not(unix))]
type Identity = Option<std::time::SystemTime>;

#[cfg(unix)]
fn identity(about: &Metadata) -> Identity {
    use std::os::unix::fs::MetadataExt;
    (about.dev(), about.ino())
}

#[cfg(not(unix))]
fn identity(about: &Metadata) -> Identity {
    about.created().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path, bytes: usize) {
        std::fs::write(path, vec![1; bytes]).unwrap();
    }

    #[test]
    fn what_becomes_of_an_open_file_is_told() {
        what_becomes_is_told(ReadMethod::Positioned);
        // Windows does not cut a file that is mapped.
        if cfg!(unix) {
            what_becomes_is_told(ReadMethod::Mapped);
        }
    }

    fn what_becomes_is_told(method: ReadMethod) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.df");
        assert!(LocalFile::open(folder.path(), method).is_ok_and(|found| found.is_none()) || cfg!(windows));
        write(&path, 100);
        let file = LocalFile::open(&path, method).unwrap().unwrap();
        assert_eq!((file.change(), file.size().unwrap()), (None, 100));
        // Longer, or touched, is still the same file.
        write(&path, 120);
        assert_eq!(file.change(), None);
        std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(40).unwrap();
        assert_eq!(file.change(), Some(Change::Shortened { from: 100, to: 40 }));
        let error = file.read_exact_at(&mut [0; 50], 0).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
        if cfg!(unix) {
            let other = folder.path().join("b.df");
            write(&other, 100);
            std::fs::rename(&other, &path).unwrap();
            assert_eq!(file.change(), Some(Change::Replaced));
            std::fs::remove_file(&path).unwrap();
            assert_eq!(file.change(), Some(Change::Deleted));
        }
        for change in [Change::Deleted, Change::Replaced, Change::Rewritten, Change::Shortened { from: 9, to: 3 }] {
            assert!(change.to_string().starts_with("the file was "), "{change}");
        }
    }
}
