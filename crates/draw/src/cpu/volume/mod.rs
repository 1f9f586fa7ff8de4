//! Volumes and isosurfaces straight from particles (F12 chapter 5), by the processor: the reference for the same on a GPU.
//!
//! Particles are projected once ([`particles`]). Slab by slab, from front to back, those that reach it are resampled to the
//! perspective grid ([`resample`]), and all rays go through it ([`raycast`]); where they have become opaque, later
//! slabs are left out ([`occlusion`]). Nothing is kept but the slab and what the rays have gathered.

pub mod attributes;
pub mod behind;
pub mod bricks;
pub mod classify;
pub mod coarse;
pub mod exact;
pub mod extents;
pub mod gather;
pub mod occlusion;
pub mod particles;
pub mod range;
pub mod raycast;
pub mod resample;
pub mod smoothing;
pub mod stretched;
pub mod supply;
pub mod surface;
pub mod variability;

mod block;
mod parts;
#[cfg(test)]
pub(in crate::cpu) mod tests;

pub use behind::OpaqueDepths;
pub use classify::{Classifier, VolumeLevels};
pub use range::FieldRange;
pub use raycast::Scenery;
pub use supply::Supply;
pub use surface::{Light, Surface};
pub use variability::Variability;

use super::Splats;
use super::paths::PathFragments;
use super::slice::arrows::ArrowKey;
use crate::color::Colors;
use crate::model::Kernel;
use crate::view::perspective_grid::{GridError, GridOptions};
use crate::view::{PerspectiveGrid, View};
use bricks::Layer;
use bricks::{BRICK, BrickGrid, Slab};
use occlusion::OpacityPyramid;
use particles::{Projected, Taken};
use raycast::Rays;
use resample::{Resampler, Work};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};
use stretched::Body;
use thiserror::Error;

/// A volume that cannot be drawn, and which setting to change.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum VolumeError {
    /// The grid cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A surface that cannot be there.
    #[error(
        "isovalues[{index}] is {value}, expected a density greater than 0 and at most the data's largest, {largest}"
    )]
    IsoValue {
        /// Which of the values.
        index: usize,
        /// The value.
        value: f64,
        /// The largest density of the data.
        largest: f64,
    },
    /// More surfaces than are drawn at once.
    #[error("isovalues has {found} values, expected at most {}", surface::MOST_SURFACES)]
    TooManySurfaces {
        /// How many were asked for.
        found: usize,
    },
    /// A setting that does not fit the data or the mode.
    #[error("{field} is {found}, expected {expected}")]
    Setting {
        /// The setting.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// A mode that the processor does not draw.
    #[error("the mode {0} is drawn by a graphics adapter only (--backend compute), not by the processor")]
    OnlyAdapter(&'static str),
    /// A mode that draws particles alone.
    #[error("mode: found one that draws particles, expected one that draws images or volumes")]
    OnlyParticles,
    /// A mode that draws images or volumes alone.
    #[error("mode: found one that draws images or volumes, expected one that draws particles")]
    OnlyFields,
    /// A mode of images or volumes that draws them alone.
    #[error("mode: found one that draws an image or a volume alone, expected one that draws it among other data")]
    OnlyAlone,
    /// A mode that draws heights alone.
    #[error("mode: found one that draws heights, expected one that draws particles")]
    OnlyHeights,
    /// An adapter that cannot draw it.
    #[error("{0}")]
    Device(String),
    /// Columns that do not fit together.
    #[error(transparent)]
    Columns(#[from] super::SplatError),
}

/// How a volume is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeOptions {
    /// Cells per pixel, and whether slices are as dense on the frustum's edges.
    pub grid: GridOptions,
    /// Depth of the near plane; around the data without.
    pub near: Option<f64>,
    /// Depth of the far plane; around the data without.
    pub far: Option<f64>,
    /// Memory that a slab's cells may take, bytes (one layer of bricks is always held).
    pub memory: u64,
    /// Least smoothing length in cells, see [`particles`]; 0 leaves particles as they are.
    pub smallest: f64,
    /// Whether what lies behind opaque pixels is left out.
    pub occlusion: bool,
    /// The kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// Steps of smoothing of the light on surfaces ([`smoothing`]) in pictures that are not in parts; 0 for none.
    pub smoothing: u32,
}

impl VolumeOptions {
    /// The same for the eye, or else for a lamp: planes are at depths from the eye.
    pub fn seen_from(self, is_eye: bool) -> VolumeOptions {
        if is_eye { self } else { VolumeOptions { near: None, far: None, ..self } }
    }
}

impl Default for VolumeOptions {
    fn default() -> VolumeOptions {
        VolumeOptions {
            grid: GridOptions::default(),
            near: None,
            far: None,
            memory: 256 << 20,
            smallest: particles::SMALLEST,
            occlusion: true,
            kernel: Kernel::default(),
            smoothing: 0,
        }
    }
}

/// What drawing a volume took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VolumeReport {
    /// Columns, rows and slices of the grid.
    pub grid: [u32; 3],
    /// Depth of the near and the far plane.
    pub planes: [f64; 2],
    /// Number of slabs.
    pub slabs: usize,
    /// Particles that reach into the picture.
    pub particles: u64,
    /// Of those, how many were raised to the grid's size.
    pub raised: u64,
    /// Pairs of a brick and a particle in it.
    pub pairs: u64,
    /// Bricks that hold something.
    pub bricks: u64,
    /// Visible samples, where they are counted.
    pub samples: Option<u64>,
    /// Crossings of surfaces, where they are counted.
    pub crossings: Option<u64>,
    /// Columns of bricks that were left out of a slab because they lie behind opaque pixels, over all slabs.
    pub hidden: u64,
    /// Most memory held at once by particles, the field and the rays, bytes, where it is counted.
    pub memory: Option<u64>,
    /// What the picture hides; `None` without occlusion.
    pub opaque: Option<Arc<OpaqueDepths>>,
    /// How long the arrows of a slice are, where it has some.
    pub arrows: Option<Box<ArrowKey>>,
    /// What a section through particles shows, pixel by pixel in the field's unit, NaN where that is nothing; of one flat picture.
    pub values: Option<Arc<Vec<f32>>>,
    /// Time for projecting and resampling.
    pub resampling: Duration,
    /// Time for casting rays.
    pub rendering: Duration,
}

