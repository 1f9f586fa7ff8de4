//! A round kernel row by row: what share of the flux a strip of heights has, and how it lies along it.
//!
//! Heights and places are in units of the kernel's radius. Along the row at `eta` the kernel's flux lies between
//! `+-sqrt(1 - eta^2)`; in units of that chord its cumulative share hardly depends on `eta` (for poly6 not at all).

use super::profile::{TERMS, solve};
use super::table::CumulativeTable;
use crate::model::Kernel;
use std::sync::OnceLock;

/// The rows of a kernel, computed once for the whole program.
pub struct RowShares {
    /// Of the flux above each of the heights from -1 to 1: all of it, its first and second moments, and the flux per height.
    nodes: Vec<[f64; 4]>,
    shapes: Vec<Packed>,
}

/// How the flux of a strip lies along its row: the chord's flux, smeared evenly by as much as the strip leans.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// The flux between `-t` and `t` as a share of all of it, `t` in units of where it ends: `t` times a polynomial in
    /// `2 t^2 - 1`, coefficients in ascending order. It is 1 at 1 but for rounding.
    pub share: [f32; TERMS],
    /// 1 over the variance, in the same units.
    pub per_variance: f32,
    /// Variance of the chord alone, in units of the chord.
    pub chord: f32,
}

/// A [`Shape`] in one piece, which a vector's width divides.
type Packed = [f32; TERMS + 3];

/// A strip of heights.
#[derive(Clone, Copy, Debug)]
pub struct Strip {
    /// Its share of the flux.
    pub share: f32,
    /// Mean height of its flux.
    pub height: f32,
    /// How far that is below its middle.
    pub tilt: f32,
    /// Variance of its flux's height; at most that of an even strip.
    pub variance: f32,
}

impl RowShares {
    /// Steps from -1 to 1 of the moments.
    const STEPS: usize = 64;
    /// Steps of heights from 0 to 1 at which chords are held.
    const CHORDS: usize = 8;
    /// Steps of the part of the width that comes from leaning, from none to all.
    const LEANS: usize = 20;
    /// Shapes of one height.
    const SHAPES: usize = RowShares::LEANS + 1;
    /// Strips below this height, in units of the radius, have their flux in their middle.
    const THIN: f64 = 1.0 / 32.0;

