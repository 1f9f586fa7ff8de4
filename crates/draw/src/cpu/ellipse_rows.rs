//! Small ellipses in a tile: means over pixels that add up to the flux, at a cost that grows with the number of pixels alone.
//!
//! An ellipse is cut into strips of rows of pixels, the more the further it leans within a row for its width. A strip's kernel is a sum of
//! two products of a function along the row and one across ([`super::kernel_products`]); it lies along the row where the ellipse is at the
//! mean height of its mass, widened by what it leans within itself, so that the second moments are the ellipse's own. A strip's share of
//! a pixel is a difference at the pixel's sides. Of a picture 3e-3 is left at most, of one of needles 6e-3 (relative L2).

use super::kernel_products::{HeightMoments, KernelProducts, TERMS};
use super::lanes::Canvas;
use crate::model::Kernel;
use pulp::Simd;
use std::sync::OnceLock;

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

/// Strips that a pixel of lean is divided into, where the ellipse is thin.
const LEANING: f32 = 8.0;
/// Strips that half the height of a needle is divided into, at least.
const NEEDLE: f32 = 8.0;
/// Half the height below which there is one strip in a row, cells.
const TINY: f32 = 0.25;
/// Most strips in a row of pixels.
const MOST: f32 = 4096.0;
/// Smallest half width of a strip, cells.
const NARROWEST: f32 = 1e-3;
/// Edges of strips that are found together.
const EDGES: usize = 64;
/// Share of the mass below which a strip is left out.
const LEAST: f32 = 1e-8;

/// What a kernel's strips are made of. All polynomials are in powers of `2 x^2 - 1`, in which their terms hardly cancel: what singles round
/// off would be light else.
#[derive(Clone, Copy, Debug)]
pub struct StripKernel {
    products: KernelProducts,
    moments: HeightMoments,
    per_variance: f32,
}

impl StripKernel {
    /// That of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static StripKernel {
        static STRIPS: [OnceLock<StripKernel>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        STRIPS[kernel as usize].get_or_init(|| {
            let KernelProducts { first, second } = KernelProducts::of(kernel);
            let of_heights = HeightMoments::of(kernel);
            let HeightMoments { mass, mean, square } = *of_heights;
            let moments = HeightMoments { mass: centered(&mass), mean: centered(&mean), square: centered(&square) };
            let products = KernelProducts { first: centered(&first), second: centered(&second) };
            StripKernel { products, moments, per_variance: of_heights.variance().recip() }
        })
    }
}

/// A polynomial in `z` as one in `2 z - 1`.
fn centered(coefficients: &[f32; TERMS]) -> [f32; TERMS] {
    let mut sums = [0.0_f64; TERMS];
    // Horner's scheme with `z = (y + 1) / 2`, on polynomials in `y`.
    for &coefficient in coefficients.iter().rev() {
        for power in (0..TERMS).rev() {
            let before = power.checked_sub(1).map_or(0.0, |before| sums[before]);
            sums[power] = 0.5 * (sums[power] + before);
        }
        sums[0] += f64::from(coefficient);
    }
    sums.map(|sum| sum as f32)
}

/// What lies above each of some heights: the two functions, and mass, first and second moment.
struct Above {
    heights: [f32; EDGES],
    first: [f32; EDGES],
    second: [f32; EDGES],
    mass: [f32; EDGES],
    mean: [f32; EDGES],
    square: [f32; EDGES],
}

