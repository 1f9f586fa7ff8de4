//! Volumes of particles that are not all there at once, as of pages that do not fit into memory together: each part of the grid is filled
//! with those that reach into it, a portion after the other. A cell's sum goes on where the portion before has left it and particles always
//! come in the same order, so that the picture has the bits that it has with all of them at hand.
//!
//! What reaches into several slabs is supplied for each of them, and once more for each coarser grid ([`coarse`]) that particles of its
//! size may belong to. What only hidden columns of bricks would see is not supplied, and nothing is once all rays have ended.

use super::attributes::Column;
use super::bricks::{BRICK, BrickGrid};
use super::particles::{Particle, Projected, Taken, project};
use super::resample::{Resampler, ends};
use super::stretched::Body;
use super::{Prepared, Scenery, VolumeError, VolumeOptions, VolumeReport, cast, coarse, extents};
use crate::color::Colors;
use crate::cpu::Splats;
use crate::view::perspective_grid::GridError;
use crate::view::{Extent, Projection, View};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Bytes that a particle of a portion takes at most, about: projected, and paired with the bricks that it reaches, which are sorted into another
/// place. What belongs to a level is narrower than two bricks of it, so that it reaches three along each axis.
pub const PARTICLE_BYTES: u64 = (size_of::<Particle>() + 2 * 27 * size_of::<[u32; 2]>()) as u64;

/// Particles in groups that lie together, of which not all are there at once. Groups of ellipsoids come after all others.
pub trait Supply: Send {
    /// The extents of the groups that have particles, as [`extents::of`] finds them.
    fn extents(&self) -> Vec<Extent>;

    /// Number of particles.
    fn particles(&self) -> u64;

    /// Whether they have an attribute.
    fn has_attribute(&self) -> bool;

    /// Bytes that the cells of a slab may take.
    fn slab_bytes(&self) -> u64;

    /// Hands over the groups whose extents are wanted, some at a time and always in the same order. Where that fails the rest is left out; whoever
    /// supplies knows why.
    fn supply(&mut self, is_wanted: &dyn Fn(&Extent) -> bool, each: &mut dyn FnMut(&[Splats<'_>]));
}

/// Some layers of a grid, or of a coarser level.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// The level; 0 is the grid.
    pub level: usize,
    /// Its layers.
    pub layers: &'a Range<usize>,
    /// For each column of bricks, row by row, whether it is hidden; none for an empty slice.
    pub hidden: &'a [bool],
}

impl Part<'_> {
    /// Column, row and layer of one of its bricks.
    pub fn brick_at(&self, brick_grid: &BrickGrid, index: usize) -> [usize; 3] {
        let (layer, place) = (index / brick_grid.of_layer(), index % brick_grid.of_layer());
        [place % brick_grid.bricks[0], place / brick_grid.bricks[0], self.layers.start + layer]
    }

    /// Whether particles within an extent may reach a brick that is not hidden, and belong to the level.
    fn may_hold(&self, view: &View, taken: &Taken, prepared: &Prepared, extent: &Extent) -> bool {
        let (grid, brick_grid) = (&prepared.grid, &prepared.levels[self.level]);
        let depth = if grid.perspective { view.farthest_depth(extent).max(0.0) } else { 1.0 };
        let raised = Extent { margin: extent.margin.max(taken.smallest * taken.sigma * depth), ..*extent };
        // A little more than they reach, since particles are rounded.
        let widest = 1.001 * extents::widest(view, &[raised], grid.sigma);
        if self.level >= coarse::levels_of(widest, prepared.levels.len()) {
            return false;
        }
        let place = view.to_camera(raised.bounds.center());
        let radius = 1.0001 * (0.5 * raised.bounds.size().length() + raised.margin) + 1e-6 * place.length();
        let [x, y, z] = place.as_vec3().to_array();
        let ball = Particle { place: [x, y, z, radius as f32], mass: 0.0, weighted: 0.0 };
        let ball = Body { particle: &ball, shape: None };
        let ([front, back], [nearest, farthest]) = (ball.depths(), ends(brick_grid, self.layers));
        if front > farthest || back < nearest {
            return false;
        }
        self.layers.clone().any(|layer| {
            let Some([columns, rows]) = brick_grid.reached(&ball, layer) else { return false };
            let mut places = (rows[0]..=rows[1])
                .flat_map(|row| (columns[0]..=columns[1]).map(move |column| row * brick_grid.bricks[0] + column));
            places.any(|place| self.hidden.get(place) != Some(&true))
        })
    }
}

/// A supply that several grids are filled from, one after the other.
pub(super) type Shared<'a> = Arc<Mutex<&'a mut dyn Supply>>;

pub(super) fn shared(supply: &mut dyn Supply) -> Shared<'_> {
    Arc::new(Mutex::new(supply))
}

/// Particles on their way to a grid.
pub struct Portions<'a> {
    supply: Shared<'a>,
    /// What the grid is filled with, where that is not their own attribute.
    column: Option<Column>,
    view: View,
    taken: Taken,
    is_empty: bool,
    particles: u64,
    raised: u64,
}

