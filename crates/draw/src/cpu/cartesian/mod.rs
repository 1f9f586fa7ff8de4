//! A Cartesian grid in world space: the field resampled once, at one resolution everywhere, and rays cast through it with
//! trilinear interpolation (F12 5.9).
//!
//! The particles are those of a parallel view along an axis, and the grid is its grid: so its bricks hold the exact SPH sum at
//! every cell's centre, and empty ones take no memory.

pub mod march;
pub mod octree;
#[cfg(test)]
mod tests;

use super::volume::bricks::{BORDER, BRICK, BrickGrid, Slab};
use super::volume::particles::{Taken, project};
use super::volume::resample::Resampler;
use super::volume::{Prepared, Scenery, VolumeError, VolumeOptions, VolumeReport, extents};
use super::{Extent, Splats};
use crate::color::Colors;
use crate::model::Bounds;
use crate::view::perspective_grid::{self, GridError};
use crate::view::{Cut, Images, PerspectiveGrid, Projection, View};
use glam::{DVec3, Vec3};
use march::{Field, Room};
use std::time::Instant;

/// Which box is resampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Region {
    /// Around the particles in view, as far as the view reaches.
    #[default]
    View,
    /// Around all particles.
    Data,
}

/// How a grid is laid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CartesianOptions {
    /// Cells along the longest side of the box.
    pub cells: u32,
    /// Which box.
    pub region: Region,
    /// Memory that the cells may take if none is empty, bytes.
    pub memory: u64,
}

/// A resampled field.
pub struct Cartesian {
    /// The parallel view whose grid it is.
    view: View,
    grid: PerspectiveGrid,
    brick_grid: BrickGrid,
    slab: Slab,
    /// For each brick, layer by layer, the largest density in it and around it.
    reach: Vec<f32>,
    attribute: bool,
}

/// A box of nothing: what boxes grow from.
const NOTHING: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