    /// The rows of a kernel.
    pub fn of(kernel: Kernel) -> &'static RowShares {
        static TABLES: [OnceLock<RowShares>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| RowShares::compute(kernel))
    }

    fn compute(kernel: Kernel) -> RowShares {
        const FINE: usize = 64;
        let table = CumulativeTable::of(kernel);
        let height = |step: usize| 2.0 * step as f64 / RowShares::STEPS as f64 - 1.0;
        let density = |height: f64| 2.0 * table.along(1.0, height);
        let mut sums = [0.0; 3];
        let mut nodes = vec![[0.0; 4]];
        for step in 0..RowShares::STEPS {
            let (from, width) = (height(step), 2.0 / (RowShares::STEPS * FINE) as f64);
            for fine in 0..FINE {
                let (low, high) = (from + fine as f64 * width, from + (fine + 1) as f64 * width);
                let share = 2.0 * (table.at(1.0, high) - table.at(1.0, low));
                let middle = 0.5 * (low + high);
                let parts = [share, share * middle, share * (middle * middle + width * width / 12.0)];
                sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
            }
            nodes.push([sums[0], sums[1], sums[2], density(height(step + 1))]);
        }
        // All of it is exactly 1, and its first moment 0.
        nodes[RowShares::STEPS][0] = 1.0;
        nodes[RowShares::STEPS][1] = 0.0;
        let shapes = (0..(RowShares::CHORDS + 1) * RowShares::SHAPES).map(|index| {
            let (chord, lean) = (index / RowShares::SHAPES, index % RowShares::SHAPES);
            // A point has no chord: the last is that of a height just below.
            let height = (chord as f64 / RowShares::CHORDS as f64).min(0.99);
            Shape::fit(table, height, lean as f64 / RowShares::LEANS as f64).packed()
        });
        RowShares { nodes, shapes: shapes.collect() }
    }

    /// Moments of the flux above a height; outside [-1, 1] as at the edge.
    #[inline(always)]
    pub fn above(&self, height: f64) -> [f64; 3] {
        const STEP: f64 = 2.0 / RowShares::STEPS as f64;
        let height = height.clamp(-1.0, 1.0);
        let position = (height + 1.0) / STEP;
        // The cast saturates.
        let index = (position as usize).min(RowShares::STEPS - 1);
        let t = position - index as f64;
        let (before, after) = (&self.nodes[index], &self.nodes[index + 1]);
        // Cubic with the values and slopes at both ends: the slope of a moment is a power of the height times the density.
        let (rise, from, to) = (t * t * (3.0 - 2.0 * t), t * (1.0 - t) * (1.0 - t) * STEP, t * t * (t - 1.0) * STEP);
        let ends = [index, index + 1].map(|index| index as f64 * STEP - 1.0);
        let mut slopes = [from * before[3], to * after[3]];
        let mut values = [0.0; 3];
        for k in 0..3 {
            values[k] = before[k] + rise * (after[k] - before[k]) + slopes[0] + slopes[1];
            slopes = [slopes[0] * ends[0], slopes[1] * ends[1]];
        }
        values
    }

    /// The strip between two heights with these [`RowShares::above`]; None where it has no flux.
    #[inline(always)]
    pub fn strip(&self, [from, to]: [f64; 2], above: &[f64; 3], below: &[f64; 3]) -> Option<Strip> {
        let share = below[0] - above[0];
        if share <= 0.0 {
            return None;
        }
        let even = (to - from) * (to - from) * (1.0 / 12.0);
        let (height, variance) = if to - from < RowShares::THIN {
            (0.5 * (from + to), even)
        } else {
            let per_share = share.recip();
            let height = ((below[1] - above[1]) * per_share).clamp(from, to);
            (height, ((below[2] - above[2]) * per_share - height * height).clamp(0.0, even))
        };
        let tilt = height - 0.5 * (from + to);
        Some(Strip { share: share as f32, height: height as f32, tilt: tilt as f32, variance: variance as f32 })
    }

    /// How the flux lies along a row at a height, `lean` being the variance of what the strip leans by, in units of the chord.
    #[inline(always)]
    pub fn shape(&self, height: f32, lean: f32) -> Shape {
        // Casts saturate.
        let at = height.abs() * RowShares::CHORDS as f32;
        let chord = (at as usize).min(RowShares::CHORDS - 1);
        let half = (3.0 * lean).sqrt();
        let part = RowShares::LEANS as f32 * (1.0 - (1.0 + half).recip());
        let first = (part as usize).min(RowShares::LEANS - 1);
        let (up, along) = (at - chord as f32, part - first as f32);
        let index = chord * RowShares::SHAPES + first;
        let (before, after) = (&self.shapes[index..index + 2], &self.shapes[index + RowShares::SHAPES..][..2]);
        let mut shape = [0.0; TERMS + 3];
        for k in 0..TERMS + 3 {
            let (low, high) = (before[0][k], after[0][k]);
            let (low, high) = (low + along * (before[1][k] - low), high + along * (after[1][k] - high));
            shape[k] = low + up * (high - low);
        }
        Shape::unpacked(&shape)
    }
}

impl Shape {
    fn packed(&self) -> Packed {
        let mut packed = [0.0; TERMS + 3];
        packed[..TERMS].copy_from_slice(&self.share);
        (packed[TERMS], packed[TERMS + 1]) = (self.per_variance, self.chord);
        packed
    }

    #[inline(always)]
    fn unpacked(packed: &Packed) -> Shape {
        let mut share = [0.0; TERMS];
        share.copy_from_slice(&packed[..TERMS]);
        Shape { share, per_variance: packed[TERMS], chord: packed[TERMS + 1] }
    }