/// What fills the bricks of a perspective grid, from front to back.
pub trait Fill: Sync {
    /// Fills layers of the grid that follow those of the last call. Bricks of columns that are `hidden` (one flag for each, row by row; none
    /// for an empty slice) are left out; they have to stay hidden.
    fn fill(&mut self, layers: Range<usize>, hidden: &[bool]) -> (Vec<Layer>, Work);

    /// Takes the memory of layers that are not needed any more.
    fn recycle(&mut self, layers: Vec<Layer>);

    /// Whether cells have an attribute.
    fn has_attribute(&self) -> bool;

    /// Whether surfaces have numbers of their own in the bricks.
    fn has_surface_field(&self) -> bool {
        false
    }

    /// Whether bricks say what the volume's extinction is multiplied by.
    fn has_opacity(&self) -> bool {
        false
    }

    /// Whether there is nothing where the volume's numbers, and those of surfaces, are 0, so that surfaces end there; else 0 is a value.
    fn has_holes(&self) -> [bool; 2] {
        [false; 2]
    }

    /// Which way the surface of a value rises in camera axes, by what the grid is filled from, in a column and row of the grid at a share of a
    /// step; `None` where differences between cells say it.
    fn slope(&self, _place: [f64; 2], _step: usize, _share: f32, _value: f32) -> Option<[f32; 3]> {
        None
    }

    /// Memory of what it is filled from, bytes.
    fn bytes(&self) -> u64;
}

/// The particles of a view and the grid for them.
pub struct Prepared {
    /// The grid.
    pub grid: PerspectiveGrid,
    /// Its bricks, and those of the coarser grids for wide particles ([`coarse`]); never empty.
    pub levels: Vec<BrickGrid>,
    /// The particles.
    pub particles: Projected,
}

impl Prepared {
    /// These particles, to be resampled on this grid. Smoothing lengths are at most `widest` of its cells.
    pub fn new(grid: PerspectiveGrid, widest: f32, particles: Projected) -> Prepared {
        Prepared { levels: coarse::brick_grids(&grid, widest), grid, particles }
    }

