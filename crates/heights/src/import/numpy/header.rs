//! What an array says of itself.

use crate::import::content::{Content, word};
use crate::import::raw::{ByteOrder, Layout, NATIVE, decode};
use deepfield_data::import::ImportError;
use deepfield_data::model::SampleType;

/// What arrays begin with.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// The header of an array.
#[derive(Debug)]
pub(super) struct Header {
    /// Its shape, the slowest axis first unless it is in Fortran's order.
    pub sizes: Vec<u64>,
    /// What its numbers are stored in.
    pub sample_type: SampleType,
    /// The byte behind the header.
    pub start: u64,
    order: ByteOrder,
    is_fortran: bool,
}

impl Header {
    /// Reads it from what an array begins with.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn read(content: &Content, head: &[u8]) -> Result<Header, ImportError> {
        let wrong = |found: &str| content.malformed("header", found, "a header of NumPy's versions 1 to 3");
        if !head.starts_with(MAGIC) {
            return Err(wrong("another beginning"));
        }
        let (start, length) = match head.get(6) {
            Some(1) => (10, u32::from(u16::from_le_bytes(word(head, 8)))),
            Some(2 | 3) => (12, u32::from_le_bytes(word(head, 8))),
            Some(other) => return Err(wrong(&format!("version {other}"))),
            None => return Err(wrong("the end of the file")),
        };
        let end = start + length as usize;
        let text = head.get(start..end).ok_or_else(|| wrong("one that is longer than the file or 64 KiB"))?;
        let text = std::str::from_utf8(text).map_err(|_| wrong("one that is no text"))?;
        let value = |key: &str| value(text, key).ok_or_else(|| content.missing(key, "an entry of the header"));

        let descr = value("descr")?;
        let expected = "whole numbers or floats of 8 to 64 bits, such as '<f4'";
        let (sample_type, order) = sample_type(descr).ok_or_else(|| content.malformed("descr", descr, expected))?;
        let is_fortran = match value("fortran_order")? {
            "True" => true,
            "False" => false,
            other => return Err(content.malformed("fortran_order", other, "True or False")),
        };
        let shape = value("shape")?;
        let sizes = shape.strip_prefix('(').and_then(|shape| shape.strip_suffix(')')).and_then(sizes);
        let sizes = sizes.ok_or_else(|| content.malformed("shape", shape, "whole numbers in brackets"))?;
        Ok(Header { sizes, sample_type, start: end as u64, order, is_fortran })
    }

    /// Its shape as Python writes it.
    pub(super) fn shape(&self) -> String {
        format!("({})", self.sizes.iter().map(u64::to_string).collect::<Vec<_>>().join(", "))
    }

    /// Whether it can hold nothing but heights: two axes, and more than a byte a number.
    pub(super) fn holds_heights(&self) -> bool {
        self.sizes.len() == 2 && self.sample_type.size() > 1
    }

    /// Its samples of two axes, from byte `offset` on.
    pub(super) fn layout(&self, size: [u64; 2], offset: u64) -> Layout {
        let of = if self.is_fortran { Layout::by_columns } else { Layout::packed };
        of(size, offset, self.sample_type, self.order)
    }

    /// The numbers of an array with one axis or none, whose bytes are these.
    pub(super) fn numbers(&self, bytes: &[u8]) -> Vec<f64> {
        let size = self.sample_type.size();
        let bytes = bytes.get(self.start as usize..).unwrap_or_default();
        let mut numbers = vec![0.0; bytes.len() / size];
        decode(self.sample_type, self.order, bytes, size, &mut numbers, |number| number);
        numbers
    }
}

/// Numbers with commas between them and maybe one behind.
fn sizes(text: &str) -> Option<Vec<u64>> {
    let text = text.trim();
    let text = text.strip_suffix(',').unwrap_or(text);
    if text.is_empty() {
        return Some(Vec::new());
    }
    // As many as NumPy has at most.
    text.split(',').take(65).map(|size| size.trim().trim_end_matches('L').parse().ok()).collect()
}

/// The type of numbers and their byte order.
fn sample_type(descr: &str) -> Option<(SampleType, ByteOrder)> {
    let word = descr.trim_matches(['\'', '"']);
    let (order, kind) = word.split_at_checked(1)?;
    let (letter, size) = kind.split_at_checked(1)?;
    let size: usize = size.parse().ok()?;
    let kind = match letter {
        "i" => SampleType::whole(size, true),
        "u" => SampleType::whole(size, false),
        // Truth values are bytes of 0 and 1.
        "b" if size == 1 => Some(SampleType::U8),
        "f" => SampleType::float(size),
        _ => None,
    };
    let order = match order {
        "<" => ByteOrder::Little,
        ">" => ByteOrder::Big,
        "=" => NATIVE,
        "|" if size == 1 => NATIVE,
        _ => return None,
    };
    Some((kind?, order))
}

/// What stands behind a key of the dictionary that a header is.
fn value<'t>(text: &'t str, key: &str) -> Option<&'t str> {
    let behind = |quote: char| text.split_once(&format!("{quote}{key}{quote}")).map(|(_, behind)| behind);
    let rest = behind('\'').or_else(|| behind('"'))?.trim_start().strip_prefix(':')?.trim_start();
    // A tuple ends with its bracket, anything else with a comma or the dictionary's bracket.
    let end = if rest.starts_with('(') { rest.find(')')? + 1 } else { rest.find([',', '}'])? };
    Some(rest.get(..end)?.trim())
}
