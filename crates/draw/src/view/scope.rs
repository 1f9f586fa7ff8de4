//! For whom a selection is made: for one picture, or for all that are put together into one, so that they draw the same.

use super::{Extent, Projection, View};
use std::f64::consts::PI;

/// What of the data a selection is for, seen from a view's eye.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Scope {
    /// What the view's picture shows.
    #[default]
    Picture,
    /// What the pictures of eyes beside it show, which look in parallel.
    Beside {
        /// How far these eyes are away from the view's at most, world units.
        away: f64,
    },
    /// What lies in directions near the middle line of sight, in all of them where the angle is half a turn.
    Around {
        /// The largest angle to the middle line of sight, radians.
        half_angle: f64,
        /// Angle of a pixel, radians.
        pixel: f64,
        /// How far eyes are away from the view's at most, world units.
        away: f64,
    },
}

impl Scope {
    /// Whether any particle of the extent can be seen. Never false for an extent that is.
    pub fn sees(&self, view: &View, extent: &Extent) -> bool {
        match *self {
            Scope::Picture => view.sees(extent),
            Scope::Beside { away } => view.sees(&Extent { margin: extent.margin + away, ..*extent }),
            Scope::Around { half_angle, away, .. } => {
                let center = extent.bounds.center() - view.eye;
                let (distance, radius) = (center.length(), 0.5 * extent.bounds.size().length() + extent.margin + away);
                half_angle >= PI
                    || distance <= radius
                    || center.angle_between(view.forward) <= half_angle + (radius / distance).asin()
            }
        }
    }

    /// Pixels for a length, for each share of the box's longest edge that counts as the least distance: what the eye is in is worth
    /// drawing finely, yet not without end.
    pub(super) fn scales(&self, view: &View, extent: &Extent, shares: [f64; 2]) -> [f64; 2] {
        let (focal, nearest) = match (*self, view.projection) {
            (Scope::Around { pixel, .. }, _) => (pixel.recip(), distance(view, extent)),
            (_, Projection::Orthographic { .. }) => return [view.focal_pixels(); 2],
            (_, Projection::Perspective { .. }) => (view.focal_pixels(), view.nearest_depth(extent)),
        };
        let size = extent.bounds.size().max_element();
        shares.map(|share| focal / nearest.max(share * size).max(f64::MIN_POSITIVE))
    }

    /// Largest displacement in the picture, pixels, of any particle of the extent that is drawn at most `delta` from its place.
    pub(super) fn error_pixels(&self, view: &View, extent: &Extent, delta: f64) -> f64 {
        match *self {
            Scope::Picture | Scope::Beside { .. } => view.error_pixels(extent, delta),
            Scope::Around { pixel, away, .. } => {
                // The angle at the eye between a place and another one that far from it.
                let sine = delta / (distance(view, extent) - away).max(0.0);
                match delta > 0.0 {
                    true => (if sine < 1.0 { sine.asin() } else { PI }) / pixel,
                    false => 0.0,
                }
            }
        }
    }
}

/// Smallest distance of a point of the box (without its margin) from the eye, world units.
fn distance(view: &View, extent: &Extent) -> f64 {
    view.eye.distance(view.eye.clamp(extent.bounds.min, extent.bounds.max))
}

#[cfg(test)]
mod tests {
    use super::super::{Eye, Eyes, Stereo, StereoKind};
    use super::*;
    use crate::model::Bounds;
    use glam::DVec3;
    use proptest::prelude::*;

    proptest! {
        /// What any of the pictures shows is selected, and nothing is displaced by more than is said.
        #[test]
        fn what_is_seen_is_in_scope(
            eye in prop::array::uniform3(-2.0..2.0f64), min in prop::array::uniform3(-3.0..3.0f64), size in 0.001..2.0f64,
            inside in prop::array::uniform3(0.0..1.0f64), moved in prop::array::uniform3(-1.0..1.0f64),
            half_angle in 0.1..3.1f64, separation in 0.01..0.5f64, margin in 0.0..0.3f64,
        ) {
            let projection = Projection::Perspective { fov_y: 0.9 };
            let view = View::look_at(DVec3::from(eye), DVec3::new(5.0, 1.0, -7.0), DVec3::Y, projection, 300, 200).unwrap();
            let min = DVec3::from(min);
            let extent = Extent { bounds: Bounds { min, max: min + size }, margin };
            let place = min + size * DVec3::from(inside);
            // A point of a particle there.
            let reached = place + margin * DVec3::from(moved).normalize_or_zero();
            let pixel = 0.01;
            let around = Scope::Around { half_angle, pixel, away: 0.5 * separation };
            let toward = reached - (view.eye + 0.5 * separation * view.right);
            if toward.angle_between(view.forward) <= half_angle {
                prop_assert!(around.sees(&view, &extent));
            }
            let stereo = Stereo { kind: StereoKind::OffAxis, separation, zero_parallax: 1.5, eyes: Eyes::SideBySide };
            let (wide, scope) = stereo.both(&view).unwrap();
            for eye in [Eye::Left, Eye::Right] {
                let own = stereo.off_axis(&view, eye).unwrap();
                let at = own.to_pixels(own.to_camera(reached));
                if at.is_some_and(|[x, y]| (0.0..=300.0).contains(&x) && (0.0..=200.0).contains(&y)) {
                    prop_assert!(scope.sees(&wide, &extent));
                }
            }
            let delta = 0.3 * size;
            let drawn = place + delta * DVec3::from(moved).normalize_or_zero();
            let angle = (place - view.eye).angle_between(drawn - view.eye);
            prop_assert!(angle / pixel <= around.error_pixels(&view, &extent, delta) * (1.0 + 1e-9) + 1e-9);
        }
    }
}
