//! Splats that are too small to be sampled on the picture's own grid: exact integrals over each pixel.

use super::exact::AREA_FILTER;
use super::footprint::{Footprint, Lens, Shape};
use super::lanes::{self, Canvas, Circle};
use super::profile::{Profile, Profiles};
use super::pyramid::SMALLEST_RADIUS;
use super::table::CumulativeTable;
use super::tiles::Record;
use crate::model::Kernel;
use glam::Vec3;
use pulp::Simd;
use std::sync::OnceLock;

/// The cumulative integral of the line-of-sight kernel over the whole square [-1, 1]^2 in single precision, read with
/// bilinear interpolation (error below 6e-5).
pub struct CornerTable {
    values: Vec<f32>,
}

impl CornerTable {
    const STEPS: usize = 128;

    /// The table of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static CornerTable {
        static TABLES: [OnceLock<CornerTable>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| {
            let table = CumulativeTable::of(kernel);
            let at = |i: usize| 2.0 * i as f64 / CornerTable::STEPS as f64 - 1.0;
            let row =
                |j: usize| (0..=CornerTable::STEPS).map(move |i| table.rectangle(-1.0, -1.0, at(i), at(j)) as f32);
            CornerTable { values: (0..=CornerTable::STEPS).flat_map(row).collect() }
        })
    }

    /// Grid cell and fraction of a coordinate within [-1, 1]; coordinates outside count as at the edge.
    #[inline(always)]
    fn locate(at: f32) -> (usize, f32) {
        let position = (at.clamp(-1.0, 1.0) + 1.0) * (0.5 * CornerTable::STEPS as f32);
        let index = (position as usize).min(CornerTable::STEPS - 1);
        (index, position - index as f32)
    }

    /// Integral of the kernel below `y` and left of `x`.
    #[inline(always)]
    fn at(&self, (i, u): (usize, f32), (j, v): (usize, f32)) -> f32 {
        let start = j * (CornerTable::STEPS + 1) + i;
        let lower = &self.values[start..start + 2];
        let upper = &self.values[start + CornerTable::STEPS + 1..start + CornerTable::STEPS + 3];
        let (below, above) = (lower[0] + u * (lower[1] - lower[0]), upper[0] + u * (upper[1] - upper[0]));
        below + v * (above - below)
    }
}

/// Most pixels that a splat drawn by its corners covers along one axis.
const ACROSS: usize = 2 * Profiles::SMALLEST as usize + 2;

/// Adds the integral of a circle over each pixel, from the cumulative integral at the pixels' corners: the shares add up
/// to 1 whatever the radius. The circle's radius is below [`Profiles::SMALLEST`].
#[inline(always)]
pub fn corners(canvas: &mut Canvas<'_>, table: &CornerTable, circle: &Circle) {
    let bound = |center: f32, count: usize| {
        // Casts saturate: below zero becomes 0.
        let first = (center - circle.radius) as usize;
        (first, ((center + circle.radius).max(0.0) as usize + 1).min(count).min(first + ACROSS))
    };
    let ((left, right), (top, bottom)) = (bound(circle.x, canvas.columns), bound(circle.y, canvas.rows));
    if left >= right || top >= bottom {
        return;
    }
    let inverse = 1.0 / circle.radius;
    let area = circle.radius * circle.radius;
    let (amplitude, amplitude_s) = (circle.amplitude * area, circle.amplitude_s * area);
    let mut edges = [(0usize, 0.0f32); ACROSS + 1];
    for (k, edge) in edges.iter_mut().enumerate() {
        *edge = CornerTable::locate(((left + k) as f32 - circle.x) * inverse);
    }
    let count = right - left;
    let line = |y: usize| {
        let edge = CornerTable::locate((y as f32 - circle.y) * inverse);
        let mut values = [0.0f32; ACROSS + 1];
        for k in 0..=count {
            values[k] = table.at(edges[k], edge);
        }
        values
    };
    let mut above = line(top);
    for y in top..bottom {
        let below = line(y + 1);
        let start = y * canvas.stride + left;
        for k in 0..count {
            let share = (below[k + 1] - below[k]) - (above[k + 1] - above[k]);
            canvas.p[start + k] += amplitude * share;
            if !canvas.ps.is_empty() {
                canvas.ps[start + k] += amplitude_s * share;
            }
        }
        above = below;
    }
}

/// The footprint of a record that holds a sphere.
#[inline(always)]
pub fn footprint(lens: &Lens, record: &Record) -> Option<Footprint> {
    let [x, y, z, h] = record.place;
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

/// Finest sample spacing, as a power of two of a pixel. Smaller spheres are drawn with the radius that fits.
const FINEST: u32 = 10;

/// Adds a small sphere in a perspective view, by samples on a grid so fine that its radius has [`SMALLEST_RADIUS`] or more
/// of them: each pixel takes the mean of its samples, with the ends weighted as in [`AREA_FILTER`], so that the error is
/// of sixth order in the spacing. `corner` is the buffer's corner in pixels.
#[inline(always)]
pub fn sphere<S: Simd>(
    simd: S,
    canvas: &mut Canvas<'_>,
    lens: &Lens,
    corner: [f64; 2],
    profile: &Profile,
    record: &Record,
) {
    let Some(mut splat) = footprint(lens, record) else { return };
    let power = ((SMALLEST_RADIUS / splat.radius).log2().ceil().max(1.0) as u32).min(FINEST);
    let count = 1usize << power;
    let fine = count as f64;
    let (mut amplitude, mut amplitude_s) = (record.amplitude, record.amplitude_s);
    let grow = SMALLEST_RADIUS / fine / splat.radius;
    if let (true, Shape::Sphere { camera, h }) = (grow > 1.0, splat.shape) {
        splat.shape = Shape::Sphere { camera, h: h * grow };
        amplitude /= (grow * grow) as f32;
        amplitude_s /= (grow * grow) as f32;
        for k in 0..2 {
            let (middle, half) = (0.5 * (splat.min[k] + splat.max[k]), 0.5 * (splat.max[k] - splat.min[k]));
            (splat.min[k], splat.max[k]) = (middle - half * grow, middle + half * grow);
        }
    }
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
        lanes::perspective_row(simd, profile, &row, lens.ray(), x, 1.0 / fine, values);
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
