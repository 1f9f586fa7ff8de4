//! Ambient occlusion: the share of the hemisphere over a surface, weighted with the cosine to its normal, that nothing near by hides, from a
//! picture of depths.
//!
//! Around the line of sight lie half-planes ([`super::Shadowing::samples`]), and in each of them the highest thing within the radius is the horizon.
//! The hemisphere between two horizons of a slice has its integral in closed form (Jimenez, Wu, Pesce, Jarabo, "Practical Real-Time Strategies
//! for Accurate Indirect Occlusion", SIGGRAPH 2016, equation 7). Heights of things are measured from the surface's own plane, so that a plane has exactly
//! none, however it is seen. The slices are the same in every pixel and every picture: nothing flickers.

use super::depth_picture::DepthPicture;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// How far a picture is looked at from a pixel, pixels: where the radius is longer, that is the radius.
pub const FARTHEST: u32 = 256;
/// How much further each sample lies than the one before.
const GROWTH: f64 = 1.35;
/// Samples so many cells away from a pixel are read from cells of that size.
const CELLS: f64 = 12.0;
/// Sines up to this over a surface's plane are none: depths are rounded.
const LEVEL: f64 = 2e-3;

/// Distances of samples from a pixel, pixels, and the level that they are read from.
fn samples() -> Vec<(f64, usize)> {
    let mut samples = Vec::new();
    let mut away = 1.0;
    while away <= f64::from(FARTHEST) {
        samples.push((away, (away / CELLS).max(1.0).log2() as usize));
        away = (away * GROWTH).max(away + 1.0);
    }
    samples
}

/// The share of each pixel of a surface that is open, row by row, within a radius in world units, as `scene` hides it, in which the surface is;
/// 1 where there is nothing.
pub(super) fn open_shares(surface: &DepthPicture, scene: &DepthPicture, radius: f64, directions: u32) -> Vec<f32> {
    let (samples, [width, height]) = (samples(), surface.size());
    // Each plane through a line of sight has two.
    let slices = (directions as usize / 2).max(1);
    let share =
        |index: usize| open_share((surface, scene), [index % width, index / width], radius, (slices, &samples)) as f32;
    (0..width * height).into_par_iter().map(share).collect()
}

/// What a slice's half sees from a surface.
struct Slice {
    /// The normal of what the pixel shows.
    normal: DVec3,
    /// How long its part in the slice is.
    length: f64,
    /// Along the surface, in the slice, away from the line of sight.
    along: DVec3,
}

fn open_share(
    (surface, scene): (&DepthPicture, &DepthPicture),
    pixel: [usize; 2],
    radius: f64,
    (slices, samples): (usize, &[(f64, usize)]),
) -> f64 {
    let (Some(here), Some(normal)) = (surface.shown(pixel), surface.normal(pixel)) else { return 1.0 };
    let sight = surface.toward_eye(here);
    let pixels = surface.pixels_at(here.z);
    let radius = radius.min(f64::from(FARTHEST) / pixels);
    let first = (DVec3::X - sight * sight.x).normalize_or(DVec3::Y);
    let second = sight.cross(first);
    let (mut open, mut whole, mut is_occluded) = (0.0_f64, 0.0_f64, false);
    for slice in 0..slices {
        let (sine, cosine) = ((slice as f64 + 0.5) * PI / slices as f64).sin_cos();
        let side = cosine * first + sine * second;
        let axis = sight.cross(side);
        let within = normal - axis * normal.dot(axis);
        let length = within.length();
        let Some([x, y]) = surface.across(here, side).filter(|_| length > 1e-6) else { continue };
        // From the line of sight to the normal, towards `side`.
        let [toward, aside] = [within.dot(sight) / length, within.dot(side) / length];
        let turned = aside.atan2(toward);
        let along = side * toward - sight * aside;
        for (sign, turned) in [(1.0_f64, turned), (-1.0, -turned)] {
            let half = Slice { normal, length, along: sign * along };
            let height = half.height(scene, (pixel, here), [sign * x, sign * y], radius, samples);
            is_occluded |= height > 0.0;
            // Heights run from 0 on the surface over 1 at the normal to 2 on the surface beyond.
            let from_normal = if height <= 1.0 { height.acos() } else { -(2.0 - height).acos() };
            open += length * arc(turned + from_normal, turned);
            whole += length * arc(turned + FRAC_PI_2, turned);
        }
    }
    if is_occluded && whole > 0.0 { (open / whole).clamp(0.0, 1.0) } else { 1.0 }
}

impl Slice {
    /// How high the horizon is that is seen on the way through the picture in a direction.
    fn height(
        &self,
        picture: &DepthPicture,
        (pixel, here): ([usize; 2], DVec3),
        [x, y]: [f64; 2],
        radius: f64,
        samples: &[(f64, usize)],
    ) -> f64 {
        let [width, height] = picture.size().map(|size| size as isize);
        let reach = radius * picture.pixels_at(here.z);
        let mut highest = 0.0_f64;
        for &(away, level) in samples.iter().take_while(|(away, _)| *away <= reach) {
            let at = [pixel[0] as f64 + 0.5 + away * x, pixel[1] as f64 + 0.5 + away * y].map(|at| at.floor() as isize);
            if at[0] < 0 || at[1] < 0 || at[0] >= width || at[1] >= height {
                break;
            }
            let Some(there) = picture.shown_around(at, level) else { continue };
            let way = there - here;
            let distance = way.length();
            let sine = way.dot(self.normal) / distance - LEVEL;
            // NaN where both are one place.
            if sine > 0.0 && distance < radius {
                let risen = (sine / self.length).min(1.0);
                let risen = if way.dot(self.along) < 0.0 { 2.0 - risen } else { risen };
                // Things fade towards the radius.
                highest = highest.max(risen * (1.0 - (distance / radius).powi(4)));
            }
        }
        highest
    }
}

/// The integral of `cos(t - turned) |sin t|` over `t` from the line of sight, 0, to a horizon.
fn arc(horizon: f64, turned: f64) -> f64 {
    let horizon = horizon.clamp(0.0, PI);
    0.25 * (turned.cos() - (2.0 * horizon - turned).cos() + 2.0 * horizon * turned.sin())
}
