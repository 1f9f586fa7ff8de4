//! The rows of a binary table, read in place.

use super::column::StoredColumn;
use crate::import::ImportError;
use crate::import::grid::scratch::Storage;
use crate::import::table::columns::{Column, Table};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Bytes that are read at once where rows are short.
const BUFFER: usize = 1 << 20;

/// Rows that are longer are not read whole: one read for each fetches what is asked for.
const LONG: usize = 1 << 12;

/// The rows of a table.
pub(super) struct FitsRows {
    path: PathBuf,
    columns: Vec<Column>,
    stored: Vec<StoredColumn>,
    storage: Storage,
    /// The byte of the first row.
    start: u64,
    /// Bytes of a row.
    stride: usize,
    rows: u64,
}

impl FitsRows {
    /// So many rows, from byte `start` of the storage on, which has them all.
    pub(super) fn new(
        path: &Path,
        stored: Vec<StoredColumn>,
        storage: Storage,
        start: u64,
        stride: usize,
        rows: u64,
    ) -> FitsRows {
        let columns = stored.iter().map(|column| column.column.clone()).collect();
        FitsRows { path: path.into(), columns, stored, storage, start, stride, rows }
    }

    /// Calls `take` with the bytes of a column of each row and the row's number in the range.
    fn each(
        &self,
        column: &StoredColumn,
        rows: Range<u64>,
        mut take: impl FnMut(usize, &[u8]),
    ) -> Result<(), ImportError> {
        let bytes = column.stored.size() * column.column.components;
        let at = |row: u64| self.start + row * self.stride as u64;
        let mut buffer = Vec::new();
        if self.stride > LONG {
            buffer.resize(bytes, 0);
            for row in rows.clone() {
                self.storage.read(&self.path, at(row) + column.at as u64, &mut buffer)?;
                take((row - rows.start) as usize, &buffer);
            }
            return Ok(());
        }
        let stride = self.stride.max(1);
        let step = (BUFFER / stride).max(1);
        for first in rows.clone().step_by(step) {
            let count = (rows.end - first).min(step as u64) as usize;
            buffer.resize(count * stride, 0);
            self.storage.read(&self.path, at(first), &mut buffer)?;
            for (index, row) in buffer.chunks_exact(stride).enumerate() {
                // The column lies in the row: that was compared when the header was read.
                take((first - rows.start) as usize + index, row.get(column.at..column.at + bytes).unwrap_or_default());
            }
        }
        Ok(())
    }
}

impl Table for FitsRows {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.rows
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let column = &self.stored[column];
        let components = column.column.components;
        self.each(column, rows, |row, bytes| {
            let numbers = bytes.chunks_exact(column.stored.size());
            let places = out.get_mut(row * components..(row + 1) * components).unwrap_or_default();
            places.iter_mut().zip(numbers).for_each(|(value, bytes)| *value = column.value(bytes));
        })
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        let column = &self.stored[column];
        if !column.is_plain() || column.column.components != 1 {
            return Ok(false);
        }
        self.each(column, rows, |row, bytes| {
            if let Some(place) = out.get_mut(row) {
                *place = column.whole(bytes).and_then(|whole| u64::try_from(whole).ok());
            }
        })?;
        Ok(true)
    }
}
