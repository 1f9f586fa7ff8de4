//! What the numbers of a column are, and numbers out of what the library decodes.

use parquet::basic::{ConvertedType, LogicalType, Repetition, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::{ParquetError, Result};
use parquet::schema::types::{ColumnDescPtr, ColumnDescriptor};

/// Values that are decoded at a time.
const STEP: usize = 1 << 16;

/// The most digits of a decimal number behind its point.
const MOST_DIGITS: i32 = 38;

/// What stored values stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stored {
    /// True is 1 and false 0.
    Truth,
    /// Whole numbers.
    Whole,
    /// Whole numbers from 0.
    Unsigned,
    /// Numbers of single or double precision.
    Float,
    /// Numbers of half precision.
    Half,
    /// Whole numbers, times ten to the power of so many below zero.
    Decimal(i32),
}

/// What the levels of values say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Levels {
    /// The level of a value that is there.
    value: i16,
    /// Of lists, the level from which on they have one, there or missing, and how many each row has.
    list: Option<(i16, usize)>,
}

/// A column of numbers as a file stores it.
#[derive(Clone, Debug)]
pub(super) struct StoredColumn {
    /// The library's description.
    pub about: ColumnDescPtr,
    /// What its values stand for.
    pub stored: Stored,
    /// Bytes of a value in plain coding, at least 1.
    pub width: u64,
    levels: Levels,
}

impl StoredColumn {
    /// `None` where a column is none of one number a row.
    pub(super) fn of(about: &ColumnDescPtr) -> Option<StoredColumn> {
        let is_single = about.path().parts().len() == 1 && about.max_rep_level() == 0;
        let (stored, width) = stored(about).filter(|_| is_single)?;
        let levels = Levels { value: about.max_def_level(), list: None };
        Some(StoredColumn { about: about.clone(), stored, width, levels })
    }

    /// A column of lists of `size` numbers; `None` where it is something else. That it is all of a column is up to the caller.
    pub(super) fn of_lists(about: &ColumnDescPtr, size: usize) -> Option<StoredColumn> {
        // The list, what is repeated in it, and a number; one of these or two in older files.
        let is_list = about.path().parts().len() <= 3 && about.max_rep_level() == 1;
        let (stored, width) = stored(about).filter(|_| is_list)?;
        let value = about.max_def_level();
        let basic = about.self_type().get_basic_info();
        let is_optional = basic.has_repetition() && basic.repetition() == Repetition::OPTIONAL;
        let levels = Levels { value, list: Some((value - i16::from(is_optional), size)) };
        Some(StoredColumn { about: about.clone(), stored, width, levels })
    }

    /// Whether it has lists.
    pub(super) fn is_of_lists(&self) -> bool {
        self.levels.list.is_some()
    }

    /// Numbers of a row.
    pub(super) fn components(&self) -> usize {
        self.levels.list.map_or(1, |(_, size)| size)
    }

    /// Decodes numbers behind the first `skip` rows of a reader into `out`; NaN for what is missing. Gives how many there were.
    pub(super) fn numbers(&self, reader: ColumnReader, skip: usize, out: &mut [f64]) -> Result<usize> {
        let levels = self.levels;
        let none = f64::NAN;
        match (reader, self.stored) {
            (ColumnReader::BoolColumnReader(of), _) => spread(of, skip, levels, out, none, |v| f64::from(u8::from(*v))),
            (ColumnReader::Int32ColumnReader(of), Stored::Decimal(digits)) => {
                spread(of, skip, levels, out, none, |v| f64::from(*v) / 10_f64.powi(digits))
            }
            (ColumnReader::Int32ColumnReader(of), Stored::Unsigned) => {
                spread(of, skip, levels, out, none, |v| f64::from(v.cast_unsigned()))
            }
            (ColumnReader::Int32ColumnReader(of), _) => spread(of, skip, levels, out, none, |v| f64::from(*v)),
            (ColumnReader::Int64ColumnReader(of), Stored::Decimal(digits)) => {
                spread(of, skip, levels, out, none, |v| *v as f64 / 10_f64.powi(digits))
            }
            (ColumnReader::Int64ColumnReader(of), Stored::Unsigned) => {
                spread(of, skip, levels, out, none, |v| v.cast_unsigned() as f64)
            }
            (ColumnReader::Int64ColumnReader(of), _) => spread(of, skip, levels, out, none, |v| *v as f64),
            (ColumnReader::FloatColumnReader(of), _) => spread(of, skip, levels, out, none, |v| f64::from(*v)),
            (ColumnReader::DoubleColumnReader(of), _) => spread(of, skip, levels, out, none, |v| *v),
            (ColumnReader::FixedLenByteArrayColumnReader(of), Stored::Half) => {
                spread(of, skip, levels, out, none, |v| half(v.data()))
            }
            (ColumnReader::FixedLenByteArrayColumnReader(of), Stored::Decimal(digits)) => {
                spread(of, skip, levels, out, none, |v| big_endian(v.data()) as f64 / 10_f64.powi(digits))
            }
            // Columns of nothing else are stored ones.
            _ => Ok(0),
        }
    }

