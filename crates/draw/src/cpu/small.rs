//! Splats that are too small to be sampled on the picture's own grid: exact integrals over each pixel.

use super::footprint::{Footprint, Lens, Shape};
use super::lanes::{self, Canvas, Circle};
use super::profile::Profiles;
use super::sphere;
use super::table::CumulativeTable;
use super::tiles::Record;
use crate::model::Kernel;
use glam::DVec3;
use pulp::Simd;
use std::sync::OnceLock;

/// The cumulative integral of the line-of-sight kernel over [-1, 1]^2 in single precision, as a sum of few products of a
/// function of `x` and one of `y`, which a kernel that depends on the distance alone nearly is.
///
/// The functions are found by cross approximation with full pivoting (Bebendorf, Numerische Mathematik 86, 2000): what is left is
/// largest somewhere, and the product of its row and its column there, over its value, leaves zero in both. The first pivot is
/// the corner, so that the integral over anything that goes right across the kernel is exact but for rounding: shares of pixels
/// add up to 1 whatever the radius. Elsewhere products and linear interpolation are off by less than 4e-5.
pub struct CornerTable {
    nodes: Vec<Node>,
}

/// The functions of a [`CornerTable`] at one coordinate.
#[derive(Clone, Copy, Default)]
struct Node {
    across: [f32; RANK],
    down: [f32; RANK],
}

/// Products in a [`CornerTable`].
const RANK: usize = 4;

impl CornerTable {
    /// Steps from 0 to 1. The functions are odd.
    const STEPS: usize = 128;

    /// The table of a kernel, computed once for the whole program.
    pub fn of(kernel: Kernel) -> &'static CornerTable {
        static TABLES: [OnceLock<CornerTable>; Kernel::ALL.len()] = [const { OnceLock::new() }; Kernel::ALL.len()];
        TABLES[kernel as usize].get_or_init(|| {
            let table = CumulativeTable::of(kernel);
            let count = CornerTable::STEPS + 1;
            let at = |i: usize| i as f64 / CornerTable::STEPS as f64;
            let mut left: Vec<f64> = (0..count * count).map(|i| table.at(at(i % count), at(i / count))).collect();
            let mut half = vec![Node::default(); count];
            for rank in 0..RANK {
                let pivot = (0..count * count).max_by(|&a, &b| left[a].abs().total_cmp(&left[b].abs())).unwrap_or(0);
                let (column, row, value) = (pivot % count, pivot / count, left[pivot]);
                let across: Vec<f64> = left[row * count..(row + 1) * count].to_vec();
                let down: Vec<f64> = (0..count).map(|j| left[j * count + column] / value).collect();
                for (i, left) in left.iter_mut().enumerate() {
                    *left -= down[i / count] * across[i % count];
                }
                for (i, node) in half.iter_mut().enumerate() {
                    (node.across[rank], node.down[rank]) = (across[i] as f32, down[i] as f32);
                }
            }
            let opposite = |node: &Node| Node { across: node.across.map(|v| -v), down: node.down.map(|v| -v) };
            CornerTable { nodes: half[1..].iter().rev().map(opposite).chain(half.iter().copied()).collect() }
        })
    }

    /// The functions at a coordinate; outside [-1, 1] as at the edge.
    #[inline(always)]
    fn at(&self, coordinate: f32, functions: impl Fn(&Node) -> [f32; RANK]) -> [f32; RANK] {
        let position = (coordinate.clamp(-1.0, 1.0) + 1.0) * CornerTable::STEPS as f32;
        let index = (position as usize).min(2 * CornerTable::STEPS - 1);
        let share = position - index as f32;
        let pair = &self.nodes[index..index + 2];
        let (before, after) = (functions(&pair[0]), functions(&pair[1]));
        let mut values = before;
        for (value, after) in values.iter_mut().zip(after) {
            *value += share * (after - *value);
        }
        values
    }
}

/// Most pixels that a splat drawn by its corners covers along one axis.
const ACROSS: usize = 2 * Profiles::SMALLEST as usize + 2;
/// The same of splats narrower than a pixel, and the radius below which they are, whatever rounding does.
const ACROSS_TINY: usize = 2;
const TINY: f32 = 0.499;

/// Adds the integral of a circle over each pixel, from the cumulative integral at the pixels' corners: the shares add up
/// to 1 whatever the radius. The circle's radius is below [`Profiles::SMALLEST`].
#[inline(always)]
pub fn corners(canvas: &mut Canvas<'_>, table: &CornerTable, circle: &Circle) {
    match circle.radius < TINY {
        true => corners_within::<ACROSS_TINY>(canvas, table, circle),
        false => corners_within::<ACROSS>(canvas, table, circle),
    }
}

