//! A part of a field as a field of its own.

use crate::model::{HeightError, HeightGrid, Heights, Window};

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
    disc: Option<Disc>,
}

impl<'a> Part<'a> {
    /// The samples of a window; `None` where this is not in the field, or less than 2 x 2 samples.
    pub fn of_window(heights: &'a dyn Heights, window: Window) -> Option<Part<'a>> {
        let grid = heights.grid();
        if !window.is_in(grid) || window.rows < 2 || window.columns < 2 {
            return None;
        }
        let origin = grid.place(window.row as f64, window.column as f64);
        let grid = HeightGrid { rows: window.rows, columns: window.columns, origin, ..grid.clone() };
        Some(Part { heights, grid, first: [window.row, window.column], disc: None })
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
        Some(Part { disc: Some(disc), ..part })
    }
}

/// The samples in a rectangle and on its edges, given by two opposite corners in x and y; `None` where there are none. What is off an edge by
/// rounding is on it.
pub fn window_of(grid: &HeightGrid, corners: [[f64; 2]; 2]) -> Option<Window> {
    if corners.as_flattened().iter().any(|part| part.is_nan()) {
        return None;
    }
    let [from, to] = corners.map(|corner| grid.row_column(corner));
    let span = |one: f64, other: f64, count: u64| {
        let slack = |place: f64| 1e-9 + 4.0 * f64::EPSILON * place.abs();
        let (low, high) = (one.min(other), one.max(other));
        let (first, last) = ((low - slack(low)).ceil().max(0.0), (high + slack(high)).floor().min((count - 1) as f64));
        (first <= last).then(|| (first as u64, (last - first) as u64 + 1))
    };
    let ((row, rows), (column, columns)) = (span(from[0], to[0], grid.rows)?, span(from[1], to[1], grid.columns)?);
    Some(Window { row, column, rows, columns })
}

impl Heights for Part<'_> {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.heights
            .stored(Window { row: window.row + self.first[0], column: window.column + self.first[1], ..window }, out)?;
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
        self.heights.plane(
            plane,
            Window { row: window.row + self.first[0], column: window.column + self.first[1], ..window },
            out,
        )
    }
}
