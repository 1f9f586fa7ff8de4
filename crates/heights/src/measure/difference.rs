//! The difference of two fields on the first one's grid, and the volumes between them.

use super::bands::map_bands;
use super::tiles::triangle_at;
use crate::model::{Cell, HeightError, HeightGrid, Heights, Lengths, Window, units};
use deepfield_data::model::{SampleType, Scale, Unit};
use serde::Serialize;

/// Why two fields have no difference.
#[derive(Debug, thiserror::Error)]
pub enum DifferenceError {
    /// One of the fields.
    #[error(transparent)]
    Heights(#[from] HeightError),
    /// They do not fit together.
    #[error("{before} and {after}: {field}: found {found}, expected {expected}")]
    Unlike {
        /// Name of the earlier field.
        before: String,
        /// Name of the later field.
        after: String,
        /// What does not fit.
        field: &'static str,
        /// What both say.
        found: String,
        /// What would fit, and the option for it.
        expected: String,
    },
}

/// Places in samples that differ by less are one: grids that coincide.
const SAME: f64 = 1e-9;

/// Next to a sample in no triangle a place is on it.
const ON_SAMPLE: f64 = 1e-6;

/// So many samples of the later field are read at once.
const AT_ONCE: f64 = 262_144.0;

/// A later field minus an earlier one, on the earlier one's grid and in its units; computed whenever it is read. Where grids coincide, samples
/// are subtracted from samples; else the later field is T at the earlier one's places. Not measured where either is not.
pub struct Difference<'a> {
    before: &'a dyn Heights,
    after: &'a dyn Heights,
    grid: HeightGrid,
    /// Row and column in the later field of the earlier one's first sample.
    first: [f64; 2],
    /// What a row and a column of the earlier field are there.
    step: [f64; 2],
    /// From the later field's unit of heights to the earlier one's.
    factor: f64,
    /// How far rows and columns are shifted, where the grids coincide.
    shift: Option<[i64; 2]>,
}

impl crate::build::Measured for Difference<'_> {}

/// What one unit is in another; `None` where this is not known.
fn factor(from: &Unit, to: &Unit) -> Option<f64> {
    if from == to {
        return Some(1.0);
    }
    Some(units::metres(from)? / units::metres(to)?)
}

fn named(unit: &Unit) -> &str {
    if unit.is_unknown() { "no unit" } else { &unit.0 }
}

