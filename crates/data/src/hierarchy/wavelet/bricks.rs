//! How a grid is cut into bricks, which are built, written and read one by one; and boxes of nodes or samples.

use super::grid::{Shape, index};

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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Part {
    /// The first.
    pub min: Shape,
    /// How many along each axis.
    pub shape: Shape,
}

impl Part {
    /// All of a level of this shape.
    pub fn whole(of: Shape) -> Part {
        Part { min: [0; 3], shape: of }
    }

    /// The first place along each axis that is not in it any more.
    pub fn end(&self) -> Shape {
        std::array::from_fn(|k| self.min[k] + self.shape[k])
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The index within it of a place of the level.
    #[inline]
    pub fn index(&self, at: Shape) -> usize {
        index(self.shape, [at[0] - self.min[0], at[1] - self.min[1], at[2] - self.min[2]])
    }

    /// The place of the level that an index within it is.
    #[inline]
    pub fn place(&self, index: usize) -> Shape {
        let at = super::grid::place(self.shape, index);
        std::array::from_fn(|k| self.min[k] + at[k])
    }

    /// The box with so many places more on each side along the first axes, as far as a level of this shape has them.
    pub fn wider(&self, by: usize, dimensions: usize, of: Shape) -> Part {
        let end = self.end();
        let min: Shape = std::array::from_fn(|k| if k < dimensions { self.min[k].saturating_sub(by) } else { 0 });
        let end: Shape = std::array::from_fn(|k| if k < dimensions { (end[k] + by).min(of[k]) } else { of[k] });
        Part { min, shape: std::array::from_fn(|k| end[k] - min[k]) }
    }

    /// The box of what so many levels further down lies below it, of a level of this shape.
    pub fn below(&self, levels: usize, dimensions: usize, of: Shape) -> Part {
        let end = self.end();
        let min: Shape = std::array::from_fn(|k| if k < dimensions { self.min[k] << levels } else { 0 });
        let end: Shape = std::array::from_fn(|k| if k < dimensions { (end[k] << levels).min(of[k]) } else { of[k] });
        Part { min, shape: std::array::from_fn(|k| end[k] - min[k]) }
    }

    /// The box of the nodes so many levels further up that have any of it below them.
    pub fn above(&self, levels: usize, dimensions: usize) -> Part {
        let end = self.end();
        let min: Shape = std::array::from_fn(|k| if k < dimensions { self.min[k] >> levels } else { 0 });
        let end: Shape = std::array::from_fn(|k| if k < dimensions { end[k].div_ceil(1 << levels) } else { 1 });
        Part { min, shape: std::array::from_fn(|k| end[k] - min[k]) }
    }

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

    /// Whether there are none, as of a grid without samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
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
