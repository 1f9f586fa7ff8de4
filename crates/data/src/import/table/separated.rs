//! Rows of values that something separates, behind a header: what CSV, ECSV and ASCII tables have in common.

use super::columns::{Column, Opened, Table, left_out_note, number, shown};
use super::masked::{unmasked, without_masks};
use super::records::{Delimiter, Records};
use super::store::{Store, StoreWriter};
use super::{ids, sky, text};
use crate::import::ImportError;
use crate::model::ReadMethod;
use csv::ByteRecord;
use std::io::{BufRead, Cursor, Read};
use std::path::Path;

/// The longest line of a header, bytes: a file without line ends is not read as one.
const LONGEST: u64 = 1 << 20;

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
    let has_masks = heading.has_masks;
    let (table, left_out) = rows(path, heading, reader)?;
    let table: Box<dyn Table> = Box::new(table);
    let table = if has_masks { unmasked(table) } else { table };
    let notes = left_out_note(&left_out).into_iter().collect();
    Ok(Opened { table, format: F::NAME, bytes, notes })
}

/// The columns of a table, numbers or not, without masks.
///
/// # Errors
/// As [`Separated::heading`].
pub(super) fn columns<F: Separated>(path: &Path) -> Result<Vec<Column>, ImportError> {
    let Heading { columns, has_masks, .. } = F::heading(path, &mut *text::open(path)?.0)?;
    Ok(if has_masks { without_masks(&columns) } else { columns })
}

/// What stands before the rows.
pub(super) struct Heading {
    /// The columns, one for each value of a row.
    pub columns: Vec<Column>,
    /// Which of them hold text, whatever it looks like.
    pub is_text: Vec<bool>,
    /// Whether some are masks of others.
    pub has_masks: bool,
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
        let is_text = vec![false; columns.len()];
        Heading { columns, is_text, has_masks: false, delimiter, lines: 1, begun: Vec::new() }
    }
}

/// The next line of a header without its end; empty at the end of the file.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn header_line(path: &Path, reader: &mut dyn BufRead) -> Result<String, ImportError> {
    let mut line = Vec::new();
    let mut limited = std::io::Read::take(reader, LONGEST);
    limited.read_until(b'\n', &mut line).map_err(|source| ImportError::io(path, "header", source))?;
    Ok(text::decoded(line))
}

/// Reads all rows. Columns in which some value is text are left out; their names come with the rows.
///
/// # Errors
/// When the file cannot be read, a row has too few or too many values, or one of a column that positions need is no number.
fn rows(path: &Path, heading: Heading, reader: Box<dyn BufRead>) -> Result<(Store, Vec<String>), ImportError> {
    let Heading { columns, is_text, delimiter, lines, begun, .. } = heading;
    let mut records = Records::new(Box::new(Cursor::new(begun).chain(reader)), delimiter, lines);
    let mut record = ByteRecord::new();
    let widths: Vec<usize> = columns.iter().map(Column::width).collect();
    let mut row = Vec::with_capacity(widths.iter().sum());
    // The first value of a column that is text, and the line that it is in.
    let mut text: Vec<Option<(u64, String)>> = vec![None; columns.len()];
    let mut has_numbers = vec![false; columns.len()];
    let may_be_truth: Vec<bool> = columns.iter().map(|column| !sky::is_needed(column) && !column.is_id()).collect();
    let names = columns.clone();
    let mut rows = StoreWriter::new(path, columns);
    while records.read(path, &mut record)? {
        let line = records.line();
        if record.len() != names.len() {
            if rows.rows() == 0 && lines == 1 && names.len() > 1 {
                return Ok((transposed(path, names, records, &record)?, Vec::new()));
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
            let value_of = |field: &str| number(field).or_else(|| truth(field).filter(|_| may_be_truth[index]));
            let components = names[index].components;
            let first = row.len();
            let is_text = match components {
                1 => value_of(&field).map(|value| row.push(value)),
                _ => push_array(&field, components, value_of, &mut row),
            }
            .is_none();
            if is_text {
                row.truncate(first);
                text[index] = Some((line, field.chars().take(40).collect()));
            }
            row.resize(first + components, f64::NAN);
            let value = row[first];
            has_numbers[index] |= row[first..].iter().any(|value| !value.is_nan());
            if widths[index] > components {
                row.push(ids::rest(value, ids::of_text(&field, value)));
            }
        }
        rows.push(&row)?;
    }
    let first_text = names.iter().zip(&text).filter_map(|(column, text)| Some((column, text.as_ref()?)));
    let with_numbers = names.iter().zip(text.iter().zip(&has_numbers));
    let with_numbers = with_numbers.filter(|(_, (text, has_numbers))| text.is_none() && **has_numbers);
    let with_numbers: Vec<Column> = with_numbers.map(|(column, _)| column.clone()).collect();
    let is_needed = |column: &Column| sky::is_needed_beside(column, &with_numbers);
    if let Some((column, (line, found))) = first_text.into_iter().find(|(column, _)| is_needed(column)) {
        let field = format!("{} in line {line}", shown(&column.name));
        return Err(ImportError::malformed(path, field, shown(found), "a number"));
    }
    let left_out = names.iter().zip(&text).enumerate().filter_map(|(index, (column, text))| match text {
        // One value among numbers may be a mistake of whoever wrote it.
        Some((line, found)) if has_numbers[index] => Some(format!("{} ({found} in line {line})", column.name)),
        text => (is_text[index] || text.is_some()).then(|| column.name.clone()),
    });
    let left_out = left_out.collect();
    Ok((rows.finish(|column| !is_text[column] && text[column].is_none())?, left_out))
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

/// Adds the numbers of a text such as `[1.5,null]` or `[[1,2],[3,4]]` to a row, as many as `count`; none of an empty one. `None` for other text.
fn push_array(text: &str, count: usize, value: impl Fn(&str) -> Option<f64>, row: &mut Vec<f64>) -> Option<()> {
    let text = text.trim();
    if number(text).is_some_and(f64::is_nan) {
        return Some(());
    }
    let inner = text.strip_prefix('[')?.strip_suffix(']')?;
    let end = row.len() + count;
    for word in inner.split(',') {
        let word = word.trim_matches(|letter: char| letter.is_whitespace() || matches!(letter, '[' | ']'));
        let value = value(word).filter(|_| row.len() < end)?;
        row.push(value);
    }
    (row.len() == end).then_some(())
}

/// 1 for what is true and 0 for what is not, in letters of any case; `None` for other text.
fn truth(text: &str) -> Option<f64> {
    let is = |word: &str| text.trim().eq_ignore_ascii_case(word);
    if is("true") { Some(1.0) } else { is("false").then_some(0.0) }
}
