//! How far the coarse surfaces are from T over a leaf: exact, from T's samples.
//!
//! Both surfaces are flat between the corners of T's cells, but for the diagonals of cells that are no squares ([`super`]) and where a corner is
//! missing; so the largest vertical distance is at T's samples, and where T's edges cross those diagonals.

use crate::model::Cell;

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
    pub fn join(&mut self, other: Range) {
        self.add(other.low);
        self.add(other.high);
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

/// T minus the surface of a level over a leaf. `coarse` are the level's samples in the leaf, row by row.
pub fn range(fine: Fine<'_>, level: u32, coarse: &[f64]) -> Range {
    let cells = fine.size.map(|count| (count - 1).div_ceil(1 << level));
    let [height, width] = fine.size.map(|count| count - 1);
    let stride = cells[1] + 1;
    let steps: Vec<f64> = (0..=1_usize << level).map(|step| step as f64).collect();
    let mut range = Range::NONE;
    let mut surface = vec![f64::NAN; width + 1];
    for cell_row in 0..cells[0] {
        let top = cell_row << level;
        let tall = (height - top).min(1 << level);
        let corners = |column: usize| {
            let at = cell_row * stride + column;
            Cell([coarse[at], coarse[at + 1], coarse[at + stride], coarse[at + stride + 1]])
        };
        let wide = |column: usize| (width - (column << level)).min(1 << level);
        let mut is_broken = false;
        for column in 0..cells[1] {
            let (cell, size) = (corners(column), [tall, wide(column)]);
            if cell.measured() < 4 {
                is_broken = true;
                broken(fine, [top, column << level], size, cell, &mut range);
            } else if tall != size[1] {
                diagonal(fine, [top, column << level], size, cell, &mut range);
            }
        }
        let is_last = cell_row + 1 == cells[0];
        for down in 0..tall + usize::from(is_last || is_broken) {
            if is_broken {
                surface.fill(f64::NAN);
            }
            for column in 0..cells[1] {
                let cell = corners(column);
                if !is_broken || cell.measured() == 4 {
                    let wide = wide(column);
                    fill(&mut surface[column << level..][..=wide], cell, [down, tall], &steps);
                }
            }
            let samples = fine.row(top + down);
            let (mut low, mut high) = ([range.low; 4], [range.high; 4]);
            let (samples, sample_rest) = samples.as_chunks::<4>();
            let (surfaces, surface_rest) = surface.as_chunks::<4>();
            for (samples, surfaces) in samples.iter().zip(surfaces) {
                for lane in 0..4 {
                    let distance = samples[lane] - surfaces[lane];
                    low[lane] = if distance < low[lane] { distance } else { low[lane] };
                    high[lane] = if distance > high[lane] { distance } else { high[lane] };
                }
            }
            low.iter().chain(&high).for_each(|value| range.add(*value));
            sample_rest.iter().zip(surface_rest).for_each(|(sample, surface)| range.add(sample - surface));
        }
    }
    range
}

/// Heights of a row across a cell of four corners, `down` of `tall` steps from its top.
#[inline]
fn fill(out: &mut [f64], Cell([a, b, d, e]): Cell, [down, tall]: [usize; 2], steps: &[f64]) {
    let wide = out.len() - 1;
    let share = down as f64 / tall as f64;
    // The lower left triangle, then the upper right one.
    let (left, along_left) = (a + (d - a) * share, (e - d) / wide as f64);
    let (right, along_right) = (a + (e - b) * share, (b - a) / wide as f64);
    let bend = if wide == tall { down } else { (down * wide).div_ceil(tall) };
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
                surface = there.min_by(|one, other| far(*one).total_cmp(&far(*other))).map_or(f64::NAN, |corner| cell.0[corner]);
            }
            range.add(sample - surface);
        }
    }
}

/// Where T's edges cross the diagonal of a cell that is no square.
fn diagonal(fine: Fine<'_>, [top, left]: [usize; 2], [tall, wide]: [usize; 2], Cell([a, _, _, e]): Cell, range: &mut Range) {
    let (tall_steps, wide_steps) = (tall as f64, wide as f64);
    let mut look = |share: f64, down: f64, across: f64| {
        let surface = a + (e - a) * share;
        // Cells on both sides of an edge have the same height on it, but one of them may have no surface.
        let (row, column) = (down.floor() as usize, across.floor() as usize);
        for row in [row.checked_sub(1).filter(|_| down == down.floor()), Some(row).filter(|row| *row < tall)].into_iter().flatten() {
            for column in [column.checked_sub(1).filter(|_| across == across.floor()), Some(column).filter(|column| *column < wide)].into_iter().flatten() {
                let height = fine.cell(top + row, left + column).height(across - column as f64, down - row as f64);
                range.add(height - surface);
            }
        }
    };
    (1..tall).for_each(|down| look(down as f64 / tall_steps, down as f64, down as f64 * wide_steps / tall_steps));
    (1..wide).for_each(|across| look(across as f64 / wide_steps, across as f64 * tall_steps / wide_steps, across as f64));
    for diagonal in 1..wide.abs_diff(tall) {
        let share = diagonal as f64 / wide.abs_diff(tall) as f64;
        look(share, share * tall_steps, share * wide_steps);
    }
}
