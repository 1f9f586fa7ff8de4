//! The inner loops of the fast path: one splat into the rows of a tile, in SIMD lanes chosen at run time.
//!
//! Coordinates are those of the tile's buffer, in cells; the centre of cell `(i, j)` lies at `(i + 0.5, j + 0.5)`.

use super::ellipse_rows::TileEllipse;
use super::footprint::Row;
use super::profile::{Profile, TERMS};
use pulp::Simd;

/// Cells beyond the last column that a row of a tile must have, for the vector that reaches over it.
pub const SLACK: usize = 32;

/// The buffer of a tile while it is drawn.
pub struct Canvas<'a> {
    /// Values in a row, at least `columns + SLACK`.
    pub stride: usize,
    /// Cells in a row.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
    /// `P`, `rows * stride` values.
    pub p: &'a mut [f32],
    /// `P S`; empty when it is not wanted.
    pub ps: &'a mut [f32],
}

/// A circle in a tile.
#[derive(Clone, Copy, Debug)]
pub struct Circle {
    /// Centre, cells.
    pub x: f32,
    /// Centre, cells.
    pub y: f32,
    /// Radius at which the profile ends, cells; at most [`WIDEST`].
    pub radius: f32,
    /// Factor on the profile for `P`.
    pub amplitude: f32,
    /// Factor on the profile for `P S`.
    pub amplitude_s: f32,
}

/// Largest radius of a [`Circle`], cells.
pub const WIDEST: f32 = 12.5;

/// The constant vectors of a profile.
struct Coefficients<S: Simd>([S::f32s; TERMS]);

impl<S: Simd> Coefficients<S> {
    #[inline(always)]
    fn new(simd: S, profile: &Profile) -> Coefficients<S> {
        // Loops instead of closures here and below: a closure that is not inlined is compiled without the wide
        // instructions, which makes every operation a call.
        let mut constants = [simd.splat_f32s(0.0); TERMS];
        for (constant, &coefficient) in constants.iter_mut().zip(profile) {
            *constant = simd.splat_f32s(coefficient);
        }
        Coefficients(constants)
    }

    /// The profile at `t = 1 - z`; zero for `t <= 0`.
    #[inline(always)]
    fn at(&self, simd: S, t: S::f32s) -> S::f32s {
        let t = simd.max_f32s(t, simd.splat_f32s(0.0));
        let y = simd.mul_add_e_f32s(t, simd.splat_f32s(2.0), simd.splat_f32s(-1.0));
        let cube = simd.mul_f32s(simd.mul_f32s(t, t), t);
        let mut sum = self.0[TERMS - 1];
        for k in (0..TERMS - 1).rev() {
            sum = simd.mul_add_e_f32s(sum, y, self.0[k]);
        }
        simd.mul_f32s(cube, sum)
    }
}

/// `0.5, 1.5, 2.5, ...` in the lanes.
#[inline(always)]
fn centers<S: Simd>(simd: S) -> S::f32s {
    let mut lanes = [0.0f32; 16];
    for (i, lane) in lanes.iter_mut().enumerate() {
        *lane = i as f32 + 0.5;
    }
    simd.partial_load_f32s(&lanes[..S::F32_LANES.min(16)])
}

/// The rows and columns whose cell centres may lie within `radius` of a coordinate, clipped.
#[inline(always)]
fn covered(center: f32, radius: f32, count: usize) -> (usize, usize) {
    // Casts saturate: below zero becomes 0.
    let first = (center - radius + 0.5) as usize;
    let end = ((center + radius + 0.5).max(0.0) as usize).min(count);
    (first, end)
}

/// Adds circles that share a profile.
#[inline(always)]
pub fn uniform_circles<S: Simd>(
    simd: S,
    canvas: &mut Canvas<'_>,
    profile: &Profile,
    splats: impl Iterator<Item = Circle>,
) {
    let coefficients = Coefficients::new(simd, profile);
    for circle in splats {
        circle_of(simd, canvas, &circle, &coefficients);
    }
}

