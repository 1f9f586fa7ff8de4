//! One page file on the disk: opening it and reading its pages.

use super::disk::{Change, Disk};
use super::error::StoreError;
use super::footer;
use super::layout::{ALIGNMENT, HEADER_LEN, Header, HeaderError, PAGE_HEADER_LEN, PageEntry, VERSION, VERSION_NAMED};
use super::metadata::Metadata;
use super::page::{NODE_MEMORY, Page, PageId};
use crate::model::Placement;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What messages call such a file.
pub(super) const KIND: &str = "page file";

/// The bytes of a page as they came from the disk, unchecked.
#[derive(Debug)]
pub(super) struct RawPage {
    pub(super) page: PageId,
    pub(super) bytes: Vec<u8>,
}

/// An open page file. It holds the footer (28 bytes for each page of about 3 MB, attribute tables and codebooks), never pages.
#[derive(Debug)]
pub(super) struct Reader {
    path: PathBuf,
    disk: Arc<dyn Disk>,
    header: Header,
    head: Vec<u8>,
    metadata: Arc<Metadata>,
    table: Vec<PageEntry>,
}

impl Reader {
    /// Checks header, footer and page table. Pages are checked as they are read.
    pub(super) fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<Reader, StoreError> {
        let io = |action| move |source| StoreError::Io { path: path.to_path_buf(), action, source };
        let real_len = disk.size().map_err(io("look at"))?;
        let mut head = vec![0; (HEADER_LEN as u64).min(real_len) as usize];
        disk.read_exact_at(&mut head, 0).map_err(io("read the header"))?;
        let header = Header::decode(&head, real_len).map_err(|error| match error {
            HeaderError::NotAPageFile(expected) => {
                StoreError::NotThis { path: path.to_path_buf(), kind: KIND, expected }
            }
            HeaderError::Version(found) => {
                let supported = [VERSION, VERSION_NAMED];
                StoreError::Version { path: path.to_path_buf(), kind: KIND, found, supported }
            }
            HeaderError::Damaged(damage) => damage.in_file(path),
        })?;
        let damaged = |place: &str, expected: &str| StoreError::Damaged {
            path: path.to_path_buf(),
            place: place.into(),
            expected: expected.into(),
        };
        let mut bytes =
            vec![0; usize::try_from(header.footer_len).map_err(|_| damaged("header", "a footer that fits in memory"))?];
        disk.read_exact_at(&mut bytes, header.footer_offset).map_err(io("read the footer"))?;
        if crc32c::crc32c(&bytes) != header.footer_crc {
            return Err(damaged("footer", "its checksum"));
        }
        let (metadata, table) =
            footer::decode(&bytes, header.version, header.pages).map_err(|damage| damage.in_file(path))?;
        let reader = Reader { path: path.to_path_buf(), disk, header, head, metadata: Arc::new(metadata), table };
        reader.check_table().map_err(|(place, expected)| damaged(&place, expected))?;
        Ok(reader)
    }

    /// What the file holds.
    pub(super) fn metadata(&self) -> &Arc<Metadata> {
        &self.metadata
    }

