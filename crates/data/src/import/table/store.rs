//! Numbers of rows that were parsed once, for reading in any order: memory while they are few, else a temporary file without a name.
//! They stand in blocks of rows, and column by column in a block, so that reading one column leaves out the others. Behind the numbers of ids
//! stands what these lack.

use super::columns::{Column, Table};
use super::ids;
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
    /// Whether a number was seen, and whether one was missing, by number of a row.
    has_numbers: Vec<bool>,
    has_gaps: Vec<bool>,
    rows_per_block: usize,
    rows: u64,
    scratch: Scratch,
    bytes: Vec<u8>,
}

impl StoreWriter {
    /// For the rows of `path`.
    pub(super) fn new(path: &Path, columns: Vec<Column>) -> StoreWriter {
        let width = columns.iter().map(Column::width).sum();
        StoreWriter {
            path: path.into(),
            columns,
            block: vec![Vec::new(); width],
            has_numbers: vec![false; width],
            has_gaps: vec![false; width],
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

    /// Adds a row; `numbers` are as many as its columns have by [`Column::width`].
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(super) fn push(&mut self, numbers: &[f64]) -> Result<(), ImportError> {
        let seen = self.has_numbers.iter_mut().zip(&mut self.has_gaps);
        for ((list, (has_numbers, has_gaps)), number) in self.block.iter_mut().zip(seen).zip(numbers) {
            list.push(*number);
            *has_numbers |= number.is_finite();
            *has_gaps |= !number.is_finite();
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
        let (mut columns, mut firsts, mut first) = (Vec::new(), Vec::new(), 0);
        let (mut is_blank, mut lacks_ids) = (Vec::new(), Vec::new());
        for (index, column) in self.columns.into_iter().enumerate() {
            let next = first + column.width();
            if keep(index) {
                firsts.push(first);
                is_blank.push(!self.has_numbers[first..next].contains(&true));
                lacks_ids.push(self.has_gaps[first..next].contains(&true));
                columns.push(column);
            }
            first = next;
        }
        let (path, width, rows_per_block) = (self.path, self.block.len(), self.rows_per_block as u64);
        let storage = self.scratch.into_storage()?;
        Ok(Store { path, columns, firsts, is_blank, lacks_ids, width, rows_per_block, rows: self.rows, storage })
    }
}

/// Rows of numbers.
pub(super) struct Store {
    path: PathBuf,
    columns: Vec<Column>,
    /// Which number of a row is the first of a column.
    firsts: Vec<usize>,
    is_blank: Vec<bool>,
    /// Whether a number of a column is missing in some row, or what an id lacks is.
    lacks_ids: Vec<bool>,
    width: usize,
    rows_per_block: u64,
    rows: u64,
    storage: Storage,
}

impl Store {
    /// Calls `take` with each row's place among `rows`, and number `number` of that row.
    fn each(&self, number: usize, rows: Range<u64>, mut take: impl FnMut(usize, f64)) -> Result<(), ImportError> {
        const SIZE: u64 = size_of::<f64>() as u64;
        let mut bytes = Vec::new();
        let mut at = rows.start;
        while at < rows.end {
            let start = at / self.rows_per_block * self.rows_per_block;
            let length = self.rows_per_block.min(self.rows - start);
            let end = rows.end.min(start + length);
            bytes.resize(((end - at) * SIZE) as usize, 0);
            let list = start * self.width as u64 + number as u64 * length;
            self.storage.read(&self.path, (list + at - start) * SIZE, &mut bytes)?;
            for (row, number) in bytes.as_chunks().0.iter().enumerate() {
                take((at - rows.start) as usize + row, f64::from_ne_bytes(*number));
            }
            at = end;
        }
        Ok(())
    }
}

impl Table for Store {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.rows
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let components = self.columns[column].components;
        for component in 0..components {
            self.each(self.firsts[column] + component, rows.clone(), |row, number| {
                if let Some(value) = out.get_mut(row * components + component) {
                    *value = number;
                }
            })?;
        }
        Ok(())
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        if !self.columns[column].is_id() {
            return Ok(false);
        }
        let mut numbers = vec![f64::NAN; out.len()];
        self.read(column, rows.clone(), &mut numbers)?;
        self.each(self.firsts[column] + 1, rows, |row, rest| {
            if let (Some(id), Some(number)) = (out.get_mut(row), numbers.get(row)) {
                *id = ids::joined(*number, rest);
            }
        })?;
        Ok(true)
    }

    fn is_blank(&self, column: usize) -> bool {
        self.is_blank[column]
    }

    fn lacks_ids(&self, column: usize) -> bool {
        self.lacks_ids[column]
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
