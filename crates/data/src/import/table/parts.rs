//! A table in many files: those of one folder, in the order of their names. They have the same columns.

use super::catalogue::Catalogue;
use super::columns::{Column, Opened};
use super::joined::{self, Open, unlike};
use super::{Ascii, Csv, Ecsv, fits, parquet, separated, votable};
use crate::import::format::{Head, format_of};
use crate::import::{Format, ImportError, Source, folder};
use crate::model::ReadMethod;
use std::path::{Path, PathBuf};

/// Folders that hold one table.
pub(in crate::import) struct Parts;

/// A format whose files may be parts of one table.
struct Reader {
    format: &'static dyn Format,
    open: Open,
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

/// The rows of all files, one file after the other.
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
    let mut opened = joined::open(path, files, reader.open, method)?;
    opened.notes.push(note(files));
    Ok(opened)
}

fn note(files: &[PathBuf]) -> String {
    format!("one table in {} files", files.len())
}
