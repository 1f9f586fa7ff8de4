//! Soft shadows: how much of a lamp reaches each pixel, from depths of the scene as seen from places of the lamp's disc.
//!
//! The lamp is far away: each of its places sees the scene in parallel (Williams, "Casting curved shadows on curved surfaces", SIGGRAPH 1978), in
//! a picture that is just as large as what is to be lit. Places spread evenly over the disc (Vogel 1979), and the share of them that reaches a
//! pixel is the share of the disc that is seen from there.

use super::depth_picture::DepthPicture;
use super::{Casters, Lamp};
use crate::view::{Cut, Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixels along the longer side of the picture from a point, for each along that of the picture: they lie across those of the picture. From places of a
/// lamp, whose pictures are added up, as many as the picture has.
const FINER: u32 = 2;
/// Fewest and most of them.
const SIDE: [u32; 2] = [256, 2048];
/// Receivers move away from their surface by so many pixels of a lamp's picture, and by so many more where its light grazes them, so that they
/// do not lie in their own shadow.
const AWAY: [f64; 2] = [0.5, 1.5];
/// Depths of pictures are rounded by so much of them.
const ROUNDED: f64 = 4.0 * f32::EPSILON as f64;
/// A lamp beside the eye that shades nothing goes out evenly towards where it grazes: from this cosine on.
const GRAZES: f64 = 0.25;

/// What of a lamp reaches a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reached {
    /// The share of its disc that is seen from there.
    pub(super) share: f32,
    /// The cosine between the surface's normal and the lamp's middle; 0 where it faces away.
    pub(super) cosine: f32,
}

/// What is lit.
struct Receiver {
    pixel: usize,
    /// In the world.
    place: DVec3,
    normal: DVec3,
    /// How far its place is rounded.
    rounded: f64,
}

/// What of a lamp reaches each pixel, row by row; all of it where there is nothing. The scene's diameter, and how far surfaces may be from each
/// other in two pictures, are in world units. `samples` are places of a lamp that is no point.
pub(super) fn reached_shares(
    picture: &DepthPicture,
    (lamp, samples): (&Lamp, u32),
    (scene, slack): (f64, f64),
    casters: &Casters<'_>,
) -> Vec<Reached> {
    let ([width, height], view) = (picture.size(), &picture.view);
    let to_world = |[x, y, z]: [f64; 3]| x * view.right + y * view.up + z * view.forward;
    let receiver = |pixel: usize| {
        let at = [pixel % width, pixel / width];
        let place = picture.shown(at)?;
        let normal = picture.normal(at).unwrap_or_else(|| picture.toward_eye(place));
        let rounded = ROUNDED * place.z.abs();
        let place = view.eye + to_world(place.to_array());
        Some(Receiver { pixel, place, normal: to_world(normal.to_array()), rounded })
    };
    let receivers: Vec<Receiver> = (0..width * height).into_par_iter().filter_map(receiver).collect();
    let mut sums = vec![0.0f32; receivers.len()];
    let places = places(lamp, samples as usize);
    let finer = if places.len() > 1 { 1 } else { FINER };
    for toward in &places {
        let seen = lamp_view(view, *toward, &receivers, (scene, finer));
        let pixels = |seen: &View| seen.width as usize * seen.height as usize;
        let drawn = |seen: View| Some((seen, casters(&seen).filter(|depths| depths.len() == pixels(&seen))?));
        // Where nothing is seen, nothing is in the way.
        let seen = seen.and_then(drawn);
        sums.par_iter_mut().zip(&receivers).for_each(|(sum, receiver)| {
            let seen = seen.as_ref().map(|(view, depths)| (view, &depths[..]));
            *sum += reaches(seen, receiver, (*toward, lamp.lights), slack) as f32;
        });
    }
    let mut reached = vec![Reached { share: 1.0, cosine: 1.0 }; width * height];
    for (receiver, sum) in receivers.iter().zip(&sums) {
        let cosine = receiver.normal.dot(lamp.toward).max(0.0) as f32;
        reached[receiver.pixel] = Reached { share: sum / places.len() as f32, cosine };
    }
    reached
}

