//! Soft shadows: how much of a lamp reaches each pixel, from depths of the scene as seen from places of the lamp's disc.
//!
//! The lamp is far away: each of its places sees the scene in parallel (Williams, "Casting curved shadows on curved surfaces", SIGGRAPH 1978), in
//! a picture that is just as large as what is to be lit. Places spread evenly over the disc (Vogel 1979), and the share of them that reaches a
//! pixel is the share of the disc that is seen from there.
//!
//! Where such a picture is costly, one serves all places near each other: what it shows is a sheet, torn where depths jump, and each place sees this
//! sheet from its own direction. What hides behind the sheet casts no shadow beside it; that is within the penumbra of what hides it.

use super::depth_picture::DepthPicture;
use super::{Casters, Lamp, Shadowing};
use crate::view::{Cut, Projection, View};
use glam::DVec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::f64::consts::PI;

/// Pixels along the longer side of the picture from a point, for each along that of the picture: they lie across those of the picture. From places of a
/// lamp, whose pictures are added up, as many as the picture has; no more where pictures are costly. What is lit and small in the picture has fewer:
/// as many for a length as the picture has at what is nearest.
const FINER: u32 = 2;
/// Fewest and most of them.
const SIDE: [u32; 2] = [256, 2048];
/// Diameter of the part of a lamp whose places share a costly picture, radians.
const SHARED: f64 = PI / 18.0;
/// Pixels along the longer side of a costly picture times the lamp's diameter, radians: two for the penumbra of what is a sixteenth of that
/// side away.
const SOFT: f64 = 32.0;
/// A costly picture has around what is to be lit no more than this share of its longer side.
const AROUND: f64 = 0.25;
/// Places whose pictures are made of one at once: memory for as many.
const AT_ONCE: usize = 4;
/// What is seen is torn where the depths of neighbours differ by more pixels.
const TORN: f64 = 16.0;
/// Corners belong to a triangle in spite of rounding.
const INSIDE: f64 = 1e-9;
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
/// other in two pictures, are in world units.
pub(super) fn reached_shares(
    picture: &DepthPicture,
    lamp: &Lamp,
    shadowing: &Shadowing,
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
    let places = places(lamp, shadowing.samples as usize);
    let drawn = if shadowing.is_costly { shared_places(lamp, places.len()) } else { places.clone() };
    let longer = view.width.max(view.height);
    let (side, finer) = match (shadowing.is_costly, places.len()) {
        (true, _) => (longer.min((SOFT / lamp.size.max(f64::MIN_POSITIVE)) as u32), 1),
        (false, 1) => (longer.saturating_mul(FINER), FINER),
        (false, _) => (longer, 1),
    };
    let pixels_of = |receiver: &Receiver| picture.pixels_at((receiver.place - view.eye).dot(view.forward));
    let finest = f64::from(finer) * receivers.par_iter().map(pixels_of).reduce(|| 0.0, f64::max);
    for (number, from) in drawn.iter().enumerate() {
        let is_own = |place: &DVec3| nearest(&drawn, *place) == Some(number);
        let own: Vec<DVec3> = places.iter().copied().filter(is_own).collect();
        if own.is_empty() {
            continue;
        }
        let around = shadowing.scene * own.iter().map(|place| place.distance(*from)).fold(0.0, f64::max);
        let pixels = |seen: &View| seen.width as usize * seen.height as usize;
        // Where nothing is seen, nothing is in the way.
        let seen = lamp_view(view, *from, &receivers, (shadowing.scene, around), (side, finest));
        let seen = seen.and_then(|(seen, middle)| {
            let depths = casters(&seen).filter(|depths| depths.len() == pixels(&seen))?;
            Some(LampPicture { view: seen, middle, shift: [0.0; 2], depths: Cow::Owned(depths) })
        });
        for some in own.chunks(AT_ONCE) {
            let from_place = |place: &DVec3| seen.as_ref().map(|seen| seen.seen_from(*place, *from));
            let pictures: Vec<Option<LampPicture<'_>>> = some.par_iter().map(from_place).collect();
            for (place, picture) in some.iter().zip(&pictures) {
                sums.par_iter_mut().zip(&receivers).for_each(|(sum, receiver)| {
                    *sum += reaches(picture.as_ref(), receiver, (*place, lamp.lights), shadowing.slack) as f32;
                });
            }
        }
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

/// Those from which costly pictures are drawn where the lamp has so many places.
fn shared_places(lamp: &Lamp, count: usize) -> Vec<DVec3> {
    let parts = (lamp.size / SHARED).powi(2).ceil() as usize;
    places(lamp, parts.clamp(1, count.max(1)))
}

/// The number of the place that is nearest to another one, the first of several.
fn nearest(places: &[DVec3], to: DVec3) -> Option<usize> {
    let away = |number: &usize| places[*number].distance_squared(to);
    (0..places.len()).min_by(|a, b| away(a).total_cmp(&away(b)))
}

/// How the scene is seen from a lamp in a direction, in so many pixels along its longer side, and no more for each length than are given: all
/// receivers with something around them, and in front of them as far as the scene reaches; with the depth of their middle.
fn lamp_view(
    view: &View,
    toward: DVec3,
    receivers: &[Receiver],
    (scene, around): (f64, f64),
    (side, finest): (u32, f64),
) -> Option<(View, f64)> {
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
    let around = around.min(AROUND * longest);
    let length = longest + 2.0 * around;
    let pixel = length / f64::from(side.min((length * finest).ceil() as u32).clamp(SIDE[0], SIDE[1]));
    // With a pixel around it, for the differences between neighbours.
    let [width, height] =
        [high.x - low.x, high.y - low.y].map(|across| ((across + 2.0 * around) / pixel).ceil() as u32 + 4);
    let middle = 0.5 * (low + high);
    let eye = origin + middle.x * plain.right + middle.y * plain.up + (low.z - scene - pixel) * plain.forward;
    // What fades with its distance from the eye is all there for a lamp.
    let cut = Cut { fade_start: 0.0, fade_rate: 0.0, around: false, ..view.cut };
    let projection = Projection::Orthographic { height: pixel * f64::from(height) };
    let (images, time) = (view.images, view.time);
    let seen = View { eye, projection, width, height, cut, images, time, ..plain };
    (seen.eye.is_finite() && pixel.is_finite()).then_some((seen, middle.z - low.z + scene + pixel))
}

/// What a place of a lamp sees.
struct LampPicture<'a> {
    /// The view that was drawn; depths are its own.
    view: View,
    /// A depth whose pixels lie where the view has them.
    middle: f64,
    /// By how many pixels to the right and down others lie aside, for each length that they are deeper.
    shift: [f64; 2],
    depths: Cow<'a, [f32]>,
}

impl LampPicture<'_> {
    /// What is seen from a place beside the one that it was drawn from.
    fn seen_from(&self, place: DVec3, drawn: DVec3) -> LampPicture<'_> {
        let &LampPicture { view, middle, shift, ref depths } = self;
        if place == drawn {
            return LampPicture { view, middle, shift, depths: Cow::Borrowed(&depths[..]) };
        }
        // Along its rays places move by so much for each length that they are less deep.
        let aside = view.focal_pixels() / -place.dot(view.forward);
        let shift = [aside * place.dot(view.right), -aside * place.dot(view.up)];
        let size = [view.width, view.height].map(|pixels| pixels as usize);
        let torn = TORN / view.focal_pixels();
        let corner = |x: usize, y: usize| {
            let depth = f64::from(depths[y * size[0] + x]);
            [x as f64 + (depth - middle) * shift[0], y as f64 + (depth - middle) * shift[1], depth]
        };
        let mut seen = vec![f32::INFINITY; depths.len()];
        for y in 1..size[1] {
            for x in 1..size[0] {
                let [a, b, c, d] = [corner(x - 1, y - 1), corner(x, y - 1), corner(x - 1, y), corner(x, y)];
                for triangle in [[a, b, c], [d, c, b]] {
                    let [low, high] = ends(triangle.map(|corner| corner[2]));
                    // Nothing is infinitely deep: it is no part of what is seen.
                    if high - low <= torn {
                        draw_triangle(&mut seen, size, triangle);
                    }
                }
            }
        }
        LampPicture { view, middle, shift, depths: Cow::Owned(seen) }
    }
}

