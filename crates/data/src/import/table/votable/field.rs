//! A column of a VOTable: its type, and the numbers that text or bytes of it stand for.

use super::markup::Markup;
use crate::import::ImportError;
use crate::import::source::exact_id;
use crate::import::table::columns::{Column, MOST_COMPONENTS, shown};
use crate::import::table::ids;
use std::path::Path;

/// The type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Datatype {
    Boolean,
    Bit,
    UnsignedByte,
    Short,
    Int,
    Long,
    Char,
    UnicodeChar,
    Float,
    Double,
    FloatComplex,
    DoubleComplex,
}

impl Datatype {
    fn named(name: &str) -> Option<Datatype> {
        Some(match name {
            "boolean" => Datatype::Boolean,
            "bit" => Datatype::Bit,
            "unsignedByte" => Datatype::UnsignedByte,
            "short" => Datatype::Short,
            "int" => Datatype::Int,
            "long" => Datatype::Long,
            "char" => Datatype::Char,
            "unicodeChar" => Datatype::UnicodeChar,
            "float" => Datatype::Float,
            "double" => Datatype::Double,
            "floatComplex" => Datatype::FloatComplex,
            "doubleComplex" => Datatype::DoubleComplex,
            _ => return None,
        })
    }

    /// Bytes of so many values; `None` for more than can be.
    pub(super) fn bytes(self, count: usize) -> Option<usize> {
        match self {
            Datatype::Bit => Some(count.div_ceil(8)),
            Datatype::Boolean | Datatype::UnsignedByte | Datatype::Char => Some(count),
            Datatype::Short | Datatype::UnicodeChar => count.checked_mul(2),
            Datatype::Int | Datatype::Float => count.checked_mul(4),
            Datatype::Long | Datatype::Double | Datatype::FloatComplex => count.checked_mul(8),
            Datatype::DoubleComplex => count.checked_mul(16),
        }
    }
}

/// How many values a row has in a column; `None`: each row says.
pub(super) type Count = Option<usize>;

/// The most bytes of a row in a column, as far as the header says.
const MOST_BYTES: usize = 1 << 24;

/// A column.
#[derive(Clone, Debug)]
pub(super) struct VoField {
    /// Its name, or its `ID` without one.
    pub name: String,
    unit: String,
    pub datatype: Datatype,
    pub count: Count,
    /// Numbers that it adds to a row ([`Column::width`]).
    width: usize,
    /// The number that stands for none.
    pub null: Option<f64>,
}

impl VoField {
    /// Reads the attributes of a `FIELD`.
    ///
    /// # Errors
    /// When it has no type that is known.
    pub(super) fn read(path: &Path, markup: &Markup) -> Result<VoField, ImportError> {
        let attribute = |name: &str| markup.attribute(name).unwrap_or_default();
        let name = [attribute("name"), attribute("ID")].into_iter().find(|name| !name.is_empty()).unwrap_or_default();
        let wrong = |entry: &str, found: String, expected: &str| {
            ImportError::malformed(path, format!("{entry} of {}", shown(&name)), shown(&found), expected)
        };
        let stated = attribute("datatype");
        let datatype = Datatype::named(stated.trim());
        let datatype = datatype.ok_or_else(|| wrong("datatype", stated, "a type of VOTable, such as double"))?;
        let size = attribute("arraysize");
        let count = count_of(size.trim());
        let is_short =
            |count: &Count| count.is_none_or(|count| datatype.bytes(count).is_some_and(|all| all <= MOST_BYTES));
        let count = count.filter(is_short).ok_or_else(|| wrong("arraysize", size, "a size such as 3, 2x3 or *"))?;
        let unit = attribute("unit").trim().to_owned();
        let mut field = VoField { name, unit, datatype, count, width: 0, null: None };
        field.width = field.column().width();
        Ok(field)
    }

    /// Whether every row has the same number of real numbers in it. A bit alone is one, as astropy writes truth values so.
    pub(super) fn has_numbers(&self) -> bool {
        use Datatype::{Bit, Boolean, Double, Float, Int, Long, Short, UnsignedByte};
        let most = match self.datatype {
            Boolean | UnsignedByte | Short | Int | Long | Float | Double => MOST_COMPONENTS,
            Bit => 1,
            _ => 0,
        };
        self.count.is_some_and(|count| (1..=most).contains(&count))
    }

    /// The column that it is to a table.
    pub(super) fn column(&self) -> Column {
        Column::with_unit(&self.name, &self.unit, self.components())
    }

    fn components(&self) -> usize {
        self.count.unwrap_or(1)
    }

