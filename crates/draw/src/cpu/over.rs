//! Splats that lie over each other (HE03, "over"): each has one colour and an opacity at every pixel, and hides what is behind it.
//!
//! At a pixel where a splat of weight `w` has the line-of-sight kernel `F`, its optical depth is `k w F` and its opacity `1 - exp(-k w F)`;
//! colours and `k` are those of [`SplatColors`]. So the opacity of all together is that of their sum, in any order and however many splats
//! the same matter is divided into; the order decides about the colours alone. Splats are ordered by the distance of their middles as a
//! whole, so where they overlap the order along a ray is not exact, as in the paper.
//!
//! A pixel sees the middle of its area, and nothing between pixels' middles must be lost: every splat is blurred by a kernel of
//! [`LOW_PASS`] pixels ([`blurred`]).

mod blurred;

use super::about_eye;
use super::footprint::Lens;
use super::front_to_back::{Among, Seen, blend};
use super::paths::PathFragments;
use super::volume::VolumeReport;
use super::{Extent, Splats};
use crate::color::Colors;
use crate::color::splat_colors::{OwnColumn, SplatColors};
use crate::model::Kernel;
use crate::view::{Projection, View};
use blurred::Appearance;
use rayon::prelude::*;
use std::cmp::Ordering;

/// Radius of the kernel that blurs splats, pixels. The sum of a kernel of two pixels over the pixels' middles is its integral to half a
/// percent wherever it lies. The variance is 0.3 square pixels, as that of 3D Gaussian splatting.
pub const LOW_PASS: f64 = 2.0;

/// Opacity at which a ray ends: what is behind cannot change a colour of 8 bits by more than a quarter of a step in linear light.
pub const TERMINATION: f32 = 0.999;

/// Splats that are looked at by one task.
const CHUNK: usize = 1 << 14;

/// In which order splats lie over each other, the nearest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// By the distance of their middles, and what is equal in that by everything else.
    #[default]
    Exact,
    /// By buckets of distance, 16 for a splat and 1024 at least, as they are stored within each (HE03, for quality).
    Buckets,
    /// By buckets of distance, one for a splat and 128 at least (HE03, for speed).
    CoarseBuckets,
    /// As they are stored.
    None,
}

impl Order {
    /// All of them.
    pub const ALL: [Order; 4] = [Order::Exact, Order::Buckets, Order::CoarseBuckets, Order::None];

    /// Its name in files and statistics.
    pub fn name(self) -> &'static str {
        match self {
            Order::Exact => "exact",
            Order::Buckets => "buckets",
            Order::CoarseBuckets => "coarse-buckets",
            Order::None => "none",
        }
    }
}

/// How splats lie over each other.
#[derive(Clone, Copy, Debug)]
pub struct Over<'a> {
    /// The nearest first.
    pub order: Order,
    /// The kernel that smoothing lengths belong to.
    pub kernel: Kernel,
    /// What splats look like.
    pub colors: &'a SplatColors,
    /// By what their own columns are found.
    pub column: OwnColumn,
    /// Angle of a pixel of the panorama that the picture is a face of, radians; `None` for a flat picture. So that no face shows where it
    /// ends, a face blurs splats by that panorama's pixels, and draws what surrounds the eye for rays that begin there.
    pub around: Option<f64>,
}

/// One splat of the batches.
#[derive(Clone, Copy, Debug)]
struct Splat {
    distance: f32,
    batch: u32,
    index: u32,
    color: [f32; 3],
}

