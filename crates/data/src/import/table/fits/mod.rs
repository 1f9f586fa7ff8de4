//! Binary tables of FITS files (<https://fits.gsfc.nasa.gov/fits_standard.html>, section 7.3): the first one with columns that positions
//! can be made of. Rows are read in place, those of a compressed file from a temporary one.

mod column;
mod header;
mod rows;

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, left_out_note};
use super::{sky, text};
use crate::import::bytes::RangeFile;
use crate::import::grid::scratch::{Scratch, Storage};
use crate::import::packed::Packing;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use column::StoredColumn;
use header::{BLOCK, Header};
use rows::FitsRows;
use std::io::{BufRead, Read};
use std::path::Path;

/// Tables of FITS files.
pub(in crate::import) struct FitsTable;

/// The most parts of a file that are looked at.
const MOST_PARTS: usize = 1000;

/// Bytes that are copied at a time.
const BUFFER: usize = 1 << 18;

/// Whether a file that begins so is a FITS file.
fn is_fits(head: &[u8]) -> bool {
    head.starts_with(b"SIMPLE  =")
}

impl Format for FitsTable {
    fn name(&self) -> &'static str {
        "FITS table"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["fits", "fit"]
    }

    /// A file with a table has no array in its first part, as a rule; what has one is an image, and is told before.
    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let content = text::content(head);
        let mut cards = content.chunks_exact(80).take(36);
        let axes = cards.find_map(|card| card.strip_prefix(b"NAXIS   =")).unwrap_or_default();
        is_fits(&content) && axes.trim_ascii_start().starts_with(b"0")
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open(path, method)?)?))
    }
}

/// Opens the table.
///
/// # Errors
/// When the file cannot be read or is damaged, or has no table that positions can be made of.
pub(super) fn open(path: &Path, method: ReadMethod) -> Result<Opened, ImportError> {
    let (table, mut walk) = find(path, method)?;
    let Found { columns, left_out, stride, rows, start } = table;
    let bytes = walk.length;
    // Not above 2^63: `find` has compared the two.
    let size = stride as u64 * rows;
    let (storage, start) = match &mut walk.packed {
        None => (Storage::File(RangeFile::open(path, method)?), start),
        Some(packed) => (unpacked(path, packed, size)?, 0),
    };
    let rows = FitsRows::new(path, columns, storage, start, stride, rows);
    let notes = left_out_note(&left_out).into_iter().collect();
    Ok(Opened { table: Box::new(rows), format: "fits", bytes, notes })
}

/// The columns of numbers of the table.
///
/// # Errors
/// As [`open`].
pub(super) fn columns(path: &Path) -> Result<Vec<Column>, ImportError> {
    let (table, _) = find(path, ReadMethod::Positioned)?;
    Ok(table.columns.into_iter().map(|column| column.column).collect())
}

/// Where in a file the table is.
struct Found {
    columns: Vec<StoredColumn>,
    /// Names of the columns that hold no numbers.
    left_out: Vec<String>,
    /// Bytes of a row.
    stride: usize,
    rows: u64,
    /// The byte of the first row.
    start: u64,
}

/// Looks for the first table that positions can be made of. A compressed file has been read up to its first row then.
fn find(path: &Path, method: ReadMethod) -> Result<(Found, Walk), ImportError> {
    let mut walk = Walk::open(path, method)?;
    let mut other_tables = 0;
    for part in 0..MOST_PARTS {
        let Some(header) = Header::read(path, part, &mut |block| walk.block(block))? else { break };
        let bytes = header.data_bytes()?;
        if header.text("XTENSION") == Some("BINTABLE") && header.text("ZIMAGE") != Some("T") {
            let (stride, rows) = header.row_bytes_and_rows()?;
            let (columns, left_out) = StoredColumn::all(&header, stride)?;
            let names: Vec<Column> = columns.iter().map(|column| column.column.clone()).collect();
            if sky::has_positions(&names) {
                let most = walk.most().saturating_sub(walk.at);
                if (stride as u64).checked_mul(rows).is_none_or(|size| size > most) {
                    let found = format!("{rows} rows of {stride} bytes");
                    let expected = format!("no more than the {most} bytes that follow");
                    return Err(header.wrong("NAXIS2", found, expected));
                }
                let start = walk.at;
                return Ok((Found { columns, left_out, stride, rows, start }, walk));
            }
            other_tables += 1;
        }
        walk.skip(bytes)?;
    }
    Err(match other_tables {
        0 => ImportError::missing(path, "positions", "a binary table"),
        count => sky::missing_in(path, count),
    })
}

/// A file from its beginning to its end.
struct Walk {
    file: RangeFile,
    /// What comes out of a compressed file.
    packed: Option<Box<dyn BufRead>>,
    /// Bytes of the file.
    length: u64,
    /// The next byte of what is in it.
    at: u64,
}

impl Walk {
    fn open(path: &Path, method: ReadMethod) -> Result<Walk, ImportError> {
        let file = RangeFile::open(path, method)?;
        let mut head = [0; 4];
        let length = file.length;
        let is_packed = length >= 4 && {
            file.read(0, &mut head, "header")?;
            Packing::of(&head).is_some()
        };
        let packed = if is_packed { Some(text::open(path)?.0) } else { None };
        Ok(Walk { file, packed, length, at: 0 })
    }

    /// The most bytes that can be in the file.
    fn most(&self) -> u64 {
        if self.packed.is_some() { self.length.saturating_mul(text::MOST_EXPANSION) } else { self.length }
    }

    /// Reads the next block of a header; false at the end of the file.
    fn block(&mut self, block: &mut [u8; BLOCK]) -> Result<bool, ImportError> {
        let Walk { file, packed, length, at } = self;
        match packed {
            None if *at >= *length => return Ok(false),
            None => file.read(*at, block, "header")?,
            Some(packed) => {
                let io = |error| ImportError::io(&file.path, "header", error);
                if packed.fill_buf().map_err(io)?.is_empty() {
                    return Ok(false);
                }
                packed.read_exact(block).map_err(io)?;
            }
        }
        *at += BLOCK as u64;
        Ok(true)
    }

    /// Goes on behind so many bytes, or to the end of the file.
    fn skip(&mut self, bytes: u64) -> Result<(), ImportError> {
        if let Some(packed) = &mut self.packed {
            let skipped = std::io::copy(&mut packed.take(bytes), &mut std::io::sink());
            skipped.map_err(|error| ImportError::io(&self.file.path, "data", error))?;
        }
        self.at = self.at.saturating_add(bytes);
        Ok(())
    }
}

/// The rows of a compressed file, `size` bytes.
fn unpacked(path: &Path, packed: &mut dyn BufRead, size: u64) -> Result<Storage, ImportError> {
    let mut scratch = Scratch::new(path);
    let mut buffer = vec![0; BUFFER];
    let mut left = size;
    while left > 0 {
        let most = BUFFER.min(usize::try_from(left).unwrap_or(BUFFER));
        let read = packed.read(&mut buffer[..most]);
        match read.map_err(|error| ImportError::io(path, "rows", error))? {
            0 => {
                let found = format!("{} bytes", size - left);
                return Err(ImportError::malformed(path, "rows", found, size.to_string()));
            }
            read => {
                scratch.write(&buffer[..read])?;
                left -= read as u64;
            }
        }
    }
    scratch.into_storage()
}
