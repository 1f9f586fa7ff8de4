//! What a grid is laid around: boxes around particles and how far they reach at most, known before any particle is.
//!
//! The planes, and how many coarser levels wide particles take, follow from extents alone, so that a renderer that never has
//! the particles in memory lays the same grid.

use super::particles::{CHUNK, Taken};
use super::{VolumeError, VolumeOptions};
use crate::cpu::Splats;
use crate::model::Bounds;
use crate::view::perspective_grid::{depth_range, planes, seen};
use crate::view::{Extent, PerspectiveGrid, Projection, View};
use rayon::prelude::*;

/// The extents of batches: those that they come with, else those of their particles. Batches without any are left out.
pub fn of(batches: &[Splats<'_>]) -> Vec<Extent> {
    batches.par_iter().filter_map(|batch| batch.reach().or_else(|| measured(batch))).collect()
}

/// The extent of a batch's particles; `None` where none is drawn.
fn measured(batch: &Splats<'_>) -> Option<Extent> {
    let nothing = Extent { bounds: Bounds::EMPTY, margin: 0.0 };
    let part = |start: usize| {
        (start..batch.len().min(start + CHUNK)).fold(nothing, |extent, index| {
            let Some(h) = batch.farthest(index) else { return extent };
            let place = batch.positions().world(index);
            match place.is_finite() && h > 0.0 && h.is_finite() {
                true => Extent { bounds: extent.bounds.with(place), margin: extent.margin.max(f64::from(h)) },
                false => extent,
            }
        })
    };
    let both = |a: Extent, b: Extent| Extent { bounds: a.bounds.union(b.bounds), margin: a.margin.max(b.margin) };
    let starts = (0..batch.len().div_ceil(CHUNK)).into_par_iter();
    let all = starts.map(|chunk| part(chunk * CHUNK)).reduce(|| nothing, both);
    (!all.bounds.is_empty()).then_some(all)
}

/// The near and far plane of a picture of batches: those that are set, else around their extents.
///
/// # Errors
/// [`VolumeError::Grid`] when no extent is in view, or near is not in front of far.
pub fn planes_around(
    view: &View,
    batches: &[Splats<'_>],
    taken: &Taken,
    ends: [Option<f64>; 2],
) -> Result<[f64; 2], VolumeError> {
    planes_of(view, of(batches), taken.smallest * taken.sigma, ends)
}

/// The same of extents, where smoothing lengths below `least` are raised to it (at depth 1 if in perspective).
///
/// # Errors
/// As [`planes_around`].
pub fn planes_of(
    view: &View,
    extents: impl IntoIterator<Item = Extent>,
    least: f64,
    [near, far]: [Option<f64>; 2],
) -> Result<[f64; 2], VolumeError> {
    let perspective = matches!(view.projection, Projection::Perspective { .. });
    Ok(planes(depth_range(view, seen(view, extents, least)), near, far, perspective)?)
}

/// The grid of a view of extents, and an upper bound of the smoothing lengths that [`super::coarse::cells_of`] gives, in its
/// cells.
///
/// # Errors
/// [`VolumeError::Grid`] when no extent is in view, or the planes or the resolution make no sense.
pub fn planes_and_widest(
    view: &View,
    extents: impl IntoIterator<Item = Extent>,
    options: &VolumeOptions,
) -> Result<(PerspectiveGrid, f32), VolumeError> {
    let sigma = PerspectiveGrid::sigma_of(view, options.grid.resolution);
    let seen: Vec<Extent> = seen(view, extents, options.smallest * sigma).collect();
    let perspective = matches!(view.projection, Projection::Perspective { .. });
    let depths = planes(depth_range(view, seen.iter().copied()), options.near, options.far, perspective)?;
    Ok((PerspectiveGrid::new(view, depths, &options.grid)?, widest(view, &seen, sigma)))
}

/// An upper bound of the smoothing lengths within extents that are seen, in cells of width `sigma` (at depth 1 if in
/// perspective) where particles reach farthest; infinite where some may reach over the eye's plane from behind.
pub fn widest(view: &View, seen: &[Extent], sigma: f64) -> f32 {
    let cells = |extent: &Extent| match view.projection {
        Projection::Perspective { .. } => {
            // Of particles behind the eye's plane, those are widest that barely reach over it.
            let nearest = view.nearest_depth(extent);
            if nearest > 0.0 { extent.margin / (sigma * (nearest + extent.margin)) } else { f64::INFINITY }
        }
        Projection::Orthographic { .. } => extent.margin / sigma,
    };
    seen.iter().map(cells).fold(0.0, f64::max) as f32
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::super::particles::{Particle, project};
    use super::super::stretched::Body;
    use super::super::tests::{Cloud, look, merger, perspective};
    use super::super::{coarse, prepare};
    use super::*;
    use crate::model::Kernel;
    use glam::DVec3;

    /// Depths that particles reach, and the widest of them in cells.
    fn reached(view: &View, cloud: &Cloud, smallest: f64) -> ([f64; 2], f32) {
        let (grid, _) = planes_and_widest(view, of(&[cloud.batch()]), &VolumeOptions::default()).unwrap();
        let taken = Taken { sigma: grid.sigma, smallest, stride: 1, kernel: Kernel::default() };
        let particles: Vec<Particle> = project(view, &[cloud.batch()], &taken).chunks.concat();
        let ends =
            particles.iter().map(|particle| [-1.0, 1.0].map(|side| particle.place[2] + side * particle.place[3]));
        let depths =
            ends.fold([f32::INFINITY, f32::NEG_INFINITY], |all, ends| [all[0].min(ends[0]), all[1].max(ends[1])]);
        let widest = particles
            .iter()
            .map(|particle| coarse::cells_of(&Body { particle, shape: None }, &grid))
            .fold(0.0, f32::max);
        (depths.map(f64::from), widest)
    }

    #[test]
    fn grids_around_extents_hold_all_that_particles_reach() {
        let mut cloud = merger(3_000);
        cloud.push([1.0, 2.0, 3.0], 0.0, 1.0, 0.0);
        cloud.push([f64::NAN, 2.0, 3.0], 1e9, 1.0, 0.0);
        cloud.push([1e9, 2.0, 3.0], f32::INFINITY, 1.0, 0.0);
        let eye = DVec3::new(60.0, 40.0, 90.0);
        let views = [1.0, 6.0].map(|far| perspective(far * eye, 40, 30));
        let flat = look(eye, Projection::Orthographic { height: 60.0 }, 40, 30);
        for view in views.into_iter().chain([flat]) {
            for smallest in [0.0, 2.0, 12.0] {
                let options = VolumeOptions { smallest, ..VolumeOptions::default() };
                let (grid, most) = planes_and_widest(&view, of(&[cloud.batch()]), &options).unwrap();
                let ([near, far], widest) = reached(&view, &cloud, smallest);
                let nearest = if grid.perspective { PerspectiveGrid::NEAREST * grid.far } else { f64::NEG_INFINITY };
                assert!(grid.near <= near.max(nearest) && grid.far >= far, "{grid:?} {near} {far}");
                assert!(most >= widest, "{most} {widest}");
            }
        }
    }

    #[test]
    fn batches_that_say_their_extent_are_taken_at_their_word() {
        let cloud = Cloud::lattice(4, 2.0);
        let view = perspective(DVec3::new(0.0, 0.0, 9.0), 40, 30);
        let measured = of(&[cloud.batch()])[0];
        assert!((measured.bounds.max - 0.75).length() < 1e-12 && (measured.margin - 1.3).abs() < 1e-6, "{measured:?}");
        let told = Extent { margin: 4.0, ..measured };
        let grid = prepare(&view, &[cloud.batch().with_reach(Some(told))], &VolumeOptions::default()).unwrap().grid;
        assert!((grid.near - 4.25).abs() < 0.1 && (grid.far - 13.75).abs() < 0.1, "{grid:?}");
        // Where an extent is in view that no particle of is, nothing is.
        let beside = Cloud { positions: vec![[99.0, 0.0, 0.0]; cloud.h.len()], ..cloud.clone() };
        let batch = beside.batch().with_reach(Some(Extent { margin: 120.0, ..measured }));
        assert!(prepare(&view, &[batch], &VolumeOptions::default()).is_err());
    }
}
