//! A Cartesian grid in world space: the field resampled once, at one resolution everywhere, and rays cast through it with
//! trilinear interpolation (F12 5.9).
//!
//! The particles are those of a parallel view along an axis, and the grid is its grid ([`Lattice`]): so its bricks hold the exact SPH
//! sum at every cell's centre, and empty ones take no memory.

pub mod march;
pub mod octree;

mod lattice;
#[cfg(test)]
mod tests;

pub use lattice::{CartesianOptions, Lattice, Region, region};

use super::Splats;
use super::volume::bricks::{BRICK, BrickGrid, Slab};
use super::volume::particles::{Taken, project};
use super::volume::resample::Resampler;
use super::volume::{Prepared, Scenery, VolumeError, VolumeOptions, VolumeReport, extents};
use crate::color::Colors;
use crate::view::{View, perspective_grid};
use glam::{DVec3, Vec3};
use march::{Field, Room};
use std::time::Instant;

/// A resampled field.
pub struct Cartesian {
    lattice: Lattice,
    brick_grid: BrickGrid,
    slab: Slab,
    /// For each brick, layer by layer, the largest density in it and around it.
    reach: Vec<f32>,
    attribute: bool,
}

impl Cartesian {
    /// Resamples batches to a grid.
    ///
    /// # Errors
    /// [`VolumeError::Grid`] when no particle reaches into it.
    pub fn new(
        batches: &[Splats<'_>],
        lattice: &Lattice,
        options: &VolumeOptions,
    ) -> Result<(Cartesian, VolumeReport), VolumeError> {
        let Lattice { view, grid, cells } = *lattice;
        let cell = grid.sigma;
        let attribute = batches.iter().any(|batch| batch.attribute().is_some());
        let taken = Taken { sigma: cell, smallest: options.smallest, stride: 1, kernel: options.kernel };
        let particles = project(&view, batches, &taken).unless_empty()?;
        let seen: Vec<_> = perspective_grid::seen(&view, extents::of(batches), options.smallest * cell).collect();
        let prepared = Prepared::new(grid, extents::widest(&view, &seen, cell), particles);
        let layers = 0..prepared.brick_grid().bricks[2];
        let (layers, work) = Resampler::new(&prepared, options.kernel).resample(layers, &[]);
        let Prepared { particles, mut levels, .. } = prepared;
        let brick_grid = levels.swap_remove(0);
        let slab = Slab { first: 0, layers };
        let report = VolumeReport {
            grid: cells,
            slabs: 1,
            particles: particles.len(),
            raised: particles.raised,
            pairs: work.pairs,
            bricks: work.bricks,
            memory: Some(particles.bytes() + slab.bytes()),
            ..VolumeReport::default()
        };
        let reach = reach(&brick_grid, &slab);
        Ok((Cartesian { lattice: *lattice, brick_grid, slab, reach, attribute }, report))
    }

    /// Density and `sum m A W` at a world position: trilinear between the cells around it.
    pub fn at(&self, world: DVec3) -> [f32; 2] {
        let place = Field::place(self, world).as_vec3();
        Field::at(self, &self.room(place, 0.0), place)
    }

    /// The cell with these stored coordinates.
    fn cell(&self, [x, y, z]: [i32; 3]) -> [f32; 2] {
        if x < 0 || y < 0 || z < 0 {
            return [0.0; 2];
        }
        let [x, y, z] = [x as usize, y as usize, z as usize];
        self.slab.brick(x / BRICK, y / BRICK, z / BRICK, &self.brick_grid).map_or([0.0; 2], |brick| {
            let cell = (z % BRICK * BRICK + y % BRICK) * BRICK + x % BRICK;
            [brick.density[cell], brick.weighted.get(cell).copied().unwrap_or(0.0)]
        })
    }
}

/// The largest density of each brick and those around it.
fn reach(brick_grid: &BrickGrid, slab: &Slab) -> Vec<f32> {
    let [columns, rows, layers] = brick_grid.bricks;
    let around = |index: usize, count: usize| index.saturating_sub(1)..(index + 2).min(count);
    let densest = |x: usize, y: usize, z: usize| {
        let bricks = around(z, layers).flat_map(|z| {
            around(y, rows).flat_map(move |y| around(x, columns).filter_map(move |x| slab.brick(x, y, z, brick_grid)))
        });
        bricks.map(|brick| brick.densest).fold(0.0, f32::max)
    };
    (0..columns * rows * layers)
        .map(|index| densest(index % columns, index / columns % rows, index / columns / rows))
        .collect()
}

impl Field for Cartesian {
    const REACH: f32 = 1.0;