    /// Whether its numbers are whole ones as they are stored.
    pub(super) fn is_whole(&self) -> bool {
        matches!(self.stored, Stored::Whole | Stored::Unsigned) && self.levels.list.is_none()
    }

    /// The same for whole numbers from 0; `None` for all else.
    pub(super) fn whole_numbers(&self, reader: ColumnReader, skip: usize, out: &mut [Option<u64>]) -> Result<usize> {
        let levels = self.levels;
        match (reader, self.stored) {
            (ColumnReader::Int32ColumnReader(of), Stored::Unsigned) => {
                spread(of, skip, levels, out, None, |v| Some(u64::from(v.cast_unsigned())))
            }
            (ColumnReader::Int32ColumnReader(of), Stored::Whole) => {
                spread(of, skip, levels, out, None, |v| u64::try_from(*v).ok())
            }
            (ColumnReader::Int64ColumnReader(of), Stored::Unsigned) => {
                spread(of, skip, levels, out, None, |v| Some(v.cast_unsigned()))
            }
            (ColumnReader::Int64ColumnReader(of), Stored::Whole) => {
                spread(of, skip, levels, out, None, |v| u64::try_from(*v).ok())
            }
            _ => Ok(0),
        }
    }
}

/// What a column's values stand for, and the bytes of one; `None` where they are no numbers.
fn stored(about: &ColumnDescriptor) -> Option<(Stored, u64)> {
    let (logical, converted) = (about.logical_type_ref(), about.converted_type());
    let digits = match (logical, converted) {
        (Some(LogicalType::Decimal(decimal)), _) => Some(decimal.scale),
        (None, ConvertedType::DECIMAL) => Some(about.type_scale()),
        _ => None,
    };
    let decimal = digits.filter(|digits| (0..=MOST_DIGITS).contains(digits)).map(Stored::Decimal);
    let whole = match (logical, converted) {
        (Some(LogicalType::Integer(whole)), _) if whole.is_signed => Some(Stored::Whole),
        (Some(LogicalType::Integer(_)), _) => Some(Stored::Unsigned),
        // Dates and times are no quantities.
        (Some(_), _) => None,
        (None, ConvertedType::UINT_8 | ConvertedType::UINT_16 | ConvertedType::UINT_32 | ConvertedType::UINT_64) => {
            Some(Stored::Unsigned)
        }
        (
            None,
            ConvertedType::NONE
            | ConvertedType::INT_8
            | ConvertedType::INT_16
            | ConvertedType::INT_32
            | ConvertedType::INT_64,
        ) => Some(Stored::Whole),
        _ => None,
    };
    match about.physical_type() {
        Type::BOOLEAN => Some((Stored::Truth, 1)),
        Type::INT32 => decimal.or(whole).map(|stored| (stored, 4)),
        Type::INT64 => decimal.or(whole).map(|stored| (stored, 8)),
        Type::FLOAT => Some((Stored::Float, 4)),
        Type::DOUBLE => Some((Stored::Float, 8)),
        Type::FIXED_LEN_BYTE_ARRAY => {
            let width = u64::try_from(about.type_length()).ok().filter(|width| (1..=16).contains(width))?;
            match logical {
                Some(LogicalType::Float16) => (width == 2).then_some((Stored::Half, 2)),
                _ => decimal.map(|stored| (stored, width)),
            }
        }
        _ => None,
    }
}

