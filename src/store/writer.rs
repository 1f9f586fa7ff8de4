//! Writing a page file: under a temporary name in the target's folder, renamed when everything is on the disk.

use super::error::StoreError;
use super::footer;
use super::layout::{
    ALIGNMENT, Header, NODE_RECORD_LEN, NodeRecord, PAGE_HEADER_LEN, PageEntry, SECTION_ALIGNMENT, align_up,
    encode_page_header,
};
use super::metadata::Metadata;
use super::page::{Node, PageId, Positions};
use crate::codec::VqBits;
use std::io::Write;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A node on its way into a page.
#[derive(Clone, Copy, Debug)]
pub struct PageNode<'a> {
    /// The node; its `particles` is the length of the two columns.
    pub node: &'a Node,
    /// Its packed positions, of the kind that its encoding wants.
    pub positions: Positions<'a>,
    /// Its codes.
    pub codes: &'a [u16],
}

/// Bytes that a node takes in a page: its record, its positions, its codes.
pub fn node_bytes(encoding: super::Encoding, particles: usize, vq_bits: VqBits) -> usize {
    let width = if encoding == super::Encoding::Leaf { 8 } else { 4 };
    let align = |len: usize| len.next_multiple_of(SECTION_ALIGNMENT);
    NODE_RECORD_LEN + align(particles * width) + align(vq_bits.packed_len(particles).unwrap_or(0))
}

/// A page as bytes, without the zeros that align the next one; `None` if it would be longer than 4 GiB.
pub fn encode_page(id: PageId, family: u32, nodes: &[PageNode], vq_bits: VqBits) -> Option<Vec<u8>> {
    let len = PAGE_HEADER_LEN
        + nodes.iter().map(|node| node_bytes(node.node.encoding, node.codes.len(), vq_bits)).sum::<usize>();
    let mut out = Vec::with_capacity(len);
    out.extend_from_slice(&encode_page_header(id, family, nodes.len() as u32, u32::try_from(len).ok()?));
    out.resize(PAGE_HEADER_LEN + nodes.len() * NODE_RECORD_LEN, 0);
    for (i, PageNode { node, positions, codes }) in nodes.iter().enumerate() {
        let positions_at = out.len() as u32;
        match positions {
            Positions::Grid(words) => out.extend(words.iter().flat_map(|word| word.to_le_bytes())),
            Positions::Leaf(words) => out.extend(words.iter().flat_map(|word| word.to_le_bytes())),
        }
        out.resize(out.len().next_multiple_of(SECTION_ALIGNMENT), 0);
        let codes_at = out.len() as u32;
        vq_bits.pack(codes, &mut out);
        out.resize(out.len().next_multiple_of(SECTION_ALIGNMENT), 0);
        let record = NodeRecord { node: (*node).clone(), positions: positions_at, codes: codes_at };
        let at = PAGE_HEADER_LEN + i * NODE_RECORD_LEN;
        out[at..at + NODE_RECORD_LEN].copy_from_slice(&record.encode());
    }
    Some(out)
}

/// A page file that is being written. Dropping it without [`PageFileWriter::finish`] leaves nothing behind.
#[derive(Debug)]
pub struct PageFileWriter {
    path: PathBuf,
    file: NamedTempFile,
    end: u64,
    table: Vec<PageEntry>,
}

impl PageFileWriter {
    /// Starts a file that will appear at `path` when it is finished.
    pub fn create(path: &Path) -> Result<PageFileWriter, StoreError> {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let Some(name) = path.file_name() else {
            return Err(StoreError::Unwritable { path: path.to_path_buf(), reason: "it names no file".into() });
        };
        let mut prefix = name.to_os_string();
        prefix.push(".tmp");
        let file =
            tempfile::Builder::new().prefix(&prefix).suffix("").tempfile_in(folder).map_err(io(path, "create"))?;
        let mut writer = PageFileWriter { path: path.to_path_buf(), file, end: 0, table: Vec::new() };
        writer.put(&[0; ALIGNMENT as usize])?;
        Ok(writer)
    }

    /// Appends page number `self.page_count()`, encoded by [`encode_page`] with that number.
    pub fn append(&mut self, family: u32, nodes: u32, page: &[u8]) -> Result<PageId, StoreError> {
        let id = PageId(self.table.len() as u32);
        let len = u32::try_from(page.len()).map_err(|_| self.unwritable("a page would be longer than 4 GiB"))?;
        self.table.push(PageEntry { offset: self.end, len, nodes, family, crc: crc32c::crc32c(page) });
        self.put(page)?;
        Ok(id)
    }

    /// An error that says why this file cannot be written.
    pub(super) fn unwritable(&self, reason: &str) -> StoreError {
        StoreError::Unwritable { path: self.path.clone(), reason: reason.into() }
    }

    /// Number of pages so far.
    pub fn page_count(&self) -> u32 {
        self.table.len() as u32
    }

    /// Writes footer and header, waits until the disk has them, and moves the file to its name. Returns its length.
    pub fn finish(mut self, metadata: &Metadata) -> Result<u64, StoreError> {
        let footer = footer::encode(metadata, &self.table);
        let header = Header {
            file_len: self.end + footer.len() as u64,
            footer_offset: self.end,
            footer_len: footer.len() as u64,
            footer_crc: crc32c::crc32c(&footer),
            pages: self.table.len() as u32,
        };
        let path = self.path.clone();
        let file = self.file.as_file_mut();
        file.write_all(&footer).map_err(io(&path, "write"))?;
        std::io::Seek::rewind(file).map_err(io(&path, "write"))?;
        file.write_all(&header.encode()).map_err(io(&path, "write"))?;
        file.sync_all().map_err(io(&path, "write"))?;
        self.file.persist(&path).map_err(|error| error.error).map_err(io(&path, "rename the finished file to"))?;
        Ok(header.file_len)
    }

    /// Appends bytes and zeros up to the next aligned place.
    fn put(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        let end = self.end + bytes.len() as u64;
        let aligned = align_up(end, ALIGNMENT).unwrap_or(end);
        let file = self.file.as_file_mut();
        file.write_all(bytes).map_err(io(&self.path, "write"))?;
        file.write_all(&[0; ALIGNMENT as usize][..(aligned - end) as usize]).map_err(io(&self.path, "write"))?;
        self.end = aligned;
        Ok(())
    }
}

fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> StoreError + use<> {
    let path = path.to_path_buf();
    move |source| StoreError::Io { path, action, source }
}
