//! The data's box with coordinates along its edges, and the directions of the axes in a corner.

use super::display_list::{Anchor, Area, At, DisplayList, Rgba};
use super::ticks::ticks;
use super::{QUIET, Subject, TEXT};
use crate::model::Bounds;
use crate::view::{Projection, View};
use glam::DVec3;

/// Edges behind the data.
const BEHIND: Rgba = [0xb4, 0xbc, 0xc8, 90];
/// Edges at the outline.
const OUTLINE: Rgba = [0xd4, 0xda, 0xe2, 170];
/// The axes' names.
const NAMES: [&str; 3] = ["x", "y", "z"];
/// Their colours in the corner, told apart by colour-blind eyes too.
const COLORS: [Rgba; 3] = [[0xe6, 0x9f, 0x00, 255], [0x56, 0xc8, 0xa0, 255], [0x66, 0xb4, 0xf0, 255]];
/// Pixels per em of coordinates.
const SIZE: f32 = 12.0;

/// An edge of the box.
struct Edge {
    axis: usize,
    from: DVec3,
    to: DVec3,
    /// How many of its two faces are seen from outside.
    facing: usize,
}

/// The twelve edges, from the smaller to the larger coordinate.
fn edges(bounds: &Bounds, view: &View) -> Vec<Edge> {
    // A face is seen from outside where the eye is beyond its plane.
    let seen = |axis: usize, high: bool| match view.projection {
        Projection::Perspective { .. } if high => view.eye[axis] > bounds.max[axis],
        Projection::Perspective { .. } => view.eye[axis] < bounds.min[axis],
        Projection::Orthographic { .. } if high => view.forward[axis] < 0.0,
        Projection::Orthographic { .. } => view.forward[axis] > 0.0,
    };
    let mut edges = Vec::with_capacity(12);
    for axis in 0..3 {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        for [high_u, high_v] in [[false, false], [true, false], [false, true], [true, true]] {
            let mut from = bounds.min;
            from[u] = if high_u { bounds.max[u] } else { bounds.min[u] };
            from[v] = if high_v { bounds.max[v] } else { bounds.min[v] };
            let mut to = from;
            to[axis] = bounds.max[axis];
            let facing = usize::from(seen(u, high_u)) + usize::from(seen(v, high_v));
            edges.push(Edge { axis, from, to, facing });
        }
    }
    edges
}

/// The part of a line that is ahead of the eye, in logical pixels.
fn project(subject: &Subject<'_>, from: DVec3, to: DVec3) -> Option<[At; 2]> {
    let view = subject.view;
    let [mut a, mut b] = [from, to].map(|end| view.to_camera(end));
    if let Projection::Perspective { .. } = view.projection {
        let near = 1e-3 * (b - a).length();
        if a.z < near && b.z < near {
            return None;
        }
        if a.z < near {
            a += (b - a) * ((near - a.z) / (b.z - a.z));
        } else if b.z < near {
            b += (a - b) * ((near - b.z) / (a.z - b.z));
        }
    }
    let place = |camera| Some(view.to_pixels(camera)?.map(|pixel| (pixel / f64::from(subject.scale)) as f32));
    Some([place(a)?, place(b)?])
}

/// The part of a line that is in the picture (Liang and Barsky's clipping); `None` where all is outside.
fn clip([from, to]: [At; 2], size: [f32; 2]) -> Option<[At; 2]> {
    let (mut enter, mut leave) = (0.0f32, 1.0f32);
    for k in 0..2 {
        let delta = to[k] - from[k];
        for (step, room) in [(-delta, from[k]), (delta, size[k] - from[k])] {
            if step == 0.0 {
                if room < 0.0 {
                    return None;
                }
            } else if step < 0.0 {
                enter = enter.max(room / step);
            } else {
                leave = leave.min(room / step);
            }
        }
    }
    let at = |share: f32| [0, 1].map(|k| from[k] + share * (to[k] - from[k]));
    (enter < leave && at(enter).iter().chain(&at(leave)).all(|x| x.is_finite())).then(|| [at(enter), at(leave)])
}

/// Adds the edges of the box that are not in front of the data, and coordinates along three of them.
pub fn layout_box(list: &mut DisplayList, subject: &Subject<'_>) {
    let bounds = subject.bounds;
    if bounds.is_empty() || !(bounds.min.is_finite() && bounds.max.is_finite()) {
        return;
    }
    let edges = edges(&bounds, subject.view);
    for edge in edges.iter().filter(|edge| edge.facing < 2) {
        if let Some([from, to]) = project(subject, edge.from, edge.to).and_then(|line| clip(line, list.size)) {
            list.line(from, to, 1.0, if edge.facing == 1 { OUTLINE } else { BEHIND });
        }
    }
    let page = list.page();
    for axis in 0..3 {
        // The lowest edge of the outline, for the upright axis the one at the left: where a reader expects them.
        let candidates = edges.iter().filter(|edge| edge.axis == axis && edge.facing == 1);
        let placed = candidates.filter_map(|edge| {
            let [from, to] = project(subject, edge.from, edge.to)?;
            let upright = (to[1] - from[1]).abs() > (to[0] - from[0]).abs();
            let middle = [0, 1].map(|k| 0.5 * (from[k] + to[k]));
            let inside = page.holds(&Area { min: middle, max: middle });
            Some((edge, if upright { -middle[0] } else { middle[1] } + if inside { 0.0 } else { -1e6 }))
        });
        let best = placed.max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((edge, _)) = best {
            coordinates(list, subject, edge);
        }
    }
}