/// Decodes what is behind the first `skip` rows into `out`. Gives how many values there were, missing ones among them.
fn spread<T: DataType, V: Copy>(
    mut reader: ColumnReaderImpl<T>,
    skip: usize,
    levels: Levels,
    out: &mut [V],
    none: V,
    value: impl Fn(&T::T) -> V,
) -> Result<usize> {
    if reader.skip_records(skip)? != skip {
        return Ok(0);
    }
    if let Some((entry, size)) = levels.list {
        return spread_lists(reader, (entry, levels.value), size, out, none, value);
    }
    let (mut found, mut values): (Vec<i16>, Vec<T::T>) = (Vec::new(), Vec::new());
    let mut done = 0;
    while done < out.len() {
        found.clear();
        values.clear();
        let most = STEP.min(out.len() - done);
        let (rows, _, _) = reader.read_records(most, Some(&mut found), None, &mut values)?;
        if rows == 0 {
            break;
        }
        let places = out.get_mut(done..done + rows).unwrap_or_default();
        if levels.value == 0 {
            places.iter_mut().zip(&values).for_each(|(place, stored)| *place = value(stored));
        } else {
            let mut stored = values.iter();
            for (place, level) in places.iter_mut().zip(&found) {
                let own = if *level == levels.value { stored.next() } else { None };
                *place = own.map_or(none, &value);
            }
        }
        done += rows;
    }
    Ok(done)
}

/// Decodes lists of `size` values into `out`; a list that is missing or empty is one of missing values. Levels from `entry` on are those of
/// values, `there` that of those that are not missing. Gives how many values there were.
fn spread_lists<T: DataType, V: Copy>(
    mut reader: ColumnReaderImpl<T>,
    (entry, there): (i16, i16),
    size: usize,
    out: &mut [V],
    none: V,
    value: impl Fn(&T::T) -> V,
) -> Result<usize> {
    let (mut found, mut repeats, mut values): (Vec<i16>, Vec<i16>, Vec<T::T>) = (Vec::new(), Vec::new(), Vec::new());
    let whole = |entries: usize| match entries == 0 || entries == size {
        true => Ok(()),
        false => Err(ParquetError::General(format!("a row of {entries} values, not {size}"))),
    };
    out.fill(none);
    let (mut done, all) = (0, out.len() / size.max(1));
    while done < all {
        found.clear();
        repeats.clear();
        values.clear();
        let most = (STEP / size.max(1)).max(1).min(all - done);
        let (rows, _, _) = reader.read_records(most, Some(&mut found), Some(&mut repeats), &mut values)?;
        if rows == 0 {
            break;
        }
        let (mut stored, mut row, mut entries) = (values.iter(), done, 0);
        for (place, (level, repeat)) in found.iter().zip(&repeats).enumerate() {
            // A row begins.
            if *repeat == 0 && place > 0 {
                whole(entries)?;
                (row, entries) = (row + 1, 0);
            }
            if *level >= entry {
                let own = if *level == there { stored.next() } else { None };
                // More than there should be are told below.
                let to = out.get_mut(row * size + entries).filter(|_| entries < size);
                if let (Some(own), Some(to)) = (own, to) {
                    *to = value(own);
                }
                entries += 1;
            }
        }
        whole(entries)?;
        done += rows;
    }
    Ok(done * size)
}

/// A number of half precision (IEEE 754), little-endian.
fn half(bytes: &[u8]) -> f64 {
    let Ok(bytes) = <[u8; 2]>::try_from(bytes) else { return f64::NAN };
    let bits = u16::from_le_bytes(bytes);
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2_f64.powi(exponent - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// A whole number in up to 16 bytes, the most significant first.
fn big_endian(bytes: &[u8]) -> i128 {
    let sign = if bytes.first().is_some_and(|first| *first >= 0x80) { -1 } else { 0 };
    bytes.iter().fold(sign, |value, byte| value << 8 | i128::from(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_the_numbers_that_they_stand_for() {
        for (bits, expected) in [
            (0_u16, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (1, 2_f64.powi(-24)),
            (0x3555, 0.333_251_953_125),
            (0xfc00, f64::NEG_INFINITY),
        ] {
            assert_eq!(half(&bits.to_le_bytes()), expected);
        }
        assert!(half(&0x7e00_u16.to_le_bytes()).is_nan());
        for number in [0, 1, -1, 255, -256, i128::from(i64::MIN), i128::MIN, i128::MAX] {
            assert_eq!(big_endian(&number.to_be_bytes()), number);
        }
        assert_eq!((big_endian(&[0xff, 0x38]), big_endian(&[0x7f])), (-200, 127));
    }
}
