//! The records of a file of RAMSES, one behind the other: Fortran's unformatted output, in either byte order.

use crate::import::ImportError;
use crate::import::bytes::{Order, RangeFile};
use crate::import::gadget::fortran_record;
use crate::model::ReadMethod;
use std::ops::Range;
use std::path::Path;

/// How the numbers of an array are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    /// Whole numbers of one byte.
    Byte,
    /// Whole numbers of four bytes.
    Whole,
    /// Whole numbers of eight bytes.
    Long,
    /// Floats of four bytes.
    Single,
    /// Floats of eight bytes.
    Double,
}

/// Numbers of one kind without gaps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Array {
    offset: u64,
    stored: Stored,
}

impl Array {
    /// The same bytes read as whole numbers, or as floats; single bytes are always whole.
    pub(super) fn taken_as(self, whole: bool) -> Array {
        let stored = match (self.stored, whole) {
            (Stored::Byte, _) => Stored::Byte,
            (Stored::Whole | Stored::Single, true) => Stored::Whole,
            (Stored::Whole | Stored::Single, false) => Stored::Single,
            (Stored::Long | Stored::Double, true) => Stored::Long,
            (Stored::Long | Stored::Double, false) => Stored::Double,
        };
        Array { stored, ..self }
    }

    /// Whether its numbers are single bytes.
    pub(super) fn is_of_bytes(self) -> bool {
        self.stored == Stored::Byte
    }

    fn size(self) -> usize {
        match self.stored {
            Stored::Byte => 1,
            Stored::Whole | Stored::Single => 4,
            Stored::Long | Stored::Double => 8,
        }
    }
}

/// A place in a file, which moves from record to record.
pub(super) struct Walk {
    /// The file.
    pub file: RangeFile,
    order: Order,
    at: u64,
}

impl Walk {
    /// At the beginning of a file, whose first record is a whole number.
    ///
    /// # Errors
    /// When it cannot be read, or does not begin so.
    pub(super) fn open(path: &Path, method: ReadMethod) -> Result<Walk, ImportError> {
        let file = RangeFile::open(path, method)?;
        let mut marker = [0; 4];
        file.read(0, &mut marker, "header")?;
        let order = Order::BOTH.into_iter().find(|order| order.u32(&marker, 0) == 4);
        let wrong = || {
            let found = format!("a record of {} bytes", Order::Little.u32(&marker, 0));
            ImportError::malformed(path, "header", found, "one of 4 bytes, with the number of processes")
        };
        Ok(Walk { order: order.ok_or_else(wrong)?, file, at: 0 })
    }

    /// Whether all records have been passed.
    pub(super) fn is_at_end(&self) -> bool {
        self.at >= self.file.length
    }

    /// An error where records that were passed over are not all there.
    pub(super) fn end(&self, field: &str) -> Result<(), ImportError> {
        if self.at > self.file.length {
            let found = format!("the file's end at byte {}", self.file.length);
            return Err(self.wrong(field, found, format!("records to byte {}", self.at)));
        }
        Ok(())
    }

    /// An error about what is here.
    pub(super) fn wrong(&self, field: &str, found: impl ToString, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(&self.file.path, field, found, expected)
    }

    /// Where the next record's data begins, and how long it is; `field` names it.
    ///
    /// # Errors
    /// When the file ends before it does.
    fn next(&mut self, field: &str) -> Result<(u64, u64), ImportError> {
        let (offset, length) = fortran_record(&self.file, self.order, self.at, field)?;
        self.at = offset + length + 4;
        Ok((offset, length))
    }

    /// Passes over records.
    ///
    /// # Errors
    /// As [`Walk::next`].
    pub(super) fn skip(&mut self, field: &str, records: usize) -> Result<(), ImportError> {
        (0..records).try_for_each(|_| self.next(field).map(|_| ()))
    }

    /// Passes over records of a known length, all together; that they are there shows behind them.
    pub(super) fn jump(&mut self, records: u64, length: u64) {
        self.at = self.at.saturating_add(records.saturating_mul(length.saturating_add(8)));
    }

