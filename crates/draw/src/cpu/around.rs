//! Splats of one face of a panorama, so that no face shows where it ends.
//!
//! What a renderer of a flat picture does by its own pixels or its own plane is done here by the panorama's:
//!
//! - Kernels that fill more than 30 degrees to each side of the eye, or hold it, are summed for rays that begin at the eye
//!   ([`super::half_line`]), whichever side of the face's plane their centre is on. They are smooth: a grid of rays half a degree
//!   apart, read with bilinear interpolation, has them to 1e-3 of each one's peak.
//! - Discs of a fixed size in pixels subtend as many of the panorama's pixels, in every direction: each becomes a sphere around
//!   the eye that subtends its angle, and whose flux over a pixel's solid angle is the disc's.
//!
//! Ellipsoids about the eye are summed in the space in which they are balls; such rays cannot resolve very flat ones, which are made
//! thicker ([`FLATTEST`]). All others are drawn by the flat renderers, whose integrals along each pixel's own ray know no face.

use super::half_line::HalfLine;
use super::{Counts, Extent, Positions, SplatError, SplatOptions, Splats, draw_counted};
use crate::color::Accumulation;
use crate::model::{Covariance, Kernel};
use crate::view::View;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Particles nearer than so many smoothing lengths, or longest semi-axes, are summed ray by ray.
pub const NEAR: f64 = 2.0;
/// The shortest semi-axis of an ellipsoid that is, over the longest.
pub const FLATTEST: f64 = 0.1;
/// Distance of those rays, radians.
const STEP: f64 = 0.008;

/// Columns of particles, owned.
struct Columns {
    positions: Vec<[f64; 3]>,
    reach: Reach,
    weight: Vec<f32>,
    attribute: Option<Vec<f32>>,
}

/// How far they reach.
enum Reach {
    /// Smoothing lengths.
    Balls(Vec<f32>),
    /// Second moments.
    Ellipsoids(Vec<Covariance>),
}

impl Columns {
    fn with(attribute: bool, reach: Reach) -> Columns {
        Columns { positions: Vec::new(), reach, weight: Vec::new(), attribute: attribute.then(Vec::new) }
    }

    /// Adds a particle whose reach the caller adds.
    fn push(&mut self, place: DVec3, weight: f32, attribute: Option<f32>) {
        self.positions.push(place.to_array());
        self.weight.push(weight);
        if let (Some(column), Some(value)) = (&mut self.attribute, attribute) {
            column.push(value);
        }
    }

    fn splats(&self) -> Result<Splats<'_>, SplatError> {
        let positions = Positions::World(&self.positions);
        let extent = match &self.reach {
            Reach::Balls(lengths) => Extent::World(lengths),
            Reach::Ellipsoids(covariances) => Extent::Ellipsoids(covariances),
        };
        Splats::new(positions, extent, &self.weight, self.attribute.as_deref())
    }
}

/// The space in which a particle's support is the unit ball.
#[derive(Clone, Copy)]
struct Stretched {
    /// From world units.
    to_ball: DMat3,
    /// Volume of the support over that of the unit ball.
    volume: f64,
}

impl Stretched {
    /// That of a particle of a batch; of an ellipsoid with semi-axes of at least `flattest` of the longest. None without an extent in space.
    fn of(batch: &Splats<'_>, index: usize, kernel: Kernel, flattest: f64) -> Option<Stretched> {
        let (radii, axes) = match batch.extent() {
            Extent::Pixels(_) => return None,
            Extent::World(lengths) => (DVec3::splat(f64::from(lengths[index])), DMat3::IDENTITY),
            Extent::Ellipsoids(covariances) => {
                let (values, axes) = covariances[index].principal();
                let radii = (values / kernel.variance()).max(DVec3::ZERO).map(f64::sqrt);
                (radii.max(DVec3::splat(flattest * radii.x)), axes)
            }
        };
        let to_ball = DMat3::from_diagonal(radii.recip()) * axes.transpose();
        let is_solid = radii.min_element() > 0.0 && to_ball.is_finite();
        is_solid.then_some(Stretched { to_ball, volume: radii.element_product() })
    }
}

/// A particle about the eye.
#[derive(Clone, Copy)]
struct Near {
    /// Its middle relative to the eye, where it is a ball.
    place: DVec3,
    to_ball: DMat3,
    /// Its weight over its volume, and the same times the attribute.
    amplitudes: [f64; 2],
}

