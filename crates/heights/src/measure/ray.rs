//! The first place where a ray meets T, exactly: from block to block of a pyramid of least and largest heights, then from cell to cell.
//!
//! Along the ray, the ray's height above T changes its sign where they meet. Both are linear within a triangle, so that its two ends tell
//! whether the ray passes, and where. Every parameter at which the ray crosses a line of the grid comes out of the same operations whichever
//! block or cell asks for it; therefore parts of the ray follow one another without gaps, and it cannot slip between two triangles.

use super::tiles::{height_in, samples_of};
use crate::model::{Cell, HeightGrid, Lengths, Triangle, units};
use rayon::prelude::*;

/// A field with least and largest heights of its blocks: of level k, block (r, c) holds the cells of rows `r 2^k` to `(r + 1) 2^k`, and the
/// same of columns, as far as there are such.
///
/// It is read by one ray after the other: a reader of pages keeps what it read last.
pub trait MinMax {
    /// Why it cannot be read.
    type Error: Send;

    /// Where the samples are.
    fn grid(&self) -> &HeightGrid;

    /// The level whose only block holds all cells: the least k with `2^k >= max(columns, rows) - 1`, or one above.
    fn top(&self) -> u32;

    /// The finest level of which ranges are known; at most [`MinMax::top`].
    fn finest(&self) -> u32;

    /// The least and the largest height of the samples at the corners of a block's cells, or something wider; `None` where no cell has a
    /// triangle. Asked for levels from [`MinMax::finest`] to [`MinMax::top`] and for blocks in the field.
    ///
    /// # Errors
    /// Where it cannot be read.
    fn range(&mut self, level: u32, row: u64, column: u64) -> Result<Option<[f64; 2]>, Self::Error>;

    /// The cell of a first sample.
    ///
    /// # Errors
    /// Where it cannot be read.
    fn cell(&mut self, row: u64, column: u64) -> Result<Cell, Self::Error>;
}

/// How high heights stand in the world, whose third coordinate is in the unit of x and y: `zero + lift * height`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rise {
    /// Where the height 0 is.
    pub zero: f64,
    /// What a height of 1 adds.
    pub lift: f64,
}

impl Rise {
    /// Of a grid's units, exaggerated about a height.
    pub fn new(grid: &HeightGrid, exaggeration: f64, base: f64) -> Rise {
        let ratio = height_ratio(grid);
        Rise { zero: ratio * base * (1.0 - exaggeration), lift: ratio * exaggeration }
    }

    /// Where a height is in the world.
    pub fn world(self, height: f64) -> f64 {
        self.zero + self.lift * height
    }

    fn cell(self, cell: &Cell) -> [f64; 4] {
        cell.0.map(|height| self.world(height))
    }
}

/// Length of the unit of heights in the unit of x and y; 1 unless both are known lengths.
pub fn height_ratio(grid: &HeightGrid) -> f64 {
    if units::is_degrees(&grid.xy_unit) { 1.0 } else { Lengths::of(grid).lift }
}

/// A ray in the world, or a part of one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where its parameter is 0.
    pub origin: [f64; 3],
    /// What a parameter of 1 adds; of any length.
    pub direction: [f64; 3],
    /// From which parameter to which it is looked at; at least 0.
    pub part: [f64; 2],
}

impl Ray {
    /// The whole of a ray from its origin on.
    pub fn new(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin, direction, part: [0.0, f64::INFINITY] }
    }

    /// The place of a parameter.
    pub fn at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|axis| self.origin[axis] + t * self.direction[axis])
    }
}

/// Where a ray meets T.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray's parameter.
    pub t: f64,
    /// Row, with fraction.
    pub row: f64,
    /// Column, with fraction.
    pub column: f64,
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// T's true height there, in the unit of heights.
    pub height: f64,
    /// The triangle's samples: row, column and height of each, in order of rows and columns.
    pub samples: [(u64, u64, f64); 3],
}

/// A ray in the grid: columns, rows, world height.
struct Path {
    origin: [f64; 3],
    direction: [f64; 3],
    inverse: [f64; 2],
}

