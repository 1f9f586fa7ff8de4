//! The resampled field of a slab: bricks of `16^3` cells, those alone that hold something.
//!
//! Stored cells reach [`BORDER`] cells beyond the picture on every side, for gradients and interpolation at its edge:
//! stored column `c` is column `c - BORDER` of the grid.

use super::stretched::Body;
use crate::view::PerspectiveGrid;
use std::sync::{Mutex, PoisonError};

/// Cells along a brick's side, and slices of a layer of bricks.
pub const BRICK: usize = 16;
/// Cells of a brick.
pub const CELLS: usize = BRICK * BRICK * BRICK;
/// Cells stored beyond the picture's edge.
pub const BORDER: usize = 2;

/// One brick; cell `(x, y, z)` is at `(16 z + y) 16 + x`.
#[derive(Clone, Debug)]
pub struct Brick {
    /// `rho = sum m W`, mass per volume.
    pub density: Box<[f32]>,
    /// `sum m A W`; empty without attribute.
    pub weighted: Box<[f32]>,
    /// Values of another field, whose surfaces are drawn; empty where that is 0, or surfaces are the densities'.
    pub surface: Box<[f32]>,
    /// What the volume's extinction is multiplied by; empty where that is 1 everywhere, or 0 in this brick.
    pub opacity: Box<[f32]>,
    /// The largest density; on coarser levels by amount, since cubics overshoot.
    pub densest: f32,
}

/// Bricks at the same depth, row by row; `None` where nothing is.
pub type Layer = Vec<Option<Brick>>;

/// The cells of bricks that were done with. New memory costs more than clearing old: the system hands it out page by page.
#[derive(Default)]
pub struct SpareCells(Mutex<Vec<Box<[f32]>>>);

impl SpareCells {
    /// Cells of 0.
    pub fn take(&self) -> Box<[f32]> {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        match spare {
            Some(mut cells) => {
                cells.fill(0.0);
                cells
            }
            None => vec![0.0; CELLS].into_boxed_slice(),
        }
    }

    /// Keeps those of layers that are not needed any more.
    pub fn keep(&mut self, layers: impl IntoIterator<Item = Layer>) {
        let spare = self.0.get_mut().unwrap_or_else(PoisonError::into_inner);
        for brick in layers.into_iter().flatten().flatten() {
            spare.extend([brick.density, brick.weighted].into_iter().filter(|cells| !cells.is_empty()));
        }
    }
}

/// The bricks of several layers, one after the other, as layers of so many.
pub fn layers(mut bricks: Vec<Option<Brick>>, of_layer: usize) -> Vec<Layer> {
    let mut layers = Vec::with_capacity(bricks.len().div_ceil(of_layer.max(1)));
    while !bricks.is_empty() {
        let rest = bricks.split_off(of_layer.min(bricks.len()));
        layers.push(std::mem::replace(&mut bricks, rest));
    }
    layers
}

/// How a grid is cut into bricks.
#[derive(Clone, Debug)]
pub struct BrickGrid {
    /// Bricks in a row, in a column, and layers.
    pub bricks: [usize; 3],
    /// Grid coordinates of the middle line of sight, in stored cells.
    pub middle: [f32; 2],
    /// Depth of each slice's centre, to the end of the last layer.
    pub depth: Vec<f32>,
    /// One over the width of a cell at that depth.
    pub per_cell: Vec<f32>,
    /// Width of a cell at that depth.
    pub spacing: Vec<f32>,
    /// Distance from a slice's front to its back, on the middle ray.
    pub thickness: Vec<f32>,
    /// Slices of the grid.
    pub slices: usize,
    /// Whether lines of sight diverge.
    pub perspective: bool,
}

impl BrickGrid {
    /// The bricks of a grid.
    pub fn new(grid: &PerspectiveGrid) -> BrickGrid {
        let [k, l, m] = grid.size.map(|size| size as usize);
        let bricks = [(k + 2 * BORDER).div_ceil(BRICK), (l + 2 * BORDER).div_ceil(BRICK), m.div_ceil(BRICK)];
        let middle = grid.middle.map(|middle| (middle + BORDER as f64) as f32);
        BrickGrid { slices: m, ..BrickGrid::with(grid, bricks, middle, 1.0, |slice| slice) }
    }

