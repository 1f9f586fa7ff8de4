//! The pages of a column of a row group: where they are, and numbers out of them. Their headers are read here first, so that nothing that
//! they say makes the library ask for more memory than the rows can take.

use super::compact::{DATA, DATA_2, DICTIONARY, PageHeader, page_header};
use super::guard;
use super::passed::Passed;
use super::unpacked::{Packing, Sizes, Unpacked};
use super::values::StoredColumn;
use crate::import::ImportError;
use crate::import::bytes::RangeFile;
use crate::import::table::columns::shown;
use crate::model::ReadMethod;
use parquet::basic::Compression;
use parquet::column::page::PageReader;
use parquet::column::reader::{ColumnReader, get_column_reader};
use parquet::errors::Result as Decoded;
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::page_index::offset_index::PageLocation;
use parquet::file::serialized_reader::SerializedPageReader;
use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of headers as a rule, and the most.
const HEADER: u64 = 256;
const LONGEST_HEADER: u64 = 1 << 16;

/// The largest page, unpacked.
const MOST_PAGE: u64 = 1 << 29;

/// The most values of a dictionary: once they are decoded they take up to 32 bytes each, whatever the file has of them.
const MOST_ENTRIES: u64 = 1 << 24;

/// Bytes that a page may have beside its values, for their levels and what codes are told by.
const BESIDE: u64 = 1 << 16;

/// A column of a row group: bytes of a file, which has them all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chunk {
    /// The first byte.
    pub start: u64,
    /// How many bytes.
    pub length: u64,
    /// How many values it has, those that are missing among them.
    pub values: u64,
    /// How pages are packed.
    pub packing: Compression,
}

/// A column of a row group that is being read.
pub(super) struct Reading<'a> {
    /// The file.
    pub path: &'a Path,
    /// What is in it, where it is compressed as a whole. The library moves the one position that all who read such a file share.
    pub unpacked: Option<&'a Mutex<File>>,
    /// Its length when it was opened, bytes.
    pub length: u64,
    /// The column.
    pub column: &'a StoredColumn,
    /// Its bytes.
    pub chunk: Chunk,
    /// Rows of the group.
    pub rows: u64,
}