/// Directions along rows or columns below this part of the largest are none: their parameters would leave the range of numbers.
const STRAIGHT: f64 = 1e-200;

impl Path {
    /// `None` where the ray has no direction, or is no ray.
    fn new(grid: &HeightGrid, ray: &Ray) -> Option<Path> {
        let ([x0, y0], [sx, sy]) = (grid.origin, grid.step);
        let origin = [(ray.origin[0] - x0) / sx, (ray.origin[1] - y0) / sy, ray.origin[2]];
        let mut direction = [ray.direction[0] / sx, ray.direction[1] / sy, ray.direction[2]];
        let largest = direction.iter().fold(0.0_f64, |largest, part| largest.max(part.abs()));
        let is_ray = origin.iter().chain(&direction).all(|part| part.is_finite()) && largest > 0.0;
        for part in &mut direction[..2] {
            if part.abs() <= STRAIGHT * largest.max(1.0) {
                *part = 0.0;
            }
        }
        is_ray.then_some(Path { origin, direction, inverse: [1.0 / direction[0], 1.0 / direction[1]] })
    }

    /// The parameter at a line of the grid. It grows or falls with the line's number, rounded as it is.
    fn at_line(&self, axis: usize, line: i64) -> f64 {
        (line as f64 - self.origin[axis]) * self.inverse[axis]
    }

    /// Where the ray enters and leaves the space between two lines of the grid.
    fn between(&self, axis: usize, low: i64, high: i64) -> [f64; 2] {
        if self.direction[axis] > 0.0 {
            [self.at_line(axis, low), self.at_line(axis, high)]
        } else if self.direction[axis] < 0.0 {
            [self.at_line(axis, high), self.at_line(axis, low)]
        } else if (low as f64..=high as f64).contains(&self.origin[axis]) {
            [f64::NEG_INFINITY, f64::INFINITY]
        } else {
            [f64::INFINITY, f64::NEG_INFINITY]
        }
    }

    /// World height at a parameter, which may be infinite.
    fn height(&self, t: f64) -> f64 {
        if self.direction[2] == 0.0 { self.origin[2] } else { self.origin[2] + t * self.direction[2] }
    }

    /// The cell, of those from `low` to `high`, in which the ray goes on at a parameter.
    fn locate(&self, axis: usize, t: f64, low: i64, high: i64) -> i64 {
        let way = self.direction[axis];
        let place = if way == 0.0 { self.origin[axis] } else { self.origin[axis] + t * way };
        // The conversion saturates, and takes what is no number for 0.
        let mut cell = (place.floor() as i64).clamp(low, high);
        // The lines' own parameters decide: a product is rounded otherwise.
        if way > 0.0 {
            while cell < high && self.at_line(axis, cell + 1) <= t {
                cell += 1;
            }
            while cell > low && self.at_line(axis, cell) > t {
                cell -= 1;
            }
        } else if way < 0.0 {
            while cell > low && self.at_line(axis, cell) <= t {
                cell -= 1;
            }
            while cell < high && self.at_line(axis, cell + 1) > t {
                cell += 1;
            }
        }
        cell
    }
}

/// The end of the part of a ray that was looked at last: its parameter, and how far above T it is there. Where the next part begins at the
/// same parameter on the other side, only rounding lies between.
type Last = Option<(f64, f64)>;

