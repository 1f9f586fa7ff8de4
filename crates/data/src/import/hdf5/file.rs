//! HDF5 files behind a wall: everything that the reader library says about a damaged file, a panic included, becomes an
//! [`ImportError`], and sizes are held against the file before anything is allocated.

use super::filters;
use crate::import::ImportError;
use crate::import::guarded::guarded;
use crate::import::source::exact_id;
use crate::import::unpacking::unpacked_once;
use crate::model::{ReadFile, ReadMethod};
use hdf5_reader::group::Group;
use hdf5_reader::{
    Attribute, Dataset, Datatype, Hdf5File, OpenOptions, RangeRequestStorage, SliceInfo, SliceInfoElem, StringSize,
};
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The most that the deflate filter can expand data by, a little rounded up: more than this times the file's size
/// cannot be in it.
pub(super) const MOST_EXPANSION: u64 = 1040;

/// Largest chunk that is decoded at once, bytes.
const MOST_CHUNK: u64 = 1 << 30;

/// Attributes of a data set that name its unit in words.
const UNITS: [&str; 4] = ["unit", "units", "Unit", "Units"];

/// Most values per particle of a field.
const MOST_COMPONENTS: u64 = 64;

/// An open HDF5 file.
pub(in crate::import) struct H5 {
    pub path: PathBuf,
    pub bytes: u64,
    file: Hdf5File,
}

impl H5 {
    /// Opens the file, unpacked where it is compressed as a whole, to be read in the way `method`, and reads its superblock.
    pub(super) fn open(path: &Path, method: ReadMethod) -> Result<H5, ImportError> {
        H5::of(path, unpacked_once(path)?, method)
    }

    /// The same of an open file, which is called `path`.
    pub(in crate::import) fn of(path: &Path, file: File, method: ReadMethod) -> Result<H5, ImportError> {
        let io = |source| ImportError::io(path, "file", source);
        let bytes = file.metadata().map_err(io)?.len();
        let file = ReadFile::new(file, method);
        let storage = RangeRequestStorage::new(bytes, move |offset, len| {
            let mut bytes = vec![0; len];
            file.read_exact_at(&mut bytes, offset)?;
            Ok(bytes)
        });
        let most_chunk = bytes.saturating_mul(MOST_EXPANSION).min(MOST_CHUNK) as usize;
        let options = OpenOptions::default()
            .with_max_chunk_bytes(most_chunk)
            .with_max_read_bytes(MOST_CHUNK as usize)
            .with_filter_registry(filters::registry(most_chunk));
        let file = guard(path, "superblock", "an intact HDF5 file", || {
            Hdf5File::from_storage_with_options(Arc::new(storage), options)
        })?;
        Ok(H5 { path: path.into(), bytes, file })
    }

    /// The root group.
    pub(in crate::import) fn root(&self) -> Result<H5Group<'_>, ImportError> {
        let group = guard(&self.path, "/", "a readable root group", || self.file.root_group())?;
        Ok(H5Group { file: self, name: String::new(), group })
    }
}

/// A group of an open file.
pub(in crate::import) struct H5Group<'a> {
    pub file: &'a H5,
    /// Path inside the file, without a leading slash.
    pub name: String,
    pub(super) group: Group,
}

impl<'a> H5Group<'a> {
    /// Names of the groups and the data sets in this group.
    pub(in crate::import) fn members(&self) -> Result<(Vec<String>, Vec<String>), ImportError> {
        guard(&self.file.path, self.label(), "a readable group", || self.group.member_names())
    }

    fn label(&self) -> &str {
        if self.name.is_empty() { "/" } else { &self.name }
    }

    pub(super) fn child(&self, name: &str) -> String {
        if self.name.is_empty() { name.into() } else { format!("{}/{name}", self.name) }
    }

