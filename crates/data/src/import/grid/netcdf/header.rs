//! The header of a classic NetCDF file: dimensions, attributes and variables, each list behind its length, all numbers big-endian.

use super::super::choice::shown;
use super::super::content::Content;
use super::super::conventions::About;
use crate::import::ImportError;
use crate::model::SampleType;
use std::io::Read;

/// The longest header that is read, bytes.
const LONGEST: u64 = 64 << 20;

/// The number of records of a file that was being written.
const STREAMING: u64 = u32::MAX as u64;

/// What the lists begin with.
const DIMENSIONS: u64 = 10;
const VARIABLES: u64 = 11;
const ATTRIBUTES: u64 = 12;

/// A dimension; of length 0 the one that grows.
pub(super) struct Dimension {
    pub name: String,
    pub length: u64,
}

/// An attribute's value.
enum Value {
    Text(String),
    Numbers(Vec<f64>),
}

/// The attributes of a variable.
pub(super) struct AttributeList(Vec<(String, Value)>);

impl About for AttributeList {
    fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        self.0.iter().find_map(|(known, value)| match value {
            Value::Numbers(numbers) if known == name => Some(numbers.clone()),
            _ => None,
        })
    }

    fn text(&self, name: &str) -> Option<String> {
        self.0.iter().find_map(|(known, value)| match value {
            Value::Text(text) if known == name => Some(text.clone()),
            _ => None,
        })
    }
}

/// A variable.
pub(super) struct Variable {
    pub name: String,
    /// Numbers of its dimensions, the fastest last; all are there.
    pub dimensions: Vec<usize>,
    pub attributes: AttributeList,
    /// How its values are stored; `None` of text.
    pub sample_type: Option<SampleType>,
    /// Its first byte.
    pub begin: u64,
}

/// What a file says about itself.
pub(super) struct Header {
    pub dimensions: Vec<Dimension>,
    pub variables: Vec<Variable>,
    /// Values along the dimension that grows; `None` where the file does not say.
    pub records: Option<u64>,
}

impl Header {
    /// Reads it.
    ///
    /// # Errors
    /// Where the file ends in it, or it is none.
    pub(super) fn read(content: &Content) -> Result<Header, ImportError> {
        let version = content.head.get(3).copied().unwrap_or_default();
        let inner = content.reader(4)?.take(LONGEST);
        let mut words = Words { content, inner, at: 4, is_64_bit: version == 5 };
        let records = words.count("records")?;
        let dimensions = words.list(DIMENSIONS, "dimensions", |words| {
            Ok(Dimension { name: words.name("dimensions")?, length: words.count("dimensions")? })
        })?;
        // Those of the whole file say nothing that a grid has.
        words.attributes("attributes")?;
        let variables = words.list(VARIABLES, "variables", |words| words.variable(version, &dimensions))?;
        // In version 5 the mark of a file that is being written has 64 bits.
        let is_open = records == if version == 5 { u64::MAX } else { STREAMING };
        Ok(Header { dimensions, variables, records: Some(records).filter(|_| !is_open) })
    }
}

/// The words of a header, one behind the other.
struct Words<'a, R> {
    content: &'a Content,
    inner: R,
    at: u64,
    /// Whether counts are of 64 bits.
    is_64_bit: bool,
}