/// The first place where a ray meets T, from either side; `None` where it does not.
///
/// # Errors
/// Where the field cannot be read.
pub fn cast<M: MinMax>(field: &mut M, rise: Rise, ray: &Ray) -> Result<Option<Hit>, M::Error> {
    let grid = field.grid();
    let cells = [grid.columns as i64 - 1, grid.rows as i64 - 1];
    let Some(path) = Path::new(grid, ray) else { return Ok(None) };
    let (top, finest) = (field.top(), field.finest());
    let (across, along) = (path.between(0, 0, cells[0]), path.between(1, 0, cells[1]));
    let mut t = ray.part[0].max(0.0).max(across[0]).max(along[0]);
    let end = ray.part[1].min(across[1]).min(along[1]);
    // What is no number is on neither side.
    if !(t <= end && t < f64::INFINITY) {
        return Ok(None);
    }
    let mut at = [path.locate(0, t, 0, cells[0] - 1), path.locate(1, t, 0, cells[1] - 1)];
    let (mut level, mut last) = (top, None);
    loop {
        // The block's cells along both axes, and where the ray leaves it.
        let block = at.map(|cell| cell >> level);
        let low = block.map(|number| number << level);
        let high: [i64; 2] = std::array::from_fn(|axis| ((block[axis] + 1) << level).min(cells[axis]));
        let leaves: [f64; 2] = std::array::from_fn(|axis| match path.direction[axis] {
            way if way > 0.0 => path.at_line(axis, high[axis]),
            way if way < 0.0 => path.at_line(axis, low[axis]),
            _ => f64::INFINITY,
        });
        let out = leaves[0].min(leaves[1]);
        let stop = out.min(end);
        if level == 0 {
            let cell = field.cell(at[1] as u64, at[0] as u64)?;
            if let Some(hit) = meet(&path, rise, &cell, at, [t, stop], &mut last) {
                return Ok(Some(hit.placed(field.grid(), &cell, at)));
            }
        } else {
            let range = field.range(level, block[1] as u64, block[0] as u64)?;
            if range.is_some_and(|range| reaches(&path, rise, range, [t, stop])) {
                level = if level > finest { level - 1 } else { 0 };
                continue;
            }
        }
        if out >= end {
            return Ok(None);
        }
        t = out;
        for axis in 0..2 {
            if leaves[axis] <= t {
                at[axis] = if path.direction[axis] > 0.0 { high[axis] } else { low[axis] - 1 };
                if at[axis] < 0 || at[axis] >= cells[axis] {
                    return Ok(None);
                }
            } else if level > 0 {
                at[axis] = path.locate(axis, t, low[axis], high[axis] - 1);
            }
        }
        // Where the ray leaves what holds this block as well, larger steps may do.
        let coarser = if level == 0 { finest.max(1) } else { level + 1 };
        if coarser <= top && (0..2).any(|axis| at[axis] >> coarser != low[axis] >> coarser) {
            level = coarser;
        }
    }
}

/// Whether a part of a ray has heights in a range.
fn reaches(path: &Path, rise: Rise, range: [f64; 2], part: [f64; 2]) -> bool {
    let ends = range.map(|height| rise.world(height));
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let slack = 4.0 * f64::EPSILON * low.abs().max(high.abs());
    let (first, second) = (path.height(part[0]), path.height(part[1]));
    first.max(second) >= low - slack && first.min(second) <= high + slack
}

/// Where in a cell a ray meets a triangle of it.
struct Met {
    t: f64,
    triangle: Triangle,
    u: f64,
    v: f64,
}

impl Met {
    fn placed(&self, grid: &HeightGrid, cell: &Cell, at: [i64; 2]) -> Hit {
        let (row, column) = (at[1] as f64 + self.v, at[0] as f64 + self.u);
        Hit {
            t: self.t,
            row,
            column,
            x: grid.origin[0] + column * grid.step[0],
            y: grid.origin[1] + row * grid.step[1],
            height: height_in(cell, &self.triangle, self.u, self.v),
            samples: samples_of(at[1] as u64, at[0] as u64, cell, &self.triangle),
        }
    }
}

