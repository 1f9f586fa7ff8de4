//! Mean normals of coarse chunks, finer than files keep them.
//!
//! Files keep the parts of a mean normal as bytes. On gentle waves neighbours differ by a few of their steps only, so that curvature, which is
//! what they differ by, would be speckled, and ground that leans by less than half a step would be flat. The chunk's own heights say more: their
//! mean slope over what a sample stands for, of the polynomial through those around it. Where that rounds to the byte that is kept, it is
//! taken; where it is a step or more away, as on rough ground, heights say nothing of the mean, and the byte stays. So no part is further than a step
//! from the mean.

use super::super::samples::MeanNormal;
use deepfield_heights::hierarchy::chunks::coarse::{UP, normal_of};

/// From a byte of x, y and z to the next.
const STEPS: [f32; 3] = [1.0 / 127.0, 1.0 / 127.0, 1.0 / 255.0];

/// Samples that a slope is made of.
const TAPS: usize = 5;

/// What each of them counts in the mean slope from half a spacing before one of them, by its number, to half a spacing after it: of cubics through
/// the four that are nearest to either end, of those that there are.
const WEIGHTS: [[f64; TAPS]; TAPS] = [
    [-1.875, 3.125, -1.625, 0.375, 0.0],
    [-0.375, -0.375, 0.875, -0.125, 0.0],
    [0.0625, -0.625, 0.0, 0.625, -0.0625],
    [0.0, 0.125, -0.875, 0.375, 0.375],
    [0.0, -0.375, 1.625, -3.125, 1.875],
];

/// The heights of a coarse chunk, and where they are.
pub(super) struct Ground<'a> {
    /// Row by row; NaN where there are none.
    pub(super) heights: &'a [f64],
    /// Rows and columns of full resolution that its own are at.
    pub(super) places: [Vec<u64>; 2],
    /// From differences of heights along columns and rows of full resolution to slopes.
    pub(super) slopes: [f64; 2],
}

/// The samples along an axis that a slope is made of.
#[derive(Clone, Copy)]
struct Stencil {
    first: usize,
    weights: [f64; TAPS],
}

/// The stencil of each place along an axis; none where spacings differ, as at the end of a field, or there are too few.
fn stencils(places: &[u64], slope: f64) -> Vec<Option<Stencil>> {
    let of = |index: usize| {
        let first = index.saturating_sub(TAPS / 2).min(places.len().checked_sub(TAPS)?);
        let apart = places[first + 1] - places[first];
        let is_even = places[first..first + TAPS].windows(2).all(|pair| pair[1] - pair[0] == apart);
        let scale = slope / apart as f64;
        is_even.then(|| Stencil { first, weights: WEIGHTS[index - first].map(|weight| weight * scale) })
    };
    (0..places.len()).map(of).collect()
}

/// How much of what a part is away from its byte, in steps, is taken.
#[inline(always)]
fn taken(away: f32) -> f32 {
    let far = away.abs();
    if far <= 0.5 {
        away
    } else if far < 1.0 {
        (1.0 - far).copysign(away)
    } else {
        // Also where nothing is known.
        0.0
    }
}

/// A unit normal by the slopes along columns and rows.
#[inline(always)]
fn unit([x, y]: [f32; 2]) -> [f32; 3] {
    let up = (x * x + y * y + 1.0).sqrt().recip();
    [-x * up, -y * up, up]
}

/// Mean normals of which bytes are kept (none where all of them point up), turned.
pub(super) fn refined(ground: &Ground<'_>, kept: &[[u8; 3]], turned: impl Fn([f32; 3]) -> [f32; 3]) -> Vec<MeanNormal> {
    let Ground { heights, places: [rows, columns], slopes } = ground;
    let (along_columns, along_rows) = (stencils(columns, slopes[0]), stencils(rows, slopes[1]));
    let mut out = Vec::with_capacity(heights.len());
    let mut down = vec![f64::NAN; columns.len()];
    let row_of = |row: usize| &heights[row * columns.len()..(row + 1) * columns.len()];
    for (row, stencil) in along_rows.iter().enumerate() {
        match stencil {
            None => down.fill(f64::NAN),
            Some(Stencil { first, weights }) => {
                let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|tap| row_of(first + tap));
                let [to_a, to_b, to_c, to_d, to_e] = *weights;
                for (column, down) in down.iter_mut().enumerate() {
                    let sum = to_a * a[column] + to_b * b[column] + to_c * c[column];
                    *down = sum + to_d * d[column] + to_e * e[column];
                }
            }
        }
        let own = row_of(row);
        for (stencil, down) in along_columns.iter().zip(&down) {
            let right = stencil.map_or(f64::NAN, |Stencil { first, weights }| {
                own[first..first + TAPS].iter().zip(weights).map(|(height, weight)| height * weight).sum()
            });
            let normal = normal_of(kept.get(out.len()).copied().unwrap_or(UP));
            let expected = unit([right as f32, *down as f32]);
            let part = |k: usize| normal[k] + STEPS[k] * taken((expected[k] - normal[k]) / STEPS[k]);
            out.push(MeanNormal::new(turned([part(0), part(1), part(2)])));
        }
    }
    out
}

