//! Lines along the rims of holes: how far a place of the picture is from where the drawn surface ends, but for the field's border.

use super::resolve::{Hit, Resolver};
use super::stitch::{Mesh, Scene};
use deepfield_heights::model::Cell;
use rayon::prelude::*;

/// Corners of a cell's sides, in the order of a mesh's: first row, last row, first column, last column.
const ENDS: [[usize; 2]; 4] = [[0, 1], [2, 3], [0, 2], [1, 3]];
/// Squares of so many cells along a side know whether there is a rim in them.
pub const SQUARE: usize = 8;
/// Cells along rows and columns that are looked at around a place; more are there only where the surface is seen from its edge.
pub const MOST: f64 = 40.0;
/// Rims are looked for within so many widths: where there are many of them they fade, as coverage shows them.
pub const AROUND: f64 = 2.0;
/// Lengths of rims within that, in parts of its radius, from which on lines fade, and where there are none: a straight one is 2.
pub const CROWDED: [f64; 2] = [4.5, 7.0];
/// Cells that are smaller than this are looked at as if the picture were not in perspective, pixels.
const SMALL: f64 = 8.0;
/// Half of a line's soft edge, samples.
pub const EDGE: f64 = 0.3;

/// The rims of what is drawn.
pub(super) struct Rims {
    meshes: Vec<Edges>,
    /// Width of lines, in the picture's samples.
    width: f64,
}

/// Which edges of a chunk's cells end the surface: a bit for each side, and one for the edge across the cell. Empty where none do.
#[derive(Default)]
struct Edges {
    cells: Vec<u8>,
    /// Whether there are any in squares of cells.
    squares: Vec<bool>,
}

/// Whether a triangle of a cell has this edge.
fn has(cell: &Cell, [from, to]: [usize; 2]) -> bool {
    cell.triangles().any(|triangle| triangle.corners.contains(&from) && triangle.corners.contains(&to))
}

impl Edges {
    fn of(scene: &Scene, mesh: &Mesh) -> Edges {
        let [rows, columns] = [mesh.samples.rows - 1, mesh.samples.columns - 1];
        let is_mixed = !mesh.samples.coverage.is_empty();
        let mut edges = Edges::default();
        for row in 0..rows {
            let is_side = row == 0 || row + 1 == rows;
            // What is whole ends at its border only.
            let step = if is_mixed || is_side { 1 } else { (columns - 1).max(1) };
            for column in (0..columns).step_by(step) {
                let cell = mesh.cell(row, column);
                let mut bits = 0;
                for (side, ends) in ENDS.into_iter().enumerate() {
                    if has(&cell, ends) && is_open(scene, mesh, [row, column], side) {
                        bits |= 1 << side;
                    }
                }
                if cell.measured() == 3 {
                    bits |= 1 << 4;
                }
                if bits == 0 {
                    continue;
                }
                if edges.cells.is_empty() {
                    edges.cells = vec![0; rows * columns];
                    edges.squares = vec![false; rows.div_ceil(SQUARE) * columns.div_ceil(SQUARE)];
                }
                edges.cells[row * columns + column] = bits;
                edges.squares[row / SQUARE * columns.div_ceil(SQUARE) + column / SQUARE] = true;
            }
        }
        edges
    }
}

/// Whether nothing is on the other side of a cell's side that is not on the field's border.
fn is_open(scene: &Scene, mesh: &Mesh, [row, column]: [usize; 2], side: usize) -> bool {
    let [rows, columns] = [mesh.samples.rows - 1, mesh.samples.columns - 1];
    let (axis, is_last) = super::stitch::SIDES[side];
    let opposite = ENDS[side ^ 1];
    let at = [row, column];
    let is_inside = if is_last { at[axis] + 1 < [rows, columns][axis] } else { at[axis] > 0 };
    if is_inside {
        let mut beside = at;
        beside[axis] = if is_last { at[axis] + 1 } else { at[axis] - 1 };
        return !has(&mesh.cell(beside[0], beside[1]), opposite);
    }
    let places = [&mesh.rows, &mesh.columns];
    let mut place = [0, 1].map(|axis| places[axis][at[axis]]);
    if is_last {
        place[axis] = places[axis][at[axis] + 1];
        if place[axis] + 1 >= scene.lattice.samples[axis] {
            return false;
        }
    } else {
        if place[axis] == 0 {
            return false;
        }
        place[axis] -= 1;
    }
    let Some(other) = scene.cut.at(place[0], place[1]).map(|number| &scene.meshes[number]) else {
        // Nothing is there, or nothing of it is in the picture.
        return true;
    };
    let [row, column] = other.cell_at(place);
    !has(&other.cell(row, column), opposite)
}

