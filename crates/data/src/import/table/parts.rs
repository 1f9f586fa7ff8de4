//! A table in many files: those of one folder, in the order of their names. They have the same columns.

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, Table, left_out_note, shown};
use super::store::{Store, StoreWriter};
use super::{Ascii, Csv, Ecsv, fits, ids, parquet, separated, votable};
use crate::import::check::chunks;
use crate::import::format::{Head, format_of};
use crate::import::{Format, ImportError, Source, folder};
use crate::model::ReadMethod;
use std::path::{Path, PathBuf};

/// Folders that hold one table.
pub(in crate::import) struct Parts;

/// A format whose files may be parts of one table.
struct Reader {
    format: &'static dyn Format,
    open: fn(&Path, ReadMethod) -> Result<Opened, ImportError>,
    columns: fn(&Path) -> Result<Vec<Column>, ImportError>,
    /// Opens all files at once, where their rows can be read in place.
    in_place: Option<fn(&[PathBuf]) -> Result<Opened, ImportError>>,
}

static READERS: &[Reader] = &[
    Reader { format: &super::FitsTable, open: fits::open, columns: fits::columns, in_place: None },
    Reader {
        format: &super::Parquet,
        open: parquet::open,
        columns: parquet::columns,
        in_place: Some(parquet::together),
    },
    Reader { format: &super::VoTable, open: votable::open, columns: votable::columns, in_place: None },
    Reader { format: &Ecsv, open: separated::open::<Ecsv>, columns: separated::columns::<Ecsv>, in_place: None },
    Reader { format: &Ascii, open: separated::open::<Ascii>, columns: separated::columns::<Ascii>, in_place: None },
    Reader { format: &Csv, open: separated::open::<Csv>, columns: separated::columns::<Csv>, in_place: None },
];

/// How many files are compared before they are opened; the others are when they are read.
const COMPARED: usize = 16;

/// Whether files are parts of one table: several of the same format with the same columns, of which positions can be made.
pub(in crate::import) fn same_columns(files: &[PathBuf]) -> bool {
    let Some(first) = files.first().filter(|_| files.len() > 1) else { return false };
    let Some(reader) = reader_of(first) else { return false };
    let Ok(columns) = (reader.columns)(first) else { return false };
    let is_like = |file: &PathBuf| {
        reader_of(file).is_some_and(|other| std::ptr::eq(other, reader))
            && (reader.columns)(file).is_ok_and(|other| other == columns)
    };
    super::sky::has_positions(&columns) && files[1..].iter().take(COMPARED).all(is_like)
}

fn reader_of(file: &Path) -> Option<&'static Reader> {
    let name = format_of(&Head::read(file).ok()?)?.name();
    READERS.iter().find(|reader| reader.format.name() == name)
}

impl Format for Parts {
    fn name(&self) -> &'static str {
        "table in several files"
    }

    /// Folders are not told by bytes.
    fn recognise(&self, _head: &[u8], _length: u64) -> bool {
        false
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
        folder::claimants(path)
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let files = self.files(path)?;
        let reader = files.first().and_then(|file| reader_of(file));
        let reader = reader.ok_or_else(|| ImportError::missing(path, "tables", "files with the same columns"))?;
        let opened = together(path, &files, reader, method)?;
        Ok(Box::new(Catalogue::in_files(path, opened, files.len())?))
    }
}

/// The rows of all files, one file after the other. What a column holds besides numbers in some file leaves it out.
fn together(path: &Path, files: &[PathBuf], reader: &Reader, method: ReadMethod) -> Result<Opened, ImportError> {
    for file in files {
        if reader_of(file).is_none_or(|other| !std::ptr::eq(other, reader)) {
            return Err(unlike(file, "a file of another format".into(), reader.format.name().into()));
        }
    }
    if let Some(in_place) = reader.in_place {
        let mut opened = in_place(files)?;
        opened.notes.push(note(files));
        return Ok(opened);
    }
    let mut all: Option<(StoreWriter, Vec<Column>, Vec<bool>, &'static str)> = None;
    let (mut bytes, mut notes) = (0_u64, Vec::new());
    for file in files {
        let opened = (reader.open)(file, method)?;
        bytes = bytes.saturating_add(opened.bytes);
        let (writer, columns, is_kept, _) = all.get_or_insert_with(|| {
            notes = opened.notes;
            let columns = opened.table.columns().to_vec();
            (StoreWriter::new(path, columns.clone()), columns.clone(), vec![true; columns.len()], opened.format)
        });
        let table = &*opened.table;
        let own = table.columns();
        let mut places = Vec::with_capacity(columns.len());
        for (column, is_kept) in columns.iter().zip(is_kept.iter_mut()) {
            let place = own.iter().position(|other| other.name == column.name);
            if let Some(other) = place.map(|place| &own[place]).filter(|other| *other != column) {
                let described = |column: &Column| {
                    format!("{} [{}] with {} numbers", shown(&column.name), shown(&column.unit), column.components)
                };
                return Err(unlike(file, described(other), format!("{}, as in the first file", described(column))));
            }
            if place.is_none() && super::sky::is_needed(column) {
                let expected = "numbers in this column, as in the first file";
                return Err(ImportError::missing(file, shown(&column.name), expected));
            }
            *is_kept &= place.is_some();
            places.push(place);
        }
        append(table, &places, columns, writer)?;
    }
    let Some((writer, columns, is_kept, format)) = all else {
        return Err(ImportError::missing(path, "tables", "files with the same columns"));
    };
    let dropped = columns.iter().zip(&is_kept).filter(|(_, is_kept)| !**is_kept);
    notes.extend(left_out_note(&dropped.map(|(column, _)| column.name.clone()).collect::<Vec<String>>()));
    notes.push(note(files));
    let store: Store = writer.finish(|column| is_kept[column])?;
    Ok(Opened { table: Box::new(store), format, bytes, notes })
}

/// Adds all rows of a table; `places` are where its columns are found.
fn append(
    table: &dyn Table,
    places: &[Option<usize>],
    columns: &[Column],
    writer: &mut StoreWriter,
) -> Result<(), ImportError> {
    let widths: Vec<usize> = columns.iter().map(Column::width).collect();
    let mut lists: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    let mut row = Vec::with_capacity(writer.width());
    // Fewer rows at a time where there are many columns.
    let step = (STEP / writer.width().max(1)).max(1);
    for range in chunks(table.rows()) {
        for start in range.clone().step_by(step) {
            let rows = start..range.end.min(start + step as u64);
            let count = (rows.end - rows.start) as usize;
            for (((list, place), column), width) in lists.iter_mut().zip(places).zip(columns).zip(&widths) {
                list.clear();
                let Some(place) = place else {
                    list.resize(count * width, f64::NAN);
                    continue;
                };
                list.resize(count * column.components, f64::NAN);
                table.read(*place, rows.clone(), list)?;
                if *width > column.components {
                    let ids = ids::read(table, *place, rows.clone())?;
                    *list = list.iter().zip(ids).flat_map(|(number, id)| [*number, ids::rest(*number, id)]).collect();
                }
            }
            for index in 0..count {
                row.clear();
                for (list, width) in lists.iter().zip(&widths) {
                    row.extend_from_slice(&list[index * width..(index + 1) * width]);
                }
                writer.push(&row)?;
            }
        }
    }
    Ok(())
}

/// Numbers that are copied at a time.
const STEP: usize = 1 << 19;

fn note(files: &[PathBuf]) -> String {
    format!("one table in {} files", files.len())
}

fn unlike(file: &Path, found: String, expected: String) -> ImportError {
    ImportError::Unlike { path: file.into(), found, expected }
}
