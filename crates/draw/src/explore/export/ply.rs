//! PLY, the polygon file format, of points alone: binary, little-endian. Every number is a double, but for the family, Gadget's number as a
//! byte (255: another family), and ids, which the format has no numbers for: their lower and their upper 32 bits. What a family does not
//! have is not a number. Units are comments.

use super::{Block, Layout, Out, Table};
use std::io::{self, Seek, SeekFrom, Write};

/// Digits of the number of points, which is known when all are written.
const DIGITS: usize = 20;

pub(super) struct Ply<'a> {
    out: Out<'a>,
    /// Where the number of points is.
    count_at: u64,
    rows: u64,
}

impl<'a> Ply<'a> {
    pub(super) fn new(mut out: Out<'a>, layout: &Layout) -> io::Result<Ply<'a>> {
        let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
        let word = |name: &str| name.replace(char::is_whitespace, "_");
        for column in layout.columns.iter().filter(|column| !column.unit.is_unknown()) {
            let unit = column.unit.0.replace(['\n', '\r'], " ");
            header.push_str(&format!("comment unit of {}: {unit}\n", word(&column.name)));
        }
        header.push_str("element vertex ");
        let count_at = header.len() as u64;
        // Behind the number is a comment as long as the number is short.
        header.push_str(&count_line(0));
        header.push_str("property uchar family\n");
        if layout.has_ids {
            header.push_str("property uint id_low\nproperty uint id_high\n");
        }
        for column in &layout.columns {
            header.push_str(&format!("property double {}\n", word(&column.name)));
        }
        header.push_str("end_header\n");
        out.write_all(header.as_bytes())?;
        Ok(Ply { out, count_at, rows: 0 })
    }
}

/// The number of points, and what fills the line up to the same length for each.
pub(super) fn count_line(rows: u64) -> String {
    let number = rows.to_string();
    let rest = "-".repeat(DIGITS - number.len());
    format!("{number}\ncomment {rest}-\n")
}

/// Writes what is left, and the number of points where it belongs.
pub(super) fn finish(mut out: Out<'_>, count_at: u64, rows: u64) -> io::Result<u64> {
    out.flush()?;
    let file = out.get_mut();
    file.seek(SeekFrom::Start(count_at))?;
    file.write_all(count_line(rows).as_bytes())?;
    Ok(rows)
}

impl Table for Ply<'_> {
    type Piece = (Vec<u8>, usize);

    fn prepare(block: Block) -> (Vec<u8>, usize) {
        block.packed(u64::to_le_bytes, f64::to_le_bytes)
    }

    fn write(&mut self, (bytes, rows): (Vec<u8>, usize)) -> io::Result<()> {
        self.rows += rows as u64;
        self.out.write_all(&bytes)
    }

    fn finish(self) -> io::Result<u64> {
        finish(self.out, self.count_at, self.rows)
    }
}
