//! Numbers of rows that were parsed once, for reading in any order: memory while they are few, else a temporary file without a name.
//! They stand in blocks of rows, and column by column in a block, so that reading one column leaves out the others.

use super::columns::{Column, Table};
use crate::import::ImportError;
use crate::import::grid::scratch::{Scratch, Storage};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Rows of a block, where they have few columns.
const ROWS: usize = 1 << 12;

/// Numbers of a block, where rows have many columns.
const NUMBERS: usize = 1 << 19;

/// Rows on their way to a [`Store`].
pub(super) struct StoreWriter {
    path: PathBuf,
    columns: Vec<Column>,
    /// The block that is being filled, one list for each number of a row.
    block: Vec<Vec<f64>>,
    /// Whether a number was seen, by number of a row.
    has_numbers: Vec<bool>,
    rows_per_block: usize,
    rows: u64,
    scratch: Scratch,
    bytes: Vec<u8>,
}

impl StoreWriter {
    /// For the rows of `path`.
    pub(super) fn new(path: &Path, columns: Vec<Column>) -> StoreWriter {
        let width = columns.iter().map(|column| column.components).sum();
        StoreWriter {
            path: path.into(),
            columns,
            block: vec![Vec::new(); width],
            has_numbers: vec![false; width],
            rows_per_block: (NUMBERS / width.max(1)).clamp(1, ROWS),
            rows: 0,
            scratch: Scratch::new(path),
            bytes: Vec::new(),
        }
    }

    /// Numbers of a row.
    pub(super) fn width(&self) -> usize {
        self.block.len()
    }

    /// How many rows there are so far.
    pub(super) fn rows(&self) -> u64 {
        self.rows
    }

    /// Adds a row; `numbers` are as many as its columns have.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(super) fn push(&mut self, numbers: &[f64]) -> Result<(), ImportError> {
        for ((list, has_numbers), number) in self.block.iter_mut().zip(&mut self.has_numbers).zip(numbers) {
            list.push(*number);
            *has_numbers |= number.is_finite();
        }
        self.rows += 1;
        if self.rows.is_multiple_of(self.rows_per_block as u64) {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), ImportError> {
        for list in &mut self.block {
            self.bytes.clear();
            self.bytes.extend(list.iter().flat_map(|number| number.to_ne_bytes()));
            self.scratch.write(&self.bytes)?;
            list.clear();
        }
        Ok(())
    }

    /// All rows, with the columns for which `keep` says so.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(super) fn finish(mut self, keep: impl Fn(usize) -> bool) -> Result<Store, ImportError> {
        self.flush()?;
        let (mut columns, mut firsts, mut is_blank, mut first) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for (index, column) in self.columns.into_iter().enumerate() {
            let next = first + column.components;
            if keep(index) {
                firsts.push(first);
                is_blank.push(!self.has_numbers[first..next].contains(&true));
                columns.push(column);
            }
            first = next;
        }
        let (path, width, rows_per_block) = (self.path, self.block.len(), self.rows_per_block as u64);
        let storage = self.scratch.into_storage()?;
        Ok(Store { path, columns, firsts, is_blank, width, rows_per_block, rows: self.rows, storage })
    }
}

/// Rows of numbers.
pub(super) struct Store {
    path: PathBuf,
    columns: Vec<Column>,
    /// Which number of a row is the first of a column.
    firsts: Vec<usize>,
    is_blank: Vec<bool>,
    width: usize,
    rows_per_block: u64,
    rows: u64,
    storage: Storage,
}

impl Table for Store {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.rows
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        const SIZE: u64 = size_of::<f64>() as u64;
        let components = self.columns[column].components;
        let mut bytes = Vec::new();
        let mut at = rows.start;
        while at < rows.end {
            let block = at / self.rows_per_block;
            let start = block * self.rows_per_block;
            let length = self.rows_per_block.min(self.rows - start);
            let end = rows.end.min(start + length);
            bytes.resize(((end - at) * SIZE) as usize, 0);
            let place = (at - rows.start) as usize;
            for component in 0..components {
                let list = start * self.width as u64 + (self.firsts[column] + component) as u64 * length;
                self.storage.read(&self.path, (list + at - start) * SIZE, &mut bytes)?;
                for (row, number) in bytes.as_chunks().0.iter().enumerate() {
                    if let Some(value) = out.get_mut((place + row) * components + component) {
                        *value = f64::from_ne_bytes(*number);
                    }
                }
            }
            at = end;
        }
        Ok(())
    }

    fn is_blank(&self, column: usize) -> bool {
        self.is_blank[column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_range_of_every_column_comes_back() {
        let columns =
            vec![Column::new("a"), Column { components: 3, ..Column::new("b") }, Column::new("text"), Column::new("c")];
        let mut writer = StoreWriter::new(Path::new("rows"), columns);
        let rows = 2 * ROWS + 17;
        let value = |row: usize, number: usize| (row * 6 + number) as f64;
        for row in 0..rows {
            writer
                .push(&[value(row, 0), value(row, 1), value(row, 2), value(row, 3), f64::NAN, value(row, 5)])
                .unwrap();
        }
        let store = writer.finish(|column| column != 2).unwrap();
        assert_eq!((store.rows(), store.columns().len()), (rows as u64, 3));
        for (column, first, components) in [(0, 0, 1), (1, 1, 3), (2, 5, 1)] {
            assert!(!store.is_blank(column));
            for range in [0..rows, 5..6, ROWS - 1..ROWS + 1, ROWS..2 * ROWS, 2 * ROWS + 3..rows] {
                let mut out = vec![0.0; range.len() * components];
                store.read(column, range.start as u64..range.end as u64, &mut out).unwrap();
                let expected = range.flat_map(|row| (first..first + components).map(move |number| value(row, number)));
                assert!(out.into_iter().eq(expected), "column {column}");
            }
        }
    }
}
