//! Positions from the columns of a table: `x, y, z`, one column of three numbers, or right ascension, declination and a distance or parallax.
//!
//! Equatorial coordinates become `d (cos dec cos ra, cos dec sin ra, sin dec)`. A table without any distance is placed on
//! the unit sphere. In one with distances a star that has none (a negative one, a parallax that is not positive) has no position.
//!
//! A unit stands in brackets or behind the name (`dist [kpc]`, `dist_kpc`). One that is not known is an error: these columns
//! say where things are.

use super::columns::{Column, Table};
use crate::import::check::chunks;
use crate::import::hdf5::{POSITIONS, VELOCITIES};
use crate::import::units::{conversion, degrees, degrees_of, length, length_of};
use crate::import::{ImportError, units};
use crate::model::Unit;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;

/// What a table's positions are.
pub(super) struct Positions {
    /// What they are made of.
    pub recipe: Recipe,
    /// Their unit.
    pub unit: Unit,
    /// Names of the columns they come from.
    pub stored_as: String,
    /// What was assumed.
    pub note: Option<String>,
}

/// What positions are made of; columns are indices.
pub(super) enum Recipe {
    /// Columns of coordinates, and what each is multiplied by.
    Cartesian {
        /// The columns.
        axes: [usize; 3],
        /// The factors that bring them to one unit.
        factors: [f64; 3],
    },
    /// A column of three coordinates.
    Vector(usize),
    /// Directions on the sky, and how far away.
    Equatorial {
        /// Right ascension and declination.
        angles: [usize; 2],
        /// What one of each is in degrees.
        degrees: [f64; 2],
        /// How far away.
        distance: Distance,
    },
}

/// How far away a star is.
pub(super) enum Distance {
    /// Nobody says: 1.
    Unknown,
    /// What the column says.
    Column(usize),
    /// 1000 / parallax, which is multiplied with the factor to be in milliarcseconds.
    Parallax(usize, f64),
}

impl Distance {
    fn of(&self, value: f64) -> f64 {
        match self {
            Distance::Unknown => 1.0,
            Distance::Column(_) if value >= 0.0 => value,
            Distance::Parallax(_, per_mas) if value > 0.0 => 1000.0 / (value * per_mas),
            // One over a parallax that noise has made negative, among others: it would stand on the other side of the sky.
            Distance::Column(_) | Distance::Parallax(..) => f64::NAN,
        }
    }

    fn column(&self) -> Option<usize> {
        match self {
            Distance::Unknown => None,
            Distance::Column(column) | Distance::Parallax(column, _) => Some(*column),
        }
    }
}

impl Recipe {
    /// Reads positions, three numbers for each row; NaN where there is none.
    ///
    /// # Errors
    /// When the table cannot be read.
    pub(super) fn read(&self, table: &dyn Table, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        match self {
            Recipe::Vector(column) => table.read(*column, rows, out)?,
            Recipe::Cartesian { axes, factors } => {
                let out = out.as_chunks_mut::<3>().0;
                let mut values = vec![0.0; out.len()];
                for (axis, (column, factor)) in axes.iter().zip(factors).enumerate() {
                    table.read(*column, rows.clone(), &mut values)?;
                    out.iter_mut().zip(&values).for_each(|(position, value)| position[axis] = value * factor);
                }
            }
            Recipe::Equatorial { angles, degrees, distance } => {
                let out = out.as_chunks_mut::<3>().0;
                let mut columns = [vec![0.0; out.len()], vec![0.0; out.len()], vec![1.0; out.len()]];
                table.read(angles[0], rows.clone(), &mut columns[0])?;
                table.read(angles[1], rows.clone(), &mut columns[1])?;
                if let Some(column) = distance.column() {
                    table.read(column, rows, &mut columns[2])?;
                }
                let [ra, dec, far] = &columns;
                for (position, ((ra, dec), far)) in out.iter_mut().zip(ra.iter().zip(dec).zip(far)) {
                    let (sin_ra, cos_ra) = (ra * degrees[0]).to_radians().sin_cos();
                    let (sin_dec, cos_dec) = (dec * degrees[1]).to_radians().sin_cos();
                    let distance = distance.of(*far);
                    *position = [distance * cos_dec * cos_ra, distance * cos_dec * sin_ra, distance * sin_dec];
                }
            }
        }
        Ok(())
    }

    /// Whether they are made of directions on the sky.
    pub(super) fn is_of_sky(&self) -> bool {
        matches!(self, Recipe::Equatorial { .. })
    }
}

/// Places, and how AHF calls those of haloes' centres.
const AXES: [[&str; 2]; 3] = [["x", "xc"], ["y", "yc"], ["z", "zc"]];
/// Directions, among them as VizieR calls those of its catalogues and those that it adds to them.
const RA: [&str; 7] = ["ra", "raj2000", "ra_icrs", "raicrs", "_raj2000", "_ra_icrs", "right_ascension"];
const DEC: [&str; 8] = ["dec", "dej2000", "de_icrs", "deicrs", "_dej2000", "_de_icrs", "decj2000", "declination"];
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
    is_needed_beside(column, &[])
}

