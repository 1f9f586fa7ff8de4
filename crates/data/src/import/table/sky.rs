//! Positions from the columns of a table: `x, y, z`, or right ascension, declination and a distance or parallax.
//!
//! Equatorial coordinates become `d (cos dec cos ra, cos dec sin ra, sin dec)`. A table without any distance is placed on
//! the unit sphere. In one with distances a star that has none (a parallax that is not positive) has no position.
//!
//! A unit stands in brackets or behind the name (`dist [kpc]`, `dist_kpc`). One that is not known is an error: these columns
//! say where things are.

use super::columns::Column;
use crate::import::units::{conversion, degrees, degrees_of, length, length_of};
use crate::import::{ImportError, units};
use crate::model::Unit;
use std::path::Path;

/// What a table's positions are.
pub(super) struct Positions {
    /// One per row; NaN where there is none.
    pub values: Vec<[f64; 3]>,
    /// Their unit.
    pub unit: Unit,
    /// Names of the columns they come from.
    pub stored_as: String,
    /// What was assumed.
    pub note: Option<String>,
    /// Whether they were made of directions on the sky.
    pub from_sky: bool,
}

const AXES: [&str; 3] = ["x", "y", "z"];
const RA: [&str; 3] = ["ra", "raj2000", "right_ascension"];
const DEC: [&str; 4] = ["dec", "dej2000", "decj2000", "declination"];
const DISTANCE: [&str; 2] = ["dist", "distance"];
const PARALLAX: [&str; 2] = ["parallax", "plx"];

/// What a column's unit measures.
#[derive(Clone, Copy, PartialEq)]
enum Measure {
    Length,
    Angle,
}

impl Measure {
    fn knows(self, unit: &str) -> bool {
        match self {
            Measure::Length => matches!(length(unit), Some(units::Length::Known { .. })),
            Measure::Angle => degrees(unit).is_some(),
        }
    }
}

/// Whether positions may be made of a column, so that it must hold numbers.
pub(super) fn is_needed(column: &Column) -> bool {
    let lists: [(&[&str], Measure); 5] = [
        (&AXES, Measure::Length),
        (&RA, Measure::Angle),
        (&DEC, Measure::Angle),
        (&DISTANCE, Measure::Length),
        (&PARALLAX, Measure::Angle),
    ];
    lists.iter().any(|(names, measure)| names.iter().any(|name| unit_of(column, name, *measure).is_some()))
}

/// The unit of a column if it is called `name`, or `name_UNIT` with a unit that is known.
fn unit_of<'a>(column: &'a Column, name: &str, measure: Measure) -> Option<&'a str> {
    let key = column.key();
    if key == name {
        return Some(&column.unit);
    }
    let suffix = key.strip_prefix(name).is_some_and(|rest| rest.starts_with('_'));
    let unit = column.name.get(name.len() + 1..).filter(|unit| suffix && measure.knows(unit))?;
    Some(if column.unit.is_empty() { unit } else { &column.unit })
}

/// A column that positions are made of.
struct Found<'a> {
    column: &'a Column,
    unit: &'a str,
}

/// The first column with one of the names: one of the name itself rather than one with a unit behind it.
fn find<'a>(columns: &'a [Column], names: &[&str], measure: Measure) -> Option<Found<'a>> {
    let exact = |name: &&str| columns.iter().find(|column| column.key() == *name);
    let suffixed = |name: &&str| columns.iter().find(|column| unit_of(column, name, measure).is_some());
    let column = names.iter().find_map(exact).or_else(|| names.iter().find_map(suffixed))?;
    let unit = names.iter().find_map(|name| unit_of(column, name, measure))?;
    Some(Found { column, unit })
}

/// The positions of a table; `None` if it has neither kind of columns.
///
/// # Errors
/// When a unit of such a column is not known.
pub(super) fn positions(path: &Path, columns: &[Column]) -> Result<Option<Positions>, ImportError> {
    match cartesian(path, columns)? {
        Some(positions) => Ok(Some(positions)),
        None => equatorial(path, columns),
    }
}

