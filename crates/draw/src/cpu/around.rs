//! Splats of one face of a panorama, so that no face shows where it ends.
//!
//! What a renderer of a flat picture does by its own pixels or its own plane is done here by the panorama's:
//!
//! - Kernels that fill more than 30 degrees to each side of the eye, or hold it, are summed for rays that begin at the eye
//!   ([`super::about_eye`]).
//! - Discs of a fixed size in pixels subtend as many of the panorama's pixels, in every direction: each becomes a sphere around
//!   the eye that subtends its angle, and whose flux over a pixel's solid angle is the disc's.
//!
//! All others are drawn by the flat renderers, whose integrals along each pixel's own ray know no face. Surfaces hide what is behind them as
//! [`super::among`] says.

use super::about_eye::{AboutEye, Stretched, is_about, ray, step};
use super::among::{self, share_of};
use super::footprint::Lens;
use super::half_line::HalfLine;
use super::paths::PathFragments;
use super::{Counts, Extent, Positions, SplatError, SplatOptions, Splats, Summation, draw_counted};
use crate::color::Accumulation;
use crate::model::{Covariance, Kernel};
use crate::view::View;
use glam::DVec3;
use rayon::prelude::*;

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

/// A particle about the eye, with its weight over its volume, and the same times the attribute.
type Near = (AboutEye, [f64; 2]);

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
    draw_face_among(view, batches, pixel, options, None)
}

/// The same without what is behind surfaces of the face.
///
/// # Errors
/// As [`draw_face`].
pub fn draw_face_among(
    view: &View,
    batches: &[Splats<'_>],
    pixel: f64,
    options: &SplatOptions,
    surfaces: Option<&PathFragments>,
) -> Result<(Accumulation, Counts), SplatError> {
    let Some(surfaces) = surfaces else {
        let mut sums = FaceSums::new(view, pixel, options);
        sums.add(batches)?;
        return Ok(sums.finish());
    };
    let lens = Lens::new(view);
    let share = |place: DVec3| share_of(&lens, surfaces, view.to_camera(place));
    let parts: Vec<Part> =
        batches.par_iter().map(|batch| part((view.eye, options.kernel), batch, pixel, &share)).collect();
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
    let (mut picture, mut counts) = among::draw(view, &world, options, surfaces)?;
    if !sky.is_empty() {
        let (discs, drawn) = draw_counted(&View { eye: DVec3::ZERO, ..*view }, &sky, options);
        counts += drawn;
        match world.is_empty() {
            true => picture = discs,
            false => add(&mut picture, &discs),
        }
    }
    counts.drawn += near.len() as u64;
    let attribute = batches.iter().any(|batch| batch.attribute().is_some());
    add_near(view, options.kernel, &near, attribute, Some(surfaces), &mut picture);
    Ok((picture, counts))
}

/// A face that batches are added to, some at a time: it has the same bits whichever are added together, as long as their order is the same.
pub struct FaceSums {
    view: View,
    pixel: f64,
    kernel: Kernel,
    /// What is drawn as it is, and spheres around the origin; whether there are any.
    world: (Summation, bool),
    sky: (Summation, bool),
    near: Vec<Near>,
    attribute: bool,
}

impl FaceSums {
    /// Nothing is in it yet; the panorama's pixels are `pixel` radians wide.
    pub fn new(view: &View, pixel: f64, options: &SplatOptions) -> FaceSums {
        let world = (Summation::new(view, options), false);
        let sky = (Summation::new(&View { eye: DVec3::ZERO, ..*view }, options), false);
        let (kernel, near) = (options.kernel, Vec::new());
        FaceSums { view: *view, pixel, kernel, world, sky, near, attribute: false }
    }

    /// Adds batches.
    ///
    /// # Errors
    /// As [`draw_face`].
    pub fn add(&mut self, batches: &[Splats<'_>]) -> Result<(), SplatError> {
        let (about, pixel) = ((self.view.eye, self.kernel), self.pixel);
        let parts: Vec<Part> = batches.par_iter().map(|batch| part(about, batch, pixel, &|_| 1.0)).collect();
        let (mut world, mut sky) = (Vec::new(), Vec::new());
        for (batch, part) in batches.iter().zip(&parts) {
            match part {
                Part::Whole => world.push(*batch),
                Part::Split(about, others) => {
                    self.near.extend_from_slice(about);
                    world.push(others.splats()?);
                }
                Part::Sky(columns) => sky.push(columns.splats()?),
            }
        }
        self.attribute |= batches.iter().any(|batch| batch.attribute().is_some());
        for (sums, batches) in [(&mut self.world, world), (&mut self.sky, sky)] {
            sums.0.add(&batches);
            sums.1 |= !batches.is_empty();
        }
        Ok(())
    }

    /// The face, and what became of the particles.
    pub fn finish(self) -> (Accumulation, Counts) {
        let FaceSums { view, kernel, world: (world, has_world), sky: (sky, has_sky), near, attribute, .. } = self;
        let (mut picture, mut counts) = world.finish();
        if has_sky {
            let (discs, drawn) = sky.finish();
            counts += drawn;
            match has_world {
                true => add(&mut picture, &discs),
                false => picture = discs,
            }
        }
        counts.drawn += near.len() as u64;
        add_near(&view, kernel, &near, attribute, None, &mut picture);
        (picture, counts)
    }
}

/// Adds pictures of the same size.
pub fn add(picture: &mut Accumulation, other: &Accumulation) {
    if picture.ps.is_empty() && !other.ps.is_empty() {
        picture.ps = vec![0.0; picture.p.len()];
    }
    let channels = [(&mut picture.p, &other.p), (&mut picture.ps, &other.ps)];
    channels.into_iter().for_each(|(to, from)| to.iter_mut().zip(from).for_each(|(to, from)| *to += from));
}

/// `share` says how much of what is at a place is seen.
fn part((eye, kernel): (DVec3, Kernel), batch: &Splats<'_>, pixel: f64, share: &(dyn Fn(DVec3) -> f32 + Sync)) -> Part {
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
                    let weight = (f64::from(weight) * pixel * pixel) as f32 * share(positions.world(i));
                    sky.push(direction, weight, attribute(i));
                    lengths.push(h);
                }
            }
            sky.reach = Reach::Balls(lengths);
            Part::Sky(sky)
        }
        Extent::World(_) | Extent::Ellipsoids(_) => {
            let is_near = |i: usize| is_about(batch, i, eye, 0.0);
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
                let about = AboutEye::of(batch, i, eye, kernel, 0.0)?;
                let amplitude = f64::from(batch.weight()[i]) * about.amplitude;
                let amplitudes = [amplitude, amplitude * attribute(i).map_or(0.0, f64::from)];
                amplitudes.iter().all(|amplitude| amplitude.is_finite()).then_some((about, amplitudes))
            });
            Part::Split(near.collect(), others)
        }
    }
}