/// The least and the largest of some numbers.
fn ends(numbers: [f64; 3]) -> [f64; 2] {
    [numbers.into_iter().fold(f64::INFINITY, f64::min), numbers.into_iter().fold(f64::NEG_INFINITY, f64::max)]
}

/// Draws a triangle of columns, rows and depths, in which pixels are whole numbers, in front of the depths that are there.
fn draw_triangle(depths: &mut [f32], size: [usize; 2], [a, b, c]: [[f64; 3]; 3]) {
    let [[bx, by, bz], [cx, cy, cz]] = [b, c].map(|corner| [0, 1, 2].map(|axis| corner[axis] - a[axis]));
    let area = bx * cy - by * cx;
    if area == 0.0 {
        return;
    }
    let [columns, rows] = [0, 1].map(|axis| {
        let [low, high] = ends([a[axis], b[axis], c[axis]]);
        // What is beside the picture is none of its pixels.
        low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, size[axis] as f64) as usize
    });
    for y in rows {
        for x in columns.clone() {
            let [right, down] = [x as f64 - a[0], y as f64 - a[1]];
            let [of_b, of_c] = [(right * cy - down * cx) / area, (bx * down - by * right) / area];
            if of_b >= -INSIDE && of_c >= -INSIDE && of_b + of_c <= 1.0 + INSIDE {
                let depth = &mut depths[y * size[0] + x];
                *depth = depth.min((a[2] + of_b * bz + of_c * cz) as f32);
            }
        }
    }
}

/// How much of a place of a lamp reaches a receiver, from 0 to 1: the mean over the four pixels around it of the lamp's picture.
fn reaches(seen: Option<&LampPicture<'_>>, receiver: &Receiver, (toward, lights): (DVec3, bool), slack: f64) -> f64 {
    let cosine = receiver.normal.dot(toward);
    if cosine <= 0.0 {
        return 0.0;
    }
    let facing = if lights { 1.0 } else { (cosine / GRAZES).min(1.0) };
    let Some(LampPicture { view: seen, middle, shift, depths }) = seen else { return facing };
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let away = (AWAY[0] + AWAY[1] * sine) / seen.focal_pixels() + slack;
    let camera = seen.to_camera(receiver.place + away * receiver.normal);
    let Some(at) = seen.to_pixels(camera) else { return facing };
    let depth = camera.z - receiver.rounded - ROUNDED * camera.z.abs();
    let [x, y] = [0, 1].map(|axis| at[axis] - 0.5 + (camera.z - middle) * shift[axis]);
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
