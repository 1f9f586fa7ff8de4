//! Fractional Brownian motion on a lattice, by successive additions: a coarse lattice of random numbers is refined by
//! cubic B-spline subdivision, and every level adds independent noise of its own, whose standard deviation goes with
//! its spacing to the power of the Hurst exponent. That is the spectrum `k^-(2 H + 2)` in octaves, and a sample depends
//! on a few numbers of each level only: any window can be made alone, at a cost a sample that does not depend on the
//! number of levels.

use super::noise::Noise;

/// The part of a level's variance that the noise of the samples themselves has, times the Hurst exponent: such that
/// increments of 1 to 4 samples go on as those of 16 and more do (found by the exact variogram of the sum; local
/// exponents are then within 0.04 of H from 0.1 to 0.8).
const FINEST: f64 = 0.15;

/// The variance of a level's noise far below it, averaged over places: the square of the integral of the cubic B-spline
/// squared.
const SPREAD: f64 = (151.0 / 315.0) * (151.0 / 315.0);

/// A field. Its mean over all seeds is 0.
#[derive(Clone, Debug)]
pub(super) struct Fbm {
    /// Of each level, the finest first: standard deviation, and the noise.
    levels: Vec<(f64, Noise)>,
}

/// What is needed on the way, to be used again.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    fine: Vec<f64>,
    coarse: Vec<f64>,
    wide: Vec<f64>,
}

/// A part of a level's lattice.
#[derive(Clone, Copy, Debug)]
struct Part {
    row: i64,
    column: i64,
    rows: i64,
    columns: i64,
}

impl Part {
    /// The part that ends where pairs of samples do.
    fn paired(self) -> Part {
        let wider = |first: i64, count: i64| {
            let end = first + count;
            (first & !1, ((end + 1) & !1) - (first & !1))
        };
        let ((row, rows), (column, columns)) = (wider(self.row, self.rows), wider(self.column, self.columns));
        Part { row, column, rows, columns }
    }

    /// What it depends on, of the next coarser level; this part is paired.
    fn parents(self) -> Part {
        Part {
            row: self.row / 2 - 1,
            column: self.column / 2 - 1,
            rows: self.rows / 2 + 2,
            columns: self.columns / 2 + 2,
        }
    }

    fn samples(self) -> usize {
        (self.rows * self.columns) as usize
    }
}

impl Fbm {
    /// A field whose coarsest level has numbers every `reach` samples, or up to twice as far apart, and whose heights
    /// deviate by `deviation` from their mean.
    pub(super) fn new(seed: u64, hurst: f64, reach: u64, deviation: f64) -> Fbm {
        let octaves = u64::BITS - reach.max(4).saturating_sub(1).leading_zeros();
        let mut levels: Vec<(f64, Noise)> = (0..=octaves)
            .map(|level| {
                let own = if level == 0 { (FINEST / hurst).sqrt() } else { libm::exp2(hurst * f64::from(level)) };
                (own, Noise::new(seed, u64::from(level)))
            })
            .collect();
        let spread = |level: usize| if level == 0 { 1.0 } else { SPREAD };
        let variance: f64 = levels.iter().enumerate().map(|(level, (own, _))| own * own * spread(level)).sum();
        let scale = deviation / variance.sqrt();
        levels.iter_mut().for_each(|(own, _)| *own *= scale);
        Fbm { levels }
    }

    /// The samples of a window, row by row, `stride` numbers from row to row. Columns and rows count from any place,
    /// below 2^60.
    pub(super) fn window(
        &self,
        [row, column]: [i64; 2],
        [rows, columns]: [usize; 2],
        out: &mut [f64],
        stride: usize,
        scratch: &mut Scratch,
    ) {
        let own = Part { row, column, rows: rows as i64, columns: columns as i64 };
        // What each level has to hold, the finest first; all but the coarsest are refined from the next.
        let mut parts = vec![own.paired()];
        for _ in 1..self.levels.len() {
            let finer = parts.last().copied().unwrap_or(own);
            parts.push(finer.parents().paired());
        }
        let Scratch { fine, coarse, wide } = scratch;
        let mut above: Option<Part> = None;
        for (part, (deviation, noise)) in parts.iter().zip(&self.levels).rev() {
            fine.resize(part.samples(), 0.0);
            match above {
                None => fine.fill(0.0),
                Some(above) => refine(above, coarse, *part, fine, wide),
            }
            for (number, line) in fine.chunks_exact_mut(part.columns as usize).enumerate() {
                let row = noise.row(part.row + number as i64);
                for (column, sample) in (part.column..).zip(line) {
                    *sample += deviation * row.normal(column);
                }
            }
            std::mem::swap(fine, coarse);
            above = Some(*part);
        }
        let Some(held) = above else { return };
        let (down, right) = ((row - held.row) as usize, (column - held.column) as usize);
        let lines = coarse.chunks_exact(held.columns as usize).skip(down);
        for (line, out) in lines.zip(out.chunks_mut(stride)).take(rows) {
            out[..columns].copy_from_slice(&line[right..right + columns]);
        }
    }
}

/// Cubic B-spline subdivision, along rows and then along columns: a sample between two is their mean, one at a place of
/// another has 6/8 of it and 1/8 of each neighbour. `coarse` holds `above`, which is the parents of `part` and maybe
/// more; `part` is paired.
fn refine(above: Part, coarse: &[f64], part: Part, fine: &mut [f64], wide: &mut Vec<f64>) {
    let width = part.columns as usize;
    let parents = part.parents();
    let (down, right) = ((parents.row - above.row) as usize, (parents.column - above.column) as usize);
    wide.resize(parents.rows as usize * width, 0.0);
    let lines = coarse.chunks_exact(above.columns as usize).skip(down);
    for (line, out) in lines.zip(wide.chunks_exact_mut(width)) {
        let line = &line[right..];
        for (three, two) in line.windows(3).zip(out.as_chunks_mut::<2>().0) {
            *two = [0.125 * (three[0] + three[2]) + 0.75 * three[1], 0.5 * (three[1] + three[2])];
        }
    }
    for (number, two) in fine.chunks_exact_mut(2 * width).enumerate() {
        let (even, odd) = two.split_at_mut(width);
        let [before, at, after] = [0, 1, 2].map(|further| &wide[(number + further) * width..][..width]);
        for (((even, odd), before), (at, after)) in even.iter_mut().zip(odd).zip(before).zip(at.iter().zip(after)) {
            *even = 0.125 * (before + after) + 0.75 * at;
            *odd = 0.5 * (at + after);
        }
    }
}