    /// The shape at a height of which `part` of the width is that of leaning.
    fn fit(table: &CumulativeTable, height: f64, part: f64) -> Shape {
        const SAMPLES: usize = 100;
        let chord = (1.0 - height * height).sqrt();
        let whole = table.along(chord, height);
        let share = |t: f64| table.along(t * chord, height) / whole;
        let even = |f: &dyn Fn(f64) -> f64| {
            (0..SAMPLES).map(|k| f((k as f64 + 0.5) / SAMPLES as f64)).sum::<f64>() / SAMPLES as f64
        };
        // By parts: the integral of t^2 times the density is that of 2 t (1 - share).
        let variance = even(&|t| 2.0 * t * (1.0 - share(t)));
        if part >= 1.0 {
            let mut coefficients = [0.0; TERMS];
            coefficients[0] = 1.0;
            return Shape { share: coefficients, per_variance: 3.0, chord: variance as f32 };
        }
        // Half of what it is smeared over, in units of the chord.
        let half = part / (1.0 - part);
        let end = 1.0 + half;
        let smeared = |t: f64| match part > 0.0 {
            true => even(&|k| share(t * end + half * (2.0 * k - 1.0))),
            false => share(t),
        };
        let mut matrix = [[0.0; TERMS + 1]; TERMS];
        for sample in 0..SAMPLES {
            let t = (sample as f64 + 0.5) / SAMPLES as f64;
            let y = 2.0 * t * t - 1.0;
            let basis: [f64; TERMS] = std::array::from_fn(|power| t * y.powi(power as i32));
            let value = smeared(t);
            for (row, &a) in matrix.iter_mut().zip(&basis) {
                for (entry, &b) in row.iter_mut().zip(basis.iter().chain([&value])) {
                    *entry += a * b;
                }
            }
        }
        let coefficients = solve(matrix);
        let all: f64 = coefficients.iter().sum();
        let per_variance = end * end / (variance + half * half / 3.0);
        Shape {
            share: coefficients.map(|c| (c / all) as f32),
            per_variance: per_variance as f32,
            chord: variance as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;

    #[test]
    fn chords_are_the_cumulative_kernel() {
        for kernel in Kernel::ALL {
            let (rows, table) = (RowShares::of(kernel), CumulativeTable::of(kernel));
            for i in 0..64 {
                let height = (f64::from(i) + 0.5) / 64.0;
                let chord = rows.shape(height as f32, 0.0);
                let half = (1.0 - height * height).sqrt();
                let mut worst = 0.0f64;
                for j in 0..=100 {
                    let t = f64::from(j) / 100.0;
                    let y = 2.0 * t * t - 1.0;
                    let found = t * chord.share.iter().rev().fold(0.0, |sum, &c| sum * y + f64::from(c));
                    let expected = table.along(t * half, height) / table.along(half, height);
                    worst = worst.max((found - expected).abs());
                }
                // Rows near the edge, which change fastest, have next to no flux.
                let flux = table.along(half, height) / table.along(1.0, 0.0);
                assert!(worst * flux < 6e-4, "{kernel:?} {height}: {worst}, {flux} of the middle's flux");
            }
        }
    }

    #[test]
    fn strips_add_up() {
        for kernel in Kernel::ALL {
            let rows = RowShares::of(kernel);
            for count in [1u16, 2, 3, 7, 50] {
                let at = |k: u16| 2.4 * f64::from(k) / f64::from(count) - 1.2;
                let strips = (0..count)
                    .filter_map(|k| rows.strip([at(k), at(k + 1)], &rows.above(at(k)), &rows.above(at(k + 1))));
                let strips: Vec<Strip> = strips.collect();
                let sum = |f: &dyn Fn(&Strip) -> f32| strips.iter().map(|strip| f64::from(f(strip))).sum::<f64>();
                assert!((sum(&|s| s.share) - 1.0).abs() < 1e-6);
                assert!(sum(&|s| s.share * s.height).abs() < 1e-6);
                let second = sum(&|s| s.share * (s.height * s.height + s.variance));
                assert!((second / kernel.variance() - 1.0).abs() < 2e-3, "{kernel:?} {count}: {second}");
            }
        }
    }
}