impl Reading<'_> {
    /// Decodes the rows `rows` of the group into `out`, which holds as many values, by `decode`: it is told the rows to leave out before, and
    /// gives how many it found.
    ///
    /// # Errors
    /// When the file cannot be read there, is damaged, or has other rows.
    pub(super) fn read<V>(
        &self,
        rows: Range<u64>,
        out: &mut [V],
        decode: impl FnOnce(&StoredColumn, ColumnReader, usize, &mut [V]) -> Decoded<usize>,
    ) -> Result<(), ImportError> {
        let io = |source| ImportError::io(self.path, "file", source);
        let unpacked = self.unpacked.map(|file| file.lock().unwrap_or_else(PoisonError::into_inner));
        let file = match &unpacked {
            Some(unpacked) => unpacked.try_clone(),
            None => File::open(self.path),
        };
        let file = file.map_err(io)?;
        let headers = RangeFile::of(self.path, file.try_clone().map_err(io)?, ReadMethod::Positioned)?;
        if headers.length != self.length {
            let expected = format!("{}, as when it was opened", self.length);
            return Err(ImportError::malformed(self.path, "length", headers.length, expected));
        }
        let Pages { pages, sizes, rows: known, length, passed, first } = self.pages(&headers, &rows)?;
        let packing = Packing::of(self.chunk.packing);
        let (expected, about) = (out.len(), &self.column.about);
        let found = guard(self.path, self.field(), "pages of numbers", || {
            let chunk = ColumnChunkMetaData::builder(about.clone())
                .set_data_page_offset(self.chunk.start as i64)
                .set_total_compressed_size(length as i64)
                .set_compression(packing.map_or(self.chunk.packing, |_| Compression::UNCOMPRESSED))
                .build()?;
            let pages = SerializedPageReader::new(Arc::new(file), &chunk, known as usize, pages)?;
            let pages: Box<dyn PageReader> = match packing {
                Some(packing) => Box::new(Unpacked::new(Passed::new(pages, passed), packing, sizes)),
                None if passed > 0 => Box::new(Passed::new(pages, passed)),
                None => Box::new(pages),
            };
            decode(self.column, get_column_reader(about.clone(), pages), (rows.start - first) as usize, out)
        })?;
        if found != expected {
            let (found, expected) = (format!("{found} values"), expected.to_string());
            return Err(ImportError::malformed(self.path, self.field(), found, expected));
        }
        Ok(())
    }

    /// The column in messages.
    fn field(&self) -> String {
        format!("pages of {}", shown(self.column.about.name()))
    }

    /// Pages of data up to the one that has the last of the rows `rows`. Which rows pages of lists have, their headers do not say; where none is
    /// missing, it follows from how many values are before.
    fn pages(&self, file: &RangeFile, rows: &Range<u64>) -> Result<Pages, ImportError> {
        let wrong = |found: String, expected: &str| ImportError::malformed(self.path, self.field(), found, expected);
        let Chunk { start, length, .. } = self.chunk;
        let end = start + length;
        let components = self.column.components() as u64;
        let [all, from, until] = [self.rows, rows.start, rows.end].map(|rows| rows.saturating_mul(components));
        let (mut at, mut value, mut pages, mut sizes) = (start, 0, Vec::new(), Sizes::default());
        while value < until {
            if at >= end && self.column.is_of_lists() {
                break;
            }
            if at >= end {
                return Err(wrong(format!("{value} rows"), &self.rows.to_string()));
            }
            let Some(header) = header_at(file, at, end)? else {
                return Err(wrong(format!("damage at byte {at}"), "the header of a page"));
            };
            let [plain, stored, values] =
                [header.plain, header.stored, header.values].map(|number| u64::try_from(number).unwrap_or(u64::MAX));
            let left = (end - at).saturating_sub(header.bytes);
            if stored > left {
                return Err(wrong(format!("a page of {} bytes", header.stored), &format!("at most {left}")));
            }
            let size = values.saturating_mul(self.column.width);
            let (is_data, most) = match header.kind {
                DATA | DATA_2 => (true, size.saturating_mul(2).saturating_add(BESIDE).min(MOST_PAGE)),
                DICTIONARY if at == start => (false, MOST_PAGE),
                kind => {
                    return Err(wrong(format!("a page of kind {kind}"), "pages of data behind one of a dictionary"));
                }
            };
            // Packing adds little where it saves nothing.
            if plain > most || stored > plain.saturating_add(plain / 8).saturating_add(BESIDE) {
                let found = format!("a page of {stored} bytes, {plain} unpacked, for {values} values");
                return Err(wrong(found, &format!("at most {most} unpacked")));
            }
            let next = at + header.bytes + stored;
            if is_data {
                if values > all - value {
                    return Err(wrong(format!("more than {value} and {values} values"), &all.to_string()));
                }
                // Below 2^31: what a page has unpacked is, and what it has packed is little more.
                let compressed_page_size = (next - at) as i32;
                pages.push(PageLocation { offset: at as i64, compressed_page_size, first_row_index: value as i64 });
                sizes.data.push_back(plain);
                value += values;
            } else if size > plain || values > MOST_ENTRIES {
                return Err(wrong(format!("a dictionary of {values} values in {plain} bytes"), "fewer values"));
            } else {
                sizes.dictionary = plain;
            }
            at = next;
        }
        if !self.column.is_of_lists() {
            return Ok(Pages { pages: Some(pages), sizes, rows: value, length, passed: 0, first: 0 });
        }
        let first_value = |page: &PageLocation| page.first_row_index as u64;
        let before = pages.partition_point(|page| first_value(page) <= from).saturating_sub(1);
        let passed = if self.chunk.values == all { before } else { 0 };
        sizes.data.drain(..passed);
        // A row that goes on in the first page counts as one there.
        let first = pages.get(passed).map_or(0, first_value) / components;
        // What follows has not been looked at.
        Ok(Pages { pages: None, sizes, rows: self.rows, length: at - start, passed, first })
    }
}

/// Pages that are to be read.
struct Pages {
    /// Where those of data are; `None`: one after the other.
    pages: Option<Vec<PageLocation>>,
    /// How large they are unpacked.
    sizes: Sizes,
    /// The row behind them, or at most so many.
    rows: u64,
    /// Bytes that the library is to know of.
    length: u64,
    /// How many of data are to be passed over, and the row that the first of the others begins with, or in.
    passed: usize,
    first: u64,
}

/// The header of the page at byte `at`, before byte `end`.
fn header_at(file: &RangeFile, at: u64, end: u64) -> Result<Option<PageHeader>, ImportError> {
    let mut bytes = Vec::new();
    for most in [HEADER, LONGEST_HEADER] {
        bytes.resize(most.min(end - at) as usize, 0);
        file.read(at, &mut bytes, "header of a page")?;
        let header = page_header(&bytes);
        if header.is_some() {
            return Ok(header);
        }
    }
    Ok(None)
}