impl<'a> Difference<'a> {
    /// Of an earlier and a later field, with names for messages.
    ///
    /// # Errors
    /// Where units are not known to be lengths of both, or reference systems differ, or the fields have nothing in common.
    pub fn new(
        [before_name, after_name]: [&str; 2],
        before: &'a dyn Heights,
        after: &'a dyn Heights,
    ) -> Result<Difference<'a>, DifferenceError> {
        let (a, b) = (before.grid(), after.grid());
        let unlike = |field, found, expected: &str| DifferenceError::Unlike {
            before: before_name.into(),
            after: after_name.into(),
            field,
            found,
            expected: expected.into(),
        };
        let units = |one: &Unit, other: &Unit| format!("{} and {}", named(one), named(other));
        let Some(place) = factor(&a.xy_unit, &b.xy_unit) else {
            return Err(unlike(
                "unit of x and y",
                units(&a.xy_unit, &b.xy_unit),
                "lengths in both, or degrees in both (--xy-unit)",
            ));
        };
        let Some(factor) = factor(&b.height_unit, &a.height_unit) else {
            return Err(unlike(
                "unit of heights",
                units(&a.height_unit, &b.height_unit),
                "lengths in both (--height-unit)",
            ));
        };
        if let (Some(one), Some(other)) = (&a.crs, &b.crs)
            && one != other
        {
            let expected = "one reference system in both: reproject one of them first, or export it without its system (select -o FILE.asc)";
            return Err(unlike("CRS", format!("{one} and {other}"), expected));
        }
        let first = b.row_column([a.origin[0] * place, a.origin[1] * place]);
        let step = [a.step[1] * place / b.step[1], a.step[0] * place / b.step[0]];
        let last = [(a.rows, 0), (a.columns, 1)].map(|(count, axis)| first[axis] + (count - 1) as f64 * step[axis]);
        let size = [(b.rows - 1) as f64, (b.columns - 1) as f64];
        let meets = |axis: usize| {
            let (low, high) = (first[axis].min(last[axis]), first[axis].max(last[axis]));
            low <= size[axis] + SAME && high >= -SAME
        };
        if !meets(0) || !meets(1) {
            let extent = |grid: &HeightGrid, factor: f64| {
                let end = grid.place((grid.rows - 1) as f64, (grid.columns - 1) as f64);
                let span = |axis: usize| {
                    let (one, other) = (grid.origin[axis] * factor, end[axis] * factor);
                    format!("{} to {}", one.min(other), one.max(other))
                };
                format!("x {}, y {}", span(0), span(1))
            };
            let found = format!("{} and {}", extent(a, 1.0), extent(b, 1.0 / place));
            return Err(unlike(
                "places",
                found,
                "fields that overlap (--spacing and --xy-unit say how far samples are apart)",
            ));
        }
        let is_whole = |axis: usize, count: u64| {
            (first[axis] - first[axis].round()).abs() <= SAME && (step[axis] - 1.0).abs() * count as f64 <= SAME
        };
        let shift = (is_whole(0, a.rows) && is_whole(1, a.columns)).then(|| first.map(|place| place.round() as i64));
        let grid = HeightGrid {
            sample_type: SampleType::F64,
            scale: Scale::NONE,
            planes: Vec::new(),
            crs: a.crs.clone().or_else(|| b.crs.clone()),
            ..a.clone()
        };
        Ok(Difference { before, after, grid, first, step, factor, shift })
    }

    /// Takes samples from the later field where grids coincide.
    fn copied(&self, window: Window, [down, right]: [i64; 2], out: &mut [f64]) -> Result<(), HeightError> {
        let b = self.after.grid();
        let span = |first: u64, count: u64, shift: i64, all: u64| {
            let low = first as i64 + shift;
            (low.max(0), (low + count as i64).min(all as i64))
        };
        let (top, bottom) = span(window.row, window.rows, down, b.rows);
        let (left, right_end) = span(window.column, window.columns, right, b.columns);
        if top >= bottom || left >= right_end {
            out.fill(f64::NAN);
            return Ok(());
        }
        let inner = Window {
            row: top as u64,
            column: left as u64,
            rows: (bottom - top) as u64,
            columns: (right_end - left) as u64,
        };
        let mut values = vec![0.0; inner.samples() as usize];
        self.after.heights(inner, &mut values)?;
        let width = window.columns as usize;
        let skip = (left - (window.column as i64 + right)) as usize;
        let first_row = (top - (window.row as i64 + down)) as usize;
        let is_row = |number: usize| (first_row..first_row + inner.rows as usize).contains(&number);
        for (number, row) in out.chunks_exact_mut(width).enumerate() {
            let here = is_row(number)
                .then(|| &values[(number - first_row) * inner.columns as usize..][..inner.columns as usize]);
            for (column, height) in row.iter_mut().enumerate() {
                let other = here.and_then(|here| here.get(column.wrapping_sub(skip))).copied().unwrap_or(f64::NAN);
                *height = self.factor * other - *height;
            }
        }
        Ok(())
    }

    /// Takes T of the later field at the places of some rows of a window.
    fn sampled(&self, window: Window, rows: std::ops::Range<usize>, out: &mut [f64]) -> Result<(), HeightError> {
        let b = self.after.grid();
        let place = |axis: usize, number: u64| self.first[axis] + number as f64 * self.step[axis];
        // What is needed of the later field, with a neighbour on all sides.
        let span = |axis: usize, first: u64, count: u64, all: u64| {
            let (one, other) = (place(axis, first), place(axis, first + count - 1));
            let last = (all - 1) as f64;
            let (low, high) = (one.min(other).floor() - 1.0, one.max(other).ceil() + 1.0);
            let is_beside = high < 0.0 || low > last;
            (!is_beside).then(|| (low.clamp(0.0, last) as u64, high.clamp(0.0, last) as u64))
        };
        let first_row = window.row + rows.start as u64;
        let needed =
            span(0, first_row, rows.len() as u64, b.rows).zip(span(1, window.column, window.columns, b.columns));
        let Some(((top, bottom), (left, right))) = needed else {
            out.fill(f64::NAN);
            return Ok(());
        };
        let inner = Window { row: top, column: left, rows: bottom - top + 1, columns: right - left + 1 };
        let mut values = vec![0.0; inner.samples() as usize];
        self.after.heights(inner, &mut values)?;
        let value = |row: u64, column: u64| match (row.checked_sub(top), column.checked_sub(left)) {
            (Some(row), Some(column)) if row < inner.rows && column < inner.columns => {
                values[(row * inner.columns + column) as usize]
            }
            _ => f64::NAN,
        };
        let cell = |row: u64, column: u64| -> Result<Cell, HeightError> {
            Ok(Cell([value(row, column), value(row, column + 1), value(row + 1, column), value(row + 1, column + 1)]))
        };
        for (number, line) in out.chunks_exact_mut(window.columns as usize).enumerate() {
            let row = place(0, first_row + number as u64);
            for (number, height) in line.iter_mut().enumerate().filter(|(_, height)| !height.is_nan()) {
                let column = place(1, window.column + number as u64);
                let other = match triangle_at([b.rows, b.columns], row, column, cell)? {
                    Some(on) => on.height(),
                    // A sample in no triangle has its height at its very place.
                    None if (row - row.round()).hypot(column - column.round()) < ON_SAMPLE
                        && row > -0.5
                        && column > -0.5 =>
                    {
                        value(row.round() as u64, column.round() as u64)
                    }
                    None => f64::NAN,
                };
                *height = self.factor * other - *height;
            }
        }
        Ok(())
    }
}

