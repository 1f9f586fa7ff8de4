//! Particles as spheres, and the smooth surface over them that a depth buffer gives (F12 5.9, screen-space techniques).
//!
//! Three passes: the depth at which each line of sight first meets a sphere; a filter over these depths, which leaves out
//! neighbours that belong to another surface in front or behind; normals from differences of the smoothed depths, and the light
//! of the isosurfaces. Spheres are as large as a share of their smoothing length, so the filter is too: its radius is that
//! of the sphere that a pixel shows, and the smoothness does not depend on the distance.

use super::Splats;
use super::footprint::Lens;
use super::paths::PathFragments;
use super::paths::fragments::over;
use super::screen_tiles::{Reach, Tiles};
use super::shadowing::Covering;
use super::volume::particles::{Taken, project};
use super::volume::{Light, OpaqueDepths, VolumeError, VolumeReport, extents};
use crate::color::Colors;
use crate::color::transfer::Scale;
use crate::model::Kernel;
use crate::view::{PerspectiveGrid, Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Widest filter, pixels.
pub const WIDEST: f32 = 40.0;
/// Pixels around one that its smoothed surface depends on.
pub const NEIGHBOURHOOD: u32 = (WIDEST as u32 + 1) * ROUNDS as u32;
/// Rounds of the filter: its two directions are passed one after the other, which one round alone would show.
pub const ROUNDS: usize = 2;
/// Neighbours count whose depth differs by less than so many radii.
pub const NEIGHBOUR: f32 = 2.0;
/// How far surfaces that are smoothed in two pictures may be apart, radii of spheres.
const SLACK: f64 = 0.5;
/// Pairs of a tile and a particle that are held at once.
const PAIRS: usize = 1 << 22;

/// Which spheres are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereOptions {
    /// Radius of a sphere, in smoothing lengths.
    pub radius: f64,
    /// Least density of a particle.
    pub least: f64,
    /// Radius of the filter, in radii of the sphere that a pixel shows; 0: none.
    pub smoothing: f64,
    /// Depth of the near plane; around the data without.
    pub near: Option<f64>,
    /// Depth of the far plane; around the data without.
    pub far: Option<f64>,
    /// Whether it is told what a picture hides.
    pub occlusion: bool,
}

impl SphereOptions {
    /// The same for a lamp: planes are at depths from the eye, and nobody asks what is hidden from it.
    #[must_use]
    pub fn for_lamp(self) -> SphereOptions {
        SphereOptions { near: None, far: None, occlusion: false, ..self }
    }
}

/// Colours of a surface by one value.
#[derive(Clone, Debug)]
pub struct SurfaceColors {
    /// From the low end of the range to the high one, linear light.
    pub colors: Arc<[[f32; 4]]>,
    /// Whether they follow the attribute, not the density.
    pub of_attribute: bool,
    /// How values are placed.
    pub scale: Scale,
    /// Values at the ends.
    pub range: [f64; 2],
}

impl PartialEq for SurfaceColors {
    fn eq(&self, other: &SurfaceColors) -> bool {
        Arc::ptr_eq(&self.colors, &other.colors)
            && self.of_attribute == other.of_attribute
            && self.scale == other.scale
            && self.range == other.range
    }
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Depth of the surface; infinite where there is none.
    pub depth: f32,
    /// Radius of the sphere, world units.
    pub radius: f32,
    /// The particle's density.
    pub density: f32,
    /// The particle's attribute; 0 without.
    pub attribute: f32,
}

impl Hit {
    /// Nothing.
    pub const NONE: Hit = Hit { depth: f32::INFINITY, radius: 0.0, density: 0.0, attribute: 0.0 };
}

/// The surface in front of each pixel, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Front {
    /// Pixels in a row.
    pub width: usize,
    /// What each pixel shows.
    pub hits: Vec<Hit>,
}

/// A sphere in camera space.
#[derive(Clone, Copy)]
struct Sphere {
    place: [f32; 3],
    hit: Hit,
}

