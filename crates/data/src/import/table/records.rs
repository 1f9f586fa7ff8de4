//! Rows of text, one after the other: the values that something separates.

use super::columns::shown;
use crate::import::ImportError;
use csv::{ByteRecord, ReaderBuilder};
use std::io::{BufRead, Read};
use std::path::Path;

/// The longest line between whose blanks values are looked for, bytes.
const LONGEST: u64 = 1 << 20;

/// What separates values.
#[derive(Clone, Copy)]
pub(super) enum Delimiter {
    /// Each of these bytes.
    Each(u8),
    /// Any number of blanks and tabs. Empty lines are no rows, nor is what is behind a `#`.
    Blanks,
}

/// The rows of a table.
pub(super) struct Records {
    rows: Rows,
    line: u64,
}

enum Rows {
    Each(Box<csv::Reader<Box<dyn BufRead>>>),
    Blanks { reader: Box<dyn BufRead>, line: Vec<u8> },
}

impl Records {
    /// The rows that follow so many lines.
    pub(super) fn new(reader: Box<dyn BufRead>, delimiter: Delimiter, lines: u64) -> Records {
        let rows = match delimiter {
            Delimiter::Each(delimiter) => {
                let mut csv = ReaderBuilder::new();
                csv.has_headers(false).delimiter(delimiter).flexible(true);
                Rows::Each(Box::new(csv.from_reader(reader)))
            }
            Delimiter::Blanks => Rows::Blanks { reader, line: Vec::new() },
        };
        Records { rows, line: lines }
    }

    /// The line of the row that was read last, from 1.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// Reads the next row; false at the end.
    ///
    /// # Errors
    /// When the file cannot be read, or a line is too long.
    pub(super) fn read(&mut self, path: &Path, record: &mut ByteRecord) -> Result<bool, ImportError> {
        self.line += 1;
        match &mut self.rows {
            Rows::Each(csv) => csv.read_byte_record(record).map_err(|error| {
                let found = error.to_string().replace(['\n', '\r'], " ");
                ImportError::malformed(path, format!("line {}", self.line), found, "a line of the table")
            }),
            Rows::Blanks { reader, line } => loop {
                line.clear();
                let read = reader.by_ref().take(LONGEST).read_until(b'\n', line);
                let read = read.map_err(|source| ImportError::io(path, format!("line {}", self.line), source))?;
                if read == 0 {
                    return Ok(false);
                }
                if read as u64 == LONGEST && !line.ends_with(b"\n") {
                    let found = shown(&String::from_utf8_lossy(line));
                    let expected = format!("a line of fewer than {LONGEST} bytes");
                    return Err(ImportError::malformed(path, format!("line {}", self.line), found, expected));
                }
                record.clear();
                words(line).for_each(|word| record.push_field(word));
                if !record.is_empty() {
                    return Ok(true);
                }
                self.line += 1;
            },
        }
    }
}

/// The values of a line: what stands between blanks, or in quotes, up to a comment.
pub(super) fn words(mut line: &[u8]) -> impl Iterator<Item = &[u8]> {
    std::iter::from_fn(move || {
        line = line.trim_ascii_start();
        let first = *line.first().filter(|byte| **byte != b'#')?;
        let is_quote = matches!(first, b'"' | b'\'');
        let quoted = line[1..].iter().position(|byte| is_quote && *byte == first);
        let (word, rest) = match quoted {
            Some(length) => (&line[1..=length], &line[length + 2..]),
            None => line.split_at(line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len())),
        };
        line = rest;
        Some(word)
    })
}
