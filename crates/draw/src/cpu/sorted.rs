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
use super::footprint::{Footprint, Lens};
use super::profile::{Profile, Profiles};
use super::screen_tiles::{Reach, TILE, Tiles};
use super::volume::particles::{Taken, project};
use super::volume::raycast::Ray;
use super::volume::{Classifier, OpaqueDepths, VolumeError, VolumeOptions, VolumeReport, extents};
use crate::color::Colors;
use crate::model::Kernel;
use crate::view::{PerspectiveGrid, View};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Pairs of a tile and a particle that are held at once.
const PAIRS: usize = 1 << 22;

/// One particle, ready to be blended.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Splat {
    /// Camera coordinates, and smoothing length.
    place: [f32; 4],
    /// Optical depth where `F = 1 / h^2`: `kappa(rho) / rho  m / h^2`.
    depth: f32,
    /// Colour, linear light.
    color: [f32; 3],
}

impl Splat {
    /// What splats are sorted by: depth, then everything else.
    fn key(&self) -> [f32; 8] {
        let [x, y, z, h] = self.place;
        let [r, g, b] = self.color;
        [z, x, y, h, self.depth, r, g, b]
    }

    fn order(&self, other: &Splat) -> std::cmp::Ordering {
        let pairs = self.key().into_iter().zip(other.key());
        pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
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
    let taken = Taken { sigma, smallest: options.smallest, stride: 1 };
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
    let chunks = particles.chunks.par_iter().zip(&particles.densities);
    let classified = chunks.flat_map_iter(|(chunk, densities)| {
        let pairs = chunk.iter().zip(densities);
        pairs.filter_map(|(particle, &density)| {
            let (depth, density) = (f64::from(particle.place[2]), density * density_scale);
            if !(depth >= near && depth <= far && density > classifier.least() && particle.mass > 0.0) {
                return None;
            }
            let matter = classifier.matter(density, density * particle.weighted / particle.mass);
            let [_, _, _, h] = particle.place;
            let amplitude = matter.extinction / density * particle.mass / (h * h);
            (amplitude > 0.0 && amplitude.is_finite()).then_some(Splat {
                place: particle.place,
                depth: amplitude,
                color: matter.color,
            })
        })
    });
    let mut splats: Vec<Splat> = classified.collect();
    report.memory = Some(particles.bytes());
    drop(particles);
    splats.par_sort_unstable_by(Splat::order);
    report.resampling = start.elapsed();
    let look = |lens: &Lens, splat: &Splat| {
        let [x, y, z, h] = splat.place.map(f64::from);
        let footprint = lens.at(glam::DVec3::new(x, y, z), h)?;
        Some(Seen { footprint, depth: splat.depth, color: splat.color, place: splat.place[2] })
    };
    let (colors, ends) = blend(view, splats, look, options.kernel, termination, &mut report);
    // Pixels are the cells to whose size small particles are enlarged.
    let opaque = options.occlusion.then(|| OpaqueDepths::new(view, ends, 1.0, options.smallest));
    report.opaque = opaque.map(Arc::new);
    Ok((colors, report))
}

/// What a splat looks like.
pub(super) struct Seen {
    /// Which pixels it covers.
    pub(super) footprint: Footprint,
    /// Optical depth where `F` is 1.
    pub(super) depth: f32,
    /// Colour, linear light.
    pub(super) color: [f32; 3],
    /// How far away it is.
    pub(super) place: f32,
}

/// Blends splats front to back, in their order, as `look` says that they look; rays end at an opacity of `termination`. The colours, and
/// for each pixel how far away the splat is that its ray ends with; infinite where it goes on.
pub(super) fn blend<S: Send + Sync>(
    view: &View,
    splats: Vec<S>,
    look: impl Fn(&Lens, &S) -> Option<Seen> + Sync,
    kernel: Kernel,
    termination: f32,
    report: &mut VolumeReport,
) -> (Colors, Vec<f32>) {
    let start = Instant::now();
    let (lens, tiles) = (Lens::new(view), Tiles::new(view));
    let reach = |splat: &S| tiles.reach(&lens, &look(&lens, splat)?.footprint);
    let (splats, reaches): (Vec<S>, Vec<Reach>) =
        splats.into_par_iter().filter_map(|splat| reach(&splat).map(|reach| (splat, reach))).unzip();
    report.resampling += start.elapsed();
    let profile = &Profiles::of(kernel).sampled;
    let mut drawn: Vec<Tile> = (0..tiles.count())
        .map(|tile| {
            let [columns, rows] = tiles.pixels(tile);
            let count = columns.len() * rows.len();
            Tile { rays: vec![Ray::default(); count], ends: vec![f32::INFINITY; count], open: count }
        })
        .collect();
    let pixels = view.width as u64 * u64::from(view.height) * size_of::<Ray>() as u64;
    let held = splats.len() as u64 * (size_of::<S>() + size_of::<Reach>()) as u64 + pixels;
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
            bins.of(index)
                .iter()
                .map(|&splat| tile.blend(&lens, &pixels, || look(&lens, &splats[splat as usize]), profile, termination))
                .sum()
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
    (Colors { width: view.width, height: view.height, rgba }, ends)
}

impl Tile {
    /// Blends a splat under what is there; the number of rays that it met.
    fn blend(
        &mut self,
        lens: &Lens,
        [columns, rows]: &[std::ops::Range<usize>; 2],
        look: impl FnOnce() -> Option<Seen>,
        profile: &Profile,
        termination: f32,
    ) -> u64 {
        if self.open == 0 {
            return 0;
        }
        let Some(Seen { footprint, depth, color, place }) = look() else { return 0 };
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
        let (mut square, mut factors) = ([0.0f32; TILE], [1.0f32; TILE]);
        for row in clip(footprint.min[1], footprint.max[1], rows) {
            let line = lens.row(&footprint, row as f64 + 0.5);
            for (out, x) in square.iter_mut().zip(covered.clone()) {
                *out = lens.square(&line, x as f64 + 0.5) as f32;
            }
            if line.ray.is_some() {
                for (out, x) in factors.iter_mut().zip(covered.clone()) {
                    *out = lens.factor(&line, x as f64 + 0.5) as f32;
                }
            }
            let start = (row - rows.start) * columns.len() + covered.start - columns.start;
            let rays = self.rays[start..].iter_mut().zip(&mut self.ends[start..]);
            let places = square.iter().zip(&factors);
            for ((ray, end), (&square, factor)) in rays.zip(places).take(covered.len()) {
                if square >= 1.0 || ray.alpha >= termination {
                    continue;
                }
                ray.under(color, opacity(depth * factor * evaluate(profile, square)));
                met += 1;
                if ray.alpha >= termination {
                    *end = place;
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
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::cpu::volume::Scenery;
    use crate::cpu::volume::tests::{Cloud, RAMP, look, merger, perspective, scenery};
    use crate::synth::random::Random;
    use crate::view::Projection;
    use glam::DVec3;

    fn sorted(view: &View, cloud: &Cloud, densities: &[f32], scenery: &Scenery) -> Colors {
        let batch = cloud.batch().with_density(Some(densities)).unwrap();
        let options = VolumeOptions { smallest: 0.0, ..VolumeOptions::default() };
        draw(view, &[batch], &scenery.classifier, (scenery.termination, 1.0), &options).unwrap().0
    }

    #[test]
    fn the_order_of_the_input_changes_nothing() {
        let mut cloud = merger(6_000);
        let view = perspective(DVec3::new(60.0, 40.0, 90.0), 100, 70);
        let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![]);
        let density = |cloud: &Cloud| -> Vec<f32> {
            cloud.h.iter().zip(&cloud.mass).map(|(h, mass)| 12.0 * mass / h.powi(3)).collect()
        };
        // Some at the same depth exactly.
        for i in 0..200 {
            cloud.positions[i + 200] = cloud.positions[i];
        }
        let first = sorted(&view, &cloud, &density(&cloud), &scenery);
        assert!(first.rgba.iter().any(|pixel| pixel[3] > 0.5));
        let mut random = Random::new(8, 1);
        for i in (1..cloud.h.len()).rev() {
            let j = (random.uniform() * (i + 1) as f64) as usize;
            cloud.positions.swap(i, j);
            cloud.h.swap(i, j);
            cloud.mass.swap(i, j);
            cloud.attribute.swap(i, j);
        }
        let second = sorted(&view, &cloud, &density(&cloud), &scenery);
        let bits = |colors: &Colors| colors.rgba.as_flattened().iter().map(|c| c.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&first), bits(&second));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(bits(&first), bits(&pool.install(|| sorted(&view, &cloud, &density(&cloud), &scenery))));
    }

    #[test]
    fn one_particle_is_its_optical_depth_and_the_nearer_one_hides_the_farther() {
        // 0.3 for each 0.5 at any density above 0.1.
        let slab = "(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])";
        let plain = scenery(slab, [0.1, 10.0], 0.5, vec![]);
        let mut cloud = Cloud::default();
        cloud.push([0.1, -0.05, 0.3], 0.5, 0.2, 7.0);
        let view = look(DVec3::new(0.0, 0.0, 3.0), Projection::Orthographic { height: 1.2 }, 64, 64);
        let kappa = -(0.7f64.ln()) / 0.5;
        let at = view.to_camera(DVec3::from_array(cloud.positions[0]));
        for (index, pixel) in sorted(&view, &cloud, &[1.5], &plain).rgba.iter().enumerate() {
            let [x, y] = [(index % 64) as f64 - 31.5, 31.5 - (index / 64) as f64].map(|at| at * 1.2 / 64.0);
            let q = (x - at.x).hypot(y - at.y) / 0.5;
            let depth = kappa / 1.5 * 0.2 * Kernel::CubicSpline.projected(q) / 0.25;
            let expected = 1.0 - (-depth).exp();
            assert!((f64::from(pixel[3]) - expected).abs() < 1e-3, "{pixel:?} {expected}");
        }
        // Two opaque ones, of low and of high attribute.
        let colored = scenery(
            "(opacity: [(0.0, 0.0), (0.01, 1.0)], brightness: [(0.0, 0.5)], hue: Some((color_map: \"plasma\", scale: linear, \
             range: auto)))",
            [0.1, 10.0],
            0.01,
            vec![],
        );
        let pixel = |depths: [f64; 2]| {
            let mut cloud = Cloud::default();
            cloud.push([0.0, 0.0, depths[0]], 0.5, 1.0, -1.0);
            cloud.push([0.0, 0.0, depths[1]], 0.5, 1.0, 1.0);
            sorted(&view, &cloud, &[2.0, 2.0], &colored).rgba[32 * 64 + 32]
        };
        assert_ne!(pixel([0.0, 1.0]), pixel([1.0, 0.0]));
        let mut alone = Cloud::default();
        alone.push([0.0, 0.0, 1.0], 0.5, 1.0, 1.0);
        let near = sorted(&view, &alone, &[2.0], &colored).rgba[32 * 64 + 32];
        assert!((0..3).all(|k| (pixel([0.0, 1.0])[k] - near[k]).abs() < 0.01), "{near:?}");
    }

    #[test]
    fn a_homogeneous_block_has_its_optical_depth() {
        let cloud = Cloud::lattice(20, 4.0);
        let scenery =
            scenery("(opacity: [(0.0, 0.0), (0.01, 0.3)], brightness: [(0.0, 1.0)])", [0.1, 10.0], 2.5, vec![]);
        let view = look(DVec3::new(0.0, 0.0, 9.0), Projection::Orthographic { height: 1.2 }, 33, 21);
        let expected = 1.0 - 0.7f64.powf(4.0 / 2.5);
        for pixel in &sorted(&view, &cloud, &vec![1.0; cloud.h.len()], &scenery).rgba {
            assert!((f64::from(pixel[3]) - expected).abs() < 0.03, "{pixel:?} {expected}");
        }
    }

    #[test]
    fn particles_without_densities_are_refused() {
        let scenery = scenery(RAMP, [1e-8, 1e-3], 4.0, vec![]);
        let view = perspective(DVec3::new(0.0, 0.0, 9.0), 30, 20);
        let error =
            draw(&view, &[Cloud::lattice(3, 2.0).batch()], &scenery.classifier, (1.0, 1.0), &VolumeOptions::default());
        assert!(error.unwrap_err().to_string().starts_with("density is not there"));
    }
}