/// The box that a region is, and the depths between which rays go.
///
/// # Errors
/// [`VolumeError::Grid`] when nothing is in view or the planes make no sense.
pub fn region(
    view: &View,
    batches: &[Splats<'_>],
    region: Region,
    options: &VolumeOptions,
) -> Result<(Bounds, [f64; 2]), VolumeError> {
    let sigma = PerspectiveGrid::sigma_of(view, 1.0);
    let taken = Taken { sigma, smallest: 0.0, stride: 1 };
    let depths = extents::planes_around(view, batches, &taken, [options.near, options.far])?;
    let seen = project(view, batches, &taken).unless_empty()?;
    let perspective = matches!(view.projection, Projection::Perspective { .. });
    let world = |camera: DVec3| view.eye + camera.x * view.right + camera.y * view.up + camera.z * view.forward;
    let grown = |bounds: Bounds, at: DVec3, h: f64| Bounds { min: bounds.min.min(at - h), max: bounds.max.max(at + h) };
    if region == Region::Data {
        let mut bounds = NOTHING;
        for batch in batches {
            let Extent::World(lengths) = batch.extent() else { continue };
            for (index, &h) in lengths.iter().enumerate() {
                let position = batch.positions().world(index);
                if position.is_finite() && h > 0.0 && h.is_finite() {
                    bounds = grown(bounds, position, f64::from(h));
                }
            }
        }
        return Ok((bounds, depths));
    }
    let particles = seen.chunks.iter().flatten().map(|particle| particle.place.map(f64::from));
    let data = particles.fold(NOTHING, |bounds, [x, y, z, h]| grown(bounds, world(DVec3::new(x, y, z)), h));
    let edges = view.edges();
    let frustum = (0..8).fold(NOTHING, |bounds, corner| {
        let depth = depths[corner / 4];
        let scale = if perspective { depth } else { 1.0 };
        let side = |axis: usize| edges[axis][corner >> axis & 1] * scale;
        grown(bounds, world(DVec3::new(side(0), side(1), depth)), 0.0)
    });
    let bounds = Bounds { min: data.min.max(frustum.min), max: data.max.min(frustum.max) };
    match (bounds.max - bounds.min).min_element() > 0.0 {
        true => Ok((bounds, depths)),
        false => Err(GridError::NothingInView.into()),
    }
}

impl Cartesian {
    /// Resamples batches within a box.
    ///
    /// # Errors
    /// [`VolumeError::Setting`] when the grid would take more memory than allowed.
    pub fn new(
        batches: &[Splats<'_>],
        bounds: Bounds,
        cartesian: &CartesianOptions,
        options: &VolumeOptions,
    ) -> Result<(Cartesian, VolumeReport), VolumeError> {
        let size = bounds.max - bounds.min;
        let cell = size.max_element() / f64::from(cartesian.cells.max(1));
        let border = 2 * BORDER as u64;
        let cells = size.to_array().map(|side| ((side / cell - 1e-9).ceil() as u64).max(1));
        let attribute = batches.iter().any(|batch| batch.attribute().is_some());
        let bytes =
            cells.iter().fold(4 * (1 + u64::from(attribute)), |product, side| product.saturating_mul(side + border));
        if bytes > cartesian.memory || cells.iter().any(|&side| side > 1 << 16) {
            let [k, l, m] = cells;
            let mib = |bytes: u64| bytes.div_ceil(1 << 20);
            return Err(VolumeError::Setting {
                field: "cells",
                found: cartesian.cells.to_string(),
                expected: format!(
                    "fewer: a grid of {k} x {l} x {m} cells takes {} MiB, and memory is {} MiB",
                    mib(bytes),
                    mib(cartesian.memory)
                ),
            });
        }
        let [k, l, m] = cells.map(|side| side as u32);
        // Looking along -z with y up, x is to the right.
        let eye = DVec3::new(
            bounds.min.x + 0.5 * f64::from(k) * cell,
            bounds.min.y + 0.5 * f64::from(l) * cell,
            bounds.min.z + f64::from(m) * cell,
        );
        let projection = Projection::Orthographic { height: f64::from(l) * cell };
        let (right, up, forward) = (DVec3::X, DVec3::Y, DVec3::NEG_Z);
        let (shift, cut, images) = ([0.0; 2], Cut::NONE, Images::ONE);
        let view = View { eye, right, up, forward, projection, width: k, height: l, shift, cut, images, time: 0.0 };
        let slices = m + border as u32;
        let near = -(BORDER as f64) * cell;
        let grid = PerspectiveGrid {
            size: [k, l, slices],
            near,
            far: near + f64::from(slices) * cell,
            sigma: cell,
            cell: 1.0,
            middle: [k, l].map(|cells| 0.5 * f64::from(cells)),
            perspective: false,
        };
        let particles = project(&view, batches, &Taken { sigma: cell, smallest: options.smallest, stride: 1 });
        let seen: Vec<_> = perspective_grid::seen(&view, extents::of(batches), options.smallest * cell).collect();
        let prepared = Prepared::new(grid, extents::widest(&view, &seen, cell), particles);
        let layers = 0..prepared.brick_grid().bricks[2];
        let (layers, work) = Resampler::new(&prepared, options.kernel).resample(layers, &[]);
        let Prepared { particles, mut levels, .. } = prepared;
        let brick_grid = levels.swap_remove(0);
        let slab = Slab { first: 0, layers };
        let report = VolumeReport {
            grid: [k, l, m],
            slabs: 1,
            particles: particles.len(),
            raised: particles.raised,
            pairs: work.pairs,
            bricks: work.bricks,
            memory: Some(particles.bytes() + slab.bytes()),
            ..VolumeReport::default()
        };
        let reach = reach(&brick_grid, &slab);
        Ok((Cartesian { view, grid, brick_grid, slab, reach, attribute }, report))
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
        let [x, y, z] = self.grid.to_grid(self.view.to_camera(world));
        DVec3::new(x + BORDER as f64, y + BORDER as f64, z)
    }

    fn unit(&self) -> f64 {
        self.grid.sigma
    }

    fn bounds(&self) -> [DVec3; 2] {
        let [k, l, slices] = self.grid.size.map(f64::from);
        let border = BORDER as f64;
        [DVec3::splat(border), DVec3::new(k + border, l + border, slices - border)]
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
    let (bounds, planes) = region(view, batches, cartesian.region, options)?;
    let (field, mut report) = Cartesian::new(batches, bounds, cartesian, options)?;
    report.resampling = start.elapsed();
    let start = Instant::now();
    let (colors, effort) = march::cast(view, &field, scenery, planes);
    report.rendering = start.elapsed();
    report.memory = report.memory.map(|memory| memory + 16 * colors.rgba.len() as u64);
    let (samples, crossings) = (Some(effort.samples), Some(effort.crossings));
    Ok((colors, VolumeReport { planes, samples, crossings, ..report }))
}
