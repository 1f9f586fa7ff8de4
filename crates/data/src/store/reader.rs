//! One page file on the disk: opening it and reading its pages.

use super::container::{Container, FileKind, RawPage};
use super::disk::{Change, Disk};
use super::error::{Damage, StoreError};
use super::footer;
use super::layout::{MAGIC, VERSION, VERSION_INDEXED, child_pages};
use super::metadata::{FamilyMetadata, Metadata};
use super::page::{NODE_MEMORY, Page, PageId};
use crate::model::Placement;
use std::path::Path;
use std::sync::Arc;

/// Files of particles.
pub(super) const KIND: FileKind = FileKind { name: "page file", magic: MAGIC, versions: [VERSION, VERSION_INDEXED] };

/// An open page file. It holds the footer (attribute tables, codebooks) and what has been read of the page table, 32 bytes for each page of
/// about 3 MB, never pages.
#[derive(Debug)]
pub(super) struct Reader {
    container: Container,
    metadata: Arc<Metadata>,
}

impl Reader {
    /// Checks header, footer and page table. Pages are checked as they are read.
    pub(super) fn open_on(path: &Path, disk: Arc<dyn Disk>) -> Result<Reader, StoreError> {
        let (container, footer) = Container::open_on(path, disk, KIND)?;
        let metadata = footer::decode(&footer, container.version()).map_err(|damage| damage.in_file(path))?;
        let reader = Reader { container, metadata: Arc::new(metadata) };
        reader.check_families().map_err(|damage| damage.in_file(path))?;
        Ok(reader)
    }

    /// What the file holds.
    pub(super) fn metadata(&self) -> &Arc<Metadata> {
        &self.metadata
    }

    /// Its pages, whatever is in them.
    pub(super) fn container(&self) -> &Container {
        &self.container
    }

    /// The file's path, as it was opened.
    pub(super) fn path(&self) -> &Path {
        self.container.path()
    }

    /// Length of the file, bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.container.bytes()
    }

    /// Number of pages.
    pub(super) fn page_count(&self) -> u32 {
        self.container.table().len() as u32
    }

    /// Bytes that reading the page takes from the disk, as far as is known; 0 for a page that does not exist.
    pub(super) fn page_bytes(&self, page: PageId) -> u64 {
        self.container.table().size(page.0 as usize).map_or(0, |size| size.bytes)
    }

    /// Bytes that the page takes in memory, as far as is known; 0 for a page that does not exist.
    pub(super) fn page_memory(&self, page: PageId) -> u64 {
        self.container.table().size(page.0 as usize).map_or(0, |size| size.memory + size.nodes * NODE_MEMORY)
    }

    /// Largest what a page takes of all pages.
    pub(super) fn largest_page_bytes(&self) -> u64 {
        self.container.table().longest().into()
    }

    /// Reads a page's bytes and nothing more: the part of [`PageFile::read_page`](super::PageFile::read_page) that waits for the disk.
    ///
    /// # Errors
    /// As [`PageFile::read_page`](super::PageFile::read_page).
    pub(super) fn fetch_page(&self, page: PageId) -> Result<RawPage, StoreError> {
        let raw = self.container.fetch_page(page)?;
        self.learn_children(&raw)?;
        Ok(raw)
    }

    /// Whoever has a page knows where its children lie and what they take: they are checked against it, and nobody who asks for them later
    /// waits for it.
    fn learn_children(&self, raw: &RawPage) -> Result<(), StoreError> {
        let table = self.container.table();
        if !table.has_unread() {
            return Ok(());
        }
        let is_unread = |child: &PageId| table.is_unread(child.0 as usize);
        let mut unread = child_pages(&raw.bytes).filter(is_unread).peekable();
        if unread.peek().is_some() {
            // What is damaged names pages at random.
            self.container.check_page(raw)?;
        }
        unread.try_for_each(|child| self.container.learn(child, raw.page))
    }

    /// Checks and decodes a page's bytes: the part of [`PageFile::read_page`](super::PageFile::read_page) that works the processor.
    ///
    /// # Errors
    /// As [`PageFile::read_page`](super::PageFile::read_page).
    pub(super) fn decode_page(&self, raw: RawPage, placement: &Placement) -> Result<Page, StoreError> {
        self.container.check_page(&raw)?;
        let page = Page::parse(raw.page, &raw.bytes, &self.metadata, self.container.table(), placement);
        let page = page.map_err(|damage| damage.in_file(self.path()))?;
        let is_wrong = |(i, family): (usize, &FamilyMetadata)| family.has_root(page.id) && i != page.family as usize;
        match self.metadata.families.iter().enumerate().any(is_wrong) {
            true => {
                let expected = "to be of the family whose root it has";
                Err(Damage::new(format!("page {}", page.id.0), expected).in_file(self.path()))
            }
            false => Ok(page),
        }
    }

    /// How many pages at a time are best read, where that is up to the disk.
    pub(super) fn reads_at_once(&self) -> Option<usize> {
        self.container.reads_at_once()
    }

    /// What has become of the file since it was opened; asks the disk, so it may wait.
    pub(super) fn change(&self) -> Option<Change> {
        self.container.change()
    }

    /// Every page must be of a family that there is, and every family's roots in pages of its own; what is not known yet is checked as pages
    /// are decoded.
    fn check_families(&self) -> Result<(), Damage> {
        let (table, families) = (self.container.table(), &self.metadata.families);
        for (i, entry) in table.iter().enumerate() {
            if entry.nodes == 0 || entry.family as usize >= families.len() {
                return Err(Damage::new(
                    format!("page table, entry {i}"),
                    "at least one node, of a family of this file",
                ));
            }
        }
        // The outline of a step of a run that keeps no stills has no page at all.
        for (i, family) in families.iter().enumerate().filter(|_| !table.is_empty()) {
            let is_wrong = |page: PageId| {
                let number = page.0 as usize;
                number >= table.len() || table.get(number).is_some_and(|entry| entry.family as usize != i)
            };
            if is_wrong(family.root_page) || family.trees().any(|(_, root)| is_wrong(root)) {
                return Err(Damage::new("footer", "a root page of the same family for each family"));
            }
        }
        Ok(())
    }
}