/// Whether a column of three numbers is called as those of places or velocities are.
pub(super) fn may_be_vector(name: &str) -> bool {
    let column = Column { components: 3, ..Column::new(name) };
    is_needed(&column) || VELOCITIES.contains(&column.key().as_str())
}

/// The same beside `others` that hold numbers: directions that are there as text, too, are not needed.
pub(super) fn is_needed_beside(column: &Column, others: &[Column]) -> bool {
    let has = |names: &[&str], measure| names.iter().any(|name| unit_of(column, name, measure).is_some());
    if column.components != 1 {
        return column.components == 3 && has(&POSITIONS, Measure::Length);
    }
    let is_there = |names: &[&str]| find(others, names, Measure::Angle).is_some();
    let lengths: [&[&str]; 2] = [AXES.as_flattened(), &DISTANCE];
    let directions: [&[&str]; 2] = [&RA, &DEC];
    lengths.iter().any(|names| has(names, Measure::Length))
        || has(&PARALLAX, Measure::Angle)
        || directions.iter().any(|names| has(names, Measure::Angle) && !is_there(names))
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

/// The error of a table without them.
pub(super) fn missing(path: &Path) -> ImportError {
    let is_ron = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ron"));
    let expected = match is_ron {
        true => "data in the place of a scene or a tour, which names its own",
        false => "columns x, y, z, or ra, dec and possibly dist or parallax",
    };
    ImportError::missing(path, "positions", expected)
}

/// The error of so many tables without them.
pub(super) fn missing_in(path: &Path, tables: usize) -> ImportError {
    let expected = format!("columns x, y, z, or ra, dec and possibly dist or parallax in one of {tables} tables");
    ImportError::missing(path, "positions", expected)
}

/// Whether there are columns that positions can be made of.
pub(super) fn has_positions(columns: &[Column]) -> bool {
    let has = |names: &[&str], measure| find(columns, names, measure).is_some();
    AXES.iter().all(|names| has(names, Measure::Length))
        || find_of(columns, &POSITIONS, Measure::Length, 3).is_some()
        || has(&RA, Measure::Angle) && has(&DEC, Measure::Angle)
}

/// A column that positions are made of.
struct Found<'a> {
    index: usize,
    column: &'a Column,
    unit: &'a str,
}

/// The first column of one number a row with one of the names: one of the name itself rather than one with a unit behind it.
fn find<'a>(columns: &'a [Column], names: &[&str], measure: Measure) -> Option<Found<'a>> {
    find_of(columns, names, measure, 1)
}

/// The same of so many numbers a row.
fn find_of<'a>(columns: &'a [Column], names: &[&str], measure: Measure, components: usize) -> Option<Found<'a>> {
    let own = || columns.iter().enumerate().filter(move |(_, column)| column.components == components);
    let exact = |name: &&str| own().find(|(_, column)| column.key() == *name);
    let suffixed = |name: &&str| own().find(|(_, column)| unit_of(column, name, measure).is_some());
    let (index, column) = names.iter().find_map(exact).or_else(|| names.iter().find_map(suffixed))?;
    let unit = names.iter().find_map(|name| unit_of(column, name, measure))?;
    Some(Found { index, column, unit })
}

/// The positions of a table; `None` if it has neither kind of columns.
///
/// # Errors
/// When a unit of such a column is not known, or the table cannot be read.
pub(super) fn positions(path: &Path, table: &dyn Table) -> Result<Option<Positions>, ImportError> {
    for of in [cartesian, vector, equatorial] {
        if let Some(positions) = of(path, table)? {
            return Ok(Some(positions));
        }
    }
    Ok(None)
}

/// Positions in one column.
fn vector(path: &Path, table: &dyn Table) -> Result<Option<Positions>, ImportError> {
    let Some(found) = find_of(table.columns(), &POSITIONS, Measure::Length, 3) else { return Ok(None) };
    let is_known = length_of(path, &found.column.name, found.unit)? != units::Length::Code;
    let unit = Unit::new(if is_known { found.unit } else { "" });
    let stored_as = found.column.name.clone();
    Ok(Some(Positions { recipe: Recipe::Vector(found.index), unit, stored_as, note: None }))
}

fn cartesian(path: &Path, table: &dyn Table) -> Result<Option<Positions>, ImportError> {
    let columns = table.columns();
    let [x, y, z] = AXES.map(|names| find(columns, &names, Measure::Length));
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
    let recipe = Recipe::Cartesian { axes: [axes[0].index, axes[1].index, axes[2].index], factors };
    let parsecs = unit.is_empty() && in_parsecs(table)?;
    let note = parsecs.then(|| "lengths are in pc: absolute magnitude = magnitude - 5 log10(dist / 10 pc)".to_string());
    let unit = Unit::new(if parsecs { "pc" } else { unit });
    let stored_as = axes.map(|axis| &*axis.column.name).join(",");
    Ok(Some(Positions { recipe, unit, stored_as, note }))
}