    /// What is told of them before anything is drawn.
    fn report(&self, resampling: Duration) -> VolumeReport {
        VolumeReport {
            grid: self.grid.size,
            planes: [self.grid.near, self.grid.far],
            particles: self.particles.len(),
            raised: self.particles.raised,
            resampling,
            ..VolumeReport::default()
        }
    }

    /// The bricks of the grid.
    pub fn brick_grid(&self) -> &BrickGrid {
        &self.levels[0]
    }

    /// The level that a particle is resampled on.
    pub fn level_of(&self, body: &Body<'_>) -> usize {
        coarse::level_of(body, &self.grid, self.levels.len())
    }
}

/// Projects batches and lays the grid around what is in view.
///
/// # Errors
/// [`VolumeError::Grid`] when nothing is in view or the grid makes no sense.
pub fn prepare(view: &View, batches: &[Splats<'_>], options: &VolumeOptions) -> Result<Prepared, VolumeError> {
    let (grid, widest) = extents::planes_and_widest(view, extents::of(batches), options)?;
    let taken = Taken { sigma: grid.sigma, smallest: options.smallest, stride: 1, kernel: options.kernel };
    let particles = particles::project(view, batches, &taken).unless_empty()?;
    Ok(Prepared::new(grid, widest, particles))
}

/// Draws what `scenery` says of batches; [`supply::draw`] where not all of them are there at once.
///
/// # Errors
/// [`VolumeError`] as [`prepare`].
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    scenery: &Scenery,
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    draw_with_paths(view, batches, scenery, options, None)
}

