//! Apache Parquet (<https://parquet.apache.org/docs/file-format/>): tables column by column, in one file or many. Footers are read when a table is
//! opened; of the rows nothing but the pages of the columns that are asked for, whenever they are.

mod compact;
mod file;
mod hats;
mod pages;
mod passed;
mod units;
mod unpacked;
mod values;

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, Table, left_out_note, shown};
use super::masked::{masked_by, unmasked, without_masks};
use super::sky;
use crate::import::guarded::guarded;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use file::{Contents, ENCRYPTED, Group, MAGIC};
pub(in crate::import) use hats::{Hats, catalogue_in, is_partitioned};
use pages::{Chunk, Reading};
use rayon::prelude::*;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use values::StoredColumn;

/// Parquet files.
pub(in crate::import) struct Parquet;

/// Files whose footers are held at a time.
const BATCH: usize = 64;

impl Format for Parquet {
    fn name(&self) -> &'static str {
        "Parquet table"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["parquet", "parq", "pq"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        head.starts_with(MAGIC) || head.starts_with(ENCRYPTED)
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open(path, method)?)?))
    }
}

/// Opens a table.
///
/// # Errors
/// When the file cannot be read, or is damaged.
pub(super) fn open(path: &Path, _: ReadMethod) -> Result<Opened, ImportError> {
    together(&[path.to_owned()])
}

/// The columns of numbers of a table, without masks.
///
/// # Errors
/// As [`open`].
pub(super) fn columns(path: &Path) -> Result<Vec<Column>, ImportError> {
    let Contents { columns, has_masks, .. } = Contents::read(path)?;
    Ok(if has_masks { without_masks(&columns) } else { columns })
}

/// Opens the rows of all files, one file after the other. What is no column of numbers in some file is left out, but for masks: files in
/// which nothing is hidden have none.
///
/// # Errors
/// As [`open`], and where a file lacks a column that positions need, or has another unit.
pub(super) fn together(files: &[PathBuf]) -> Result<Opened, ImportError> {
    let mut columns: Vec<Column> = Vec::new();
    let mut left_out: Vec<String> = Vec::new();
    let mut table = Rows { columns: Vec::new(), files: Vec::new(), groups: Vec::new(), rows: 0 };
    let (mut bytes, mut is_kept, mut has_masks) = (0_u64, Vec::new(), false);
    for (batch, paths) in files.chunks(BATCH).enumerate() {
        let read: Vec<Result<Contents, ImportError>> = paths.par_iter().map(|path| Contents::read(path)).collect();
        for (number, (path, contents)) in paths.iter().zip(read).enumerate() {
            let contents = contents?;
            if batch + number == 0 {
                columns.clone_from(&contents.columns);
                left_out.clone_from(&contents.left_out);
                is_kept = vec![true; columns.len()];
            }
            if contents.has_masks {
                has_masks = true;
                let is_known = |own: &Column| columns.iter().any(|column| column.name == own.name);
                let is_new = |own: &&Column| masked_by(own, &columns).is_some() && !is_known(own);
                let masks: Vec<Column> = contents.columns.iter().filter(is_new).cloned().collect();
                is_kept.resize(is_kept.len() + masks.len(), true);
                columns.extend(masks);
                table.widen(columns.len());
            }
            let places = places(path, &columns, &contents.columns)?;
            is_kept.iter_mut().zip(&places).for_each(|(is_kept, place)| *is_kept &= place.is_some());
            bytes = bytes.saturating_add(contents.length);
            table.push(path, contents, &places);
        }
    }
    if has_masks {
        for (mask, column) in (0..columns.len()).filter_map(|at| Some((at, masked_by(&columns[at], &columns)?))) {
            is_kept[mask] = is_kept[column];
        }
    }
    let dropped = columns.iter().zip(&is_kept).filter(|(_, is_kept)| !**is_kept);
    left_out.extend(dropped.map(|(column, _)| column.name.clone()));
    table.keep(&columns, &is_kept);
    let notes = left_out_note(&left_out).into_iter().collect();
    let table: Box<dyn Table> = Box::new(table);
    let table = if has_masks { unmasked(table) } else { table };
    Ok(Opened { table, format: "parquet", bytes, notes })
}

/// Where the columns of the first file are among those of another.
fn places(file: &Path, columns: &[Column], own: &[Column]) -> Result<Vec<Option<usize>>, ImportError> {
    let place_of = |column: &Column| {
        let place = own.iter().position(|other| other.name == column.name);
        match place.map(|place| &own[place]) {
            Some(other) if other != column => {
                let of = |column: &Column| format!("{} [{}]", shown(&column.name), shown(&column.unit));
                let expected = format!("{}, as in the first file", of(column));
                Err(ImportError::Unlike { path: file.into(), found: of(other), expected })
            }
            None if sky::is_needed(column) => {
                let expected = "numbers in this column, as in the first file";
                Err(ImportError::missing(file, shown(&column.name), expected))
            }
            _ => Ok(place),
        }
    };
    columns.iter().map(place_of).collect()
}

/// The rows of some files, read in place.
struct Rows {
    columns: Vec<Column>,
    files: Vec<PartFile>,
    /// In the order of the rows.
    groups: Vec<Placed>,
    rows: u64,
}