#[inline(always)]
fn circle_of<S: Simd>(simd: S, canvas: &mut Canvas<'_>, circle: &Circle, coefficients: &Coefficients<S>) {
    let (left, right) = covered(circle.x, circle.radius, canvas.columns);
    let (top, bottom) = covered(circle.y, circle.radius, canvas.rows);
    if left >= right || top >= bottom {
        return;
    }
    let vectors = (right - left).div_ceil(S::F32_LANES);
    match vectors {
        1 => circle_rows::<S, 1>(simd, canvas, circle, coefficients, left, top..bottom),
        2 => circle_rows::<S, 2>(simd, canvas, circle, coefficients, left, top..bottom),
        3 => circle_rows::<S, 3>(simd, canvas, circle, coefficients, left, top..bottom),
        4 => circle_rows::<S, 4>(simd, canvas, circle, coefficients, left, top..bottom),
        // Narrow lanes: in pieces of four vectors.
        _ => {
            for first in (left..right).step_by(4 * S::F32_LANES) {
                circle_rows::<S, 4>(simd, canvas, circle, coefficients, first, top..bottom);
            }
        }
    }
}

/// Samples an ellipse at the cell centres of a tile.
#[inline(always)]
pub fn sampled_ellipse<S: Simd>(simd: S, canvas: &mut Canvas<'_>, profile: &Profile, ellipse: &TileEllipse) {
    let coefficients = Coefficients::new(simd, profile);
    let TileEllipse { center, shear, half, clip: [columns, rows], .. } = *ellipse;
    let (top, bottom) = covered(center[1], half[1], rows[1]);
    let inverse = half[0].recip();
    let scale = simd.splat_f32s(inverse);
    let (lanes, limit) = (centers(simd), simd.splat_f32s(columns[1] as f32));
    let (amplitude, amplitude_s) = (simd.splat_f32s(ellipse.amplitude), simd.splat_f32s(ellipse.amplitude_s));
    for j in top.max(rows[0])..bottom {
        let y = j as f32 + 0.5 - center[1];
        let rest = 1.0 - (y / half[1]) * (y / half[1]);
        if rest <= 0.0 {
            continue;
        }
        let middle = center[0] + shear * y;
        let (left, right) = covered(middle, half[0] * rest.sqrt(), columns[1]);
        let left = left.max(columns[0]);
        if left >= right {
            continue;
        }
        let (rest, start) = (simd.splat_f32s(rest), j * canvas.stride + left);
        let width = (right - left).next_multiple_of(S::F32_LANES);
        for first in (0..width).step_by(S::F32_LANES) {
            let x = simd.add_f32s(lanes, simd.splat_f32s((left + first) as f32));
            let along = simd.mul_f32s(simd.sub_f32s(x, simd.splat_f32s(middle)), scale);
            let t = simd.sub_f32s(rest, simd.mul_f32s(along, along));
            // Nothing beyond the part that is drawn: its columns are half a cell or more away from the limit.
            let t = simd.min_f32s(t, simd.mul_f32s(simd.sub_f32s(limit, x), simd.splat_f32s(2.0)));
            let value = [coefficients.at(simd, t)];
            let out = start + first..start + first + S::F32_LANES;
            accumulate(simd, &mut canvas.p[out.clone()], amplitude, &value);
            if !canvas.ps.is_empty() {
                accumulate(simd, &mut canvas.ps[out], amplitude_s, &value);
            }
        }
    }
}

/// The rows of a circle, `N` vectors each from column `left` on.
#[inline(always)]
fn circle_rows<S: Simd, const N: usize>(
    simd: S,
    canvas: &mut Canvas<'_>,
    circle: &Circle,
    coefficients: &Coefficients<S>,
    left: usize,
    rows: std::ops::Range<usize>,
) {
    let scale = 1.0 / (circle.radius * circle.radius);
    let lanes = centers(simd);
    let mut squares = [lanes; N];
    for (k, square) in squares.iter_mut().enumerate() {
        let offset = (left + k * S::F32_LANES) as f32 - circle.x;
        let x = simd.add_f32s(lanes, simd.splat_f32s(offset));
        *square = simd.mul_f32s(simd.mul_f32s(x, x), simd.splat_f32s(scale));
    }
    let amplitude = simd.splat_f32s(circle.amplitude);
    let amplitude_s = simd.splat_f32s(circle.amplitude_s);
    let width = N * S::F32_LANES;
    for j in rows {
        let y = j as f32 + 0.5 - circle.y;
        let height = simd.splat_f32s(1.0 - y * y * scale);
        let start = j * canvas.stride + left;
        let mut values = squares;
        for value in &mut values {
            *value = coefficients.at(simd, simd.sub_f32s(height, *value));
        }
        accumulate(simd, &mut canvas.p[start..start + width], amplitude, &values);
        if !canvas.ps.is_empty() {
            accumulate(simd, &mut canvas.ps[start..start + width], amplitude_s, &values);
        }
    }
}

