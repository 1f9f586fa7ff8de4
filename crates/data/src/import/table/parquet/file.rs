//! What the footer of a file says: its columns of numbers, and where in the file each of them is, group of rows by group.

use super::compact::has_sound_schema;
use super::guard;
use super::pages::Chunk;
use super::units::{list_sizes, units};
use super::values::StoredColumn;
use crate::import::ImportError;
use crate::import::bytes::RangeFile;
use crate::import::table::columns::{Column, shown};
use crate::import::table::masked::names_mask;
use crate::import::table::sky;
use crate::import::unpacking::unpacked;
use crate::model::ReadMethod;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, ParquetMetaDataReader};
use std::fs::File;
use std::ops::RangeInclusive;
use std::path::Path;

/// What a file begins and ends with.
pub(super) const MAGIC: &[u8] = b"PAR1";

/// The same where it is encrypted.
pub(super) const ENCRYPTED: &[u8] = b"PARE";

/// Bytes of the marks, and of the footer's length.
const FRAME: u64 = 12;

/// The most rows that a file may have for each of its bytes. Values that repeat take next to none; a file of far more is no table.
const MOST_ROWS_PER_BYTE: u64 = 1024;

/// A file, as far as its footer says what it is.
pub(super) struct Contents {
    /// Its length, bytes.
    pub length: u64,
    /// What is in it, where it is compressed as a whole.
    pub unpacked: Option<File>,
    /// Its columns of numbers.
    pub columns: Vec<Column>,
    /// How it stores each of them.
    pub stored: Vec<StoredColumn>,
    /// Names of the columns that hold no numbers.
    pub left_out: Vec<String>,
    /// Whether some of its columns are masks of others.
    pub has_masks: bool,
    /// Its groups of rows.
    pub groups: Vec<Group>,
}

/// Rows that lie together.
pub(super) struct Group {
    /// How many; at least 1.
    pub rows: u64,
    /// Where each column is.
    pub chunks: Vec<Chunk>,
}

impl Contents {
    /// Reads a footer.
    ///
    /// # Errors
    /// When the file cannot be read, or is damaged.
    pub(super) fn read(path: &Path) -> Result<Contents, ImportError> {
        let (file, is_packed) = unpacked(path)?;
        let kept = is_packed.then(|| file.try_clone()).transpose();
        let unpacked = kept.map_err(|source| ImportError::io(path, "unpacking", source))?;
        let file = RangeFile::of(path, file, ReadMethod::Positioned)?;
        let length = file.length;
        let Some(most) = length.checked_sub(FRAME) else {
            return Err(ImportError::malformed(path, "length", format!("{length} bytes"), format!("at least {FRAME}")));
        };
        let mut tail = [0; 8];
        file.read(length - 8, &mut tail, "footer")?;
        let [size @ .., _, _, _, _] = tail;
        if !tail.ends_with(MAGIC) {
            let found = if tail.ends_with(ENCRYPTED) { "PARE, which is encrypted" } else { "no mark" };
            return Err(ImportError::malformed(path, "the file's end", found, "PAR1"));
        }
        let size = u64::from(u32::from_le_bytes(size));
        if size > most {
            let expected = format!("no more than the {most} of the file");
            return Err(ImportError::malformed(path, "footer", format!("{size} bytes"), expected));
        }
        let start = length - 8 - size;
        let mut footer = vec![0; size as usize];
        file.read(start, &mut footer, "footer")?;
        if !has_sound_schema(&footer) {
            return Err(ImportError::malformed(path, "schema", "damage", "columns in a tree of at most 64 levels"));
        }
        let footer =
            guard(path, "footer".into(), "what the file holds", || ParquetMetaDataReader::decode_metadata(&footer))?;
        Ok(Contents { unpacked, ..Contents::of(path, length, start, &footer)? })
    }

