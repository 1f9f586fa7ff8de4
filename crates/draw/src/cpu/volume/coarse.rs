//! Wide particles: their sum is smooth, so it is sampled on coarser grids and interpolated.
//!
//! A cell's cost is the particles over it, and a particle's the cells under it, so that wide particles would cost most though they
//! show least. Cells of level `l` are `2^l` times as wide and as deep as the grid's. A particle goes to the coarsest level where its
//! smoothing length is still [`WIDE`] cells wherever it reaches; each level is the sum of its own particles and of the next
//! coarser level's field, interpolated by cubics through four cells along each axis. With 8 cells to a smoothing length that
//! errs by 2.5e-3 of a lone cubic spline (L2) and falls with the fourth power; what particles have in common over a cell is
//! smoother still. Kernels that are narrower for their support err by more: the quartic spline and Wendland's C2 by 3.6e-3, the quintic
//! spline and C4 by 5.5e-3, C6 by 8.4e-3.
//!
//! Coordinate `x` of a level, in its stored cells, is `x / 2 + BORDER` in the next, along all axes, so that every cell has
//! the four around it.

use super::bricks::{BORDER, BRICK, Brick, BrickGrid, Slab};
use super::stretched::Body;
use crate::view::PerspectiveGrid;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Least smoothing length on a coarser level, in its cells.
pub const WIDE: f32 = 8.0;
/// More levels than this gain nothing: a kernel of `8 * 2^6` cells fills a picture.
pub const MOST_LEVELS: usize = 7;
/// Cells of the next level that a brick's interpolation reads along an axis.
const REACH: usize = BRICK / 2 + 4;
/// Cubics through four cells, a quarter of a cell behind the second; in reverse, a quarter before the third.
pub const WEIGHTS: [f32; 4] = [-0.0546875, 0.8203125, 0.2734375, -0.0390625];

/// How much larger than the cells that it reads an interpolated value may be: the cube of what the weights' amounts add up to.
pub const OVERSHOOT: f32 = {
    let [a, b, c, d] = WEIGHTS;
    let sum = b + c - a - d;
    sum * sum * sum
};

/// The smoothing length of a particle in cells of the grid, where it reaches farthest and cells are widest; of an ellipsoid its shortest
/// semi-axis.
pub fn cells_of(body: &Body<'_>, grid: &PerspectiveGrid) -> f32 {
    let [_, far] = body.depths();
    let cell = grid.sigma as f32 * if grid.perspective { far } else { 1.0 };
    body.shortest() / cell
}

/// The level that a particle is resampled on.
pub fn level_of(body: &Body<'_>, grid: &PerspectiveGrid, levels: usize) -> usize {
    levels_of(cells_of(body, grid), levels) - 1
}

/// How many levels particles of up to so many cells take, of `most`: one at least.
pub fn levels_of(cells: f32, most: usize) -> usize {
    1 + (1..most).take_while(|level| cells >= WIDE * (1 << level) as f32).count()
}

/// The bricks of each level, finest first, where the largest smoothing length is `widest` cells of the grid.
pub fn brick_grids(grid: &PerspectiveGrid, widest: f32) -> Vec<BrickGrid> {
    let mut levels = vec![BrickGrid::new(grid)];
    // The grid's `z'` of the level's `z` is `scale z - shift`.
    let (mut scale, mut shift) = (1.0, 0.0);
    while levels.len() < MOST_LEVELS && widest >= WIDE * (1 << levels.len()) as f32 {
        let Some(finer) = levels.last() else { break };
        shift += scale * 2.0 * BORDER as f64;
        scale *= 2.0;
        let bricks = finer.bricks.map(|bricks| read_by(bricks - 1).end);
        let middle = finer.middle.map(|middle| 0.5 * middle + BORDER as f32);
        levels.push(BrickGrid::with(grid, bricks, middle, scale, |slice| scale * slice - shift));
    }
    levels
}

/// The bricks of the next level that one of this level reads along an axis.
fn read_by(brick: usize) -> Range<usize> {
    let first = brick * BRICK / 2;
    first / BRICK..(first + REACH - 1) / BRICK + 1
}