#[inline(always)]
fn accumulate<S: Simd, const N: usize>(simd: S, row: &mut [f32], amplitude: S::f32s, values: &[S::f32s; N]) {
    let (vectors, _) = S::as_mut_simd_f32s(row);
    for (out, value) in vectors.iter_mut().zip(values) {
        *out = simd.mul_add_e_f32s(amplitude, *value, *out);
    }
}

/// Evaluates the profile along a row of cells in a perspective view: `q^2` as in [`Row`], for `out.len()` cells (a
/// multiple of the lanes) from the pixel coordinate `x` on, `step` pixels apart.
#[inline(always)]
pub fn perspective_row<S: Simd>(simd: S, profile: &Profile, row: &Row, x: f64, step: f64, out: &mut [f32]) {
    let coefficients = Coefficients::new(simd, profile);
    // Along the row in units of the numerator's root and of the ray's slope.
    let root = row.curvature.sqrt();
    let (along_step, along_start) = (simd.splat_f32s((step * root) as f32), (x - row.middle) * root);
    let (slope_step, slope_start) = (simd.splat_f32s((step * row.slope) as f32), (x - row.axis) * row.slope);
    let (offset, depth) = (simd.splat_f32s((row.offset) as f32), simd.splat_f32s((row.depth) as f32));
    let lanes = centers(simd);
    let (vectors, _) = S::as_mut_simd_f32s(out);
    for (k, out) in vectors.iter_mut().enumerate() {
        let cell = (k * S::F32_LANES) as f64;
        let along = simd.mul_add_e_f32s(lanes, along_step, simd.splat_f32s((along_start + cell * step * root) as f32));
        let slope =
            simd.mul_add_e_f32s(lanes, slope_step, simd.splat_f32s((slope_start + cell * step * row.slope) as f32));
        let numerator = simd.mul_add_e_f32s(along, along, offset);
        let denominator = simd.mul_add_e_f32s(slope, slope, depth);
        let square = simd.div_f32s(numerator, denominator);
        *out = coefficients.at(simd, simd.sub_f32s(simd.splat_f32s(1.0), square));
    }
}

/// Multiplies what [`perspective_row`] has evaluated by the ray's length over the root of the row's denominator: see
/// [`Row::ray`], whose value is `depth`. `ray` is [`super::footprint::Lens::ray`].
#[inline(always)]
pub fn scale_by_rays<S: Simd>(simd: S, row: &Row, ray: [f64; 2], depth: f64, x: f64, step: f64, out: &mut [f32]) {
    let lanes = centers(simd);
    let (own_step, ray_step) = (simd.splat_f32s((step * row.slope) as f32), simd.splat_f32s((step * ray[1]) as f32));
    let (own_depth, ray_depth) = (simd.splat_f32s(row.depth as f32), simd.splat_f32s(depth as f32));
    let (vectors, _) = S::as_mut_simd_f32s(out);
    for (k, out) in vectors.iter_mut().enumerate() {
        let start = x + (k * S::F32_LANES) as f64 * step;
        let own = simd.mul_add_e_f32s(lanes, own_step, simd.splat_f32s(((start - row.axis) * row.slope) as f32));
        let slope = simd.mul_add_e_f32s(lanes, ray_step, simd.splat_f32s(((start - ray[0]) * ray[1]) as f32));
        let length = simd.mul_add_e_f32s(slope, slope, ray_depth);
        let ratio = simd.div_f32s(length, simd.mul_add_e_f32s(own, own, own_depth));
        *out = simd.mul_f32s(*out, simd.sqrt_f32s(ratio));
    }
}
