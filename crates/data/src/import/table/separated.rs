//! Rows of values that something separates, behind a header: what CSV, ECSV and ASCII tables have in common.

use super::columns::{Column, Opened, number, shown};
use super::records::{Delimiter, Records};
use super::store::{Store, StoreWriter};
use super::{ids, sky, text};
use crate::import::ImportError;
use crate::model::ReadMethod;
use csv::ByteRecord;
use std::io::{BufRead, Cursor, Read};
use std::path::Path;

/// The longest line of a header, bytes: a file without line ends is not read as one.
const LONGEST: u64 = 1 << 16;

/// A format of such rows.
pub(super) trait Separated {
    /// Its name in descriptions.
    const NAME: &'static str;

    /// Reads what stands before the rows.
    ///
    /// # Errors
    /// When the file cannot be read, or its header is damaged.
    fn heading(path: &Path, reader: &mut dyn BufRead) -> Result<Heading, ImportError>;
}

/// Opens a table.
///
/// # Errors
/// When the file cannot be read, or is damaged.
pub(super) fn open<F: Separated>(path: &Path, _: ReadMethod) -> Result<Opened, ImportError> {
    let (mut reader, bytes) = text::open(path)?;
    let heading = F::heading(path, &mut *reader)?;
    // Before rows are read, of which there may be many.
    if !sky::has_positions(&heading.columns) {
        return Err(sky::missing(path));
    }
    let table = Box::new(rows(path, heading, reader)?);
    Ok(Opened { table, format: F::NAME, bytes, notes: Vec::new() })
}

/// The columns of a table, numbers or not.
///
/// # Errors
/// As [`Separated::heading`].
pub(super) fn columns<F: Separated>(path: &Path) -> Result<Vec<Column>, ImportError> {
    Ok(F::heading(path, &mut *text::open(path)?.0)?.columns)
}

/// What stands before the rows.
pub(super) struct Heading {
    /// The columns, one for each value of a row.
    pub columns: Vec<Column>,
    /// Which of them hold text, whatever it looks like.
    pub is_text: Vec<bool>,
    /// Which of them hold `True` and `False`.
    pub is_truth: Vec<bool>,
    /// What separates values.
    pub delimiter: Delimiter,
    /// Lines of the header.
    pub lines: u64,
    /// Rows behind the header that were read along with it.
    pub begun: Vec<u8>,
}

impl Heading {
    /// Columns of which nothing is known but their names.
    pub(super) fn of_names(columns: Vec<Column>, delimiter: Delimiter) -> Heading {
        let nothing = vec![false; columns.len()];
        Heading { is_text: nothing.clone(), is_truth: nothing, columns, delimiter, lines: 1, begun: Vec::new() }
    }
}

/// The next line of a header without its end; empty at the end of the file.
///
/// # Errors
/// When the file cannot be read, or the line is no text.
pub(super) fn header_line(path: &Path, reader: &mut dyn BufRead) -> Result<String, ImportError> {
    let mut line = String::new();
    let mut limited = std::io::Read::take(reader, LONGEST);
    limited.read_line(&mut line).map_err(|source| ImportError::io(path, "header", source))?;
    Ok(line)
}

/// Reads all rows. Columns in which some value is text are left out.
///
/// # Errors
/// When the file cannot be read, a row has too few or too many values, or one of a column that positions need is no number.
fn rows(path: &Path, heading: Heading, reader: Box<dyn BufRead>) -> Result<Store, ImportError> {
    let Heading { columns, is_text, is_truth, delimiter, lines, begun } = heading;
    let mut records = Records::new(Box::new(Cursor::new(begun).chain(reader)), delimiter, lines);
    let mut record = ByteRecord::new();
    let widths: Vec<usize> = columns.iter().map(Column::width).collect();
    let mut row = Vec::with_capacity(widths.iter().sum());
    // The first value of a column that is text, and the line that it is in.
    let mut text: Vec<Option<(u64, String)>> = vec![None; columns.len()];
    let names = columns.clone();
    let mut rows = StoreWriter::new(path, columns);
    while records.read(path, &mut record)? {
        let line = records.line();
        if record.len() != names.len() {
            if rows.rows() == 0 && lines == 1 && names.len() > 1 {
                return transposed(path, names, records, &record);
            }
            let found = format!("{} values", record.len());
            let expected = format!("{}, as many as the header has names", names.len());
            return Err(ImportError::malformed(path, format!("line {line}"), found, expected));
        }
        row.clear();
        for (index, field) in record.iter().enumerate() {
            if is_text[index] || text[index].is_some() {
                row.resize(row.len() + widths[index], f64::NAN);
                continue;
            }
            let field = String::from_utf8_lossy(field);
            let value = if is_truth[index] { truth(&field) } else { number(&field) };
            if value.is_none() {
                text[index] = Some((line, field.chars().take(40).collect()));
            }
            let value = value.unwrap_or(f64::NAN);
            row.push(value);
            if widths[index] > 1 {
                row.push(ids::rest(value, ids::of_text(&field, value)));
            }
        }
        rows.push(&row)?;
    }
    let first_text = names.iter().zip(&text).filter_map(|(column, text)| Some((column, text.as_ref()?)));
    if let Some((column, (line, found))) = first_text.into_iter().find(|(column, _)| sky::is_needed(column)) {
        let field = format!("{} in line {line}", shown(&column.name));
        return Err(ImportError::malformed(path, field, shown(found), "a number"));
    }
    rows.finish(|column| !is_text[column] && text[column].is_none())
}

/// The rows of a table that has a line for each name; `first` is the first of these lines.
fn transposed(path: &Path, names: Vec<Column>, mut records: Records, first: &ByteRecord) -> Result<Store, ImportError> {
    let values_of = |record: &ByteRecord, column: &Column| -> Result<Vec<[f64; 2]>, ImportError> {
        let values = record.iter().map(|field| {
            let field = String::from_utf8_lossy(field);
            let wrong = || ImportError::malformed(path, shown(&column.name), format!("{field:.40?}"), "a number");
            let value = number(&field).ok_or_else(wrong)?;
            Ok([value, ids::rest(value, ids::of_text(&field, value))])
        });
        values.collect()
    };
    let mut lines = vec![values_of(first, &names[0])?];
    let mut record = ByteRecord::new();
    while records.read(path, &mut record)? {
        let Some(column) = names.get(lines.len()) else {
            let expected = format!("{} lines, one for each name", names.len());
            return Err(ImportError::malformed(path, "lines", "more lines", expected));
        };
        lines.push(values_of(&record, column)?);
    }
    lines.resize(names.len(), Vec::new());
    let longest = lines.iter().map(Vec::len).max().unwrap_or(0);
    if let Some((column, line)) = names.iter().zip(&lines).find(|(_, line)| line.len() != longest) {
        let found = format!("{} values", line.len());
        return Err(ImportError::malformed(path, shown(&column.name), found, format!("{longest} as in other lines")));
    }
    let widths: Vec<usize> = names.iter().map(Column::width).collect();
    let mut rows = StoreWriter::new(path, names);
    for row in 0..longest {
        let values = lines.iter().zip(&widths).flat_map(|(line, width)| &line[row][..*width]);
        rows.push(&values.copied().collect::<Vec<f64>>())?;
    }
    rows.finish(|_| true)
}

/// 1 for what is true, 0 for what is not, NaN where nothing is said; `None` for other text.
fn truth(text: &str) -> Option<f64> {
    match text.trim() {
        "True" | "true" => Some(1.0),
        "False" | "false" => Some(0.0),
        other => number(other),
    }
}