/// Finds the first sphere along each line of sight, of particles whose own densities count `density_scale`-fold
/// ([`super::volume::particles::density_scale`]). Where two are at the same depth, which one a pixel shows does not depend on
/// the number of threads.
///
/// # Errors
/// [`VolumeError`] when nothing is in view, no particle is dense enough, or the planes make no sense.
pub fn front(
    view: &View,
    batches: &[Splats<'_>],
    density_scale: f32,
    options: &SphereOptions,
) -> Result<(Front, VolumeReport), VolumeError> {
    let start = Instant::now();
    let sigma = PerspectiveGrid::sigma_of(view, 1.0);
    let taken = Taken { sigma, smallest: 0.0, stride: 1, kernel: Kernel::default() };
    let [near, far] = extents::planes_around(view, batches, &taken, [options.near, options.far])?;
    let particles = project(view, batches, &taken).unless_empty()?;
    let chunks = particles.chunks.par_iter().zip(&particles.densities);
    let of_chunk = chunks.flat_map_iter(|(chunk, densities)| {
        chunk.iter().zip(densities).filter_map(|(particle, &density)| {
            let ([x, y, z, h], density) = (particle.place, density * density_scale);
            let attribute = if particle.mass != 0.0 { particle.weighted / particle.mass } else { 0.0 };
            let hit = Hit { depth: z, radius: h * options.radius as f32, density, attribute };
            (f64::from(density) >= options.least && f64::from(z) <= far).then_some(Sphere { place: [x, y, z], hit })
        })
    });
    let spheres: Vec<Sphere> = of_chunk.collect();
    let (lens, tiles) = (Lens::new(view), Tiles::new(view));
    let reach = |sphere: &Sphere| {
        let camera = DVec3::from_array(sphere.place.map(f64::from));
        tiles.reach(&lens, &lens.at(camera, f64::from(sphere.hit.radius))?)
    };
    let (spheres, reaches): (Vec<Sphere>, Vec<Reach>) =
        spheres.into_par_iter().filter_map(|sphere| reach(&sphere).map(|reach| (sphere, reach))).unzip();
    if spheres.is_empty() {
        let expected = "a density that some particle in view has".into();
        return Err(VolumeError::Setting { field: "threshold", found: options.least.to_string(), expected });
    }
    let mut drawn: Vec<Vec<Hit>> = (0..tiles.count())
        .map(|tile| {
            let [columns, rows] = tiles.pixels(tile);
            vec![Hit::NONE; columns.len() * rows.len()]
        })
        .collect();
    let mut report = VolumeReport {
        grid: [view.width, view.height, 1],
        planes: [near, far],
        particles: particles.len(),
        ..VolumeReport::default()
    };
    let (mut next, mut most) = (0, 0);
    while next < spheres.len() {
        let (bins, end) = tiles.bin(&reaches, next..spheres.len(), PAIRS, |_| true);
        next = end;
        report.pairs += bins.len() as u64;
        report.slabs += 1;
        most = most.max(4 * bins.len());
        drawn.par_iter_mut().enumerate().for_each(|(index, hits)| {
            let pixels = tiles.pixels(index);
            bins.of(index).iter().for_each(|&i| nearest(&lens, &pixels, &spheres[i as usize], near as f32, hits));
        });
    }
    let width = view.width as usize;
    let mut front = Front { width, hits: vec![Hit::NONE; width * view.height as usize] };
    for (index, hits) in drawn.iter().enumerate() {
        let [columns, rows] = tiles.pixels(index);
        for (y, hits) in rows.zip(hits.chunks(columns.len().max(1))) {
            front.hits[y * width + columns.start..y * width + columns.end].copy_from_slice(hits);
        }
    }
    let of_pixels = 2 * front.hits.len() * size_of::<Hit>();
    report.memory = Some(
        particles.bytes() + (spheres.len() * (size_of::<Sphere>() + size_of::<Reach>()) + most + of_pixels) as u64,
    );
    report.resampling = start.elapsed();
    Ok((front, report))
}

/// Draws a sphere into a tile where it is in front.
fn nearest(lens: &Lens, [columns, rows]: &[std::ops::Range<usize>; 2], sphere: &Sphere, near: f32, hits: &mut [Hit]) {
    let camera = DVec3::from_array(sphere.place.map(f64::from));
    let radius = f64::from(sphere.hit.radius);
    let Some(footprint) = lens.at(camera, radius) else { return };
    // Pixels whose centres it may cover; casts saturate.
    let clip = |from: f64, to: f64, range: &std::ops::Range<usize>| {
        let first = ((from - 0.5).ceil().max(0.0) as usize).max(range.start);
        first..((to + 0.5).floor().max(0.0) as usize).min(range.end)
    };
    for y in clip(footprint.min[1], footprint.max[1], rows) {
        let row = lens.row(&footprint, y as f64 + 0.5);
        for x in clip(footprint.min[0], footprint.max[0], columns) {
            let square = lens.square(&row, x as f64 + 0.5);
            if square >= 1.0 {
                continue;
            }
            // The ray's slope, 0 for parallel ones, gives the depth of its nearest point and how deep a way along it is.
            let [u, v] = lens.slope([x as f64 + 0.5, y as f64 + 0.5]);
            let length = u * u + v * v + 1.0;
            let middle = (camera.z + u * camera.x - v * camera.y) / length;
            let depth = (middle - radius * ((1.0 - square) / length).sqrt()) as f32;
            let hit = &mut hits[(y - rows.start) * columns.len() + x - columns.start];
            if depth >= near && depth < hit.depth {
                *hit = Hit { depth, ..sphere.hit };
            }
        }
    }
}

impl Front {
    /// The depth of what each pixel shows, row by row; infinite where there is nothing.
    pub fn depths(&self) -> Vec<f32> {
        self.hits.iter().map(|hit| hit.depth).collect()
    }

    /// The mean radius of what is shown, world units.
    fn mean_radius(&self) -> f64 {
        let shown = self.hits.iter().filter(|hit| hit.depth.is_finite());
        let (sum, count) = shown.fold((0.0, 0.0), |(sum, count), hit| (sum + f64::from(hit.radius), count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// What of a picture it covers, smoothed by so many radii.
    pub fn covering(&self, smoothing: f64) -> Covering {
        // Of two pictures each is smoothed by itself.
        let slack = if smoothing > 0.0 { SLACK * self.mean_radius() } else { 0.0 };
        Covering { depths: self.depths(), light: None, slack }
    }

    /// What spheres of a radius (smoothing lengths) hide, before they are smoothed: smoothing looks at no more than what each pixel shows.
    pub fn opaque(&self, view: &View, radius: f64) -> OpaqueDepths {
        OpaqueDepths::new(view, self.depths(), 1.0, 0.0).reaching(radius)
    }

    /// Smooths depths, densities and attributes. Silhouettes stay where they are.
    pub fn smooth(&mut self, view: &View, smoothing: f64) {
        if smoothing <= 0.0 {
            return;
        }
        let (width, focal) = (self.width, view.focal_pixels() as f32);
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        let height = self.hits.len() / width.max(1);
        let reach = |hit: &Hit| {
            let pixels = hit.radius * focal / if perspective { hit.depth } else { 1.0 };
            (pixels * smoothing as f32).clamp(1.0, WIDEST)
        };
        let mut other = self.hits.clone();
        for pass in 0..2 * ROUNDS {
            let from = &self.hits;
            let along_x = pass % 2 == 0;
            let row = |(y, out): (usize, &mut [Hit])| {
                for (x, out) in out.iter_mut().enumerate() {
                    let center = from[y * width + x];
                    if center.depth.is_infinite() {
                        *out = center;
                        continue;
                    }
                    let reach = reach(&center);
                    let steps = reach.ceil() as usize;
                    let (at, size, stride) = if along_x { (x, width, 1) } else { (y, height, width) };
                    let base = y * width + x - at * stride;
                    let (mut sum, mut total) = ([0.0f32; 3], 0.0f32);
                    for k in at.saturating_sub(steps)..(at + steps + 1).min(size) {
                        let hit = &from[base + k * stride];
                        let away = (hit.depth - center.depth) / (NEIGHBOUR * center.radius);
                        // Infinity and NaN compare false.
                        if away.abs() < 1.0 {
                            let share = k.abs_diff(at) as f32 / (reach + 1.0);
                            let weight = ((1.0 - share * share).max(0.0) * (1.0 - away * away)).powi(2);
                            sum[0] += weight * (hit.depth - center.depth);
                            sum[1] += weight * hit.density;
                            sum[2] += weight * hit.attribute;
                            total += weight;
                        }
                    }
                    let [depth, density, attribute] = sum.map(|sum| sum / total.max(f32::MIN_POSITIVE));
                    *out = Hit { depth: center.depth + depth, density, attribute, ..center };
                }
            };
            other.par_chunks_mut(width).enumerate().for_each(row);
            std::mem::swap(&mut self.hits, &mut other);
        }
    }

    /// Colours: `color` of the density and the attribute of each hit, lit by `light`. Opaque where there is a surface.
    pub fn shade(&self, view: &View, light: Option<&Light>, color: impl Fn(f32, f32) -> [f32; 3] + Sync) -> Colors {
        let lens = Lens::new(view);
        let rows = self.hits.par_chunks(self.width).enumerate();
        let rgba = rows.flat_map_iter(|(y, row)| {
            let (lens, color) = (&lens, &color);
            row.iter().enumerate().map(move |(x, hit)| {
                if hit.depth.is_infinite() {
                    return [0.0; 4];
                }
                let own = color(hit.density, hit.attribute);
                let [r, g, b] = match light {
                    Some(light) => light.shade(own, self.cosine(view, lens, x, y)),
                    None => own,
                };
                [r, g, b, 1.0]
            })
        });
        Colors { width: view.width, height: view.height, rgba: rgba.collect() }
    }

    /// Puts other surfaces into a picture of this one: in each pixel those that are in front of it, or all where it is not.
    pub fn lie_among(&self, surfaces: &PathFragments, colors: &mut Colors) {
        let width = self.width;
        let of_hit = |(index, (pixel, hit)): (usize, (&mut [f32; 4], &Hit))| {
            let fragments = surfaces.of(index % width, index / width);
            let in_front = fragments.partition_point(|fragment| fragment.depth < hit.depth);
            let mut sum = over(&fragments[..in_front]);
            let through = 1.0 - sum[3];
            sum.iter_mut().zip(&*pixel).for_each(|(sum, own)| *sum += through * own);
            *pixel = sum;
        };
        colors.rgba.par_iter_mut().zip(&self.hits).enumerate().for_each(of_hit);
    }

    /// The cosine between a pixel's line of sight and the surface's normal.
    fn cosine(&self, view: &View, lens: &Lens, x: usize, y: usize) -> f32 {
        let center = self.hits[y * self.width + x];
        let height = self.hits.len() / self.width;
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        let ray = |x: usize, y: usize| {
            let [u, v] = lens.slope([x as f64 + 0.5, y as f64 + 0.5]);
            DVec3::new(u, -v, 1.0)
        };
        let place = |x: usize, y: usize, depth: f32| match perspective {
            true => ray(x, y) * f64::from(depth),
            false => {
                let [x, y] = [x as f64, -(y as f64)].map(|at| at / view.focal_pixels());
                DVec3::new(x, y, f64::from(depth))
            }
        };
        let here = place(x, y, center.depth);
        // The neighbour before or behind whose depth is nearer: the other one may be another surface.
        let along = |before: Option<(usize, usize)>, after: Option<(usize, usize)>| {
            let step = |at: Option<(usize, usize)>, sign: f64| {
                let (x, y) = at?;
                let depth = self.hits[y * self.width + x].depth;
                let away = (depth - center.depth).abs();
                (away < NEIGHBOUR * center.radius).then(|| (away, (place(x, y, depth) - here) * sign))
            };
            match (step(before, -1.0), step(after, 1.0)) {
                (Some(a), Some(b)) => Some(if a.0 < b.0 { a.1 } else { b.1 }),
                (a, b) => a.or(b).map(|step| step.1),
            }
        };
        let across = along(x.checked_sub(1).map(|x| (x, y)), (x + 1 < self.width).then_some((x + 1, y)));
        let down = along(y.checked_sub(1).map(|y| (x, y)), (y + 1 < height).then_some((x, y + 1)));
        match (across, down) {
            (Some(across), Some(down)) => {
                across.cross(down).normalize_or_zero().dot(ray(x, y).normalize()).abs() as f32
            }
            // A surface of one pixel's width: its edge.
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::cpu::volume::tests::{Cloud, look};

    const OPTIONS: SphereOptions =
        SphereOptions { radius: 0.5, least: 1.0, smoothing: 1.5, near: None, far: None, occlusion: false };

    fn seen(view: &View, cloud: &Cloud) -> Front {
        let densities = vec![2.0; cloud.h.len()];
        front(view, &[cloud.batch().with_density(Some(&densities)).unwrap()], 1.0, &OPTIONS).unwrap().0
    }

    /// Where each pixel's line of sight meets the sphere around the origin, and the cosine there.
    fn expected(view: &View, radius: f64, index: usize) -> Option<(f64, f64)> {
        let focal = view.focal_pixels();
        let half = [view.width, view.height].map(|pixels| 0.5 * f64::from(pixels));
        let [x, y] = [index % view.width as usize, index / view.width as usize].map(|at| at as f64 + 0.5);
        let [x, y] = [(x - half[0]) / focal, (half[1] - y) / focal];
        let center = view.to_camera(DVec3::ZERO);
        let (origin, ray) = match view.projection {
            Projection::Orthographic { .. } => (DVec3::new(x, y, 0.0) - center, DVec3::Z),
            Projection::Perspective { .. } => (-center, DVec3::new(x, y, 1.0).normalize()),
        };
        let along = origin.dot(ray);
        let square = along * along - origin.length_squared() + radius * radius;
        (square > 0.0).then(|| {
            let place = origin + (-along - square.sqrt()) * ray;
            ((place + center).z, place.dot(ray).abs() / radius)
        })
    }

    #[test]
    fn the_depth_of_one_sphere_is_the_analytic_one() {
        let mut cloud = Cloud::default();
        cloud.push([0.0; 3], 2.0, 1.0, 3.0);
        let light = Light { ambient: 0.0, specular: 0.0, shininess: 1.0 };
        for projection in [Projection::Orthographic { height: 2.4 }, Projection::Perspective { fov_y: 0.7 }] {
            let view = look(DVec3::new(1.0, 0.5, 4.0), projection, 120, 100);
            let found = seen(&view, &cloud);
            let colors = found.shade(&view, Some(&light), |_, attribute| [attribute / 3.0; 3]);
            let (mut covered, mut error) = (0, 0.0);
            for (index, hit) in found.hits.iter().enumerate() {
                let expected = expected(&view, 1.0, index);
                assert_eq!(expected.is_some(), hit.depth.is_finite(), "{index}");
                let Some((depth, cosine)) = expected else { continue };
                assert!((f64::from(hit.depth) - depth).abs() < 1e-5, "{hit:?} {depth}");
                assert_eq!(hit.attribute, 3.0);
                covered += 1;
                error += (f64::from(colors.rgba[index][0]) - cosine).abs();
            }
            assert!(covered > 2000 && error / f64::from(covered) < 0.02, "{covered} {error}");
        }
    }

    #[test]
    fn smoothing_flattens_bumps_and_keeps_silhouettes() {
        // A wall of spheres, and one sphere far in front of it.
        let mut cloud = Cloud::default();
        for index in 0..400 {
            let at = |n: i32| (f64::from(n % 20) - 9.5) * 0.2;
            cloud.push([at(index), at(index / 20), 0.0], 0.4, 1.0, 0.0);
        }
        cloud.push([0.0, 0.0, 3.0], 1.0, 1.0, 0.0);
        let view = look(DVec3::new(0.0, 0.0, 9.0), Projection::Orthographic { height: 3.0 }, 150, 150);
        let rough = seen(&view, &cloud);
        let mut smooth = rough.clone();
        smooth.smooth(&view, 1.5);
        let spread = |front: &Front| {
            let wall: Vec<f32> = front.hits.iter().map(|hit| hit.depth).filter(|depth| *depth > 7.0).collect();
            let mean = wall.iter().sum::<f32>() / wall.len() as f32;
            (wall.iter().map(|depth| (depth - mean).powi(2)).sum::<f32>() / wall.len() as f32).sqrt()
        };
        assert!(spread(&smooth) < 0.35 * spread(&rough), "{} {}", spread(&smooth), spread(&rough));
        for (before, after) in rough.hits.iter().zip(&smooth.hits) {
            assert_eq!(before.depth < 7.0, after.depth < 7.0);
            assert_eq!(before.depth.is_finite(), after.depth.is_finite());
        }
    }

    #[test]
    fn what_is_too_thin_is_left_out_and_said() {
        let cloud = Cloud::lattice(4, 2.0);
        let view = look(DVec3::new(0.0, 0.0, 9.0), Projection::Orthographic { height: 3.0 }, 20, 20);
        let densities: Vec<f32> = (0..64).map(|i| i as f32 / 16.0).collect();
        let batch = cloud.batch().with_density(Some(&densities)).unwrap();
        let with = |least| front(&view, &[batch], 1.0, &SphereOptions { least, ..OPTIONS });
        assert!(with(3.75).is_ok());
        assert_eq!(
            with(4.0).unwrap_err().to_string(),
            "threshold is 4, expected a density that some particle in view has"
        );
    }
}