    /// Adds the numbers of a text to a row, where it has numbers; false where the text says something else.
    pub(super) fn push_text(&self, text: &str, row: &mut Vec<f64>) -> bool {
        if !self.has_numbers() {
            return true;
        }
        let end = row.len() + self.components();
        for word in text.split_whitespace() {
            match self.number(word).filter(|_| row.len() < end) {
                Some(number) => row.push(self.or_none(number)),
                None => return false,
            }
        }
        let is_whole = row.len() == end || text.trim().is_empty();
        row.resize(end, f64::NAN);
        self.push_rest(row, |number| ids::of_text(text, number));
        is_whole
    }

    /// What [`VoField::push_text`] takes.
    pub(super) fn expected(&self) -> String {
        match (self.datatype, self.components()) {
            (Datatype::Boolean, _) => "true, false or ?".into(),
            (Datatype::Bit, _) => "0 or 1".into(),
            (_, 1) => "a number".into(),
            (_, count) => format!("{count} numbers"),
        }
    }

    fn number(&self, word: &str) -> Option<f64> {
        if self.datatype == Datatype::Boolean {
            return match word {
                "T" | "t" | "1" => Some(1.0),
                "F" | "f" | "0" => Some(0.0),
                "?" => Some(f64::NAN),
                _ if word.eq_ignore_ascii_case("true") => Some(1.0),
                _ if word.eq_ignore_ascii_case("false") => Some(0.0),
                _ => None,
            };
        }
        if self.datatype == Datatype::Bit {
            return word.parse().ok().filter(|bit| [0.0, 1.0].contains(bit));
        }
        let hexadecimal = || i64::from_str_radix(word.strip_prefix("0x")?, 16).ok().map(|whole| whole as f64);
        word.parse().ok().or_else(hexadecimal)
    }

    /// Adds the numbers of bytes to a row, where it has numbers.
    pub(super) fn push_bytes(&self, bytes: &[u8], row: &mut Vec<f64>) {
        if !self.has_numbers() {
            return;
        }
        let size = self.datatype.bytes(1).unwrap_or(1);
        row.extend(bytes.chunks_exact(size).map(|bytes| self.or_none(self.value(bytes))));
        self.push_rest(row, |number| match self.datatype {
            Datatype::Long => u64::try_from(i64::from_be_bytes(bytes.try_into().ok()?)).ok(),
            _ => exact_id(number),
        });
    }

    /// Adds what the number before lacks where it is an id, which `id` says.
    fn push_rest(&self, row: &mut Vec<f64>, id: impl FnOnce(f64) -> Option<u64>) {
        if self.width > self.components()
            && let Some(number) = row.last().copied()
        {
            row.push(ids::rest(number, id(number)));
        }
    }

    /// Adds as many missing numbers.
    pub(super) fn push_none(&self, row: &mut Vec<f64>) {
        if self.has_numbers() {
            row.resize(row.len() + self.width, f64::NAN);
        }
    }

    fn or_none(&self, number: f64) -> f64 {
        if self.null == Some(number) { f64::NAN } else { number }
    }

    fn value(&self, bytes: &[u8]) -> f64 {
        match (self.datatype, bytes) {
            (Datatype::Boolean, b"T" | b"t" | b"1") => 1.0,
            (Datatype::Boolean, b"F" | b"f" | b"0") => 0.0,
            // The first bit of a byte whose others are padding; astropy sets another one.
            (Datatype::Bit, [byte]) => f64::from(*byte != 0),
            (Datatype::UnsignedByte, [byte]) => f64::from(*byte),
            (Datatype::Short, _) => f64::from(i16::from_be_bytes(bytes.try_into().unwrap_or_default())),
            (Datatype::Int, _) => f64::from(i32::from_be_bytes(bytes.try_into().unwrap_or_default())),
            (Datatype::Long, _) => i64::from_be_bytes(bytes.try_into().unwrap_or_default()) as f64,
            (Datatype::Float, _) => f64::from(f32::from_be_bytes(bytes.try_into().unwrap_or_default())),
            (Datatype::Double, _) => f64::from_be_bytes(bytes.try_into().unwrap_or_default()),
            _ => f64::NAN,
        }
    }
}

/// How many values an `arraysize` stands for; `None` where it is none.
fn count_of(size: &str) -> Option<Count> {
    if size.is_empty() {
        return Some(Some(1));
    }
    if size.ends_with('*') {
        return Some(None);
    }
    let mut count: usize = 1;
    for axis in size.split('x') {
        count = count.checked_mul(axis.trim().parse().ok()?)?;
    }
    Some(Some(count))
}
