//! Heights that are read in windows, wherever they lie: in a source, in a page file, or in memory.

use super::HeightGrid;
use deepfield_data::import::ImportError;
use deepfield_data::store::StoreError;

/// A rectangle of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// The first row.
    pub row: u64,
    /// The first column.
    pub column: u64,
    /// How many rows; at least 1.
    pub rows: u64,
    /// How many columns; at least 1.
    pub columns: u64,
}

impl Window {
    /// All samples of a grid.
    pub fn all(grid: &HeightGrid) -> Window {
        Window { row: 0, column: 0, rows: grid.rows, columns: grid.columns }
    }

    /// Whole rows of a grid.
    pub fn rows(grid: &HeightGrid, row: u64, rows: u64) -> Window {
        Window { row, column: 0, rows, columns: grid.columns }
    }

    /// Number of samples.
    pub fn samples(&self) -> u64 {
        self.rows * self.columns
    }

    /// Whether it lies in a grid and is not empty.
    pub fn is_in(&self, grid: &HeightGrid) -> bool {
        let fits =
            |first: u64, count: u64, all: u64| count > 0 && first.checked_add(count).is_some_and(|end| end <= all);
        fits(self.row, self.rows, grid.rows) && fits(self.column, self.columns, grid.columns)
    }
}

/// Why heights cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum HeightError {
    /// The source.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// The page file.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Heights that are read in windows. Several threads may read at once.
pub trait Heights: Sync {
    /// Where the samples are, and what they mean.
    fn grid(&self) -> &HeightGrid;

    /// Reads the samples of a window into `out`, row by row, as they are stored (before [`HeightGrid::scale`]); NaN where nothing was
    /// measured. What is stored and is no finite number was not measured. `out` holds exactly as many.
    ///
    /// # Errors
    /// Where they cannot be read, or the window is not in the grid.
    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError>;

    /// Reads a colour plane's values of a window in the same way. `plane` is a number below that of [`HeightGrid::planes`].
    ///
    /// # Errors
    /// As [`Heights::stored`].
    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError>;

    /// How many rows, from a multiple of that number on, cost no more to read than one of them.
    fn rows_together(&self) -> u64 {
        1
    }

    /// The heights of a window, in [`HeightGrid::height_unit`]; NaN where nothing was measured.
    ///
    /// # Errors
    /// As [`Heights::stored`].
    fn heights(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.stored(window, out)?;
        let scale = self.grid().scale;
        out.iter_mut().for_each(|height| *height = scale.value(*height));
        Ok(())
    }
}

/// A field in memory.
#[derive(Clone, Debug)]
pub struct HeightField {
    /// Where the samples are.
    pub grid: HeightGrid,
    /// The samples as they are stored, row by row; NaN where nothing was measured.
    pub stored: Vec<f64>,
    /// Of each plane the values, row by row.
    pub planes: Vec<Vec<u8>>,
}

impl HeightField {
    /// A field of floats in steps of 1, for tests and synthetic data.
    pub fn of(columns: u64, rows: u64, heights: Vec<f64>) -> HeightField {
        let grid = HeightGrid::new(columns, rows, deepfield_data::model::SampleType::F64);
        HeightField { grid, stored: heights, planes: Vec::new() }
    }
}

/// The samples of a window among all rows of a grid.
fn gather<T: Copy>(all: &[T], columns: u64, window: Window, out: &mut [T]) {
    let width = window.columns as usize;
    for (number, row) in out.chunks_exact_mut(width).enumerate() {
        let first = ((window.row as usize + number) * columns as usize) + window.column as usize;
        row.copy_from_slice(&all[first..first + width]);
    }
}

impl Heights for HeightField {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        gather(&self.stored, self.grid.columns, window, out);
        Ok(())
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        gather(&self.planes[plane], self.grid.columns, window, out);
        Ok(())
    }
}
