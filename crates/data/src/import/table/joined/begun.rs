//! The files of a table while they are opened one after the other: which columns all of them have, and the copies of those that are copied.

use super::{Copied, unlike};
use crate::import::ImportError;
use crate::import::check::chunks;
use crate::import::table::columns::{Column, Table, shown};
use crate::import::table::store::StoreWriter;
use crate::import::table::{ids, sky};
use std::path::Path;
use std::sync::Arc;

/// Numbers that are copied at a time.
const STEP: usize = 1 << 19;

/// A column that all files have.
pub(super) struct Found {
    pub column: Column,
    pub copy: Option<Copied>,
    pub has_numbers: bool,
}

/// The files that have been opened so far; lists are of the columns of the first.
pub(super) struct Begun {
    columns: Vec<Column>,
    is_copied: Vec<bool>,
    is_everywhere: Vec<bool>,
    /// Of those that are not copied.
    has_numbers: Vec<bool>,
    writer: StoreWriter,
}

impl Begun {
    /// For the rows of `path`, of whose first file these are the columns.
    pub(super) fn of(path: &Path, columns: &[Column], is_copied: &dyn Fn(&Column) -> bool) -> Begun {
        let copied = columns.iter().filter(|column| is_copied(column)).cloned();
        Begun {
            is_copied: columns.iter().map(is_copied).collect(),
            is_everywhere: vec![true; columns.len()],
            has_numbers: vec![false; columns.len()],
            writer: StoreWriter::new(path, copied.collect()),
            columns: columns.into(),
        }
    }

    /// How many rows there are so far.
    pub(super) fn rows(&self) -> u64 {
        self.writer.rows()
    }

    /// Adds the rows of a file.
    ///
    /// # Errors
    /// When it has other columns than the first, or cannot be read.
    pub(super) fn add(&mut self, file: &Path, table: &dyn Table) -> Result<(), ImportError> {
        let places = places(file, &self.columns, table.columns())?;
        for (index, place) in places.iter().enumerate() {
            self.is_everywhere[index] &= place.is_some();
            if let Some(place) = place.filter(|_| !self.is_copied[index] && !self.has_numbers[index]) {
                self.has_numbers[index] = has_numbers(table, place)?;
            }
        }
        let copied = self.columns.iter().zip(places).zip(&self.is_copied).filter(|(_, is_copied)| **is_copied);
        let copied: Vec<(&Column, Option<usize>)> = copied.map(|(column, _)| column).collect();
        append(table, &copied, &mut self.writer)
    }

    /// The columns that all files have, and the names of the others.
    ///
    /// # Errors
    /// When the temporary file cannot be written.
    pub(super) fn finish(self) -> Result<(Vec<Found>, Vec<String>), ImportError> {
        let Begun { columns, is_copied, is_everywhere, has_numbers, writer } = self;
        let copied: Vec<bool> =
            is_everywhere.iter().zip(&is_copied).filter(|(_, is_copied)| **is_copied).map(|(all, _)| *all).collect();
        let store = Arc::new(writer.finish(|place| copied[place])?);
        let (mut found, mut dropped, mut next) = (Vec::new(), Vec::new(), 0);
        for (index, column) in columns.into_iter().enumerate() {
            if !is_everywhere[index] {
                dropped.push(column.name);
                continue;
            }
            let copy = is_copied[index].then(|| (Arc::clone(&store), next));
            next += usize::from(copy.is_some());
            let has_numbers = copy.as_ref().map_or(has_numbers[index], |(store, place)| !store.is_blank(*place));
            found.push(Found { column, copy, has_numbers });
        }
        Ok((found, dropped))
    }
}

/// Where the columns of the first file are among `own`, those of another.
fn places(file: &Path, columns: &[Column], own: &[Column]) -> Result<Vec<Option<usize>>, ImportError> {
    let place_of = |column: &Column| {
        let place = own.iter().position(|other| other.name == column.name);
        if let Some(other) = place.map(|place| &own[place]).filter(|other| *other != column) {
            let described = |column: &Column| {
                format!("{} [{}] with {} numbers", shown(&column.name), shown(&column.unit), column.components)
            };
            return Err(unlike(file, described(other), format!("{}, as in the first file", described(column))));
        }
        if place.is_none() && sky::is_needed(column) {
            let expected = "numbers in this column, as in the first file";
            return Err(ImportError::missing(file, shown(&column.name), expected));
        }
        Ok(place)
    };
    columns.iter().map(place_of).collect()
}

/// Whether some row of a column has a number; reads until it finds one.
fn has_numbers(table: &dyn Table, column: usize) -> Result<bool, ImportError> {
    if table.is_blank(column) {
        return Ok(false);
    }
    let mut numbers = Vec::new();
    for rows in chunks(table.rows()) {
        numbers.resize((rows.end - rows.start) as usize * table.columns()[column].components, f64::NAN);
        table.read(column, rows, &mut numbers)?;
        if numbers.iter().any(|number| number.is_finite()) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Adds all rows of a table. Beside each column stands which of the table it is; without that it has no numbers.
///
/// # Errors
/// When the table cannot be read, or the temporary file not be written.
pub(super) fn append(
    table: &dyn Table,
    copied: &[(&Column, Option<usize>)],
    writer: &mut StoreWriter,
) -> Result<(), ImportError> {
    let widths: Vec<usize> = copied.iter().map(|(column, _)| column.width()).collect();
    let mut lists: Vec<Vec<f64>> = vec![Vec::new(); copied.len()];
    let mut row = Vec::with_capacity(writer.width());
    // Fewer rows at a time where there are many columns.
    let step = (STEP / writer.width().max(1)).max(1);
    for range in chunks(table.rows()) {
        for start in range.clone().step_by(step) {
            let rows = start..range.end.min(start + step as u64);
            let count = (rows.end - rows.start) as usize;
            for ((list, (column, place)), width) in lists.iter_mut().zip(copied).zip(&widths) {
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
