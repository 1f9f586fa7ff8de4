//! The file layer of GSD (glotzerlab/gsd, `doc/file-layer.rst`, versions 1 and 2): a header, a list of names, and an index with an entry for each
//! chunk, in the order of frames. A chunk is a matrix of numbers of one type, row by row. All numbers are little-endian.

use super::super::index::MOST_FRAMES;
use super::super::quoted;
use crate::import::ImportError;
use crate::import::bytes::{Order, RangeFile};
use crate::import::grid::scratch::Storage;
use crate::import::typed_columns::{Column, each_number};
use crate::model::{ReadMethod, SampleType};
use std::path::{Path, PathBuf};

/// What a file begins with.
const MAGIC: [u8; 8] = 0x65df_65df_65df_65df_u64.to_le_bytes();

/// Bytes of the header, of an entry of the index, and of a name in files of version 1; lists of names are counted in the latter in all versions.
const HEADER: u64 = 256;
const ENTRY: u64 = 32;
const NAME: u64 = 64;

/// The longest list of names, bytes. It has no more than 2^16.
const MOST_NAMES: u64 = 1 << 24;

/// Entries that are read at a time.
const ENTRIES: u64 = 1 << 9;

/// The type of a chunk of characters.
const CHARACTERS: u8 = 11;

/// Whether a file begins as one of GSD does.
pub(super) fn is_gsd(head: &[u8]) -> bool {
    head.starts_with(&MAGIC)
}

/// An open file.
pub(super) struct GsdFile {
    pub path: PathBuf,
    /// Its length when it was opened, bytes.
    pub length: u64,
    pub storage: Storage,
}

impl GsdFile {
    /// Opens a file, to be read in the way `method`.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub(super) fn open(path: &Path, method: ReadMethod) -> Result<GsdFile, ImportError> {
        let file = RangeFile::open_unpacked(path, method)?;
        Ok(GsdFile { path: path.into(), length: file.length, storage: Storage::File(file) })
    }

    /// So many bytes from a byte on, which are no more than can be held.
    fn bytes(&self, start: u64, count: u64) -> Result<Vec<u8>, ImportError> {
        let mut bytes = vec![0; count as usize];
        self.storage.read(&self.path, start, &mut bytes)?;
        Ok(bytes)
    }
}

/// What the index says of a chunk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Entry {
    /// The frame that it belongs to, from 0.
    pub frame: u64,
    /// Rows of its matrix.
    pub rows: u64,
    /// Columns of its matrix.
    pub columns: u64,
    /// Byte at which it begins; 0: there is no further entry.
    location: u64,
    /// The number of its name.
    pub name: usize,
    kind: u8,
}

impl Entry {
    fn parse(bytes: &[u8]) -> Entry {
        let number = |at: usize| Order::Little.f64(bytes, at).to_bits();
        let last = Order::Little.u32(bytes, 28);
        Entry {
            frame: number(0),
            rows: number(8),
            columns: Order::Little.u32(bytes, 24).into(),
            location: number(16),
            name: (last & 0xffff) as usize,
            kind: (last >> 16) as u8,
        }
    }

    /// Whether it is text.
    pub(super) fn is_text(&self) -> bool {
        self.kind == CHARACTERS
    }

    /// How its numbers are stored.
    fn number(&self) -> Option<SampleType> {
        match self.kind {
            1..=4 => SampleType::whole(1 << (self.kind - 1), false),
            5..=8 => SampleType::whole(1 << (self.kind - 5), true),
            9 => SampleType::float(4),
            10 => SampleType::float(8),
            CHARACTERS => Some(SampleType::U8),
            _ => None,
        }
    }

    /// What a chunk of this name is in messages.
    pub(super) fn field(&self, name: &str) -> String {
        format!("frame {}: {name}", self.frame)
    }

    /// Its shape in messages.
    pub(super) fn shape(&self) -> String {
        format!("{} x {} numbers", self.rows, self.columns)
    }