/// Draws batches. Splats without a positive weight are left out.
pub fn draw(view: &View, batches: &[Splats<'_>], over: &Over<'_>) -> (Colors, VolumeReport) {
    draw_among(view, batches, over, None)
}

/// The same among surfaces, which are in the picture then.
pub fn draw_among(
    view: &View,
    batches: &[Splats<'_>],
    over: &Over<'_>,
    surfaces: Option<&PathFragments>,
) -> (Colors, VolumeReport) {
    let jobs: Vec<(u32, usize)> = (0..)
        .zip(batches)
        .flat_map(|(number, batch)| (0..batch.len()).step_by(CHUNK).map(move |start| (number, start)))
        .collect();
    let splats: Vec<Splat> = jobs
        .into_par_iter()
        .flat_map_iter(|(number, start)| {
            let batch = &batches[number as usize];
            let range = start..batch.len().min(start + CHUNK);
            range.filter_map(move |index| splat(view, batches, over, (number, index)))
        })
        .collect();
    let splats = ordered(splats, batches, over.order);
    let mut report =
        VolumeReport { particles: splats.len() as u64, grid: [view.width, view.height, 1], ..VolumeReport::default() };
    if let (Some(near), Some(far)) = (
        splats.iter().map(|splat| splat.distance).min_by(f32::total_cmp),
        splats.iter().map(|splat| splat.distance).max_by(f32::total_cmp),
    ) {
        report.planes = [near, far].map(f64::from);
    }
    let appearance = Appearance { view, kernel: over.kernel, around: over.around };
    let look = |lens: &Lens, splat: &Splat| {
        let batch = &batches[splat.batch as usize];
        let (cover, amplitude) = appearance.of(lens, batch, splat.index as usize)?;
        let depth = (over.colors.depth() * amplitude) as f32;
        Some(Seen { cover, depth, color: splat.color, place: splat.distance })
    };
    let by_distance = over.around.is_some() || matches!(view.projection, Projection::Perspective { .. });
    let surfaces = surfaces.map(|fragments| Among { fragments, by_distance });
    let (colors, _) = blend(view, splats, look, None, (over.kernel, TERMINATION), surfaces, &mut report);
    (colors, report)
}

/// A splat of a batch; `None` when it cannot be seen.
fn splat(view: &View, batches: &[Splats<'_>], over: &Over<'_>, (number, index): (u32, usize)) -> Option<Splat> {
    let batch = &batches[number as usize];
    let world = batch.positions().world(index);
    let camera = view.to_camera(world);
    let weight = f64::from(batch.weight()[index]);
    if !(camera.is_finite() && weight > 0.0 && weight.is_finite()) {
        return None;
    }
    let distance = match (over.around, view.projection) {
        // The same on every face, to the last bit.
        (Some(_), _) => (world - view.eye).length(),
        (None, Projection::Perspective { .. }) => camera.length(),
        (None, Projection::Orthographic { .. }) => camera.z,
    };
    let is_about = || {
        let blur = |pixel: f64| LOW_PASS * pixel * distance;
        over.around.is_some_and(|pixel| about_eye::is_about(batch, index, view.eye, blur(pixel)))
    };
    // NaN was dropped above.
    if camera.z <= 0.0 && !is_about() {
        return None;
    }
    let density = batch.density().map(|densities| densities[index]);
    let own = |sigma: f64| over.column.of(weight, density, sigma);
    let column = match batch.extent() {
        Extent::Pixels(radius) => weight * over.kernel.projected(0.0) / f64::from(radius * radius),
        Extent::World(lengths) => own(f64::from(lengths[index]) * over.kernel.variance().sqrt()),
        Extent::Ellipsoids(covariances) => own(covariances[index].mean_radius()),
    };
    let color = over.colors.light(column, batch.attribute().map(|attribute| attribute[index]));
    Some(Splat { distance: distance as f32, batch: number, index: index as u32, color })
}

/// Splats in an order.
fn ordered(mut splats: Vec<Splat>, batches: &[Splats<'_>], order: Order) -> Vec<Splat> {
    match order {
        Order::Exact => {
            splats.par_sort_unstable_by(|a, b| compare(batches, a, b));
            splats
        }
        Order::Buckets => in_buckets(&splats, (16 * splats.len()).max(1024)),
        Order::CoarseBuckets => in_buckets(&splats, splats.len().max(128)),
        Order::None => splats,
    }
}

/// By distance, then by everything else, so that the order of equal ones changes nothing.
fn compare(batches: &[Splats<'_>], a: &Splat, b: &Splat) -> Ordering {
    let everything = || {
        let (own, other) = (values(batches, a), values(batches, b));
        let pairs = own.into_iter().zip(other);
        pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    };
    a.distance.total_cmp(&b.distance).then_with(everything)
}

/// All that a picture shows of a splat.
fn values(batches: &[Splats<'_>], splat: &Splat) -> [f64; 13] {
    let (batch, index) = (&batches[splat.batch as usize], splat.index as usize);
    let [x, y, z] = batch.positions().world(index).to_array();
    let [xx, yy, zz, xy, xz, yz] = match batch.extent() {
        Extent::World(lengths) => [lengths[index], 0.0, 0.0, 0.0, 0.0, 0.0],
        Extent::Pixels(radius) => [radius, 0.0, 0.0, 0.0, 0.0, 0.0],
        Extent::Ellipsoids(covariances) => covariances[index].0,
    }
    .map(f64::from);
    let [r, g, b] = splat.color.map(f64::from);
    [x, y, z, xx, yy, zz, xy, xz, yz, f64::from(batch.weight()[index]), r, g, b]
}

/// Splats by `count` equal intervals of distance, within each as they come.
fn in_buckets(splats: &[Splat], count: usize) -> Vec<Splat> {
    let distances = || splats.iter().map(|splat| splat.distance);
    let (Some(near), Some(far)) = (distances().min_by(f32::total_cmp), distances().max_by(f32::total_cmp)) else {
        return Vec::new();
    };
    let scale = count as f64 / f64::from(far - near).max(f64::MIN_POSITIVE);
    // The cast saturates.
    let bucket = |splat: &Splat| ((f64::from(splat.distance - near) * scale) as usize).min(count - 1);
    let mut next = vec![0u32; count + 1];
    splats.iter().for_each(|splat| next[bucket(splat) + 1] += 1);
    (0..count).for_each(|k| next[k + 1] += next[k]);
    let mut sorted = splats.to_vec();
    for splat in splats {
        let place = &mut next[bucket(splat)];
        sorted[*place as usize] = *splat;
        *place += 1;
    }
    sorted
}

#[cfg(test)]
mod tests;
