//! Where the samples of one field are in another: whether two fields can be subtracted, and how.

use super::difference::DifferenceError;
use crate::model::{HeightGrid, units};
use deepfield_data::model::Unit;

/// Places in samples that differ by less are one: grids that coincide.
pub const SAME: f64 = 1e-9;

/// Next to a sample in no triangle a place is on it.
pub const ON_SAMPLE: f64 = 1e-6;

/// One field's samples in the rows and columns of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Row and column in the other field of the field's first sample.
    pub first: [f64; 2],
    /// What a row and a column of the field are there.
    pub step: [f64; 2],
    /// From the other field's unit of heights to the field's own.
    pub factor: f64,
}

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

impl Alignment {
    /// Of a field's grid in that of another, with names of both for messages.
    ///
    /// # Errors
    /// Where units are not known to be lengths of both, or reference systems differ, or the fields have nothing in common.
    pub fn new(
        [name, other_name]: [&str; 2],
        own: &HeightGrid,
        other: &HeightGrid,
    ) -> Result<Alignment, DifferenceError> {
        let unlike = |field, found, expected: &str| DifferenceError::Unlike {
            before: name.into(),
            after: other_name.into(),
            field,
            found,
            expected: expected.into(),
        };
        let units = |one: &Unit, other: &Unit| format!("{} and {}", named(one), named(other));
        let Some(place) = factor(&own.xy_unit, &other.xy_unit) else {
            return Err(unlike(
                "unit of x and y",
                units(&own.xy_unit, &other.xy_unit),
                "lengths in both, or degrees in both (--xy-unit)",
            ));
        };
        let Some(factor) = factor(&other.height_unit, &own.height_unit) else {
            return Err(unlike(
                "unit of heights",
                units(&own.height_unit, &other.height_unit),
                "lengths in both (--height-unit)",
            ));
        };
        if let (Some(one), Some(another)) = (&own.crs, &other.crs)
            && one != another
        {
            let expected = "one reference system in both: reproject one of them first, or export it without its system (select -o FILE.asc)";
            return Err(unlike("CRS", format!("{one} and {another}"), expected));
        }
        let first = other.row_column([own.origin[0] * place, own.origin[1] * place]);
        let step = [own.step[1] * place / other.step[1], own.step[0] * place / other.step[0]];
        let found = Alignment { first, step, factor };
        let last = [found.place(0, own.rows - 1), found.place(1, own.columns - 1)];
        let size = [(other.rows - 1) as f64, (other.columns - 1) as f64];
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
            let found = format!("{} and {}", extent(own, 1.0), extent(other, 1.0 / place));
            return Err(unlike(
                "places",
                found,
                "fields that overlap (--spacing and --xy-unit say how far samples are apart)",
            ));
        }
        Ok(found)
    }

    /// The row (axis 0) or column (1) in the other field of one of the field's own.
    pub fn place(&self, axis: usize, number: u64) -> f64 {
        self.first[axis] + number as f64 * self.step[axis]
    }

    /// How far rows and columns are shifted, where the grids coincide along rows and columns of so many samples.
    pub fn shift(&self, [rows, columns]: [u64; 2]) -> Option<[i64; 2]> {
        let is_whole = |axis: usize, count: u64| {
            let (first, step) = (self.first[axis], self.step[axis]);
            (first - first.round()).abs() <= SAME && (step - 1.0).abs() * count as f64 <= SAME
        };
        (is_whole(0, rows) && is_whole(1, columns)).then(|| self.first.map(|place| place.round() as i64))
    }
}
