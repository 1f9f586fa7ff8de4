//! Files read by byte range, and numbers in either byte order.

use super::ImportError;
use super::unpacking::unpacked_once;
use crate::model::{ReadFile, ReadMethod};
use std::cell::RefCell;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A file that several threads read at once by offset. One that shrinks meanwhile gives an error.
pub(super) struct RangeFile {
    /// The file's name.
    pub path: PathBuf,
    /// Its length when it was opened, bytes.
    pub length: u64,
    file: ReadFile,
}

impl RangeFile {
    /// Opens the file, to be read in the way `method`.
    pub(super) fn open(path: &Path, method: ReadMethod) -> Result<RangeFile, ImportError> {
        let io = |source| ImportError::io(path, "file", source);
        RangeFile::of(path, File::open(path).map_err(io)?, method)
    }

    /// The same of [what is in](unpacked_once) the file.
    pub(super) fn open_unpacked(path: &Path, method: ReadMethod) -> Result<RangeFile, ImportError> {
        RangeFile::of(path, unpacked_once(path)?, method)
    }

    /// The same of an open file, which is called `path`.
    pub(super) fn of(path: &Path, file: File, method: ReadMethod) -> Result<RangeFile, ImportError> {
        let length = file.metadata().map_err(|source| ImportError::io(path, "file", source))?.len();
        Ok(RangeFile { path: path.into(), length, file: ReadFile::new(file, method) })
    }

    /// Its bytes from `at` on, one after the other.
    pub(super) fn reader(&self, at: u64) -> impl Read {
        FromHere { file: self, at }
    }

    /// Fills `out` from byte `offset` on; `field` names what is there.
    pub(super) fn read(&self, offset: u64, out: &mut [u8], field: &str) -> Result<(), ImportError> {
        let end = offset.checked_add(out.len() as u64);
        if end.is_none_or(|end| end > self.length) {
            let found = format!("the file's end at byte {}", self.length);
            let expected = format!("{} bytes from byte {offset} on", out.len());
            return Err(ImportError::malformed(&self.path, field, found, expected));
        }
        self.file.read_exact_at(out, offset).map_err(|source| ImportError::io(&self.path, field, source))
    }

    /// Decodes the records of a block from byte `offset` on into `out`, `records.components` numbers for each; `field` names what
    /// is there.
    pub(super) fn decode(
        &self,
        offset: u64,
        records: Records,
        out: &mut [f64],
        field: &str,
    ) -> Result<(), ImportError> {
        let count = out.len() / records.components.max(1);
        RAW.with_borrow_mut(|raw| {
            raw.resize(count * records.stride, 0);
            self.read(offset, raw, field)?;
            if let Some(from_column) = raw.get(records.column..) {
                records.number.decode(records.order, from_column, records.stride, records.components, out);
            }
            Ok(())
        })
    }
}

/// Bytes of a file in their order.
struct FromHere<'a> {
    file: &'a RangeFile,
    at: u64,
}

impl Read for FromHere<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = self.file.length.saturating_sub(self.at).min(out.len() as u64) as usize;
        self.file.file.read_exact_at(&mut out[..count], self.at)?;
        self.at += count as u64;
        Ok(count)
    }
}

impl RangeFile {
    /// Reads whole numbers of 4 or 8 bytes from byte `offset` on; `field` names what is there.
    pub(super) fn whole(
        &self,
        offset: u64,
        number: Number,
        order: Order,
        out: &mut [u64],
        field: &str,
    ) -> Result<(), ImportError> {
        RAW.with_borrow_mut(|raw| {
            raw.resize(out.len() * number.size(), 0);
            self.read(offset, raw, field)?;
            for (out, bytes) in out.iter_mut().zip(raw.chunks_exact(number.size())) {
                let [first, second] = [0, 4].map(|at| u64::from(order.u32(bytes, at)));
                *out = match (number.size(), order) {
                    (4, _) => first,
                    (_, Order::Little) => first | second << 32,
                    (_, Order::Big) => first << 32 | second,
                };
            }
            Ok(())
        })
    }
}

thread_local! {
    /// Bytes on their way from a file, one buffer per thread.
    static RAW: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Numbers that stand at the same place of every record of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Records {
    /// How each is stored.
    pub number: Number,
    /// The order of its bytes.
    pub order: Order,
    /// Bytes of a record.
    pub stride: usize,
    /// First byte of the numbers in a record.
    pub column: usize,
    /// How many numbers follow each other there.
    pub components: usize,
}

/// The order of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

impl Order {
    /// This machine's.
    pub const NATIVE: Order = if cfg!(target_endian = "big") { Order::Big } else { Order::Little };

    /// Both orders.
    pub(super) const BOTH: [Order; 2] = [Order::Little, Order::Big];

    /// The four bytes at `at`; 0 past the end, which callers exclude.
    pub(super) fn u32(self, bytes: &[u8], at: usize) -> u32 {
        let word = bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).unwrap_or_default();
        match self {
            Order::Little => u32::from_le_bytes(word),
            Order::Big => u32::from_be_bytes(word),
        }
    }

    /// The eight bytes at `at` as a number; 0 past the end, which callers exclude.
    pub(super) fn f64(self, bytes: &[u8], at: usize) -> f64 {
        let word = bytes.get(at..at + 8).and_then(|word| word.try_into().ok()).unwrap_or_default();
        match self {
            Order::Little => f64::from_le_bytes(word),
            Order::Big => f64::from_be_bytes(word),
        }
    }
}

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// 32-bit whole number.
    U32,
    /// 64-bit whole number.
    U64,
}

impl Number {
    /// Size in bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Number::F32 | Number::U32 => 4,
            Number::F64 | Number::U64 => 8,
        }
    }

    /// Decodes `components` numbers from the start of every `stride` bytes into `out`.
    pub(super) fn decode(self, order: Order, bytes: &[u8], stride: usize, components: usize, out: &mut [f64]) {
        match (self, order) {
            (Number::F32, Order::Little) => each(bytes, stride, components, out, |b| f32::from_le_bytes(b) as f64),
            (Number::F32, Order::Big) => each(bytes, stride, components, out, |b| f32::from_be_bytes(b) as f64),
            (Number::F64, Order::Little) => each(bytes, stride, components, out, f64::from_le_bytes),
            (Number::F64, Order::Big) => each(bytes, stride, components, out, f64::from_be_bytes),
            (Number::U32, Order::Little) => each(bytes, stride, components, out, |b| u32::from_le_bytes(b) as f64),
            (Number::U32, Order::Big) => each(bytes, stride, components, out, |b| u32::from_be_bytes(b) as f64),
            (Number::U64, Order::Little) => each(bytes, stride, components, out, |b| u64::from_le_bytes(b) as f64),
            (Number::U64, Order::Big) => each(bytes, stride, components, out, |b| u64::from_be_bytes(b) as f64),
        }
    }
}

fn each<const N: usize>(
    bytes: &[u8],
    stride: usize,
    components: usize,
    out: &mut [f64],
    decode: impl Fn([u8; N]) -> f64,
) {
    if stride == N * components {
        for (value, word) in out.iter_mut().zip(bytes.as_chunks::<N>().0) {
            *value = decode(*word);
        }
        return;
    }
    for (record, values) in bytes.chunks(stride).zip(out.chunks_exact_mut(components)) {
        for (value, word) in values.iter_mut().zip(record.as_chunks::<N>().0) {
            *value = decode(*word);
        }
    }
}