/// The bricks of the next level that a brick of this level reads.
pub fn around(brick: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let [columns, rows, layers] = brick.map(read_by);
    layers.flat_map(move |layer| {
        let columns = columns.clone();
        rows.clone().flat_map(move |row| columns.clone().map(move |column| [column, row, layer]))
    })
}

/// The layers of the next level that some of this level read.
pub fn layers_read_by(layers: &Range<usize>) -> Range<usize> {
    read_by(layers.start).start..read_by(layers.end.max(1) - 1).end
}

/// The columns of bricks of the next level that only hidden ones of this level read.
pub fn hidden_by(hidden: &[bool], finer: &BrickGrid, coarser: &BrickGrid) -> Vec<bool> {
    if hidden.is_empty() {
        return Vec::new();
    }
    let mut out = vec![true; coarser.of_layer()];
    for (place, _) in hidden.iter().enumerate().filter(|(_, hidden)| !**hidden) {
        let [columns, rows] = [place % finer.bricks[0], place / finer.bricks[0]].map(read_by);
        for row in rows {
            for column in columns.clone() {
                out[row * coarser.bricks[0] + column] = false;
            }
        }
    }
    out
}

/// Cells along the side of a part of a brick. What is read of a brick are whole parts.
const PART: usize = 4;
/// Parts along a brick's side.
const PARTS: usize = BRICK / PART;

/// The largest amounts in parts of a level's bricks: what interpolation from them is bounded by.
pub struct Peaks<'a> {
    brick_grid: &'a BrickGrid,
    first: usize,
    least: f32,
    /// For each brick, layer by layer; `None` where interpolation from it alone is below `least`.
    peaks: Vec<Option<[f32; PARTS * PARTS * PARTS]>>,
}

impl<'a> Peaks<'a> {
    /// The peaks of layers of a level, where densities up to `least` show nothing.
    pub fn new(brick_grid: &'a BrickGrid, slab: &Slab, least: f32) -> Peaks<'a> {
        let of_brick = |brick: &Brick| {
            let mut peaks = [0.0f32; PARTS * PARTS * PARTS];
            for (row, cells) in brick.density.chunks_exact(BRICK).enumerate() {
                let (y, z) = (row % BRICK / PART, row / BRICK / PART);
                for (x, cells) in cells.chunks_exact(PART).enumerate() {
                    let peak = &mut peaks[(z * PARTS + y) * PARTS + x];
                    *peak = cells.iter().fold(*peak, |peak, cell| peak.max(cell.abs()));
                }
            }
            peaks
        };
        let shown =
            |brick: &Option<Brick>| brick.as_ref().filter(|brick| OVERSHOOT * brick.densest > least).map(of_brick);
        let peaks = slab.layers.par_iter().flat_map_iter(|layer| layer.iter().map(shown)).collect();
        Peaks { brick_grid, first: slab.first, least, peaks }
    }

    /// Whether what a brick of the next finer level reads may be more than shows nothing.
    pub fn show(&self, brick: [usize; 3]) -> bool {
        let [columns, rows, _] = self.brick_grid.bricks;
        let parts = |axis: usize| (0..REACH / PART).map(move |part| brick[axis] * (PARTS / 2) + part);
        parts(2).any(|z| {
            parts(1).any(|y| {
                parts(0).any(|x| {
                    let place = ((z / PARTS - self.first) * rows + y / PARTS) * columns + x / PARTS;
                    let part = ((z % PARTS) * PARTS + y % PARTS) * PARTS + x % PARTS;
                    self.peaks[place].as_ref().is_some_and(|peaks| OVERSHOOT * peaks[part] > self.least)
                })
            })
        })
    }
}

/// Adds the interpolated field of the next coarser level to a brick, in the lanes that it is dispatched for.
pub struct Interpolate<'a, F> {
    /// The brick.
    pub brick: [usize; 3],
    /// The cells of a brick of the next level, by column, row and layer; `None` where nothing is.
    pub cells_of: F,
    /// Memory that is used again.
    pub scratch: &'a mut Scratch,
    /// The brick's cells.
    pub out: &'a mut [f32],
}