    /// The group `name` in this one, which must exist.
    pub(in crate::import) fn group(&self, name: &str) -> Result<H5Group<'a>, ImportError> {
        let label = self.child(name);
        let group = guard(&self.file.path, &label, "a readable group", || self.group.group(name))?;
        Ok(H5Group { file: self.file, name: label, group })
    }

    /// The attributes of this group.
    pub(in crate::import) fn attributes(&self) -> Result<Attributes, ImportError> {
        let list = guard(&self.file.path, self.label(), "readable attributes", || self.group.attributes())?;
        Ok(Attributes { path: self.file.path.clone(), label: self.label().into(), list })
    }

    /// The numeric data set `name` in this group as a column; `None` if it is not numeric, or not one or two-dimensional
    /// with a handful of components.
    pub(in crate::import) fn column(&self, name: &str) -> Result<Option<Column>, ImportError> {
        let path = &self.file.path;
        let label = self.child(name);
        let dataset = guard(path, &label, "a readable data set", || self.group.dataset(name))?;
        let (size, number) = match dataset.dtype() {
            Datatype::FloatingPoint { size: 4, .. } => (4, Number::F32),
            Datatype::FloatingPoint { size: 8, .. } => (8, Number::F64),
            Datatype::FixedPoint { size, signed, .. } => match (size, signed) {
                (1, true) => (1, Number::I8),
                (1, false) => (1, Number::U8),
                (2, true) => (2, Number::I16),
                (2, false) => (2, Number::U16),
                (4, true) => (4, Number::I32),
                (4, false) => (4, Number::U32),
                (8, true) => (8, Number::I64),
                (8, false) => (8, Number::U64),
                _ => return Ok(None),
            },
            _ => return Ok(None),
        };
        let (rows, components, flat) = match *dataset.shape() {
            [rows] => (rows, 1, true),
            [rows, components] if (1..=MOST_COMPONENTS).contains(&components) => (rows, components, false),
            _ => return Ok(None),
        };
        let chunked = guard(path, &label, "a readable layout", || Ok(dataset.chunks().is_some()))?;
        let most = self.file.bytes.saturating_mul(if chunked { MOST_EXPANSION } else { 1 });
        let wanted = rows.checked_mul(components * size);
        if wanted.is_none_or(|wanted| wanted > most) {
            let found = format!("{rows} x {components} values");
            let expected = format!("no more than a file of {} bytes can hold", self.file.bytes);
            return Err(ImportError::malformed(path, label, found, expected));
        }
        let components = components as usize;
        Ok(Some(Column { path: path.clone(), label, dataset, rows, components, flat, number }))
    }
}

/// The attributes of one group or data set.
pub(in crate::import) struct Attributes {
    pub(super) path: PathBuf,
    pub(super) label: String,
    pub(super) list: Vec<Attribute>,
}

impl Attributes {
    pub(super) fn find(&self, name: &str) -> Option<&Attribute> {
        self.list.iter().find(|attribute| attribute.name == name)
    }

    /// The numbers of an attribute, if it is there and numeric.
    pub(in crate::import) fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let attribute = self.find(name)?;
        macro_rules! read {
            ($number:ty) => {
                attribute.read_1d::<$number>().map(|values| values.into_iter().map(|value| value as f64).collect())
            };
        }
        let read = || match attribute.datatype {
            Datatype::FixedPoint { size: 1, signed: true, .. } => read!(i8),
            Datatype::FixedPoint { size: 1, signed: false, .. } => read!(u8),
            Datatype::FixedPoint { size: 2, signed: true, .. } => read!(i16),
            Datatype::FixedPoint { size: 2, signed: false, .. } => read!(u16),
            Datatype::FixedPoint { size: 4, signed: true, .. } => read!(i32),
            Datatype::FixedPoint { size: 4, signed: false, .. } => read!(u32),
            Datatype::FixedPoint { signed: true, .. } => read!(i64),
            Datatype::FixedPoint { signed: false, .. } => read!(u64),
            Datatype::FloatingPoint { size: 4, .. } => read!(f32),
            _ => read!(f64),
        };
        guard(&self.path, &self.label, "numbers", read).ok()
    }

    /// Whether there is an attribute of that name.
    pub(in crate::import) fn has(&self, name: &str) -> bool {
        self.find(name).is_some()
    }

    /// An error about an attribute.
    pub(super) fn malformed(&self, name: &str, found: String, expected: &str) -> ImportError {
        ImportError::malformed(&self.path, format!("{}/{name}", self.label), found, expected)
    }

    /// The first number of an attribute.
    pub(in crate::import) fn number(&self, name: &str) -> Option<f64> {
        self.numbers(name)?.first().copied()
    }

    /// A text attribute.
    pub(in crate::import) fn text(&self, name: &str) -> Option<String> {
        let attribute = self.find(name)?;
        let text = guard(&self.path, &self.label, "text", || attribute.read_string()).ok();
        text.or_else(|| attribute.decoded_strings.as_ref().and_then(|strings| strings.first().cloned()))
    }

    /// The bytes of a text of fixed length, which may be in any code.
    pub(in crate::import) fn bytes(&self, name: &str) -> Option<&[u8]> {
        let attribute = self.find(name)?;
        let is_fixed = matches!(attribute.datatype, Datatype::String { size: StringSize::Fixed(_), .. });
        is_fixed.then_some(&*attribute.raw_data)
    }

    /// The unit that a data set names in words, and the attribute in which it does.
    pub(in crate::import) fn unit(&self) -> Option<(&'static str, String)> {
        let stated = UNITS.into_iter().find_map(|name| Some((name, self.text(name)?)));
        stated.filter(|(_, text)| !text.trim().is_empty())
    }

    /// The counts of an attribute such as `NumPart_ThisFile`.
    pub(super) fn counts(&self, name: &str) -> Result<Option<Vec<u64>>, ImportError> {
        let Some(numbers) = self.numbers(name) else { return Ok(None) };
        let count =
            |number: &f64| (*number >= 0.0 && *number < 9e15 && number.fract() == 0.0).then_some(*number as u64);
        match numbers.iter().map(count).collect::<Option<Vec<u64>>>() {
            Some(counts) => Ok(Some(counts)),
            None => {
                let field = format!("{}/{name}", self.label);
                Err(ImportError::malformed(&self.path, field, format!("{numbers:?}"), "numbers of particles"))
            }
        }
    }
}

