//! Small ellipses in a tile: means over pixels that add up to the flux, at a cost that grows with the number of pixels alone.
//!
//! An ellipse is cut into strips of a fraction of its height and of a pixel. Each strip has its exact share of the flux
//! ([`super::row_shares`]), which lies along the row at its flux's mean height, widened by what the strip leans within itself,
//! so that the second moments are the ellipse's own. A strip's share of a pixel is the difference of the cumulative share at the
//! pixel's sides. Of the peak, what is left is below 1e-3.

use super::lanes::Canvas;
use super::profile::TERMS;
use super::row_shares::{RowShares, Shape};
use pulp::Simd;

/// An ellipse in a tile's buffer, in cells: see [`super::ellipse::Ellipse`].
#[derive(Clone, Copy, Debug)]
pub struct TileEllipse {
    /// Centre.
    pub center: [f32; 2],
    /// By how much the middle of a row lies further to the right than that of the row above it.
    pub shear: f32,
    /// Half the width of the row through the centre, and half the height of the whole.
    pub half: [f32; 2],
    /// Factor on the profile for `P`.
    pub amplitude: f32,
    /// Factor on the profile for `P S`.
    pub amplitude_s: f32,
    /// First and last columns, then rows, that it is drawn in; the last is not.
    pub clip: [[usize; 2]; 2],
}

/// Strips that a pixel of lean is divided into.
const LEANING: f32 = 6.0;
/// Strips that half the height is divided into, at least.
const STRIPS: f32 = 5.0;
/// Most strips in a row of pixels.
const MOST: f32 = 4096.0;
/// Variance of leaning, in units of the chord, at which half of a strip's tilt is seen.
const EVEN: f32 = 0.1;
/// Smallest half width of a strip, cells.
const NARROWEST: f32 = 1e-3;

/// Adds the integral of an ellipse over each pixel.
#[inline(always)]
pub fn add<S: Simd>(simd: S, canvas: &mut Canvas<'_>, rows: &RowShares, ellipse: &TileEllipse) {
    let TileEllipse { center, shear, half, clip, .. } = *ellipse;
    let (top, bottom) = (center[1] - half[1], center[1] + half[1]);
    let first = (top.max(0.0) as usize).max(clip[1][0]);
    // Casts saturate.
    let end = ((bottom.max(0.0) + 1.0) as usize).min(clip[1][1]);
    let area = half[0] * half[1];
    let flux = [0.5 * area * ellipse.amplitude, 0.5 * area * ellipse.amplitude_s];
    // What is wide hides how its strips lean.
    let leaning = LEANING * shear.abs() / (1.0 + 0.8 * half[0] * half[0]).sqrt();
    let lean = shear * half[1];
    // What is far smaller than a pixel lies in one, whatever it looks like.
    let strips = STRIPS.min(2.0 + 4.0 * half[0].max(lean.abs()));
    // What leans by more than its width shows its strips.
    let sliver = lean * lean / (lean * lean + 9.0 * half[0] * half[0]);
    let per_cell = leaning.max(strips * (1.0 + 1.2 * sliver) / half[1]);
    let per_half = f64::from(half[1]).recip();
    let height = |y: f32| (f64::from(y) - f64::from(center[1])) * per_half;
    let numbers = numbers(simd);
    let slant = (lean / half[0]) * (lean / half[0]);
    for j in first..end {
        let (from, to) = (top.max(j as f32), bottom.min((j + 1) as f32));
        if from >= to {
            continue;
        }
        let count = ((to - from) * per_cell).ceil().clamp(1.0, MOST);
        let (mut last, step) = (height(from), f64::from((to - from) / count) * per_half);
        let start = j * canvas.stride;
        let mut above = rows.above(last);
        for k in 1..=count as usize {
            let next = if k == count as usize { height(to) } else { last + step };
            let below = rows.above(next);
            let strip = rows.strip([last, next], &above, &below);
            (above, last) = (below, next);
            let Some(strip) = strip else { continue };
            // The variance of the chord's length is that of the heights.
            let chord = (1.0 - strip.height * strip.height - strip.variance).max(1e-6);
            let per_chord = slant * chord.recip();
            let leaning = per_chord * strip.variance;
            // What leans further than it is wide has its flux to one side, as the strip has it above or below its middle.
            let tilted = strip.tilt * leaning / (leaning + EVEN);
            let leaning = leaning + per_chord * tilted * tilted;
            let shape = rows.shape(strip.height, leaning);
            let width = half[0] * (chord * (shape.chord + leaning) * shape.per_variance).sqrt();
            let width = width.max(NARROWEST);
            let middle = center[0] + lean * (strip.height - tilted);
            let inverse = width.recip();
            let tilt = (0.75 * lean * tilted * inverse).clamp(-0.25, 0.25);
            let left = ((middle - width).max(0.0) as usize).max(clip[0][0]);
            let right = (((middle + width).max(0.0) + 1.0) as usize).min(clip[0][1]);
            if left >= right {
                continue;
            }
            let inside = Inside { left, middle, tilt, inverse, limit: clip[0][1] as f32 };
            let out = start + left..start + (left + (right - left).next_multiple_of(S::F32_LANES));
            spread(simd, numbers, &mut canvas.p[out.clone()], &shape, &inside, flux[0] * strip.share);
            if !canvas.ps.is_empty() {
                spread(simd, numbers, &mut canvas.ps[out], &shape, &inside, flux[1] * strip.share);
            }
        }
    }
}

