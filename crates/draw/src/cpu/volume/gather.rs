//! What a brick gathers of the particles that reach it, in SIMD lanes.

use super::bricks::{BRICK, Brick, BrickGrid, CELLS};
use super::particles::{Particle, Projected};
use super::stretched::Stretched;
use crate::model::Kernel;
use pulp::{Arch, Simd, WithSimd};
use std::f32::consts::PI;

// Kernels by their number, so that inner loops are compiled for each.
const CUBIC_SPLINE: usize = Kernel::CubicSpline as usize;
const POLY6: usize = Kernel::Poly6 as usize;
const QUARTIC_SPLINE: usize = Kernel::QuarticSpline as usize;
const QUINTIC_SPLINE: usize = Kernel::QuinticSpline as usize;
const WENDLAND_C2: usize = Kernel::WendlandC2 as usize;
const WENDLAND_C4: usize = Kernel::WendlandC4 as usize;
const WENDLAND_C6: usize = Kernel::WendlandC6 as usize;

/// One brick on its way to be filled.
pub struct Gather<'a> {
    /// The bricks of its level.
    pub brick_grid: &'a BrickGrid,
    /// Stored column, stored row and slice of its first cell.
    pub corner: [usize; 3],
    /// The kernel.
    pub kernel: Kernel,
    /// The particles.
    pub particles: &'a Projected,
    /// Those that reach the brick: chunks, and numbers in them.
    pub pairs: &'a [[u32; 2]],
    /// Its cells.
    pub brick: &'a mut Brick,
}

/// Has `fill` of something run that is compiled for its kernel.
macro_rules! fill_of_kernel {
    ($own:ident, $simd:ident) => {
        match $own.kernel {
            Kernel::CubicSpline => $own.fill::<S, CUBIC_SPLINE>($simd),
            Kernel::Poly6 => $own.fill::<S, POLY6>($simd),
            Kernel::QuarticSpline => $own.fill::<S, QUARTIC_SPLINE>($simd),
            Kernel::QuinticSpline => $own.fill::<S, QUINTIC_SPLINE>($simd),
            Kernel::WendlandC2 => $own.fill::<S, WENDLAND_C2>($simd),
            Kernel::WendlandC4 => $own.fill::<S, WENDLAND_C4>($simd),
            Kernel::WendlandC6 => $own.fill::<S, WENDLAND_C6>($simd),
        }
    };
}

impl WithSimd for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        fill_of_kernel!(self, simd);
    }
}

impl Gather<'_> {
    #[inline(always)]
    fn fill<S: Simd, const KERNEL: usize>(self, simd: S) {
        for &[chunk, index] in self.pairs {
            let particle = &self.particles.chunks[chunk as usize][index as usize];
            match self.particles.shapes[chunk as usize].get(index as usize) {
                None => add::<S, KERNEL>(simd, self.brick_grid, self.corner, particle, self.brick),
                Some(shape) => {
                    add_stretched::<S, KERNEL>(simd, self.brick_grid, self.corner, (particle, shape), self.brick);
                }
            }
        }
    }
}

/// The only brick of a grid that has no other; `None` where nothing is.
pub fn lone_brick(
    brick_grid: &BrickGrid,
    particles: impl Iterator<Item = Particle>,
    attribute: bool,
    kernel: Kernel,
) -> Option<Brick> {
    let cells = || vec![0.0f32; CELLS].into_boxed_slice();
    let weighted = if attribute { cells() } else { Box::default() };
    let mut brick =
        Brick { density: cells(), weighted, surface: Box::default(), opacity: Box::default(), densest: 0.0 };
    Arch::new().dispatch(Alone { brick_grid, kernel, particles, brick: &mut brick });
    brick.densest = brick.density.iter().copied().fold(0.0, f32::max);
    (brick.densest > 0.0).then_some(brick)
}

/// A brick without others, and what fills it.
struct Alone<'a, I> {
    brick_grid: &'a BrickGrid,
    kernel: Kernel,
    particles: I,
    brick: &'a mut Brick,
}

