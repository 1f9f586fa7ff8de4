//! Catalogues as tables: a header with `name` and either `x`, `y`, `z` or `ra`, `dec` and a distance; perhaps `radius` and `mass`. What stands on
//! a surface may have `x` and `y` alone.

use super::properties::Kept;
use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::{Field, FieldKind, open};
use crate::model::Unit;
use flate2::read::MultiGzDecoder;
use glam::DVec3;
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Headers of the column of names and of radii.
const NAMES: [&str; 5] = ["name", "object", "label", "designation", "proper"];
const RADII: [&str; 6] = ["radius", "r", "r200", "r_200", "r200c", "rvir"];
/// Headers of the column of masses.
const MASSES: [&str; 3] = ["mass", "m", "masses"];
/// Headers of columns that make places in space of a table's rows.
const IN_SPACE: [&str; 4] = ["z", "ra", "raj2000", "right_ascension"];

/// Most bytes of text that names may be spread over.
const MOST_TEXT: u64 = 8 << 30;

pub(super) fn read(path: &Path, kept: &mut Kept) -> Result<Catalogue, ExploreError> {
    // Numbers, units and directions on the sky are read as those of any table.
    let source = open(path)?;
    let about = source.description();
    let Some(info) = about.families.first().filter(|_| about.box_size.is_none() && about.families.len() == 1) else {
        return Err(ExploreError::missing(path, "objects", "a table, RON or a group catalogue"));
    };
    if info.count > MOST_OBJECTS {
        let expected = format!("at most {MOST_OBJECTS}");
        return Err(ExploreError::malformed(path, "rows", info.count, expected));
    }
    let names = names(path)?;
    if names.len() as u64 != info.count {
        let expected = format!("{} as there are rows of numbers", info.count);
        return Err(ExploreError::malformed(path, "names", names.len(), expected));
    }
    let column = |field: Option<usize>| -> Result<Option<Vec<f64>>, ExploreError> {
        let Some(field) = field.filter(|&field| info.fields[field].components == 1) else { return Ok(None) };
        let mut values = vec![0.0; names.len()];
        source.read(0, field, 0..info.count, &mut values)?;
        Ok(Some(values))
    };
    let mut positions = vec![[0.0; 3]; names.len()];
    let position = info.find(FieldKind::Position);
    if let Some(field) = position {
        source.read(0, field, 0..info.count, positions.as_flattened_mut())?;
    }
    let own = [info.fields.iter().position(|field| is_radius(&field.stored_as)), info.find(FieldKind::Mass), position];
    let (radius, mass) = (column(own[0])?, column(own[1])?);
    let naming = |field: &Field| (field.name.clone(), field.kind);
    kept.read(path, source.as_ref(), (0, info), &own, 0, naming)?;
    let properties = kept.finished(names.len());
    let of = |column: &Option<Vec<f64>>, i: usize| column.as_ref().map(|values| values[i]);
    let object = |(i, (name, at)): (usize, (String, [f64; 3]))| Object {
        name,
        position: DVec3::from_array(at),
        radius: of(&radius, i),
        mass: of(&mass, i),
    };
    Ok(Catalogue {
        path: path.into(),
        format: "csv",
        length_unit: about.length_unit.clone(),
        mass_unit: about.mass_unit.clone(),
        box_size: None,
        left_out: 0,
        objects: names.into_iter().zip(positions).enumerate().map(object).collect(),
        properties,
        is_in_plane: false,
        tree: None,
    })
}

/// A header as it is compared: lower case, without a unit in brackets.
pub(in crate::explore) fn key(header: &str) -> String {
    let name = header.split(['[', '(']).next().unwrap_or_default();
    name.trim().trim_matches('"').trim().to_lowercase()
}

/// Whether a header is that of radii.
pub(in crate::explore) fn is_radius(header: &str) -> bool {
    RADII.contains(&key(header).as_str())
}

