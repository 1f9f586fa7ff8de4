//! Comma-separated values. Numbers are written with as many digits as it takes to read the same number back; ids as whole numbers;
//! what a family does not have is left empty.

use super::{Block, Layout, Out, Table};
use std::io::{self, Write};

pub(super) struct Csv<'a> {
    out: Out<'a>,
    rows: u64,
}

/// Rows as text.
pub(super) struct Lines {
    text: Vec<u8>,
    rows: usize,
}

impl<'a> Csv<'a> {
    pub(super) fn new(mut out: Out<'a>, layout: &Layout) -> io::Result<Csv<'a>> {
        let mut header = if layout.has_ids { "family,id" } else { "family" }.to_owned();
        for column in &layout.columns {
            let unit = if column.unit.is_unknown() { String::new() } else { format!(" [{}]", column.unit) };
            header.push(',');
            header.push_str(&quoted(&format!("{}{unit}", column.name)));
        }
        header.push('\n');
        out.write_all(header.as_bytes())?;
        Ok(Csv { out, rows: 0 })
    }
}

fn quoted(text: &str) -> String {
    let plain = !text.contains([',', '"', '\n', '\r']);
    if plain { text.to_owned() } else { format!("\"{}\"", text.replace('"', "\"\"").replace(['\n', '\r'], " ")) }
}

impl Table for Csv<'_> {
    type Piece = Lines;

    fn prepare(block: Block) -> Lines {
        let mut text = Vec::with_capacity(block.rows * (16 + 12 * block.columns.len()));
        for row in 0..block.rows {
            text.extend_from_slice(block.family.as_str().as_bytes());
            // A family without ids has the place for one, where others have some.
            if block.has_ids {
                text.push(b',');
            }
            if let Some(id) = block.ids.as_ref().and_then(|ids| ids.get(row)) {
                // Writing to memory cannot fail.
                let _ = write!(text, "{id}");
            }
            for column in &block.columns {
                text.push(b',');
                if let Some(&value) = column.as_ref().and_then(|column| column.get(row)) {
                    number(&mut text, value);
                }
            }
            text.push(b'\n');
        }
        Lines { text, rows: block.rows }
    }

    fn write(&mut self, lines: Lines) -> io::Result<()> {
        self.rows += lines.rows as u64;
        self.out.write_all(&lines.text)
    }

    fn finish(mut self) -> io::Result<u64> {
        self.out.flush()?;
        Ok(self.rows)
    }
}

/// The shortest text that reads back as this number; nothing for what is not one.
fn number(text: &mut Vec<u8>, value: f64) {
    let size = value.abs();
    let _ = match () {
        () if value.is_nan() => Ok(()),
        () if size == 0.0 || (1e-5..1e17).contains(&size) || size.is_infinite() => write!(text, "{value}"),
        () => write!(text, "{value:e}"),
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_read_back(value in any::<f64>(), single in any::<f32>()) {
            for value in [value, f64::from(single)] {
                let mut text = Vec::new();
                number(&mut text, value);
                let text = String::from_utf8(text).unwrap();
                prop_assert!(if value.is_nan() { text.is_empty() } else { text.parse() == Ok(value) }, "{}", text);
                prop_assert!(text.len() < 28);
            }
        }
    }
}
