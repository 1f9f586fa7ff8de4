//! What everything above the store sees of data: a tree of nodes in pages, whoever holds or makes them.

use super::disk::Change;
use super::error::StoreError;
use super::metadata::Metadata;
use super::page::{NodeRef, Page, PageId};
use super::page_file::{PageBytes, PageFile};
use crate::hierarchy::Purpose;
use std::fmt::Debug;
use std::path::Path;
use std::sync::Arc;

/// A hierarchy over some data. Nodes have any number of children and lie anywhere in their parents' boxes; pages are read and
/// decoded by several threads at a time.
pub trait Tree: Debug + Send + Sync {
    /// What it holds.
    fn metadata(&self) -> &Metadata;

    /// What messages call it.
    fn path(&self) -> &Path;

    /// Number of pages.
    fn page_count(&self) -> u32;

    /// Bytes that fetching the page reads; 0 for a page that does not exist.
    fn page_bytes(&self, page: PageId) -> u64;

    /// Bytes that the page takes in memory ([`Page::memory`]), as far as is known before it is read; 0 for a page that does not
    /// exist.
    fn page_memory(&self, page: PageId) -> u64;

    /// Reads a page's bytes and nothing more: the part that waits for a disk.
    ///
    /// # Errors
    /// [`StoreError`] where they cannot be had.
    fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError>;

    /// Makes a page of its bytes: the part that works the processor.
    ///
    /// # Errors
    /// [`StoreError`] where they are damaged.
    fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError>;

    /// Fetches and decodes a page.
    ///
    /// # Errors
    /// As [`Tree::fetch_page`] and [`Tree::decode_page`].
    fn read_page(&self, page: PageId) -> Result<Page, StoreError> {
        self.decode_page(self.fetch_page(page)?)
    }

    /// Largest [`Tree::page_bytes`] of all pages.
    fn largest_page_bytes(&self) -> u64 {
        (0..self.page_count()).map(|page| self.page_bytes(PageId(page))).max().unwrap_or(0)
    }

    /// How many pages are about as much to read and decode as a page of a page file.
    fn pages_at_once(&self) -> usize {
        1
    }

    /// How many pages at a time are best read, where that is up to what they are read from; it changes with the reads.
    fn reads_at_once(&self) -> Option<usize> {
        None
    }

    /// The first nodes of these families (indices in the metadata) at a time, in the data's unit, made for this purpose where there are
    /// such.
    fn roots(&self, families: &[u32], purpose: Purpose, _time: f64) -> Vec<NodeRef> {
        let families = families.iter().filter_map(|&family| self.metadata().families.get(family as usize));
        let page = |family: &super::FamilyMetadata| family.root_page_of(purpose).unwrap_or(family.root_page);
        // An outline has no pages.
        let pages = families.map(page).filter(|page| page.0 < self.page_count());
        pages.map(|page| NodeRef { page, node: 0 }).collect()
    }

    /// Whether a page holds a root: nothing can be drawn without it.
    fn is_root(&self, page: PageId) -> bool {
        self.metadata().families.iter().any(|family| family.has_root(page))
    }

    /// What has become of what a page is read from since it was opened; may wait.
    fn change_of(&self, _page: PageId) -> Option<Change> {
        None
    }

    /// What messages call that.
    fn path_of(&self, _page: PageId) -> &Path {
        self.path()
    }
}

/// Passes every method on.
macro_rules! delegate {
    ($self:ident => $to:expr) => {
        fn metadata(&$self) -> &Metadata {
            $to.metadata()
        }

        fn path(&$self) -> &Path {
            $to.path()
        }

        fn page_count(&$self) -> u32 {
            $to.page_count()
        }

        fn page_bytes(&$self, page: PageId) -> u64 {
            $to.page_bytes(page)
        }

        fn page_memory(&$self, page: PageId) -> u64 {
            $to.page_memory(page)
        }

        fn fetch_page(&$self, page: PageId) -> Result<PageBytes, StoreError> {
            $to.fetch_page(page)
        }

        fn decode_page(&$self, bytes: PageBytes) -> Result<Page, StoreError> {
            $to.decode_page(bytes)
        }

        fn largest_page_bytes(&$self) -> u64 {
            $to.largest_page_bytes()
        }

        fn reads_at_once(&$self) -> Option<usize> {
            $to.reads_at_once()
        }

        fn change_of(&$self, page: PageId) -> Option<Change> {
            $to.change_of(page)
        }

        fn path_of(&$self, page: PageId) -> &Path {
            $to.path_of(page)
        }
    };
}

impl Tree for PageFile {
    // Inherent methods come before a trait's, so each calls the file's own of the same name.
    delegate!(self => self);
}

impl<T: Tree + ?Sized> Tree for Arc<T> {
    delegate!(self => (**self));

    fn pages_at_once(&self) -> usize {
        (**self).pages_at_once()
    }

    fn roots(&self, families: &[u32], purpose: Purpose, time: f64) -> Vec<NodeRef> {
        (**self).roots(families, purpose, time)
    }

    fn is_root(&self, page: PageId) -> bool {
        (**self).is_root(page)
    }
}