/// Whether distances are in parsecs, which shows where both the apparent and the absolute magnitude are there.
fn in_parsecs(table: &dyn Table) -> Result<bool, ImportError> {
    let columns = table.columns();
    let of = |key: &str| columns.iter().position(|column| column.key() == key && column.components == 1);
    let (Some(distance), Some(apparent), Some(absolute)) =
        (find(columns, &DISTANCE, Measure::Length), of("mag"), of("absmag"))
    else {
        return Ok(false);
    };
    let [count, close] = tally(table, [distance.index, apparent, absolute], |[distance, apparent, absolute]| {
        let difference = (absolute - (apparent - 5.0 * (distance / 10.0).log10())).abs();
        [u64::from(difference.is_finite()), u64::from(difference < 0.01)]
    })?;
    Ok(count > 0 && 10 * close >= 9 * count)
}

/// The sums of what `count` gives for every row of some columns.
fn tally<const N: usize>(
    table: &dyn Table,
    columns: [usize; N],
    count: impl Fn([f64; N]) -> [u64; 2] + Sync,
) -> Result<[u64; 2], ImportError> {
    let sum = |a: [u64; 2], b: [u64; 2]| [a[0] + b[0], a[1] + b[1]];
    let of_range = |range: Range<u64>| -> Result<[u64; 2], ImportError> {
        let rows = (range.end - range.start) as usize;
        let mut values = vec![0.0; N * rows];
        for (column, values) in columns.iter().zip(values.chunks_exact_mut(rows.max(1))) {
            table.read(*column, range.clone(), values)?;
        }
        let row = |row: usize| count(std::array::from_fn(|column| values[column * rows + row]));
        Ok((0..rows).map(row).fold([0, 0], sum))
    };
    chunks(table.rows()).into_par_iter().map(of_range).try_reduce(|| [0, 0], |a, b| Ok(sum(a, b)))
}

fn equatorial(path: &Path, table: &dyn Table) -> Result<Option<Positions>, ImportError> {
    let columns = table.columns();
    let (Some(ra), Some(dec)) = (find(columns, &RA, Measure::Angle), find(columns, &DEC, Measure::Angle)) else {
        return Ok(None);
    };
    let mut notes = Vec::new();
    let stated = !ra.unit.is_empty() && !units::is_frame(ra.unit);
    let beyond = |[ra]: [f64; 1]| [u64::from(ra.is_finite() && ra > 24.0), 0];
    let hours = !stated && table.rows() > 100 && tally(table, [ra.index], beyond)?[0] == 0;
    if hours {
        notes.push("right ascensions up to 24 are taken for hours".to_string());
    }
    let ra_degrees = degrees_of(path, &ra.column.name, ra.unit, if hours { 15.0 } else { 1.0 })?;
    let dec_degrees = degrees_of(path, &dec.column.name, dec.unit, 1.0)?;
    let (distance, unit, source) = if let Some(distance) = find(columns, &DISTANCE, Measure::Length) {
        let known = length_of(path, &distance.column.name, distance.unit)? != units::Length::Code;
        (Distance::Column(distance.index), if known { distance.unit } else { "" }, &*distance.column.name)
    } else if let Some(parallax) = find(columns, &PARALLAX, Measure::Angle) {
        let per_mas = degrees_of(path, &parallax.column.name, parallax.unit, MILLIARCSECOND)? / MILLIARCSECOND;
        (Distance::Parallax(parallax.index, per_mas), "pc", &*parallax.column.name)
    } else {
        notes.push("no distances: positions are directions on the unit sphere".into());
        (Distance::Unknown, "", "")
    };
    if let Some(column) = distance.column() {
        let [without, _] = tally(table, [column], |[value]| [u64::from(!distance.of(value).is_finite()), 0])?;
        if without > 0 {
            notes.push(format!("{without} stars have no distance and so no position"));
        }
    }
    let mut stored_as = format!("{},{}", ra.column.name, dec.column.name);
    if !source.is_empty() {
        stored_as = format!("{stored_as},{source}");
    }
    let note = (!notes.is_empty()).then(|| notes.join("; "));
    let (angles, degrees) = ([ra.index, dec.index], [ra_degrees, dec_degrees]);
    let recipe = Recipe::Equatorial { angles, degrees, distance };
    Ok(Some(Positions { recipe, unit: Unit::new(unit), stored_as, note }))
}

/// Degrees.
const MILLIARCSECOND: f64 = 1.0 / 3.6e6;
