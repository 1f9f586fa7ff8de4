//! NumPy's arrays (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>). The last axis is x.

use super::content::Content;
use super::fields::Entry;
use super::layout::Layout;
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, SampleType};
use std::path::Path;

/// Arrays of two axes are images, of three volumes; of four, volumes whose last axis is that of values.
pub(super) const NPY: GridFormat = GridFormat {
    name: "npy",
    extensions: &["npy"],
    has_parts: false,
    detect: |content| content.head.starts_with(b"\x93NUMPY"),
    open,
};

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let array = Array::read(&content.path, &content.head)?;
    let storage = content.samples(array.start, array.bytes, &array.grid)?;
    let layout = array.layout(if content.is_packed { 0 } else { array.start });
    Ok(GridSource::new(GridDescription::new(&content.path, NPY.name, content.length, array.grid), storage, layout))
}

/// What the header of an array says.
pub(super) struct Array {
    /// The grid.
    pub grid: Grid,
    /// Size of its samples, bytes.
    pub bytes: u64,
    /// The byte behind the header.
    pub start: u64,
    /// Its axes, the fastest first: 1 to 3 are x, y and z, 0 is that of values.
    axes: [usize; 4],
    order: Order,
}

impl Array {
    /// Samples that begin at byte `offset` of what is read.
    pub(super) fn layout(&self, offset: u64) -> Layout {
        Layout::packed(&self.grid, self.axes, offset, self.order)
    }

    /// Reads the header that an array begins with.
    ///
    /// # Errors
    /// What is wrong with it, or with the array as a grid.
    pub(super) fn read(path: &Path, head: &[u8]) -> Result<Array, ImportError> {
        let header = Header::read(path, head)?;
        let kind = header.kind;
        let grid = match header.sizes[..] {
            [y, x] => Grid::image([x, y], kind, Channel::numbered(1)),
            [z, y, x] => Grid::volume([x, y, z], kind, Channel::numbered(1)),
            [z, y, x, channels @ 1..=4096] => Grid::volume([x, y, z], kind, Channel::numbered(channels)),
            _ => {
                let expected = "2 axes (an image), 3 (a volume), or 4, the last of at most 4096 values";
                return Err(header.wrong_shape(path, expected));
            }
        };
        Array::of(path, &header, grid)
    }

    /// An array whose numbers are the samples of `grid`.
    ///
    /// # Errors
    /// What is wrong with it as a grid.
    pub(super) fn of(path: &Path, header: &Header, grid: Grid) -> Result<Array, ImportError> {
        let bytes = checked(path, &grid, "shape", "shape")?;
        let axes = match (header.is_fortran, header.sizes.len()) {
            (false, _) => [0, 1, 2, 3],
            (true, 2) => [2, 1, 3, 0],
            (true, _) => [3, 2, 1, 0],
        };
        Ok(Array { grid, bytes, start: header.start, axes, order: header.order })
    }
}

/// What an array says of itself.
pub(super) struct Header {
    /// Its shape, the slowest axis first unless [`Header::is_fortran`].
    pub sizes: Vec<u64>,
    /// What its numbers are stored in.
    pub kind: SampleType,
    /// Whether the first axis is the fastest.
    pub is_fortran: bool,
    /// The byte behind the header.
    pub start: u64,
    order: Order,
    /// The shape as it is written.
    shape: String,
}

impl Header {
    /// Reads it from what a file begins with.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn read(path: &Path, head: &[u8]) -> Result<Header, ImportError> {
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
        let sizes = shape.text.strip_prefix('(').and_then(|text| text.strip_suffix(')'));
        let sizes = sizes.ok_or_else(|| shape.wrong("numbers in brackets"))?;
        let sizes: Vec<u64> = Entry { text: sizes, ..shape }.values("whole numbers")?;
        Ok(Header { sizes, kind, is_fortran, start, order, shape: shape.text.to_owned() })
    }

    /// The message that an array has another shape.
    pub(super) fn wrong_shape(&self, path: &Path, expected: &str) -> ImportError {
        Entry { path, name: "shape", text: &self.shape }.wrong(expected)
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
        "|" if size == 1 => Some(Order::Little),
        "=" => Some(super::layout::NATIVE),
        _ => None,
    };
    kind.zip(order).ok_or_else(wrong)
}

/// The text of the header, and the byte behind it.
fn header<'h>(path: &Path, head: &'h [u8]) -> Result<(&'h str, u64), ImportError> {
    let wrong = |found: &str| ImportError::malformed(path, "header", found, "a header of NumPy's versions 1 to 3");
    if !head.starts_with(b"\x93NUMPY") {
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
