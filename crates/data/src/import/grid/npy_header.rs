//! What NumPy's arrays say of themselves (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).

use super::fields::Entry;
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::SampleType;
use std::path::Path;

/// What an array says of itself.
pub struct NpyHeader {
    /// Its shape, the slowest axis first unless [`NpyHeader::is_fortran`].
    pub sizes: Vec<u64>,
    /// What its numbers are stored in.
    pub kind: SampleType,
    /// The order of their bytes.
    pub order: Order,
    /// Whether the first axis is the fastest.
    pub is_fortran: bool,
    /// The byte behind the header.
    pub start: u64,
    /// The shape as it is written.
    pub shape: String,
}

impl NpyHeader {
    /// What arrays begin with.
    pub const MAGIC: &[u8] = b"\x93NUMPY";

    /// Reads it from what an array begins with; `path` names the file in messages.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(path: &Path, head: &[u8]) -> Result<NpyHeader, ImportError> {
        let (text, start) = header(path, head)?;
        let descr = Entry { path, name: "descr", text: value(path, text, "descr")? };
        let (kind, order) = sample_type(descr)?;
        let fortran = Entry { path, name: "fortran_order", text: value(path, text, "fortran_order")? };
        let is_fortran = match fortran.text {
            "True" => true,
            "False" => false,
            _ => return Err(fortran.wrong("True or False")),
        };
        let shape = Entry { path, name: "shape", text: value(path, text, "shape")? };
        let sizes = shape.text.strip_prefix('(').and_then(|text| text.strip_suffix(')')).and_then(sizes);
        let sizes = sizes.ok_or_else(|| shape.wrong("whole numbers in brackets"))?;
        Ok(NpyHeader { sizes, kind, order, is_fortran, start, shape: shape.text.to_owned() })
    }

    /// The message that an array has another shape.
    pub(super) fn wrong_shape(&self, path: &Path, expected: &str) -> ImportError {
        Entry { path, name: "shape", text: &self.shape }.wrong(expected)
    }
}

/// Numbers with commas between them and maybe one behind; of Python 2 an `L` may follow them.
fn sizes(text: &str) -> Option<Vec<u64>> {
    let text = text.trim().trim_end_matches(',');
    match text {
        "" => Some(Vec::new()),
        text => text.split(',').map(|size| size.trim().trim_end_matches('L').parse().ok()).collect(),
    }
}

/// The type of samples and their byte order.
fn sample_type(descr: Entry) -> Result<(SampleType, Order), ImportError> {
    let expected = "whole numbers or floats of 8 to 64 bits, such as '<f4'";
    let wrong = || descr.wrong(expected);
    let word = descr.text.trim_matches(['\'', '"']);
    let (order, kind) = word.split_at_checked(1).ok_or_else(wrong)?;
    let (letter, size) = kind.split_at_checked(1).ok_or_else(wrong)?;
    let size: usize = size.parse().map_err(|_| wrong())?;
    let kind = match letter {
        "i" => SampleType::whole(size, true),
        "u" => SampleType::whole(size, false),
        // Truth values are bytes of 0 and 1.
        "b" if size == 1 => Some(SampleType::U8),
        "f" => SampleType::float(size),
        _ => None,
    };
    let order = match order {
        "<" => Some(Order::Little),
        ">" => Some(Order::Big),
        "|" if size == 1 => Some(Order::NATIVE),
        "=" => Some(Order::NATIVE),
        _ => None,
    };
    kind.zip(order).ok_or_else(wrong)
}

/// The text of the header, and the byte behind it.
fn header<'h>(path: &Path, head: &'h [u8]) -> Result<(&'h str, u64), ImportError> {
    let wrong = |found: &str| ImportError::malformed(path, "header", found, "a header of NumPy's versions 1 to 3");
    if !head.starts_with(NpyHeader::MAGIC) {
        return Err(wrong("another beginning"));
    }
    let byte = |at: usize| head.get(at).map(|&byte| usize::from(byte)).ok_or_else(|| wrong("the file's end"));
    let (start, length) = match byte(6)? {
        1 => (10, byte(8)? | byte(9)? << 8),
        2 | 3 => (12, byte(8)? | byte(9)? << 8 | byte(10)? << 16 | byte(11)? << 24),
        other => return Err(wrong(&format!("version {other}"))),
    };
    let text = head.get(start..start + length).ok_or_else(|| wrong("one that is longer than the file or 64 KiB"))?;
    let text = std::str::from_utf8(text).map_err(|_| wrong("one that is not text"))?;
    Ok((text, (start + length) as u64))
}

/// What stands behind a key of the dictionary that a header is.
fn value<'t>(path: &Path, text: &'t str, key: &str) -> Result<&'t str, ImportError> {
    let missing = || ImportError::missing(path, key, "an entry of the header");
    let at = ['\'', '"'].iter().find_map(|quote| {
        let name = format!("{quote}{key}{quote}");
        text.find(&name).map(|at| at + name.len())
    });
    let rest = text.get(at.ok_or_else(missing)?..).unwrap_or_default().trim_start();
    let rest = rest.strip_prefix(':').ok_or_else(missing)?.trim_start();
    // A tuple ends with its bracket, anything else with a comma or that of the dictionary.
    let end = match rest.starts_with('(') {
        true => rest.find(')').map(|end| end + 1),
        false => rest.find([',', '}']),
    };
    Ok(rest.get(..end.ok_or_else(missing)?).unwrap_or_default().trim())
}
