//! What the footer of a file says: its columns of numbers, and where in the file each of them is, group of rows by group.

use super::compact::has_sound_schema;
use super::guard;
use super::pages::Chunk;
use super::units::units;
use super::values::StoredColumn;
use crate::import::ImportError;
use crate::import::bytes::RangeFile;
use crate::import::table::columns::{Column, shown};
use crate::import::table::masked::names_mask;
use crate::import::unpacking::unpacked;
use crate::model::ReadMethod;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, ParquetMetaDataReader};
use std::fs::File;
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
        let has_masks = texts.iter().any(|text| text.value.as_deref().is_some_and(names_mask));
        let (mut columns, mut stored, mut places) = (Vec::new(), Vec::new(), Vec::new());
        let mut left_out: Vec<String> = Vec::new();
        for (place, column) in about.schema_descr().columns().iter().enumerate() {
            // Of a structure the name of the whole.
            let name = column.path().parts().first().map_or("", String::as_str);
            match StoredColumn::of(column) {
                Some(own) => {
                    columns.push(Column::with_unit(name, units.get(name).map_or("", String::as_str), 1));
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
                chunk(path, &field, group.columns().get(*place).ok_or_else(missing)?, rows, end)
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

/// Where a column of a group is; it lies before byte `end`.
fn chunk(
    path: &Path,
    field: &dyn Fn() -> String,
    about: &ColumnChunkMetaData,
    rows: u64,
    end: u64,
) -> Result<Chunk, ImportError> {
    let wrong = |found: String, expected: &str| ImportError::malformed(path, field(), found, expected);
    if about.file_path().is_some() {
        return Err(wrong("rows in other files".into(), "rows; open the folder of these files"));
    }
    if u64::try_from(about.num_values()) != Ok(rows) {
        return Err(wrong(format!("{} values", about.num_values()), &rows.to_string()));
    }
    let data = about.data_page_offset();
    // Some programs write 0 where there is no dictionary.
    let start = about.dictionary_page_offset().filter(|at| (1..data).contains(at)).unwrap_or(data);
    let place = u64::try_from(start).ok().zip(u64::try_from(about.compressed_size()).ok());
    let place = place.filter(|(start, length)| start.checked_add(*length).is_some_and(|behind| behind <= end));
    let Some((start, length)) = place else {
        let found = format!("{} bytes from byte {start} on", about.compressed_size());
        return Err(wrong(found, &format!("bytes before the footer at byte {end}")));
    };
    Ok(Chunk { start, length, packing: about.compression() })
}
