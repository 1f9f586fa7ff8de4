//! Order-dependent splatting (F12 5.9): particles sorted by depth, each classified on its own and blended front to back.
//!
//! A particle of density `rho` and mass `m` absorbs like matter of that density: where its line-of-sight kernel is `F`, its
//! optical depth is `kappa(rho) / rho  m F`, and its colour is that of `rho` and its attribute. So the sum over particles is the
//! SPH sum of the extinction: classification comes before interpolation, not after it as in a volume, and the order of
//! particles stands for the order along the ray, which is wrong where they overlap. That is what the comparison is about.
//!
//! Ellipsoids may be long, so that the depths of their centres say little of the order in which a ray meets them: an order by centre
//! changes at once all over two of them when the view turns. In each tile they are sorted by the depth at which the ray through the
//! tile's middle is deepest in each of them, round particles by their centres. As many particles are sorted so as are held at once
//! ([`PAIRS`]); beyond that the centres' order holds.
//!
//! Particles of equal depth are ordered by all their other values, so that the picture is the same to the last bit whatever order
//! they come in.

use super::Splats;
use super::footprint::{Footprint, Lens};
use super::profile::{Profile, Profiles};
use super::screen_tiles::{Reach, TILE, Tiles};
use super::volume::particles::{Taken, project};
use super::volume::raycast::Ray;
use super::volume::stretched::Stretched;
use super::volume::{Classifier, OpaqueDepths, VolumeError, VolumeOptions, VolumeReport, extents};
use crate::color::Colors;
use crate::model::Kernel;
use crate::view::{PerspectiveGrid, View};
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Instant;

/// Pairs of a tile and a particle that are held at once.
const PAIRS: usize = 1 << 22;

/// One particle, ready to be blended.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Splat {
    /// Camera coordinates, and smoothing length.
    place: [f32; 4],
    /// Optical depth where `F = 1 / h^2`: `kappa(rho) / rho  m / h^2`. Of an ellipsoid `kappa(rho) / rho  m`.
    depth: f32,
    /// Colour, linear light.
    color: [f32; 3],
    /// Number of its shape, counted from 1; none for a ball, whose amplitude `depth` has.
    shape: Option<NonZeroU32>,
}

/// What splats are drawn with.
struct Brush<'a> {
    lens: Lens,
    tiles: Tiles,
    /// Shapes of ellipsoids.
    shapes: &'a [Stretched],
    kernel: Kernel,
    profile: &'a Profile,
    termination: f32,
}

impl Splat {
    /// What splats are sorted by: depth, then everything else.
    fn key(&self) -> [f32; 8] {
        let [x, y, z, h] = self.place;
        let [r, g, b] = self.color;
        [z, x, y, h, self.depth, r, g, b]
    }

    fn order(&self, other: &Splat, shapes: &[Stretched]) -> Ordering {
        let pairs = self.key().into_iter().zip(other.key());
        let by_key = pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
        by_key.unwrap_or_else(|| {
            let factor = |splat: &Splat| splat.shape.map(|shape| shapes[shape.get() as usize - 1].factor);
            match (factor(self), factor(other)) {
                (Some(a), Some(b)) => {
                    let pairs = a.into_iter().zip(b);
                    pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
                }
                (a, b) => a.is_some().cmp(&b.is_some()),
            }
        })
    }
}

/// The rays of a tile, row by row, and how many of them go on.
struct Tile {
    rays: Vec<Ray>,
    /// The depth of the last splat that each ray meets; infinite for those that go on.
    ends: Vec<f32>,
    open: usize,
}

