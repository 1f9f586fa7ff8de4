//! T anywhere in a field, with the tiles that were read last kept in memory: for what goes along lines and looks at places.

use crate::model::{Cell, HeightError, HeightGrid, Heights, Triangle, Window};
use std::convert::Infallible;

/// Cells along an edge of a tile.
const EDGE: u64 = 256;

/// So many tiles are kept.
const KEPT: usize = 16;

/// Places so close to a triangle, in parts of a cell, are on it: what rounding may take a place off an edge.
const CLOSE: f64 = 1e-9;

struct Tile {
    row: u64,
    column: u64,
    width: usize,
    heights: Vec<f64>,
}

/// A reader of single cells of a field.
pub struct Tiles<'a> {
    heights: &'a dyn Heights,
    /// The one used last comes first.
    tiles: Vec<Tile>,
}

impl<'a> Tiles<'a> {
    /// Of a field.
    pub fn new(heights: &'a dyn Heights) -> Tiles<'a> {
        Tiles { heights, tiles: Vec::new() }
    }

    /// The field's grid.
    pub fn grid(&self) -> &'a HeightGrid {
        self.heights.grid()
    }

    /// A cell by its first sample.
    ///
    /// # Errors
    /// Where the field cannot be read, or the cell is not in it.
    pub fn cell(&mut self, row: u64, column: u64) -> Result<Cell, HeightError> {
        let (tile_row, tile_column) = (row / EDGE, column / EDGE);
        let found = self.tiles.iter().position(|tile| (tile.row, tile.column) == (tile_row, tile_column));
        match found {
            Some(0) => {}
            Some(number) => self.tiles[..=number].rotate_right(1),
            None => {
                let tile = self.read(tile_row, tile_column)?;
                self.tiles.truncate(KEPT - 1);
                self.tiles.insert(0, tile);
            }
        }
        let tile = &self.tiles[0];
        let first = ((row - tile_row * EDGE) as usize) * tile.width + (column - tile_column * EDGE) as usize;
        let at = |offset: usize| tile.heights.get(first + offset).copied().unwrap_or(f64::NAN);
        Ok(Cell([at(0), at(1), at(tile.width), at(tile.width + 1)]))
    }

    fn read(&self, tile_row: u64, tile_column: u64) -> Result<Tile, HeightError> {
        let grid = self.grid();
        let (row, column) = (tile_row * EDGE, tile_column * EDGE);
        let window = Window {
            row,
            column,
            rows: (EDGE + 1).min(grid.rows.saturating_sub(row)),
            columns: (EDGE + 1).min(grid.columns.saturating_sub(column)),
        };
        let mut heights = vec![f64::NAN; window.samples() as usize];
        self.heights.heights(window, &mut heights)?;
        Ok(Tile { row: tile_row, column: tile_column, width: window.columns as usize, heights })
    }

    /// The triangle of T at a place between samples, its cell and the place in that (0 to 1 along columns and rows); `None` where there is no
    /// surface. T's edges belong to it, those of holes and borders as well.
    ///
    /// # Errors
    /// Where the field cannot be read.
    pub fn triangle(&mut self, row: f64, column: f64) -> Result<Option<OnSurface>, HeightError> {
        let grid = self.grid();
        triangle_at([grid.rows, grid.columns], row, column, |row, column| self.cell(row, column))
    }

    /// The same of a field whose first column follows a spacing after the last one, as of a globe.
    ///
    /// # Errors
    /// As [`Tiles::triangle`].
    pub fn triangle_around(&mut self, row: f64, column: f64) -> Result<Option<OnSurface>, HeightError> {
        let grid = self.grid();
        triangle_at([grid.rows, grid.columns + 1], row, column, |row, column| {
            if column + 1 < grid.columns {
                return self.cell(row, column);
            }
            let [before, first] = [self.cell(row, column - 1)?, self.cell(row, 0)?];
            Ok(Cell([before.0[1], first.0[0], before.0[3], first.0[2]]))
        })
    }
}

