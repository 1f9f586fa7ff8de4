//! The cells around one brick, copied together: what the rays through it read, interpolation and gradients included.

use super::bricks::{BRICK, BrickGrid, Slab};

/// Cells along a block's side: one more than the brick before it and two behind it across, three slices in front of it.
pub const SIDE: usize = BRICK + 3;
/// Columns and rows of a block before those of its brick.
pub const BEFORE: usize = 1;
/// Slices of a block in front of its brick's first: the step into that slice is drawn with the brick, the slice after
/// the last step is the brick's last.
pub const FRONT: usize = 3;

/// The field around a brick; cell `(x, y, z)` is at `(19 z + y) 19 + x`.
#[derive(Clone, Debug, Default)]
pub struct Block {
    density: Vec<f32>,
    weighted: Vec<f32>,
}

impl Block {
    /// Fills the block of a brick. False, and nothing is filled, where no density in reach is above `least`.
    pub fn fill(&mut self, slab: &Slab, brick_grid: &BrickGrid, [column, row, layer]: [usize; 3], least: f32) -> bool {
        // Bricks around, the layer in front included; what is not in the slab reads as empty.
        let near = |index: usize, offset: usize| (index + offset).wrapping_sub(1);
        let brick =
            |dx: usize, dy: usize, dz: usize| slab.brick(near(column, dx), near(row, dy), near(layer, dz), brick_grid);
        let bricks = (0..18).filter_map(|index| brick(index % 3, index / 3 % 3, index / 9));
        let (mut densest, mut attribute) = (0.0f32, false);
        for brick in bricks {
            densest = densest.max(brick.densest);
            attribute |= !brick.weighted.is_empty();
        }
        if densest <= least || densest <= 0.0 {
            return false;
        }
        self.density.clear();
        self.density.resize(SIDE * SIDE * SIDE, 0.0);
        self.weighted.clear();
        self.weighted.resize(if attribute { SIDE * SIDE * SIDE } else { 0 }, 0.0);
        for z in 0..SIDE {
            // Slices beyond the grid's ends repeat the last one, so that the ends have no surfaces.
            let slice = (layer * BRICK + z).saturating_sub(FRONT).min(brick_grid.slices - 1);
            let dz = (slice / BRICK + 1).saturating_sub(layer);
            for y in 0..SIDE {
                let (dy, in_y) = split(y);
                for (dx, from, to, in_x) in [(0, 0, 1, BRICK - 1), (1, 1, BRICK + 1, 0), (2, BRICK + 1, SIDE, 0)] {
                    let Some(brick) = brick(dx, dy, dz) else { continue };
                    let start = (slice % BRICK * BRICK + in_y) * BRICK + in_x;
                    let (out, cells) = ((z * SIDE + y) * SIDE + from, to - from);
                    self.density[out..out + cells].copy_from_slice(&brick.density[start..start + cells]);
                    if attribute && !brick.weighted.is_empty() {
                        self.weighted[out..out + cells].copy_from_slice(&brick.weighted[start..start + cells]);
                    }
                }
            }
        }
        true
    }

    /// Density and `sum m A W` at a place of a slice: bilinear between four cells.
    #[inline]
    pub fn sample(&self, at: &Place, z: usize) -> [f32; 2] {
        let start = (z * SIDE + at.y) * SIDE + at.x;
        let read = |cells: &[f32]| match at.shares {
            [0.0, 0.0] => cells[start],
            [u, v] => {
                let [a, b, c, d] = [0, 1, SIDE, SIDE + 1].map(|offset| cells[start + offset]);
                (a + u * (b - a)) * (1.0 - v) + (c + u * (d - c)) * v
            }
        };
        [read(&self.density), if self.weighted.is_empty() { 0.0 } else { read(&self.weighted) }]
    }

    /// The density alone.
    #[inline]
    pub fn density(&self, at: &Place, z: usize) -> f32 {
        self.sample(at, z)[0]
    }
}

/// Which of three bricks a cell of a block is in, and where.
fn split(cell: usize) -> (usize, usize) {
    match cell.checked_sub(BEFORE) {
        None => (0, BRICK - BEFORE + cell),
        Some(inside) => (1 + inside / BRICK, inside % BRICK),
    }
}

/// A place across a block: a cell, and the shares of the way to the next column and row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Column in the block.
    pub x: usize,
    /// Row in the block.
    pub y: usize,
    /// How far towards the next column and row, within [0, 1).
    pub shares: [f32; 2],
}
