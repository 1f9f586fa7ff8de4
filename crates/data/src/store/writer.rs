//! Writing a page file: under a temporary name in the target's folder, renamed when everything is on the disk.

use super::error::StoreError;
use super::footer;
use super::layout::{
    ALIGNMENT, Header, MAGIC, NODE_RECORD_LEN, NodeRecord, PAGE_HEADER_LEN, PageEntry, SECTION_ALIGNMENT, StoredNode,
    VERSION_INDEXED, align_up, encode_page_header,
};
use super::metadata::Metadata;
use super::page::PageId;
use super::page_table;
use super::paging::Sections;
use super::temporary::Temporary;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Pages whose table a footer has at most (112 KiB): the table of more lies before it, in index pages.
const MOST_IN_FOOTER: usize = 4096;
/// Pages of an index page (28 KiB).
const TOGETHER: u32 = 1024;

/// A node on its way into a page.
#[derive(Clone, Copy, Debug)]
pub struct PageNode<'a> {
    /// The node.
    pub node: &'a StoredNode,
    /// Its particles.
    pub sections: &'a Sections,
}

/// Bytes that a node takes in a page: its record, its positions, its codes.
pub fn node_bytes(positions: usize, codes: usize) -> usize {
    let align = |len: usize| len.next_multiple_of(SECTION_ALIGNMENT);
    NODE_RECORD_LEN + align(positions) + align(codes)
}

/// A page as bytes, without the zeros that align the next one; `None` if it would be longer than 4 GiB.
pub fn encode_page(id: PageId, family: u32, nodes: &[PageNode]) -> Option<Vec<u8>> {
    let bytes = |node: &PageNode| node_bytes(node.sections.positions.len(), node.sections.codes.len());
    let len = PAGE_HEADER_LEN + nodes.iter().map(bytes).sum::<usize>();
    let mut out = Vec::with_capacity(len);
    out.extend_from_slice(&encode_page_header(id, family, nodes.len() as u32, u32::try_from(len).ok()?));
    out.resize(PAGE_HEADER_LEN + nodes.len() * NODE_RECORD_LEN, 0);
    for (i, PageNode { node, sections }) in nodes.iter().enumerate() {
        let mut append = |section: &[u8]| {
            let at = out.len() as u32;
            out.extend_from_slice(section);
            out.resize(out.len().next_multiple_of(SECTION_ALIGNMENT), 0);
            at
        };
        let (positions, codes) = (append(&sections.positions), append(&sections.codes));
        let record = NodeRecord { node: (*node).clone(), positions, codes };
        let at = PAGE_HEADER_LEN + i * NODE_RECORD_LEN;
        out[at..at + NODE_RECORD_LEN].copy_from_slice(&record.encode());
    }
    Some(out)
}

/// A page file that is being written. Dropping it without [`PageFileWriter::complete`] leaves nothing behind.
#[derive(Debug)]
pub struct PageFileWriter {
    path: PathBuf,
    file: Temporary,
    end: u64,
    table: Vec<PageEntry>,
}

impl PageFileWriter {
    /// Starts a file that will appear at `path` when it is finished.
    pub fn create(path: &Path) -> Result<PageFileWriter, StoreError> {
        if path.file_name().is_none() {
            return Err(StoreError::Unwritable { path: path.to_path_buf(), reason: "it names no file".into() });
        }
        let file = Temporary::create(path, None).map_err(io(path, "create"))?;
        let mut writer = PageFileWriter { path: path.to_path_buf(), file, end: 0, table: Vec::new() };
        writer.put(&[0; ALIGNMENT as usize])?;
        Ok(writer)
    }

    /// Appends page number `self.page_count()`, encoded by [`encode_page`] with that number; its particles take `memory` bytes
    /// when they are decoded.
    pub fn append(&mut self, family: u32, nodes: u32, memory: u64, page: &[u8]) -> Result<PageId, StoreError> {
        let id = PageId(self.table.len() as u32);
        let len = u32::try_from(page.len()).map_err(|_| self.unwritable("a page would be longer than 4 GiB"))?;
        let memory =
            u32::try_from(memory).map_err(|_| self.unwritable("a page would take more than 4 GiB of memory"))?;
        self.table.push(PageEntry { offset: self.end, len, nodes, family, crc: crc32c::crc32c(page), memory });
        self.put(page)?;
        Ok(id)
    }

    /// An error that says why this file cannot be written.
    pub fn unwritable(&self, reason: &str) -> StoreError {
        StoreError::Unwritable { path: self.path.clone(), reason: reason.into() }
    }