/// The same for a circle that covers `ACROSS` pixels along one axis at most: those beyond it cost as much as others.
#[inline(always)]
fn corners_within<const ACROSS: usize>(canvas: &mut Canvas<'_>, table: &CornerTable, circle: &Circle) {
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
    // Differences of the functions of x over each pixel; right of the circle they are 0, so that rows need no end.
    let mut across = [[0.0f32; ACROSS]; RANK];
    let mut before = table.at((left as f32 - circle.x) * inverse, |node| node.across);
    for k in 0..ACROSS {
        let after = table.at(((left + k + 1) as f32 - circle.x) * inverse, |node| node.across);
        let ends = after.iter().zip(&before);
        across.iter_mut().zip(ends).for_each(|(row, (after, before))| row[k] = (after - before) * area);
        before = after;
    }
    let mut above = table.at((top as f32 - circle.y) * inverse, |node| node.down);
    for y in top..bottom {
        let below = table.at(((y + 1) as f32 - circle.y) * inverse, |node| node.down);
        let mut shares = [0.0f32; ACROSS];
        for rank in 0..RANK {
            let down = below[rank] - above[rank];
            for k in 0..ACROSS {
                shares[k] += down * across[rank][k];
            }
        }
        let start = y * canvas.stride + left;
        add(&mut canvas.p[start..start + ACROSS], circle.amplitude, &shares);
        if !canvas.ps.is_empty() {
            add(&mut canvas.ps[start..start + ACROSS], circle.amplitude_s, &shares);
        }
        above = below;
    }
}

/// Adds `amplitude * shares` to a part of a row.
#[inline(always)]
fn add(row: &mut [f32], amplitude: f32, shares: &[f32]) {
    for (out, share) in row.iter_mut().zip(shares) {
        *out += amplitude * share;
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
    circles_of(lens, profiles, (camera, h), [footprint.amplitude, footprint.amplitude_s])
}

/// The same of a sphere by its place in camera space, its smoothing length and its amplitudes: for most it is not worth knowing what
/// exactly they cover.
#[inline]
pub fn circles_of(
    lens: &Lens,
    profiles: &Profiles,
    (camera, h): (DVec3, f64),
    [amplitude, amplitude_s]: [f64; 2],
) -> [Option<Footprint>; 2] {
    let radius = h * lens.focal() / camera.z;
    // Not finite: it is no circle either.
    if radius.is_nan() || radius >= Profiles::SMALLEST {
        return [None; 2];
    }
    let Some(center) = lens.center(camera) else { return [None; 2] };
    let slope = lens.slope(center);
    let tangent = slope[0] * slope[0] + slope[1] * slope[1];
    if tangent > STEEPEST {
        return [None; 2];
    }
    let circle = |side: f64, share: f64| {
        let center: [f64; 2] = std::array::from_fn(|k| center[k] + side * profiles.spread * radius * slope[k]);
        let stretch = share * (1.0 + tangent).sqrt();
        Some(Footprint {
            min: center.map(|x| x - radius),
            max: center.map(|x| x + radius),
            radius,
            amplitude: amplitude * stretch,
            amplitude_s: amplitude_s * stretch,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Cumulative integrals as products, against the table that they are made of.
    #[test]
    fn few_products_are_the_cumulative_integral() {
        for kernel in Kernel::ALL {
            let (table, exact) = (CornerTable::of(kernel), CumulativeTable::of(kernel));
            let integral = |x: f64, y: f64| -> f64 {
                let (across, down) = (table.at(x as f32, |node| node.across), table.at(y as f32, |node| node.down));
                across.iter().zip(down).map(|(a, b)| f64::from(a * b)).sum()
            };
            let mut worst = 0.0f64;
            for i in 0..=200 {
                for j in 0..=200 {
                    let [x, y] = [i, j].map(|k| f64::from(k) * 0.0107 - 1.07);
                    worst = worst.max((integral(x, y) - exact.at(x, y)).abs());
                }
            }
            assert!(worst < 4e-5, "{kernel:?}: {worst}");
            // Right across the kernel nothing is lost, between nodes of the table.
            for (from, to) in [(-1.0, 1.0), (-0.25, 0.125), (0.625, 0.632_812_5)] {
                let strip = |at: &dyn Fn(f64, f64) -> f64| at(1.0, to) - at(1.0, from) - at(-1.0, to) + at(-1.0, from);
                let expected = strip(&|x, y| exact.at(x, y));
                assert!((strip(&integral) - expected).abs() < 1e-6, "{kernel:?} {from} {to}");
            }
        }
    }
}