/// Draws batches with their own densities, which count `density_scale`-fold ([`super::volume::particles::density_scale`]). Rays end
/// at an opacity of `termination`.
///
/// # Errors
/// [`VolumeError`] when nothing is in view, the planes make no sense, or the particles have no densities.
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    classifier: &Classifier,
    (termination, density_scale): (f32, f32),
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    let start = Instant::now();
    let sigma = PerspectiveGrid::sigma_of(view, 1.0);
    let taken = Taken { sigma, smallest: options.smallest, stride: 1, kernel: options.kernel };
    let [near, far] = extents::planes_around(view, batches, &taken, [options.near, options.far])?;
    let particles = project(view, batches, &taken).unless_empty()?;
    let mut report = VolumeReport {
        planes: [near, far],
        particles: particles.len(),
        raised: particles.raised,
        grid: [view.width, view.height, 1],
        ..VolumeReport::default()
    };
    if particles.densities.is_empty() {
        let expected = "particles with densities of their own".into();
        return Err(VolumeError::Setting { field: "density", found: "not there".into(), expected });
    }
    // Where each chunk's shapes begin among all.
    let starts: Vec<usize> = particles
        .shapes
        .iter()
        .scan(0, |next, shapes| {
            *next += shapes.len();
            Some(*next - shapes.len())
        })
        .collect();
    let chunks = particles.chunks.par_iter().zip(&particles.densities).zip(&particles.shapes).zip(starts);
    let classified = chunks.flat_map_iter(|(((chunk, densities), shapes), start)| {
        let pairs = chunk.iter().zip(densities).enumerate();
        pairs.filter_map(move |(index, (particle, &density))| {
            let (depth, density) = (f64::from(particle.place[2]), density * density_scale);
            if !(depth >= near && depth <= far && density > classifier.least() && particle.mass > 0.0) {
                return None;
            }
            let matter = classifier.matter(density, density * particle.weighted / particle.mass);
            let [_, _, _, h] = particle.place;
            let shape = shapes.get(index).and_then(|_| NonZeroU32::new((start + index) as u32 + 1));
            let area = if shape.is_some() { 1.0 } else { h * h };
            let amplitude = matter.extinction / density * particle.mass / area;
            (amplitude > 0.0 && amplitude.is_finite()).then_some(Splat {
                place: particle.place,
                depth: amplitude,
                color: matter.color,
                shape,
            })
        })
    });
    let mut splats: Vec<Splat> = classified.collect();
    report.memory = Some(particles.bytes());
    let shapes = particles.shapes.concat();
    drop(particles.chunks);
    splats.par_sort_unstable_by(|a, b| a.order(b, &shapes));
    let profile = &Profiles::of(options.kernel).sampled;
    let (lens, tiles) = (Lens::new(view), Tiles::new(view));
    let brush = Brush { lens, tiles, shapes: &shapes, kernel: options.kernel, profile, termination };
    let reach = |splat: &Splat| tiles.reach(&lens, &brush.footprint(splat)?);
    let (splats, reaches): (Vec<Splat>, Vec<Reach>) =
        splats.into_par_iter().filter_map(|splat| reach(&splat).map(|reach| (splat, reach))).unzip();
    report.resampling = start.elapsed();
    let mut drawn: Vec<Tile> = (0..tiles.count())
        .map(|tile| {
            let [columns, rows] = tiles.pixels(tile);
            let count = columns.len() * rows.len();
            Tile { rays: vec![Ray::default(); count], ends: vec![f32::INFINITY; count], open: count }
        })
        .collect();
    let pixels = view.width as u64 * u64::from(view.height) * size_of::<Ray>() as u64;
    let held = splats.len() as u64 * (size_of::<Splat>() + size_of::<Reach>()) as u64 + pixels;
    let held = held + (shapes.len() * size_of::<Stretched>()) as u64;
    let mut next = 0;
    while next < splats.len() && drawn.iter().any(|tile| tile.open > 0) {
        let start = Instant::now();
        let (bins, end) = tiles.bin(&reaches, next..splats.len(), PAIRS, |tile| drawn[tile].open > 0);
        next = end;
        report.resampling += start.elapsed();
        let start = Instant::now();
        report.pairs += bins.len() as u64;
        report.slabs += 1;
        report.memory = report.memory.max(Some(held + 4 * bins.len() as u64));
        let blend = |(index, tile): (usize, &mut Tile)| -> u64 {
            let pixels = tiles.pixels(index);
            if shapes.is_empty() {
                let own = bins.of(index).iter().map(|&splat| &splats[splat as usize]);
                return own.map(|splat| tile.blend(&brush, &pixels, splat, splat.place[2])).sum();
            }
            let own = brush.in_order(index, bins.of(index), &splats).into_iter();
            own.map(|(depth, splat)| tile.blend(&brush, &pixels, &splats[splat as usize], depth)).sum()
        };
        *report.samples.get_or_insert(0) += drawn.par_iter_mut().enumerate().map(blend).sum::<u64>();
        report.rendering += start.elapsed();
    }
    let (width, height) = (view.width as usize, view.height as usize);
    let mut rgba = vec![[0.0; 4]; width * height];
    let mut ends = vec![f32::INFINITY; width * height];
    for (index, tile) in drawn.iter().enumerate() {
        let [columns, rows] = tiles.pixels(index);
        let rays = tile.rays.chunks(columns.len().max(1)).zip(tile.ends.chunks(columns.len().max(1)));
        for (y, (rays, own)) in rows.zip(rays) {
            let row = y * width + columns.start..y * width + columns.end;
            ends[row.clone()].copy_from_slice(own);
            rgba[row]
                .iter_mut()
                .zip(rays)
                .for_each(|(out, ray)| *out = [ray.color[0], ray.color[1], ray.color[2], ray.alpha]);
        }
    }
    // Pixels are the cells to whose size small particles are enlarged.
    let opaque = options.occlusion.then(|| OpaqueDepths::new(view, ends, 1.0, options.smallest));
    report.opaque = opaque.map(Arc::new);
    Ok((Colors { width: view.width, height: view.height, rgba }, report))
}

