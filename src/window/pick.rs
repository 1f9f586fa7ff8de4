//! Picking: which particle is under the cursor.
//!
//! Candidates are the drawn particles (of resident pages) whose centres lie within a few pixels of the cursor. The one
//! with the largest mass per projected distance wins: dense cores attract the cursor, as the eye expects, and among
//! equals the nearest in the picture and then in depth. Nodes whose boxes are nowhere near the cursor are not searched.

use crate::explore::particle::ParticleRef;
use crate::store::Metadata;
use crate::stream::SceneNode;
use crate::view::{Extent, View};
use bevy::math::DVec3;

/// Something under the cursor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// Which particle.
    pub particle: ParticleRef,
    /// Where it is, world units.
    pub position: DVec3,
    /// Its smoothing length, world units.
    pub smoothing_length: f64,
    /// Distance from the cursor, pixels.
    pub pixels: f64,
}

/// Said where the mouse asks for places in pictures of all directions and of two eyes.
pub const NO_PLACES: &str =
    "what is under the mouse is known in flat pictures of one eye only: choose such a projection first (section View)";

/// How far from the cursor particles are looked for, pixels.
pub const REACH_PX: f64 = 14.0;

/// The particle under `cursor` (picture pixels) among the drawn nodes.
pub fn pick(view: &View, metadata: &Metadata, nodes: &[SceneNode], cursor: [f64; 2]) -> Option<Picked> {
    let mut best: Option<(f64, Picked)> = None;
    for drawn in nodes {
        let index = drawn.node.node as usize;
        let Some(node) = drawn.page.nodes.get(index) else { continue };
        let Some(family) = metadata.families.get(drawn.page.family as usize) else { continue };
        if !near_cursor(view, &Extent { bounds: node.bounds.moved(drawn.offset), margin: 0.0 }, cursor) {
            continue;
        }
        let Some(particles) = drawn.page.block(index, family, drawn.time) else { continue };
        let Some(codebook) = particles.table() else { continue };
        for i in 0..particles.len() {
            let Some(code) = particles.entry(i) else { continue };
            let camera = view.to_camera(particles.position(i) + drawn.offset);
            let Some([px, py]) = view.to_pixels(camera) else { continue };
            let pixels = (px - cursor[0]).hypot(py - cursor[1]);
            if pixels > REACH_PX || camera.z <= 0.0 {
                continue;
            }
            let position = view.eye + view.right * camera.x + view.up * camera.y + view.forward * camera.z;
            if !view.cut.keeps(position) {
                continue;
            }
            let column = |values: &[f32]| values.get(code).map_or(0.0, |&value| f64::from(value));
            let (density, smoothing_length) = (column(&codebook.density), column(&codebook.smoothing_length));
            let closeness = 1.0 - pixels / (REACH_PX * 1.001);
            let score = closeness * closeness * density.max(f64::MIN_POSITIVE).powf(0.5) / camera.z.powf(0.25);
            if best.as_ref().is_none_or(|(highest, _)| score > *highest) {
                let particle = ParticleRef { node: drawn.node, index: i as u32 };
                best = Some((score, Picked { particle, position, smoothing_length, pixels }));
            }
        }
    }
    best.map(|(_, picked)| picked)
}

/// Whether anything in a box may be drawn within reach of the cursor; true where the box reaches behind the eye.
fn near_cursor(view: &View, extent: &Extent, [x, y]: [f64; 2]) -> bool {
    let (min, max) = (extent.bounds.min, extent.bounds.max);
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 1 { max[axis] } else { min[axis] };
        let Some(pixel) = view.to_pixels(view.to_camera(DVec3::new(pick(0), pick(1), pick(2)))) else { return true };
        for axis in 0..2 {
            low[axis] = low[axis].min(pixel[axis]);
            high[axis] = high[axis].max(pixel[axis]);
        }
    }
    (low[0] - REACH_PX..=high[0] + REACH_PX).contains(&x) && (low[1] - REACH_PX..=high[1] + REACH_PX).contains(&y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use crate::view::Projection;

    fn view() -> View {
        let projection = Projection::Perspective { fov_y: 0.8 };
        View::look_at(DVec3::Z * 10.0, DVec3::ZERO, DVec3::Y, projection, 800, 600).unwrap()
    }

    #[test]
    fn only_boxes_near_the_cursor_are_searched() {
        let cube = |center: DVec3, half: f64| Extent {
            bounds: Bounds { min: center - half, max: center + half },
            margin: 0.0,
        };
        assert!(near_cursor(&view(), &cube(DVec3::ZERO, 0.5), [400.0, 300.0]));
        assert!(!near_cursor(&view(), &cube(DVec3::ZERO, 0.5), [700.0, 300.0]));
        assert!(near_cursor(&view(), &cube(DVec3::ZERO, 50.0), [700.0, 300.0]), "a box around the eye");
        assert!(near_cursor(&view(), &cube(DVec3::ZERO, 0.0), [400.0 + REACH_PX, 300.0]));
    }
}