impl<I: Iterator<Item = Particle>> WithSimd for Alone<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        fill_of_kernel!(self, simd);
    }
}

impl<I: Iterator<Item = Particle>> Alone<'_, I> {
    #[inline(always)]
    fn fill<S: Simd, const KERNEL: usize>(self, simd: S) {
        for particle in self.particles {
            add::<S, KERNEL>(simd, self.brick_grid, [0; 3], &particle, self.brick);
        }
    }
}

/// `0.5, 1.5, 2.5, ...` over a row of a brick.
const CENTERS: [f32; BRICK] = {
    let mut centers = [0.0; BRICK];
    let mut i = 0;
    while i < BRICK {
        centers[i] = i as f32 + 0.5;
        i += 1;
    }
    centers
};

/// Adds `factor * values` to cells, of which there are as many as lanes.
#[inline(always)]
fn add_scaled<S: Simd>(simd: S, cells: &mut [f32], factor: S::f32s, values: S::f32s) {
    let (vectors, _) = S::as_mut_simd_f32s(cells);
    for out in vectors {
        *out = simd.mul_add_e_f32s(factor, values, *out);
    }
}

/// The kernel at squared distances in units of its support, but for its leading factor ([`leading`]).
#[inline(always)]
fn profile<S: Simd, const KERNEL: usize>(simd: S, q2: S::f32s) -> S::f32s {
    let [zero, half, one] = [0.0, 0.5, 1.0].map(|value| simd.splat_f32s(value));
    if KERNEL == CUBIC_SPLINE {
        // 2 (1 - q)^3 - 8 (1/2 - q)^3, each where it is positive.
        let q = simd.sqrt_f32s(q2);
        let a = simd.max_f32s(simd.sub_f32s(one, q), zero);
        let b = simd.max_f32s(simd.sub_f32s(half, q), zero);
        let a3 = simd.mul_f32s(simd.mul_f32s(a, a), simd.add_f32s(a, a));
        let b3 = simd.mul_f32s(simd.mul_f32s(b, b), b);
        return simd.mul_add_e_f32s(b3, simd.splat_f32s(-8.0), a3);
    }
    if KERNEL == POLY6 {
        let t = simd.max_f32s(simd.sub_f32s(one, q2), zero);
        return simd.mul_f32s(simd.mul_f32s(t, t), t);
    }
    let q = simd.sqrt_f32s(q2);
    let [left, square, fourth] = until::<S>(simd, q, 1.0);
    match KERNEL {
        QUARTIC_SPLINE => {
            // (1 - q)^4 - 5 (3/5 - q)^4 + 10 (1/5 - q)^4, each where its base is positive.
            let ([.., b], [.., c]) = (until::<S>(simd, q, 0.6), until::<S>(simd, q, 0.2));
            simd.mul_add_e_f32s(c, simd.splat_f32s(10.0), simd.mul_add_e_f32s(b, simd.splat_f32s(-5.0), fourth))
        }
        QUINTIC_SPLINE => {
            // (1 - q)^5 - 6 (2/3 - q)^5 + 15 (1/3 - q)^5, each where its base is positive.
            let [b, _, b4] = until::<S>(simd, q, 2.0 / 3.0);
            let [c, _, c4] = until::<S>(simd, q, 1.0 / 3.0);
            let (a5, b5, c5) = (simd.mul_f32s(left, fourth), simd.mul_f32s(b, b4), simd.mul_f32s(c, c4));
            simd.mul_add_e_f32s(c5, simd.splat_f32s(15.0), simd.mul_add_e_f32s(b5, simd.splat_f32s(-6.0), a5))
        }
        // (1 - q)^4 (1 + 4 q)
        WENDLAND_C2 => simd.mul_f32s(fourth, polynomial::<S, 2>(simd, q, [1.0, 4.0])),
        // (1 - q)^6 (1 + 6 q + 35/3 q^2)
        WENDLAND_C4 => {
            let sixth = simd.mul_f32s(fourth, square);
            simd.mul_f32s(sixth, polynomial::<S, 3>(simd, q, [1.0, 6.0, 35.0 / 3.0]))
        }
        // (1 - q)^8 (1 + 8 q + 25 q^2 + 32 q^3)
        _ => {
            let eighth = simd.mul_f32s(fourth, fourth);
            simd.mul_f32s(eighth, polynomial::<S, 4>(simd, q, [1.0, 8.0, 25.0, 32.0]))
        }
    }
}