impl Brush<'_> {
    /// The shape of a splat, if it is no ball.
    fn shape(&self, splat: &Splat) -> Option<&Stretched> {
        splat.shape.map(|shape| &self.shapes[shape.get() as usize - 1])
    }

    /// Where a splat of weight 1 is seen; `None` when it is not.
    fn footprint(&self, splat: &Splat) -> Option<Footprint> {
        let [x, y, z, h] = splat.place.map(f64::from);
        let camera = DVec3::new(x, y, z);
        match self.shape(splat) {
            None => self.lens.at(camera, h),
            Some(shape) => self.lens.ellipsoid(shape.ellipsoid(camera), self.kernel.variance(), [1.0, 0.0]),
        }
    }

    /// Splats of a tile with the depths that they are sorted by there; at the same depth in the order of their centres.
    fn in_order(&self, tile: usize, own: &[u32], splats: &[Splat]) -> Vec<(f32, u32)> {
        let [columns, rows] = self.tiles.pixels(tile);
        let [x, y] = [columns, rows].map(|pixels| 0.5 * (pixels.start + pixels.end) as f64);
        let (start, direction) = self.lens.sight([x, y]);
        let depth = |splat: &Splat| match self.shape(splat) {
            None => splat.place[2],
            Some(shape) => {
                let center = glam::Vec3::from_slice(&splat.place).as_dvec3();
                let (along, away) = (shape.to_ball(direction), shape.to_ball(center - start));
                let (middle, half) = (along.dot(away) / along.length_squared(), f64::from(shape.half_depth()));
                // A ray that passes by may be nearest to it, as it is measured, far away.
                middle.clamp(center.z - half, center.z + half) as f32
            }
        };
        let mut sorted: Vec<(f32, u32)> = own.iter().map(|&index| (depth(&splats[index as usize]), index)).collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        sorted
    }
}

impl Tile {
    /// Blends a splat, which lies at this depth in the tile, under what is there; the number of rays that it met.
    fn blend(
        &mut self,
        brush: &Brush<'_>,
        [columns, rows]: &[std::ops::Range<usize>; 2],
        splat: &Splat,
        depth: f32,
    ) -> u64 {
        if self.open == 0 {
            return 0;
        }
        let Some(footprint) = brush.footprint(splat) else { return 0 };
        let Brush { lens, profile, termination, .. } = brush;
        let is_ball = splat.shape.is_none();
        // What lies behind this is sorted behind the splat, here and among the centres.
        let behind = depth.max(splat.place[2]);
        // Pixels whose centres it may cover; casts saturate.
        let clip = |from: f64, to: f64, range: &std::ops::Range<usize>| {
            let first = ((from - 0.5).ceil().max(0.0) as usize).max(range.start);
            first..((to + 0.5).floor().max(0.0) as usize).min(range.end)
        };
        let covered = clip(footprint.min[0], footprint.max[0], columns);
        if covered.is_empty() {
            return 0;
        }
        let mut met = 0;
        let mut square = [0.0f32; TILE];
        let mut factor = [splat.depth; TILE];
        for row in clip(footprint.min[1], footprint.max[1], rows) {
            let line = lens.row(&footprint, row as f64 + 0.5);
            for (out, x) in square.iter_mut().zip(covered.clone()) {
                *out = lens.square(&line, x as f64 + 0.5) as f32;
            }
            if !is_ball {
                let amplitude = f64::from(splat.depth) * footprint.amplitude;
                for (out, x) in factor.iter_mut().zip(covered.clone()) {
                    *out = (amplitude * lens.ray_factor(&line, x as f64 + 0.5)) as f32;
                }
            }
            let start = (row - rows.start) * columns.len() + covered.start - columns.start;
            let rays = self.rays[start..].iter_mut().zip(&mut self.ends[start..]);
            for (((ray, end), &square), &factor) in rays.zip(&square).zip(&factor).take(covered.len()) {
                if square >= 1.0 || ray.alpha >= *termination {
                    continue;
                }
                ray.under(splat.color, opacity(factor * evaluate(profile, square)));
                met += 1;
                if ray.alpha >= *termination {
                    *end = behind;
                    self.open -= 1;
                }
            }
        }
        met
    }
}

/// A profile at a squared distance below 1.
#[inline]
fn evaluate(profile: &Profile, square: f32) -> f32 {
    let (t, y) = (1.0 - square, 1.0 - 2.0 * square);
    t * t * t * profile.iter().rev().fold(0.0, |sum, &c| sum * y + c)
}

/// `1 - exp(-depth)`.
#[inline]
fn opacity(depth: f32) -> f32 {
    if depth < 0.02 { depth * (1.0 - 0.5 * depth * (1.0 - depth / 3.0)) } else { 1.0 - (-depth).exp() }
}

#[cfg(test)]
mod tests;
