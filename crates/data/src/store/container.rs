//! What files of pages have in common, whatever is in the pages: a header, aligned pages, a footer that begins with a table of them.

use super::disk::{Change, Disk, room};
use super::error::{Damage, StoreError};
use super::layout::{ALIGNMENT, HEADER_LEN, Header, HeaderError, PageEntry};
use super::page::PageId;
use super::page_table::{PageTable, Unread};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a file of pages is.
#[derive(Clone, Copy, Debug)]
pub struct FileKind {
    /// What messages call it.
    pub name: &'static str,
    /// Its first bytes.
    pub magic: [u8; 8],
    /// The first and the last version that are read.
    pub versions: [u32; 2],
}

impl FileKind {
    fn versions(&self) -> RangeInclusive<u32> {
        self.versions[0]..=self.versions[1]
    }
}

/// The bytes of a page as they came from the disk, unchecked.
#[derive(Debug)]
pub struct RawPage {
    /// Its number.
    pub page: PageId,
    /// All of it.
    pub bytes: Vec<u8>,
}

/// An open file of pages. It holds what has been read of the table of pages (32 bytes for each), never pages.
#[derive(Debug)]
pub struct Container {
    path: PathBuf,
    disk: Arc<dyn Disk>,
    header: Header,
    head: Vec<u8>,
    /// In a box, so that enums that hold files of several kinds beside each other stay small.
    table: Box<PageTable>,
}

impl Container {
    /// Checks header, footer and table of pages. Gives what follows that table in the footer, too. Pages are checked as they are read.
    ///
    /// # Errors
    /// [`StoreError`] where the file cannot be read, is of another kind or damaged.
    pub fn open_on(path: &Path, disk: Arc<dyn Disk>, kind: FileKind) -> Result<(Container, Vec<u8>), StoreError> {
        let io = |action| move |source| StoreError::Io { path: path.to_path_buf(), action, source };
        let real_len = disk.size().map_err(io("look at"))?;
        let mut head = vec![0; (HEADER_LEN as u64).min(real_len) as usize];
        disk.read_sealed_at(&mut head, 0, Header::is_sound).map_err(io("read the header"))?;
        let header = Header::decode(&head, real_len, kind.magic, kind.versions()).map_err(|error| match error {
            HeaderError::NotAPageFile(expected) => {
                StoreError::NotThis { path: path.to_path_buf(), kind: kind.name, expected }
            }
            HeaderError::Version(found) => {
                let supported = kind.versions;
                StoreError::Version { path: path.to_path_buf(), kind: kind.name, found, supported }
            }
            HeaderError::Damaged(damage) => damage.in_file(path),
        })?;
        let damaged = |place: &str, expected: &str| Damage::new(place, expected).in_file(path);
        let len = room(header.footer_len).ok_or_else(|| damaged("header", "a footer that fits in memory"))?;
        let mut footer = vec![0; len];
        disk.read_known_at(&mut footer, header.footer_offset, header.footer_crc).map_err(io("read the footer"))?;
        if crc32c::crc32c(&footer) != header.footer_crc {
            return Err(damaged("footer", "its checksum"));
        }
        let (table, taken) = PageTable::open(&header, &footer).map_err(|damage| damage.in_file(path))?;
        let rest = footer.split_off(taken);
        Ok((Container { path: path.to_path_buf(), disk, header, head, table: Box::new(table) }, rest))
    }

    /// The version in its header.
    pub fn version(&self) -> u32 {
        self.header.version
    }

    /// The file's path, as it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file, bytes.
    pub fn bytes(&self) -> u64 {
        self.header.file_len
    }

    /// The page table.
    pub fn table(&self) -> &PageTable {
        &self.table
    }

    /// Reads what the table says of a page, unless that is known: what reading the page `wanted` takes. May wait for the disk.
    ///
    /// # Errors
    /// As [`Container::fetch_page`] of the page that is wanted.
    pub(super) fn learn(&self, page: PageId, wanted: PageId) -> Result<(), StoreError> {
        let error = match self.table.load(page.0 as usize, &*self.disk) {
            Ok(()) => return Ok(()),
            Err(Unread::Io(source)) => StoreError::Page { path: self.path.clone(), page: wanted.0, source },
            Err(Unread::Damaged(damage)) => damage.in_file(&self.path),
        };
        Err(self.explained(wanted, error))
    }