/// The normals of the heights alone, where bytes were made for slopes so much steeper that they say nothing.
pub(super) fn of_heights(ground: &Ground<'_>) -> Vec<MeanNormal> {
    let Ground { heights, places: [rows, columns], slopes } = ground;
    let sample = |index: usize| {
        let (row, column) = (index / columns.len(), index % columns.len());
        let right = between(columns, column, |column| heights[row * columns.len() + column]);
        let down = between(rows, row, |row| heights[row * columns.len() + column]);
        MeanNormal::new(unit([(right * slopes[0]) as f32, (down * slopes[1]) as f32]))
    };
    (0..heights.len()).map(sample).collect()
}

/// What a row or a column of full resolution adds to the height between the neighbours of a sample, or between it and one of them; 0 where neither is
/// there.
fn between(places: &[u64], at: usize, height: impl Fn(usize) -> f64) -> f64 {
    let known = |index: usize| if height(index).is_nan() { at } else { index };
    let (from, to) = (known(at.saturating_sub(1)), known((at + 1).min(places.len() - 1)));
    let rise = height(to) - height(from);
    if from == to || rise.is_nan() { 0.0 } else { rise / (places[to] - places[from]) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples 4 apart, of which the last row is nearer.
    fn ground(height: impl Fn(f64, f64) -> f64) -> (Vec<f64>, [Vec<u64>; 2]) {
        let places = |count: u64, last: u64| (0..count).map(|at| 4 * at).chain([last]).collect::<Vec<u64>>();
        let places = [places(9, 33), places(12, 48)];
        let ([rows, columns], height) = (&places, &height);
        let at = |row: u64| columns.iter().map(move |column| height(row as f64, *column as f64));
        (rows.iter().flat_map(|row| at(*row)).collect(), places)
    }

    /// The bytes of a mean normal, as files keep them.
    fn bytes(normal: [f64; 3]) -> [u8; 3] {
        [128.0 + 127.0 * normal[0], 128.0 + 127.0 * normal[1], 255.0 * normal[2]].map(|value| (value + 0.5) as u8)
    }

    #[test]
    fn weights_are_mean_slopes_of_cubics() {
        for (middle, weights) in WEIGHTS.iter().enumerate() {
            for power in 0..4 {
                let at = |x: f64| (x - middle as f64).powi(power);
                let slope: f64 = weights.iter().enumerate().map(|(tap, weight)| weight * at(tap as f64)).sum();
                let expected = at(middle as f64 + 0.5) - at(middle as f64 - 0.5);
                assert!((slope - expected).abs() < 1e-12, "{middle}, power {power}: {slope}, expected {expected}");
            }
        }
    }

    #[test]
    fn gentle_ground_is_as_its_heights_say() {
        let (heights, places) = ground(|row, column| 0.003 * column - 0.3 * row);
        let ground = Ground { heights: &heights, places, slopes: [1.0, 1.0] };
        let length = (1.0_f64 + 0.3 * 0.3 + 0.003 * 0.003).sqrt();
        let normal = [-0.003 / length, 0.3 / length, 1.0 / length];
        let kept = vec![bytes(normal); heights.len()];
        let found = refined(&ground, &kept, |normal| normal);
        let columns = ground.places[1].len();
        for (index, found) in found.iter().enumerate() {
            let (row, found) = (index / columns, found.vector().map(f64::from));
            // The last row is nearer to the one before: its slope along rows is not known there.
            let most = if row < 7 { 4e-5 } else { 0.5 / 127.0 + 4e-5 };
            assert!((0..3).all(|k| (found[k] - normal[k]).abs() < most), "{index}: {found:?}, expected {normal:?}");
        }
        // Nearer to the flat than half a step: no bytes are kept.
        let (heights, places) = self::ground(|_, column| 0.003 * column);
        let flat = Ground { heights: &heights, places, slopes: [1.0, 1.0] };
        let leans = refined(&flat, &[], |normal| normal);
        assert!(leans[3 * columns + 5].vector()[0] < -0.0029);
        // A needle, flattened.
        let alone = of_heights(&ground);
        assert!(alone.iter().all(|found| (0..3).all(|k| (f64::from(found.vector()[k]) - normal[k]).abs() < 4e-5)));
    }

    #[test]
    fn rough_ground_is_as_its_bytes_say() {
        let (heights, places) = ground(|row, column| 40.0 * ((7.0 * row + 3.0 * column) * 12.9898).sin());
        let ground = Ground { heights: &heights, places, slopes: [1.0, 1.0] };
        let kept = bytes([0.1, -0.2, 0.7]);
        let found = refined(&ground, &vec![kept; heights.len()], |normal| normal);
        let (normal, mut same) = (normal_of(kept), 0);
        for found in &found {
            let away = [0, 1, 2].map(|k| (found.vector()[k] - normal[k]).abs() / STEPS[k]);
            assert!(away.iter().all(|away| *away < 0.51), "{away:?}");
            same += usize::from(away.iter().all(|away| *away < 0.01));
        }
        assert!(10 * same > 9 * found.len(), "{same} of {}", found.len());
        // Where nothing was measured nothing is known.
        let nothing = vec![f64::NAN; heights.len()];
        let ground = Ground { heights: &nothing, places: ground.places, slopes: [1.0, 1.0] };
        let up = MeanNormal::new([0.0, 0.0, 1.0]);
        assert!(refined(&ground, &[], |normal| normal).iter().all(|normal| *normal == up));
        assert!(of_heights(&ground).iter().all(|normal| *normal == up));
    }
}
