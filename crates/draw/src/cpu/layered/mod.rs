//! Layered splatting (F12 5.10): between splats that know no order and a volume that knows it along every ray.
//!
//! Depth is cut into layers, as much deeper from one to the next as the perspective grid's slices (F12 5.4), only fewer. The
//! particles of a layer are splatted in any order to the column density and the mean attribute in it, by the same image
//! pyramid as the splatting modes. Each layer's mean density, which is its column density over the way through it, is
//! classified like a sample of a volume, and the layers are blended front to back.
//!
//! F12 puts all of a particle into the layer nearest to its centre, which is coarse where particles are deeper than layers. Here a
//! particle is cut at the layers' planes by default ([`caps`]): every part has exactly the mass, the depth and the
//! second moment of what lies between the planes, and the profile of a whole particle. With more layers this comes to the
//! picture of a volume; with one it is the column density's, classified.

pub mod caps;
#[cfg(test)]
mod tests;

use super::paths::PathFragments;
use super::volume::particles::{Particle, Projected, Taken, project};
use super::volume::raycast::Ray;
use super::volume::{Classifier, OpaqueDepths, VolumeError, VolumeOptions, VolumeReport, extents};
use super::{Extent, Positions, SplatOptions, Splats};
use crate::color::Accumulation;
use crate::color::Colors;
use crate::view::{PerspectiveGrid, Projection, View};
use caps::Caps;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Most layers.
pub const MOST_LAYERS: u32 = 4096;
/// Parts of particles that are held at once, as long as one layer has no more.
const HELD: u64 = 1 << 21;
/// How far splats reach in a layer's picture, smoothing lengths: those of 6 cells of the image pyramid's levels are interpolated through
/// four cells of each, which make 8.
const SPREAD: f64 = 2.5;
/// Bytes of a part: as it is cut, and in its layer's columns.
const PART_BYTES: u64 = 64;

/// Which layers a particle counts in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Assignment {
    /// Each that it reaches, with what of it lies there.
    #[default]
    Kernel,
    /// The one that its centre is in (F12 5.10).
    Nearest,
}

/// The columns of one layer.
#[derive(Default)]
struct Columns {
    offsets: Vec<[f32; 3]>,
    smoothing_length: Vec<f32>,
    mass: Vec<f32>,
    attribute: Vec<f32>,
}

/// A part of a particle.
#[derive(Clone, Copy)]
struct Part {
    layer: u32,
    /// Camera coordinates, and smoothing length.
    place: [f32; 4],
    mass: f32,
    attribute: f32,
}

/// How depth is cut, and where a particle belongs.
struct Cutter {
    /// Depth of each layer's front, and of the last one's back.
    edges: Vec<f64>,
    grid: PerspectiveGrid,
    caps: &'static Caps,
    assignment: Assignment,
}

impl Cutter {
    /// The layers that a particle reaches.
    fn reached(&self, particle: &Particle) -> std::ops::Range<usize> {
        let [_, _, z, h] = particle.place.map(f64::from);
        let layers = self.edges.len() - 1;
        let layer = |depth: f64| (self.grid.slice(depth.clamp(self.grid.near, self.grid.far)) as usize).min(layers - 1);
        let ([front, back], none) = ([self.grid.near, self.grid.far], 0..0);
        match self.assignment {
            Assignment::Nearest if z < front || z > back => none,
            Assignment::Nearest => layer(z)..layer(z) + 1,
            Assignment::Kernel if z + h <= front || z - h >= back => none,
            Assignment::Kernel => layer(z - h)..layer(z + h) + 1,
        }
    }

    /// What of a particle is in a layer.
    fn part(&self, particle: &Particle, layer: usize) -> Option<Part> {
        let [x, y, z, h] = particle.place;
        let attribute = if particle.mass != 0.0 { particle.weighted / particle.mass } else { 0.0 };
        let whole = Part { layer: layer as u32, place: particle.place, mass: particle.mass, attribute };
        if self.assignment == Assignment::Nearest {
            return Some(whole);
        }
        let zeta = |edge: usize| (self.edges[edge] - f64::from(z)) / f64::from(h);
        let cut = self.caps.between(zeta(layer), zeta(layer + 1))?;
        let place = [x, y, z + h * cut.depth as f32, h * cut.width as f32];
        Some(Part { place, mass: particle.mass * cut.mass as f32, ..whole })
    }
}

/// Draws batches in `layers` layers between the planes of `options`. The result does not depend on the number of threads.
///
/// # Errors
/// [`VolumeError`] when nothing is in view, the planes make no sense, or there are no layers.
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    classifier: &Classifier,
    (layers, assignment, termination): (u32, Assignment, f32),
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    draw_with_paths(view, batches, classifier, (layers, assignment, termination), options, None)
}

