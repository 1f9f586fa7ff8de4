//! Page files as everything else sees them: one, or several that make one scene.
//!
//! In a scene of several the pages and families of each file follow those of the one before, and what is read from it is put where
//! it lies ([`Placement`]). Nothing else in the program knows that there are several.

use super::container::RawPage;
use super::disk::{Change, Disk};
use super::error::StoreError;
use super::metadata::Metadata;
use super::open_disk::open_disk;
use super::page::{Page, PageId};
use super::reader::{KIND, Reader};
use crate::model::url::shown;
use crate::model::{Placement, ReadMethod};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// The bytes of a page as they came from the disk, unchecked.
#[derive(Debug)]
pub struct PageBytes {
    part: usize,
    raw: RawPage,
}

impl PageBytes {
    /// The bytes of a page of a tree that is no page file.
    pub fn new(page: PageId, bytes: Vec<u8>) -> PageBytes {
        PageBytes { part: 0, raw: RawPage { page, bytes } }
    }

    /// The page; of several files, its number in its own.
    pub fn page(&self) -> PageId {
        self.raw.page
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.raw.bytes
    }
}

/// An open page file, or several as one. Cheap to share in an `Arc`: reads are positioned, and what is known of pages is told without a lock.
#[derive(Debug)]
pub struct PageFile {
    pub(super) metadata: Arc<Metadata>,
    /// One or more.
    pub(super) parts: Vec<Part>,
    /// How its bytes come into memory.
    pub(super) read: ReadMethod,
}

/// One file of a scene.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) reader: Reader,
    pub(super) placement: Placement,
    /// Number of its first page and its first family in the scene.
    pub(super) first_page: u32,
    pub(super) first_family: u32,
}

/// What is known of one file of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct PartInfo<'a> {
    /// Its path, as it was opened.
    pub path: &'a Path,
    /// Its families in [`Metadata::families`] of the scene.
    pub families: Range<usize>,
    /// What it says itself, in its own units.
    pub metadata: &'a Metadata,
    /// Where it lies.
    pub placement: Placement,
}

impl PageFile {
    /// Opens a file, here or behind a URL, and checks header, footer and the page table, if the footer has it. Pages, and index pages that
    /// tell of them, are checked as they are read.
    ///
    /// # Errors
    /// [`StoreError`] where it cannot be read, is no page file or is damaged.
    pub fn open(path: &Path) -> Result<PageFile, StoreError> {
        PageFile::open_with(path, ReadMethod::default())
    }

    /// The same, read in the way `method`.
    ///
    /// # Errors
    /// As [`PageFile::open`].
    pub fn open_with(path: &Path, method: ReadMethod) -> Result<PageFile, StoreError> {
        let file = PageFile::open_on(&shown(path), open_disk(path, method, KIND.name)?)?;
        Ok(PageFile { read: method, ..file })
    }

    /// The same for bytes that lie anywhere; `path` is what messages call them.
    ///
    /// # Errors
    /// As [`PageFile::open`].
    pub fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<PageFile, StoreError> {
        let reader = Reader::open_on(path, disk)?;
        let metadata = Arc::clone(reader.metadata());
        let part = Part { reader, placement: Placement::HERE, first_page: 0, first_family: 0 };
        Ok(PageFile { metadata, parts: vec![part], read: ReadMethod::default() })
    }

    /// Whether `bytes`, the first ones of a file, say that it is a page file of any version.
    pub fn recognises(bytes: &[u8]) -> bool {
        bytes.starts_with(&super::layout::MAGIC)
    }

    /// What it holds.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The path as it was opened; that of the first of several.
    pub fn path(&self) -> &Path {
        self.first().path()
    }

    /// How its bytes come into memory; its source is read alike.
    pub fn read_method(&self) -> ReadMethod {
        self.read
    }

    /// Whether there are several files.
    pub fn is_joined(&self) -> bool {
        self.parts.len() > 1
    }

