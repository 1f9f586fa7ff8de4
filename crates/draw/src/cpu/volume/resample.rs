//! Resampling (F12 5.5): particles are binned to the bricks of a slab, and each brick gathers its own, in SIMD lanes.
//!
//! Every cell holds `sum m W(|r - r_j|, h_j)` at its centre, and `sum m A W` where there is an attribute; what wide particles add is
//! interpolated from coarser grids ([`coarse`]). A brick is filled by one task in the order of the particles, so the field is the
//! same to the last bit for any number of threads.

use super::Prepared;
use super::bricks::{BRICK, Brick, BrickGrid, CELLS, Layer, Slab};
use super::coarse::{self, Interpolate, Peaks, Scratch};
use super::particles::{Particle, Projected};
use crate::model::Kernel;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// What a slab's resampling took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Pairs of a brick and a particle that reaches it.
    pub pairs: u64,
    /// Bricks that hold something.
    pub bricks: u64,
}

/// Resamples a grid from front to back. Coarser layers that more than one slab reads, and the memory of bricks, are kept.
pub struct Resampler<'a> {
    prepared: &'a Prepared,
    kernel: Kernel,
    /// Depths between which the particles of each chunk reach.
    reach: Vec<[f32; 2]>,
    /// Layers of each coarser level, for those before it.
    held: Vec<Slab>,
    /// The cells of bricks that were done with.
    spare: Mutex<Vec<Box<[f32]>>>,
    /// Densities up to this show nothing.
    least: f32,
    /// The layer that was resampled last, and for each of its bricks whether it may show.
    last: Option<(usize, Vec<bool>)>,
}

impl<'a> Resampler<'a> {
    /// Nothing is resampled yet.
    pub fn new(prepared: &'a Prepared, kernel: Kernel) -> Resampler<'a> {
        let held = vec![Slab::default(); prepared.levels.len()];
        let nothing = [f32::INFINITY, f32::NEG_INFINITY];
        let with =
            |[from, to]: [f32; 2], Particle { place: [_, _, z, h], .. }: &Particle| [from.min(z - h), to.max(z + h)];
        let reach = prepared.particles.chunks.par_iter().map(|chunk| chunk.iter().fold(nothing, with)).collect();
        Resampler { prepared, kernel, reach, held, spare: Mutex::default(), least: 0.0, last: None }
    }

    /// The same for a picture in which densities up to `least` show nothing: bricks are left out where nothing in them or next
    /// to them is denser.
    #[must_use]
    pub fn showing_above(self, least: f32) -> Resampler<'a> {
        Resampler { least, ..self }
    }

    /// Resamples `layers` of the grid, fastest if they follow those of the last call. Bricks of columns that are `hidden` (one
    /// flag for each, row by row; none for an empty slice) are left out; they have to stay hidden.
    pub fn resample(&mut self, layers: Range<usize>, hidden: &[bool]) -> (Vec<Layer>, Work) {
        let mut work = Work::default();
        let layers = self.advance(0, layers, hidden, &mut work);
        work.bricks = layers.iter().flatten().flatten().count() as u64;
        (layers, work)
    }

    /// Takes the memory of layers that are not needed any more.
    pub fn recycle(&mut self, layers: impl IntoIterator<Item = Layer>) {
        let spare = self.spare.get_mut().unwrap_or_else(PoisonError::into_inner);
        for brick in layers.into_iter().flatten().flatten() {
            spare.extend([brick.density, brick.weighted].into_iter().filter(|cells| !cells.is_empty()));
        }
    }

    /// Resamples layers of a level, after what they need of the next.
    fn advance(&mut self, level: usize, layers: Range<usize>, hidden: &[bool], work: &mut Work) -> Vec<Layer> {
        let levels = &self.prepared.levels;
        if let Some(coarser) = levels.get(level + 1) {
            let wanted = coarse::layers_read_by(&layers);
            let Slab { first, layers: mut held } = std::mem::take(&mut self.held[level + 1]);
            // What lies before is not read any more, and what is read lies in the order of the slabs.
            let done = wanted.start.checked_sub(first).map_or(held.len(), |before| before.min(held.len()));
            self.recycle(held.drain(..done));
            let missing = wanted.start + held.len()..wanted.end;
            if !missing.is_empty() {
                let hidden = coarse::hidden_by(hidden, &levels[level], coarser);
                held.extend(self.advance(level + 1, missing, &hidden, work));
            }
            self.held[level + 1] = Slab { first: wanted.start, layers: held };
        }
        self.fill(level, layers, hidden, work)
    }

