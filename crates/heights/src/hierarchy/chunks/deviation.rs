//! How far the coarse surfaces are from T over a leaf: exact, from T's samples.
//!
//! Both surfaces are flat between the corners of T's cells, but for the diagonals of cells that are no squares ([`super`]) and where a corner is
//! missing; so the largest vertical distance is at T's samples, and where T's edges cross such diagonals.

use crate::model::{Cell, Triangle};
use deepfield_data::lanes::in_lanes;

/// The least and the largest of T minus a surface; the least is above the largest where there is nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The least.
    pub low: f64,
    /// The largest.
    pub high: f64,
}

impl Range {
    /// Of nothing.
    pub const NONE: Range = Range { low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// Takes in a number, unless it is none.
    #[inline]
    pub fn add(&mut self, value: f64) {
        self.low = if value < self.low { value } else { self.low };
        self.high = if value > self.high { value } else { self.high };
    }

    /// Takes in another range.
    #[inline]
    pub fn join(&mut self, other: Range) {
        self.low = if other.low < self.low { other.low } else { self.low };
        self.high = if other.high > self.high { other.high } else { self.high };
    }

    /// The largest distance from 0.
    pub fn most(&self) -> f64 {
        self.high.max(-self.low).max(0.0)
    }
}

/// A leaf's own samples, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Fine<'a> {
    /// Heights as they are stored.
    pub stored: &'a [f64],
    /// Rows and columns.
    pub size: [usize; 2],
}

impl Fine<'_> {
    fn row(&self, row: usize) -> &[f64] {
        &self.stored[row * self.size[1]..][..self.size[1]]
    }

    fn cell(&self, row: usize, column: usize) -> Cell {
        let (upper, lower) = (self.row(row), self.row(row + 1));
        Cell([upper[column], upper[column + 1], lower[column], lower[column + 1]])
    }
}

/// Distances that are compared side by side.
const LANES: usize = 8;

/// T minus the surface of a level over a leaf. `coarse` are the level's samples in the leaf, row by row.
pub fn range(fine: Fine<'_>, level: u32, coarse: &[f64]) -> Range {
    in_lanes!(range_in_vectors(fine, level, coarse))
}

#[inline(always)]
fn range_in_vectors(fine: Fine<'_>, level: u32, coarse: &[f64]) -> Range {
    let is_whole = fine.stored.iter().fold(true, |is_whole, height| is_whole & !height.is_nan());
    let cells = fine.size.map(|count| (count - 1).div_ceil(1 << level));
    let [height, width] = fine.size.map(|count| count - 1);
    let stride = cells[1] + 1;
    let steps: Vec<f64> = (0..=1_usize << level).map(|step| step as f64).collect();
    // A power of two divides as exactly as its inverse multiplies, and not as quickly.
    let (full, inverse) = (1_usize << level, 1.0 / (1_u64 << level) as f64);
    let mut range = Range::NONE;
    let mut surface = vec![f64::NAN; width + 1];
    for cell_row in 0..cells[0] {
        let top = cell_row << level;
        let tall = (height - top).min(1 << level);
        let wide = |column: usize| (width - (column << level)).min(1 << level);
        let mut is_broken = false;
        for column in 0..cells[1] {
            let (cell, size) = (corners(coarse, stride, [cell_row, column]), [tall, wide(column)]);
            if cell.measured() < 4 {
                is_broken = true;
                broken(fine, [top, column << level], size, cell, &mut range);
            } else if tall != size[1] {
                along(fine, [top, column << level], size, ([0, 0], cell.0[0]), (size, cell.0[3]), &mut range);
            } else if !is_whole {
                middles(fine, [top, column << level], tall, (cell.0[0], cell.0[3]), &mut range);
            }
        }
        let is_last = cell_row + 1 == cells[0];
        for down in 0..tall + usize::from(is_last || is_broken) {
            if is_broken {
                surface.fill(f64::NAN);
            }
            let share = down as f64 / tall as f64;
            for column in 0..cells[1] {
                let cell = corners(coarse, stride, [cell_row, column]);
                if !is_broken || cell.measured() == 4 {
                    let wide = wide(column);
                    let bend = if wide == tall { down } else { (down * wide).div_ceil(tall) };
                    let per_step = |rise: f64| if wide == full { rise * inverse } else { rise / wide as f64 };
                    fill(&mut surface[column << level..][..=wide], cell, (share, bend), per_step, &steps);
                }
            }
            let samples = fine.row(top + down);
            let (mut low, mut high) = ([range.low; LANES], [range.high; LANES]);
            let (samples, sample_rest) = samples.as_chunks::<LANES>();
            let (surfaces, surface_rest) = surface.as_chunks::<LANES>();
            for (samples, surfaces) in samples.iter().zip(surfaces) {
                for lane in 0..LANES {
                    let distance = samples[lane] - surfaces[lane];
                    low[lane] = if distance < low[lane] { distance } else { low[lane] };
                    high[lane] = if distance > high[lane] { distance } else { high[lane] };
                }
            }
            low.into_iter().zip(high).for_each(|(low, high)| range.join(Range { low, high }));
            sample_rest.iter().zip(surface_rest).for_each(|(sample, surface)| range.add(sample - surface));
        }
    }
    range
}