/// Directions to so many places of a lamp; one is its middle.
fn places(lamp: &Lamp, count: usize) -> Vec<DVec3> {
    if lamp.size <= 0.0 || count <= 1 {
        return vec![lamp.toward];
    }
    let (first, second) = lamp.toward.any_orthonormal_pair();
    let radius = (0.5 * lamp.size).tan();
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let place = |number: usize| {
        let away = radius * ((number as f64 + 0.5) / count as f64).sqrt();
        let (sine, cosine) = (number as f64 * golden).sin_cos();
        (lamp.toward + away * (cosine * first + sine * second)).normalize_or(lamp.toward)
    };
    (0..count).map(place).collect()
}

/// How the scene is seen from a lamp in a direction, in so many times as many pixels: all receivers, and in front of them as far as the scene reaches.
fn lamp_view(view: &View, toward: DVec3, receivers: &[Receiver], (scene, finer): (f64, u32)) -> Option<View> {
    let origin = receivers.first()?.place;
    let up = toward.any_orthonormal_vector();
    let unit = Projection::Orthographic { height: 1.0 };
    let plain = View::look_at(toward, DVec3::ZERO, up, unit, 1, 1).ok()?;
    let plain = View { eye: origin, ..plain };
    let (low, high) = receivers
        .par_iter()
        .map(|receiver| plain.to_camera(receiver.place))
        .map(|place| (place, place))
        .reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let longest = (high - low).truncate().max_element().max(1e-6 * scene).max(f64::MIN_POSITIVE);
    let side = view.width.max(view.height).saturating_mul(finer).clamp(SIDE[0], SIDE[1]);
    let pixel = longest / f64::from(side);
    // With a pixel around it, for the differences between neighbours.
    let [width, height] = [high.x - low.x, high.y - low.y].map(|length| (length / pixel).ceil() as u32 + 4);
    let middle = 0.5 * (low + high);
    let eye = origin + middle.x * plain.right + middle.y * plain.up + (low.z - scene - pixel) * plain.forward;
    // What fades with its distance from the eye is all there for a lamp.
    let cut = Cut { fade_start: 0.0, fade_rate: 0.0, around: false, ..view.cut };
    let projection = Projection::Orthographic { height: pixel * f64::from(height) };
    let (images, time) = (view.images, view.time);
    let seen = View { eye, projection, width, height, cut, images, time, ..plain };
    (seen.eye.is_finite() && pixel.is_finite()).then_some(seen)
}

/// How much of a place of a lamp reaches a receiver, from 0 to 1: the mean over the four pixels around it of the lamp's picture.
fn reaches(seen: Option<(&View, &[f32])>, receiver: &Receiver, (toward, lights): (DVec3, bool), slack: f64) -> f64 {
    let cosine = receiver.normal.dot(toward);
    if cosine <= 0.0 {
        return 0.0;
    }
    let facing = if lights { 1.0 } else { (cosine / GRAZES).min(1.0) };
    let Some((seen, depths)) = seen else { return facing };
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let away = (AWAY[0] + AWAY[1] * sine) / seen.focal_pixels() + slack;
    let camera = seen.to_camera(receiver.place + away * receiver.normal);
    let Some(at) = seen.to_pixels(camera) else { return facing };
    let depth = camera.z - receiver.rounded - ROUNDED * camera.z.abs();
    let [x, y] = at.map(|at| at - 0.5);
    let [left, top] = [x.floor(), y.floor()];
    let size = [f64::from(seen.width), f64::from(seen.height)];
    let passes = |column: f64, row: f64| {
        let is_inside = column >= 0.0 && row >= 0.0 && column < size[0] && row < size[1];
        let index = || row as usize * seen.width as usize + column as usize;
        f64::from(u8::from(!is_inside || f64::from(depths[index()]) >= depth))
    };
    let row = |row: f64| passes(left, row) + (x - left) * (passes(left + 1.0, row) - passes(left, row));
    let [above, below] = [row(top), row(top + 1.0)];
    facing * (above + (y - top) * (below - above))
}
