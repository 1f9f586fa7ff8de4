//! How far a camera may move before it needs a node refined: the prefetching sphere of F12 4.8.2, independent of the
//! viewing direction.
//!
//! A node is refined where it is nearer than `d_min = f delta sec^2(theta) / tau`: seen at the picture's corner, `theta`
//! off the middle line of sight, a point at distance `d` has depth `d cos(theta)` and its displacement is stretched by
//! another `sec(theta)` (see [`super::error`]). So whatever lies within `d_min + d_prefetch` may be needed refined after
//! a turn by any angle and a move by `d_prefetch`. A box that reaches past the plane of the eye is refined from a little
//! further away; such a node is loaded when it is missed.

use super::frustum::Extent;
use super::{Projection, View};

impl View {
    /// How far the camera has to move until an error of at most `tau` pixels may need the node refined whose largest
    /// displacement is `delta` (world units): 0 or less where a turn may suffice, infinite where no move does. An
    /// orthographic camera moves without turning.
    pub fn travel(&self, extent: &Extent, delta: f64, tau: f64) -> f64 {
        if delta <= 0.0 {
            return f64::INFINITY;
        }
        if delta.is_infinite() {
            return f64::NEG_INFINITY;
        }
        let focal = self.focal_pixels();
        match self.projection {
            Projection::Perspective { .. } => {
                self.distance_to(extent) - focal * delta * self.corner_secant_squared() / tau
            }
            Projection::Orthographic { .. } if focal * delta <= tau => f64::INFINITY,
            Projection::Orthographic { .. } => self.distance_to_sight(extent),
        }
    }

    /// How far a perspective camera has to move until, after a turn by any angle, part of the extent may be seen at less than this
    /// depth: 0 or less where the turn suffices.
    pub(super) fn travel_to_depth(&self, extent: &Extent, depth: f64) -> f64 {
        self.distance_to(extent) - depth * self.corner_secant_squared().sqrt()
    }

    fn distance_to(&self, extent: &Extent) -> f64 {
        self.eye.distance(self.eye.clamp(extent.bounds.min, extent.bounds.max))
    }

    /// The square of `sec(theta)` at the picture's corner.
    fn corner_secant_squared(&self) -> f64 {
        let [x, y] = self.reach();
        1.0 + x * x + y * y
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::model::Bounds;
    use glam::DVec3;
    use proptest::prelude::*;

    /// A view before and after a move and, where it is perspective, a turn.
    pub fn moved_views() -> impl Strategy<Value = (View, View)> {
        let vector = |most: f64| prop::array::uniform3(-most..most).prop_map(DVec3::from);
        (vector(0.5), vector(1.0), any::<bool>()).prop_filter_map("looks along up", |(step, gaze, ortho)| {
            let projection =
                if ortho { Projection::Orthographic { height: 3.0 } } else { Projection::Perspective { fov_y: 0.8 } };
            let eye = DVec3::new(0.3, -0.2, 3.0);
            let before = View::look_at(eye, DVec3::ZERO, DVec3::Y, projection, 640, 360).ok()?;
            let gaze = if ortho { before.forward } else { gaze };
            let after = View::look_at(eye + step, eye + step + gaze, DVec3::Y, projection, 640, 360).ok()?;
            (gaze.cross(DVec3::Y).length() > 1e-3).then_some((before, after))
        })
    }

    proptest! {
        /// What a move and a turn make the view refine was within reach before: for boxes that stay in front of the eye.
        #[test]
        fn nothing_beyond_the_sphere_is_refined_after_a_move(
            min in prop::array::uniform3(-6.0..6.0f64),
            size in 0.001..0.5f64,
            (before, after) in moved_views(),
            delta in 1e-5..1e-2f64,
        ) {
            let min = DVec3::from(min);
            let extent = Extent { bounds: Bounds { min, max: min + size }, margin: 0.0 };
            let tau = 0.8;
            let needed = after.sees(&extent) && after.error_pixels(&extent, delta) > tau;
            // The distance is to the box's nearest point, the error counts its nearest depth: they differ by its diagonal.
            let slack = if matches!(before.projection, Projection::Orthographic { .. }) { 0.0 } else { 2.0 * 3f64.sqrt() * size };
            if needed {
                prop_assert!(before.travel(&extent, delta, tau) <= after.eye.distance(before.eye) + slack + 1e-9);
            }
        }
    }

    #[test]
    fn leaves_are_never_refined_and_relays_always() {
        let view =
            View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, Projection::Perspective { fov_y: 0.8 }, 64, 64).unwrap();
        let extent = Extent { bounds: Bounds { min: DVec3::ZERO, max: DVec3::ONE }, margin: 0.0 };
        assert_eq!(view.travel(&extent, 0.0, 0.8), f64::INFINITY);
        assert_eq!(view.travel(&extent, f64::INFINITY, 0.8), f64::NEG_INFINITY);
    }
}