/// Adds ticks, coordinates and the axis' name along an edge.
fn coordinates(list: &mut DisplayList, subject: &Subject<'_>, edge: &Edge) {
    let Some([from, to]) = project(subject, edge.from, edge.to) else { return };
    let Some([middle, _]) = project(subject, subject.bounds.center(), subject.bounds.center()) else { return };
    let along = [to[0] - from[0], to[1] - from[1]];
    let length = along[0].hypot(along[1]);
    if !(length > 40.0 && length.is_finite()) {
        return;
    }
    // Outwards: across the edge, away from the middle of the box.
    let mut out = [-along[1] / length, along[0] / length];
    if (0..2).map(|k| out[k] * (0.5 * (from[k] + to[k]) - middle[k])).sum::<f32>() < 0.0 {
        out = out.map(|x| -x);
    }
    let anchor = Anchor(out.map(|x| 0.5 - 0.5 * x));
    let page = list.page();
    for tick in ticks([edge.from[edge.axis], edge.to[edge.axis]], false) {
        let point = edge.from + (edge.to - edge.from) * tick.place;
        let Some([at, _]) = project(subject, point, point) else { continue };
        let tip = [0, 1].map(|k| at[k] + 5.0 * out[k]);
        if !page.holds(&Area { min: at, max: at }) || !page.holds(&Area { min: tip, max: tip }) {
            continue;
        }
        list.line(at, tip, 1.0, OUTLINE);
        if let Some(label) = tick.label {
            list.text_if_free([0, 1].map(|k| at[k] + 8.0 * out[k]), anchor, &label, SIZE, TEXT);
        }
    }
    let unit = super::legend::tidy(subject.length_unit.to_owned());
    let name = if unit.is_empty() { NAMES[edge.axis].to_owned() } else { format!("{} / {unit}", NAMES[edge.axis]) };
    // The name further out than coordinates reach; nearer the ends where the middle is taken.
    let name = |list: &mut DisplayList, share: f32, away: f32| {
        let at = [0, 1].map(|k| from[k] + share * along[k] + away * out[k]);
        list.text_if_free(at, anchor, &name, SIZE, QUIET)
    };
    let places = [(0.5, 26.0), (0.5, 48.0), (0.35, 40.0), (0.65, 40.0), (0.5, 70.0)];
    places.into_iter().any(|(share, away)| name(list, share, away));
}

/// Adds the three directions above the lower left corner.
pub fn layout_triad(list: &mut DisplayList, view: &View) {
    const ARM: f32 = 26.0;
    let center = [20.0 + ARM + 8.0, list.size[1] - 70.0 - ARM];
    if center[1] < ARM + 20.0 || list.size[0] < 2.0 * center[0] {
        return;
    }
    let mut arms: Vec<(usize, DVec3)> = DVec3::AXES
        .into_iter()
        .map(|axis| DVec3::new(axis.dot(view.right), axis.dot(view.up), axis.dot(view.forward)))
        .enumerate()
        .collect();
    // From back to front.
    arms.sort_by(|a, b| b.1.z.total_cmp(&a.1.z));
    let tip = |direction: DVec3| [center[0] + ARM * direction.x as f32, center[1] - ARM * direction.y as f32];
    for &(axis, direction) in &arms {
        list.line(center, tip(direction), 4.0, [0, 0, 0, 130]);
        list.line(center, tip(direction), 2.0, COLORS[axis]);
    }
    // Of two letters at one place the one in front is written.
    for &(axis, direction) in arms.iter().rev() {
        let [dx, dy] = [direction.x as f32, -direction.y as f32];
        // Arms towards the eye have their letter at the side of the middle.
        let length = dx.hypot(dy);
        let [ux, uy] = if length > 0.2 { [dx / length, dy / length] } else { [-0.7, 0.7] };
        let [x, y] = tip(direction);
        list.text_if_free([x + 9.0 * ux, y + 9.0 * uy], Anchor::CENTER, NAMES[axis], SIZE, COLORS[axis]);
    }
    list.keep_free(Area { min: center, max: center }.grown(ARM + 14.0));
}
