//! Tables of comma, semicolon or tab separated values with a header line, plain or gzip. The header may be a comment
//! (`# x,y,z`). A file with as many lines after the header as the header has names, each with one and the same other
//! number of values, holds a column in every line.

use super::columns::{Column, number};
use super::{Catalogue, text};
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use ::csv::{ByteRecord, ReaderBuilder};
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

    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let (reader, bytes) = text::open(path)?;
        let columns = read(path, reader)?;
        Ok(Box::new(Catalogue::new(path, "csv", bytes, columns)?))
    }
}

/// What separates the names of a header line.
fn delimiter(header: &str) -> char {
    let candidates = [',', '\t', ';'];
    candidates.into_iter().max_by_key(|candidate| header.matches(*candidate).count()).unwrap_or(',')
}

fn read(path: &Path, mut reader: Box<dyn std::io::BufRead>) -> Result<Vec<Column>, ImportError> {
    let mut header = String::new();
    // A header is short: a file without line ends is not read as one.
    let mut limited = std::io::Read::take(&mut reader, 1 << 16);
    std::io::BufRead::read_line(&mut limited, &mut header).map_err(|source| ImportError::io(path, "header", source))?;
    let delimiter = delimiter(&header);
    let names = header.trim_start_matches('\u{feff}').trim_start_matches('#').trim_end().split(delimiter);
    let mut columns: Vec<Column> = names.map(Column::new).collect();
    let mut csv = ReaderBuilder::new().has_headers(false).delimiter(delimiter as u8).flexible(true).from_reader(reader);
    let mut record = ByteRecord::new();
    let mut rows = 0u64;
    let mut transposed = false;
    // Columns in which some field is text.
    let mut text: Vec<Option<(u64, String)>> = vec![None; columns.len()];
    while csv.read_byte_record(&mut record).map_err(|error| damaged(path, rows, error))? {
        transposed = if rows == 0 { record.len() != columns.len() && columns.len() > 1 } else { transposed };
        let fields = record.iter().map(|field| String::from_utf8_lossy(field));
        if transposed {
            let Some(column) = columns.get_mut(rows as usize) else {
                let expected = format!("{} lines, one for each name", columns.len());
                return Err(ImportError::malformed(path, "lines", "more lines", expected));
            };
            let unreadable =
                |field: &str| ImportError::malformed(path, &*column.name, format!("{field:.40?}"), "a number");
            column.values =
                fields.map(|field| number(&field).ok_or_else(|| unreadable(&field))).collect::<Result<_, _>>()?;
        } else if record.len() != columns.len() {
            let found = format!("{} values", record.len());
            let expected = format!("{}, as many as the header has names", columns.len());
            return Err(ImportError::malformed(path, format!("line {}", rows + 2), found, expected));
        } else {
            for ((field, column), text) in fields.zip(&mut columns).zip(&mut text) {
                match number(&field) {
                    Some(number) if text.is_none() => column.values.push(number),
                    Some(_) => {}
                    None => {
                        column.values = Vec::new();
                        text.get_or_insert_with(|| (rows + 2, field.chars().take(40).collect()));
                    }
                }
            }
        }
        rows += 1;
    }
    if transposed {
        let lengths = columns.iter().map(|column| column.values.len());
        let longest = lengths.clone().max().unwrap_or(0);
        if let Some(column) = columns.iter().find(|column| column.values.len() != longest) {
            let found = format!("{} values", column.values.len());
            return Err(ImportError::malformed(path, &*column.name, found, format!("{longest} as in other lines")));
        }
        return Ok(columns);
    }
    let with_text = columns.iter().zip(&text).filter_map(|(column, text)| Some((column, text.as_ref()?)));
    if let Some((column, (line, found))) = with_text.into_iter().find(|(column, _)| super::sky::is_needed(column)) {
        return Err(ImportError::malformed(path, format!("{} in line {line}", column.name), found, "a number"));
    }
    let numeric = columns.into_iter().zip(text).filter(|(_, text)| text.is_none());
    Ok(numeric.map(|(column, _)| column).collect())
}

fn damaged(path: &Path, rows: u64, error: ::csv::Error) -> ImportError {
    let found = error.to_string().replace(['\n', '\r'], " ");
    ImportError::malformed(path, format!("line {}", rows + 2), found, "a line of the table")
}