    /// Bricks of cells that are `scale` times as wide as the grid's; `place` gives the grid's `z'` of theirs.
    pub fn with(
        grid: &PerspectiveGrid,
        bricks: [usize; 3],
        middle: [f32; 2],
        scale: f64,
        place: impl Fn(f64) -> f64,
    ) -> BrickGrid {
        let slices = bricks[2] * BRICK;
        let edge = |slice: usize| grid.depth(place(slice as f64));
        let depths: Vec<f64> = (0..slices).map(|slice| grid.depth(place(slice as f64 + 0.5))).collect();
        BrickGrid {
            bricks,
            middle,
            per_cell: depths.iter().map(|&depth| (1.0 / (scale * grid.spacing(depth))) as f32).collect(),
            spacing: depths.iter().map(|&depth| (scale * grid.spacing(depth)) as f32).collect(),
            thickness: (0..slices).map(|slice| (edge(slice + 1) - edge(slice)) as f32).collect(),
            depth: depths.iter().map(|&depth| depth as f32).collect(),
            slices,
            perspective: grid.perspective,
        }
    }

    /// Number of bricks in a layer.
    pub fn of_layer(&self) -> usize {
        self.bricks[0] * self.bricks[1]
    }

    /// The bricks of a layer that a particle's support may reach: first and last column and row. `None` for none.
    pub fn reached(&self, body: &Body<'_>, layer: usize) -> Option<[[usize; 2]; 2]> {
        let [x, y, z, h] = body.particle.place;
        let slices = layer * BRICK..(layer + 1) * BRICK;
        let (first, last) = (self.depth[slices.start], self.depth[slices.end - 1]);
        // From where to where it reaches across, and downwards.
        let spans = match body.shape {
            None => {
                let away = (first - z).max(z - last).max(0.0);
                let square = h * h - away * away;
                if square <= 0.0 {
                    return None;
                }
                let radius = square.sqrt();
                [[x - radius, x + radius], [-y - radius, -y + radius]]
            }
            Some(shape) => {
                let [across, up] = shape.between([first - z, last - z])?;
                [[x + across[0], x + across[1]], [-y - up[1], -y - up[0]]]
            }
        };
        // One over the cell's width at both ends of the particle within the layer, the wider end of which counts.
        let ends = match self.perspective {
            true => {
                let per_depth = self.per_cell[slices.start] * first;
                let [near, far] = body.depths();
                [per_depth / first.max(near), per_depth / last.min(far)]
            }
            false => [self.per_cell[slices.start]; 2],
        };
        let span = |[low, high]: [f32; 2], middle: f32, bricks: usize| {
            let low = middle + (low * ends[0]).min(low * ends[1]) - 0.51;
            let high = middle + (high * ends[0]).max(high * ends[1]) - 0.49;
            // Casts saturate, and round towards zero.
            let first = low as usize;
            let [from, to] = [(first + usize::from((first as f32) < low)) / BRICK, high as usize / BRICK];
            (high >= 0.0 && from < bricks && from <= to).then_some([from, to.min(bricks - 1)])
        };
        Some([span(spans[0], self.middle[0], self.bricks[0])?, span(spans[1], self.middle[1], self.bricks[1])?])
    }
}

/// Consecutive layers of a grid.
#[derive(Clone, Debug, Default)]
pub struct Slab {
    /// Number of the first layer.
    pub first: usize,
    /// The layers.
    pub layers: Vec<Layer>,
}

impl Slab {
    /// The brick in a column and row of bricks and a layer; `None` where nothing is or what is not in this slab.
    pub fn brick(&self, column: usize, row: usize, layer: usize, brick_grid: &BrickGrid) -> Option<&Brick> {
        let layer = self.layers.get(layer.checked_sub(self.first)?)?;
        if column >= brick_grid.bricks[0] || row >= brick_grid.bricks[1] {
            return None;
        }
        layer[row * brick_grid.bricks[0] + column].as_ref()
    }

    /// Density and `sum m A W` of a cell of the grid; 0 where nothing is.
    pub fn at(&self, [i, j, k]: [usize; 3], brick_grid: &BrickGrid) -> [f32; 2] {
        let [x, y] = [i + BORDER, j + BORDER];
        self.brick(x / BRICK, y / BRICK, k / BRICK, brick_grid).map_or([0.0; 2], |brick| {
            let cell = (k % BRICK * BRICK + y % BRICK) * BRICK + x % BRICK;
            [brick.density[cell], brick.weighted.get(cell).copied().unwrap_or(0.0)]
        })
    }

    /// Memory of the cells that are held.
    pub fn bytes(&self) -> u64 {
        let cells =
            |brick: &Brick| brick.density.len() + brick.weighted.len() + brick.surface.len() + brick.opacity.len();
        4 * self.layers.iter().flatten().flatten().map(|brick| cells(brick) as u64).sum::<u64>()
    }

    /// Only the last layer, for the next slab; the others go to `done`.
    pub fn split_last(mut self, done: impl FnOnce(Vec<Layer>)) -> Slab {
        let first = self.first + self.layers.len().saturating_sub(1);
        let last = self.layers.pop();
        done(self.layers);
        Slab { first, layers: last.into_iter().collect() }
    }
}