/// A table whose places are `x` and `y`, without anything that makes places in space of them; these have z 0. `None` of every other file.
pub(super) fn read_in_plane(path: &Path) -> Result<Option<Catalogue>, ExploreError> {
    let header = Lines::open(path)?.header;
    let find = |names: &[&str]| header.iter().position(|name| names.contains(&key(name).as_str()));
    let (Some(x), Some(y), None) = (find(&["x"]), find(&["y"]), find(&IN_SPACE)) else { return Ok(None) };
    let columns = [Some(x), Some(y), find(&RADII), find(&MASSES), Some(column_of_names(path, &header)?)];
    let mut objects = Vec::new();
    Lines::open(path)?.each(columns, |line, [x, y, radius, mass, name]| {
        if objects.len() as u64 == MOST_OBJECTS {
            return Err(ExploreError::malformed(path, "rows", "more", format!("at most {MOST_OBJECTS}")));
        }
        let number = |header: &str, text: &str| match text.trim() {
            "" | "-" => Ok(f64::NAN),
            text => text.parse().map_err(|_| {
                let found: String = text.chars().filter(|letter| !letter.is_control()).take(40).collect();
                ExploreError::malformed(path, format!("{header} in line {line}"), found, "a number")
            }),
        };
        let position = DVec3::new(number("x", &x)?, number("y", &y)?, 0.0);
        // What is no number of these says nothing, as in other tables.
        let [radius, mass] = [radius, mass].map(|text| text.trim().parse::<f64>().ok());
        objects.push(Object { name: named(&name, objects.len()), position, radius, mass });
        Ok(())
    })?;
    Ok(Some(Catalogue {
        path: path.into(),
        format: "csv",
        length_unit: Unit::new(unit_in(&header[x])),
        mass_unit: Unit::default(),
        box_size: None,
        left_out: 0,
        objects,
        properties: Vec::new(),
        is_in_plane: true,
        tree: None,
    }))
}

/// The unit in brackets behind a header's name; empty without.
fn unit_in(header: &str) -> &str {
    let behind = header.find(['[', '(']).map_or("", |at| &header[at + 1..]);
    behind.trim_matches(['"', ' ', ']', ')'])
}

/// The column of names.
pub(in crate::explore) fn names(path: &Path) -> Result<Vec<String>, ExploreError> {
    let lines = Lines::open(path)?;
    let column = column_of_names(path, &lines.header)?;
    let mut names = Vec::new();
    lines.each([Some(column)], |_, [name]| {
        names.push(named(&name, names.len()));
        Ok(())
    })?;
    Ok(names)
}

/// Which column has the names.
fn column_of_names(path: &Path, header: &[String]) -> Result<usize, ExploreError> {
    let found = NAMES.iter().find_map(|name| header.iter().position(|other| key(other) == *name));
    found.ok_or_else(|| {
        let expected = format!("a column with one of the headers {}", NAMES.join(", "));
        ExploreError::missing(path, "names", expected)
    })
}

/// The name of the object in row `index`, which may have none.
fn named(text: &str, index: usize) -> String {
    match text.trim() {
        "" => format!("Object {index}"),
        name => name.to_owned(),
    }
}

/// A table as text: its header's names, and the lines behind it.
struct Lines<'a> {
    path: &'a Path,
    header: Vec<String>,
    table: csv::Reader<Box<dyn Read>>,
}

impl Lines<'_> {
    /// Reads a file's first line; what is no table has a header all the same.
    fn open(path: &Path) -> Result<Lines<'_>, ExploreError> {
        let io = |source| ExploreError::io(path, "reading", source);
        let mut file = BufReader::new(File::open(path).map_err(io)?);
        let is_gzip = file.fill_buf().map_err(io)?.starts_with(&[0x1f, 0x8b]);
        let reader: Box<dyn Read> = if is_gzip { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        let mut reader = BufReader::new(reader.take(MOST_TEXT));
        let mut header = Vec::new();
        (&mut reader).take(1 << 16).read_until(b'\n', &mut header).map_err(io)?;
        let header = String::from_utf8_lossy(&header);
        let header = header.trim_start_matches('\u{feff}').trim_start_matches('#').trim_end();
        let delimiter = [',', '\t', ';'].into_iter().max_by_key(|&c| header.matches(c).count()).unwrap_or(',');
        let header = header.split(delimiter).map(str::to_owned).collect();
        let mut table = csv::ReaderBuilder::new();
        let reader: Box<dyn Read> = Box::new(reader);
        let table = table.has_headers(false).flexible(true).delimiter(delimiter as u8).from_reader(reader);
        Ok(Lines { path, header, table })
    }

    /// Shows the fields in some columns of each line, with the line's number from 1; they are empty where there are none.
    fn each<const N: usize>(
        self,
        columns: [Option<usize>; N],
        mut see: impl FnMut(usize, [Cow<'_, str>; N]) -> Result<(), ExploreError>,
    ) -> Result<(), ExploreError> {
        for (i, record) in self.table.into_byte_records().enumerate() {
            let record = record.map_err(|error| {
                let found = error.to_string().replace(['\n', '\r'], " ");
                ExploreError::malformed(self.path, format!("line {}", i + 2), found, "a line of the table")
            })?;
            let field = |column: Option<usize>| column.and_then(|column| record.get(column)).unwrap_or_default();
            see(i + 2, columns.map(|column| String::from_utf8_lossy(field(column))))?;
        }
        Ok(())
    }
}