impl<'a> Portions<'a> {
    /// None has come yet.
    pub(super) fn new(supply: Shared<'a>, column: Option<Column>, view: &View, taken: Taken) -> Portions<'a> {
        Portions { supply, column, view: *view, taken, is_empty: true, particles: 0, raised: 0 }
    }

    /// How many particles have begun in the parts of the grid that were visited, and how many of them were raised.
    pub(super) fn counts(&self) -> [u64; 2] {
        [self.particles, self.raised]
    }

    /// Hands over, a portion at a time, what may reach a part of the grid and belongs to its level, and other particles of the same groups.
    pub(super) fn visit(&mut self, prepared: &Prepared, part: &Part<'_>, each: &mut dyn FnMut(&Projected)) {
        let Portions { supply, column, view, taken, is_empty, particles, raised } = self;
        let (column, view, taken) = (*column, &*view, &*taken);
        let is_wanted = |extent: &Extent| part.may_hold(view, taken, prepared, extent);
        let mut supply = supply.lock().unwrap_or_else(PoisonError::into_inner);
        supply.supply(&is_wanted, &mut |batches: &[Splats<'_>]| {
            let portion = match column {
                Some(column) => project(view, &column.of(batches), taken),
                None => project(view, batches, taken),
            };
            *is_empty &= portion.is_empty();
            let begun = begun_in(view, taken, prepared, part, &portion);
            (*particles, *raised) = (*particles + begun[0], *raised + begun[1]);
            each(&portion);
        });
    }

    /// Whether any particle reaches into the picture, if only where there are no cells.
    fn has_any(&mut self) -> bool {
        let Portions { supply, view, taken, is_empty, .. } = self;
        if *is_empty {
            let mut supply = supply.lock().unwrap_or_else(PoisonError::into_inner);
            supply
                .supply(&|_| true, &mut |batches: &[Splats<'_>]| *is_empty &= project(view, batches, taken).is_empty());
        }
        !*is_empty
    }
}

/// How many particles of a portion begin in a part of the grid, so that each counts once, and how many of them were raised.
fn begun_in(view: &View, taken: &Taken, prepared: &Prepared, part: &Part<'_>, portion: &Projected) -> [u64; 2] {
    let brick_grid = &prepared.levels[part.level];
    let [_, farthest] = ends(brick_grid, part.layers);
    let before = (part.layers.start * BRICK).checked_sub(1).map(|slice| brick_grid.depth[slice]);
    let is_perspective = matches!(view.projection, Projection::Perspective { .. });
    let of_body = |body: Body<'_>| {
        let [front, _] = body.depths();
        let is_here = front <= farthest && before.is_none_or(|before| front > before);
        if !is_here || prepared.level_of(&body) != part.level {
            return [0, 0];
        }
        let depth = if is_perspective { f64::from(body.particle.place[2]).max(0.0) } else { 1.0 };
        let least = taken.smallest * taken.sigma * depth;
        [1, u64::from(f64::from(body.shortest()) <= 1.000_001 * least)]
    };
    let sum = |a: [u64; 2], b: [u64; 2]| [a[0] + b[0], a[1] + b[1]];
    let of_chunk = |chunk: usize| portion.bodies(chunk).map(of_body).fold([0, 0], sum);
    (0..portion.chunks.len()).into_par_iter().map(of_chunk).reduce(|| [0, 0], sum)
}

/// Draws what `scenery` says of particles that are not all there at once; of those that nobody sees the report counts some alone.
///
/// # Errors
/// [`VolumeError`] as [`super::draw`].
pub fn draw(
    view: &View,
    supply: &mut dyn Supply,
    scenery: &Scenery,
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    let start = Instant::now();
    let options = &VolumeOptions { memory: options.memory.min(supply.slab_bytes()), ..*options };
    let (grid, widest) = extents::planes_and_widest(view, supply.extents(), options)?;
    let taken = Taken { sigma: grid.sigma, smallest: options.smallest, stride: 1, kernel: options.kernel };
    let nothing = Projected { attribute: supply.has_attribute(), ..Projected::default() };
    let prepared = Prepared::new(grid, widest, nothing);
    let mut report = VolumeReport {
        grid: grid.size,
        planes: [grid.near, grid.far],
        resampling: start.elapsed(),
        ..VolumeReport::default()
    };
    let portions = Portions::new(shared(supply), None, view, taken);
    let resampler = Resampler::new(&prepared, options.kernel).showing_above(scenery.least());
    let mut resampler = resampler.supplied_by(portions);
    let grids = (&prepared.grid, prepared.brick_grid());
    let colors = cast(view, grids, &mut resampler, scenery, options, None, &mut report);
    let mut portions = resampler.into_portions();
    if !portions.as_mut().is_some_and(Portions::has_any) {
        return Err(GridError::NothingInView.into());
    }
    let [particles, raised] = portions.map_or([0; 2], |portions| portions.counts());
    Ok((colors, VolumeReport { particles, raised, ..report }))
}

#[cfg(test)]
pub(super) mod tests;