/// The cells of a square, row by row: a bit for each side that ends the surface, in the order of a mesh's, and one for the edge across the cell.
pub type RimSquare = [u8; SQUARE * SQUARE];

/// Of each chunk of a scene its squares of cells, row by row, where any of them has a rim; no squares where none has.
pub fn squares(scene: &Scene) -> Vec<Vec<Option<RimSquare>>> {
    scene.meshes.par_iter().map(|mesh| Edges::of(scene, mesh).squares_of(mesh)).collect()
}

impl Rims {
    /// Of a scene, for lines so wide, in the picture's samples.
    pub(super) fn new(scene: &Scene, width: f64) -> Rims {
        Rims { meshes: scene.meshes.par_iter().map(|mesh| Edges::of(scene, mesh)).collect(), width }
    }

    /// How much of a hit is line.
    pub(super) fn share(&self, resolver: &Resolver<'_>, hit: &Hit) -> f32 {
        let (scene, radius) = (resolver.scene, AROUND * self.width);
        let [row, column, height] = hit.under;
        let own = &scene.meshes[hit.shown.node];
        if hit.shown.slot.is_none() {
            return 0.0;
        }
        let Some(moves) = resolver.moves(hit) else { return 0.0 };
        let [by_column, by_row] = moves.along(hit.slope);
        let cross = (by_column[0] * by_row[1] - by_column[1] * by_row[0]).abs().max(f64::MIN_POSITIVE);
        let most = MOST * (1_u64 << own.node.key.level) as f64;
        let reach = [by_column, by_row].map(|way| (radius * way[0].hypot(way[1]) / cross).min(most));
        let size = [moves.column, moves.row].map(|[x, y]| x.hypot(y)).into_iter().fold(0.0, f64::max);
        let mut found = Found { nearest: f64::INFINITY, length: 0.0, radius };
        let place = |at: [f64; 3], is_small: bool| {
            if is_small {
                let [down, right, up] = [at[0] - row, at[1] - column, at[2] - height];
                return Some([0, 1].map(|k| right * moves.column[k] + down * moves.row[k] + up * moves.height[k]));
            }
            let relative = scene.placed.world(at[0], at[1], at[2]) - resolver.sight.eye();
            let (to, _) = resolver.project(relative)?;
            Some([0, 1].map(|k| to[k] - moves.at[k]))
        };
        let bounds = [(row, reach[0]), (column, reach[1])].map(|(at, reach)| [at - reach, at + reach]);
        for number in around(scene, hit.shown.node, bounds) {
            let (mesh, edges) = (&scene.meshes[number], &self.meshes[number]);
            if edges.cells.is_empty() {
                continue;
            }
            let is_small = size * ((1_u64 << mesh.node.key.level) as f64) < SMALL;
            edges.each(mesh, bounds, |[row, column], bits| {
                let heights = mesh.cell(row, column).0;
                let corner = |corner: usize| {
                    let (row, column) = (mesh.rows[row + corner / 2], mesh.columns[column + corner % 2]);
                    place([row as f64, column as f64, heights[corner]], is_small)
                };
                let inner = if heights[0].is_nan() || heights[3].is_nan() { [1, 2] } else { [0, 3] };
                for ends in ENDS.into_iter().chain([inner]).enumerate().filter(|(bit, _)| bits >> bit & 1 == 1) {
                    if let (Some(from), Some(to)) = (corner(ends.1[0]), corner(ends.1[1])) {
                        found.add(from, to);
                    }
                }
            });
        }
        let line = ((self.width - found.nearest) / (2.0 * EDGE) + 0.5).clamp(0.0, 1.0);
        let crowd = (found.length / radius - CROWDED[0]) / (CROWDED[1] - CROWDED[0]);
        (line * (1.0 - crowd.clamp(0.0, 1.0))) as f32
    }
}