    /// The bricks of some layers of a level: its own particles, and the field of the coarser levels.
    fn fill(&mut self, level: usize, layers: Range<usize>, hidden: &[bool], work: &mut Work) -> Vec<Layer> {
        let Prepared { levels, particles, .. } = self.prepared;
        let brick_grid = &levels[level];
        let own = |particle: &Particle| levels.len() == 1 || self.prepared.level_of(particle) == level;
        let [nearest, farthest] = ends(brick_grid, &layers);
        let of_chunk = |(chunk, [from, to]): (&Vec<Particle>, &[f32; 2])| match *from > farthest || *to < nearest {
            true => Vec::new(),
            false => pairs(brick_grid, chunk, own, layers.clone(), hidden),
        };
        let of_chunks: Vec<_> = particles.chunks.par_iter().zip(&self.reach).map(of_chunk).collect();
        let bins = Bins::new(layers.len() * brick_grid.of_layer(), &of_chunks);
        drop(of_chunks);
        work.pairs += bins.particles.len() as u64;
        let wanted = match level {
            0 => self.shown(&layers, hidden, &bins),
            _ => vec![true; layers.len() * brick_grid.of_layer()],
        };
        let coarser = levels.get(level + 1).map(|coarser| (coarser, &self.held[level + 1]));
        let arch = Arch::new();
        let gather = |scratch: &mut Scratch, index: usize| {
            let (layer, place) = (layers.start + index / brick_grid.of_layer(), index % brick_grid.of_layer());
            if !wanted[index] || hidden.get(place) == Some(&true) {
                return None;
            }
            let at = [place % brick_grid.bricks[0], place / brick_grid.bricks[0], layer];
            let smooth = coarser.map(|(brick_grid, slab)| {
                move |[column, row, layer]: [usize; 3]| slab.brick(column, row, layer, brick_grid)
            });
            let under = smooth.filter(|brick| coarse::around(at).any(|at| brick(at).is_some()));
            if under.is_none() && bins.of(index).is_empty() {
                return None;
            }
            let weighted = if particles.attribute { self.cells() } else { Box::default() };
            let mut brick = Brick { density: self.cells(), weighted, densest: 0.0 };
            let (corner, kernel) = (at.map(|brick| brick * BRICK), self.kernel);
            arch.dispatch(Gather { brick_grid, corner, kernel, particles, bins: &bins, index, brick: &mut brick });
            if let Some(under) = under {
                let density = |at| under(at).map(|brick: &Brick| &brick.density[..]);
                arch.dispatch(Interpolate { brick: at, cells_of: density, scratch, out: &mut brick.density });
                if particles.attribute {
                    let weighted = |at| under(at).map(|brick: &Brick| &brick.weighted[..]);
                    arch.dispatch(Interpolate { brick: at, cells_of: weighted, scratch, out: &mut brick.weighted });
                }
                if level == 0 {
                    // Cubics overshoot by a little where the field ends; a density is not negative.
                    brick.density.iter_mut().for_each(|density| *density = density.max(0.0));
                }
            }
            brick.densest = brick.density.iter().fold(0.0, |densest, density| densest.max(density.abs()));
            (brick.densest > 0.0).then_some(brick)
        };
        let bricks = (0..layers.len() * brick_grid.of_layer()).into_par_iter().map_init(Scratch::default, gather);
        let mut all: Vec<Option<Brick>> = bricks.collect();
        let mut out = Vec::with_capacity(layers.len());
        while !all.is_empty() {
            let rest = all.split_off(brick_grid.of_layer().min(all.len()));
            out.push(std::mem::replace(&mut all, rest));
        }
        out
    }

