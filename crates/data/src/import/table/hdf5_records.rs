//! Tables in HDF5 whose rows are records of one data set, as PyTables, pandas, astropy and h5py write them: the first with columns that
//! positions can be made of. Rows are read in place.

use super::catalogue::Catalogue;
use super::columns::{Column, MOST_COMPONENTS, Opened, Table, left_out_note, shown};
use super::masked::{names_mask, unmasked};
use super::{ecsv_header, pickled, sky};
use crate::import::hdf5::{Array, Attributes, H5, Records};
use crate::import::{ImportError, Source};
use std::collections::HashMap;
use std::ops::Range;

/// What follows the name of a data set in that of astropy's description of its columns.
const DESCRIPTION: &str = ".__table_column_meta__";

/// The longest such description, bytes.
const LONGEST: u64 = 1 << 22;

/// Opens such a table; `None` where a file has no records.
///
/// # Errors
/// When the file cannot be read, or is damaged, or positions can be made of the columns of none of its tables.
pub(in crate::import) fn in_records(file: &H5) -> Result<Option<Box<dyn Source>>, ImportError> {
    let arrays = file.arrays()?;
    let mut other_tables = 0;
    for array in &arrays {
        let Some(records) = array.records()? else { continue };
        let description = description(array, &arrays)?;
        let table = Rows::of(file, records, &array.attributes()?, &description);
        if !sky::has_positions(&table.columns) {
            other_tables += 1;
            continue;
        }
        let mut notes = vec![format!("table {}", shown(&array.label))];
        notes.extend(left_out_note(&table.records.left_out));
        let has_masks = description.iter().any(|line| names_mask(line));
        let table: Box<dyn Table> = Box::new(table);
        let table = if has_masks { unmasked(table) } else { table };
        let opened = Opened { table, format: "hdf5", bytes: file.bytes, notes };
        return Ok(Some(Box::new(Catalogue::new(&file.path, opened)?)));
    }
    match other_tables {
        0 => Ok(None),
        count => Err(sky::missing_in(&file.path, count)),
    }
}

/// The lines that astropy has written about the columns of a data set; none where there are none.
fn description(array: &Array, all: &[Array]) -> Result<Vec<String>, ImportError> {
    let is_meant = |other: &&Array| other.label.strip_suffix(DESCRIPTION) == Some(&*array.label);
    let lines = all.iter().find(is_meant).map(|lines| lines.texts(LONGEST)).transpose()?;
    Ok(lines.flatten().unwrap_or_default())
}

/// Records as rows.
struct Rows {
    records: Records,
    columns: Vec<Column>,
    /// Which numbers of which member each column is.
    places: Vec<(usize, Range<usize>)>,
}

impl Rows {
    /// `about` is what pandas says of the members, `description` what astropy does.
    fn of(file: &H5, mut records: Records, about: &Attributes, description: &[String]) -> Rows {
        let described = ecsv_header::described(&file.path, description).into_iter().flat_map(|header| header.columns);
        let units: HashMap<String, String> = described.map(|column| (column.name, column.unit)).collect();
        let (mut columns, mut places) = (Vec::new(), Vec::new());
        let all = |member: &str| names(about, member).unwrap_or_else(|| vec![member.to_owned()]);
        let mut left_out: Vec<String> = records.left_out.iter().flat_map(|member| all(member)).collect();
        for (index, member) in records.members.iter().enumerate() {
            let (name, components) = (&*member.name, member.components);
            if is_coded(about, name) {
                left_out.extend(all(name));
            } else if let Some(own) = names(about, name).filter(|names| names.len() == components) {
                columns.extend(own.iter().map(|name| Column::new(name)));
                places.extend((0..components).map(|number| (index, number..number + 1)));
            } else if components <= MOST_COMPONENTS {
                columns.push(Column::with_unit(name, units.get(name).map_or("", String::as_str), components));
                places.push((index, 0..components));
            } else {
                left_out.push(name.to_owned());
            }
        }
        records.left_out = left_out;
        Rows { records, columns, places }
    }
}

/// The columns that pandas has put into one member.
fn names(about: &Attributes, member: &str) -> Option<Vec<String>> {
    pickled::names(about.bytes(&format!("{member}_kind"))?)
}

/// Whether pandas says that the whole numbers of a member stand for dates, times or texts.
fn is_coded(about: &Attributes, member: &str) -> bool {
    const CODES: [&str; 4] = ["datetime", "timedelta", "category", "string"];
    ["dtype", "kind", "meta"].iter().any(|entry| {
        let text = about.text(&format!("{member}_{entry}"));
        text.is_some_and(|text| CODES.iter().any(|code| text.starts_with(code)))
    })
}

impl Table for Rows {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn rows(&self) -> u64 {
        self.records.rows
    }

    fn read(&self, column: usize, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let (member, components) = &self.places[column];
        self.records.read(*member, components.clone(), rows, out)
    }

    fn at_hand_until(&self, row: u64) -> Option<u64> {
        Some(self.records.slab(row).end)
    }

    fn read_whole(&self, column: usize, rows: Range<u64>, out: &mut [Option<u64>]) -> Result<bool, ImportError> {
        let (member, components) = &self.places[column];
        if !self.records.members[*member].is_whole() || components.len() != 1 {
            return Ok(false);
        }
        // Of those below 0 the sign is a bit like others, as in snapshots.
        let mut numbers = vec![0; out.len()];
        self.records.read_whole(*member, components.start, rows, &mut numbers)?;
        out.iter_mut().zip(numbers).for_each(|(out, number)| *out = Some(number));
        Ok(true)
    }
}
