//! The shape of the tree: which cells are nodes, which of them leaves, and what each holds of the sorted particles.

use crate::codec::morton::MORTON_BITS;
use crate::hierarchy::NodeKey;
use crate::hierarchy::cell::MAX_DEPTH;
use std::ops::Range;

/// A node of the tree before anything is merged.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    pub key: NodeKey,
    pub sources: Range<usize>,
    /// Indices of the children in the next level.
    pub children: [Option<usize>; 8],
}

impl Shape {
    /// Whether the node has no children.
    pub fn is_leaf(&self) -> bool {
        self.children.iter().all(Option::is_none)
    }
}

/// Splits cells that hold more than `capacity` particles, down to [`MAX_DEPTH`]; one list for each depth, the root first,
/// each in Morton order.
pub(super) fn split(keys: &[u64], capacity: usize) -> Vec<Vec<Shape>> {
    let mut levels = vec![vec![Shape { key: NodeKey::ROOT, sources: 0..keys.len(), children: [None; 8] }]];
    for depth in 0..MAX_DEPTH {
        let mut below = Vec::new();
        for node in &mut levels[usize::from(depth)] {
            if node.sources.len() <= capacity {
                continue;
            }
            let shift = 3 * (MORTON_BITS - 1 - u32::from(depth));
            let mut start = node.sources.start;
            for octant in 0..8_u8 {
                let inside = &keys[start..node.sources.end];
                let len = inside.partition_point(|key| (key >> shift & 7) as u8 <= octant);
                if len > 0 {
                    node.children[usize::from(octant)] = Some(below.len());
                    below.push(Shape { key: node.key.child(octant), sources: start..start + len, children: [None; 8] });
                }
                start += len;
            }
        }
        if below.is_empty() {
            break;
        }
        levels.push(below);
    }
    levels
}

/// The depth of the coarsest cells that separate two neighbouring keys; more than [`MORTON_BITS`] if they are equal.
pub(super) fn boundary_depth(a: u64, b: u64) -> u32 {
    // A key has 63 bits, so the first triple of bits starts one below the top.
    ((a ^ b) << 1).leading_zeros() / 3 + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_particle_is_in_one_leaf(
            mut keys in prop::collection::vec(prop_oneof![0..1_u64 << 63, 0..64_u64], 1..400),
            capacity in 1..40_usize,
        ) {
            keys.sort_unstable();
            let levels = split(&keys, capacity);
            let mut covered = 0;
            for (depth, level) in levels.iter().enumerate() {
                for node in level {
                    let shift = 3 * (MORTON_BITS - depth as u32);
                    let prefix = keys[node.sources.start] >> shift;
                    prop_assert!(keys[node.sources.clone()].iter().all(|key| key >> shift == prefix));
                    prop_assert!(node.key.is_valid() && usize::from(node.key.depth) == depth);
                    if node.is_leaf() {
                        prop_assert!(node.sources.len() <= capacity || depth == usize::from(MAX_DEPTH));
                        covered += node.sources.len();
                    }
                }
            }
            prop_assert_eq!(covered, keys.len());
        }

        #[test]
        fn boundaries_are_where_digits_differ(a in 0..1_u64 << 63, b in 0..1_u64 << 63) {
            let depth = boundary_depth(a, b);
            if depth <= MORTON_BITS {
                prop_assert_eq!(a >> (3 * (MORTON_BITS - depth + 1)), b >> (3 * (MORTON_BITS - depth + 1)));
                prop_assert_ne!(a >> (3 * (MORTON_BITS - depth)), b >> (3 * (MORTON_BITS - depth)));
            } else {
                prop_assert_eq!(a, b);
            }
        }
    }
}