/// Where a strip lies along its row.
#[derive(Clone, Copy)]
struct Inside {
    left: usize,
    middle: f32,
    /// A quarter of the density's slope, from -1 to 1 times the mean density.
    tilt: f32,
    inverse: f32,
    /// Where the part that is drawn ends.
    limit: f32,
}

/// `0, 1, 2, ...` in the lanes.
#[inline(always)]
fn numbers<S: Simd>(simd: S) -> S::f32s {
    let mut lanes = [0.0f32; 16];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = i as f32;
    }
    simd.partial_load_f32s(&lanes[..S::F32_LANES.min(16)])
}

/// Adds a strip's share of each pixel from `left` on.
#[inline(always)]
fn spread<S: Simd>(simd: S, numbers: S::f32s, out: &mut [f32], shape: &Shape, inside: &Inside, flux: f32) {
    let (limit, inverse) = (simd.splat_f32s(inside.limit), simd.splat_f32s(inside.inverse));
    let (middle, flux) = (simd.splat_f32s(inside.middle), simd.splat_f32s(flux));
    let tilt = simd.splat_f32s(inside.tilt);
    let (low, high) = (simd.splat_f32s(-1.0), simd.splat_f32s(1.0));
    let (vectors, _) = S::as_mut_simd_f32s(out);
    for (k, out) in vectors.iter_mut().enumerate() {
        let begin = simd.add_f32s(numbers, simd.splat_f32s((inside.left + k * S::F32_LANES) as f32));
        let finish = simd.min_f32s(simd.add_f32s(begin, high), limit);
        let begin = simd.min_f32s(begin, limit);
        let mut ends = [begin, finish];
        for end in &mut ends {
            let place = simd.mul_f32s(simd.sub_f32s(*end, middle), inverse);
            let place = simd.min_f32s(simd.max_f32s(place, low), high);
            let y = simd.mul_add_e_f32s(simd.add_f32s(place, place), place, low);
            let mut sum = simd.splat_f32s(shape.share[TERMS - 1]);
            for power in (0..TERMS - 1).rev() {
                sum = simd.mul_add_e_f32s(sum, y, simd.splat_f32s(shape.share[power]));
            }
            *end = simd.mul_add_e_f32s(place, sum, simd.mul_f32s(tilt, y));
        }
        *out = simd.mul_add_e_f32s(flux, simd.sub_f32s(ends[1], ends[0]), *out);
    }
}