    /// Whether it is one file in its own coordinates, so that what its source says holds here too.
    pub fn is_as_its_source(&self) -> bool {
        matches!(&self.parts[..], [only] if only.placement.is_here())
    }

    /// The files.
    pub fn parts(&self) -> impl ExactSizeIterator<Item = PartInfo<'_>> {
        self.parts.iter().map(|part| {
            let (first, metadata) = (part.first_family as usize, part.reader.metadata());
            let families = first..first + metadata.families.len();
            PartInfo { path: part.reader.path(), families, metadata, placement: part.placement }
        })
    }

    /// Bytes of all files.
    pub fn bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.reader.bytes()).sum()
    }

    /// Number of pages.
    pub fn page_count(&self) -> u32 {
        self.parts.last().map_or(0, |last| last.first_page + last.reader.page_count())
    }

    /// Bytes that reading the page takes from the disk, about as many as long as nobody has read a page that has it as a child; 0 for a
    /// page that does not exist.
    pub fn page_bytes(&self, page: PageId) -> u64 {
        let (part, own) = self.part_of(page);
        self.parts[part].reader.page_bytes(own)
    }

    /// Bytes that the page takes in memory, in the same way; 0 for a page that does not exist.
    pub fn page_memory(&self, page: PageId) -> u64 {
        let (part, own) = self.part_of(page);
        self.parts[part].reader.page_memory(own)
    }

    /// Largest [`PageFile::page_bytes`] of all pages.
    pub fn largest_page_bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.reader.largest_page_bytes()).max().unwrap_or(0)
    }

    /// Reads a page: checks its checksum, its structure, every code and every child reference.
    ///
    /// # Errors
    /// [`StoreError::Changed`] where the file is not what it was when it was opened, else what is wrong with the page. Messages name
    /// the page by its number in its own file.
    pub fn read_page(&self, page: PageId) -> Result<Page, StoreError> {
        self.decode_page(self.fetch_page(page)?)
    }

    /// Reads a page's bytes and nothing more: the part of [`PageFile::read_page`] that waits for the disk.
    ///
    /// # Errors
    /// As [`PageFile::read_page`].
    pub fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
        let (part, own) = self.part_of(page);
        Ok(PageBytes { part, raw: self.parts[part].reader.fetch_page(own)? })
    }

    /// Checks and decodes a page's bytes: the part of [`PageFile::read_page`] that works the processor.
    ///
    /// # Errors
    /// As [`PageFile::read_page`].
    pub fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
        // Bytes come from a page of this scene, or of another with fewer or more files.
        let part = self.parts.get(bytes.part).unwrap_or(&self.parts[0]);
        let mut page = part.reader.decode_page(bytes.raw, &part.placement)?;
        if part.first_page > 0 || !part.placement.is_here() {
            page.relocate(part.first_page, part.first_family, &part.placement);
        }
        Ok(page)
    }

    /// How many pages at a time are best read, where that is up to what they are read from: by the best of several.
    pub fn reads_at_once(&self) -> Option<usize> {
        self.parts.iter().filter_map(|part| part.reader.reads_at_once()).max()
    }

    /// What has become of a page's file since it was opened; asks the disk, so it may wait.
    pub fn change_of(&self, page: PageId) -> Option<Change> {
        self.parts[self.part_of(page).0].reader.change()
    }

    /// The path of the file that a page belongs to.
    pub fn path_of(&self, page: PageId) -> &Path {
        self.parts[self.part_of(page).0].reader.path()
    }

    /// The only file, or the first of several: for what looks at a file's bytes.
    pub(super) fn first(&self) -> &Reader {
        // There is one at least: it is made by opening a file.
        &self.parts[0].reader
    }

    /// Index of the file that a page belongs to, and the page's number there; pages that do not exist are some of the last file's.
    fn part_of(&self, page: PageId) -> (usize, PageId) {
        let part = self.parts.partition_point(|part| part.first_page <= page.0).saturating_sub(1);
        (part, PageId(page.0 - self.parts[part].first_page))
    }
}
