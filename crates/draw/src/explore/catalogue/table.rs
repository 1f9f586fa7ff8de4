//! Catalogues as tables: a header with `name` and either `x`, `y`, `z` or `ra`, `dec` and a distance; perhaps `radius` and `mass`.

use super::{Catalogue, MOST_OBJECTS, Object};
use crate::explore::ExploreError;
use crate::import::{FieldKind, open};
use flate2::read::MultiGzDecoder;
use glam::DVec3;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Headers of the column of names and of radii.
const NAMES: [&str; 5] = ["name", "object", "label", "designation", "proper"];
const RADII: [&str; 6] = ["radius", "r", "r200", "r_200", "r200c", "rvir"];

/// Most bytes of text that names may be spread over.
const MOST_TEXT: u64 = 8 << 30;

pub(super) fn read(path: &Path) -> Result<Catalogue, ExploreError> {
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
    if let Some(field) = info.find(FieldKind::Position) {
        source.read(0, field, 0..info.count, positions.as_flattened_mut())?;
    }
    let radius = column(info.fields.iter().position(|field| is_radius(&field.stored_as)))?;
    let mass = column(info.find(FieldKind::Mass))?;
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

/// The column of names.
pub(in crate::explore) fn names(path: &Path) -> Result<Vec<String>, ExploreError> {
    let io = |source| ExploreError::io(path, "reading", source);
    let mut file = BufReader::new(File::open(path).map_err(io)?);
    let is_gzip = file.fill_buf().map_err(io)?.starts_with(&[0x1f, 0x8b]);
    let reader: Box<dyn Read> = if is_gzip { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
    let mut reader = BufReader::new(reader.take(MOST_TEXT));
    let mut header = String::new();
    (&mut reader).take(1 << 16).read_line(&mut header).map_err(io)?;
    let header = header.trim_start_matches('\u{feff}').trim_start_matches('#').trim_end();
    let delimiter = [',', '\t', ';'].into_iter().max_by_key(|&c| header.matches(c).count()).unwrap_or(',');
    let column = NAMES.iter().find_map(|name| header.split(delimiter).position(|other| key(other) == *name));
    let Some(column) = column else {
        let expected = format!("a column with one of the headers {}", NAMES.join(", "));
        return Err(ExploreError::missing(path, "names", expected));
    };
    let mut table = csv::ReaderBuilder::new();
    let table = table.has_headers(false).flexible(true).delimiter(delimiter as u8).from_reader(reader);
    let mut names = Vec::new();
    for (i, record) in table.into_byte_records().enumerate() {
        let record = record.map_err(|error| {
            let found = error.to_string().replace(['\n', '\r'], " ");
            ExploreError::malformed(path, format!("line {}", i + 2), found, "a line of the table")
        })?;
        let name = String::from_utf8_lossy(record.get(column).unwrap_or_default()).trim().to_owned();
        names.push(if name.is_empty() { format!("Object {i}") } else { name });
    }
    Ok(names)
}
