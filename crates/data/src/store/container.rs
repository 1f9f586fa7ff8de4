//! What files of pages have in common, whatever is in the pages: a header, aligned pages, a footer that begins with a table of them.

use super::disk::{Change, Disk, room};
use super::error::{Damage, StoreError};
use super::layout::{ALIGNMENT, HEADER_LEN, Header, HeaderError, PAGE_ENTRY_LEN, PAGE_HEADER_LEN, PageEntry};
use super::page::PageId;
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

/// An open file of pages. It holds the table of pages (28 bytes for each), never pages.
#[derive(Debug)]
pub struct Container {
    path: PathBuf,
    disk: Arc<dyn Disk>,
    header: Header,
    head: Vec<u8>,
    table: Vec<PageEntry>,
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
        disk.read_exact_at(&mut head, 0).map_err(io("read the header"))?;
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
        let table_len = (header.pages as usize).checked_mul(PAGE_ENTRY_LEN).filter(|len| *len <= footer.len());
        let table_len = table_len.ok_or_else(|| damaged("footer", "room for the page table"))?;
        let rest = footer.split_off(table_len);
        let entries = footer.chunks_exact(PAGE_ENTRY_LEN).filter_map(|entry| entry.try_into().ok());
        let table = entries.map(PageEntry::decode).collect();
        let container = Container { path: path.to_path_buf(), disk, header, head, table };
        container.check_table().map_err(|(place, expected)| damaged(&place, expected))?;
        Ok((container, rest))
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
    pub fn table(&self) -> &[PageEntry] {
        &self.table
    }

    /// Reads a page's bytes and nothing more.
    ///
    /// # Errors
    /// [`StoreError`] where there is no such page or it cannot be read; [`StoreError::Changed`] where that is why.
    pub fn fetch_page(&self, page: PageId) -> Result<RawPage, StoreError> {
        let entry = self.table.get(page.0 as usize).ok_or_else(|| self.damaged(page, "to exist"))?;
        // The length was checked against the file when it was opened.
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
        let entry = self.table.get(raw.page.0 as usize).ok_or_else(|| self.damaged(raw.page, "to exist"))?;
        match crc32c::crc32c(&raw.bytes) == entry.crc {
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

    /// Whether bytes that are of no structure are zeros: those up to the first page, and those after each page.
    ///
    /// # Errors
    /// [`StoreError`] where they are not, or cannot be read.
    pub fn check_zeros(&self, after: Option<PageId>) -> Result<(), StoreError> {
        let end_of = |entry: &PageEntry| entry.offset + u64::from(entry.len);
        let next = |number: usize| self.table.get(number).map_or(self.header.footer_offset, |next| next.offset);
        let (start, end) = match after {
            None => (HEADER_LEN as u64, ALIGNMENT),
            Some(page) => match self.table.get(page.0 as usize) {
                Some(entry) => (end_of(entry), next(page.0 as usize + 1)),
                None => return Err(self.damaged(page, "to exist")),
            },
        };
        let mut bytes = vec![0; end.saturating_sub(start) as usize];
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

    /// Pages must follow one another from the header to the footer, each at the next aligned place.
    fn check_table(&self) -> Result<(), (String, &'static str)> {
        let mut end = ALIGNMENT;
        for (i, entry) in self.table.iter().enumerate() {
            let place = || format!("page table, entry {i}");
            if entry.offset != end || entry.len % 8 != 0 || (entry.len as usize) < PAGE_HEADER_LEN {
                return Err((place(), "a page right after the page before"));
            }
            end = entry
                .offset
                .checked_add(u64::from(entry.len))
                .and_then(|end| super::layout::align_up(end, ALIGNMENT))
                .filter(|&end| end <= self.header.footer_offset)
                .ok_or_else(|| (place(), "a page that ends before the footer"))?;
        }
        match end == self.header.footer_offset {
            true => Ok(()),
            false => Err(("header".into(), "a footer right after the last page")),
        }
    }
}