/// What becomes of a batch.
enum Part {
    /// Drawn as it is.
    Whole,
    /// Particles about the eye, and the others.
    Split(Vec<Near>, Columns),
    /// Spheres of unit distance around the origin.
    Sky(Columns),
}

/// Draws batches as a face of a panorama whose pixels are `pixel` radians wide.
///
/// # Errors
/// [`SplatError`] as [`Splats::new`].
pub fn draw_face(
    view: &View,
    batches: &[Splats<'_>],
    pixel: f64,
    options: &SplatOptions,
) -> Result<(Accumulation, Counts), SplatError> {
    let parts: Vec<Part> = batches.par_iter().map(|batch| part((view.eye, options.kernel), batch, pixel)).collect();
    let (mut world, mut sky, mut near) = (Vec::new(), Vec::new(), Vec::new());
    for (batch, part) in batches.iter().zip(&parts) {
        match part {
            Part::Whole => world.push(*batch),
            Part::Split(about, others) => {
                near.extend_from_slice(about);
                world.push(others.splats()?);
            }
            Part::Sky(columns) => sky.push(columns.splats()?),
        }
    }
    let (mut picture, mut counts) = draw_counted(view, &world, options);
    if !sky.is_empty() {
        let (discs, drawn) = draw_counted(&View { eye: DVec3::ZERO, ..*view }, &sky, options);
        counts += drawn;
        match world.is_empty() {
            true => picture = discs,
            false => add(&mut picture, &discs),
        }
    }
    counts.drawn += near.len() as u64;
    add_near(view, options.kernel, &near, batches.iter().any(|batch| batch.attribute().is_some()), &mut picture);
    Ok((picture, counts))
}

/// Adds pictures of the same size.
pub fn add(picture: &mut Accumulation, other: &Accumulation) {
    if picture.ps.is_empty() && !other.ps.is_empty() {
        picture.ps = vec![0.0; picture.p.len()];
    }
    let channels = [(&mut picture.p, &other.p), (&mut picture.ps, &other.ps)];
    channels.into_iter().for_each(|(to, from)| to.iter_mut().zip(from).for_each(|(to, from)| *to += from));
}

fn part((eye, kernel): (DVec3, Kernel), batch: &Splats<'_>, pixel: f64) -> Part {
    let attribute = |i: usize| batch.attribute().map(|values| values[i]);
    let positions = batch.positions();
    match batch.extent() {
        Extent::Pixels(radius) => {
            let h = (f64::from(radius) * pixel).min(1.5).sin() as f32;
            let mut lengths = Vec::new();
            let mut sky = Columns::with(batch.attribute().is_some(), Reach::Balls(Vec::new()));
            for (i, &weight) in batch.weight().iter().enumerate() {
                // A disc on the eye itself is nowhere.
                if let Some(direction) = (positions.world(i) - eye).try_normalize() {
                    sky.push(direction, (f64::from(weight) * pixel * pixel) as f32, attribute(i));
                    lengths.push(h);
                }
            }
            sky.reach = Reach::Balls(lengths);
            Part::Sky(sky)
        }
        Extent::World(_) | Extent::Ellipsoids(_) => {
            let is_near = |i: usize| {
                // By the default kernel, which reaches farthest of all.
                let h = batch.farthest(i).map_or(0.0, f64::from);
                h > 0.0 && h.is_finite() && (positions.world(i) - eye).length_squared() < (NEAR * h).powi(2)
            };
            if !(0..batch.len()).any(is_near) {
                return Part::Whole;
            }
            let (about, far): (Vec<usize>, Vec<usize>) = (0..batch.len()).partition(|&i| is_near(i));
            let reach = match batch.extent() {
                Extent::Ellipsoids(covariances) => Reach::Ellipsoids(far.iter().map(|&i| covariances[i]).collect()),
                Extent::World(lengths) => Reach::Balls(far.iter().map(|&i| lengths[i]).collect()),
                Extent::Pixels(radius) => Reach::Balls(vec![radius; far.len()]),
            };
            let mut others = Columns::with(batch.attribute().is_some(), reach);
            far.iter().for_each(|&i| others.push(positions.world(i), batch.weight()[i], attribute(i)));
            let near = about.into_iter().filter_map(|i| {
                let Stretched { to_ball, volume } = Stretched::of(batch, i, kernel, FLATTEST)?;
                let place = to_ball * (positions.world(i) - eye);
                let amplitude = f64::from(batch.weight()[i]) / volume;
                let amplitudes = [amplitude, amplitude * attribute(i).map_or(0.0, f64::from)];
                let finite = amplitudes.iter().all(|amplitude| amplitude.is_finite());
                (finite && place.is_finite()).then_some(Near { place, to_ball, amplitudes })
            });
            Part::Split(near.collect(), others)
        }
    }
}

/// What a ray from the eye meets of a particle there.
fn met(table: &HalfLine, near: &Near, ray: DVec3) -> f64 {
    let ray = near.to_ball * ray;
    let longer = ray.length();
    let along = near.place.dot(ray) / longer;
    let square = (near.place.length_squared() - along * along).max(0.0);
    table.at(square, along) / longer
}

/// Adds particles about the eye.
fn add_near(view: &View, kernel: Kernel, near: &[Near], attribute: bool, picture: &mut Accumulation) {
    if near.is_empty() {
        return;
    }
    if attribute && picture.ps.is_empty() {
        picture.ps = vec![0.0; picture.p.len()];
    }
    let table = HalfLine::of(kernel);
    let step = (STEP * view.focal_pixels()).floor().max(1.0);
    let nodes = |pixels: u32| (f64::from(pixels) / step).ceil() as usize + 1;
    let [columns, rows] = [nodes(view.width), nodes(view.height)];
    let grid: Vec<[f64; 2]> = (0..columns * rows)
        .into_par_iter()
        .map(|index| {
            let point = [(index % columns) as f64 * step, (index / columns) as f64 * step];
            let ray = (view.at_depth(point, 1.0) - view.eye).normalize();
            near.iter().fold([0.0; 2], |sum, near| {
                let met = met(table, near, ray);
                [sum[0] + met * near.amplitudes[0], sum[1] + met * near.amplitudes[1]]
            })
        })
        .collect();
    let locate = |pixel: usize, count: usize| {
        let place = (pixel as f64 + 0.5) / step;
        let index = (place as usize).min(count.saturating_sub(2));
        (index, place - index as f64)
    };
    let width = view.width as usize;
    let add = |channel: usize, values: &mut [f32]| {
        values.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let (j, v) = locate(y, rows);
            for (x, value) in row.iter_mut().enumerate() {
                let (i, u) = locate(x, columns);
                let at = |i: usize, j: usize| grid[j * columns + i][channel];
                let upper = at(i, j) * (1.0 - u) + at(i + 1, j) * u;
                let lower = at(i, j + 1) * (1.0 - u) + at(i + 1, j + 1) * u;
                *value += (upper * (1.0 - v) + lower * v) as f32;
            }
        });
    };
    add(0, &mut picture.p);
    add(1, &mut picture.ps);
}

