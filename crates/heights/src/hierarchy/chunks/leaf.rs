//! What is found in a leaf at full resolution.

use super::cells::{self, Patch};
use super::sums::{Sums, WideLight, WideSum};
use deepfield_data::lanes::in_lanes;

/// What a leaf's samples say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Leaf {
    /// Measured samples: those of the last row and column are the next leaf's.
    pub valid: u64,
    /// The sum of their stored values.
    pub sum: f64,
    /// Whether all samples were measured, those of the last row and column among them.
    pub is_whole: bool,
    /// The least stored value of all its samples; infinite without any.
    pub low: f64,
    /// The largest.
    pub high: f64,
    /// The largest step along an edge of T.
    pub step: f64,
    /// Of levels from 1 on what the leaf adds to their samples, those of all four borders among them.
    pub levels: Vec<Sums>,
    /// Sums over all cells.
    pub total: WideSum,
    /// And their light.
    pub light: Vec<WideLight>,
}

/// Looks at a leaf. `levels` is how many levels of samples it adds to.
pub fn leaf(patch: &Patch<'_>, slopes: [f64; 2], owns: [bool; 2], levels: u32) -> Leaf {
    let mut out = Leaf { is_whole: true, low: f64::INFINITY, high: f64::NEG_INFINITY, ..Leaf::default() };
    let [rows, columns] = patch.size;
    for row in 0..rows {
        let samples = patch.row(row);
        let mut is_whole = true;
        let [low, high] = ends(samples, &mut is_whole);
        (out.low, out.high) = (less(out.low, low), more(out.high, high));
        out.is_whole &= is_whole;
        if row + usize::from(!owns[0]) < rows {
            let own = &samples[..columns - usize::from(!owns[1])];
            let valid = own.iter().filter(|value| !value.is_nan());
            out.valid += valid.clone().count() as u64;
            out.sum += valid.sum::<f64>();
        }
    }
    out.step = largest_step((0..rows).map(|row| patch.row(row)), out.is_whole);
    let mut blocks = cells::sums(patch, slopes, owns);
    for level in 1..=levels {
        let [rows, columns] = patch.size.map(|count| (count - 1).div_ceil(1 << level) + 1);
        out.levels.push(blocks.about_samples(rows, columns));
        blocks = blocks.halved();
    }
    // Short of the top there is more than one block left.
    for sum in &blocks.sums {
        out.total.add(&(*sum).into());
    }
    out.light = vec![[0; 2]; patch.planes.len()];
    for (at, light) in blocks.light.iter().enumerate() {
        let own = &mut out.light[at % patch.planes.len()];
        own[0] += u128::from(light[0]);
        own[1] += u128::from(light[1]);
    }
    out
}

/// Values that are compared side by side.
const LANES: usize = 8;

/// The least and the largest of a row's values; infinite without any. `is_whole` becomes false where one is missing.
fn ends(samples: &[f64], is_whole: &mut bool) -> [f64; 2] {
    let (mut low, mut high, mut whole) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES], [true; LANES]);
    let (lanes, rest) = samples.as_chunks::<LANES>();
    for values in lanes {
        for lane in 0..LANES {
            low[lane] = less(low[lane], values[lane]);
            high[lane] = more(high[lane], values[lane]);
            whole[lane] &= !values[lane].is_nan();
        }
    }
    *is_whole &= whole.into_iter().chain(rest.iter().map(|value| !value.is_nan())).all(|is_whole| is_whole);
    let (low, high) = (low.into_iter().chain(rest.iter().copied()), high.into_iter().chain(rest.iter().copied()));
    [low.fold(f64::INFINITY, less), high.fold(f64::NEG_INFINITY, more)]
}

/// The lesser one; the first where the second is none.
#[inline(always)]
fn less(one: f64, other: f64) -> f64 {
    if other < one { other } else { one }
}

/// The greater one; the first where the second is none.
#[inline(always)]
fn more(one: f64, other: f64) -> f64 {
    if other > one { other } else { one }
}

/// The largest difference, up or down, of two rows' values; those that are none do not count.
#[inline(always)]
fn largest(row: &[f64], other: &[f64]) -> f64 {
    let mut most = [0.0_f64; LANES];
    let count = row.len().min(other.len());
    let ((row, row_rest), (other, other_rest)) =
        (row[..count].as_chunks::<LANES>(), other[..count].as_chunks::<LANES>());
    for (row, other) in row.iter().zip(other) {
        for lane in 0..LANES {
            most[lane] = more(most[lane], (row[lane] - other[lane]).abs());
        }
    }
    let rest = row_rest.iter().zip(other_rest).map(|(value, other)| (value - other).abs());
    most.into_iter().chain(rest).fold(0.0, more)
}

/// The largest step along an edge of the surface of these samples, diagonals among them.
pub fn largest_step<'a>(rows: impl Iterator<Item = &'a [f64]>, is_whole: bool) -> f64 {
    in_lanes!(largest_step_in_vectors(rows, is_whole))
}

#[inline(always)]
fn largest_step_in_vectors<'a>(rows: impl Iterator<Item = &'a [f64]>, is_whole: bool) -> f64 {
    let mut most: f64 = 0.0;
    let mut above: Option<&[f64]> = None;
    for row in rows {
        most = more(most, largest(&row[1..], row));
        if let Some(above) = above {
            most = more(more(most, largest(row, above)), largest(&row[1..], above));
            if !is_whole {
                // Where a corner is missing the edge may be the other diagonal.
                for (up, own) in above.windows(2).zip(row.windows(2)) {
                    if up[0].is_nan() || own[1].is_nan() {
                        most = more(most, (up[1] - own[0]).abs());
                    }
                }
            }
        }
        above = Some(row);
    }
    most
}
