//! Spheres in a perspective view: samples of the exact line-of-sight integral along rows of cells.

use super::exact::AREA_FILTER;
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

/// Samples along the radius of a small sphere, at least.
const SAMPLES: f64 = 4.0;

/// Finest sample spacing, as a power of two of a pixel. Smaller spheres are drawn with the radius that fits.
const FINEST: u32 = 10;

/// Adds a small sphere in a perspective view, by samples on a grid so fine that its radius has [`SAMPLES`] or more of them: each pixel takes the mean of its samples, with the ends weighted as in [`AREA_FILTER`], so that the error is
/// of sixth order in the spacing. `corner` is the buffer's corner in pixels.
#[inline(always)]
pub fn subsampled<S: Simd>(
    simd: S,
    canvas: &mut Canvas<'_>,
    lens: &Lens,
    corner: [f64; 2],
    profile: &Profile,
    record: &Record,
) {
    let Some(mut splat) = footprint(lens, record) else { return };
    let power = ((SAMPLES / splat.radius).log2().ceil().max(1.0) as u32).min(FINEST);
    let count = 1usize << power;
    let fine = count as f64;
    let share = splat.grow_to(SAMPLES / fine, lens.focal()) as f32;
    let (amplitude, amplitude_s) = (share * record.amplitude, share * record.amplitude_s);
    // Samples inside the buffer, counted from its corner.
    let span = |k: usize, cells: usize| {
        // Casts saturate.
        let first = ((splat.min[k] - corner[k]) * fine + 0.5) as usize;
        let end = ((splat.max[k] - corner[k]) * fine + 0.5) as usize;
        (first, end.min(cells * count))
    };
    let ((left, right), (top, bottom)) = (span(0, canvas.columns), span(1, canvas.rows));
    if left >= right || top >= bottom {
        return;
    }
    let width = (right - left).next_multiple_of(S::F32_LANES);
    let mut values = [0.0f32; FINE_SPAN];
    let mut sums = [[0.0f32; FINE_SPAN]; 3];
    let Some(values) = values.get_mut(..width) else { return };
    let shares = |place: usize| -> [f32; 3] {
        let mut shares = [0.0; 3];
        if place >= 2 && place + 2 < count {
            shares[1] = (1.0 / fine) as f32;
            return shares;
        }
        for (tap, offset) in (-2i64..=2).enumerate() {
            let target = (place as i64 + offset).div_euclid(count as i64) + 1;
            shares[target as usize] += (AREA_FILTER[tap.abs_diff(2)] / fine) as f32;
        }
        shares
    };
    // `sums` holds the pixel row above the current one, the current one, and the one below.
    let mut current = top / count;
    let x = corner[0] + left as f64 / fine;
    for j in top..bottom {
        if j / count != current {
            put(
                canvas,
                &sums[0][..right - left],
                current.wrapping_sub(1),
                left,
                count,
                &shares,
                amplitude,
                amplitude_s,
            );
            sums.rotate_left(1);
            sums[2][..width].fill(0.0);
            current += 1;
        }
        let row = lens.row(&splat, corner[1] + (j as f64 + 0.5) / fine);
        lanes::perspective_row(simd, profile, &row, x, 1.0 / fine, values);
        for (sum, share) in sums.iter_mut().zip(shares(j % count)) {
            if share != 0.0 {
                add_scaled(simd, &mut sum[..width], share, values);
            }
        }
    }
    for (k, sum) in sums.iter().enumerate() {
        put(canvas, &sum[..right - left], (current + k).wrapping_sub(1), left, count, &shares, amplitude, amplitude_s);
    }
}

/// Most samples along one axis of a small sphere: its long axis may be several times its short one.
const FINE_SPAN: usize = 256;

/// Adds the means over the pixels of a row of fine samples, from sample `left` on.
#[inline(always)]
fn put(
    canvas: &mut Canvas<'_>,
    sums: &[f32],
    y: usize,
    left: usize,
    count: usize,
    shares: &impl Fn(usize) -> [f32; 3],
    amplitude: f32,
    amplitude_s: f32,
) {
    if y >= canvas.rows {
        return;
    }
    for (i, &sum) in sums.iter().enumerate() {
        let sample = left + i;
        for (k, share) in shares(sample % count).into_iter().enumerate() {
            let x = (sample / count + k).wrapping_sub(1);
            if share != 0.0 && x < canvas.columns {
                canvas.p[y * canvas.stride + x] += amplitude * share * sum;
                if !canvas.ps.is_empty() {
                    canvas.ps[y * canvas.stride + x] += amplitude_s * share * sum;
                }
            }
        }
    }
}
