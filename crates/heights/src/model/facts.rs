//! What a field's samples say of themselves: how many were measured, how many of these are in no triangle, and their heights.

use super::{HeightError, HeightGrid, Heights, Window};
use rayon::prelude::*;
use serde::Serialize;

/// Samples that were not measured, by what stands in their place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Invalid {
    /// What the format or the user declares as no data.
    pub no_data: u64,
    /// Not a number.
    pub nan: u64,
    /// Infinite.
    pub infinite: u64,
}

impl Invalid {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.no_data + self.nan + self.infinite
    }

    /// These and others.
    pub fn and(self, other: Invalid) -> Invalid {
        Invalid {
            no_data: self.no_data + other.no_data,
            nan: self.nan + other.nan,
            infinite: self.infinite + other.infinite,
        }
    }
}

/// What the samples of a field say.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Facts {
    /// Samples that were measured.
    pub valid: u64,
    /// Measured samples that are in no triangle.
    pub lone: u64,
    /// The least height; NaN without any.
    pub min: f64,
    /// The largest height.
    pub max: f64,
    /// The mean of all heights.
    pub mean: f64,
}

/// Rows that are read at once are about so many samples.
const BAND: u64 = 1 << 18;

/// What some rows say.
#[derive(Default)]
struct Part {
    valid: u64,
    lone: u64,
    min: f64,
    max: f64,
    /// Of each row.
    sums: Vec<f64>,
}

/// Reads all samples and says what they are. Sums go row by row, so that they are the same whatever is read at once, by however many threads.
///
/// # Errors
/// Where they cannot be read.
pub fn facts_of(heights: &dyn Heights) -> Result<Facts, HeightError> {
    let read = |window: Window, out: &mut [f64]| heights.stored(window, out);
    Ok(facts_by(heights.grid(), read, |_, _| ())?.0)
}

/// The same of stored samples that `read` gives for whole rows, NaN where nothing was measured. `see` looks at each row's samples once, after they were read
/// and before they count, and may change them; what it gives is told in the rows' order, one for about [`BAND`] samples.
///
/// # Errors
/// Those of `read`.
pub fn facts_by<S: Send, E: Send>(
    grid: &HeightGrid,
    read: impl Fn(Window, &mut [f64]) -> Result<(), E> + Sync,
    see: impl Fn(&mut [f64], bool) -> S + Sync,
) -> Result<(Facts, Vec<S>), E> {
    let width = grid.columns as usize;
    let rows_of_band = (BAND / grid.columns).max(8).min(grid.rows);
    let bands = grid.rows.div_ceil(rows_of_band);
    let band = |number: u64| {
        let (first, end) = (number * rows_of_band, ((number + 1) * rows_of_band).min(grid.rows));
        // A row more on either side says which of these are lone.
        let (from, to) = (first.saturating_sub(1), (end + 1).min(grid.rows));
        let mut values = vec![0.0; (to - from) as usize * width];
        read(Window::rows(grid, from, to - from), &mut values)?;
        let (before, after) = ((first - from) as usize * width, (end - from) as usize * width);
        see(&mut values[..before], false);
        see(&mut values[after..], false);
        let seen = see(&mut values[before..after], true);
        Ok((part_of(&values, width, before / width, after / width), seen))
    };
    // A few bands of each thread at once: no more are held.
    let mut total = Part { min: f64::INFINITY, max: f64::NEG_INFINITY, ..Part::default() };
    let mut all_seen = Vec::new();
    let mut sum = 0.0;
    let at_once = 4 * rayon::current_num_threads() as u64;
    let mut number = 0;
    while number < bands {
        let next = (number + at_once).min(bands);
        let parts: Vec<(Part, S)> = (number..next).into_par_iter().map(band).collect::<Result<_, E>>()?;
        for (part, seen) in parts {
            total.valid += part.valid;
            total.lone += part.lone;
            (total.min, total.max) = (total.min.min(part.min), total.max.max(part.max));
            part.sums.iter().for_each(|row| sum += row);
            all_seen.push(seen);
        }
        number = next;
    }
    let Part { valid, lone, min, max, .. } = total;
    if valid == 0 {
        return Ok((Facts { valid, lone, min: f64::NAN, max: f64::NAN, mean: f64::NAN }, all_seen));
    }
    // Heights are linear in stored samples: the ends of their range and the mean are scaled once.
    let ends = [min, max].map(|stored| grid.scale.value(stored));
    let mean = grid.scale.value(sum / valid as f64);
    Ok((Facts { valid, lone, min: ends[0].min(ends[1]), max: ends[0].max(ends[1]), mean }, all_seen))
}

/// What the rows from `first` to before `end` say, of rows that hold their neighbours too.
fn part_of(values: &[f64], width: usize, first: usize, end: usize) -> Part {
    let rows: Vec<&[f64]> = values.chunks_exact(width).collect();
    // Of each row, whether every sample was measured.
    let full: Vec<bool> = rows.iter().map(|row| !row.iter().any(|height| height.is_nan())).collect();
    let mut part = Part { min: f64::INFINITY, max: f64::NEG_INFINITY, ..Part::default() };
    let mut used = vec![false; width];
    for row in first..end {
        let here = rows[row];
        let mut sum = 0.0;
        let mut valid = 0;
        for height in here.iter().filter(|height| !height.is_nan()) {
            part.min = if *height < part.min { *height } else { part.min };
            part.max = if *height > part.max { *height } else { part.max };
            sum += height;
            valid += 1;
        }
        part.sums.push(sum);
        part.valid += valid;
        let neighbours = [row.checked_sub(1), Some(row + 1).filter(|next| *next < rows.len())];
        // Whole rows of measured samples are the usual case, and need no look at cells.
        if full[row] && neighbours.iter().flatten().any(|next| full[*next]) {
            continue;
        }
        used.fill(false);
        for next in neighbours.into_iter().flatten() {
            let there = rows[next];
            for column in 0..width - 1 {
                let corners = [here[column], here[column + 1], there[column], there[column + 1]];
                if corners.iter().filter(|corner| !corner.is_nan()).count() >= 3 {
                    (used[column], used[column + 1]) = (true, true);
                }
            }
        }
        part.lone += here.iter().zip(&used).filter(|(height, used)| !height.is_nan() && !**used).count() as u64;
    }
    part
}
