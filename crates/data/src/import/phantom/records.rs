//! The records of a PHANTOM dump, one behind the other: Fortran's unformatted output, in either byte order, with numbers of eight kinds.

use crate::import::ImportError;
use crate::import::bytes::{Order, RangeFile};
use crate::import::gadget::fortran_record;
use crate::model::SampleType;

/// Numbers of kinds of which some have the size that the program was compiled with.
pub(super) const KINDS: usize = 8;

/// The numbers that a dump begins with: Phantom's `int1`, `int2` and `int1o`.
const FIRST: u32 = 60_769;
const SECOND: u32 = 60_878;
const THIRD: u32 = 690_706;

/// Letters of a tag.
const TAG: u64 = 16;

/// How the numbers of a dump are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    /// The order of bytes.
    pub order: Order,
    /// Whether default reals are doubles.
    is_double: bool,
}

impl Layout {
    /// That of a file which begins with these bytes: the length of a record, a whole number, a default real, three whole numbers.
    pub(super) fn of(head: &[u8]) -> Option<Layout> {
        Order::BOTH.into_iter().find_map(|order| {
            let whole = |at: usize| order.u32(head, at);
            let (is_double, real, end) = match whole(0) {
                20 => (false, f64::from(f32::from_bits(whole(8))), 12),
                24 => (true, order.f64(head, 8), 16),
                _ => return None,
            };
            let is_dump = (whole(4), whole(end), whole(end + 8)) == (FIRST, SECOND, THIRD);
            (is_dump && real == f64::from(SECOND)).then_some(Layout { order, is_double })
        })
    }

    /// The types of the eight kinds: default whole numbers, those of 1, 2, 4 and 8 bytes, default reals, those of 4 and 8 bytes.
    pub(super) fn kinds(self) -> [SampleType; KINDS] {
        use SampleType::{F32, F64, I8, I16, I32, I64};
        [I32, I8, I16, I32, I64, if self.is_double { F64 } else { F32 }, F32, F64]
    }
}

/// A place in a dump, which moves from record to record.
pub(super) struct Walk<'a> {
    pub file: &'a RangeFile,
    pub layout: Layout,
    pub at: u64,
}

impl Walk<'_> {
    /// The byte at which the next record's data begins; `field` names it. It is `length` bytes long.
    ///
    /// # Errors
    /// When the file ends before, or the record has another length.
    pub(super) fn record(&mut self, field: &str, length: u64) -> Result<u64, ImportError> {
        let (offset, found) = fortran_record(self.file, self.layout.order, self.at, field)?;
        if found != length {
            let found = format!("a record of {found} bytes");
            return Err(ImportError::malformed(&self.file.path, field, found, format!("one of {length} bytes")));
        }
        self.at = offset + length + 4;
        Ok(offset)
    }

    /// The bytes of the next record, `length` of them: few.
    ///
    /// # Errors
    /// As [`Walk::record`].
    pub(super) fn bytes(&mut self, field: &str, length: u64) -> Result<Vec<u8>, ImportError> {
        let offset = self.record(field, length)?;
        // The record is in the file.
        let mut bytes = vec![0; length as usize];
        self.file.read(offset, &mut bytes, field)?;
        Ok(bytes)
    }

    /// The bytes of the next record, 2 to `most` of them.
    ///
    /// # Errors
    /// When the file ends before, or the record has another length.
    pub(super) fn text(&mut self, field: &str, most: u64) -> Result<Vec<u8>, ImportError> {
        let (_, length) = fortran_record(self.file, self.layout.order, self.at, field)?;
        if !(2..=most).contains(&length) {
            let found = format!("a record of {length} bytes");
            return Err(ImportError::malformed(&self.file.path, field, found, format!("one of 2 to {most} bytes")));
        }
        self.bytes(field, length)
    }

    /// A record with a whole number from 0 to `most` in it.
    ///
    /// # Errors
    /// As [`Walk::record`], and where the number is another.
    pub(super) fn count(&mut self, field: &str, most: u32) -> Result<u32, ImportError> {
        let bytes = self.bytes(field, 4)?;
        self.checked(field, self.layout.order.u32(&bytes, 0), most)
    }

    /// The number, if it is at most `most`.
    ///
    /// # Errors
    /// Where it is not.
    pub(super) fn checked(&self, field: &str, number: u32, most: u32) -> Result<u32, ImportError> {
        if number > most {
            let found = number as i32;
            return Err(ImportError::malformed(&self.file.path, field, found, format!("a number from 0 to {most}")));
        }
        Ok(number)
    }

    /// `count` tags.
    ///
    /// # Errors
    /// As [`Walk::record`].
    pub(super) fn tags(&mut self, field: &str, count: u32) -> Result<Vec<String>, ImportError> {
        let bytes = self.bytes(field, TAG * u64::from(count))?;
        let text = |tag: &[u8]| {
            let text = String::from_utf8_lossy(tag);
            text.trim_matches(|letter: char| letter.is_whitespace() || letter.is_control())
                .replace(char::is_control, "?")
        };
        Ok(bytes.chunks(TAG as usize).map(text).collect())
    }
}