    /// The file's path, as it was opened.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file, bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.header.file_len
    }

    /// Number of pages.
    pub(super) fn page_count(&self) -> u32 {
        self.table.len() as u32
    }

    /// Bytes that reading the page takes from the disk; 0 for a page that does not exist.
    pub(super) fn page_bytes(&self, page: PageId) -> u64 {
        self.table.get(page.0 as usize).map_or(0, |entry| u64::from(entry.len))
    }

    /// Bytes that the page takes in memory; 0 for a page that does not exist.
    pub(super) fn page_memory(&self, page: PageId) -> u64 {
        let of = |entry: &PageEntry| u64::from(entry.memory) + u64::from(entry.nodes) * NODE_MEMORY;
        self.table.get(page.0 as usize).map_or(0, of)
    }

    /// Largest what a page takes of all pages.
    pub(super) fn largest_page_bytes(&self) -> u64 {
        self.table.iter().map(|entry| u64::from(entry.len)).max().unwrap_or(0)
    }

    /// Reads a page's bytes and nothing more: the part of [`PageFile::read_page`](super::PageFile::read_page) that waits for the disk.
    ///
    /// # Errors
    /// As [`PageFile::read_page`](super::PageFile::read_page).
    pub(super) fn fetch_page(&self, page: PageId) -> Result<RawPage, StoreError> {
        let entry = self.table.get(page.0 as usize).ok_or_else(|| self.damaged(page, "to exist"))?;
        // The length was checked against the file when it was opened.
        let mut bytes = vec![0; entry.len as usize];
        self.disk
            .read_exact_at(&mut bytes, entry.offset)
            .map_err(|source| StoreError::Page { path: self.path.clone(), page: page.0, source })
            .map_err(|error| self.explained(page, error))?;
        Ok(RawPage { page, bytes })
    }

    /// Checks and decodes a page's bytes: the part of [`PageFile::read_page`](super::PageFile::read_page) that works the processor.
    ///
    /// # Errors
    /// As [`PageFile::read_page`](super::PageFile::read_page).
    pub(super) fn decode_page(&self, bytes: RawPage, placement: &Placement) -> Result<Page, StoreError> {
        let RawPage { page, bytes } = bytes;
        let entry = self.table.get(page.0 as usize).ok_or_else(|| self.damaged(page, "to exist"))?;
        if crc32c::crc32c(&bytes) != entry.crc {
            return Err(self.explained(page, self.damaged(page, "its checksum")));
        }
        Page::parse(page, &bytes, &self.metadata, &self.table, placement).map_err(|damage| damage.in_file(&self.path))
    }

    /// What has become of the file since it was opened; asks the disk, so it may wait.
    pub(super) fn change(&self) -> Option<Change> {
        self.disk.change().or_else(|| {
            // The header holds the footer's checksum, and the footer those of all pages.
            let mut head = vec![0; self.head.len()];
            self.disk.read_exact_at(&mut head, 0).ok()?;
            (head != self.head).then_some(Change::Rewritten)
        })
    }

    fn damaged(&self, page: PageId, expected: &str) -> StoreError {
        StoreError::Damaged { path: self.path.clone(), place: format!("page {}", page.0), expected: expected.into() }
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
            if entry.nodes == 0 || entry.family as usize >= self.metadata.families.len() {
                return Err((place(), "at least one node, of a family of this file"));
            }
        }
        if end != self.header.footer_offset {
            return Err(("header".into(), "a footer right after the last page"));
        }
        // The outline of a step of a run that keeps no stills has no page at all.
        let families = self.metadata.families.iter().enumerate().filter(|_| !self.table.is_empty());
        for (i, family) in families {
            let is_wrong =
                |page: PageId| self.table.get(page.0 as usize).is_none_or(|entry| entry.family as usize != i);
            if is_wrong(family.root_page) || family.trees().any(|(_, root)| is_wrong(root)) {
                return Err(("footer".into(), "a root page of the same family for each family"));
            }
        }
        Ok(())
    }

    /// Bytes `[start, end)` of the file, for the verifier's look at the padding.
    pub(super) fn raw(&self, start: u64, end: u64) -> Result<Vec<u8>, StoreError> {
        let mut bytes = vec![0; end.saturating_sub(start) as usize];
        self.disk.read_exact_at(&mut bytes, start).map_err(|source| StoreError::Io {
            path: self.path.clone(),
            action: "read",
            source,
        })?;
        Ok(bytes)
    }

    /// The page table.
    pub(super) fn table(&self) -> &[PageEntry] {
        &self.table
    }

    /// Where the footer starts.
    pub(super) fn footer_offset(&self) -> u64 {
        self.header.footer_offset
    }
}