/// Adds particles about the eye. Where there are surfaces, each pixel's ray is followed.
fn add_near(
    view: &View,
    kernel: Kernel,
    near: &[Near],
    attribute: bool,
    surfaces: Option<&PathFragments>,
    picture: &mut Accumulation,
) {
    if near.is_empty() {
        return;
    }
    if attribute && picture.ps.is_empty() {
        picture.ps = vec![0.0; picture.p.len()];
    }
    let table = HalfLine::of(kernel);
    let step = step(view);
    let nodes = |pixels: u32| (f64::from(pixels) / step).ceil() as usize + 1;
    let [columns, rows] = [nodes(view.width), nodes(view.height)];
    let grid: Vec<[f64; 2]> = (0..columns * rows)
        .into_par_iter()
        .map(|index| {
            let point = [(index % columns) as f64 * step, (index / columns) as f64 * step];
            let ray = ray(view, point);
            near.iter().fold([0.0; 2], |sum, (about, amplitudes)| {
                let met = about.met(table, ray);
                [sum[0] + met * amplitudes[0], sum[1] + met * amplitudes[1]]
            })
        })
        .collect();
    let locate = |pixel: usize, count: usize| {
        let place = (pixel as f64 + 0.5) / step;
        let index = (place as usize).min(count.saturating_sub(2));
        (index, place - index as f64)
    };
    let width = view.width as usize;
    let behind = |x: usize, y: usize| -> Option<[f64; 2]> {
        let fragments = surfaces.map_or(&[][..], |surfaces| surfaces.of(x, y));
        if fragments.is_empty() {
            return None;
        }
        let point = [x as f64 + 0.5, y as f64 + 0.5];
        let ray = ray(view, point);
        // Depth is along the view's axis.
        let longer = 1.0 / ray.dot(view.forward);
        let (mut sums, mut through) = ([0.0; 2], 1.0);
        let ends = fragments.iter().map(|fragment| (f64::from(fragment.alpha), f64::from(fragment.depth) * longer));
        for (alpha, end) in ends.chain([(1.0, f64::INFINITY)]) {
            for (about, amplitudes) in near {
                let met = through * alpha * about.met_until(table, ray, end);
                (0..2).for_each(|k| sums[k] += met * amplitudes[k]);
            }
            through *= 1.0 - alpha;
        }
        Some(sums)
    };
    let hidden: Vec<Option<[f64; 2]>> = match surfaces {
        Some(_) => (0..picture.p.len()).into_par_iter().map(|index| behind(index % width, index / width)).collect(),
        None => Vec::new(),
    };
    let add = |channel: usize, values: &mut [f32]| {
        values.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let (j, v) = locate(y, rows);
            for (x, value) in row.iter_mut().enumerate() {
                if let Some(Some(sums)) = hidden.get(y * width + x) {
                    *value += sums[channel] as f32;
                    continue;
                }
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
            let Some(Stretched { to_ball, volume }) = Stretched::of(batch, i, kernel, [0.0; 2]) else { continue };
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
