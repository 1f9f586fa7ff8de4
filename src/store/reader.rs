//! Opening a page file and reading its pages.

use super::error::StoreError;
use super::footer;
use super::layout::{ALIGNMENT, HEADER_LEN, Header, HeaderError, PAGE_HEADER_LEN, PageEntry, VERSION};
use super::metadata::Metadata;
use super::page::{Page, PageId};
use std::fs::File;
use std::path::{Path, PathBuf};

/// An open page file. Cheap to share in an `Arc`: reads are positioned and take no lock. It holds the footer (24 bytes
/// for each page of about 3 MB, attribute tables and codebooks), never pages.
#[derive(Debug)]
pub struct PageFile {
    path: PathBuf,
    file: File,
    header: Header,
    metadata: Metadata,
    table: Vec<PageEntry>,
}

impl PageFile {
    /// Opens the file and checks header, footer and page table. Pages are checked as they are read.
    pub fn open(path: &Path) -> Result<PageFile, StoreError> {
        let io = |action| move |source| StoreError::Io { path: path.to_path_buf(), action, source };
        let file = File::open(path).map_err(io("open"))?;
        let about = file.metadata().map_err(io("look at"))?;
        if !about.is_file() {
            return Err(StoreError::NotAPageFile { path: path.to_path_buf(), expected: "a regular file" });
        }
        let real_len = about.len();
        let mut head = [0; HEADER_LEN];
        let head_len = (HEADER_LEN as u64).min(real_len) as usize;
        read_exact_at(&file, &mut head[..head_len], 0).map_err(io("read the header"))?;
        let header = Header::decode(&head[..head_len], real_len).map_err(|error| match error {
            HeaderError::NotAPageFile(expected) => StoreError::NotAPageFile { path: path.to_path_buf(), expected },
            HeaderError::Version(found) => StoreError::Version { path: path.to_path_buf(), found, supported: VERSION },
            HeaderError::Damaged(damage) => damage.in_file(path),
        })?;
        let damaged = |place: &str, expected: &str| StoreError::Damaged {
            path: path.to_path_buf(),
            place: place.into(),
            expected: expected.into(),
        };
        let mut bytes =
            vec![0; usize::try_from(header.footer_len).map_err(|_| damaged("header", "a footer that fits in memory"))?];
        read_exact_at(&file, &mut bytes, header.footer_offset).map_err(io("read the footer"))?;
        if crc32c::crc32c(&bytes) != header.footer_crc {
            return Err(damaged("footer", "its checksum"));
        }
        let (metadata, table) = footer::decode(&bytes, header.pages).map_err(|damage| damage.in_file(path))?;
        let page_file = PageFile { path: path.to_path_buf(), file, header, metadata, table };
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

    /// Reads a page: checks its checksum, its structure, every code and every child reference.
    pub fn read_page(&self, page: PageId) -> Result<Page, StoreError> {
        let damaged = |expected: &str| StoreError::Damaged {
            path: self.path.clone(),
            place: format!("page {}", page.0),
            expected: expected.into(),
        };
        let entry = self.table.get(page.0 as usize).ok_or_else(|| damaged("to exist"))?;
        // The length was checked against the file when it was opened.
        let mut words = vec![0_u64; entry.len as usize / 8];
        read_exact_at(&self.file, bytemuck::cast_slice_mut(&mut words), entry.offset)
            .map_err(|source| StoreError::Io { path: self.path.clone(), action: "read a page", source })?;
        if crc32c::crc32c(bytemuck::cast_slice(&words)) != entry.crc {
            return Err(damaged("its checksum"));
        }
        Page::parse(page, words, &self.metadata, &self.table).map_err(|damage| damage.in_file(&self.path))
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
            let root = self.table.get(family.root_page.0 as usize);
            if root.is_none_or(|entry| entry.family as usize != i) {
                return Err(("footer".into(), "a root page of the same family for each family"));
            }
        }
        Ok(())
    }

    /// Bytes `[start, end)` of the file, for the verifier's look at the padding.
    pub(super) fn raw(&self, start: u64, end: u64) -> Result<Vec<u8>, StoreError> {
        let mut bytes = vec![0; end.saturating_sub(start) as usize];
        read_exact_at(&self.file, &mut bytes, start).map_err(|source| StoreError::Io {
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

/// Fills `buffer` from `offset` without moving a shared cursor.
#[cfg(unix)]
fn read_exact_at(file: &File, buffer: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset)
}

/// Fills `buffer` from `offset`; every read names its place, so the cursor that Windows moves does not matter.
#[cfg(windows)]
fn read_exact_at(file: &File, mut buffer: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    while !buffer.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, buffer, offset)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            read => {
                buffer = &mut buffer[read..];
                offset += read as u64;
            }
        }
    }
    Ok(())
}
