//! The attributes that NetCDF's climate and forecast conventions give variables (<https://cfconventions.org>), in NetCDF files of any
//! version and on HDF5 data sets.

use crate::model::{Channel, Grid, SampleType, Scale, Unit};
use glam::DVec3;

/// How far coordinates may lie from even ones, in steps, and relative to the largest of them, as they may be single precision.
const UNEVEN: f64 = 1e-3;
const ROUNDED: f64 = 1e-6;

/// Attributes of a variable.
pub(super) trait About {
    /// The numbers of an attribute, where it has some.
    fn numbers(&self, name: &str) -> Option<Vec<f64>>;

    /// An attribute that is text.
    fn text(&self, name: &str) -> Option<String>;

    /// The first number of an attribute.
    fn number(&self, name: &str) -> Option<f64> {
        self.numbers(name)?.first().copied()
    }
}

/// The channel of a variable: its name, unit, scale, and the stored value that stands for none.
pub(super) fn channel(name: &str, about: &dyn About) -> Channel {
    let mut channel = Channel::new(name);
    let one_line = |text: String| text.chars().filter(|c| !c.is_control()).take(100).collect::<String>();
    channel.unit = Unit::new(about.text("units").map(one_line).unwrap_or_default().trim());
    let number = |name: &str, usual: f64| about.number(name).filter(|value| value.is_finite()).unwrap_or(usual);
    let slope = number("scale_factor", Scale::NONE.slope);
    let slope = if slope == 0.0 { Scale::NONE.slope } else { slope };
    channel.scale = Scale { slope, intercept: number("add_offset", Scale::NONE.intercept) };
    // NaN is counted as such.
    channel.no_data =
        about.number("_FillValue").or_else(|| about.number("missing_value")).filter(|value| !value.is_nan());
    channel
}

/// The type of stored bytes that an older version of NetCDF could not say: with `_Unsigned` they have no sign.
pub(super) fn unsigned(kind: SampleType, about: &dyn About) -> SampleType {
    let is_unsigned = about.text("_Unsigned").is_some_and(|text| text.eq_ignore_ascii_case("true"));
    if is_unsigned && !kind.is_float() { SampleType::whole(kind.size(), false).unwrap_or(kind) } else { kind }
}

/// Names that the attributes `coordinates` and `bounds` of a variable list: those variables say where this one is.
pub(super) fn helpers(about: &dyn About) -> Vec<String> {
    let lists =
        ["coordinates", "bounds", "ancillary_variables", "grid_mapping"].iter().filter_map(|name| about.text(name));
    lists.flat_map(|list| list.split_whitespace().map(str::to_owned).collect::<Vec<_>>()).collect()
}

/// The coordinates of the samples along an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Coordinates {
    /// The variable's name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The values.
    pub values: Vec<f64>,
}

impl Coordinates {
    /// The first value and the step from each to the next; `None` where steps differ.
    fn even(&self) -> Option<(f64, f64)> {
        let (first, last) = (*self.values.first()?, *self.values.last()?);
        let steps = self.values.len() - 1;
        let step = if steps == 0 { 1.0 } else { (last - first) / steps as f64 };
        let most = UNEVEN * step.abs() + ROUNDED * first.abs().max(last.abs());
        let near = |(index, value): (usize, &f64)| (value - (first + step * index as f64)).abs() <= most;
        let is_even = step != 0.0 && step.is_finite() && first.is_finite() && self.values.iter().enumerate().all(near);
        is_even.then_some((first, step))
    }
}

/// Puts the samples to where their coordinates are, along each axis (x, y, z) that has evenly spaced ones, and says of the others why not.
pub(super) fn place(grid: &mut Grid, axes: &[Option<Coordinates>], notes: &mut Vec<String>) {
    let mut units: Vec<(String, String)> = Vec::new();
    let mut placed = 0;
    for (axis, coordinates) in axes.iter().enumerate().take(grid.dimensions) {
        let Some(coordinates) = coordinates.as_ref().filter(|found| found.values.len() as u64 == grid.shape[axis])
        else {
            continue;
        };
        let name = &coordinates.name;
        // Years and hours are no lengths.
        if coordinates.unit.contains(" since ") {
            notes.push(format!("{name} is time: samples along it are taken as 1 apart"));
            continue;
        }
        let Some((first, step)) = coordinates.even() else {
            notes.push(format!("coordinates {name} are not evenly spaced: samples along them are taken as 1 apart"));
            continue;
        };
        *grid.to_world.matrix3.col_mut(axis) = DVec3::AXES[axis] * step;
        grid.to_world.translation[axis] = first;
        placed += 1;
        units.push((name.clone(), plain(&coordinates.unit)));
    }
    let Some((_, unit)) = units.first().cloned() else { return };
    if units.iter().all(|(_, other)| *other == unit) {
        // What was not placed is 1 apart, in nobody's unit.
        if placed == grid.dimensions {
            grid.length_unit = Unit::new(unit);
        }
    } else {
        let listed: Vec<String> = units
            .iter()
            .map(|(name, unit)| if unit.is_empty() { name.clone() } else { format!("{name} in {unit}") })
            .collect();
        notes.push(format!("lengths have different units along the axes: {}", listed.join(", ")));
    }
}

/// A unit without the direction that the conventions put into its name.
fn plain(unit: &str) -> String {
    let unit: String = unit.trim().chars().filter(|c| !c.is_control()).take(60).collect();
    if unit.to_lowercase().starts_with("degree") && !unit.contains(char::is_whitespace) {
        "degrees".into()
    } else {
        unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along(name: &str, unit: &str, values: &[f64]) -> Option<Coordinates> {
        Some(Coordinates { name: name.into(), unit: unit.into(), values: values.to_vec() })
    }

    #[test]
    fn even_coordinates_are_places_and_others_are_told_of() {
        let mut grid = Grid::image([3, 2], SampleType::F32, Channel::numbered(1));
        let mut notes = Vec::new();
        let axes = [along("lon", "degrees_east", &[10.0, 10.5, 11.0]), along("lat", "degrees_north", &[50.0, 49.0])];
        place(&mut grid, &axes, &mut notes);
        let at = grid.to_world.transform_point3(DVec3::new(2.0, 1.0, 0.0));
        assert_eq!((at, grid.length_unit.clone(), notes.len()), (DVec3::new(11.0, 49.0, 0.0), Unit::new("degrees"), 0));
        assert_eq!(grid.spacing(), [0.5, 1.0]);

        let mut grid = Grid::volume([3, 2, 3], SampleType::F32, Channel::numbered(1));
        let axes =
            [along("x", "km", &[0.0, 2.0, 4.0]), along("y", "m", &[0.0, 1.0]), along("z", "m", &[0.0, 1.0, 3.0])];
        place(&mut grid, &axes, &mut notes);
        assert_eq!(grid.spacing(), [2.0, 1.0, 1.0]);
        assert!(notes[0].contains("z are not evenly") && notes[1].ends_with("x in km, y in m"), "{notes:?}");
        assert!(grid.length_unit.is_unknown());
        // Nothing, one value, and values of which some are none.
        assert_eq!(along("x", "", &[]).unwrap().even(), None);
        assert_eq!(along("x", "", &[7.0]).unwrap().even(), Some((7.0, 1.0)));
        for wrong in [[1.0, f64::NAN, 3.0], [1.0, 1.0, 1.0], [f64::NEG_INFINITY, 0.0, f64::INFINITY]] {
            assert_eq!(along("x", "", &wrong).unwrap().even(), None);
        }
    }
}