fn cartesian(path: &Path, columns: &[Column]) -> Result<Option<Positions>, ImportError> {
    let [x, y, z] = AXES.map(|name| find(columns, &[name], Measure::Length));
    let (Some(x), Some(y), Some(z)) = (x, y, z) else { return Ok(None) };
    let axes = [x, y, z];
    // Values keep the first unit that is stated; the other axes are brought to it.
    let mut unit = "";
    for axis in &axes {
        if length_of(path, &axis.column.name, axis.unit)? != units::Length::Code && unit.is_empty() {
            unit = axis.unit;
        }
    }
    let mut factors = [1.0; 3];
    for (factor, axis) in factors.iter_mut().zip(&axes) {
        *factor = conversion(path, &axis.column.name, axis.unit, unit)?;
    }
    let rows = axes[0].column.values.iter().zip(&axes[1].column.values).zip(&axes[2].column.values);
    let values = rows.map(|((x, y), z)| [x * factors[0], y * factors[1], z * factors[2]]).collect();
    let parsecs = unit.is_empty() && in_parsecs(columns);
    let note = parsecs.then(|| "lengths are in pc: absolute magnitude = magnitude - 5 log10(dist / 10 pc)".to_string());
    let stored_as = axes.map(|axis| &*axis.column.name).join(",");
    Ok(Some(Positions { values, unit: Unit::new(if parsecs { "pc" } else { unit }), stored_as, note, from_sky: false }))
}

/// Whether distances are in parsecs, which shows where both the apparent and the absolute magnitude are there.
fn in_parsecs(columns: &[Column]) -> bool {
    let of = |key: &str| columns.iter().find(|column| column.key() == key);
    let (Some(distance), Some(apparent), Some(absolute)) =
        (find(columns, &DISTANCE, Measure::Length), of("mag"), of("absmag"))
    else {
        return false;
    };
    let rows = distance.column.values.iter().zip(&apparent.values).zip(&absolute.values);
    let differences = rows.map(|((d, m), absolute)| (absolute - (m - 5.0 * (d / 10.0).log10())).abs());
    let (count, close) = differences
        .filter(|difference| difference.is_finite())
        .fold((0, 0), |(count, close), d| (count + 1, close + usize::from(d < 0.01)));
    count > 0 && 10 * close >= 9 * count
}

fn equatorial(path: &Path, columns: &[Column]) -> Result<Option<Positions>, ImportError> {
    let (Some(ra), Some(dec)) = (find(columns, &RA, Measure::Angle), find(columns, &DEC, Measure::Angle)) else {
        return Ok(None);
    };
    let mut notes = Vec::new();
    let largest = ra.column.values.iter().copied().filter(|ra| ra.is_finite()).fold(0.0, f64::max);
    let stated = !ra.unit.is_empty() && !units::is_frame(ra.unit);
    let hours = !stated && largest <= 24.0 && ra.column.values.len() > 100;
    if hours {
        notes.push("right ascensions up to 24 are taken for hours".to_string());
    }
    let ra_degrees = degrees_of(path, &ra.column.name, ra.unit, if hours { 15.0 } else { 1.0 })?;
    let dec_degrees = degrees_of(path, &dec.column.name, dec.unit, 1.0)?;
    let (distances, unit, source) = if let Some(distance) = find(columns, &DISTANCE, Measure::Length) {
        let known = length_of(path, &distance.column.name, distance.unit)? != units::Length::Code;
        (distance.column.values.clone(), if known { distance.unit } else { "" }, &*distance.column.name)
    } else if let Some(parallax) = find(columns, &PARALLAX, Measure::Angle) {
        let per_mas = degrees_of(path, &parallax.column.name, parallax.unit, MILLIARCSECOND)? / MILLIARCSECOND;
        let distance = |parallax: &f64| if *parallax > 0.0 { 1000.0 / (parallax * per_mas) } else { f64::NAN };
        (parallax.column.values.iter().map(distance).collect(), "pc", &*parallax.column.name)
    } else {
        notes.push("no distances: positions are directions on the unit sphere".into());
        (vec![1.0; ra.column.values.len()], "", "")
    };
    let without = distances.iter().filter(|distance| !distance.is_finite()).count();
    if without > 0 {
        notes.push(format!("{without} stars have no distance and so no position"));
    }
    let place = |((ra, dec), distance): ((&f64, &f64), &f64)| {
        let (sin_ra, cos_ra) = (ra * ra_degrees).to_radians().sin_cos();
        let (sin_dec, cos_dec) = (dec * dec_degrees).to_radians().sin_cos();
        [distance * cos_dec * cos_ra, distance * cos_dec * sin_ra, distance * sin_dec]
    };
    let values = ra.column.values.iter().zip(&dec.column.values).zip(&distances).map(place).collect();
    let mut stored_as = format!("{},{}", ra.column.name, dec.column.name);
    if !source.is_empty() {
        stored_as = format!("{stored_as},{source}");
    }
    let note = (!notes.is_empty()).then(|| notes.join("; "));
    Ok(Some(Positions { values, unit: Unit::new(unit), stored_as, note, from_sky: true }))
}

/// Degrees.
const MILLIARCSECOND: f64 = 1.0 / 3.6e6;
