//! What each pixel shows, nearest first, by an atomic minimum of depths and numbers.

use super::{FRACTION, ONE};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Pixels beyond which a place is not in any picture.
const FAR: f64 = 1e9;
/// Depths of what is shown only where nothing else is count so many times: behind all else.
pub const BEHIND: f64 = (1_u128 << 96) as f64;
/// How deep that is at least.
const LEAST_BEHIND: f64 = 1e-6;

/// Which triangle or point a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Shown {
    /// Number of the chunk in the cut.
    pub node: usize,
    /// Row and column of the cell or the sample in it.
    pub at: [usize; 2],
    /// Which of the cell's triangles; `None` for a point. [`POLE`] and the next one: the triangle between a column of cells and the pole beyond
    /// the chunk's first or last row; `at` then has no row.
    pub slot: Option<usize>,
}

/// The first slot of triangles to poles.
pub const POLE: usize = 2;
/// Numbers before those of points: of triangles, two in each of 256 x 256 cells.
pub const BEFORE_POINTS: u32 = 1 << 17;
/// Numbers before those of triangles to poles.
pub const BEFORE_POLES: u32 = BEFORE_POINTS + 257 * 257;
/// Numbers before those of the triangles, and then of the points, of the one column more that a chunk has which closes a globe.
pub const BEFORE_SEAM: u32 = BEFORE_POLES + 2 * 257;
const BEFORE_LAST: u32 = BEFORE_SEAM + 2 * 256;

impl Shown {
    /// As a number of 14 bits for the chunk and 18 for what is in it; shaders have the same.
    pub fn pack(self) -> u32 {
        let [row, column] = self.at.map(|at| at as u32);
        let within = match self.slot {
            Some(slot) if slot >= POLE => BEFORE_POLES + 257 * (slot - POLE) as u32 + column,
            Some(slot) if column == 256 => BEFORE_SEAM + 2 * row + slot as u32,
            Some(slot) => 2 * (row * 256 + column) + slot as u32,
            None if column == 257 => BEFORE_LAST + row,
            None => BEFORE_POINTS + row * 257 + column,
        };
        (self.node as u32) << 18 | within
    }

    /// From its number.
    pub fn unpack(number: u32) -> Shown {
        let (node, within) = ((number >> 18) as usize, number & ((1 << 18) - 1));
        let split = |number: u32, by: u32| [(number / by) as usize, (number % by) as usize];
        if within < BEFORE_POINTS {
            let [cell, slot] = split(within, 2);
            return Shown { node, at: [cell / 256, cell % 256], slot: Some(slot) };
        }
        if within < BEFORE_POLES {
            return Shown { node, at: split(within - BEFORE_POINTS, 257), slot: None };
        }
        if within < BEFORE_SEAM {
            let [end, column] = split(within - BEFORE_POLES, 257);
            return Shown { node, at: [0, column], slot: Some(POLE + end) };
        }
        if within < BEFORE_LAST {
            let [row, slot] = split(within - BEFORE_SEAM, 2);
            return Shown { node, at: [row, 256], slot: Some(slot) };
        }
        Shown { node, at: [(within - BEFORE_LAST) as usize, 257], slot: None }
    }
}

/// What is nearest in each pixel.
pub struct Visibility {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    pub(super) cells: Vec<AtomicU64>,
}

impl Visibility {
    /// A picture of nothing.
    pub fn new([width, height]: [u32; 2]) -> Visibility {
        let (width, height) = (width as usize, height as usize);
        let cells = (0..width * height).into_par_iter().map(|_| AtomicU64::new(u64::MAX));
        Visibility { width, height, cells: cells.collect() }
    }

    /// What a pixel shows.
    pub fn at(&self, index: usize) -> Option<Shown> {
        let value = self.cells[index].load(Ordering::Relaxed);
        (value != u64::MAX).then(|| Shown::unpack(value as u32))
    }

    /// Whether a pixel shows anything.
    pub fn is_shown(&self, index: usize) -> bool {
        self.cells[index].load(Ordering::Relaxed) != u64::MAX
    }