/// The reference: `P` and `P S` of one ray that begins at `origin`, summed over all particles in world units. Slow.
pub fn along_ray(batches: &[Splats<'_>], kernel: Kernel, origin: DVec3, direction: DVec3) -> [f64; 2] {
    const STEPS: u32 = 400;
    let ray = direction.normalize_or_zero();
    let mut sums = [0.0; 2];
    for batch in batches {
        for i in 0..batch.len() {
            let Some(Stretched { to_ball, volume }) = Stretched::of(batch, i, kernel, 0.0) else { continue };
            let (place, ray) = (to_ball * (batch.positions().world(i) - origin), to_ball * ray);
            let along = place.dot(ray) / ray.length();
            let square = place.length_squared() - along * along;
            if square.is_nan() || square >= 1.0 {
                continue;
            }
            let q = square.max(0.0).sqrt();
            let half = (1.0 - q * q).sqrt();
            let met = match along {
                _ if along >= half => kernel.projected(q),
                _ if along <= -half => 0.0,
                _ => {
                    let step = (half + along) / f64::from(STEPS);
                    let at = |k: u32| kernel.value(q.hypot((f64::from(k) + 0.5) * step - along));
                    (0..STEPS).map(at).sum::<f64>() * step
                }
            };
            let weight = f64::from(batch.weight()[i]) * met / (volume * ray.length());
            sums[0] += weight;
            sums[1] += weight * batch.attribute().map_or(0.0, |values| f64::from(values[i]));
        }
    }
    sums
}
