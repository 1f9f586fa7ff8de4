//! What a field's samples say of themselves: how many were measured, how many of these are in no triangle, and their heights.

use super::{HeightError, Heights, Window};
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
const BAND: u64 = 1 << 20;

/// Reads all samples and says what they are. Sums go row by row, so that they are the same whatever is read at once.
///
/// # Errors
/// Where they cannot be read.
pub fn facts_of(heights: &dyn Heights) -> Result<Facts, HeightError> {
    let grid = heights.grid();
    let width = grid.columns as usize;
    let (mut valid, mut lone, mut sum) = (0_u64, 0_u64, 0.0_f64);
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    let band = (BAND / grid.columns).clamp(1, grid.rows);
    // Which of the row before were measured, and which of them are in a triangle with what came before.
    let mut above: Vec<bool> = Vec::new();
    let mut used_above: Vec<bool> = Vec::new();
    let mut values = Vec::new();
    let lone_of = |is_valid: &[bool], used: &[bool]| is_valid.iter().zip(used).filter(|(valid, used)| **valid && !**used).count() as u64;
    let mut row = 0;
    while row < grid.rows {
        let rows = band.min(grid.rows - row);
        values.resize(rows as usize * width, 0.0);
        heights.heights(Window::rows(grid, row, rows), &mut values)?;
        for line in values.chunks_exact(width) {
            let here: Vec<bool> = line.iter().map(|height| !height.is_nan()).collect();
            let mut used = vec![false; width];
            let mut line_sum = 0.0;
            for height in line.iter().filter(|height| !height.is_nan()) {
                (min, max) = (min.min(*height), max.max(*height));
                line_sum += height;
                valid += 1;
            }
            sum += line_sum;
            if !above.is_empty() {
                for column in 0..width - 1 {
                    let corners = [above[column], above[column + 1], here[column], here[column + 1]];
                    if corners.iter().filter(|corner| **corner).count() >= 3 {
                        (used_above[column], used_above[column + 1]) = (true, true);
                        (used[column], used[column + 1]) = (true, true);
                    }
                }
                lone += lone_of(&above, &used_above);
            }
            (above, used_above) = (here, used);
        }
        row += rows;
    }
    lone += lone_of(&above, &used_above);
    let none = f64::NAN;
    Ok(match valid {
        0 => Facts { valid, lone, min: none, max: none, mean: none },
        _ => Facts { valid, lone, min, max, mean: sum / valid as f64 },
    })
}
