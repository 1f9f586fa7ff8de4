//! Spheres in a perspective view: samples of the exact line-of-sight integral along rows of cells.

use super::footprint::{Footprint, Lens};
use super::lanes::{self, Canvas};
use super::profile::Profile;
use super::tiles::{Record, SIDE};
use glam::Vec3;
use pulp::Simd;

/// The footprint of a record that holds a sphere.
#[inline(always)]
pub fn footprint(lens: &Lens, record: &Record) -> Option<Footprint> {
    let [x, y, z, h, _] = record.place;
    lens.sphere(Vec3::new(x, y, z).as_dvec3(), f64::from(h), f64::from(record.amplitude), f64::from(record.amplitude_s))
}

/// Adds `factor * values` to `out`; the same length, a multiple of the lanes.
#[inline(always)]
pub fn add_scaled<S: Simd>(simd: S, out: &mut [f32], factor: f32, values: &[f32]) {
    let factor = simd.splat_f32s(factor);
    let ((out, _), (values, _)) = (S::as_mut_simd_f32s(out), S::as_simd_f32s(values));
    for (out, value) in out.iter_mut().zip(values) {
        *out = simd.mul_add_e_f32s(factor, *value, *out);
    }
}

/// Samples a sphere at the cell centres of a tile, `cell` pixels apart; `corner` is the buffer's corner in pixels.
#[inline(always)]
pub fn sampled<S: Simd>(
    simd: S,
    canvas: &mut Canvas<'_>,
    lens: &Lens,
    corner: [f64; 2],
    cell: f64,
    profile: &Profile,
    record: &Record,
) {
    let Some(splat) = footprint(lens, record) else { return };
    sampled_footprint(simd, canvas, lens, corner, cell, profile, &splat, [record.amplitude, record.amplitude_s]);
}

/// The same for the footprint of a sphere or an ellipsoid, with its amplitudes.
#[inline(always)]
pub fn sampled_footprint<S: Simd>(
    simd: S,
    canvas: &mut Canvas<'_>,
    lens: &Lens,
    corner: [f64; 2],
    cell: f64,
    profile: &Profile,
    splat: &Footprint,
    [amplitude, amplitude_s]: [f32; 2],
) {
    let first = |k: usize| (splat.min[k] - corner[k]) / cell + 0.5;
    let end = |k: usize| (splat.max[k] - corner[k]) / cell + 0.5;
    // Casts saturate.
    let (left, right) = ((first(0) as usize).min(canvas.columns), (end(0) as usize).min(canvas.columns));
    let (top, bottom) = ((first(1) as usize).min(canvas.rows), (end(1) as usize).min(canvas.rows));
    let width = right.saturating_sub(left).next_multiple_of(S::F32_LANES);
    let mut values = [0.0f32; SIDE + lanes::SLACK];
    let values = &mut values[..width];
    for j in top..bottom {
        let row = lens.row(splat, corner[1] + (j as f64 + 0.5) * cell);
        let x = corner[0] + left as f64 * cell;
        lanes::perspective_row(simd, profile, &row, x, cell, values);
        if let Some(depth) = row.ray {
            lanes::scale_by_rays(simd, &row, lens.ray(), depth, x, cell, values);
        }
        let start = j * canvas.stride + left;
        add_scaled(simd, &mut canvas.p[start..start + width], amplitude, values);
        if !canvas.ps.is_empty() {
            add_scaled(simd, &mut canvas.ps[start..start + width], amplitude_s, values);
        }
    }
}
