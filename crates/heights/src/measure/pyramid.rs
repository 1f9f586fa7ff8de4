//! A field in memory with least and largest heights of blocks of 4 x 4 cells and up, as the ray caster reads it.

use super::bands::{Band, map_bands};
use super::ray::MinMax;
use crate::model::{Cell, HeightError, HeightGrid, Heights};
use deepfield_data::model::SampleType;
use rayon::prelude::*;
use std::convert::Infallible;

/// The finest level of which ranges are kept: a third of a number a sample.
const FINEST: u32 = 2;

/// A range of nothing.
pub(super) const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Samples as they are stored, at least as exact as the source has them.
enum Stored {
    Single(Vec<f32>),
    Double(Vec<f64>),
}

/// Ranges of the blocks of one level, row by row.
pub(super) struct Level {
    pub(super) columns: usize,
    pub(super) ranges: Vec<[f64; 2]>,
}

/// A field in memory: 4 or 8 bytes a sample, and 1.4 for the ranges.
pub struct Pyramid {
    grid: HeightGrid,
    stored: Stored,
    finest: u32,
    levels: Vec<Level>,
}

impl Pyramid {
    /// Reads all of a field.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn read(heights: &dyn Heights) -> Result<Pyramid, HeightError> {
        let grid = heights.grid().clone();
        let is_single = is_single(grid.sample_type);
        // Bands give heights, which are kept as they are where they are not scaled; else what is stored is kept, to be scaled again.
        let raw = AsStored { heights, grid: HeightGrid { scale: deepfield_data::model::Scale::NONE, ..grid.clone() } };
        let single = |band: &Band<'_>| {
            band.rows().flat_map(|(_, row)| row.iter().map(|height| *height as f32)).collect::<Vec<f32>>()
        };
        let double = |band: &Band<'_>| band.rows().flat_map(|(_, row)| row.iter().copied()).collect::<Vec<f64>>();
        let stored = if is_single {
            Stored::Single(map_bands(&raw, 0, single)?.concat())
        } else {
            Stored::Double(map_bands(&raw, 0, double)?.concat())
        };
        let cells = [grid.columns - 1, grid.rows - 1];
        let top = top_of(cells);
        let finest = FINEST.min(top);
        let mut pyramid = Pyramid { grid, stored, finest, levels: Vec::new() };
        let first = pyramid.first_level();
        pyramid.levels.push(first);
        for level in finest..top {
            let next = coarser(&pyramid.levels[(level - finest) as usize]);
            pyramid.levels.push(next);
        }
        Ok(pyramid)
    }

    /// Bytes that reading all of a field takes: parts of it are put together, so that twice its samples are held for a while.
    pub fn memory(grid: &HeightGrid) -> u64 {
        let size = if is_single(grid.sample_type) { 4 } else { 8 };
        grid.columns.saturating_mul(grid.rows).saturating_mul(2 * size)
    }

    /// The least and the largest height of T's samples; `None` without any triangle.
    pub fn heights(&self) -> Option<[f64; 2]> {
        self.levels.last().and_then(|level| level.ranges.first()).copied().filter(|[low, high]| low <= high)
    }

    fn value(&self, index: usize) -> f64 {
        let stored = match &self.stored {
            Stored::Single(samples) => f64::from(samples[index]),
            Stored::Double(samples) => samples[index],
        };
        self.grid.scale.value(stored)
    }

    fn cell_at(&self, row: usize, column: usize) -> Cell {
        let columns = self.grid.columns as usize;
        let first = row * columns + column;
        Cell([first, first + 1, first + columns, first + columns + 1].map(|index| self.value(index)))
    }

    fn first_level(&self) -> Level {
        let size = 1_usize << self.finest;
        let (rows, columns) = ((self.grid.rows - 1) as usize, (self.grid.columns - 1) as usize);
        let across = columns.div_ceil(size);
        let mut ranges = vec![NOTHING; across * rows.div_ceil(size)];
        ranges.par_chunks_mut(across).enumerate().for_each(|(block_row, ranges)| {
            for row in block_row * size..((block_row + 1) * size).min(rows) {
                for column in 0..columns {
                    let cell = self.cell_at(row, column);
                    if cell.measured() >= 3 {
                        let range = &mut ranges[column / size];
                        for height in cell.0.iter().filter(|height| !height.is_nan()) {
                            *range = [range[0].min(*height), range[1].max(*height)];
                        }
                    }
                }
            }
        });
        Level { columns: across, ranges }
    }
}

/// Whether singles hold samples of a type as they are stored.
fn is_single(sample_type: SampleType) -> bool {
    matches!(sample_type, SampleType::I8 | SampleType::U8 | SampleType::I16 | SampleType::U16 | SampleType::F32)
}

/// The least level of which one block holds all cells.
pub(super) fn top_of([columns, rows]: [u64; 2]) -> u32 {
    columns.max(rows).next_power_of_two().trailing_zeros()
}

/// The level above.
pub(super) fn coarser(level: &Level) -> Level {
    let rows = level.ranges.len() / level.columns;
    let columns = level.columns.div_ceil(2);
    let mut ranges = vec![NOTHING; columns * rows.div_ceil(2)];
    for (row, line) in level.ranges.chunks_exact(level.columns).enumerate() {
        for (column, [low, high]) in line.iter().enumerate() {
            let range = &mut ranges[row / 2 * columns + column / 2];
            *range = [range[0].min(*low), range[1].max(*high)];
        }
    }
    Level { columns, ranges }
}

/// A field whose heights are its stored samples.
struct AsStored<'a> {
    heights: &'a dyn Heights,
    grid: HeightGrid,
}

impl Heights for AsStored<'_> {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: crate::model::Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.heights.stored(window, out)
    }

    fn plane(&self, plane: usize, window: crate::model::Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.heights.plane(plane, window, out)
    }
}

impl MinMax for &Pyramid {
    type Error = Infallible;

    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn top(&self) -> u32 {
        self.finest + self.levels.len() as u32 - 1
    }

    fn finest(&self) -> u32 {
        self.finest
    }

    fn range(&mut self, level: u32, row: u64, column: u64) -> Result<Option<[f64; 2]>, Infallible> {
        let level = &self.levels[(level - self.finest) as usize];
        let [low, high] = level.ranges[row as usize * level.columns + column as usize];
        Ok((low <= high).then_some([low, high]))
    }

    fn cell(&mut self, row: u64, column: u64) -> Result<Cell, Infallible> {
        Ok(self.cell_at(row as usize, column as usize))
    }
}
