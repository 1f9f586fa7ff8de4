//! Lines of T at levels, as polylines: from triangle to triangle in bands of rows, several bands at a time, joined where bands meet.
//!
//! A sample at a level counts as above it. So an edge of T is crossed, once, where one of its samples is below and the other is not, and both
//! triangles of an edge agree on it; where the crossing is comes from the same operations for both.

use super::chains::{Band, Chain, Stitch, chains_of};
use crate::model::{HeightError, HeightGrid, Heights, Window};
use rayon::prelude::*;

/// A line of T.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Its height, in the unit of heights.
    pub level: f64,
    /// Its points in x and y, at least two, no two in a row equal; a closed line's last is its first.
    pub points: Vec<[f64; 2]>,
}

impl Contour {
    /// Whether it ends where it begins.
    pub fn is_closed(&self) -> bool {
        self.points.first() == self.points.last()
    }

    /// Its length in plan.
    pub fn length(&self) -> f64 {
        self.points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
    }
}

/// Why there are no lines.
#[derive(Debug, thiserror::Error)]
pub enum ContourError {
    /// The field.
    #[error(transparent)]
    Heights(#[from] HeightError),
    /// What takes the lines cannot.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// An interval that gives no levels, or too many.
    #[error(
        "--interval: found {interval} for heights from {low} to {high}, expected a number above 0 that gives at most {LARGEST} lines"
    )]
    Interval {
        /// The interval.
        interval: f64,
        /// The least height.
        low: f64,
        /// The largest height.
        high: f64,
    },
    /// A base that is no number.
    #[error("--base: found {base}, expected a finite number")]
    Base {
        /// The base.
        base: f64,
    },
}

/// At most so many levels.
const LARGEST: u64 = 1_000_000;

/// The levels `base + k interval` from the least to the largest height.
///
/// # Errors
/// Where there are more than a million, or these are no numbers.
pub fn levels([low, high]: [f64; 2], interval: f64, base: f64) -> Result<Vec<f64>, ContourError> {
    if !base.is_finite() {
        return Err(ContourError::Base { base });
    }
    let (first, last) = (((low - base) / interval).ceil(), ((high - base) / interval).floor());
    let count = last - first + 1.0;
    if !(interval > 0.0 && interval.is_finite()) || count > LARGEST as f64 || first.abs().max(last.abs()) > 9e15 {
        return Err(ContourError::Interval { interval, low, high });
    }
    // Of no heights there are no levels.
    let count = if count > 0.0 { count as u64 } else { 0 };
    Ok((0..count).map(|number| base + interval * (first + number as f64)).collect())
}

/// Samples of a band of rows, about.
const BAND: u64 = 1 << 17;
/// Samples that are read at once, at most, where rows are read together.
const READ: u64 = 1 << 24;

/// Gives all lines of T at levels, in an order that depends on the field alone. Lines that end are given and forgotten while the field is read;
/// those that go on from band to band are kept meanwhile.
///
/// # Errors
/// Where the field cannot be read, or `each` fails.
pub fn contours(
    heights: &dyn Heights,
    levels: &[f64],
    mut each: impl FnMut(Contour) -> std::io::Result<()>,
) -> Result<(), ContourError> {
    let mut levels: Vec<f64> = levels.iter().copied().filter(|level| level.is_finite()).collect();
    levels.sort_unstable_by(f64::total_cmp);
    levels.dedup();
    let grid = heights.grid();
    let cell_rows = grid.rows - 1;
    // Of many levels there may be many lines in a row.
    let height = (BAND / grid.columns / (1 + levels.len() as u64 / 16)).clamp(1, 1024);
    // Rows that are read together are read once, as far as there is room for them. Where bands begin depends on the field alone.
    let together = heights.rows_together().min(READ / grid.columns).max(1);
    let height = if height > together { height - height % together } else { height };
    let read = if together > height { together } else { 2 * height * rayon::current_num_threads() as u64 };
    let mut stitch = Stitch::default();
    let mut give = |chain: Chain| match line_of(chain, &levels) {
        Some(line) => each(line),
        None => Ok(()),
    };
    let mut values = Vec::new();
    let mut at = 0;
    while at < cell_rows {
        let end = ((at / read + 1) * read).min(cell_rows);
        values.resize(((end - at + 1) * grid.columns) as usize, 0.0);
        read_rows(heights, at, &mut values)?;
        let bands: Vec<(u64, Vec<Chain>)> = (at..end)
            .step_by(height as usize)
            .collect::<Vec<u64>>()
            .into_par_iter()
            .map(|first| {
                let rows = height.min(end - first);
                let own = ((first - at) * grid.columns) as usize;
                let heights = &values[own..own + ((rows + 1) * grid.columns) as usize];
                (first + rows, chains_of(&Band { grid, first, heights }, &levels))
            })
            .collect();
        for (bottom, chains) in bands {
            for chain in chains {
                if let Some(done) = stitch.add(chain) {
                    give(done)?;
                }
            }
            for done in stitch.close_above(bottom, grid.columns) {
                give(done)?;
            }
        }
        at = end;
    }
    Ok(())
}

/// Reads whole rows from one on; those of sources that know no rows together by as many threads as there are.
fn read_rows(heights: &dyn Heights, first: u64, out: &mut [f64]) -> Result<(), HeightError> {
    let grid = heights.grid();
    let columns = grid.columns as usize;
    let rows = out.len() / columns;
    let some = match heights.rows_together() {
        1 => rows.div_ceil(rayon::current_num_threads().max(1)),
        _ => rows,
    };
    out.par_chunks_mut(some * columns).enumerate().try_for_each(|(number, out)| {
        let rows = (out.len() / columns) as u64;
        heights.heights(Window::rows(grid, first + (number * some) as u64, rows), out)
    })
}

/// A chain as a line; `None` where it is a point: a summit exactly at the level.
fn line_of(chain: Chain, levels: &[f64]) -> Option<Contour> {
    let mut points: Vec<[f64; 2]> = chain.points.into();
    points.dedup();
    let level = *levels.get(chain.level as usize)?;
    (points.len() > 1).then_some(Contour { level, points })
}

/// Where a line at a level crosses the edge between two samples: numbers of the samples, the lower first, and their heights.
pub(super) fn crossing(grid: &HeightGrid, level: f64, [low, high]: [u64; 2], [from, to]: [f64; 2]) -> [f64; 2] {
    let at = |sample: u64| ((sample / grid.columns) as f64, (sample % grid.columns) as f64);
    let ((row, column), (last_row, last_column)) = (at(low), at(high));
    let part = (level - from) / (to - from);
    let (row, column) = (row + part * (last_row - row), column + part * (last_column - column));
    [grid.origin[0] + column * grid.step[0], grid.origin[1] + row * grid.step[1]]
}
