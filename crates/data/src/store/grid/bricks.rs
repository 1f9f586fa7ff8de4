//! How a grid is cut into bricks, each of which has a page of its nodes and one of its samples; and a page for the nodes above them.

use crate::hierarchy::wavelet::{Hierarchy, Shape};

/// Samples along a brick's edge, as a power of two, of images and volumes: the levels of nodes that a brick has.
const LEVELS: [usize; 2] = [9, 6];

/// The bricks of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bricks {
    /// 2 or 3.
    pub dimensions: usize,
    /// Samples of the grid.
    pub shape: Shape,
}

/// Nodes of a level, or samples, in a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// The first.
    pub min: Shape,
    /// How many along each axis.
    pub shape: Shape,
}

impl Part {
    /// The indices of a level of this shape, the first axis fastest.
    pub fn indices(&self, of: Shape) -> Vec<usize> {
        let Part { min, shape } = *self;
        let rows = (0..shape[2]).flat_map(move |z| (0..shape[1]).map(move |y| (y, z)));
        rows.flat_map(|(y, z)| {
            let first = ((min[2] + z) * of[1] + min[1] + y) * of[0] + min[0];
            first..first + shape[0]
        })
        .collect()
    }
}

impl Bricks {
    /// Levels of nodes in a brick.
    pub fn levels(&self) -> usize {
        LEVELS[self.dimensions.clamp(2, 3) - 2]
    }

    /// Bricks along each axis.
    pub fn counts(&self) -> Shape {
        self.level_shape(self.levels())
    }

    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.counts().iter().product()
    }

    /// Nodes of a level along each axis; of level 0 samples.
    pub fn level_shape(&self, level: usize) -> Shape {
        std::array::from_fn(|axis| if axis < self.dimensions { self.shape[axis].div_ceil(1 << level) } else { 1 })
    }

    /// Levels of nodes above the samples: the last has one node.
    pub fn all_levels(&self) -> usize {
        (0..).find(|level| self.level_shape(*level) == [1; 3]).unwrap_or(0)
    }

    /// The nodes of a level that are in a brick; of level 0 its samples.
    pub fn part(&self, brick: usize, level: usize) -> Part {
        let counts = self.counts();
        let at = [brick % counts[0], brick / counts[0] % counts[1], brick / (counts[0] * counts[1])];
        let of = self.level_shape(level);
        let side: Shape =
            std::array::from_fn(|axis| if axis < self.dimensions { 1 << (self.levels() - level) } else { 1 });
        let min: Shape = std::array::from_fn(|axis| at[axis] * side[axis]);
        Part { min, shape: std::array::from_fn(|axis| (of[axis] - min[axis]).min(side[axis])) }
    }

    /// Whether a hierarchy is one of such a grid.
    pub fn fits(&self, hierarchy: &Hierarchy) -> bool {
        let levels = hierarchy.levels.iter().enumerate();
        hierarchy.shape == self.shape
            && hierarchy.levels.len() == self.all_levels()
            && levels.into_iter().all(|(at, level)| level.shape == self.level_shape(at + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every sample and every node below the bricks' own is in exactly one brick.
        #[test]
        fn bricks_part_the_grid(dimensions in 2usize..4, shape in prop::array::uniform3(1usize..200)) {
            let shape = if dimensions == 2 { [shape[0] * 5, shape[1] * 5, 1] } else { shape };
            let bricks = Bricks { dimensions, shape };
            for level in 0..=bricks.levels() {
                let of = bricks.level_shape(level);
                let mut seen = vec![0u8; of.iter().product()];
                for brick in 0..bricks.len() {
                    let part = bricks.part(brick, level);
                    let indices = part.indices(of);
                    prop_assert_eq!(indices.len(), part.shape.iter().product::<usize>());
                    indices.into_iter().for_each(|index| seen[index] += 1);
                }
                prop_assert!(seen.iter().all(|times| *times == 1));
            }
        }
    }
}
