//! The cells around one brick, copied together: what the rays through it read, interpolation and gradients included.

use super::Fill;
use super::bricks::{BRICK, Brick, BrickGrid, Slab};

/// Cells along a block's side: one more than the brick before it and two behind it across, three slices in front of it.
pub const SIDE: usize = BRICK + 3;
/// Columns and rows of a block before those of its brick.
pub const BEFORE: usize = 1;
/// Slices of a block in front of its brick's first: the step into that slice is drawn with the brick, the slice after
/// the last step is the brick's last.
pub const FRONT: usize = 3;

/// Which of a block's numbers are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Numbers {
    /// The volume's.
    Volume,
    /// Those that surfaces are drawn of: where they have none of their own, the volume's.
    Surfaces,
}

/// The field around a brick; cell `(x, y, z)` is at `(19 z + y) 19 + x`.
#[derive(Clone, Debug, Default)]
pub struct Block {
    density: Vec<f32>,
    weighted: Vec<f32>,
    surface: Vec<f32>,
    opacity: Vec<f32>,
    /// Whether surfaces have numbers of their own.
    is_apart: bool,
    /// Whether the volume's extinction is multiplied by numbers of the bricks.
    is_dimmed: bool,
    /// Whether there is nothing where the volume's numbers, and the surfaces', are 0: no value that neighbours may be compared with.
    has_holes: [bool; 2],
}

impl Block {
    /// What blocks of a source are filled into.
    pub fn of(source: &dyn Fill) -> Block {
        Block {
            is_apart: source.has_surface_field(),
            is_dimmed: source.has_opacity(),
            has_holes: source.has_holes(),
            ..Block::default()
        }
    }

    /// Fills the block of a brick. False, and nothing is filled, where no density in reach is above `least`.
    pub fn fill(&mut self, slab: &Slab, brick_grid: &BrickGrid, [column, row, layer]: [usize; 3], least: f32) -> bool {
        // Bricks around, the layer in front included; what is not in the slab reads as empty.
        let near = |index: usize, offset: usize| (index + offset).wrapping_sub(1);
        let bricks: [[[Option<&Brick>; 3]; 3]; 2] = [0, 1].map(|dz| {
            [0, 1, 2]
                .map(|dy| [0, 1, 2].map(|dx| slab.brick(near(column, dx), near(row, dy), near(layer, dz), brick_grid)))
        });
        let (mut densest, mut attribute) = (0.0f32, false);
        for brick in bricks.as_flattened().as_flattened().iter().flatten() {
            densest = densest.max(brick.densest);
            attribute |= !brick.weighted.is_empty();
        }
        if densest <= least || densest <= 0.0 {
            return false;
        }
        self.density.resize(SIDE * SIDE * SIDE, 0.0);
        self.weighted.resize(if attribute { SIDE * SIDE * SIDE } else { 0 }, 0.0);
        self.surface.resize(if self.is_apart { SIDE * SIDE * SIDE } else { 0 }, 0.0);
        self.opacity.resize(if self.is_dimmed { SIDE * SIDE * SIDE } else { 0 }, 0.0);
        for z in 0..SIDE {
            // Slices beyond the grid's ends repeat the last one, so that the ends have no surfaces.
            let slice = (layer * BRICK + z).saturating_sub(FRONT).min(brick_grid.slices - 1);
            let dz = (slice / BRICK + 1).saturating_sub(layer);
            for y in 0..SIDE {
                let (dy, in_y) = split(y);
                let (start, out) = ((slice % BRICK * BRICK + in_y) * BRICK, (z * SIDE + y) * SIDE);
                let bricks = &bricks[dz][dy];
                copy_row(&mut self.density[out..out + SIDE], bricks, |brick| brick.density.get(start..));
                if attribute {
                    copy_row(&mut self.weighted[out..out + SIDE], bricks, |brick| brick.weighted.get(start..));
                }
                if self.is_apart {
                    copy_row(&mut self.surface[out..out + SIDE], bricks, |brick| brick.surface.get(start..));
                }
                if self.is_dimmed {
                    copy_row(&mut self.opacity[out..out + SIDE], bricks, |brick| brick.opacity.get(start..));
                }
            }
        }
        true
    }

    /// Density and `sum m A W` at a place of a slice: bilinear between four cells.
    #[inline(always)]
    pub fn sample(&self, at: &Place, z: usize) -> [f32; 2] {
        let weighted = if self.weighted.is_empty() { 0.0 } else { read(&self.weighted, at, z) };
        [read(&self.density, at, z), weighted]
    }

    /// What the volume's extinction is multiplied by there.
    #[inline]
    pub fn opacity(&self, at: &Place, z: usize) -> f32 {
        if self.opacity.is_empty() { 1.0 } else { read(&self.opacity, at, z) }
    }

    /// One of the numbers there.
    #[inline]
    pub fn number(&self, of: Numbers, at: &Place, z: usize) -> f32 {
        read(self.cells(of), at, z)
    }

    /// The same; `None` where there is nothing.
    #[inline]
    pub fn known(&self, of: Numbers, at: &Place, z: usize) -> Option<f32> {
        (!self.has_holes[of as usize] || self.least(of, at, z) > 0.0).then(|| self.number(of, at, z))
    }

    /// The least of the numbers of the cells that a sample is made of.
    pub fn least(&self, of: Numbers, at: &Place, z: usize) -> f32 {
        let (cells, start) = (self.cells(of), (z * SIDE + at.y) * SIDE + at.x);
        match at.shares {
            [0.0, 0.0] => cells[start],
            _ => [0, 1, SIDE, SIDE + 1].map(|offset| cells[start + offset]).into_iter().fold(f32::MAX, f32::min),
        }
    }

    fn cells(&self, of: Numbers) -> &[f32] {
        if of == Numbers::Surfaces && self.is_apart { &self.surface } else { &self.density }
    }
}

/// A number at a place of a slice.
#[inline(always)]
fn read(cells: &[f32], at: &Place, z: usize) -> f32 {
    let start = (z * SIDE + at.y) * SIDE + at.x;
    match at.shares {
        [0.0, 0.0] => cells[start],
        [u, v] => {
            let [a, b, c, d] = [0, 1, SIDE, SIDE + 1].map(|offset| cells[start + offset]);
            (a + u * (b - a)) * (1.0 - v) + (c + u * (d - c)) * v
        }
    }
}

/// Fills a row of a block with what begins the rows of three bricks, the middle one of which is its own.
#[inline(always)]
fn copy_row(out: &mut [f32], bricks: &[Option<&Brick>; 3], cells: impl Fn(&Brick) -> Option<&[f32]>) {
    let [before, own, behind] =
        bricks.map(|brick| brick.and_then(&cells).and_then(|cells| cells.first_chunk()).unwrap_or(&[0.0; BRICK]));
    out[..BEFORE].copy_from_slice(&before[BRICK - BEFORE..]);
    out[BEFORE..BEFORE + BRICK].copy_from_slice(own);
    out[BEFORE + BRICK..].copy_from_slice(&behind[..SIDE - BRICK - BEFORE]);
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
