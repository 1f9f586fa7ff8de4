//! A field read once, in bands of whole rows, several at a time.

use crate::model::{HeightError, Heights, Window};
use rayon::prelude::*;

/// A band is about so many samples.
const BAND: u64 = 1 << 18;

/// A band is at least so many rows, so that what it shares with its neighbours costs little.
const LEAST_ROWS: u64 = 32;

/// Rows of a field in memory.
pub(crate) struct Band<'a> {
    /// The first row.
    pub first: u64,
    /// Rows that are this band's own; those behind them are the next band's first.
    pub own: usize,
    /// Samples of a row.
    pub columns: usize,
    /// Heights, row by row.
    pub heights: &'a [f64],
}

impl<'a> Band<'a> {
    /// The band's own rows, with their numbers in the field.
    pub fn rows(&self) -> impl Iterator<Item = (u64, &'a [f64])> {
        self.heights
            .chunks_exact(self.columns)
            .take(self.own)
            .enumerate()
            .map(|(number, row)| (self.first + number as u64, row))
    }

    /// Pairs of a row and the next where it was read: the rows of cells of which the first row is the band's own.
    pub fn pairs(&self) -> impl Iterator<Item = (u64, &'a [f64], &'a [f64])> {
        let next = self.heights.chunks_exact(self.columns).skip(1);
        self.rows().zip(next).map(|((number, row), next)| (number, row, next))
    }
}

/// Reads all rows in bands with `shared` rows of the next band behind each, and gives what `each` makes of them, in order. Where bands begin
/// depends on the field alone: what is added up in this order is the same for any number of threads.
///
/// # Errors
/// Where the field cannot be read.
pub(crate) fn map_bands<T: Send>(
    heights: &dyn Heights,
    shared: u64,
    each: impl Fn(&Band<'_>) -> T + Sync,
) -> Result<Vec<T>, HeightError> {
    let grid = heights.grid();
    let (rows, columns) = (grid.rows, grid.columns);
    let height = band_rows(columns);
    let bands: Vec<u64> = (0..rows).step_by(usize::try_from(height).unwrap_or(usize::MAX)).collect();
    let read = |values: &mut Vec<f64>, first: u64| {
        let own = height.min(rows - first);
        let read = (own + shared).min(rows - first);
        values.resize((read * columns) as usize, 0.0);
        heights.heights(Window::rows(grid, first, read), values)?;
        Ok(each(&Band { first, own: own as usize, columns: columns as usize, heights: values }))
    };
    bands.into_par_iter().map_init(Vec::new, read).collect()
}

/// How many rows a band has.
pub(crate) fn band_rows(columns: u64) -> u64 {
    (BAND / columns.max(1)).max(LEAST_ROWS)
}