impl<R: Read> Words<'_, R> {
    fn wrong(&self, field: &str, found: impl ToString, expected: &str) -> ImportError {
        ImportError::malformed(&self.content.path, format!("header: {field}"), found, expected)
    }

    /// The next bytes, as many as there must be; what is not there is not allocated.
    fn bytes(&mut self, count: u64, field: &str) -> Result<Vec<u8>, ImportError> {
        let mut bytes = Vec::new();
        let read = (&mut self.inner).take(count).read_to_end(&mut bytes);
        read.map_err(|error| ImportError::io(&self.content.path, "header", error))?;
        self.at += bytes.len() as u64;
        if (bytes.len() as u64) < count {
            let found = format!("an end at byte {}", self.at);
            return Err(self.wrong(
                field,
                found,
                &format!("{count} bytes from byte {} on", self.at - bytes.len() as u64),
            ));
        }
        Ok(bytes)
    }

    /// A number of so many bytes.
    fn number(&mut self, size: u64, field: &str) -> Result<u64, ImportError> {
        Ok(self.bytes(size, field)?.iter().fold(0, |number, &byte| number << 8 | u64::from(byte)))
    }

    fn word(&mut self, field: &str) -> Result<u64, ImportError> {
        self.number(4, field)
    }

    fn count(&mut self, field: &str) -> Result<u64, ImportError> {
        self.number(if self.is_64_bit { 8 } else { 4 }, field)
    }

    /// So many bytes, and those that fill up to a multiple of four.
    fn padded(&mut self, count: u64, field: &str) -> Result<Vec<u8>, ImportError> {
        let mut bytes = self.bytes(count, field)?;
        self.bytes(bytes.len().next_multiple_of(4) as u64 - count, field)?;
        bytes.shrink_to_fit();
        Ok(bytes)
    }

    fn name(&mut self, field: &str) -> Result<String, ImportError> {
        let length = self.count(field)?;
        Ok(String::from_utf8_lossy(&self.padded(length, field)?).into_owned())
    }

    /// A list that begins with `mark`, or is not there. Every entry takes some bytes, so that a list is no longer than the file.
    fn list<T>(
        &mut self,
        mark: u64,
        field: &str,
        mut entry: impl FnMut(&mut Self) -> Result<T, ImportError>,
    ) -> Result<Vec<T>, ImportError> {
        let (found, count) = (self.word(field)?, self.count(field)?);
        if found != mark && (found, count) != (0, 0) {
            return Err(self.wrong(field, format!("a list of kind {found}"), &mark.to_string()));
        }
        let mut entries = Vec::new();
        for _ in 0..count {
            entries.push(entry(self)?);
        }
        Ok(entries)
    }

    fn attributes(&mut self, field: &str) -> Result<AttributeList, ImportError> {
        let list = self.list(ATTRIBUTES, field, |words| {
            let name = words.name(field)?;
            let (code, count) = (words.word(field)?, words.count(field)?);
            if code == 2 {
                let text = words.padded(count, field)?;
                return Ok((name, Value::Text(String::from_utf8_lossy(&text).trim_end_matches('\0').to_owned())));
            }
            let kind = words.sample_type(code, field)?;
            let size = kind.size() as u64;
            let bytes = count.checked_mul(size).ok_or_else(|| words.wrong(field, count, "fewer values"))?;
            let mut bytes = words.padded(bytes, field)?;
            if cfg!(target_endian = "little") {
                bytes.chunks_exact_mut(kind.size()).for_each(<[u8]>::reverse);
            }
            let mut numbers = Vec::new();
            kind.decode(&bytes, 1, &mut numbers);
            Ok((name, Value::Numbers(numbers)))
        })?;
        Ok(AttributeList(list))
    }

    /// The type of a code that is not text.
    fn sample_type(&self, code: u64, field: &str) -> Result<SampleType, ImportError> {
        let kind = match code {
            1 => SampleType::I8,
            3 => SampleType::I16,
            4 => SampleType::I32,
            5 => SampleType::F32,
            6 => SampleType::F64,
            7 => SampleType::U8,
            8 => SampleType::U16,
            9 => SampleType::U32,
            10 => SampleType::I64,
            11 => SampleType::U64,
            _ => return Err(self.wrong(field, format!("type {code}"), "types 1 to 11")),
        };
        Ok(kind)
    }

    fn variable(&mut self, version: u8, dimensions: &[Dimension]) -> Result<Variable, ImportError> {
        let name = self.name("variables")?;
        let field = format!("variable {}", shown(&name));
        let axes = self.count(&field)?;
        let mut numbers = Vec::new();
        for _ in 0..axes {
            let number = self.count(&field)?;
            let known = usize::try_from(number).ok().filter(|number| *number < dimensions.len());
            let wrong = || self.wrong(&field, format!("dimension {number}"), &format!("one of {}", dimensions.len()));
            numbers.push(known.ok_or_else(wrong)?);
        }
        let attributes = self.attributes(&field)?;
        let code = self.word(&field)?;
        let sample_type = if code == 2 { None } else { Some(self.sample_type(code, &field)?) };
        // Its size, which follows from its dimensions, and did not fit where it is large.
        self.count(&field)?;
        let begin = self.number(if version == 1 { 4 } else { 8 }, &field)?;
        Ok(Variable { name, dimensions: numbers, attributes, sample_type, begin })
    }
}