/// What is left up to an end, its square and its fourth power; zero beyond.
#[inline(always)]
fn until<S: Simd>(simd: S, q: S::f32s, end: f32) -> [S::f32s; 3] {
    let left = simd.max_f32s(simd.sub_f32s(simd.splat_f32s(end), q), simd.splat_f32s(0.0));
    let square = simd.mul_f32s(left, left);
    [left, square, simd.mul_f32s(square, square)]
}

/// A polynomial with coefficients in ascending order.
#[inline(always)]
fn polynomial<S: Simd, const TERMS: usize>(simd: S, q: S::f32s, coefficients: [f32; TERMS]) -> S::f32s {
    let mut sum = simd.splat_f32s(coefficients[TERMS - 1]);
    for power in (0..TERMS - 1).rev() {
        sum = simd.mul_add_e_f32s(sum, q, simd.splat_f32s(coefficients[power]));
    }
    sum
}

/// The kernel's leading factor.
pub const fn leading(kernel: Kernel) -> f32 {
    match kernel {
        Kernel::CubicSpline => 8.0 / PI,
        Kernel::Poly6 => 315.0 / (64.0 * PI),
        other => other.factor() as f32,
    }
}

/// Adds a particle to the cells of a brick that its support reaches.
#[inline(always)]
fn add<S: Simd, const KERNEL: usize>(
    simd: S,
    brick_grid: &BrickGrid,
    corner: [usize; 3],
    particle: &Particle,
    brick: &mut Brick,
) {
    let [x, y, z, h] = particle.place;
    let per_length = 1.0 / h;
    let factor = leading(Kernel::ALL[KERNEL]) * per_length * per_length * per_length;
    let amplitude = simd.splat_f32s(particle.mass * factor);
    let amplitude_s = simd.splat_f32s(particle.weighted * factor);
    let slices = corner[2]..corner[2] + BRICK;
    let (depths, per_cells) = (&brick_grid.depth[slices.clone()], &brick_grid.per_cell[slices.clone()]);
    let spacings = &brick_grid.spacing[slices];
    // Counted: searching is a chain of jumps that cannot be foreseen.
    let before = |end: f32| depths.iter().map(|&depth| u32::from(depth <= end)).sum::<u32>() as usize;
    let reached = before(z - h)..before(z + h);
    let [middle_x, middle_y] = [0, 1].map(|axis| brick_grid.middle[axis] - corner[axis] as f32);
    for slice in reached {
        let (per_cell, spacing) = (per_cells[slice], spacings[slice]);
        let away = (depths[slice] - z) * per_length;
        let radius = h * (1.0 - away * away).max(0.0).sqrt() * per_cell;
        // The particle's place in the cells of this slice of the brick.
        let (column, row) = (x * per_cell + middle_x, middle_y - y * per_cell);
        let ((left, right), (top, bottom)) = (cells(column, radius), cells(row, radius));
        if left >= right || top >= bottom {
            continue;
        }
        let cell = spacing * per_length;
        let (scale, shift, base) = (simd.splat_f32s(cell), simd.splat_f32s(column), away * away);
        // Most particles are a few cells wide: one vector, wherever it begins, holds what two may share that begin at fixed places.
        let lanes = S::F32_LANES;
        let first = if right - left <= lanes { left.min(BRICK - lanes) } else { left / lanes * lanes };
        for first in (first..right).step_by(lanes) {
            let (centers, _) = S::as_simd_f32s(&CENTERS[first..first + lanes]);
            let dx = simd.mul_f32s(simd.sub_f32s(centers[0], shift), scale);
            let dx2 = simd.mul_f32s(dx, dx);
            for j in top..bottom {
                let dy = (j as f32 + 0.5 - row) * cell;
                let q2 = simd.add_f32s(dx2, simd.splat_f32s(base + dy * dy));
                let value = profile::<S, KERNEL>(simd, q2);
                let start = (slice * BRICK + j) * BRICK + first;
                let cells = start..start + lanes;
                add_scaled(simd, &mut brick.density[cells.clone()], amplitude, value);
                if let Some(weighted) = brick.weighted.get_mut(cells) {
                    add_scaled(simd, weighted, amplitude_s, value);
                }
            }
        }
    }
}