    /// For each brick of layers of the grid, whether it or one next to it may show something.
    fn shown(&mut self, layers: &Range<usize>, hidden: &[bool], bins: &Bins) -> Vec<bool> {
        let levels = &self.prepared.levels;
        let (brick_grid, of_layer) = (&levels[0], levels[0].of_layer());
        let smooth = levels.get(1).map(|coarser| Peaks::new(coarser, &self.held[1], self.least));
        let may_show = |index: usize| {
            let (layer, place) = (layers.start + index / of_layer, index % of_layer);
            let at = [place % brick_grid.bricks[0], place / brick_grid.bricks[0], layer];
            let is_hidden = hidden.get(place) == Some(&true);
            !is_hidden && (!bins.of(index).is_empty() || smooth.as_ref().is_some_and(|peaks| peaks.show(at)))
        };
        let dense: Vec<bool> = (0..layers.len() * of_layer).into_par_iter().map(may_show).collect();
        let last = dense[dense.len() - of_layer..].to_vec();
        let before = self.last.replace((layers.end - 1, last)).filter(|(layer, _)| layer + 1 == layers.start);
        let columns = brick_grid.bricks[0];
        let near = |index: usize, count: usize| index.saturating_sub(1)..(index + 2).min(count);
        let any = |layer: &[bool], place: usize| {
            let rows = near(place / columns, brick_grid.bricks[1]);
            rows.flat_map(|row| near(place % columns, columns).map(move |column| row * columns + column))
                .any(|place| layer[place])
        };
        let shown = |index: usize| {
            let (layer, place) = (index / of_layer, index % of_layer);
            // What is not known may show.
            let first = layer == 0 && layers.start > 0 && before.as_ref().is_none_or(|(_, dense)| any(dense, place));
            let last = layer + 1 == layers.len() && layers.end < brick_grid.bricks[2];
            let known = near(layer, layers.len());
            first || last || known.into_iter().any(|layer| any(&dense[layer * of_layer..(layer + 1) * of_layer], place))
        };
        (0..dense.len()).into_par_iter().map(shown).collect()
    }

    /// Cells of 0. New memory costs more than clearing old: the system hands it out page by page.
    fn cells(&self) -> Box<[f32]> {
        let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        match spare {
            Some(mut cells) => {
                cells.fill(0.0);
                cells
            }
            None => vec![0.0; CELLS].into_boxed_slice(),
        }
    }
}

/// Pairs of a brick in `layers` and a particle of a chunk that reaches it: their numbers, in the order of the particles.
fn pairs(
    brick_grid: &BrickGrid,
    chunk: &[Particle],
    own: impl Fn(&Particle) -> bool,
    layers: Range<usize>,
    hidden: &[bool],
) -> Vec<[u32; 2]> {
    let [nearest, farthest] = ends(brick_grid, &layers);
    let mut pairs = Vec::new();
    for (index, particle) in chunk.iter().enumerate() {
        let [_, _, z, h] = particle.place;
        if z - h > farthest || z + h < nearest || !own(particle) {
            continue;
        }
        for layer in layers.clone() {
            let Some([columns, rows]) = brick_grid.reached(particle, layer) else { continue };
            for row in rows[0]..=rows[1] {
                for column in columns[0]..=columns[1] {
                    let place = row * brick_grid.bricks[0] + column;
                    if hidden.get(place) != Some(&true) {
                        let brick = (layer - layers.start) * brick_grid.of_layer() + place;
                        pairs.push([brick as u32, index as u32]);
                    }
                }
            }
        }
    }
    pairs
}

/// Depths of the first and the last slice of layers.
fn ends(brick_grid: &BrickGrid, layers: &Range<usize>) -> [f32; 2] {
    [brick_grid.depth[layers.start * BRICK], brick_grid.depth[layers.end * BRICK - 1]]
}

/// Particles by the bricks that they reach.
struct Bins {
    /// Where each brick's particles start, and the end.
    starts: Vec<u32>,
    /// Chunk, and number in it.
    particles: Vec<[u32; 2]>,
}

impl Bins {
    /// Sorts the pairs of all chunks by their bricks, of which there are `count`.
    fn new(count: usize, chunks: &[Vec<[u32; 2]>]) -> Bins {
        let mut starts = vec![0u32; count + 1];
        chunks.iter().flatten().for_each(|[brick, _]| starts[*brick as usize] += 1);
        let mut next = 0;
        for start in &mut starts {
            next += std::mem::replace(start, next);
        }
        let mut cursor = starts.clone();
        let mut particles = vec![[0; 2]; next as usize];
        for (chunk, pairs) in chunks.iter().enumerate() {
            for [brick, particle] in pairs {
                let slot = &mut cursor[*brick as usize];
                particles[*slot as usize] = [chunk as u32, *particle];
                *slot += 1;
            }
        }
        Bins { starts, particles }
    }

