//! Splats that are too small to be sampled on the picture's own grid: exact integrals over each pixel.

use super::footprint::{Footprint, Lens, Shape};
use super::lanes::{self, Canvas, Circle};
use super::profile::Profiles;
use super::sphere;
use super::table::CumulativeTable;
use super::tiles::Record;
use crate::model::Kernel;
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

/// Beyond this square of the tangent of the angle off the axis, small spheres are too elongated for [`circles`] and for
/// a profile that is blurred alike in all directions.
const STEEPEST: f64 = 0.12;

/// Two displacements below this, pixels, are not worth it.
const NEAREST: f64 = 0.02;

/// A sphere in perspective that covers few pixels, as one or two circles: its image is an ellipse, longer by
/// `sec(theta)` along the radius of the picture. Two circles of half the weight, displaced along that radius, have the
/// same integral and the same second moments. None when it is no sphere, large enough for its own shape, or too long.
pub fn circles(lens: &Lens, profiles: &Profiles, footprint: &Footprint) -> [Option<Footprint>; 2] {
    let Shape::Sphere { camera, h } = footprint.shape else { return [None; 2] };
    let Some(center) = lens.center(camera) else { return [None; 2] };
    let slope = lens.slope(center);
    let tangent = slope[0] * slope[0] + slope[1] * slope[1];
    let radius = h * lens.focal() / camera.z;
    if radius >= Profiles::SMALLEST || tangent > STEEPEST {
        return [None; 2];
    }
    let circle = |side: f64, share: f64| {
        let center: [f64; 2] = std::array::from_fn(|k| center[k] + side * profiles.spread * radius * slope[k]);
        let stretch = share * (1.0 + tangent).sqrt();
        Some(Footprint {
            min: center.map(|x| x - radius),
            max: center.map(|x| x + radius),
            radius,
            amplitude: footprint.amplitude * stretch,
            amplitude_s: footprint.amplitude_s * stretch,
            shape: Shape::Circle { center },
        })
    };
    match profiles.spread * radius * tangent.sqrt() < NEAREST {
        true => [circle(0.0, 1.0), None],
        false => [circle(1.0, 0.5), circle(-1.0, 0.5)],
    }
}

/// Adds a splat of the layer of small ones.
#[inline(always)]
pub fn draw<S: Simd>(
    simd: S,
    canvas: &mut Canvas<'_>,
    lens: &Lens,
    profiles: &Profiles,
    table: &CornerTable,
    corner: [f64; 2],
    record: &Record,
) {
    if record.is_sphere() {
        let Some(footprint) = sphere::footprint(lens, record) else { return };
        let radius = footprint.radius as f32;
        let middle = [0, 1].map(|k| 0.5 * (footprint.min[k] + footprint.max[k]));
        let slope = lens.slope(middle);
        if f64::from(radius) < Profiles::SMALLEST || slope[0] * slope[0] + slope[1] * slope[1] > STEEPEST {
            sphere::subsampled(simd, canvas, lens, corner, &profiles.sampled, record);
            return;
        }
        let reach = (radius + Profiles::REACH) / radius;
        let shrink = 1.0 / (reach * reach);
        let mut blurred = *record;
        blurred.place[3] *= reach;
        blurred.amplitude *= shrink;
        blurred.amplitude_s *= shrink;
        sphere::sampled(simd, canvas, lens, corner, 1.0, profiles.blurred(radius), &blurred);
        return;
    }
    let circle = record.circle();
    if f64::from(circle.radius) < Profiles::SMALLEST {
        corners(canvas, table, &circle);
        return;
    }
    let radius = circle.radius + Profiles::REACH;
    let shrink = (circle.radius / radius).powi(2);
    let (amplitude, amplitude_s) = (circle.amplitude * shrink, circle.amplitude_s * shrink);
    let blurred = Circle { radius, amplitude, amplitude_s, ..circle };
    lanes::uniform_circles(simd, canvas, profiles.blurred(circle.radius), std::iter::once(blurred));
}