    /// The bytes of the next record, at most `most` of them.
    ///
    /// # Errors
    /// As [`Walk::next`], and when there are more.
    pub(super) fn bytes(&mut self, field: &str, most: u64) -> Result<Vec<u8>, ImportError> {
        let (offset, length) = self.next(field)?;
        if length > most {
            return Err(self.wrong(field, format!("a record of {length} bytes"), format!("at most {most}")));
        }
        let mut bytes = vec![0; length as usize];
        self.file.read(offset, &mut bytes, field)?;
        Ok(bytes)
    }

    /// The whole numbers of the next record, `count` of them, of which each is from 0 to `most`.
    ///
    /// # Errors
    /// As [`Walk::next`], and when there are others.
    pub(super) fn wholes(&mut self, field: &str, count: u64, most: u32) -> Result<Vec<u32>, ImportError> {
        let wanted = count.saturating_mul(4);
        let (offset, length) = self.next(field)?;
        if length != wanted {
            return Err(self.wrong(field, format!("a record of {length} bytes"), format!("one of {wanted}")));
        }
        // The record is in the file.
        let mut bytes = vec![0; length as usize];
        self.file.read(offset, &mut bytes, field)?;
        let numbers: Vec<u32> = (0..count as usize).map(|index| self.order.u32(&bytes, 4 * index)).collect();
        match numbers.iter().find(|number| **number > most) {
            Some(number) => Err(self.wrong(field, *number as i32, format!("whole numbers from 0 to {most}"))),
            None => Ok(numbers),
        }
    }

    /// The whole number that is the next record.
    ///
    /// # Errors
    /// As [`Walk::wholes`].
    pub(super) fn whole(&mut self, field: &str, most: u32) -> Result<u32, ImportError> {
        Ok(self.wholes(field, 1, most)?.first().copied().unwrap_or(0))
    }

    /// The float that is the next record, and how many bytes it has.
    ///
    /// # Errors
    /// As [`Walk::next`], and when it is no float.
    pub(super) fn float(&mut self, field: &str) -> Result<(f64, u64), ImportError> {
        let bytes = self.bytes(field, 8)?;
        match bytes.len() {
            4 => Ok((f64::from(f32::from_bits(self.order.u32(&bytes, 0))), 4)),
            8 => Ok((self.order.f64(&bytes, 0), 8)),
            length => Err(self.wrong(field, format!("a record of {length} bytes"), "one number of 4 or 8")),
        }
    }

    /// The next record as `count` numbers, floats unless they have one byte.
    ///
    /// # Errors
    /// As [`Walk::next`], and when there are others.
    pub(super) fn array(&mut self, field: &str, count: u64) -> Result<Array, ImportError> {
        let (offset, length) = self.next(field)?;
        let stored = match length.checked_div(count).filter(|size| size.checked_mul(count) == Some(length)) {
            Some(1) => Stored::Byte,
            Some(4) => Stored::Single,
            Some(8) => Stored::Double,
            _ => {
                let found = format!("a record of {length} bytes");
                return Err(self.wrong(field, found, format!("{count} numbers of 1, 4 or 8 bytes")));
            }
        };
        Ok(Array { offset, stored })
    }

    /// Reads numbers of an array, each as eight bytes of this machine's order: whole ones as `i64`, others as `f64`. `raw` is room to
    /// work in.
    ///
    /// # Errors
    /// When the file cannot be read there.
    pub(super) fn words(
        &self,
        array: Array,
        range: &Range<u64>,
        raw: &mut Vec<u8>,
        out: &mut Vec<[u8; 8]>,
    ) -> Result<(), ImportError> {
        let size = array.size();
        raw.resize((range.end - range.start) as usize * size, 0);
        self.file.read(array.offset + range.start * size as u64, raw, "data")?;
        if self.order != Order::NATIVE {
            raw.chunks_mut(size).for_each(<[u8]>::reverse);
        }
        out.clear();
        let fours = raw.as_chunks::<4>().0.iter();
        match array.stored {
            Stored::Byte => out.extend(raw.iter().map(|byte| i64::from(*byte as i8).to_ne_bytes())),
            Stored::Whole => out.extend(fours.map(|word| i64::from(i32::from_ne_bytes(*word)).to_ne_bytes())),
            Stored::Single => out.extend(fours.map(|word| f64::from(f32::from_ne_bytes(*word)).to_ne_bytes())),
            Stored::Long | Stored::Double => out.extend_from_slice(raw.as_chunks::<8>().0),
        }
        Ok(())
    }
}
