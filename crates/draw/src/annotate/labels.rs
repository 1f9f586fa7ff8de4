//! Names of objects: beside their places, fading with distance, never over each other.

use super::display_list::{Anchor, At, DisplayList, Shape};
use super::{Subject, TEXT};
use crate::view::{Projection, View};
use glam::DVec3;

/// A named object.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Its name.
    pub name: String,
    /// Where it is, world units.
    pub position: DVec3,
    /// Its size, drawn as a circle.
    pub radius: Option<f64>,
}

/// Pixels per em.
const SIZE: f32 = 13.0;
/// Where the first names are written, and from which distance (as a multiple of the target's) on they fade, gone at
/// [`GONE`].
const CLEAR: f64 = 1.5;
/// Multiple of the target's distance beyond which there are no names.
const GONE: f64 = 6.0;
/// Objects nearer to each other in the picture are one, logical pixels.
const SAME: f32 = 5.0;
/// Objects smaller than this in the picture have no circle, and those larger than the picture neither.
const SMALLEST_CIRCLE: f32 = 3.0;

/// Adds up to `most` names, the first in the list first.
pub fn layout(list: &mut DisplayList, subject: &Subject<'_>, most: usize) {
    let reach = subject.view.to_camera(subject.target).length();
    let mut written: Vec<At> = Vec::new();
    for label in subject.labels {
        if written.len() == most {
            break;
        }
        let Some(spot) = project(label, subject, reach) else { continue };
        // A group and its central subhalo are one thing in the picture: the more important name stands for both.
        let near = |at: &At| (at[0] - spot.at[0]).hypot(at[1] - spot.at[1]) < SAME;
        if !written.iter().any(near) && write(list, label, &spot) {
            written.push(spot.at);
        }
    }
}

/// Where an object is in the world: in a periodic box at an image that is drawn; nowhere where the view leaves it out.
fn place(label: &Label, view: &View) -> Option<DVec3> {
    let images = view.images.offsets().map(|offset| label.position + offset);
    std::iter::once(label.position).chain(images).find(|at| view.cut.keeps(*at))
}

/// Where an object is in the picture.
struct Spot {
    at: At,
    radius: f32,
    alpha: f32,
}

/// Where a label's object is, if it is to be named at all.
fn project(label: &Label, subject: &Subject<'_>, reach: f64) -> Option<Spot> {
    let camera = subject.view.to_camera(place(label, subject.view)?);
    let [x, y] = subject.view.to_pixels(camera)?.map(|pixel| pixel as f32 / subject.scale);
    let pixels = match subject.view.projection {
        Projection::Perspective { .. } => subject.view.focal_pixels() / camera.z,
        Projection::Orthographic { .. } => subject.view.focal_pixels(),
    };
    let radius = (label.radius.unwrap_or(0.0) * pixels) as f32 / subject.scale;
    let distance = camera.length() / reach.max(f64::MIN_POSITIVE);
    let alpha = ((GONE - distance) / (GONE - CLEAR)).clamp(0.0, 1.0) as f32;
    (alpha > 0.1 && x.is_finite() && y.is_finite() && radius.is_finite()).then_some(Spot { at: [x, y], radius, alpha })
}

/// Writes a name beside its object where there is room, and the object's circle with it.
fn write(list: &mut DisplayList, label: &Label, spot: &Spot) -> bool {
    let [x, y] = spot.at;
    let inside = (0.0..list.size[0]).contains(&x) && (0.0..list.size[1]).contains(&y);
    if !inside {
        return false;
    }
    let has_circle = (SMALLEST_CIRCLE..0.5 * list.size[0].min(list.size[1])).contains(&spot.radius);
    let away = if has_circle { spot.radius + 5.0 } else { 8.0 };
    let color = [TEXT[0], TEXT[1], TEXT[2], (255.0 * spot.alpha) as u8];
    let places = [
        ([x + away, y], Anchor::LEFT),
        ([x - away, y], Anchor::RIGHT),
        ([x, y - away], Anchor::BOTTOM),
        ([x, y + away], Anchor::TOP),
    ];
    let name = label.name.trim();
    if name.is_empty() || !places.into_iter().any(|(at, anchor)| list.text_if_free(at, anchor, name, SIZE, color)) {
        return false;
    }
    let alpha = (150.0 * spot.alpha) as u8;
    if has_circle {
        list.shapes.push(Shape::Circle {
            center: spot.at,
            radius: spot.radius,
            width: 1.0,
            color: [TEXT[0], TEXT[1], TEXT[2], alpha],
        });
    } else {
        for [dx, dy] in [[3.5, 0.0], [0.0, 3.5]] {
            list.line([x - dx, y - dy], [x + dx, y + dy], 1.0, color);
        }
    }
    true
}
