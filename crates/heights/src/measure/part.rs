//! A part of a field as a field of its own.

use crate::model::{HeightError, HeightGrid, Heights, Window, units};

/// A disc in x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Its middle.
    pub center: [f64; 2],
    /// Its radius, in the unit of x and y.
    pub radius: f64,
}

/// A rectangle of samples, and in it, if asked for, those of a disc alone. Rows and columns count from the rectangle's first; places are the
/// field's.
pub struct Part<'a> {
    heights: &'a dyn Heights,
    grid: HeightGrid,
    first: [u64; 2],
    /// Where it goes on past the field's last column: after so many columns the first one comes again.
    around: Option<u64>,
    disc: Option<Disc>,
}

impl<'a> Part<'a> {
    /// The samples of a window, which of a field that goes round a globe may go on past its last column; `None` where this is not in the field, or
    /// less than 2 x 2 samples.
    pub fn of_window(heights: &'a dyn Heights, window: Window) -> Option<Part<'a>> {
        let grid = heights.grid();
        let is_in = window.is_in(grid);
        let around = grid.around().filter(|_| !is_in);
        let goes_on = around.is_some_and(|around| window.column < around && window.columns <= around + 1);
        let rows = Window { column: 0, columns: 1, ..window };
        if !(is_in || goes_on && rows.is_in(grid)) || window.rows < 2 || window.columns < 2 {
            return None;
        }
        let origin = grid.place(window.row as f64, window.column as f64);
        let grid = HeightGrid { rows: window.rows, columns: window.columns, origin, ..grid.clone() };
        Some(Part { heights, grid, first: [window.row, window.column], around, disc: None })
    }

    /// All of a field that goes round a globe and does not repeat its first column, with that once more; `None` of other fields.
    pub fn closed(heights: &'a dyn Heights) -> Option<Part<'a>> {
        let grid = heights.grid();
        let all = Window::all(grid);
        let is_open = grid.around() == Some(grid.columns);
        is_open.then(|| Part::of_window(heights, Window { columns: all.columns + 1, ..all })).flatten()
    }

    /// A whole field that begins where a window does which goes on past its last column, so that the window lies in it, and that window there; `None`
    /// of other windows.
    pub fn turned(heights: &'a dyn Heights, window: Window) -> Option<(Part<'a>, Window)> {
        let grid = heights.grid();
        let around = grid.around().filter(|_| !window.is_in(grid))?;
        let all = Window { row: 0, rows: grid.rows, column: window.column, columns: around.max(window.columns) };
        Some((Part::of_window(heights, all)?, Window { column: 0, ..window }))
    }

    /// The samples in a rectangle and on its edges, given by two opposite corners in x and y; `None` where these are less than 2 x 2.
    pub fn of_rectangle(heights: &'a dyn Heights, corners: [[f64; 2]; 2]) -> Option<Part<'a>> {
        Part::of_window(heights, window_of(heights.grid(), corners)?)
    }

    /// The samples in a disc and on its edge.
    pub fn of_disc(heights: &'a dyn Heights, disc: Disc) -> Option<Part<'a>> {
        let [x, y] = disc.center;
        let reach = disc.radius;
        let part = Part::of_rectangle(heights, [[x - reach, y - reach], [x + reach, y + reach]])?;
        let grid = &part.grid;
        // In the turn of the part's places.
        let middle = grid.place(0.0, 0.5 * (grid.columns - 1) as f64)[0];
        let turns = if units::is_degrees(&grid.xy_unit) { ((middle - x) / 360.0).round() } else { 0.0 };
        let disc = Disc { center: [x + 360.0 * turns, y], ..disc };
        Some(Part { disc: Some(disc), ..part })
    }

    /// Reads a window of it from the field, in pieces where the first column comes again.
    fn read<T: Copy + Default>(
        &self,
        window: Window,
        out: &mut [T],
        read: impl Fn(Window, &mut [T]) -> Result<(), HeightError>,
    ) -> Result<(), HeightError> {
        let (row, first) = (window.row + self.first[0], window.column + self.first[1]);
        let Some(around) = self.around else { return read(Window { row, column: first, ..window }, out) };
        let mut done = 0;
        while done < window.columns {
            let column = (first + done) % around;
            let columns = (window.columns - done).min(around - column);
            let piece = Window { row, column, columns, ..window };
            if columns == window.columns {
                return read(piece, out);
            }
            let mut values = vec![T::default(); piece.samples() as usize];
            read(piece, &mut values)?;
            let (before, width) = (done as usize, columns as usize);
            for (out, values) in out.chunks_exact_mut(window.columns as usize).zip(values.chunks_exact(width)) {
                out[before..before + width].copy_from_slice(values);
            }
            done += columns;
        }
        Ok(())
    }
}

/// Turns that places of a rectangle may be from a field's.
const TURNS: f64 = 10.0;

/// The samples in a rectangle and on its edges, given by two opposite corners in x and y; `None` where there are none. What is off an edge by
/// rounding is on it. Of a field that goes round a globe longitudes may be some turns further, and the window goes on past the last column where the
/// rectangle is over the seam: [`Part`] reads such a one.
pub fn window_of(grid: &HeightGrid, corners: [[f64; 2]; 2]) -> Option<Window> {
    if corners.as_flattened().iter().any(|part| part.is_nan()) {
        return None;
    }
    let [from, to] = corners.map(|corner| grid.row_column(corner));
    let span = |one: f64, other: f64| {
        let slack = |place: f64| 1e-9 + 4.0 * f64::EPSILON * place.abs();
        let (low, high) = (one.min(other), one.max(other));
        [(low - slack(low)).ceil(), (high + slack(high)).floor()]
    };
    let within = |[first, last]: [f64; 2], count: u64| {
        let (first, last) = (first.max(0.0), last.min((count - 1) as f64));
        (first <= last).then(|| (first as u64, (last - first) as u64 + 1))
    };
    let (row, rows) = within(span(from[0], to[0]), grid.rows)?;
    let across = span(from[1], to[1]);
    let is_within = across[0] >= 0.0 && across[1] <= (grid.columns - 1) as f64;
    let (column, columns) = match grid.around() {
        Some(around) if !is_within => round_it(across, around, grid.columns)?,
        _ => within(across, grid.columns)?,
    };
    Some(Window { row, column, rows, columns })
}

/// The first column and how many there are, from one number to another, of a field with `all` of them whose first one comes again after `around`: all
/// of more than one turn, `None` where there are none.
fn round_it([first, last]: [f64; 2], around: u64, all: u64) -> Option<(u64, u64)> {
    let (turn, count) = (around as f64, last - first + 1.0);
    if count.is_nan() || count < 1.0 || first.max(-last) > TURNS * turn {
        return None;
    }
    Some(if count > turn + 1.0 { (0, all) } else { (first.rem_euclid(turn) as u64, count as u64) })
}

impl Heights for Part<'_> {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.read(window, out, |window, out| self.heights.stored(window, out))?;
        let Some(Disc { center: [x, y], radius }) = self.disc else { return Ok(()) };
        for (number, row) in out.chunks_exact_mut(window.columns as usize).enumerate() {
            for (column, value) in row.iter_mut().enumerate() {
                let place =
                    self.grid.place((window.row + number as u64) as f64, (window.column + column as u64) as f64);
                if (place[0] - x).hypot(place[1] - y) > radius {
                    *value = f64::NAN;
                }
            }
        }
        Ok(())
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.read(window, out, |window, out| self.heights.plane(plane, window, out))
    }

    fn rows_together(&self) -> u64 {
        let together = self.heights.rows_together();
        if self.first[0].is_multiple_of(together) { together } else { 1 }
    }
}
