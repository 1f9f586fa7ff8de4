//! Positions from the columns of a table: `x, y, z`, or right ascension, declination and a distance or parallax.
//!
//! Equatorial coordinates become `d (cos dec cos ra, cos dec sin ra, sin dec)`. A table without any distance is placed on
//! the unit sphere. In one with distances a star that has none (a parallax that is not positive) has no position.

use super::columns::Column;
use crate::model::Unit;

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
const RA: [&str; 4] = ["ra", "ra_deg", "raj2000", "right_ascension"];
const DEC: [&str; 5] = ["dec", "dec_deg", "dej2000", "decj2000", "declination"];
const DISTANCE: [&str; 3] = ["dist", "distance", "dist_pc"];
const PARALLAX: [&str; 3] = ["parallax", "plx", "parallax_mas"];

/// Whether positions may be made of a column of that name, so that it must hold numbers.
pub(super) fn is_needed(key: &str) -> bool {
    let lists: [&[&str]; 5] = [&AXES, &RA, &DEC, &DISTANCE, &PARALLAX];
    lists.iter().any(|names| names.contains(&key))
}

fn find<'a>(columns: &'a [Column], names: &[&str]) -> Option<&'a Column> {
    names.iter().find_map(|name| columns.iter().find(|column| column.key() == *name))
}

/// The positions of a table; `None` if it has neither kind of columns.
pub(super) fn positions(columns: &[Column]) -> Option<Positions> {
    cartesian(columns).or_else(|| equatorial(columns))
}

fn cartesian(columns: &[Column]) -> Option<Positions> {
    let [x, y, z] = AXES.map(|name| find(columns, &[name]));
    let (x, y, z) = (x?, y?, z?);
    let values = x.values.iter().zip(&y.values).zip(&z.values).map(|((x, y), z)| [*x, *y, *z]).collect();
    let parsecs = x.unit.is_empty() && in_parsecs(columns);
    let note = parsecs.then(|| "lengths are in pc: absolute magnitude = magnitude - 5 log10(dist / 10 pc)".to_string());
    let unit = Unit::new(if parsecs { "pc" } else { &x.unit });
    Some(Positions { values, unit, stored_as: "x,y,z".into(), note, from_sky: false })
}

/// Whether distances are in parsecs, which shows where both the apparent and the absolute magnitude are there.
fn in_parsecs(columns: &[Column]) -> bool {
    let (Some(distance), Some(apparent), Some(absolute)) =
        (find(columns, &DISTANCE), find(columns, &["mag"]), find(columns, &["absmag"]))
    else {
        return false;
    };
    let rows = distance.values.iter().zip(&apparent.values).zip(&absolute.values);
    let differences = rows.map(|((d, m), absolute)| (absolute - (m - 5.0 * (d / 10.0).log10())).abs());
    let (count, close) = differences
        .filter(|difference| difference.is_finite())
        .fold((0, 0), |(count, close), d| (count + 1, close + usize::from(d < 0.01)));
    count > 0 && 10 * close >= 9 * count
}

fn equatorial(columns: &[Column]) -> Option<Positions> {
    let (ra, dec) = (find(columns, &RA)?, find(columns, &DEC)?);
    let mut notes = Vec::new();
    let largest = ra.values.iter().copied().filter(|ra| ra.is_finite()).fold(0.0, f64::max);
    let hours = ra.unit.starts_with('h') || (ra.unit.is_empty() && largest <= 24.0 && ra.values.len() > 100);
    if hours && ra.unit.is_empty() {
        notes.push("right ascensions up to 24 are taken for hours".to_string());
    }
    let degrees = if hours { 15.0 } else { 1.0 };
    let (distances, unit, source) = if let Some(distance) = find(columns, &DISTANCE) {
        (distance.values.clone(), distance.unit.clone(), distance.name.as_str())
    } else if let Some(parallax) = find(columns, &PARALLAX) {
        let distance = |parallax: &f64| if *parallax > 0.0 { 1000.0 / parallax } else { f64::NAN };
        (parallax.values.iter().map(distance).collect(), "pc".into(), parallax.name.as_str())
    } else {
        notes.push("no distances: positions are directions on the unit sphere".into());
        (vec![1.0; ra.values.len()], String::new(), "")
    };
    let without = distances.iter().filter(|distance| !distance.is_finite()).count();
    if without > 0 {
        notes.push(format!("{without} stars have no distance and so no position"));
    }
    let place = |((ra, dec), distance): ((&f64, &f64), &f64)| {
        let (sin_ra, cos_ra) = (ra * degrees).to_radians().sin_cos();
        let (sin_dec, cos_dec) = dec.to_radians().sin_cos();
        [distance * cos_dec * cos_ra, distance * cos_dec * sin_ra, distance * sin_dec]
    };
    let values = ra.values.iter().zip(&dec.values).zip(&distances).map(place).collect();
    let mut stored_as = format!("{},{}", ra.name, dec.name);
    if !source.is_empty() {
        stored_as = format!("{stored_as},{source}");
    }
    let note = (!notes.is_empty()).then(|| notes.join("; "));
    Some(Positions { values, unit: Unit::new(unit), stored_as, note, from_sky: true })
}