/// A file of a table.
struct PartFile {
    path: PathBuf,
    /// What is in it, where it is compressed as a whole.
    unpacked: Option<Mutex<File>>,
    length: u64,
    /// The table's columns as the file stores them.
    stored: Vec<Option<StoredColumn>>,
}

/// A group of rows of a file.
struct Placed {
    file: usize,
    /// The first row, of all in the table.
    first: u64,
    rows: u64,
    /// Where each of the table's columns is.
    chunks: Vec<Option<Chunk>>,
}

impl Rows {
    /// Adds a file; `places` are where the table's columns are in it.
    fn push(&mut self, path: &Path, contents: Contents, places: &[Option<usize>]) {
        let Contents { length, unpacked, stored, groups, .. } = contents;
        let own = |place: &Option<usize>| place.and_then(|place| stored.get(place).cloned());
        let mut stored: Vec<Option<StoredColumn>> = places.iter().map(own).collect();
        // Descriptions that are the same in every file are held once.
        if let Some(first) = self.files.first() {
            for (own, first) in stored.iter_mut().zip(&first.stored) {
                if let (Some(own), Some(first)) = (own, first)
                    && own.about == first.about
                {
                    own.clone_from(first);
                }
            }
        }
        for Group { rows, chunks } in groups {
            let of = |place: &Option<usize>| place.and_then(|place| chunks.get(place).copied());
            let chunks = places.iter().map(of).collect();
            self.groups.push(Placed { file: self.files.len(), first: self.rows, rows, chunks });
            self.rows += rows;
        }
        self.files.push(PartFile { path: path.into(), unpacked: unpacked.map(Mutex::new), length, stored });
    }

    /// Makes room for `columns` in all; those that are new are in no file so far.
    fn widen(&mut self, columns: usize) {
        self.files.iter_mut().for_each(|file| file.stored.resize(columns, None));
        self.groups.iter_mut().for_each(|group| group.chunks.resize(columns, None));
    }

    /// Leaves out columns that are not kept.
    fn keep(&mut self, columns: &[Column], is_kept: &[bool]) {
        self.columns = kept(columns, is_kept);
        for file in &mut self.files {
            file.stored = kept(&file.stored, is_kept);
        }
        for group in &mut self.groups {
            group.chunks = kept(&group.chunks, is_kept);
        }
    }

    /// Calls `read` with each group's part of the rows `rows`, and where it begins among them.
    fn each(
        &self,
        column: usize,
        rows: Range<u64>,
        mut read: impl FnMut(Reading, Range<u64>, Range<usize>) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        let first = self.groups.partition_point(|group| group.first + group.rows <= rows.start);
        for group in self.groups[first..].iter().take_while(|group| group.first < rows.end) {
            let own = rows.start.max(group.first) - group.first..rows.end.min(group.first + group.rows) - group.first;
            let start = (group.first + own.start - rows.start) as usize;
            let part = start..start + (own.end - own.start) as usize;
            let PartFile { path, unpacked, length, stored } = &self.files[group.file];
            // Every file has the columns that are kept, but for masks.
            let (Some(chunk), Some(stored)) = (group.chunks[column], &stored[column]) else { continue };
            let (unpacked, length) = (unpacked.as_ref(), *length);
            read(Reading { path, unpacked, length, column: stored, chunk, rows: group.rows }, own, part)?;
        }
        Ok(())
    }
}

/// Those of a list that are kept.
fn kept<T: Clone>(all: &[T], is_kept: &[bool]) -> Vec<T> {
    all.iter().zip(is_kept).filter(|(_, is_kept)| **is_kept).map(|(one, _)| one.clone()).collect()
}

impl Table for Rows {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.rows
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        // What a mask says of the rows of a file without it.
        out.fill(0.0);
        let width = self.columns[column].components;
        self.each(column, rows, |reading, rows, part| {
            let own = out.get_mut(part.start * width..part.end * width).unwrap_or_default();
            reading.read(rows, own, StoredColumn::numbers)
        })
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        if !self.files.iter().all(|file| file.stored[column].as_ref().is_some_and(StoredColumn::is_whole)) {
            return Ok(false);
        }
        self.each(column, rows, |reading, rows, part| {
            reading.read(rows, out.get_mut(part).unwrap_or_default(), StoredColumn::whole_numbers)
        })?;
        Ok(true)
    }
}

/// Runs `work` of the library; its errors and its panics become one error for `field`.
fn guard<T>(
    path: &Path,
    field: String,
    expected: &str,
    work: impl FnOnce() -> parquet::errors::Result<T>,
) -> Result<T, ImportError> {
    /// The longest message that is passed on.
    const LONGEST: usize = 200;
    let found = match guarded(work) {
        Some(Ok(value)) => return Ok(value),
        Some(Err(error)) => {
            error.to_string().chars().map(|c| if c.is_control() { ' ' } else { c }).take(LONGEST).collect()
        }
        None => "damage that the Parquet reader gave up on".to_owned(),
    };
    Err(ImportError::malformed(path, field, found, expected))
}