/// The same of an ellipsoid, row by row: see [`super::stretched`].
#[inline(always)]
fn add_stretched<S: Simd, const KERNEL: usize>(
    simd: S,
    brick_grid: &BrickGrid,
    corner: [usize; 3],
    (particle, shape): (&Particle, &Stretched),
    brick: &mut Brick,
) {
    let [x, y, z, _] = particle.place;
    let [xx, xy, xz, yy, yz, zz] = shape.factor;
    let [per_x, per_y, per_z] = [xx, yy, zz].map(f32::recip);
    let factor = leading(Kernel::ALL[KERNEL]) * per_x * per_y * per_z;
    let amplitude = simd.splat_f32s(particle.mass * factor);
    let amplitude_s = simd.splat_f32s(particle.weighted * factor);
    let slices = corner[2]..corner[2] + BRICK;
    let (depths, per_cells) = (&brick_grid.depth[slices.clone()], &brick_grid.per_cell[slices.clone()]);
    let spacings = &brick_grid.spacing[slices];
    let before = |end: f32| depths.iter().map(|&depth| u32::from(depth <= end)).sum::<u32>() as usize;
    let [middle_x, middle_y] = [0, 1].map(|axis| brick_grid.middle[axis] - corner[axis] as f32);
    let lanes = S::F32_LANES;
    for slice in before(z - zz)..before(z + zz) {
        let (per_cell, spacing) = (per_cells[slice], spacings[slice]);
        let deep = (depths[slice] - z) * per_z;
        // The ellipse in this slice, in the brick's cells.
        let (column, row) = ((x + xz * deep) * per_cell + middle_x, middle_y - (y + yz * deep) * per_cell);
        let (top, bottom) = cells(row, yy * (1.0 - deep * deep).max(0.0).sqrt() * per_cell);
        let scale = simd.splat_f32s(spacing * per_x);
        for j in top..bottom {
            // Rows go downwards.
            let high = (row - (j as f32 + 0.5)) * spacing * per_y;
            let base = deep * deep + high * high;
            let middle = column + xy * high * per_cell;
            let (left, right) = cells(middle, xx * (1.0 - base).max(0.0).sqrt() * per_cell);
            if left >= right {
                continue;
            }
            let (shift, base) = (simd.splat_f32s(middle), simd.splat_f32s(base));
            let first = if right - left <= lanes { left.min(BRICK - lanes) } else { left / lanes * lanes };
            for first in (first..right).step_by(lanes) {
                let (centers, _) = S::as_simd_f32s(&CENTERS[first..first + lanes]);
                let across = simd.mul_f32s(simd.sub_f32s(centers[0], shift), scale);
                let value = profile::<S, KERNEL>(simd, simd.mul_add_e_f32s(across, across, base));
                let start = (slice * BRICK + j) * BRICK + first;
                let cells = start..start + lanes;
                add_scaled(simd, &mut brick.density[cells.clone()], amplitude, value);
                if let Some(weighted) = brick.weighted.get_mut(cells) {
                    add_scaled(simd, weighted, amplitude_s, value);
                }
            }
        }
    }
}

/// The cells of a brick's row or column whose centres lie within a radius, first and end.
#[inline(always)]
fn cells(center: f32, radius: f32) -> (usize, usize) {
    // Casts saturate: below zero becomes 0.
    let first = (center - radius + 0.5) as usize;
    (first, ((center + radius + 0.5).max(0.0) as usize).min(BRICK))
}
