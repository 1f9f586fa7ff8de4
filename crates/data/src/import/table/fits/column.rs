//! Columns of binary tables: where in a row they stand and what their numbers mean.

use super::header::Header;
use crate::import::ImportError;
use crate::import::table::columns::{Column, MOST_COMPONENTS};

/// How a number is stored, big-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stored {
    /// `L`: `T` or `F`.
    Truth,
    /// `X`: so many bits, read as one whole number whose most significant bit is the first.
    Bits(u32),
    /// `B`.
    U8,
    /// `I`.
    I16,
    /// `J`.
    I32,
    /// `K`.
    I64,
    /// `E`.
    F32,
    /// `D`.
    F64,
}

impl Stored {
    /// Bytes of a number.
    pub(super) fn size(self) -> usize {
        match self {
            Stored::Truth | Stored::U8 => 1,
            Stored::Bits(bits) => bits.div_ceil(8) as usize,
            Stored::I16 => 2,
            Stored::I32 | Stored::F32 => 4,
            Stored::I64 | Stored::F64 => 8,
        }
    }

    fn is_whole(self) -> bool {
        matches!(self, Stored::U8 | Stored::I16 | Stored::I32 | Stored::I64)
    }
}

/// The most bits that are read as one number.
const MOST_BITS: usize = 53;

/// The unit of a column: `TUNITn`, or as this program writes units that others would take for another, behind `unit: ` in `TCOMMn`.
fn unit(header: &Header, number: u64) -> &str {
    let stated = header.text(&format!("TUNIT{number}")).filter(|unit| !unit.is_empty());
    let comment = || header.text(&format!("TCOMM{number}"))?.strip_prefix("unit: ")?.split(';').next();
    stated.or_else(comment).unwrap_or_default()
}

/// A column of numbers.
#[derive(Clone, Debug)]
pub(super) struct StoredColumn {
    /// Its name, unit and number of components.
    pub column: Column,
    /// Its first byte in a row.
    pub at: usize,
    /// How its numbers are stored.
    pub stored: Stored,
    /// `TSCALn`, where it is not 1.
    scale: f64,
    /// `TZEROn`.
    zero: f64,
    /// `TNULLn`, the stored number that stands for none.
    null: Option<i64>,
}

impl StoredColumn {
    /// All columns of numbers of a table whose rows have `row` bytes, and the names of the others.
    ///
    /// # Errors
    /// When the header contradicts itself.
    pub(super) fn all(header: &Header, row: usize) -> Result<(Vec<StoredColumn>, Vec<String>), ImportError> {
        let (mut columns, mut left_out, mut at) = (Vec::new(), Vec::new(), 0_usize);
        let fields = header.count("TFIELDS", 0)?;
        if fields > 999 {
            return Err(header.wrong("TFIELDS", fields.to_string(), "a number of columns up to 999"));
        }
        for number in 1..=fields {
            let entry = |key: &str| format!("{key}{number}");
            let key = entry("TFORM");
            let form = header.needed(&key, "the type of a column")?;
            let wrong = |expected: &str| header.wrong(&key, form.into(), expected);
            let digits = form.bytes().take_while(u8::is_ascii_digit).count();
            let (repeat, kind) = form.split_at(digits);
            let repeat: usize =
                if repeat.is_empty() { 1 } else { repeat.parse().map_err(|_| wrong("a type with a count"))? };
            let letter = kind.bytes().next().unwrap_or_default();
            let (stored, size) = match letter {
                b'L' => (Some(Stored::Truth), 1),
                b'B' => (Some(Stored::U8), 1),
                b'I' => (Some(Stored::I16), 2),
                b'J' => (Some(Stored::I32), 4),
                b'K' => (Some(Stored::I64), 8),
                b'E' => (Some(Stored::F32), 4),
                b'D' => (Some(Stored::F64), 8),
                b'X' => ((1..=MOST_BITS).contains(&repeat).then_some(Stored::Bits(repeat as u32)), 0),
                b'A' => (None, 1),
                b'C' | b'P' => (None, 8),
                b'M' | b'Q' => (None, 16),
                _ => return Err(wrong("a type of columns")),
            };
            let bytes = if letter == b'X' { Some(repeat.div_ceil(8)) } else { repeat.checked_mul(size) };
            let end = bytes.and_then(|bytes| at.checked_add(bytes)).filter(|end| *end <= row);
            let end = end.ok_or_else(|| wrong(&format!("columns of no more than {row} bytes")))?;
            let name = header.text(&entry("TTYPE")).filter(|name| !name.is_empty());
            let name = name.map_or_else(|| format!("column{number}"), str::to_owned);
            let components = if letter == b'X' { 1 } else { repeat };
            match stored.filter(|_| (1..=MOST_COMPONENTS).contains(&components)) {
                Some(stored) => columns.push(StoredColumn {
                    column: Column::with_unit(&name, unit(header, number), components),
                    at,
                    stored,
                    scale: header.float(&entry("TSCAL"))?.unwrap_or(1.0),
                    zero: header.float(&entry("TZERO"))?.unwrap_or(0.0),
                    null: if stored.is_whole() { header.whole(&entry("TNULL"))? } else { None },
                }),
                None => left_out.push(name),
            }
            at = end;
        }
        Ok((columns, left_out))
    }

    /// The number that bytes stand for; NaN for none.
    pub(super) fn value(&self, bytes: &[u8]) -> f64 {
        let value = match self.stored {
            Stored::Truth => {
                return match bytes.first() {
                    Some(b'T') => 1.0,
                    Some(b'F') => 0.0,
                    _ => f64::NAN,
                };
            }
            Stored::Bits(bits) => {
                let all = bytes.iter().fold(0_u64, |all, byte| all << 8 | u64::from(*byte));
                return (all >> (8 * bytes.len() as u32).saturating_sub(bits)) as f64;
            }
            Stored::F32 => f64::from(f32::from_be_bytes(bytes.try_into().unwrap_or_default())),
            Stored::F64 => f64::from_be_bytes(bytes.try_into().unwrap_or_default()),
            _ => match self.whole(bytes) {
                Some(whole) if self.is_plain() => return whole as f64,
                _ => match self.stored_whole(bytes) {
                    Some(stored) => stored as f64,
                    None => return f64::NAN,
                },
            },
        };
        value * self.scale + self.zero
    }

    /// Whether its numbers are whole ones, as they are or moved by a whole number, which is how unsigned ones are stored.
    pub(super) fn is_plain(&self) -> bool {
        self.stored.is_whole() && self.scale == 1.0 && self.zero.fract() == 0.0 && self.zero.abs() <= 2_f64.powi(63)
    }

    /// The whole number that bytes stand for; `None` for none.
    pub(super) fn whole(&self, bytes: &[u8]) -> Option<i128> {
        Some(i128::from(self.stored_whole(bytes)?) + self.zero as i128)
    }

    fn stored_whole(&self, bytes: &[u8]) -> Option<i64> {
        let stored = match self.stored {
            Stored::U8 => i64::from(*bytes.first()?),
            Stored::I16 => i64::from(i16::from_be_bytes(bytes.try_into().ok()?)),
            Stored::I32 => i64::from(i32::from_be_bytes(bytes.try_into().ok()?)),
            _ => i64::from_be_bytes(bytes.try_into().ok()?),
        };
        (self.null != Some(stored)).then_some(stored)
    }
}