    /// Whether all pixels of some columns and rows show something, or none of them does.
    pub(in crate::cpu::surface) fn is_even(&self, columns: &Range<usize>, rows: &Range<usize>) -> bool {
        let (mut is_any, mut are_all) = (false, true);
        for row in rows.clone().map(|y| &self.cells[y * self.width..][columns.clone()]) {
            for cell in row {
                let is_shown = cell.load(Ordering::Relaxed) != u64::MAX;
                (is_any, are_all) = (is_any | is_shown, are_all & is_shown);
            }
        }
        !is_any || are_all
    }

    /// Keeps the nearer of what is there and this; `depth` is not negative.
    #[inline]
    pub fn put(&self, index: usize, depth: f64, number: u32) {
        let (value, cell) = (ordered(depth, number), &self.cells[index]);
        if value < cell.load(Ordering::Relaxed) {
            cell.fetch_min(value, Ordering::Relaxed);
        }
    }
}

/// What sorts as depths do, and of equal ones as numbers.
#[inline]
fn ordered(depth: f64, number: u32) -> u64 {
    // Positive floats sort as their bits do.
    u64::from((depth.max(0.0) as f32).to_bits()) << 32 | u64::from(number)
}

/// The depth of what is behind all else.
pub(in crate::cpu::surface) fn behind(depth: f64) -> f64 {
    depth.max(LEAST_BEHIND) * BEHIND
}

impl Visibility {
    /// Keeps a point, in a square of pixels about its place, where nothing else is; of several the nearest.
    pub(in crate::cpu::surface) fn put_behind(&self, place: [f64; 2], side: u32, depth: f64, number: u32) {
        self.put_square(parts_of(place), side, behind(depth), number);
    }

    /// Keeps the nearer of what is there and a point, in those pixels of a square about its place at whose centres it is, with a depth for each.
    pub(in crate::cpu::surface) fn put_where(
        &self,
        place: [f64; 2],
        side: u32,
        number: u32,
        depth_at: impl Fn([f64; 2]) -> f64,
        is_at: impl Fn([f64; 2]) -> bool,
    ) {
        for [x, y] in self.square(parts_of(place), side) {
            let (index, centre) = (y * self.width + x, [x as f64 + 0.5, y as f64 + 0.5]);
            let depth = depth_at(centre);
            // What would not be kept is not asked for.
            if ordered(depth, number) < self.cells[index].load(Ordering::Relaxed) && is_at(centre) {
                self.put(index, depth, number);
            }
        }
    }

    /// The pixels of a square about a place in parts of pixels.
    fn square(&self, place: [i64; 2], side: u32) -> impl Iterator<Item = [usize; 2]> {
        let side = i64::from(side);
        let [left, top] = place.map(|place| (place - (side - 1) * ONE / 2) >> FRACTION);
        let columns = left.max(0)..(left + side).min(self.width as i64);
        let rows = top.max(0)..(top + side).min(self.height as i64);
        rows.flat_map(move |y| columns.clone().map(move |x| [x as usize, y as usize]))
    }

    /// Keeps the nearer of what is there and a point, in a square of pixels about its place in parts of pixels.
    #[inline(always)]
    pub(super) fn put_square(&self, place: [i64; 2], side: u32, depth: f64, number: u32) {
        if side == 1 {
            let [x, y] = place.map(|place| (place >> FRACTION) as usize);
            if x < self.width && y < self.height {
                self.put(y * self.width + x, depth, number);
            }
            return;
        }
        for [x, y] in self.square(place, side) {
            self.put(y * self.width + x, depth, number);
        }
    }
}

/// A place in parts of pixels.
pub(super) fn parts_of(place: [f64; 2]) -> [i64; 2] {
    place.map(|pixels| (pixels.clamp(-FAR, FAR) * ONE as f64) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_parts_show_all_or_nothing() {
        let seen = Visibility::new([4, 3]);
        assert!(seen.is_even(&(0..4), &(0..3)));
        seen.put(4 + 1, 1.0, 7);
        seen.put(4 + 2, 1.0, 7);
        assert!(!seen.is_even(&(0..4), &(0..3)) && !seen.is_even(&(1..2), &(0..2)) && !seen.is_even(&(2..4), &(1..2)));
        assert!(seen.is_even(&(1..3), &(1..2)) && seen.is_even(&(0..4), &(2..3)) && seen.is_even(&(3..4), &(0..3)));
    }
}