impl Edges {
    /// The squares of cells, with what is in them.
    fn squares_of(&self, mesh: &Mesh) -> Vec<Option<RimSquare>> {
        let [rows, columns] = [mesh.samples.rows - 1, mesh.samples.columns - 1];
        let wide = columns.div_ceil(SQUARE);
        let cells = |square: usize| -> RimSquare {
            let [down, right] = [square / wide, square % wide].map(|at| at * SQUARE);
            std::array::from_fn(|cell| {
                let [row, column] = [down + cell / SQUARE, right + cell % SQUARE];
                // The last squares may be beyond the chunk.
                if row < rows && column < columns { self.cells[row * columns + column] } else { 0 }
            })
        };
        self.squares.iter().enumerate().map(|(square, has_any)| has_any.then(|| cells(square))).collect()
    }

    /// Calls `each` for the cells between these rows and columns that have any.
    fn each(&self, mesh: &Mesh, bounds: [[f64; 2]; 2], mut each: impl FnMut([usize; 2], u8)) {
        let [rows, columns] = [0, 1].map(|axis| {
            let places = if axis == 0 { &mesh.rows } else { &mesh.columns };
            let first = places.partition_point(|place| *place as f64 <= bounds[axis][0]).saturating_sub(2);
            let last = places.partition_point(|place| (*place as f64) < bounds[axis][1]) + 1;
            first..last.min(places.len() - 1)
        });
        let wide = mesh.samples.columns - 1;
        let squares = |range: &std::ops::Range<usize>| range.start / SQUARE..range.end.div_ceil(SQUARE);
        for (down, right) in squares(&rows).flat_map(|down| squares(&columns).map(move |right| (down, right))) {
            if !self.squares[down * wide.div_ceil(SQUARE) + right] {
                continue;
            }
            let part = |range: &std::ops::Range<usize>, square: usize| {
                range.start.max(square * SQUARE)..range.end.min((square + 1) * SQUARE)
            };
            for (row, column) in part(&rows, down).flat_map(|r| part(&columns, right).map(move |c| (r, c))) {
                let bits = self.cells[row * wide + column];
                if bits != 0 {
                    each([row, column], bits);
                }
            }
        }
    }
}

/// What is known of rims near a place.
struct Found {
    nearest: f64,
    /// Their length within the radius.
    length: f64,
    radius: f64,
}

impl Found {
    /// A part of a rim, from the place.
    fn add(&mut self, from: [f64; 2], to: [f64; 2]) {
        let along = [to[0] - from[0], to[1] - from[1]];
        let square = along[0] * along[0] + along[1] * along[1];
        let foot = if square > 0.0 { -(from[0] * along[0] + from[1] * along[1]) / square } else { 0.0 };
        let at = |share: f64| (from[0] + share * along[0]).hypot(from[1] + share * along[1]);
        self.nearest = self.nearest.min(at(foot.clamp(0.0, 1.0)));
        let away = at(foot);
        if square > 0.0 && away < self.radius {
            let half = ((self.radius * self.radius - away * away) / square).sqrt();
            let inside = (foot + half).min(1.0) - (foot - half).max(0.0);
            self.length += inside.max(0.0) * square.sqrt();
        }
    }
}

/// The chunk and those beside it that reach between these rows and columns.
fn around(scene: &Scene, own: usize, bounds: [[f64; 2]; 2]) -> Vec<usize> {
    let mesh = &scene.meshes[own];
    let ends = [&mesh.rows, &mesh.columns].map(|places| [places[0] as f64, places[places.len() - 1] as f64]);
    if (0..2).all(|axis| bounds[axis][0] > ends[axis][0] && bounds[axis][1] < ends[axis][1]) {
        return vec![own];
    }
    let place = |axis: usize, at: f64| (at.max(0.0) as u64).min(scene.lattice.samples[axis] - 2);
    let mut found = vec![own];
    for row in bounds[0].iter().map(|at| place(0, *at)) {
        for column in bounds[1].iter().map(|at| place(1, *at)) {
            found.extend(scene.cut.at(row, column));
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}
