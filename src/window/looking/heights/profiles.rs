//! Profiles along a line that is drawn over a field.

use super::Spot;
use crate::heights::measure::{ProfilePoint, great_circle, profile_of_pieces, profile_on};
use crate::heights::model::{Heights, Lengths};
use crate::heights::store::HeightFile;

/// Points of a profile that are kept.
const MOST_POINTS: usize = 4096;

/// A profile.
#[derive(Clone, Debug)]
pub struct Line {
    /// Which of the datasets its field is.
    pub field: usize,
    /// Its points: distance and height; NaN in a gap.
    pub points: Vec<[f64; 2]>,
    /// Where they are; none in gaps.
    pub spots: Vec<Option<Spot>>,
    /// Its length in plan, and how much of that was measured.
    pub lengths: [f64; 2],
}

/// The profile between two places: along a straight line, on a globe along the great circle.
pub(super) fn line_of(
    file: &HeightFile,
    field: usize,
    is_flat: bool,
    radius: f64,
    ends: [[f64; 2]; 2],
) -> Result<Line, String> {
    let grid = file.grid();
    let lengths = Lengths::on(grid, radius);
    let found = match is_flat {
        true => profile_on(file, &lengths, &ends),
        false => profile_of_pieces(file, &lengths, &great_circle(grid, ends)),
    };
    let found = found.map_err(|error| error.to_string())?;
    let every = found.points.len().div_ceil(MOST_POINTS).max(1);
    // Gaps and ends stay, however many points there are.
    let last = found.points.len().saturating_sub(1);
    let kept = |(index, point): &(usize, &ProfilePoint)| index % every == 0 || *index == last || point.height.is_nan();
    let points: Vec<&ProfilePoint> = found.points.iter().enumerate().filter(kept).map(|(_, point)| point).collect();
    let spots = points.iter().map(|point| {
        let [row, column] = grid.row_column([point.x, point.y]);
        (!point.height.is_nan()).then_some(Spot { row, column, height: point.height })
    });
    let spots = spots.collect();
    let points = points.iter().map(|point| [point.distance, point.height]).collect();
    Ok(Line { field, points, spots, lengths: [found.length, found.valid_length] })
}