    fn place(&self, world: DVec3) -> DVec3 {
        self.lattice.place(world)
    }

    fn unit(&self) -> f64 {
        self.lattice.grid.sigma
    }

    fn bounds(&self) -> [DVec3; 2] {
        self.lattice.bounds()
    }

    fn room(&self, place: Vec3, least: f32) -> Room {
        let bricks = self.brick_grid.bricks;
        // Casts saturate.
        let at: [usize; 3] = std::array::from_fn(|k| ((place[k] / BRICK as f32) as usize).min(bricks[k] - 1));
        let index = (at[2] * bricks[1] + at[1]) * bricks[0] + at[0];
        let min = Vec3::from_array(at.map(|brick| (brick * BRICK) as f32));
        Room { min, max: min + BRICK as f32, cell: 1.0, empty: self.reach[index] <= least, index }
    }

    #[inline]
    fn at(&self, room: &Room, place: Vec3) -> [f32; 2] {
        let low = (place - 0.5).floor();
        let share = place - 0.5 - low;
        let first = [low.x as i32, low.y as i32, low.z as i32];
        // Within the room's brick as a rule.
        let inside = low - room.min;
        let last = (BRICK - 2) as f32;
        let corners: [[f32; 2]; 8] = if inside.min_element() >= 0.0 && inside.max_element() <= last {
            let [columns, rows, _] = self.brick_grid.bricks;
            let (layer, of_layer) = (room.index / (columns * rows), room.index % (columns * rows));
            let Some(brick) = &self.slab.layers[layer][of_layer] else { return [0.0; 2] };
            let start = (inside.z as usize * BRICK + inside.y as usize) * BRICK + inside.x as usize;
            let offset =
                |corner: usize| start + (corner >> 2) * BRICK * BRICK + (corner >> 1 & 1) * BRICK + (corner & 1);
            match self.attribute {
                true => std::array::from_fn(|corner| [brick.density[offset(corner)], brick.weighted[offset(corner)]]),
                false => std::array::from_fn(|corner| [brick.density[offset(corner)], 0.0]),
            }
        } else {
            std::array::from_fn(|corner| {
                let [dx, dy, dz] = [corner & 1, corner >> 1 & 1, corner >> 2].map(|d| d as i32);
                self.cell([first[0] + dx, first[1] + dy, first[2] + dz])
            })
        };
        std::array::from_fn(|k| {
            let mix = |a: usize, b: usize, t: f32| corners[a][k] + t * (corners[b][k] - corners[a][k]);
            let [a, b, c, d] = [mix(0, 1, share.x), mix(2, 3, share.x), mix(4, 5, share.x), mix(6, 7, share.x)];
            let (front, back) = (a + share.y * (b - a), c + share.y * (d - c));
            front + share.z * (back - front)
        })
    }
}

/// Resamples batches and draws what `scenery` says of them.
///
/// # Errors
/// [`VolumeError`] when nothing is in view, the planes make no sense, or the grid is too large.
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    scenery: &Scenery,
    cartesian: &CartesianOptions,
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    let start = Instant::now();
    let attribute = batches.iter().any(|batch| batch.attribute().is_some());
    let (lattice, planes) = Lattice::of(view, &extents::of(batches), cartesian, attribute, options)?;
    let (field, mut report) = Cartesian::new(batches, &lattice, options)?;
    report.resampling = start.elapsed();
    let start = Instant::now();
    let (colors, effort) = march::cast(view, &field, scenery, planes);
    report.rendering = start.elapsed();
    report.memory = report.memory.map(|memory| memory + 16 * colors.rgba.len() as u64);
    let (samples, crossings) = (Some(effort.samples), Some(effort.crossings));
    Ok((colors, VolumeReport { planes, samples, crossings, ..report }))
}