    /// Bytes that it has.
    pub(super) fn bytes(&self) -> Option<u64> {
        self.rows.checked_mul(self.columns)?.checked_mul(self.number()?.size() as u64)
    }

    /// The first column of its matrix, all of which is in the file.
    ///
    /// # Errors
    /// When it is not, or has no numbers of a known type.
    pub(super) fn column(&self, file: &GsdFile, name: &str) -> Result<Column, ImportError> {
        let Some(number) = self.number() else {
            let expected = "a type of numbers from 1 to 11";
            return Err(ImportError::malformed(&file.path, self.field(name), format!("type {}", self.kind), expected));
        };
        let end = self.bytes().and_then(|bytes| bytes.checked_add(self.location));
        if end.is_none_or(|end| end > file.length) {
            let found = format!("{} of {} bytes from byte {} on", self.shape(), number.size(), self.location);
            let expected = format!("numbers within the {} bytes of the file", file.length);
            return Err(ImportError::malformed(&file.path, self.field(name), found, expected));
        }
        // No overflow, as all of them are in the file; a matrix without rows has none that are read.
        let stride = self.columns.saturating_mul(number.size() as u64);
        Ok(Column { storage: 0, offset: self.location, stride, number, order: Order::Little })
    }

    /// All of its numbers, which are to be so many.
    ///
    /// # Errors
    /// When they are not, or cannot be read.
    pub(super) fn values(&self, file: &GsdFile, name: &str, count: u64) -> Result<Vec<f64>, ImportError> {
        let column = self.column(file, name)?;
        if self.rows.checked_mul(self.columns) != Some(count) {
            let expected = format!("{count} numbers");
            return Err(ImportError::malformed(&file.path, self.field(name), self.shape(), expected));
        }
        let mut values = Vec::with_capacity(count as usize);
        let storages = std::slice::from_ref(&file.storage);
        each_number(&file.path, storages, column, count, |_, value| values.push(value))?;
        Ok(values)
    }
}

/// The names and the index of a file.
#[derive(Clone, Debug)]
pub(super) struct Directory {
    /// The names of chunks.
    pub names: Vec<String>,
    /// How many frames there are; at least 1.
    pub frames: u64,
    /// Byte at which the index begins, and how many entries it has.
    index: u64,
    entries: u64,
}

impl Directory {
    /// Reads the header and the names, and finds the end of the index.
    ///
    /// # Errors
    /// When the file cannot be read, is damaged, or has no frame.
    pub(super) fn read(file: &GsdFile) -> Result<Directory, ImportError> {
        let wrong = |field: &str, found: String, expected: &str| {
            ImportError::malformed(&file.path, field, found, expected.to_owned())
        };
        if file.length < HEADER {
            return Err(wrong("header", format!("{} bytes", file.length), "256 bytes"));
        }
        let head = file.bytes(0, HEADER)?;
        let number = |at: usize| Order::Little.f64(&head, at).to_bits();
        if !is_gsd(&head) {
            return Err(wrong("header", format!("{:#x}", number(0)), "0x65df65df65df65df"));
        }
        let version = Order::Little.u32(&head, 44);
        let major = version >> 16;
        if !(1..=2).contains(&major) {
            return Err(wrong("version", format!("{major}.{}", version & 0xffff), "1 or 2"));
        }
        let schema = head[112..176].split(|byte| *byte == 0).next().unwrap_or_default();
        if schema != b"hoomd" {
            return Err(wrong("schema", quoted(schema), "\"hoomd\""));
        }
        let inside = |field: &str, count: u64, size: u64, start: u64, most: u64| {
            let bytes = count.checked_mul(size).filter(|bytes| *bytes <= most);
            let end = bytes.and_then(|bytes| bytes.checked_add(start));
            let found = || format!("{count} entries of {size} bytes from byte {start} on");
            let expected = || format!("entries within the {} bytes of the file", file.length);
            let bytes = bytes.filter(|_| start >= HEADER && end.is_some_and(|end| end <= file.length));
            bytes.ok_or_else(|| wrong(field, found(), &expected()))
        };
        let (index, allocated) = (number(8), number(16));
        inside("index", allocated, ENTRY, index, u64::MAX)?;
        let start = number(24);
        let names = file.bytes(start, inside("names", number(32), NAME, start, MOST_NAMES)?)?;
        let text = |name: &[u8]| String::from_utf8_lossy(name).replace(char::is_control, "?");
        let first = |name: &[u8]| text(name.split(|byte| *byte == 0).next().unwrap_or_default());
        let is_name = |name: &String| !name.is_empty();
        let names = match major {
            1 => names.chunks(NAME as usize).map(first).take_while(is_name).collect(),
            _ => names.split(|byte| *byte == 0).map(text).take_while(is_name).take(1 << 16).collect(),
        };
        let mut directory = Directory { names, frames: 0, index, entries: allocated };
        directory.entries = directory.first_without(file, |entry| entry.location != 0)?;
        let last = match directory.entries.checked_sub(1) {
            Some(last) => directory.entry(file, last)?.frame,
            None => return Err(wrong("frames", "none".into(), "a frame")),
        };
        let most = MOST_FRAMES + file.length / ENTRY;
        if last >= most {
            return Err(wrong("frames", format!("frame {last}"), &format!("fewer than {most} in so small a file")));
        }
        directory.frames = last + 1;
        Ok(directory)
    }

