//! Order-dependent splatting (F12 5.9): particles sorted by depth, each classified on its own and blended front to back.
//!
//! A particle of density `rho` and mass `m` absorbs like matter of that density: where its line-of-sight kernel is `F`, its
//! optical depth is `kappa(rho) / rho  m F`, and its colour is that of `rho` and its attribute. So the sum over particles is the
//! SPH sum of the extinction: classification comes before interpolation, not after it as in a volume, and the order of
//! particles stands for the order along the ray, which is wrong where they overlap. That is what the comparison is about.
//!
//! Particles of equal depth are ordered by all their other values, so that the picture is the same to the last bit whatever order
//! they come in.

use super::Splats;
use super::footprint::Lens;
use super::front_to_back::{Among, Cover, Deepest, Seen, blend};
use super::paths::PathFragments;
use super::volume::particles::{Taken, project};
use super::volume::stretched::Stretched;
use super::volume::{Classifier, OpaqueDepths, VolumeError, VolumeOptions, VolumeReport, extents};
use crate::color::Colors;
use crate::view::{PerspectiveGrid, View};
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Instant;

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

/// Draws batches with their own densities, which count `density_scale`-fold ([`super::volume::particles::density_scale`]). Rays end
/// at an opacity of `termination`.
///
/// # Errors
/// [`VolumeError`] when nothing is in view, the planes make no sense, or the particles have no densities.
pub fn draw(
    view: &View,
    batches: &[Splats<'_>],
    classifier: &Classifier,
    way: (f32, f32),
    options: &VolumeOptions,
) -> Result<(Colors, VolumeReport), VolumeError> {
    draw_among(view, batches, classifier, way, options, None)
}

/// The same among surfaces, which are in the picture then.
///
/// # Errors
/// As [`draw`].
pub fn draw_among(
    view: &View,
    batches: &[Splats<'_>],
    classifier: &Classifier,
    (termination, density_scale): (f32, f32),
    options: &VolumeOptions,
    surfaces: Option<&PathFragments>,
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
    report.resampling = start.elapsed();
    let shape = |splat: &Splat| splat.shape.map(|shape| &shapes[shape.get() as usize - 1]);
    let look = |lens: &Lens, splat: &Splat| {
        let [x, y, z, h] = splat.place.map(f64::from);
        let camera = DVec3::new(x, y, z);
        let (footprint, depth) = match shape(splat) {
            None => (lens.at(camera, h)?, splat.depth),
            Some(shape) => {
                let footprint = lens.ellipsoid(shape.ellipsoid(camera), options.kernel.variance(), [1.0, 0.0])?;
                (footprint, (f64::from(splat.depth) * footprint.amplitude) as f32)
            }
        };
        Some(Seen { cover: Cover::Footprint(footprint), depth, color: splat.color, place: splat.place[2] })
    };
    let deepest = |splat: &Splat, start: DVec3, direction: DVec3| match shape(splat) {
        None => splat.place[2],
        Some(shape) => {
            let center = glam::Vec3::from_slice(&splat.place).as_dvec3();
            let (along, away) = (shape.to_ball(direction), shape.to_ball(center - start));
            let (middle, half) = (along.dot(away) / along.length_squared(), f64::from(shape.half_depth()));
            // A ray that passes by may be nearest to it, as it is measured, far away.
            middle.clamp(center.z - half, center.z + half) as f32
        }
    };
    let deepest: Option<Deepest<'_, Splat>> = if shapes.is_empty() { None } else { Some(&deepest) };
    let surfaces = surfaces.map(|fragments| Among { fragments, by_distance: false });
    let (colors, ends) = blend(view, splats, look, deepest, (options.kernel, termination), surfaces, &mut report);
    report.memory = report.memory.map(|memory| memory + (shapes.len() * size_of::<Stretched>()) as u64);
    // Pixels are the cells to whose size small particles are enlarged.
    let opaque = options.occlusion.then(|| OpaqueDepths::new(view, ends, 1.0, options.smallest));
    report.opaque = opaque.map(Arc::new);
    Ok((colors, report))
}

#[cfg(test)]
mod tests;
