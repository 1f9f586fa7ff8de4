//! What a node's cells are: means of a level of the pyramid, in a box of it.

use super::bricks::Part;
use super::grid::{Shape, index};
use super::pyramid::Means;

/// Cells along an axis of a node, at most: what is finer counts as variation within a cell.
pub(super) const SIDE: usize = 8;

/// Levels of nodes between the nodes of a level and its cells.
pub(super) fn cell_levels(level: usize) -> usize {
    level.min(SIDE.trailing_zeros() as usize)
}

/// The cells of the nodes of a level, in a box.
pub(super) struct Cells<'a> {
    pub dimensions: usize,
    /// Cells along an axis of a node.
    pub side: usize,
    /// The shape of the level of cells.
    pub of: Shape,
    /// The box that is there.
    pub part: Part,
    /// Samples of a whole cell.
    pub samples: f32,
    /// Of each plane; samples have no more than means.
    pub planes: &'a [Means],
    /// Whether cells are samples.
    pub are_samples: bool,
}

impl Cells<'_> {
    /// Copies a node's cells from a column of the box; those beyond the grid as the last ones in it.
    #[inline]
    pub fn node(&self, at: Shape, from: &[f32], out: &mut [f32]) {
        let s = self.side;
        let depth = if self.dimensions == 2 { 1 } else { s };
        let mut to = 0;
        for z in 0..depth {
            let z = if depth == 1 { 0 } else { (at[2] * s + z).min(self.of[2] - 1) };
            for y in 0..s {
                let y = (at[1] * s + y).min(self.of[1] - 1);
                let row = self.part.index([self.part.min[0], y, z]);
                let x = at[0] * s;
                if x + s <= self.of[0] {
                    let first = row + x - self.part.min[0];
                    out[to..to + s].copy_from_slice(&from[first..first + s]);
                } else {
                    (0..s).for_each(|k| out[to + k] = from[row + (x + k).min(self.of[0] - 1) - self.part.min[0]]);
                }
                to += s;
            }
        }
    }

    /// The sum of squared deviations within a node's cells.
    pub fn within(&self, at: Shape, plane: usize) -> f32 {
        if self.are_samples {
            return 0.0;
        }
        let variation = &self.planes[plane].variation;
        let s = self.side;
        let end: Shape = std::array::from_fn(|k| {
            let side = if k < self.dimensions { s } else { 1 };
            ((at[k] + 1) * side).min(self.of[k])
        });
        let first: Shape = std::array::from_fn(|k| if k < self.dimensions { at[k] * s } else { 0 });
        let mut sum = 0.0;
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                let row = self.part.index([first[0], y, z]);
                sum += variation[row..row + end[0] - first[0]].iter().sum::<f32>();
            }
        }
        sum
    }
}

/// Points of a level that blend, in a box of it: of one plane.
pub(super) struct Blend<'a> {
    pub dimensions: usize,
    /// The shape of the level.
    pub of: Shape,
    /// The box that is there.
    pub part: Part,
    /// Its points' values.
    pub values: &'a [f32],
}

impl Blend<'_> {
    /// What they show in a node's cells, `side` along each axis; `scratch` has [`scratch_len`] numbers. The box has the node's neighbours.
    pub fn show(&self, side: usize, at: Shape, scratch: &mut [f32], out: &mut [f32]) {
        let (dimensions, values) = (self.dimensions, self.values);
        // Three values along each axis, those outside as the next one inside.
        let place = |k: usize, step: usize| {
            if k < dimensions { (at[k] + step).saturating_sub(1).min(self.of[k] - 1) - self.part.min[k] } else { 0 }
        };
        let [near_x, near_y, near_z] = [0, 1, 2].map(|k| [0, 1, 2].map(|step| place(k, step)));
        // Which neighbour a cell is next to along an axis, and how much that counts.
        let mut weights = [(0_usize, 0.0_f32); SIDE];
        let weights = &mut weights[..side];
        for (c, weight) in weights.iter_mut().enumerate() {
            let d = (c as f32 + 0.5) / side as f32 - 0.5;
            *weight = if d < 0.0 { (0, -d) } else { (2, d) };
        }
        let depth = if dimensions == 2 { 1 } else { 3 };
        // Along x: rows of cells for the nine neighbours in y and z.
        let (rows, planes) = scratch.split_at_mut(9 * side);
        for z in 0..depth {
            for y in 0..3 {
                let line = index(self.part.shape, [0, near_y[y], near_z[z]]);
                let v = near_x.map(|x| values[line + x]);
                for (c, &(other, w)) in weights.iter().enumerate() {
                    rows[(z * 3 + y) * side + c] = v[1] + w * (v[other] - v[1]);
                }
            }
        }
        for z in 0..depth {
            for (c, &(other, w)) in weights.iter().enumerate() {
                for x in 0..side {
                    let (own, next) = (rows[(z * 3 + 1) * side + x], rows[(z * 3 + other) * side + x]);
                    planes[(z * side + c) * side + x] = own + w * (next - own);
                }
            }
        }
        if depth == 1 {
            out[..side * side].copy_from_slice(&planes[..side * side]);
            return;
        }
        let area = side * side;
        for (c, &(other, w)) in weights.iter().enumerate() {
            for i in 0..area {
                let (own, next) = (planes[area + i], planes[other * area + i]);
                out[c * area + i] = own + w * (next - own);
            }
        }
    }
}

/// Numbers of scratch that [`Blend::show`] needs.
pub(super) fn scratch_len(side: usize) -> usize {
    9 * side + 3 * side * side
}
