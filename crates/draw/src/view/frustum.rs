//! What a view can see of a box: visibility and the range of depths, conservative and in double precision.

use super::{Projection, View};
use crate::model::Bounds;
use glam::DVec3;

/// An axis-aligned box of particle positions, and how far the particles reach out of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Box around the true and the drawn positions, world units; not empty.
    pub bounds: Bounds,
    /// Largest smoothing length of a particle in the box, world units.
    pub margin: f64,
}

impl Extent {
    /// The same, displaced.
    pub fn moved(&self, offset: DVec3) -> Extent {
        Extent { bounds: self.bounds.moved(offset), ..*self }
    }

    /// What particles within `bounds` have of it; `None` for none.
    pub fn within(&self, bounds: &Bounds) -> Option<Extent> {
        let bounds = Bounds { min: self.bounds.min.max(bounds.min), max: self.bounds.max.min(bounds.max) };
        (!bounds.is_empty()).then_some(Extent { bounds, ..*self })
    }

    /// Half the box's extent along a unit vector.
    fn half_extent_along(&self, direction: DVec3) -> f64 {
        0.5 * self.bounds.size().dot(direction.abs())
    }
}

impl View {
    /// Whether any particle of the extent can reach a pixel. Never false for an extent that does; may be true for one
    /// just outside a corner of the frustum.
    pub fn sees(&self, extent: &Extent) -> bool {
        let center = self.to_camera(extent.bounds.center());
        let [[left, right], [bottom, top]] = self.edges();
        // A side's inward normal in camera space, and the signed distance of the plane from the eye.
        let sides = match self.projection {
            Projection::Perspective { .. } => [
                (DVec3::new(1.0, 0.0, -left).normalize(), 0.0),
                (DVec3::new(-1.0, 0.0, right).normalize(), 0.0),
                (DVec3::new(0.0, 1.0, -bottom).normalize(), 0.0),
                (DVec3::new(0.0, -1.0, top).normalize(), 0.0),
                (DVec3::Z, 0.0),
            ],
            Projection::Orthographic { .. } => {
                [(DVec3::X, -left), (DVec3::NEG_X, right), (DVec3::Y, -bottom), (DVec3::NEG_Y, top), (DVec3::Z, 0.0)]
            }
        };
        sides.iter().all(|&(normal, offset)| {
            let world_normal = normal.x * self.right + normal.y * self.up + normal.z * self.forward;
            center.dot(normal) + offset + extent.half_extent_along(world_normal) + extent.margin >= 0.0
        })
    }

    /// How far the box with its margin is from the lines of sight of an orthographic view, along the furthest of its
    /// sides; 0 for what it sees.
    pub(super) fn distance_to_sight(&self, extent: &Extent) -> f64 {
        let center = self.to_camera(extent.bounds.center());
        let beyond = |at: f64, [low, high]: [f64; 2]| (low - at).max(at - high);
        let [x, y] = self.edges();
        let across = beyond(center.x, x) - extent.half_extent_along(self.right);
        let along = beyond(center.y, y) - extent.half_extent_along(self.up);
        let behind = -center.z - extent.half_extent_along(self.forward);
        (across.max(along).max(behind) - extent.margin).max(0.0)
    }

    /// Smallest depth of a point of the box (without its margin), world units; negative behind the eye.
    pub fn nearest_depth(&self, extent: &Extent) -> f64 {
        self.to_camera(extent.bounds.center()).z - extent.half_extent_along(self.forward)
    }

    /// Largest depth of a point of the box (without its margin), world units.
    pub fn farthest_depth(&self, extent: &Extent) -> f64 {
        self.to_camera(extent.bounds.center()).z + extent.half_extent_along(self.forward)
    }

    /// An upper bound of `1 / cos(theta)` over all points that lie both in the box and in a perspective picture,
    /// `theta` being the angle to the middle line of sight.
    pub(super) fn largest_secant(&self, extent: &Extent) -> f64 {
        let [x, y] = self.reach();
        let corner = x.hypot(y);
        let nearest = self.nearest_depth(extent);
        let tangent = if nearest > 0.0 {
            let center = self.to_camera(extent.bounds.center());
            let lateral = (center.x.abs() + extent.half_extent_along(self.right))
                .hypot(center.y.abs() + extent.half_extent_along(self.up));
            corner.min(lateral / nearest)
        } else {
            corner
        };
        tangent.hypot(1.0)
    }
}