/// The same with paths in the volume, each at its own depth.
///
/// # Errors
/// [`VolumeError`] as [`prepare`].
pub fn draw_with_paths(
    view: &View,
    batches: &[Splats<'_>],
    scenery: &Scenery,
    options: &VolumeOptions,
    paths: Option<&PathFragments>,
) -> Result<(Colors, VolumeReport), VolumeError> {
    let start = Instant::now();
    let prepared = prepare(view, batches, options)?;
    let mut report = prepared.report(start.elapsed());
    let mut resampler = Resampler::new(&prepared, options.kernel).showing_above(scenery.least());
    let grids = (&prepared.grid, prepared.brick_grid());
    let colors = cast(view, grids, &mut resampler, scenery, options, paths, &mut report);
    Ok((colors, report))
}

/// What `scenery` says of batches in parts, each with its depth: what something else is drawn among.
///
/// # Errors
/// [`VolumeError`] as [`prepare`].
pub fn draw_in_parts(
    view: &View,
    batches: &[Splats<'_>],
    scenery: &Scenery,
    options: &VolumeOptions,
) -> Result<(PathFragments, VolumeReport), VolumeError> {
    let start = Instant::now();
    let prepared = prepare(view, batches, options)?;
    let mut report = prepared.report(start.elapsed());
    let mut resampler = Resampler::new(&prepared, options.kernel).showing_above(scenery.least());
    let grids = (&prepared.grid, prepared.brick_grid());
    let parts = cast_in_parts(view, grids, &mut resampler, scenery, options, &mut report);
    Ok((parts, report))
}

/// Casts rays through a grid while it is filled, and adds to the report what that took. The picture does not depend on the number of threads.
pub fn cast(
    view: &View,
    (grid, brick_grid): (&PerspectiveGrid, &BrickGrid),
    resampler: &mut dyn Fill,
    scenery: &Scenery,
    options: &VolumeOptions,
    paths: Option<&PathFragments>,
    report: &mut VolumeReport,
) -> Colors {
    let rays = Rays::new(grid, brick_grid, view.width, view.height);
    let smoothed = scenery.light.as_ref().filter(|_| options.smoothing > 0 && !scenery.surfaces.is_empty());
    let rays = if smoothed.is_some() { rays.with_faces() } else { rays };
    let rays = march(view, (grid, brick_grid), resampler, scenery, options, paths, report, rays);
    let mut rgba = rays.picture(|ray| [ray.color[0], ray.color[1], ray.color[2], ray.alpha]);
    if let Some(light) = smoothed {
        let start = Instant::now();
        let [width, height] = [view.width, view.height].map(|pixels| pixels as usize);
        smoothing::smooth(&mut rgba, &rays.faces(width, height), width, grid, light, options.smoothing);
        report.rendering += start.elapsed();
    }
    Colors { width: view.width, height: view.height, rgba }
}

/// The same in parts, each with its depth: what something else is drawn among.
pub fn cast_in_parts(
    view: &View,
    (grid, brick_grid): (&PerspectiveGrid, &BrickGrid),
    resampler: &mut dyn Fill,
    scenery: &Scenery,
    options: &VolumeOptions,
    report: &mut VolumeReport,
) -> PathFragments {
    let rays = Rays::new(grid, brick_grid, view.width, view.height).in_parts();
    let rays = march(view, (grid, brick_grid), resampler, scenery, options, None, report, rays);
    rays.fragments(scenery.surfaces.is_empty())
}

/// Has rays that have gathered nothing go through a grid while it is filled.
fn march(
    view: &View,
    (grid, brick_grid): (&PerspectiveGrid, &BrickGrid),
    resampler: &mut dyn Fill,
    scenery: &Scenery,
    options: &VolumeOptions,
    paths: Option<&PathFragments>,
    report: &mut VolumeReport,
    mut rays: Rays,
) -> Rays {
    let others = [resampler.has_attribute(), resampler.has_surface_field(), resampler.has_opacity()];
    let cell_bytes = 4 * others.into_iter().fold(1, |numbers, is_there| numbers + u64::from(is_there));
    let slabs = grid.slabs(options.memory, cell_bytes, BRICK as u32);
    report.slabs = slabs.len();
    if let Some(paths) = paths {
        rays.look_for(grid, paths);
    }
    let (mut kept, mut hidden) = (Slab::default(), Vec::new());
    for slab in slabs {
        let start = Instant::now();
        let layers = slab.slices.start as usize / BRICK..(slab.slices.end as usize).div_ceil(BRICK);
        let (resampled, work) = resampler.fill(layers.clone(), &hidden);
        report.pairs += work.pairs;
        report.bricks += work.bricks;
        report.resampling += start.elapsed();
        let start = Instant::now();
        let first = if kept.layers.is_empty() { layers.start } else { kept.first };
        let mut held = Slab { first, layers: kept.layers };
        held.layers.extend(resampled);
        let held_now = resampler.bytes() + held.bytes() + rays.bytes();
        report.memory = report.memory.max(Some(held_now));
        let effort = rays.advance(grid, brick_grid, &held, slab.steps, scenery, resampler, paths);
        *report.samples.get_or_insert(0) += effort.samples;
        *report.crossings.get_or_insert(0) += effort.crossings;
        kept = held.split_last(|layers| resampler.recycle(layers));
        if options.occlusion {
            hidden = hidden_columns(&rays, brick_grid, view, scenery.termination);
            report.hidden += hidden.iter().filter(|hidden| **hidden).count() as u64;
        }
        report.rendering += start.elapsed();
        if !hidden.is_empty() && hidden.iter().all(|hidden| *hidden) {
            break;
        }
    }
    if let Some(paths) = paths {
        rays.meet_rest(paths, scenery.termination);
    }
    if options.occlusion {
        let depths = rays.opaque_depths(grid, scenery.termination);
        report.opaque = Some(Arc::new(OpaqueDepths::new(view, depths, grid.cell, options.smallest)));
    }
    rays
}

/// The columns of bricks that no ray reads any more.
fn hidden_columns(rays: &Rays, brick_grid: &BrickGrid, view: &View, termination: f32) -> Vec<bool> {
    let opaque = rays.picture(|ray| ray.alpha >= termination);
    let pyramid = OpacityPyramid::new(view.width as usize, view.height as usize, opaque);
    let [columns, rows, _] = brick_grid.bricks;
    let spans = |count: usize, axis: usize| -> Vec<[i64; 2]> { (0..count).map(|i| rays.readers(i, axis)).collect() };
    let (across, down) = (spans(columns, 0), spans(rows, 1));
    (0..brick_grid.of_layer()).map(|index| pyramid.hides(across[index % columns], down[index / columns])).collect()
}
