//! The cubic cells of an octree, addressed by depth and integer coordinates.

use crate::model::{Bounds, Placement};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The deepest node: a grid node needs 8 further bits of the 21-bit Morton coordinates for its cells, so grids end at
/// depth 13 and their leaves at 14. With the 21 bits of a leaf's own coordinates that resolves `2^-35` of the root cell.
pub const MAX_DEPTH: u8 = 14;

/// The cube that holds a family: the cell of depth 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RootCell {
    /// Its corner of smallest coordinates, world units.
    pub min: DVec3,
    /// Its edge, world units; positive.
    pub size: f64,
}

impl RootCell {
    /// A cube slightly larger than `bounds`, so that every position lies strictly inside; `fallback` (a length that
    /// matters, such as the largest smoothing length) sizes it where the bounds have no extent.
    pub fn around(bounds: Bounds, fallback: f64) -> RootCell {
        let center = bounds.center();
        let extent = bounds.size().max_element();
        // A cube far from the origin must not vanish in rounding: at least 2^-40 of the largest coordinate.
        let floor = center.abs().max_element() * 2.0_f64.powi(-40);
        let wanted = if extent > 0.0 { extent } else { fallback };
        let size = wanted.max(floor).clamp(f64::MIN_POSITIVE * 1e20, f64::MAX * 1e-20) * (1.0 + 2.0_f64.powi(-20));
        RootCell { min: center - DVec3::splat(0.5 * size), size }
    }

    /// The cell as a box.
    pub fn bounds(self) -> Bounds {
        Bounds { min: self.min, max: self.min + DVec3::splat(self.size) }
    }

    /// The cell where a placement puts it.
    pub fn placed(self, placement: &Placement) -> RootCell {
        if placement.is_here() {
            return self;
        }
        RootCell { min: placement.position(self.min), size: self.size * placement.scale }
    }
}

/// A cell of the octree: `x`, `y`, `z` below `2^depth`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeKey {
    /// 0 for the root cell.
    pub depth: u8,
    /// Cell index along x.
    pub x: u32,
    /// Cell index along y.
    pub y: u32,
    /// Cell index along z.
    pub z: u32,
}

impl NodeKey {
    /// The root cell.
    pub const ROOT: NodeKey = NodeKey { depth: 0, x: 0, y: 0, z: 0 };

    /// Whether depth and indices are in range.
    pub fn is_valid(self) -> bool {
        self.depth <= MAX_DEPTH && [self.x, self.y, self.z].iter().all(|&v| v >> self.depth == 0)
    }

    /// Child `octant`: bit 0 of it is the upper half in x, bit 1 in y, bit 2 in z.
    pub fn child(self, octant: u8) -> NodeKey {
        let half = |v: u32, bit: u8| v << 1 | u32::from(octant >> bit & 1);
        NodeKey { depth: self.depth + 1, x: half(self.x, 0), y: half(self.y, 1), z: half(self.z, 2) }
    }

    /// Edge of the cell, world units.
    pub fn size(self, root: RootCell) -> f64 {
        root.size * (-f64::from(self.depth)).exp2()
    }

    /// Corner of the cell with the smallest coordinates, world units.
    pub fn min(self, root: RootCell) -> DVec3 {
        root.min + DVec3::new(f64::from(self.x), f64::from(self.y), f64::from(self.z)) * self.size(root)
    }

    /// The cell as a box.
    pub fn bounds(self, root: RootCell) -> Bounds {
        let min = self.min(root);
        Bounds { min, max: min + DVec3::splat(self.size(root)) }
    }

    /// A number that differs from those of other cells: the seed of what is drawn at random in it.
    pub fn seed(self) -> u32 {
        [self.x, self.y, self.z].into_iter().fold(u32::from(self.depth), |seed, x| mix(seed ^ x.rotate_left(9)))
    }
}

/// A number whose every bit depends on every bit of `x`.
#[inline]
pub fn mix(x: u32) -> u32 {
    let x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    let x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}