/// The first triangle of a cell that a part of a ray meets.
fn meet(path: &Path, rise: Rise, cell: &Cell, at: [i64; 2], part: [f64; 2], last: &mut Last) -> Option<Met> {
    let before = last.take();
    if cell.measured() < 3 {
        return None;
    }
    let world = rise.cell(cell);
    let [start, stop] = within(path, &world, part)?;
    let inside = [path.origin[0] - at[0] as f64, path.origin[1] - at[1] as f64];
    // The line that parts the cell: k + m u + n v is above 0 on the side of the first triangle.
    let is_main = !cell.0[0].is_nan() && !cell.0[3].is_nan();
    let [k, m, n] = if is_main { [0.0, 1.0, -1.0] } else { [1.0, -1.0, -1.0] };
    let side = k + m * inside[0] + n * inside[1];
    let turn = m * path.direction[0] + n * path.direction[1];
    let crossed = -side / turn;
    let mut parts = [[start, stop]; 2];
    let mut sides = [side + 0.5 * (start + stop) * turn >= 0.0; 2];
    let mut count = 1;
    if turn != 0.0 && crossed > start && crossed < stop {
        parts = [[start, crossed], [crossed, stop]];
        sides = [turn < 0.0, turn > 0.0];
        count = 2;
    }
    *last = before;
    for (&[from, to], &is_first) in parts.iter().zip(&sides).take(count) {
        let triangle = cell.triangles().find(|triangle| (triangle.edge[1] == m && triangle.edge[2] == n) == is_first);
        let Some(triangle) = triangle else {
            *last = None;
            continue;
        };
        let plane = plane_of(&world, &triangle);
        let place = |t: f64| {
            let along = |axis: usize| match path.direction[axis] {
                0.0 => inside[axis],
                way => inside[axis] + t * way,
            };
            [along(0).clamp(0.0, 1.0), along(1).clamp(0.0, 1.0)]
        };
        let above = |t: f64| {
            let [u, v] = place(t);
            path.height(t) - (plane[0] + plane[1] * u + plane[2] * v)
        };
        let (first, second) = (above(from), above(to));
        let met = match *last {
            Some((t, side)) if t == from && parted(side, first) => Some(from),
            _ if parted(first, second) && first == second => Some(from),
            _ if parted(first, second) => Some((from + (to - from) * (first / (first - second))).clamp(from, to)),
            _ => None,
        };
        if let Some(t) = met {
            let [u, v] = place(t);
            return Some(Met { t, triangle, u, v });
        }
        *last = Some((to, second));
    }
    None
}

/// Whether 0 lies between two numbers.
fn parted(first: f64, second: f64) -> bool {
    (first <= 0.0 && second >= 0.0) || (first >= 0.0 && second <= 0.0)
}

/// The part of a part of a ray that has the heights of a cell's samples, or a little more; `None` without any. What is cut off is on one side
/// of T for sure. A vertical ray's part is finite hereafter.
fn within(path: &Path, world: &[f64; 4], part: [f64; 2]) -> Option<[f64; 2]> {
    let low = world.iter().copied().fold(f64::INFINITY, f64::min);
    let high = world.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let slack = 1e-9 * (high - low) + 1e-12 * low.abs().max(high.abs()) + 16.0 * f64::EPSILON * path.origin[2].abs();
    let (low, high) = (low - slack, high + slack);
    let way = path.direction[2];
    if way == 0.0 {
        return (low..=high).contains(&path.origin[2]).then_some(part);
    }
    let (one, other) = ((low - path.origin[2]) / way, (high - path.origin[2]) / way);
    let (start, stop) = (part[0].max(one.min(other)), part[1].min(one.max(other)));
    (start <= stop && stop < f64::INFINITY).then_some([start, stop])
}

/// A triangle's plane in the world: its height at the cell's first corner, and its changes along columns and rows.
fn plane_of(world: &[f64; 4], triangle: &Triangle) -> [f64; 3] {
    let [a, b, d, e] = *world;
    match triangle.corners {
        [0, 1, 3] => [a, b - a, e - b],
        [0, 2, 3] => [a, e - d, d - a],
        [1, 2, 3] => [b + (d - e), e - d, e - b],
        _ => [a, b - a, d - a],
    }
}

/// Rays that one task casts, one after the other.
const TOGETHER: usize = 256;

/// Casts many rays, several at a time; `out[i]` becomes what the ray `ray(i)` meets. `open` gives each task its own reader of the field.
///
/// # Errors
/// Where the field cannot be read.
pub fn cast_all<M: MinMax>(
    open: impl Fn() -> M + Send + Sync,
    rise: Rise,
    ray: impl Fn(usize) -> Ray + Sync,
    out: &mut [Option<Hit>],
) -> Result<(), M::Error> {
    out.par_chunks_mut(TOGETHER).enumerate().try_for_each_init(open, |field, (chunk, out)| {
        for (number, hit) in out.iter_mut().enumerate() {
            *hit = cast(field, rise, &ray(chunk * TOGETHER + number))?;
        }
        Ok(())
    })
}
