//! HDF5 files without particles under names of theirs, whose data sets at the root are columns of a table, as VELOCIraptor's of haloes. Rows are
//! read in place.

use super::catalogue::Catalogue;
use super::columns::{Column, Opened, Table, left_out_note, shown};
use super::sky;
use crate::import::grid::variable;
use crate::import::hdf5::{Array, Column as Stored, H5};
use crate::import::{ImportError, Source};
use crate::model::{Channel, Scale};
use std::ops::Range;

/// Opens such a table; `None` where positions cannot be made of its columns. Data sets with other numbers of rows are about the table.
///
/// # Errors
/// When the file cannot be read, or is damaged, or columns that positions need have different numbers of rows.
pub(in crate::import) fn in_root(file: &H5) -> Result<Option<Box<dyn Source>>, ImportError> {
    let Some((table, left_out)) = columns(file)? else { return Ok(None) };
    let notes = left_out_note(&left_out).into_iter().collect();
    let opened = Opened { table: Box::new(table), format: "hdf5", bytes: file.bytes, notes };
    Ok(Some(Box::new(Catalogue::new(&file.path, opened)?)))
}

/// Whether data sets, one at least, are columns of such a table, with a number or some a row. A square one is none: its axes may be those that
/// the columns of positions have the places of.
pub(in crate::import) fn are_columns(file: &H5, arrays: &[Array]) -> bool {
    let Ok(Some((table, _))) = columns(file) else { return false };
    let is_column = |array: &Array| {
        let stored = table.stored.iter().find(|stored| stored.label == array.label);
        stored.is_some_and(|stored| stored.components == 1 || stored.components as u64 != table.rows)
    };
    !arrays.is_empty() && sky::has_positions(&table.columns) && arrays.iter().all(is_column)
}

/// The columns, and the names of the data sets that are left out.
fn columns(file: &H5) -> Result<Option<(Columns, Vec<String>)>, ImportError> {
    let root = file.root()?;
    let (_, names) = root.members()?;
    let named: Vec<Column> = names.iter().map(|name| Column::new(name)).collect();
    if !sky::has_positions(&named) {
        return Ok(None);
    }
    let (mut table, mut left_out) = (Columns::default(), Vec::new());
    let mut first: Option<(String, u64)> = None;
    let mut others = Vec::new();
    for (name, column) in names.into_iter().zip(named) {
        let Some(stored) = root.column(&name)? else {
            left_out.push(name);
            continue;
        };
        let about = stored.attributes()?;
        // NetCDF stores axes that have no coordinates, too.
        if about.text("NAME").is_some_and(|name| name.starts_with("This is a netCDF dimension")) {
            continue;
        }
        let (unit, meaning) = (about.unit().map_or(column.unit, |(_, unit)| unit), variable(&name, &about));
        let column = Column::with_unit(&column.name, &unit, stored.components);
        if !sky::is_needed(&column) {
            others.push((column, stored, meaning));
            continue;
        }
        // The places of samples along an axis of an array are no places of particles.
        if about.text("CLASS").is_some_and(|class| class == "DIMENSION_SCALE") {
            return Ok(None);
        }
        let (other, rows) = first.get_or_insert_with(|| (name.clone(), stored.rows));
        if stored.rows != *rows {
            let expected = format!("{rows}, as {} has", shown(other));
            return Err(ImportError::malformed(&file.path, shown(&name), format!("{} rows", stored.rows), expected));
        }
        table.push(column, stored, meaning);
    }
    table.rows = first.map_or(0, |(_, rows)| rows);
    others.retain(|(_, stored, _)| stored.rows == table.rows);
    others.into_iter().for_each(|(column, stored, meaning)| table.push(column, stored, meaning));
    Ok(Some((table, left_out)))
}

/// Data sets of one number of rows.
#[derive(Default)]
struct Columns {
    columns: Vec<Column>,
    stored: Vec<Stored>,
    /// What stored numbers mean.
    meanings: Vec<Channel>,
    rows: u64,
}

impl Columns {
    fn push(&mut self, column: Column, stored: Stored, meaning: Channel) {
        self.columns.push(column);
        self.stored.push(stored);
        self.meanings.push(meaning);
    }
}

impl Table for Columns {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.rows
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        self.stored[column].read(rows, out)?;
        let Channel { scale, no_data, .. } = &self.meanings[column];
        if no_data.is_some() || *scale != Scale::NONE {
            let meant = |stored: f64| if *no_data == Some(stored) { f64::NAN } else { scale.value(stored) };
            out.iter_mut().for_each(|number| *number = meant(*number));
        }
        Ok(())
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        let (stored, meaning) = (&self.stored[column], &self.meanings[column]);
        if !stored.is_whole() || meaning.scale != Scale::NONE {
            return Ok(false);
        }
        let mut meant = vec![0.0; out.len()];
        if meaning.no_data.is_some() {
            self.read(column, rows.clone(), &mut meant)?;
        }
        // Of those below 0 the sign is a bit like others, as in snapshots: ids are often written with the wrong one.
        let mut numbers = vec![0; out.len()];
        stored.read_whole(rows, &mut numbers)?;
        let all = out.iter_mut().zip(numbers).zip(meant);
        all.for_each(|((out, number), meant)| *out = (!meant.is_nan()).then_some(number));
        Ok(true)
    }
}
