//! VOTable (<https://www.ivoa.net/documents/VOTable/>, 1.1 to 1.5): the first table with columns that positions can be made of, as
//! `TABLEDATA`, `BINARY` or `BINARY2`, in the file itself.

mod binary;
mod field;
mod markup;

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, Table, left_out_note, shown};
use super::store::{Store, StoreWriter};
use super::{sky, text};
use crate::import::{Format, ImportError, Source};
use crate::model::ReadMethod;
use field::VoField;
use markup::Markup;
use std::path::Path;

/// The VOTable format.
pub(in crate::import) struct VoTable;

/// The most columns of a table.
const MOST_FIELDS: usize = 4096;

/// How the rows of a table are written.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Serialization {
    /// As elements.
    Elements,
    /// As bytes in base64.
    Binary,
    /// The same, with flags for what is missing.
    Binary2,
}

impl Format for VoTable {
    fn name(&self) -> &'static str {
        "VOTable"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["vot", "votable", "xml"]
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        let text = text::head(head).unwrap_or_default();
        text.trim_start().starts_with('<') && (text.contains("<VOTABLE") || text.contains(":VOTABLE"))
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        Ok(Box::new(Catalogue::new(path, open(path, method)?)?))
    }
}

/// Opens the table.
///
/// # Errors
/// When the file cannot be read or is damaged, or has no table that positions can be made of.
pub(super) fn open(path: &Path, _: ReadMethod) -> Result<Opened, ImportError> {
    let (found, markup, bytes) = find(path)?;
    let left_out: Vec<String> =
        found.fields.iter().filter(|field| !field.has_numbers()).map(|field| field.name.clone()).collect();
    let columns = found.columns();
    let writer = StoreWriter::new(path, columns);
    let store = match found.serialization {
        Serialization::Elements => elements(path, &found.fields, markup, writer)?,
        kind => binary::rows(path, &found.fields, kind == Serialization::Binary2, markup, writer)?,
    };
    let rows = store.rows();
    if let Some(stated) = found.stated_rows.filter(|stated| *stated != rows) {
        return Err(ImportError::malformed(path, "rows", rows, format!("{stated}, as nrows says")));
    }
    let notes = left_out_note(&left_out).into_iter().collect();
    Ok(Opened { table: Box::new(store), format: "votable", bytes, notes })
}

/// The columns of numbers of the table.
///
/// # Errors
/// As [`open`].
pub(super) fn columns(path: &Path) -> Result<Vec<Column>, ImportError> {
    Ok(find(path)?.0.columns())
}

/// The table that was found, up to its rows.
struct Found {
    fields: Vec<VoField>,
    serialization: Serialization,
    stated_rows: Option<u64>,
}

impl Found {
    fn columns(&self) -> Vec<Column> {
        numbers_of(&self.fields)
    }
}

/// The columns of those fields that hold numbers.
fn numbers_of(fields: &[VoField]) -> Vec<Column> {
    fields.iter().filter(|field| field.has_numbers()).map(VoField::column).collect()
}

/// Reads up to the rows of the first table that positions can be made of. Gives the file's size too.
fn find(path: &Path) -> Result<(Found, Markup, u64), ImportError> {
    let (reader, bytes) = text::open(path)?;
    let mut markup = Markup::new(path, reader);
    let (mut other_tables, mut is_in_field) = (0, false);
    let mut fields: Vec<VoField> = Vec::new();
    let mut stated_rows: Option<u64> = None;
    while markup.next(false)? {
        if markup.is_end() {
            continue;
        }
        let serialization = match markup.name() {
            b"TABLE" => {
                fields.clear();
                stated_rows = markup.attribute("nrows").and_then(|rows| rows.trim().parse().ok());
                None
            }
            b"FIELD" if fields.len() == MOST_FIELDS => {
                let found = format!("more than {MOST_FIELDS} columns");
                return Err(ImportError::malformed(path, "FIELD", found, "fewer"));
            }
            b"FIELD" => {
                fields.push(VoField::read(path, &markup)?);
                is_in_field = true;
                None
            }
            b"PARAM" => {
                is_in_field = false;
                None
            }
            b"VALUES" if is_in_field => {
                if let (Some(field), Some(null)) = (fields.last_mut(), markup.attribute("null")) {
                    field.null = null.trim().parse().ok();
                }
                None
            }
            b"TABLEDATA" => Some(Serialization::Elements),
            b"BINARY" => Some(Serialization::Binary),
            b"BINARY2" => Some(Serialization::Binary2),
            other @ (b"FITS" | b"PARQUET") if sky::has_positions(&numbers_of(&fields)) => {
                let found = String::from_utf8_lossy(other).into_owned();
                return Err(ImportError::malformed(path, "DATA", found, "TABLEDATA, BINARY or BINARY2"));
            }
            _ => None,
        };
        if let Some(serialization) = serialization {
            if sky::has_positions(&numbers_of(&fields)) {
                return Ok((Found { fields, serialization, stated_rows }, markup, bytes));
            }
            other_tables += 1;
        }
    }
    Err(match other_tables {
        0 => ImportError::missing(path, "positions", "a table with rows"),
        count => sky::missing_in(path, count),
    })
}

/// The rows of a table as elements.
fn elements(
    path: &Path,
    fields: &[VoField],
    mut markup: Markup,
    mut writer: StoreWriter,
) -> Result<Store, ImportError> {
    let mut row = Vec::with_capacity(writer.width());
    let mut cells = 0;
    while markup.next(true)? {
        let field = || format!("row {}", writer.rows() + 1);
        match (markup.is_end(), markup.name()) {
            (true, b"TABLEDATA") => return writer.finish(|_| true),
            (false, b"TR") => {
                row.clear();
                cells = 0;
            }
            // An element without content begins and ends at once.
            (is_end, b"TD") if is_end || markup.is_empty() => {
                let Some(column) = fields.get(cells) else {
                    let expected = format!("{}, one for each column", fields.len());
                    return Err(ImportError::malformed(path, field(), "more values", expected));
                };
                let text = if is_end { markup.text() } else { "" };
                if !column.push_text(text, &mut row) {
                    let field = format!("{} in {}", shown(&column.name), field());
                    return Err(ImportError::malformed(path, field, shown(text), column.expected()));
                }
                cells += 1;
            }
            (true, b"TR") => {
                if cells != fields.len() {
                    let expected = format!("{}, one for each column", fields.len());
                    return Err(ImportError::malformed(path, field(), format!("{cells} values"), expected));
                }
                writer.push(&row)?;
            }
            _ => {}
        }
    }
    Err(ImportError::malformed(path, format!("row {}", writer.rows() + 1), "the file's end", "the end of TABLEDATA"))
}