/// Adds the integral of an ellipse over each pixel.
#[inline(always)]
pub fn add<S: Simd>(simd: S, canvas: &mut Canvas<'_>, kernel: &StripKernel, ellipse: &TileEllipse) {
    let TileEllipse { center, shear, half, clip, .. } = *ellipse;
    let (top, bottom) = (center[1] - half[1], center[1] + half[1]);
    let first = (top.max(0.0) as usize).max(clip[1][0]);
    // Casts saturate.
    let end = ((bottom.max(0.0) + 1.0) as usize).min(clip[1][1]);
    if first >= end {
        return;
    }
    let area = half[0] * half[1];
    let flux = [area * ellipse.amplitude, area * ellipse.amplitude_s];
    let lean = shear * half[1];
    // What is wide hides how its strips lean, and a needle shows them. What lies in a pixel or two is better in one piece: a row that holds
    // all of it has its exact share of each pixel then.
    let leaning = LEANING * shear.abs() / (1.0 + 0.8 * half[0] * half[0]).sqrt();
    let count = match half[1] < TINY {
        true => 1.0,
        false if lean.abs() > 3.0 * half[0] => leaning.max(NEEDLE / half[1]),
        false => leaning,
    };
    let count = count.ceil().clamp(1.0, MOST);
    let widening = lean * lean * kernel.per_variance;
    let square = half[0] * half[0];
    let per_half = half[1].recip();
    let step = per_half / count;
    let start = ((first as f64 - f64::from(center[1])) * f64::from(per_half)) as f32;
    let count = count as usize;
    // The strips that hold some of it, and one more at either end. Casts saturate.
    let at = |height: f32| (height - start) / step;
    let strips = ((at(1.0).ceil() + 1.0) as usize).min((end - first) * count);
    let numbers = numbers(simd);
    let mut above = Above {
        heights: [0.0; EDGES],
        first: [0.0; EDGES],
        second: [0.0; EDGES],
        mass: [0.0; EDGES],
        mean: [0.0; EDGES],
        square: [0.0; EDGES],
    };
    let mut done = (at(-1.0).floor() - 1.0) as usize;
    while done < strips {
        let held = (strips - done).min(EDGES - 1);
        above.find(simd, numbers, kernel, (start, step, done), held + 1);
        for k in 0..held {
            let mass = above.mass[k + 1] - above.mass[k];
            if mass < LEAST {
                continue;
            }
            let (from, to) = (above.heights[k], above.heights[k + 1]);
            let per_mass = mass.recip();
            let height = ((above.mean[k + 1] - above.mean[k]) * per_mass).clamp(from, to);
            let most = 0.25 * (to - from) * (to - from);
            let variance = ((above.square[k + 1] - above.square[k]) * per_mass - height * height).clamp(0.0, most);
            let width = (square + variance * widening).sqrt().max(NARROWEST);
            let middle = center[0] + lean * height;
            let left = ((middle - width).max(0.0) as usize).max(clip[0][0]);
            let right = (((middle + width).max(0.0) + 1.0) as usize).min(clip[0][1]);
            if left >= right {
                continue;
            }
            let along = [above.first[k + 1] - above.first[k], above.second[k + 1] - above.second[k]];
            let mut shares = [0.0; TERMS];
            for (share, (a, b)) in shares.iter_mut().zip(kernel.products.first.iter().zip(&kernel.products.second)) {
                *share = along[0] * a - along[1] * b;
            }
            let inside = Inside { left, middle, inverse: width.recip(), limit: clip[0][1] as f32 };
            let row = (first + (done + k) / count) * canvas.stride;
            let out = row + left..row + (left + (right - left).next_multiple_of(S::F32_LANES));
            spread(simd, numbers, &mut canvas.p[out.clone()], &shares, &inside, flux[0]);
            if !canvas.ps.is_empty() {
                spread(simd, numbers, &mut canvas.ps[out], &shares, &inside, flux[1]);
            }
        }
        done += held;
    }
}

impl Above {
    /// Finds what lies above the edges from number `done` on, which are `step` apart from `start`; some more than `count` of them.
    #[inline(always)]
    fn find<S: Simd>(
        &mut self,
        simd: S,
        numbers: S::f32s,
        kernel: &StripKernel,
        (start, step, done): (f32, f32, usize),
        count: usize,
    ) {
        let (low, high) = (simd.splat_f32s(-1.0), simd.splat_f32s(1.0));
        let count = count.next_multiple_of(S::F32_LANES);
        for first in (0..count).step_by(S::F32_LANES) {
            let number = simd.add_f32s(numbers, simd.splat_f32s((done + first) as f32));
            let height = simd.mul_add_e_f32s(number, simd.splat_f32s(step), simd.splat_f32s(start));
            let height = simd.min_f32s(simd.max_f32s(height, low), high);
            let square = simd.mul_f32s(height, height);
            let centered = simd.mul_add_e_f32s(square, simd.splat_f32s(2.0), low);
            let KernelProducts { first: one, second: two } = &kernel.products;
            let HeightMoments { mass, mean, square: squares } = &kernel.moments;
            let values = [
                simd.mul_f32s(polynomial(simd, one, centered), height),
                simd.mul_f32s(polynomial(simd, two, centered), height),
                simd.mul_f32s(polynomial(simd, mass, centered), height),
                simd.mul_f32s(polynomial(simd, mean, centered), square),
                simd.mul_f32s(polynomial(simd, squares, centered), simd.mul_f32s(square, height)),
                height,
            ];
            let columns = [
                &mut self.first,
                &mut self.second,
                &mut self.mass,
                &mut self.mean,
                &mut self.square,
                &mut self.heights,
            ];
            for (column, value) in columns.into_iter().zip(values) {
                simd.partial_store_f32s(&mut column[first..first + S::F32_LANES], value);
            }
        }
    }
}

/// A polynomial with coefficients in ascending order.
#[inline(always)]
fn polynomial<S: Simd>(simd: S, coefficients: &[f32; TERMS], x: S::f32s) -> S::f32s {
    let mut sum = simd.splat_f32s(coefficients[TERMS - 1]);
    for power in (0..TERMS - 1).rev() {
        sum = simd.mul_add_e_f32s(sum, x, simd.splat_f32s(coefficients[power]));
    }
    sum
}

/// Where a strip lies along its row.
#[derive(Clone, Copy)]
struct Inside {
    left: usize,
    middle: f32,
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

/// Adds a strip's share of each pixel from `left` on: `shares` are the coefficients of the odd polynomial whose differences they are.
#[inline(always)]
fn spread<S: Simd>(simd: S, numbers: S::f32s, out: &mut [f32], shares: &[f32; TERMS], inside: &Inside, flux: f32) {
    let (limit, inverse) = (simd.splat_f32s(inside.limit), simd.splat_f32s(inside.inverse));
    let (middle, flux) = (simd.splat_f32s(inside.middle), simd.splat_f32s(flux));
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
            let centered = simd.mul_add_e_f32s(simd.add_f32s(place, place), place, low);
            *end = simd.mul_f32s(polynomial(simd, shares, centered), place);
        }
        *out = simd.mul_add_e_f32s(flux, simd.sub_f32s(ends[1], ends[0]), *out);
    }
}