    /// `end` is the byte behind the rows.
    fn of(path: &Path, length: u64, end: u64, footer: &ParquetMetaData) -> Result<Contents, ImportError> {
        let about = footer.file_metadata();
        let texts = about.key_value_metadata().map(Vec::as_slice).unwrap_or_default();
        let units = units(path, texts);
        let sizes = list_sizes(texts);
        let has_masks = texts.iter().any(|text| text.value.as_deref().is_some_and(names_mask));
        let (mut columns, mut stored, mut places) = (Vec::new(), Vec::new(), Vec::new());
        let mut left_out: Vec<String> = Vec::new();
        for (place, column) in about.schema_descr().columns().iter().enumerate() {
            // Of a structure the name of the whole.
            let name = column.path().parts().first().map_or("", String::as_str);
            let lists = || StoredColumn::of_lists(column, list_size(footer, place, name, sizes.get(name).copied())?);
            match StoredColumn::of(column).or_else(lists) {
                Some(own) => {
                    let unit = units.get(name).map_or("", String::as_str);
                    columns.push(Column::with_unit(name, unit, own.components()));
                    stored.push(own);
                    places.push(place);
                }
                None if left_out.last().is_some_and(|last| last == name) => {}
                None => left_out.push(name.to_owned()),
            }
        }
        let mut contents =
            Contents { length, unpacked: None, columns, stored, left_out, has_masks, groups: Vec::new() };
        let mut total = 0_u64;
        for (number, group) in footer.row_groups().iter().enumerate() {
            let rows = u64::try_from(group.num_rows()).unwrap_or(u64::MAX);
            total = total.saturating_add(rows);
            let most = length.saturating_mul(MOST_ROWS_PER_BYTE);
            if total > most {
                let (field, found) = (format!("row group {number}"), format!("{} rows", group.num_rows()));
                return Err(ImportError::malformed(path, field, found, format!("at most {most} in so small a file")));
            }
            let of_column = |(place, column): (&usize, &Column)| {
                let field = || format!("row group {number}: {}", shown(&column.name));
                let missing = || ImportError::missing(path, field(), "bytes of this column");
                // Lists that are missing have one value.
                let values = rows..=rows.saturating_mul(column.components as u64);
                chunk(path, &field, group.columns().get(*place).ok_or_else(missing)?, &values, end)
            };
            let chunks =
                places.iter().zip(&contents.columns).map(of_column).collect::<Result<Vec<Chunk>, ImportError>>()?;
            if rows > 0 {
                contents.groups.push(Group { rows, chunks });
            }
        }
        Ok(contents)
    }
}

/// How many numbers each row has of a column of lists: as many as the schema of Arrow states, or three where nothing is stated of one that is
/// called as places or velocities are and has as many. `None` where it has more in its rows than lists of numbers.
fn list_size(footer: &ParquetMetaData, place: usize, name: &str, stated: Option<usize>) -> Option<usize> {
    let schema = footer.file_metadata().schema_descr();
    let root = |leaf: usize| (leaf < schema.num_columns()).then(|| schema.get_column_root_idx(leaf));
    let beside = [place.checked_sub(1).and_then(root), root(place + 1)];
    let size = stated.or_else(|| sky::may_be_vector(name).then_some(3)).filter(|_| !beside.contains(&root(place)))?;
    let (mut rows, mut values) = (0_u64, 0_u64);
    for group in footer.row_groups() {
        rows = rows.saturating_add(u64::try_from(group.num_rows()).ok()?);
        values = values.saturating_add(u64::try_from(group.columns().get(place)?.num_values()).ok()?);
    }
    // A list that is missing has one value: more than two for each row are three in most.
    let is_likely = values > rows.saturating_mul(2) && values <= rows.saturating_mul(3);
    (stated.is_some() || is_likely).then_some(size)
}

/// Where a column of a group is, which has `values` values; it lies before byte `end`.
fn chunk(
    path: &Path,
    field: &dyn Fn() -> String,
    about: &ColumnChunkMetaData,
    values: &RangeInclusive<u64>,
    end: u64,
) -> Result<Chunk, ImportError> {
    let wrong = |found: String, expected: &str| ImportError::malformed(path, field(), found, expected);
    if about.file_path().is_some() {
        return Err(wrong("rows in other files".into(), "rows; open the folder of these files"));
    }
    let found = u64::try_from(about.num_values()).ok().filter(|found| values.contains(found));
    let Some(values) = found else {
        let (least, most) = (values.start(), values.end());
        let expected = if least == most { most.to_string() } else { format!("{least} to {most}") };
        return Err(wrong(format!("{} values", about.num_values()), &expected));
    };
    let data = about.data_page_offset();
    // Some programs write 0 where there is no dictionary.
    let start = about.dictionary_page_offset().filter(|at| (1..data).contains(at)).unwrap_or(data);
    let place = u64::try_from(start).ok().zip(u64::try_from(about.compressed_size()).ok());
    let place = place.filter(|(start, length)| start.checked_add(*length).is_some_and(|behind| behind <= end));
    let Some((start, length)) = place else {
        let found = format!("{} bytes from byte {start} on", about.compressed_size());
        return Err(wrong(found, &format!("bytes before the footer at byte {end}")));
    };
    Ok(Chunk { start, length, values, packing: about.compression() })
}