impl<'c, F: Fn([usize; 3]) -> Option<&'c [f32]>> WithSimd for Interpolate<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Interpolate { brick, cells_of, scratch, out } = self;
        add_interpolated(brick, cells_of, scratch, out);
    }
}

#[inline(always)]
fn add_interpolated<'a>(
    brick: [usize; 3],
    cells_of: impl Fn([usize; 3]) -> Option<&'a [f32]>,
    scratch: &mut Scratch,
    out: &mut [f32],
) {
    let Scratch { around: around_it, along_x, along_y } = scratch;
    around_it.clear();
    around_it.resize(REACH * REACH * REACH, 0.0);
    let first = brick.map(|brick| brick * BRICK / 2);
    // Where a brick's cells lie in what is read, and which of its cells those are.
    let part = |axis: usize, brick: usize| {
        let from = (brick * BRICK).max(first[axis]);
        let to = ((brick + 1) * BRICK).min(first[axis] + REACH);
        (from - first[axis], from - brick * BRICK, to - from)
    };
    for brick in around(brick) {
        let Some(cells) = cells_of(brick) else { continue };
        let [x, y, z] = [0, 1, 2].map(|axis| part(axis, brick[axis]));
        for k in 0..z.2 {
            for j in 0..y.2 {
                let from = ((z.1 + k) * BRICK + y.1 + j) * BRICK + x.1;
                let to = ((z.0 + k) * REACH + y.0 + j) * REACH + x.0;
                for (to, from) in
                    around_it[to..to + x.2].chunks_exact_mut(PART).zip(cells[from..from + x.2].chunks_exact(PART))
                {
                    to.copy_from_slice(from);
                }
            }
        }
    }
    along_x.resize(REACH * REACH * BRICK, 0.0);
    for (row, out) in around_it.as_chunks::<REACH>().0.iter().zip(along_x.as_chunks_mut::<BRICK>().0) {
        let mut halves = [[0.0; BRICK / 2]; 2];
        for (odd, half) in halves.iter_mut().enumerate() {
            let [wa, wb, wc, wd] = [weight(odd, 0), weight(odd, 1), weight(odd, 2), weight(odd, 3)];
            for (cell, out) in half.iter_mut().enumerate() {
                let at = cell + odd;
                *out = wa * row[at] + wb * row[at + 1] + wc * row[at + 2] + wd * row[at + 3];
            }
        }
        for (cell, out) in out.iter_mut().enumerate() {
            *out = halves[cell % 2][cell / 2];
        }
    }
    // Rows of a slice, then slices: both are sums of whole rows.
    along_y.resize(REACH * BRICK * BRICK, 0.0);
    for (slice, out) in along_x.chunks_exact(REACH * BRICK).zip(along_y.chunks_exact_mut(BRICK * BRICK)) {
        double(slice, BRICK, out, |out, sum| *out = sum);
    }
    double(along_y, BRICK * BRICK, out, |out, sum| *out += sum);
}

/// Twice as many rows of `len` cells, each from four.
#[inline(always)]
fn double(rows: &[f32], len: usize, out: &mut [f32], set: impl Fn(&mut f32, f32)) {
    for (index, out) in out.chunks_exact_mut(len).enumerate() {
        let (half, odd) = (index / 2, index % 2);
        let start = (half + odd) * len;
        let row = |tap: usize| &rows[start + tap * len..start + (tap + 1) * len];
        let [a, b, c, d] = [row(0), row(1), row(2), row(3)];
        let [wa, wb, wc, wd] = [0, 1, 2, 3].map(|tap| weight(odd, tap));
        for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            set(out, wa * a + wb * b + wc * c + wd * d);
        }
    }
}

/// The weight of a tap: even cells lie a quarter of a coarse cell before the third, odd ones a quarter behind the second.
const fn weight(odd: usize, tap: usize) -> f32 {
    if odd == 1 { WEIGHTS[tap] } else { WEIGHTS[3 - tap] }
}

