//! Columns of which others say in what rows they hold nothing, as astropy writes masked ones: `NAME.mask` beside `NAME`, where the values of
//! masked rows are whatever was there before.

use super::columns::{Column, Table};
use crate::import::ImportError;
use std::ops::Range;

/// What the name of a mask ends in.
const ENDING: &str = ".mask";

/// Whether a line of a header in YAML, as astropy writes it, says that a column is a mask.
pub(super) fn names_mask(line: &str) -> bool {
    line.contains("mask: !astropy.table.SerializedColumn")
}

/// Which of all columns has a mask in this one, where it may be a mask at all: of rows, or of each number of a row.
pub(super) fn masked_by(mask: &Column, all: &[Column]) -> Option<usize> {
    let name = mask.name.strip_suffix(ENDING)?;
    all.iter().position(|column| column.name == name && [1, column.components].contains(&mask.components))
}

/// The columns that are no masks of others.
pub(super) fn without_masks(all: &[Column]) -> Vec<Column> {
    all.iter().filter(|column| masked_by(column, all).is_none()).cloned().collect()
}

/// The table without its masks: what these hide is missing.
pub(super) fn unmasked(table: Box<dyn Table>) -> Box<dyn Table> {
    let all = table.columns();
    let masked: Vec<Option<usize>> = all.iter().map(|column| masked_by(column, all)).collect();
    let own = (0..all.len()).filter(|at| masked[*at].is_none());
    let places: Vec<(usize, Option<usize>)> =
        own.map(|at| (at, masked.iter().position(|column| *column == Some(at)))).collect();
    let columns = places.iter().map(|(at, _)| all[*at].clone()).collect();
    Box::new(Unmasked { table, columns, places })
}

struct Unmasked {
    table: Box<dyn Table>,
    columns: Vec<Column>,
    /// Which column of the table each of them is, and which is its mask.
    places: Vec<(usize, Option<usize>)>,
}

impl Unmasked {
    /// Puts `none` into what is hidden; `out` holds so many values of each row.
    fn hide<V: Copy>(
        &self,
        mask: Option<usize>,
        rows: Range<u64>,
        out: &mut [V],
        components: usize,
        none: V,
    ) -> Result<(), ImportError> {
        let Some(mask) = mask else { return Ok(()) };
        let own = self.table.columns()[mask].components;
        let mut hidden = vec![0.0; (rows.end - rows.start) as usize * own];
        self.table.read(mask, rows, &mut hidden)?;
        // What a mask does not say is not hidden.
        let parts = out.chunks_mut((components / own).max(1)).zip(hidden).filter(|(_, hidden)| *hidden == 1.0);
        parts.for_each(|(part, _)| part.fill(none));
        Ok(())
    }
}

impl Table for Unmasked {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.table.rows()
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let (place, mask) = self.places[column];
        self.table.read(place, rows.clone(), out)?;
        self.hide(mask, rows, out, self.columns[column].components, f64::NAN)
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        let (place, mask) = self.places[column];
        let is_whole = self.table.read_whole(place, rows.clone(), out)?;
        self.hide(mask, rows, out, 1, None)?;
        Ok(is_whole)
    }

    fn lacks_ids(&self, column: usize) -> bool {
        let (place, mask) = self.places[column];
        mask.is_some() || self.table.lacks_ids(place)
    }

    fn is_blank(&self, column: usize) -> bool {
        self.table.is_blank(self.places[column].0)
    }

    fn at_hand_until(&self, row: u64) -> Option<u64> {
        self.table.at_hand_until(row)
    }
}