    /// The number of a name.
    pub(super) fn name(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|own| own == name)
    }

    fn entry(&self, file: &GsdFile, number: u64) -> Result<Entry, ImportError> {
        Ok(Entry::parse(&file.bytes(self.index + number * ENTRY, ENTRY)?))
    }

    /// The number of the first entry that does not satisfy a condition, which no entry behind it does.
    fn first_without(&self, file: &GsdFile, mut is: impl FnMut(&Entry) -> bool) -> Result<u64, ImportError> {
        let (mut from, mut to) = (0, self.entries);
        while from < to {
            let middle = from + (to - from) / 2;
            if is(&self.entry(file, middle)?) { from = middle + 1 } else { to = middle }
        }
        Ok(from)
    }

    /// Calls `each` for the entries from one on until it says that that is enough.
    fn entries_from(
        &self,
        file: &GsdFile,
        mut number: u64,
        mut each: impl FnMut(Entry) -> bool,
    ) -> Result<(), ImportError> {
        while number < self.entries {
            let count = ENTRIES.min(self.entries - number);
            let bytes = file.bytes(self.index + number * ENTRY, count * ENTRY)?;
            if !bytes.chunks_exact(ENTRY as usize).all(|entry| each(Entry::parse(entry))) {
                return Ok(());
            }
            number += count;
        }
        Ok(())
    }

    /// The entries of a frame.
    ///
    /// # Errors
    /// When the index cannot be read, or has more of them than names.
    pub(super) fn frame(&self, file: &GsdFile, frame: u64) -> Result<Vec<Entry>, ImportError> {
        let first = self.first_without(file, |entry| entry.frame < frame)?;
        let mut entries = Vec::new();
        let most = self.names.len();
        self.entries_from(file, first, |entry| {
            let is_own = entry.frame == frame && entries.len() <= most;
            if is_own {
                entries.push(entry);
            }
            is_own
        })?;
        if entries.len() > most {
            let expected = format!("at most {most}, as there are names");
            let field = format!("frame {frame}");
            return Err(ImportError::malformed(&file.path, field, "more chunks", expected));
        }
        Ok(entries)
    }

    /// Calls `each` for the entries behind those of the first frame.
    ///
    /// # Errors
    /// When the index cannot be read.
    pub(super) fn later(&self, file: &GsdFile, mut each: impl FnMut(Entry)) -> Result<(), ImportError> {
        let first = self.first_without(file, |entry| entry.frame == 0)?;
        self.entries_from(file, first, |entry| {
            each(entry);
            true
        })
    }
}