/// Memory for interpolation, used again and again.
#[derive(Debug, Default)]
pub struct Scratch {
    around: Vec<f32>,
    along_x: Vec<f32>,
    along_y: Vec<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::volume::bricks::CELLS;

    #[test]
    fn cubics_are_interpolated_exactly_across_bricks() {
        let field = |[x, y, z]: [f64; 3]| {
            let [x, y, z] = [x - 20.0, y - 9.0, z - 31.0].map(|x| 0.1 * x);
            1.0 + x - y * z + x * x * y + z * z * z - 0.5 * x * y * z + y * y * y * x * x * x
        };
        let centers = |brick: [usize; 3]| {
            let at = move |cell: usize, axis: usize| (brick[axis] * BRICK + cell) as f64 + 0.5;
            (0..CELLS).map(move |c| [at(c % BRICK, 0), at(c / BRICK % BRICK, 1), at(c / BRICK / BRICK, 2)])
        };
        let coarse: Vec<Vec<f32>> =
            (0..27).map(|i| centers([i % 3, i / 3 % 3, i / 9]).map(|center| field(center) as f32).collect()).collect();
        let mut scratch = Scratch::default();
        for brick in [[0, 0, 0], [3, 0, 2], [1, 3, 3], [2, 1, 1]] {
            let mut out = vec![1.0; CELLS];
            let cells = |[x, y, z]: [usize; 3]| Some(&coarse[(z * 3 + y) * 3 + x][..]);
            add_interpolated(brick, cells, &mut scratch, &mut out);
            for (found, center) in out.iter().zip(centers(brick)) {
                let expected = 1.0 + field(center.map(|x| 0.5 * x + BORDER as f64));
                assert!((f64::from(*found) - expected).abs() < 1e-4, "{brick:?} {center:?}: {found} {expected}");
            }
        }
        // What is read of two bricks alone is the same, and nothing else is read.
        assert_eq!(around([1, 1, 0]).collect::<Vec<_>>(), around([1, 1, 0]).filter(|b| b[2] == 0).collect::<Vec<_>>());
        assert_eq!(around([0; 3]).count(), 1);
        assert_eq!(around([1; 3]).count(), 8);
    }

    #[test]
    fn what_hidden_columns_read_alone_is_hidden() {
        let grid = crate::view::PerspectiveGrid {
            size: [80, 48, 64],
            near: 1.0,
            far: 2.0,
            sigma: 0.01,
            cell: 1.0,
            middle: [40.0, 24.0],
            perspective: true,
        };
        let levels = brick_grids(&grid, 100.0);
        assert_eq!(levels.len(), 4);
        let [finer, coarser] = [&levels[0], &levels[1]];
        assert!(hidden_by(&[], finer, coarser).is_empty());
        for seen in 0..finer.of_layer() {
            let hidden: Vec<bool> = (0..finer.of_layer()).map(|place| place != seen).collect();
            let found = hidden_by(&hidden, finer, coarser);
            let [column, row] = [seen % finer.bricks[0], seen / finer.bricks[0]];
            for (place, hidden) in found.iter().enumerate() {
                let at = [place % coarser.bricks[0], place / coarser.bricks[0], 0];
                assert_eq!(*hidden, !around([column, row, 0]).any(|read| read == at));
            }
        }
        // Depths of a coarser level are those of the finer, every other one of whose edges it has.
        for (finer, coarser) in levels.iter().zip(&levels[1..]) {
            for slice in 2..8 {
                let (near, far) = (finer.depth[2 * slice - 4], finer.depth[2 * slice - 3]);
                let middle = (near * far).sqrt();
                assert!((coarser.depth[slice] / middle - 1.0).abs() < 1e-5, "{near} {middle} {far}");
                assert!((coarser.spacing[slice] / middle / (finer.spacing[0] / finer.depth[0]) - 2.0).abs() < 1e-4);
            }
        }
    }
}
