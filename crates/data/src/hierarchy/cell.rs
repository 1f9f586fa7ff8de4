//! The cubic cells of an octree, addressed by depth and integer coordinates.

use crate::codec::morton::{self, MORTON_BITS};
use crate::model::portable::portable;
use crate::model::{Bounds, Placement};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The depth of the smallest cells. With the 21 bits of a leaf's own coordinates that resolves `2^-42` of the root cell. Where one of them
/// holds too many particles for a leaf, in the extreme all at one position, the nodes below it hold parts of them, in their order.
pub const CELL_DEPTH: u8 = MORTON_BITS as u8;

/// The deepest node: a smallest cell has up to `8^7` parts, enough for what `u32` counts.
pub const MAX_DEPTH: u8 = CELL_DEPTH + 7;

/// The cube that holds a family: the cell of depth 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RootCell {
    /// Its corner of smallest coordinates, world units.
    pub min: DVec3,
    /// Its edge, world units; positive.
    pub size: f64,
}

portable!(RootCell { min, size });

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

/// A cell of the octree, or below [`CELL_DEPTH`] a part of the particles of one: `x`, `y`, `z` below `2^depth`.
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

portable!(NodeKey { depth, x, y, z });

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

    /// Number of depths that it lies below the smallest cells.
    fn below(self) -> u8 {
        self.depth.saturating_sub(CELL_DEPTH)
    }

    /// The cell that its particles lie in: itself, or the smallest one that it is a part of.
    pub fn cell(self) -> NodeKey {
        let below = self.below();
        NodeKey { depth: self.depth - below, x: self.x >> below, y: self.y >> below, z: self.z >> below }
    }

    /// Its place in the Morton order of the nodes of its depth; without the lowest three bits that of its parent.
    pub fn order(self) -> u128 {
        let below = self.below();
        let NodeKey { x, y, z, .. } = self.cell();
        let part = [self.x, self.y, self.z].map(|v| v & ((1 << below) - 1));
        u128::from(morton::encode([x, y, z])) << (3 * below) | u128::from(morton::encode(part))
    }

    /// Edge of the cell, world units.
    pub fn size(self, root: RootCell) -> f64 {
        root.size * (-f64::from(self.cell().depth)).exp2()
    }

    /// Corner of the cell with the smallest coordinates, world units.
    pub fn min(self, root: RootCell) -> DVec3 {
        let NodeKey { x, y, z, .. } = self.cell();
        root.min + DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * self.size(root)
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ROOT: RootCell = RootCell { min: DVec3::ZERO, size: 1.0 };

    proptest! {
        /// Down any way: orders grow with octants and have those of parents in front; cells halve, and from the smallest on stay.
        #[test]
        fn ways_down_are_in_order(octants in prop::collection::vec(0..8_u8, 1..=usize::from(MAX_DEPTH))) {
            let mut node = NodeKey::ROOT;
            for octant in octants {
                let child = node.child(octant);
                prop_assert!(child.is_valid());
                prop_assert_eq!(child.order(), node.order() << 3 | u128::from(octant));
                let has_cells = node.depth < CELL_DEPTH;
                prop_assert_eq!(child.cell() == node.cell(), !has_cells);
                prop_assert_eq!(child.size(ROOT), if has_cells { 0.5 } else { 1.0 } * node.size(ROOT));
                let (inner, outer) = (child.bounds(ROOT), node.bounds(ROOT));
                prop_assert!(outer.min.cmple(inner.min).all() && inner.max.cmple(outer.max).all());
                node = child;
            }
        }
    }
}