/// The triangle of T at a place between samples, in a grid of so many rows and columns whose cells are asked for. Neighbours of a cell are
/// asked where the place is on their common edge: T's edges belong to it.
pub(crate) fn triangle_at<E>(
    [rows, columns]: [u64; 2],
    row: f64,
    column: f64,
    mut cell_at: impl FnMut(u64, u64) -> Result<Cell, E>,
) -> Result<Option<OnSurface>, E> {
    let (last_row, last_column) = ((rows - 1) as f64, (columns - 1) as f64);
    let is_near = |place: f64, last: f64| place >= -CLOSE && place <= last + CLOSE;
    if !is_near(row, last_row) || !is_near(column, last_column) {
        return Ok(None);
    }
    for [down, right] in NEIGHBOURS {
        let cell_row = (row + down).floor().clamp(0.0, last_row - 1.0);
        let cell_column = (column + right).floor().clamp(0.0, last_column - 1.0);
        let (u, v) = (column - cell_column, row - cell_row);
        let is_in = |part: f64| (-CLOSE..=1.0 + CLOSE).contains(&part);
        if !is_in(u) || !is_in(v) {
            continue;
        }
        let (cell_row, cell_column) = (cell_row as u64, cell_column as u64);
        let cell = cell_at(cell_row, cell_column)?;
        let on =
            |triangle: &Triangle, slack: f64| triangle.edge[0] + triangle.edge[1] * u + triangle.edge[2] * v >= -slack;
        let found = cell.triangles().find(|triangle| on(triangle, 0.0));
        if let Some(triangle) = found.or_else(|| cell.triangles().find(|triangle| on(triangle, CLOSE))) {
            let (u, v) = (u.clamp(0.0, 1.0), v.clamp(0.0, 1.0));
            return Ok(Some(OnSurface { row: cell_row, column: cell_column, u, v, cell, triangle }));
        }
    }
    Ok(None)
}

/// T's height at a place between samples, in a grid of so many rows and columns whose cells are asked for; `None` where there is no surface.
pub fn height_between(size: [u64; 2], row: f64, column: f64, mut cell_at: impl FnMut(u64, u64) -> Cell) -> Option<f64> {
    let cell_at = |row: u64, column: u64| Ok::<Cell, Infallible>(cell_at(row, column));
    triangle_at(size, row, column, cell_at).ok().flatten().map(|on| on.height())
}

/// Where the cell of a place is looked for: there, and a little aside.
const NEIGHBOURS: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [-CLOSE, 0.0],
    [0.0, -CLOSE],
    [CLOSE, 0.0],
    [0.0, CLOSE],
    [-CLOSE, -CLOSE],
    [-CLOSE, CLOSE],
    [CLOSE, -CLOSE],
    [CLOSE, CLOSE],
];

/// A place on T.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnSurface {
    /// Row of the cell's first sample.
    pub row: u64,
    /// Column of the cell's first sample.
    pub column: u64,
    /// The place in the cell along columns, 0 to 1.
    pub u: f64,
    /// The place in the cell along rows, 0 to 1.
    pub v: f64,
    /// The cell.
    pub cell: Cell,
    /// The triangle.
    pub triangle: Triangle,
}

impl OnSurface {
    /// T's height there, never beyond the heights of the triangle's corners.
    pub fn height(&self) -> f64 {
        height_in(&self.cell, &self.triangle, self.u, self.v)
    }

    /// The triangle's samples: row, column and height of each.
    pub fn samples(&self) -> [(u64, u64, f64); 3] {
        samples_of(self.row, self.column, &self.cell, &self.triangle)
    }
}

/// The height of a triangle at a place in its cell, kept between those of its corners, which rounding could leave.
pub(crate) fn height_in(cell: &Cell, triangle: &Triangle, u: f64, v: f64) -> f64 {
    let [p, q, s] = triangle.at;
    let corners = triangle.corners.map(|corner| cell.0[corner]);
    let low = corners.iter().copied().fold(f64::INFINITY, f64::min);
    let high = corners.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (p + q * u + s * v).clamp(low, high)
}

/// Row, column and height of a triangle's samples.
pub(crate) fn samples_of(row: u64, column: u64, cell: &Cell, triangle: &Triangle) -> [(u64, u64, f64); 3] {
    triangle.corners.map(|corner| (row + corner as u64 / 2, column + corner as u64 % 2, cell.0[corner]))
}
