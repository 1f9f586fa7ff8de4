//! What a view can see of a box: visibility and the range of depths, conservative and in double precision.

use super::{Projection, View};
use glam::DVec3;

/// An axis-aligned cube (an octree cell) whose particles reach `margin` beyond it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Lower corner, world units.
    pub min: DVec3,
    /// Edge length, world units.
    pub size: f64,
    /// Largest smoothing length of a particle in the cell, world units.
    pub margin: f64,
}

impl Cell {
    /// The middle of the cube.
    pub fn center(&self) -> DVec3 {
        self.min + 0.5 * self.size
    }

    /// Half the cube's extent along a unit vector.
    fn half_extent_along(&self, direction: DVec3) -> f64 {
        0.5 * self.size * direction.abs().element_sum()
    }
}

impl View {
    /// Whether any particle of the cell can reach a pixel. Never false for a cell that does; may be true for one
    /// just outside a corner of the frustum.
    pub fn sees(&self, cell: &Cell) -> bool {
        let center = self.to_camera(cell.center());
        let half_width = 0.5 * f64::from(self.width) / self.focal_pixels();
        let half_height = 0.5 * f64::from(self.height) / self.focal_pixels();
        // A side's inward normal in camera space, and the signed distance of the plane from the eye.
        let sides = match self.projection {
            Projection::Perspective { .. } => [
                (DVec3::new(1.0, 0.0, half_width).normalize(), 0.0),
                (DVec3::new(-1.0, 0.0, half_width).normalize(), 0.0),
                (DVec3::new(0.0, 1.0, half_height).normalize(), 0.0),
                (DVec3::new(0.0, -1.0, half_height).normalize(), 0.0),
                (DVec3::Z, 0.0),
            ],
            Projection::Orthographic { .. } => [
                (DVec3::X, half_width),
                (DVec3::NEG_X, half_width),
                (DVec3::Y, half_height),
                (DVec3::NEG_Y, half_height),
                (DVec3::Z, 0.0),
            ],
        };
        sides.iter().all(|&(normal, offset)| {
            let world_normal = normal.x * self.right + normal.y * self.up + normal.z * self.forward;
            center.dot(normal) + offset + cell.half_extent_along(world_normal) + cell.margin >= 0.0
        })
    }

    /// Smallest depth of a point of the cube (without its margin), world units; negative behind the eye.
    pub fn nearest_depth(&self, cell: &Cell) -> f64 {
        self.to_camera(cell.center()).z - cell.half_extent_along(self.forward)
    }

    /// An upper bound of `1 / cos(theta)` over all points that lie both in the cube and in a perspective picture,
    /// `theta` being the angle to the middle line of sight.
    pub(super) fn largest_secant(&self, cell: &Cell) -> f64 {
        let half_width = 0.5 * f64::from(self.width) / self.focal_pixels();
        let half_height = 0.5 * f64::from(self.height) / self.focal_pixels();
        let corner = half_width.hypot(half_height);
        let nearest = self.nearest_depth(cell);
        let tangent = if nearest > 0.0 {
            let center = self.to_camera(cell.center());
            let lateral = (center.x.abs() + cell.half_extent_along(self.right))
                .hypot(center.y.abs() + cell.half_extent_along(self.up));
            corner.min(lateral / nearest)
        } else {
            corner
        };
        tangent.hypot(1.0)
    }
}