impl Heights for Difference<'_> {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.before.heights(window, out)?;
        if let Some(shift) = self.shift {
            return self.copied(window, shift, out);
        }
        let width = window.columns as usize;
        // Of a finer field many rows stand for one.
        let a_row = (window.columns as f64 * self.step[1].abs() + 4.0) * (self.step[0].abs() + 1.0);
        let together = (AT_ONCE / a_row).clamp(1.0, window.rows as f64) as usize;
        for (number, part) in out.chunks_mut(together * width).enumerate() {
            let start = number * together;
            self.sampled(window, start..start + part.len() / width, part)?;
        }
        Ok(())
    }

    fn plane(&self, _plane: usize, _window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        out.fill(0);
        Ok(())
    }
}

/// Volumes between T and the height 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Volumes {
    /// Measured samples.
    pub valid: u64,
    /// T's area in plan, in the square of the unit of lengths.
    pub area: f64,
    /// What is above, in the cube of the unit of lengths where heights are lengths as well; else in their unit times its square.
    pub volume_above: f64,
    /// What is below; above 0 as well.
    pub volume_below: f64,
}

/// Volumes between a field, whose degrees are those of the Earth, and the height 0.
///
/// # Errors
/// As [`volumes_on`].
pub fn volumes(heights: &dyn Heights) -> Result<Volumes, HeightError> {
    volumes_on(heights, &Lengths::of(heights.grid()))
}

/// Volumes between a field and the height 0, exact for T: triangles are cut there.
///
/// # Errors
/// Where the field cannot be read.
pub fn volumes_on(heights: &dyn Heights, lengths: &Lengths) -> Result<Volumes, HeightError> {
    let bands = map_bands(heights, 1, |band| {
        let valid =
            band.rows().map(|(_, row)| row.iter().filter(|height| !height.is_nan()).count() as u64).sum::<u64>();
        let (mut area, mut above, mut below) = (0.0, 0.0, 0.0);
        for (number, upper, lower) in band.pairs() {
            let (half, mut triangles, mut line) = (0.5 * lengths.cell(number), 0_u64, [0.0; 2]);
            for (upper, lower) in upper.windows(2).zip(lower.windows(2)) {
                let cell = Cell([upper[0], upper[1], lower[0], lower[1]]);
                for triangle in cell.triangles() {
                    let parts = parted(triangle.corners.map(|corner| cell.0[corner]));
                    line = [line[0] + parts[0], line[1] + parts[1]];
                    triangles += 1;
                }
            }
            area += half * triangles as f64;
            above += half * line[0];
            below += half * line[1];
        }
        (valid, area, above, below)
    })?;
    let add = |all: (u64, f64, f64, f64), band: (u64, f64, f64, f64)| {
        (all.0 + band.0, all.1 + band.1, all.2 + band.2, all.3 + band.3)
    };
    let (valid, area, above, below) = bands.into_iter().fold((0, 0.0, 0.0, 0.0), add);
    Ok(Volumes { valid, area, volume_above: lengths.lift * above, volume_below: lengths.lift * below })
}

/// Integrals of what is above and below 0 over a triangle of area 1.
fn parted(heights: [f64; 3]) -> [f64; 2] {
    let mut sorted = heights;
    sorted.sort_unstable_by(f64::total_cmp);
    let [low, middle, high] = sorted;
    if low >= 0.0 || high <= 0.0 {
        // In order of the corners, so that equal heights add up to what they are.
        let mean = (heights[0] + heights[1] + heights[2]) / 3.0;
        return if low >= 0.0 { [mean, 0.0] } else { [0.0, -mean] };
    }
    // The tip on its side of 0 is a triangle; what is left is the whole without it.
    let tip = |top: f64, one: f64, other: f64| top / (top - one) * (top / (top - other)) * top.abs() / 3.0;
    let mean = (low + middle + high) / 3.0;
    if middle <= 0.0 {
        let above = tip(high, middle, low);
        [above, above - mean]
    } else {
        let below = tip(low, middle, high);
        [mean + below, below]
    }
}