/// The same with paths among the layers: each divides the layer that it is in.
///
/// # Errors
/// As [`draw`].
pub fn draw_with_paths(
    view: &View,
    batches: &[Splats<'_>],
    classifier: &Classifier,
    (layers, assignment, termination): (u32, Assignment, f32),
    options: &VolumeOptions,
    paths: Option<&PathFragments>,
) -> Result<(Colors, VolumeReport), VolumeError> {
    if !(1..=MOST_LAYERS).contains(&layers) {
        let expected = format!("a number from 1 to {MOST_LAYERS}");
        return Err(VolumeError::Setting { field: "layers", found: layers.to_string(), expected });
    }
    let start = Instant::now();
    let sigma = PerspectiveGrid::sigma_of(view, 1.0);
    let taken = Taken { sigma, smallest: options.smallest, stride: 1, kernel: options.kernel };
    let [near, far] = extents::planes_around(view, batches, &taken, [options.near, options.far])?;
    let particles = project(view, batches, &taken).unless_empty()?;
    let grid = layers_between(view, [near, far], layers);
    let edges = (0..=layers).map(|layer| grid.depth(f64::from(layer))).collect();
    let cutter = Cutter { edges, grid, caps: Caps::of(options.kernel), assignment };
    let counts = count(&cutter, &particles, layers as usize);
    let mut report = VolumeReport {
        grid: grid.size,
        planes: [near, far],
        particles: particles.len(),
        raised: particles.raised,
        pairs: counts.iter().sum(),
        ..VolumeReport::default()
    };
    let mut rays = vec![Ray::default(); view.width as usize * view.height as usize];
    // A layer's picture has up to two channels.
    let own = particles.bytes() + rays.len() as u64 * (size_of::<Ray>() as u64 + 8);
    let raster = SplatOptions { kernel: options.kernel, ..SplatOptions::default() };
    let mut first = 0;
    report.resampling = start.elapsed();
    'groups: while first < counts.len() {
        let (mut end, mut held) = (first + 1, counts[first]);
        while end < counts.len() && held + counts[end] <= HELD {
            held += counts[end];
            end += 1;
        }
        report.memory = report.memory.max(Some(own + held * PART_BYTES));
        report.slabs += 1;
        let start = Instant::now();
        let group = columns(&cutter, &particles, first..end);
        report.resampling += start.elapsed();
        for (layer, columns) in (first..end).zip(&group) {
            if columns.mass.is_empty() {
                continue;
            }
            let start = Instant::now();
            let picture = splat(view, columns, particles.attribute, &raster)?;
            report.resampling += start.elapsed();
            let start = Instant::now();
            let edges = [cutter.edges[layer] as f32, cutter.edges[layer + 1] as f32];
            let (samples, open) =
                blend(&mut rays, &picture, (&cutter.grid, layer), edges, classifier, termination, paths);
            *report.samples.get_or_insert(0) += samples;
            report.rendering += start.elapsed();
            if !open {
                break 'groups;
            }
        }
        first = end;
    }
    if let Some(paths) = paths {
        let width = view.width as usize;
        rays.par_chunks_mut(width).enumerate().for_each(|(y, rays)| {
            rays.iter_mut().enumerate().for_each(|(x, ray)| ray.meet_rest(paths.of(x, y), termination));
        });
    }
    let rgba = rays.iter().map(|ray| [ray.color[0], ray.color[1], ray.color[2], ray.alpha]).collect();
    if options.occlusion {
        let ends = rays.iter().map(|ray| (ray.alpha >= termination).then(|| ray.end + 1));
        report.opaque = Some(Arc::new(opaque(view, &cutter.grid, options.smallest, ends)));
    }
    Ok((Colors { width: view.width, height: view.height, rgba }, report))
}

/// Layers of a view between two planes: a grid with one slice for each.
pub fn layers_between(view: &View, [near, far]: [f64; 2], layers: u32) -> PerspectiveGrid {
    let perspective = matches!(view.projection, Projection::Perspective { .. });
    let (middle, size) = (view.middle(), [view.width, view.height, layers]);
    PerspectiveGrid { size, near, far, sigma: PerspectiveGrid::sigma_of(view, 1.0), cell: 1.0, middle, perspective }
}

/// What a picture in layers hides: for each pixel how many layers it takes to make it opaque, row by row.
pub fn opaque(
    view: &View,
    layers: &PerspectiveGrid,
    smallest: f64,
    ends: impl Iterator<Item = Option<u32>>,
) -> OpaqueDepths {
    let behind: Vec<f32> =
        (0..=layers.size[2]).map(|layer| (layers.depth(f64::from(layer)) as f32).next_up()).collect();
    let depth = |end: Option<u32>| end.and_then(|end| behind.get(end as usize)).copied().unwrap_or(f32::INFINITY);
    OpaqueDepths::new(view, ends.map(depth).collect(), 1.0, smallest).reaching(SPREAD)
}