    /// Reads a page's bytes and nothing more.
    ///
    /// # Errors
    /// [`StoreError`] where there is no such page or it cannot be read; [`StoreError::Changed`] where that is why.
    pub fn fetch_page(&self, page: PageId) -> Result<RawPage, StoreError> {
        self.learn(page, page)?;
        let entry = self.entry(page)?;
        // The length was checked against the file when the table was read.
        let mut bytes = vec![0; entry.len as usize];
        self.disk
            .read_known_at(&mut bytes, entry.offset, entry.crc)
            .map_err(|source| StoreError::Page { path: self.path.clone(), page: page.0, source })
            .map_err(|error| self.explained(page, error))?;
        Ok(RawPage { page, bytes })
    }

    /// Whether a page's bytes have the checksum of the table.
    ///
    /// # Errors
    /// As [`Container::fetch_page`], and where they have not.
    pub fn check_page(&self, raw: &RawPage) -> Result<(), StoreError> {
        match crc32c::crc32c(&raw.bytes) == self.entry(raw.page)?.crc {
            true => Ok(()),
            false => Err(self.explained(raw.page, self.damaged(raw.page, "its checksum"))),
        }
    }

    /// What has become of the file since it was opened; asks the disk, so it may wait.
    pub fn change(&self) -> Option<Change> {
        self.disk.change().or_else(|| {
            if self.disk.knows_changes() {
                return None;
            }
            // The header holds the footer's checksum, and the footer those of all pages.
            let mut head = vec![0; self.head.len()];
            self.disk.read_exact_at(&mut head, 0).ok()?;
            (head != self.head).then_some(Change::Rewritten)
        })
    }

    /// How many pages at a time are best read, where that is up to the disk ([`Disk::reads_at_once`]).
    pub fn reads_at_once(&self) -> Option<usize> {
        self.disk.reads_at_once()
    }

    /// Whether bytes that are of no structure are zeros: those after a page that has been read, or, of none, those after the header, and
    /// after a table that is not in the footer.
    ///
    /// # Errors
    /// [`StoreError`] where they are not, or cannot be read.
    pub fn check_zeros(&self, after: Option<PageId>) -> Result<(), StoreError> {
        let Some(page) = after else {
            self.check_between([HEADER_LEN as u64, ALIGNMENT])?;
            return self.table.zeros().map_or(Ok(()), |zeros| self.check_between(zeros));
        };
        let entry = self.entry(page)?;
        let end = entry.offset + u64::from(entry.len);
        // What follows a page starts at the next aligned place.
        self.check_between([end, end.next_multiple_of(ALIGNMENT)])
    }

    fn check_between(&self, [start, end]: [u64; 2]) -> Result<(), StoreError> {
        let mut bytes = vec![0; (end - start) as usize];
        self.disk.read_exact_at(&mut bytes, start).map_err(|source| StoreError::Io {
            path: self.path.clone(),
            action: "read",
            source,
        })?;
        match bytes.iter().all(|&byte| byte == 0) {
            true => Ok(()),
            false => Err(Damage::new(format!("bytes {start} to {end}"), "zeros").in_file(&self.path)),
        }
    }

    /// What is known of where a page lies.
    fn entry(&self, page: PageId) -> Result<&PageEntry, StoreError> {
        self.table.get(page.0 as usize).ok_or_else(|| self.damaged(page, "to exist"))
    }

    fn damaged(&self, page: PageId, expected: &str) -> StoreError {
        Damage::new(format!("page {}", page.0), expected).in_file(&self.path)
    }

    /// The error itself, unless something has happened to the file that explains it.
    fn explained(&self, page: PageId, error: StoreError) -> StoreError {
        match self.change() {
            Some(change) => StoreError::Changed { path: self.path.clone(), page: page.0, change },
            None => error,
        }
    }
}
