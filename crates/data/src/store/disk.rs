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
use std::sync::Arc;

/// Something that bytes are read from, by several threads at a time.
pub trait Disk: fmt::Debug + Send + Sync {
    /// Fills `buffer` from `offset`, without a shared cursor.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] where the bytes end before the buffer does; whatever else the system answers.
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()>;

    /// The same for bytes whose CRC-32C is known, so that whoever keeps copies knows which are sound. What is read is checked by who
    /// asked for it.
    ///
    /// # Errors
    /// As [`Disk::read_exact_at`].
    fn read_known_at(&self, buffer: &mut [u8], offset: u64, _crc: u32) -> io::Result<()> {
        self.read_exact_at(buffer, offset)
    }

    /// The same for bytes that hold a checksum of their own, as headers do, which `is_sound` looks at: nothing else says which version of a
    /// file they are of. What is read is checked by who asked for it.
    ///
    /// # Errors
    /// As [`Disk::read_exact_at`].
    fn read_sealed_at(&self, buffer: &mut [u8], offset: u64, _is_sound: fn(&[u8]) -> bool) -> io::Result<()> {
        self.read_exact_at(buffer, offset)
    }

    /// How many bytes there are now.
    ///
    /// # Errors
    /// What the system answers.
    fn size(&self) -> io::Result<u64>;

    /// What has become of the file since it was opened, where that can be told without reading it.
    fn change(&self) -> Option<Change>;

    /// Whether [`Disk::change`] says all that could be found out by reading.
    fn knows_changes(&self) -> bool {
        false
    }

    /// How many reads at a time serve best, where that is up to what they are answered by; it changes with the answers.
    fn reads_at_once(&self) -> Option<usize> {
        None
    }
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

/// So many bytes as a length in memory, where there may be room for them: a server says what it likes about the length of a file.
pub(super) fn room(bytes: u64) -> Option<usize> {
    usize::try_from(bytes).ok().filter(|len| Vec::<u8>::new().try_reserve_exact(*len).is_ok())
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

/// A part of what is read: its own byte 0 is byte `offset` there.
#[derive(Debug)]
pub struct Window {
    disk: Arc<dyn Disk>,
    offset: u64,
    len: u64,
}

impl Window {
    /// The `len` bytes from `offset` on.
    pub fn new(disk: Arc<dyn Disk>, offset: u64, len: u64) -> Window {
        Window { disk, offset, len }
    }

    /// Where a read of so many bytes begins in the whole.
    fn start_of(&self, buffer: &[u8], offset: u64) -> io::Result<u64> {
        let end = offset.checked_add(buffer.len() as u64).filter(|end| *end <= self.len);
        end.and_then(|_| self.offset.checked_add(offset)).ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
    }
}

impl Disk for Window {
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.disk.read_exact_at(buffer, self.start_of(buffer, offset)?)
    }

    fn read_known_at(&self, buffer: &mut [u8], offset: u64, crc: u32) -> io::Result<()> {
        self.disk.read_known_at(buffer, self.start_of(buffer, offset)?, crc)
    }

    fn read_sealed_at(&self, buffer: &mut [u8], offset: u64, is_sound: fn(&[u8]) -> bool) -> io::Result<()> {
        self.disk.read_sealed_at(buffer, self.start_of(buffer, offset)?, is_sound)
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.disk.size()?.saturating_sub(self.offset).min(self.len))
    }

    fn change(&self) -> Option<Change> {
        self.disk.change()
    }

    fn knows_changes(&self) -> bool {
        self.disk.knows_changes()
    }

    fn reads_at_once(&self) -> Option<usize> {
        self.disk.reads_at_once()
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
    fn a_window_shows_its_part_and_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.df");
        std::fs::write(&path, (0..100).collect::<Vec<u8>>()).unwrap();
        let file = Arc::new(LocalFile::open(&path, ReadMethod::default()).unwrap().unwrap());
        let window = Window::new(Arc::clone(&file) as Arc<dyn Disk>, 10, 20);
        assert_eq!(window.size().unwrap(), 20);
        let mut bytes = [0; 20];
        window.read_exact_at(&mut bytes, 0).unwrap();
        assert_eq!(bytes[..], (10..30).collect::<Vec<u8>>());
        for (offset, len) in [(0, 21), (20, 1), (u64::MAX, 1), (u64::MAX - 5, 20)] {
            let error = window.read_exact_at(&mut vec![0; len], offset).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof, "{offset}, {len}");
        }
        // A window beyond the end of the file is as short as what is there.
        let beyond = Window::new(file, 90, 20);
        assert_eq!(beyond.size().unwrap(), 10);
        assert!(beyond.read_exact_at(&mut [0; 20], 0).is_err());
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