/// How many particles each layer has, parts of particles included.
fn count(cutter: &Cutter, particles: &Projected, layers: usize) -> Vec<u64> {
    let chunk = |chunk: &Vec<Particle>| {
        let mut counts = vec![0u64; layers];
        chunk.iter().for_each(|particle| counts[cutter.reached(particle)].iter_mut().for_each(|count| *count += 1));
        counts
    };
    let sum = |mut a: Vec<u64>, b: Vec<u64>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    particles.chunks.par_iter().map(chunk).reduce(|| vec![0; layers], sum)
}

/// The particles of some layers, in their order.
fn columns(cutter: &Cutter, particles: &Projected, layers: std::ops::Range<usize>) -> Vec<Columns> {
    let cut = |chunk: &Vec<Particle>| -> Vec<Part> {
        let parts = chunk.iter().flat_map(|particle| {
            let reached = cutter.reached(particle);
            let own = reached.start.max(layers.start)..reached.end.min(layers.end);
            own.filter_map(move |layer| cutter.part(particle, layer))
        });
        parts.collect()
    };
    let parts: Vec<Vec<Part>> = particles.chunks.par_iter().map(cut).collect();
    let mut columns: Vec<Columns> = layers.clone().map(|_| Columns::default()).collect();
    // A parallel projection draws nothing behind its eye plane, where layers may be.
    let shift = if cutter.grid.perspective { 0.0 } else { cutter.grid.far - 2.0 * cutter.grid.near };
    for part in parts.iter().flatten() {
        let column = &mut columns[part.layer as usize - layers.start];
        let [x, y, z, h] = part.place;
        column.offsets.push([x, y, (f64::from(z) + shift) as f32]);
        column.smoothing_length.push(h);
        column.mass.push(part.mass);
        if particles.attribute {
            column.attribute.push(part.attribute);
        }
    }
    columns
}

/// The column densities of a layer.
fn splat(view: &View, columns: &Columns, attribute: bool, options: &SplatOptions) -> Result<Accumulation, VolumeError> {
    // Particles are in camera coordinates already.
    let view = View { eye: DVec3::ZERO, right: DVec3::X, up: DVec3::Y, forward: DVec3::Z, ..*view };
    let positions = Positions::Relative { origin: DVec3::ZERO, scale: 1.0, offsets: &columns.offsets };
    let extent = Extent::World(&columns.smoothing_length);
    let attribute = attribute.then_some(columns.attribute.as_slice());
    let splats = Splats::new(positions, extent, &columns.mass, attribute)?;
    Ok(super::draw(&view, &[splats], options))
}

/// Blends a layer under what is in front of it. Visible samples, and whether some ray goes on.
fn blend(
    rays: &mut [Ray],
    picture: &Accumulation,
    (grid, layer): (&PerspectiveGrid, usize),
    [front, back]: [f32; 2],
    classifier: &Classifier,
    termination: f32,
    paths: Option<&PathFragments>,
) -> (u64, bool) {
    let thickness = back - front;
    let width = picture.width as usize;
    let row = |(y, rays): (usize, &mut [Ray])| {
        let (mut samples, mut open) = (0, false);
        for (x, ray) in rays.iter_mut().enumerate() {
            if ray.alpha >= termination {
                continue;
            }
            let index = y * width + x;
            let fragments = paths.map_or(&[][..], |paths| paths.of(x, y));
            ray.meet(fragments, front);
            let distance = thickness * grid.secant([x as f64 + 0.5, y as f64 + 0.5]) as f32;
            let density = picture.p[index] / distance;
            if density > classifier.least() {
                let weighted = picture.ps.get(index).map_or(0.0, |ps| ps / distance);
                let matter = classifier.matter(density, weighted);
                let mut at = front;
                while let Some(path) = fragments.get(ray.next as usize).filter(|path| path.depth < back) {
                    let share = (path.depth - at) / thickness;
                    ray.under(matter.color, 1.0 - (-matter.extinction * distance * share).exp());
                    at = path.depth;
                    ray.meet(fragments, at.next_up());
                }
                let rest = if at > front { (back - at) / thickness } else { 1.0 };
                ray.under(matter.color, 1.0 - (-matter.extinction * distance * rest).exp());
                samples += 1;
            }
            ray.meet(fragments, back);
            ray.end = layer as u32;
            open |= ray.alpha < termination;
        }
        (samples, open)
    };
    let rows = rays.par_chunks_mut(width).enumerate().map(row);
    rows.reduce(|| (0, false), |a, b| (a.0 + b.0, a.1 | b.1))
}
