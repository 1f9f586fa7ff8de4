//! Tables column by column as files of Apache Parquet (<https://parquet.apache.org/docs/file-format/>), written group of rows by group of rows.
//! Columns are packed by Zstandard; what a group does not have is null. [`crate::import`] reads such files.

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, Type};
use std::io::{self, Write};
use std::sync::Arc;

/// Texts that are handed over at a time.
const TEXTS: usize = 1 << 10;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnKind {
    /// Text, few different ones.
    Text,
    /// Whole numbers from 0, to 64 bits.
    Whole,
    /// Numbers of double precision.
    Number,
}

/// The values of a column in a group of rows, of the column's kind.
#[derive(Clone, Copy, Debug)]
pub enum ColumnValues<'a> {
    /// The same text in every row.
    Text(&'a str),
    /// One whole number a row; `None` where the group has none.
    Whole(Option<&'a [u64]>),
    /// One number a row; `None` where the group has none.
    Numbers(Option<&'a [f64]>),
}

/// A file that is being written.
pub struct TableWriter<W: Write + Send> {
    file: SerializedFileWriter<W>,
}

impl<W: Write + Send> TableWriter<W> {
    /// Begins a file with columns of these names. `about` is what is said of the whole table, by names: `unit.NAME` is the unit of a column.
    ///
    /// # Errors
    /// When the file cannot be written, or there is no column.
    pub fn new(out: W, columns: &[(String, ColumnKind)], about: Vec<(String, String)>) -> io::Result<TableWriter<W>> {
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_created_by(concat!("deepfield version ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_key_value_metadata(Some(about.into_iter().map(|(key, text)| KeyValue::new(key, text)).collect()));
        let mut fields = Vec::with_capacity(columns.len());
        for (name, kind) in columns {
            let (physical, logical) = match kind {
                ColumnKind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                ColumnKind::Whole => (Physical::INT64, Some(LogicalType::integer(64, false))),
                ColumnKind::Number => (Physical::DOUBLE, None),
            };
            if *kind == ColumnKind::Text {
                properties = properties.set_column_dictionary_enabled(ColumnPath::from(name.as_str()), true);
            }
            let field = Type::primitive_type_builder(name, physical);
            let field = field.with_repetition(Repetition::OPTIONAL).with_logical_type(logical).build()?;
            fields.push(Arc::new(field));
        }
        let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
        Ok(TableWriter { file: SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties.build()))? })
    }

    /// Adds a group of so many rows: the values of each column, in the order of the columns.
    ///
    /// # Errors
    /// When the file cannot be written, or the values are not those of so many rows, or of other columns.
    pub fn write_rows(&mut self, rows: usize, values: &[ColumnValues]) -> io::Result<()> {
        let mut lengths = values.iter().filter_map(|values| match values {
            ColumnValues::Whole(numbers) => numbers.map(<[u64]>::len),
            ColumnValues::Numbers(numbers) => numbers.map(<[f64]>::len),
            ColumnValues::Text(_) => None,
        });
        let columns = self.file.schema_descr().num_columns();
        if values.len() != columns || lengths.any(|length| length != rows) {
            let message = format!("found values of {} columns, expected {rows} of each of {columns}", values.len());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        }
        self.write(rows, values).map_err(io::Error::from)
    }

    fn write(&mut self, rows: usize, values: &[ColumnValues]) -> Result<()> {
        // Whether a row has a value: definition levels, in the format's words.
        let (there, missing) = (vec![1_i16; rows], vec![0_i16; rows]);
        let mut group = self.file.next_row_group()?;
        for values in values {
            let Some(mut column) = group.next_column()? else { break };
            match *values {
                ColumnValues::Text(text) => {
                    let texts = vec![ByteArray::from(text); TEXTS.min(rows)];
                    for there in there.chunks(TEXTS) {
                        column.typed::<ByteArrayType>().write_batch(&texts[..there.len()], Some(there), None)?;
                    }
                }
                ColumnValues::Whole(numbers) => {
                    let levels = if numbers.is_some() { &there } else { &missing };
                    let numbers: &[i64] = bytemuck::cast_slice(numbers.unwrap_or_default());
                    column.typed::<Int64Type>().write_batch(numbers, Some(levels), None)?;
                }
                ColumnValues::Numbers(numbers) => {
                    let levels = if numbers.is_some() { &there } else { &missing };
                    column.typed::<DoubleType>().write_batch(numbers.unwrap_or_default(), Some(levels), None)?;
                }
            }
            column.close()?;
        }
        group.close()?;
        Ok(())
    }

    /// Writes the footer.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self) -> io::Result<()> {
        self.file.close()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{FieldKind, open};
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    #[test]
    fn tables_are_read_back_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table");
        let names = [("family", ColumnKind::Text), ("id", ColumnKind::Whole), ("x", ColumnKind::Number)];
        let names =
            names.into_iter().chain([("y", ColumnKind::Number), ("z", ColumnKind::Number), ("t", ColumnKind::Number)]);
        let columns: Vec<(String, ColumnKind)> = names.map(|(name, kind)| (name.to_owned(), kind)).collect();
        let about = vec![("unit.x".to_owned(), "kpc".to_owned()), ("unit.t".to_owned(), "K".to_owned())];
        let file = std::fs::File::create(&path).unwrap();
        let mut table = TableWriter::new(&file, &columns, about).unwrap();
        // More rows than a page has, and values that are no usual numbers.
        let rows = 30_000_usize;
        let ids: Vec<u64> = (0..rows as u64).map(|row| u64::MAX - row * 7).collect();
        let values: Vec<f64> = (0..rows).map(|row| (row as f64).sin() * 10_f64.powi(row as i32 % 600 - 300)).collect();
        let mut odd = vec![-0.0, f64::from_bits(1), f64::MAX, f64::INFINITY, f64::from_bits(0x7ff8_0000_0000_0001)];
        odd.resize(rows, 0.1);
        for (family, ids, odd) in [("gas", Some(&ids[..]), Some(&odd[..])), ("dark", Some(&ids[..]), None)] {
            let numbers = ColumnValues::Numbers;
            let values = Some(&values[..]);
            let group = [
                ColumnValues::Text(family),
                ColumnValues::Whole(ids),
                numbers(values),
                numbers(values),
                numbers(values),
                numbers(odd),
            ];
            table.write_rows(rows, &group).unwrap();
        }
        let wrong = table.write_rows(3, &[ColumnValues::Numbers(None)]).unwrap_err().to_string();
        assert!(wrong.contains("expected 3 of each of 6"), "{wrong}");
        table.finish().unwrap();
        // What is no number is left out by the library's own reader of rows.
        let reader = SerializedFileReader::new(std::fs::File::open(&path).unwrap()).unwrap();
        let last = reader.get_row_iter(None).unwrap().last().unwrap().unwrap();
        let fields: Vec<Field> = last.get_column_iter().map(|(_, field)| field.clone()).collect();
        assert_eq!(fields[..2], [Field::Str("dark".into()), Field::ULong(ids[rows - 1])]);
        assert_eq!(fields[5], Field::Null);
        // And all of it by the importer.
        let source = open(&path).unwrap();
        let about = source.description();
        let family = &about.families[0];
        assert_eq!((&*about.format, family.count, &*about.length_unit.0), ("parquet", 2 * rows as u64, "kpc"));
        assert_eq!(about.notes, ["columns without numbers are left out: family"]);
        let mut found = vec![0; 2 * rows];
        source.read_ids(0, family.find(FieldKind::Id).unwrap(), 0..2 * rows as u64, &mut found).unwrap();
        assert!(found == [&ids[..], &ids[..]].concat());
        let t = family.named("t").unwrap();
        assert_eq!(family.fields[t].unit.0, "K");
        let mut found = vec![0.0; 2 * rows];
        source.read(0, t, 0..2 * rows as u64, &mut found).unwrap();
        assert!(found[..rows].iter().zip(&odd).all(|(a, b)| a.to_bits() == b.to_bits()));
        assert!(found[rows..].iter().all(|value| value.is_nan()));
        // Parts that begin and end within pages and groups.
        let position = family.find(FieldKind::Position).unwrap();
        for range in [0..1, 19_999..20_003, rows - 5..rows + 5, 2 * rows - 1..2 * rows] {
            let mut found = vec![0.0; 3 * range.len()];
            source.read(0, position, range.start as u64..range.end as u64, &mut found).unwrap();
            for (at, row) in found.as_chunks::<3>().0.iter().zip(range) {
                assert!(at.iter().all(|x| x.to_bits() == values[row % rows].to_bits()), "{row}");
            }
        }
    }
}