    /// The particles of a brick.
    fn of(&self, brick: usize) -> &[[u32; 2]] {
        &self.particles[self.starts[brick] as usize..self.starts[brick + 1] as usize]
    }
}

/// One brick on its way to be filled.
struct Gather<'a> {
    brick_grid: &'a BrickGrid,
    /// Stored column, stored row and slice of its first cell.
    corner: [usize; 3],
    kernel: Kernel,
    particles: &'a Projected,
    bins: &'a Bins,
    index: usize,
    brick: &'a mut Brick,
}

impl WithSimd for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.kernel {
            Kernel::CubicSpline => self.fill::<S, true>(simd),
            Kernel::Poly6 => self.fill::<S, false>(simd),
        }
    }
}

impl Gather<'_> {
    #[inline(always)]
    fn fill<S: Simd, const SPLINE: bool>(self, simd: S) {
        for &[chunk, index] in self.bins.of(self.index) {
            let particle = &self.particles.chunks[chunk as usize][index as usize];
            add::<S, SPLINE>(simd, self.brick_grid, self.corner, particle, self.brick);
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
    let mut brick = Brick { density: cells(), weighted, densest: 0.0 };
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
        for particle in self.particles {
            match self.kernel {
                Kernel::CubicSpline => add::<S, true>(simd, self.brick_grid, [0; 3], &particle, self.brick),
                Kernel::Poly6 => add::<S, false>(simd, self.brick_grid, [0; 3], &particle, self.brick),
            }
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

/// Adds a particle to the cells of a brick that its support reaches.
#[inline(always)]
fn add<S: Simd, const SPLINE: bool>(
    simd: S,
    brick_grid: &BrickGrid,
    corner: [usize; 3],
    particle: &Particle,
    brick: &mut Brick,
) {
    let [x, y, z, h] = particle.place;
    let per_length = 1.0 / h;
    // The kernel's leading factor; what is left of it is written out below.
    let factor = if SPLINE { 8.0 / PI } else { 315.0 / (64.0 * PI) } * per_length * per_length * per_length;
    let amplitude = simd.splat_f32s(particle.mass * factor);
    let amplitude_s = simd.splat_f32s(particle.weighted * factor);
    let slices = corner[2]..corner[2] + BRICK;
    let (depths, per_cells) = (&brick_grid.depth[slices.clone()], &brick_grid.per_cell[slices.clone()]);
    let spacings = &brick_grid.spacing[slices];
    // Counted: searching is a chain of jumps that cannot be foreseen.
    let before = |end: f32| depths.iter().map(|&depth| u32::from(depth <= end)).sum::<u32>() as usize;
    let reached = before(z - h)..before(z + h);
    let [zero, half, one] = [0.0, 0.5, 1.0].map(|value| simd.splat_f32s(value));
    let [middle_x, middle_y] = [0, 1].map(|axis| brick_grid.middle[axis] - corner[axis] as f32);
    for slice in reached {
        let (per_cell, spacing) = (per_cells[slice], spacings[slice]);
        let away = (depths[slice] - z) * per_length;
        let radius = h * (1.0 - away * away).max(0.0).sqrt() * per_cell;
        // The particle's place in the cells of this slice of the brick.
        let (column, row) = (x * per_cell + middle_x, middle_y - y * per_cell);
        let range = |center: f32| {
            // Casts saturate: below zero becomes 0.
            let first = (center - radius + 0.5) as usize;
            (first, ((center + radius + 0.5).max(0.0) as usize).min(BRICK))
        };
        let ((left, right), (top, bottom)) = (range(column), range(row));
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
                let value = if SPLINE {
                    // 2 (1 - q)^3 - 8 (1/2 - q)^3, each where it is positive.
                    let q = simd.sqrt_f32s(q2);
                    let a = simd.max_f32s(simd.sub_f32s(one, q), zero);
                    let b = simd.max_f32s(simd.sub_f32s(half, q), zero);
                    let a3 = simd.mul_f32s(simd.mul_f32s(a, a), simd.add_f32s(a, a));
                    let b3 = simd.mul_f32s(simd.mul_f32s(b, b), b);
                    simd.mul_add_e_f32s(b3, simd.splat_f32s(-8.0), a3)
                } else {
                    let t = simd.max_f32s(simd.sub_f32s(one, q2), zero);
                    simd.mul_f32s(simd.mul_f32s(t, t), t)
                };
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
