//! Tables of comma, semicolon or tab separated values with a header line, plain or compressed. The header may be a comment
//! (`# x,y,z`). A file with as many lines after the header as the header has names, each with one and the same other
//! number of values, holds a column in every line.

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, number};
use super::separated::{Heading, header_line, rows};
use super::text;
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use std::io::BufRead;
use std::path::Path;

/// The CSV format.
pub(in crate::import) struct Csv;

impl Format for Csv {
    fn name(&self) -> &'static str {
        "CSV table with a header"
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let text = text::head(head).unwrap_or_default();
        let header = text.lines().next().unwrap_or_default();
        let names = header.trim_start_matches('#').split(delimiter(header)).map(str::trim);
        let (mut fields, mut named) = (0, 0);
        for name in names {
            fields += 1;
            named += usize::from(number(name).is_none() && name.len() < 64);
        }
        fields >= 2 && 2 * named >= fields
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open(path, method)?)?))
    }
}

/// Opens a table.
///
/// # Errors
/// When the file cannot be read, or is damaged.
pub(super) fn open(path: &Path, _: ReadMethod) -> Result<Opened, ImportError> {
    let (mut reader, bytes) = text::open(path)?;
    let heading = heading(path, &mut *reader)?;
    let table = Box::new(rows(path, heading, reader)?);
    Ok(Opened { table, format: "csv", bytes, notes: Vec::new() })
}

/// The columns of a table, numbers or not.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn columns(path: &Path) -> Result<Vec<Column>, ImportError> {
    Ok(heading(path, &mut *text::open(path)?.0)?.columns)
}

fn heading(path: &Path, reader: &mut dyn BufRead) -> Result<Heading, ImportError> {
    let header = header_line(path, reader)?;
    let delimiter = delimiter(&header);
    let names = header.trim_start_matches('\u{feff}').trim_start_matches('#').trim_end().split(delimiter);
    Ok(Heading::of_names(names.map(Column::new).collect(), delimiter as u8))
}

/// What separates the names of a header line.
fn delimiter(header: &str) -> char {
    let candidates = [',', '\t', ';'];
    candidates.into_iter().max_by_key(|candidate| header.matches(*candidate).count()).unwrap_or(',')
}
