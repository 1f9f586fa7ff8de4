//! The difference of two fields on the first one's grid, and the volumes between them.

use super::alignment::{Alignment, ON_SAMPLE};
use super::bands::map_bands;
use super::tiles::triangle_at;
use crate::model::{Cell, HeightError, HeightGrid, Heights, Lengths, Window};
use deepfield_data::model::{SampleType, Scale};
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

/// So many samples of the later field are read at once.
const AT_ONCE: f64 = 262_144.0;

/// A later field minus an earlier one, on the earlier one's grid and in its units; computed whenever it is read. Where grids coincide, samples
/// are subtracted from samples; else the later field is T at the earlier one's places. Not measured where either is not.
pub struct Difference<'a> {
    before: &'a dyn Heights,
    after: &'a dyn Heights,
    grid: HeightGrid,
    /// Where the earlier field's samples are in the later one.
    alignment: Alignment,
    /// How far rows and columns are shifted, where the grids coincide.
    shift: Option<[i64; 2]>,
}

impl crate::build::Measured for Difference<'_> {}

impl<'a> Difference<'a> {
    /// Of an earlier and a later field, with names for messages.
    ///
    /// # Errors
    /// Where units are not known to be lengths of both, or reference systems differ, or the fields have nothing in common.
    pub fn new(
        names: [&str; 2],
        before: &'a dyn Heights,
        after: &'a dyn Heights,
    ) -> Result<Difference<'a>, DifferenceError> {
        let (a, b) = (before.grid(), after.grid());
        let alignment = Alignment::new(names, a, b)?;
        let shift = alignment.shift([a.rows, a.columns]);
        let grid = HeightGrid {
            sample_type: SampleType::F64,
            scale: Scale::NONE,
            planes: Vec::new(),
            crs: a.crs.clone().or_else(|| b.crs.clone()),
            ..a.clone()
        };
        Ok(Difference { before, after, grid, alignment, shift })
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
                *height = self.alignment.factor * other - *height;
            }
        }
        Ok(())
    }

    /// Takes T of the later field at the places of some rows of a window.
    fn sampled(&self, window: Window, rows: std::ops::Range<usize>, out: &mut [f64]) -> Result<(), HeightError> {
        let b = self.after.grid();
        let place = |axis: usize, number: u64| self.alignment.place(axis, number);
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
                *height = self.alignment.factor * other - *height;
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
        let a_row = (window.columns as f64 * self.alignment.step[1].abs() + 4.0) * (self.alignment.step[0].abs() + 1.0);
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
    /// Samples.
    pub samples: u64,
    /// Measured samples.
    pub valid: u64,
    /// Their share.
    pub valid_share: f64,
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
    let (samples, valid_share) = (heights.grid().samples(), valid as f64 / heights.grid().samples() as f64);
    let [volume_above, volume_below] = [above, below].map(|volume| lengths.lift * volume);
    Ok(Volumes { samples, valid, valid_share, area, volume_above, volume_below })
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
