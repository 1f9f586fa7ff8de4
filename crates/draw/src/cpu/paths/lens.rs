//! A camera as paths are projected by it, and where sizes are angles how many pixels they come to.

use crate::view::{Projection, View};
use glam::Vec3;

/// How far from its middle a face of a panorama has paths; its edge is at 1, and what reaches into it begins a little beyond.
const FARTHEST_TANGENT: f32 = 1.5;
/// How long a chord is at most there.
const LONGEST_TANGENT: f32 = 0.25;

/// Half-spaces that chords are cut to, in camera coordinates: `normal . at + offset >= 0`.
pub(super) type Planes = Vec<(Vec3, f32)>;

/// A camera, in single precision.
pub(super) struct Lens {
    pub perspective: bool,
    pub focal: f32,
    pub middle: [f32; 2],
    pub size: [f32; 2],
    /// What is nearer is not drawn.
    pub near: f32,
    /// Where sizes are angles: the view's pixels for one of those that they are in, in the middle of its side of a cube.
    pub rate: Option<f32>,
}

impl Lens {
    pub fn new(view: &View, around: Option<f64>) -> Lens {
        let perspective = matches!(view.projection, Projection::Perspective { .. });
        Lens {
            perspective,
            focal: view.focal_pixels() as f32,
            middle: view.middle().map(|pixels| pixels as f32),
            size: [view.width as f32, view.height as f32],
            near: 0.0,
            rate: around.map(|pixel| (pixel * view.focal_pixels()) as f32),
        }
    }

    #[inline]
    pub fn pixel(&self, at: Vec3) -> [f32; 2] {
        let scale = if self.perspective { self.focal / at.z } else { self.focal };
        [self.middle[0] + at.x * scale, self.middle[1] - at.y * scale]
    }

    /// The view's pixels for one of those that sizes are in, at a place in the picture and along a unit vector there.
    ///
    /// At the tangents `q` of the angles from the axis, a step `n` in their plane is the angle
    /// `sqrt(n^2 (1 + q^2) - (q n)^2) / (1 + q^2)`.
    #[inline]
    pub fn scale(&self, at: [f32; 2], along: [f32; 2]) -> f32 {
        let Some(rate) = self.rate else { return 1.0 };
        let [qx, qy] = self.tangents(at);
        let (square, part) = (1.0 + qx * qx + qy * qy, qx * along[0] + qy * along[1]);
        rate * square / (square - part * part).max(1.0).sqrt()
    }

    #[inline]
    pub fn tangents(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        [(x - self.middle[0]) / self.focal, (y - self.middle[1]) / self.focal]
    }

    /// The most that [`Lens::scale`] is, where anything is drawn.
    pub fn most_scale(&self) -> f32 {
        self.rate.map_or(1.0, |rate| rate * (1.0 + 2.0 * FARTHEST_TANGENT * FARTHEST_TANGENT))
    }

    /// Whether a chord between two places is short enough for sizes to change evenly along it.
    #[inline]
    pub fn is_short(&self, [ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> bool {
        self.rate.is_none() || (bx - ax).hypot(by - ay) <= LONGEST_TANGENT * self.focal
    }

    /// The sides of a pyramid around what a face of a panorama shows; nothing is drawn beyond, where sizes grow without bounds.
    pub fn sides(&self) -> Planes {
        let side = |x: f32, y: f32| (Vec3::new(x, y, FARTHEST_TANGENT), 0.0);
        match self.rate {
            None => Planes::new(),
            Some(_) => vec![side(1.0, 0.0), side(-1.0, 0.0), side(0.0, 1.0), side(0.0, -1.0)],
        }
    }
}