/// The corners of a cell of a surface that has so many samples in a row.
#[inline(always)]
fn corners(coarse: &[f64], stride: usize, [row, column]: [usize; 2]) -> Cell {
    let at = row * stride + column;
    Cell([coarse[at], coarse[at + 1], coarse[at + stride], coarse[at + stride + 1]])
}

/// Heights of a row across a cell of four corners, at a share of the way from its top; `bend` is the first one of the upper right triangle.
#[inline(always)]
fn fill(
    out: &mut [f64],
    Cell([a, b, d, e]): Cell,
    (share, bend): (f64, usize),
    per_step: impl Fn(f64) -> f64,
    steps: &[f64],
) {
    // The lower left triangle, then the upper right one.
    let (left, along_left) = (a + (d - a) * share, per_step(e - d));
    let (right, along_right) = (a + (e - b) * share, per_step(b - a));
    let (lower, upper) = out.split_at_mut(bend);
    lower.iter_mut().zip(steps).for_each(|(out, step)| *out = left + along_left * step);
    upper.iter_mut().zip(&steps[bend..]).for_each(|(out, step)| *out = right + along_right * step);
}

/// A cell without all of its corners: every measured sample counts, by the triangle that it is in, else by the nearest corner.
fn broken(fine: Fine<'_>, [top, left]: [usize; 2], [tall, wide]: [usize; 2], cell: Cell, range: &mut Range) {
    if cell.measured() == 0 {
        return;
    }
    for down in 0..=tall {
        let samples = &fine.row(top + down)[left..=left + wide];
        for (across, sample) in samples.iter().enumerate().filter(|(_, sample)| !sample.is_nan()) {
            let (u, v) = (across as f64 / wide as f64, down as f64 / tall as f64);
            let mut surface = cell.height(u, v);
            if surface.is_nan() {
                let far = |corner: usize| (u - (corner % 2) as f64).abs().max((v - (corner / 2) as f64).abs());
                let there = (0..4).filter(|corner| !cell.0[*corner].is_nan());
                surface = there
                    .min_by(|one, other| far(*one).total_cmp(&far(*other)))
                    .map_or(f64::NAN, |corner| cell.0[corner]);
            }
            range.add(sample - surface);
        }
    }
    let [a, b, d, e] = cell.0;
    along(fine, [top, left], [tall, wide], ([0, 0], a), ([tall, wide], e), range);
    along(fine, [top, left], [tall, wide], ([0, wide], b), ([tall, 0], d), range);
}

/// Looks along the diagonal of a square: T's other diagonals cross it in the middle of cells, where these lack a corner on it.
fn middles(fine: Fine<'_>, [top, left]: [usize; 2], size: usize, (first, last): (f64, f64), range: &mut Range) {
    for step in 0..size {
        let Cell([a, b, d, e]) = fine.cell(top + step, left + step);
        if a.is_nan() != e.is_nan() {
            let share = (step as f64 + 0.5) / size as f64;
            range.add((b + d) / 2.0 - (first + (last - first) * share));
        }
    }
}

/// Looks along an edge of a surface, between two corners of a cell, wherever edges of T may cross it; `from` and `to` are a corner's row and
/// column and its height.
fn along(
    fine: Fine<'_>,
    [top, left]: [usize; 2],
    [tall, wide]: [usize; 2],
    from: ([usize; 2], f64),
    to: ([usize; 2], f64),
    range: &mut Range,
) {
    let ([from_row, from_column], first) = from;
    let ([to_row, to_column], last) = to;
    let (rows, columns) = (to_row as f64 - from_row as f64, to_column as f64 - from_column as f64);
    let mut look = |share: f64| {
        let (down, across) = (from_row as f64 + rows * share, from_column as f64 + columns * share);
        let surface = first + (last - first) * share;
        // Cells on both sides of an edge have the same height on it, but one of them may have no surface.
        let sides = |place: f64, end: usize| {
            let at = place.floor() as usize;
            [at.checked_sub(1).filter(|_| place == place.floor()), Some(at).filter(|at| *at < end)]
                .into_iter()
                .flatten()
        };
        for row in sides(down, tall) {
            for column in sides(across, wide) {
                let (u, v) = (across - column as f64, down - row as f64);
                for Triangle { at: [p, q, s], edge: [k, m, n], .. } in fine.cell(top + row, left + column).triangles() {
                    // The place is on an edge, up to rounding.
                    if k + m * u + n * v >= -1e-9 {
                        range.add(p + q * u + s * v - surface);
                    }
                }
            }
        }
    };
    // Rows, columns, and diagonals of both kinds.
    for lines in [rows, columns, rows - columns, rows + columns] {
        let lines = lines.abs() as usize;
        (1..lines).for_each(|line| look(line as f64 / lines as f64));
    }
}