/// How the values of a column are stored.
#[derive(Clone, Copy)]
enum Number {
    F32,
    F64,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
}

/// A numeric data set of one row per particle.
pub(in crate::import) struct Column {
    path: PathBuf,
    /// Path inside the file, without a leading slash.
    pub label: String,
    dataset: Dataset,
    /// Number of particles.
    pub rows: u64,
    /// Values per particle.
    pub components: usize,
    flat: bool,
    number: Number,
}

impl Column {
    /// The attributes of the data set.
    pub(in crate::import) fn attributes(&self) -> Result<Attributes, ImportError> {
        let list = guard(&self.path, &self.label, "readable attributes", || Ok(self.dataset.attributes()))?;
        Ok(Attributes { path: self.path.clone(), label: self.label.clone(), list })
    }

    /// Whether its numbers are stored as whole ones.
    pub(in crate::import) fn is_whole(&self) -> bool {
        !matches!(self.number, Number::F32 | Number::F64)
    }

    fn slice(&self, rows: Range<u64>) -> SliceInfo {
        let rows = SliceInfoElem::Slice { start: rows.start, end: rows.end, step: 1 };
        let all = SliceInfoElem::Slice { start: 0, end: self.components as u64, step: 1 };
        SliceInfo { selections: if self.flat { vec![rows] } else { vec![rows, all] } }
    }

    /// Reads rows of one whole number each, exactly. Negative numbers become what their bits mean without a sign: ids that were
    /// written with the wrong one come out right.
    pub(in crate::import) fn read_whole(&self, rows: Range<u64>, out: &mut [u64]) -> Result<(), ImportError> {
        macro_rules! read {
            ($number:ty, $unsigned:ty) => {
                guard(&self.path, &self.label, "readable values", || {
                    let array = self.dataset.read_slice::<$number>(&self.slice(rows))?;
                    let read = array.len();
                    for (out, value) in out.iter_mut().zip(array.iter()) {
                        *out = *value as $unsigned as u64;
                    }
                    Ok(read)
                })
            };
        }
        let read = match self.number {
            Number::I8 => read!(i8, u8),
            Number::I16 => read!(i16, u16),
            Number::I32 => read!(i32, u32),
            Number::I64 => read!(i64, u64),
            Number::U8 => read!(u8, u8),
            Number::U16 => read!(u16, u16),
            Number::U32 => read!(u32, u32),
            Number::U64 => read!(u64, u64),
            Number::F32 | Number::F64 => {
                let mut values = vec![0.0; out.len()];
                self.read(rows, &mut values)?;
                for (out, value) in out.iter_mut().zip(&values) {
                    let expected = "whole numbers from 0 to 2^53";
                    let wrong = || ImportError::malformed(&self.path, &*self.label, value, expected);
                    *out = exact_id(*value).ok_or_else(wrong)?;
                }
                Ok(values.len())
            }
        }?;
        self.as_many(read, out.len())
    }

    fn as_many(&self, read: usize, wanted: usize) -> Result<(), ImportError> {
        if read == wanted {
            Ok(())
        } else {
            let found = format!("{read} values");
            Err(ImportError::malformed(&self.path, &*self.label, found, format!("{wanted} values")))
        }
    }

    /// Reads rows into `out`, row by row.
    pub(in crate::import) fn read(&self, rows: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let slice = self.slice(rows);
        macro_rules! read {
            ($number:ty) => {
                guard(&self.path, &self.label, "readable values", || {
                    let array = self.dataset.read_slice::<$number>(&slice)?;
                    let read = array.len();
                    for (out, value) in out.iter_mut().zip(array.iter()) {
                        *out = *value as f64;
                    }
                    Ok(read)
                })
            };
        }
        let read = match self.number {
            Number::F32 => read!(f32),
            Number::F64 => read!(f64),
            Number::I8 => read!(i8),
            Number::I16 => read!(i16),
            Number::I32 => read!(i32),
            Number::I64 => read!(i64),
            Number::U8 => read!(u8),
            Number::U16 => read!(u16),
            Number::U32 => read!(u32),
            Number::U64 => read!(u64),
        }?;
        self.as_many(read, out.len())
    }
}

/// Runs `work` of the reader library; its errors and its panics become one error for `field`.
pub(super) fn guard<T>(
    path: &Path,
    field: &str,
    expected: &str,
    work: impl FnOnce() -> hdf5_reader::error::Result<T>,
) -> Result<T, ImportError> {
    match guarded(work) {
        Some(Ok(value)) => Ok(value),
        Some(Err(error)) => {
            let text = error.to_string().replace(['\n', '\r'], " ");
            Err(ImportError::malformed(path, field, text, expected))
        }
        None => Err(ImportError::malformed(path, field, "damage that the HDF5 reader gave up on", expected)),
    }
}
