//! Opening a page file and reading its pages.

use super::disk::{Change, Disk, LocalFile};
use super::error::StoreError;
use super::footer;
use super::layout::{ALIGNMENT, HEADER_LEN, Header, HeaderError, PAGE_HEADER_LEN, PageEntry, VERSION, VERSION_VOLUME};
use super::metadata::Metadata;
use super::page::{Node, Page, PageId};
use crate::hierarchy::Levels;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The bytes of a page as they came from the disk, unchecked.
#[derive(Debug)]
pub struct PageBytes {
    page: PageId,
    bytes: Vec<u8>,
}

/// An open page file. Cheap to share in an `Arc`: reads are positioned and take no lock. It holds the footer (28 bytes
/// for each page of about 3 MB, attribute tables and codebooks), never pages.
#[derive(Debug)]
pub struct PageFile {
    path: PathBuf,
    disk: Arc<dyn Disk>,
    header: Header,
    head: Vec<u8>,
    metadata: Metadata,
    table: Vec<PageEntry>,
}

impl PageFile {
    /// Opens the file and checks header, footer and page table. Pages are checked as they are read.
    pub fn open(path: &Path) -> Result<PageFile, StoreError> {
        let opened = LocalFile::open(path);
        let opened = opened.map_err(|source| StoreError::Io { path: path.to_path_buf(), action: "open", source })?;
        let not_a_file = || StoreError::NotAPageFile { path: path.to_path_buf(), expected: "a regular file" };
        PageFile::open_on(path, Arc::new(opened.ok_or_else(not_a_file)?))
    }

    /// The same for bytes that lie anywhere; `path` is what messages call them.
    pub fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<PageFile, StoreError> {
        let io = |action| move |source| StoreError::Io { path: path.to_path_buf(), action, source };
        let real_len = disk.size().map_err(io("look at"))?;
        let mut head = vec![0; (HEADER_LEN as u64).min(real_len) as usize];
        disk.read_exact_at(&mut head, 0).map_err(io("read the header"))?;
        let header = Header::decode(&head, real_len).map_err(|error| match error {
            HeaderError::NotAPageFile(expected) => StoreError::NotAPageFile { path: path.to_path_buf(), expected },
            HeaderError::Version(found) => {
                StoreError::Version { path: path.to_path_buf(), found, supported: [VERSION, VERSION_VOLUME] }
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
        let page_file = PageFile { path: path.to_path_buf(), disk, header, head, metadata, table };
        page_file.check_table().map_err(|(place, expected)| damaged(&place, expected))?;
        Ok(page_file)
    }

    /// Whether `bytes`, the first ones of a file, say that it is a page file of any version.
    pub fn recognises(bytes: &[u8]) -> bool {
        bytes.starts_with(&super::layout::MAGIC)
    }

    /// What the file holds.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The file's path, as it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file, bytes.
    pub fn bytes(&self) -> u64 {
        self.header.file_len
    }

    /// Number of pages.
    pub fn page_count(&self) -> u32 {
        self.table.len() as u32
    }

    /// Bytes that reading the page takes from the disk; 0 for a page that does not exist.
    pub fn page_bytes(&self, page: PageId) -> u64 {
        self.table.get(page.0 as usize).map_or(0, |entry| u64::from(entry.len))
    }

    /// Bytes that the page takes in memory; 0 for a page that does not exist.
    pub fn page_memory(&self, page: PageId) -> u64 {
        let of = |entry: &PageEntry| u64::from(entry.memory) + u64::from(entry.nodes) * size_of::<Node>() as u64;
        self.table.get(page.0 as usize).map_or(0, of)
    }

    /// Largest [`PageFile::page_bytes`] of all pages.
    pub fn largest_page_bytes(&self) -> u64 {
        self.table.iter().map(|entry| u64::from(entry.len)).max().unwrap_or(0)
    }

    /// Reads a page: checks its checksum, its structure, every code and every child reference.
    ///
    /// # Errors
    /// [`StoreError::Changed`] where the file is not what it was when it was opened, else what is wrong with the page.
    pub fn read_page(&self, page: PageId) -> Result<Page, StoreError> {
        self.decode_page(self.fetch_page(page)?)
    }

    /// Reads a page's bytes and nothing more: the part of [`PageFile::read_page`] that waits for the disk.
    ///
    /// # Errors
    /// As [`PageFile::read_page`].
    pub fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
        let entry = self.table.get(page.0 as usize).ok_or_else(|| self.damaged(page, "to exist"))?;
        // The length was checked against the file when it was opened.
        let mut bytes = vec![0; entry.len as usize];
        self.disk
            .read_exact_at(&mut bytes, entry.offset)
            .map_err(|source| StoreError::Page { path: self.path.clone(), page: page.0, source })
            .map_err(|error| self.explained(page, error))?;
        Ok(PageBytes { page, bytes })
    }

    /// Checks and decodes a page's bytes: the part of [`PageFile::read_page`] that works the processor.
    ///
    /// # Errors
    /// As [`PageFile::read_page`].
    pub fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
        let PageBytes { page, bytes } = bytes;
        let entry = self.table.get(page.0 as usize).ok_or_else(|| self.damaged(page, "to exist"))?;
        if crc32c::crc32c(&bytes) != entry.crc {
            return Err(self.explained(page, self.damaged(page, "its checksum")));
        }
        Page::parse(page, &bytes, &self.metadata, &self.table).map_err(|damage| damage.in_file(&self.path))
    }

    /// What has become of the file since it was opened; asks the disk, so it may wait.
    pub fn change(&self) -> Option<Change> {
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
        for (i, family) in self.metadata.families.iter().enumerate() {
            let roots = [Levels::Splats, Levels::Volume].into_iter().filter_map(|levels| family.root_page_of(levels));
            let is_wrong =
                |page: PageId| self.table.get(page.0 as usize).is_none_or(|entry| entry.family as usize != i);
            if roots.into_iter().any(is_wrong) {
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