    /// Number of pages so far.
    pub fn page_count(&self) -> u32 {
        self.table.len() as u32
    }

    /// Writes footer and header of a file of particles, and before them the table of many pages. Nothing has the file's name yet.
    pub fn complete(self, metadata: &Metadata) -> Result<CompletePageFile, StoreError> {
        let (version, about) = about(metadata, self.table.len());
        self.complete_as(MAGIC, version, &about)
    }

    /// Writes the header of a file that begins like this, and its footer: what tells of the page table, then these bytes.
    ///
    /// # Errors
    /// [`StoreError`] where the file cannot be written.
    pub fn complete_as(self, magic: [u8; 8], version: u32, about: &[u8]) -> Result<CompletePageFile, StoreError> {
        let (header, tail) = ends(magic, version, &self.table, self.end, about);
        let mut file = self.file.file();
        file.write_all(&tail).map_err(io(&self.path, "write"))?;
        std::io::Seek::rewind(&mut file).map_err(io(&self.path, "write"))?;
        file.write_all(&header.encode()).map_err(io(&self.path, "write"))?;
        Ok(CompletePageFile { path: self.path, file: self.file, bytes: header.file_len })
    }

    /// Appends bytes and zeros up to the next aligned place.
    fn put(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        let end = self.end + bytes.len() as u64;
        let aligned = align_up(end, ALIGNMENT).unwrap_or(end);
        let mut file = self.file.file();
        file.write_all(bytes).map_err(io(&self.path, "write"))?;
        file.write_all(&[0; ALIGNMENT as usize][..(aligned - end) as usize]).map_err(io(&self.path, "write"))?;
        self.end = aligned;
        Ok(())
    }
}

/// The header of a file whose pages, of which this is the table, end at an aligned place, and what lies from there on: the table, where the
/// footer does not hold it, and the footer, which goes on with `about`.
pub fn ends(magic: [u8; 8], version: u32, table: &[PageEntry], end: u64, about: &[u8]) -> (Header, Vec<u8>) {
    ends_of(magic, version, table, end, about, TOGETHER)
}

/// The same with index pages of `together` pages, where the table lies in such.
pub(super) fn ends_of(
    magic: [u8; 8],
    version: u32,
    table: &[PageEntry],
    end: u64,
    about: &[u8],
    together: u32,
) -> (Header, Vec<u8>) {
    let (mut footer, mut tail) = match magic == MAGIC && version == VERSION_INDEXED {
        true => page_table::encode(table, together),
        false => (table.iter().flat_map(PageEntry::encode).collect(), Vec::new()),
    };
    footer.extend_from_slice(about);
    tail.resize(tail.len().next_multiple_of(ALIGNMENT as usize), 0);
    let footer_offset = end + tail.len() as u64;
    let header = Header {
        magic,
        version,
        file_len: footer_offset + footer.len() as u64,
        footer_offset,
        footer_len: footer.len() as u64,
        footer_crc: crc32c::crc32c(&footer),
        pages: table.len() as u32,
    };
    tail.extend(footer);
    (header, tail)
}

/// The version of a file of so many pages with this metadata, and what follows in its footer what tells of the pages.
pub fn about(metadata: &Metadata, pages: usize) -> (u32, Vec<u8>) {
    let version = if pages > MOST_IN_FOOTER { VERSION_INDEXED } else { footer::version(metadata) };
    (version, footer::encode(metadata, version))
}

/// Whether these are such a version, and such bytes.
pub fn is_about(version: u32, bytes: &[u8], pages: usize) -> bool {
    footer::decode(bytes, version).is_ok_and(|metadata| about(&metadata, pages).0 == version)
}

/// A page file that is whole, but has no name yet. Dropping it leaves nothing behind.
#[derive(Debug)]
pub struct CompletePageFile {
    path: PathBuf,
    file: Temporary,
    bytes: u64,
}

impl CompletePageFile {
    /// Its length.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Its bytes.
    pub fn file(&self) -> &std::fs::File {
        self.file.file()
    }

    /// Waits until the disk has it, and moves it to its name. Returns its length.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn persist(self) -> Result<u64, StoreError> {
        self.file.file().sync_all().map_err(io(&self.path, "write"))?;
        self.persist_for_now()
    }

    /// Moves it to its name, whether the disk has it or not: a file that goes with the program.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn persist_for_now(self) -> Result<u64, StoreError> {
        self.file.persist(&self.path).map_err(io(&self.path, "rename the finished file to"))?;
        Ok(self.bytes)
    }
}

fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> StoreError + use<> {
    let path = path.to_path_buf();
    move |source| StoreError::Io { path, action, source }
}
