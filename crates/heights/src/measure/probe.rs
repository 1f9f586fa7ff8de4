//! What a field says of one place.

use super::tiles::{OnSurface, Tiles};
use crate::model::{HeightError, Heights, Lengths, Window};
use serde::Serialize;

/// A measured sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Its row.
    pub row: u64,
    /// Its column.
    pub column: u64,
    /// Its place.
    pub x: f64,
    /// Its place.
    pub y: f64,
    /// Its height, in the unit of heights.
    pub height: f64,
    /// How far it is from the place that was asked for, in plan, as [`Lengths`] has it.
    pub distance: f64,
}

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Probe {
    /// The row, with fraction.
    pub row: f64,
    /// The column, with fraction.
    pub column: f64,
    /// The place.
    pub x: f64,
    /// The place.
    pub y: f64,
    /// T's height; `None` where there is no surface, or beside the field.
    pub height: Option<f64>,
    /// How steep T is: height per length, as [`Lengths`] has both.
    pub slope: Option<f64>,
    /// The direction downhill, degrees from the y axis's positive end over the x axis's; `None` where it is level or not measured.
    pub aspect: Option<f64>,
    /// Where there is no surface: the nearest measured sample; `None` when there is none at all.
    pub nearest: Option<Sample>,
}

/// What is at a place between samples.
///
/// # Errors
/// Where the field cannot be read.
pub fn probe_sample(heights: &dyn Heights, lengths: &Lengths, row: f64, column: f64) -> Result<Probe, HeightError> {
    let grid = heights.grid();
    let [x, y] = grid.place(row, column);
    let mut found = Probe { row, column, x, y, height: None, slope: None, aspect: None, nearest: None };
    match Tiles::new(heights).triangle(row, column)? {
        Some(on) => {
            let [across, along] = gradient(lengths, row, &on);
            found.height = Some(on.height());
            found.slope = Some(across.hypot(along));
            found.aspect =
                (across != 0.0 || along != 0.0).then(|| (-across).atan2(-along).to_degrees().rem_euclid(360.0));
        }
        None => {
            found.nearest = nearest(heights, lengths, row, column)?;
            // A sample in no triangle is no surface, and yet a height at its very place.
            found.height = found.nearest.filter(|sample| sample.distance == 0.0).map(|sample| sample.height);
        }
    }
    Ok(found)
}

/// What is at a place in x and y; degrees are those of the Earth.
///
/// # Errors
/// Where the field cannot be read.
pub fn probe(heights: &dyn Heights, place: [f64; 2]) -> Result<Probe, HeightError> {
    probe_on(heights, &Lengths::of(heights.grid()), place)
}

/// What is at a place in x and y; in degrees some turns further, too.
///
/// # Errors
/// Where the field cannot be read.
pub fn probe_on(heights: &dyn Heights, lengths: &Lengths, [x, y]: [f64; 2]) -> Result<Probe, HeightError> {
    let grid = heights.grid();
    let [row, column] = grid.row_column([grid.in_turn(x), y]);
    Ok(Probe { x, y, ..probe_sample(heights, lengths, row, column)? })
}

/// T's changes along x and y at a row: height per length.
pub fn gradient(lengths: &Lengths, row: f64, on: &OnSurface) -> [f64; 2] {
    let [_, across, along] = on.triangle.at;
    let [x, y] = lengths.steps(row);
    [lengths.lift * across / x, lengths.lift * along / y]
}

/// So many samples are read at once.
const AT_ONCE: u64 = 1 << 18;

/// The measured sample nearest to a place in plan, where degrees are as long as at that place; the first in order of rows and columns among
/// equals. Looks at growing rectangles about the place.
///
/// # Errors
/// Where the field cannot be read.
pub fn nearest(heights: &dyn Heights, lengths: &Lengths, row: f64, column: f64) -> Result<Option<Sample>, HeightError> {
    let grid = heights.grid();
    if !row.is_finite() || !column.is_finite() {
        return Ok(None);
    }
    let step = lengths.steps(row).map(f64::abs);
    let last = [(grid.columns - 1) as f64, (grid.rows - 1) as f64];
    let beside = [column - column.clamp(0.0, last[0]), row - row.clamp(0.0, last[1])];
    // Up to the field itself nothing is found.
    let mut reach = (beside[0] * step[0]).hypot(beside[1] * step[1]) + 4.0 * step[0].max(step[1]);
    loop {
        let span = |place: f64, step: f64, last: f64| {
            let (low, high) =
                ((place - reach / step).ceil().clamp(0.0, last), (place + reach / step).floor().clamp(0.0, last));
            (low as u64, high as u64)
        };
        let ((left, right), (first, bottom)) = (span(column, step[0], last[0]), span(row, step[1], last[1]));
        let best = nearest_in(heights, step, [row, column], [left, right], [first, bottom])?;
        let is_all = left == 0 && first == 0 && right + 1 == grid.columns && bottom + 1 == grid.rows;
        // What lies outside of the rectangle is farther than its reach.
        if is_all || best.is_some_and(|sample| sample.distance <= reach) {
            return Ok(best);
        }
        reach *= 2.0;
    }
}

fn nearest_in(
    heights: &dyn Heights,
    step: [f64; 2],
    [row, column]: [f64; 2],
    [left, right]: [u64; 2],
    [first, bottom]: [u64; 2],
) -> Result<Option<Sample>, HeightError> {
    let grid = heights.grid();
    let columns = right.saturating_sub(left) + 1;
    let mut best: Option<Sample> = None;
    let mut values = Vec::new();
    let mut at = first;
    while at <= bottom {
        let rows = (AT_ONCE / columns).max(1).min(bottom - at + 1);
        let window = Window { row: at, column: left, rows, columns };
        values.resize(window.samples() as usize, 0.0);
        heights.heights(window, &mut values)?;
        for (number, &height) in values.iter().enumerate().filter(|(_, height)| !height.is_nan()) {
            let (sample_row, sample_column) = (at + number as u64 / columns, left + number as u64 % columns);
            let (down, across) = ((sample_row as f64 - row) * step[1], (sample_column as f64 - column) * step[0]);
            let distance = down.hypot(across);
            if best.is_none_or(|sample| distance < sample.distance) {
                let [x, y] = grid.place(sample_row as f64, sample_column as f64);
                best = Some(Sample { row: sample_row, column: sample_column, x, y, height, distance });
            }
        }
        at += rows;
    }
    Ok(best)
}
