//! Samples that are written as text.

use super::super::ImportError;
use super::content::{in_one_line, too_few};
use super::scratch::{Scratch, Storage};
use crate::model::Grid;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The longest word that may be a number, bytes.
const LONGEST: usize = 400;

/// How much of the samples is written at once, bytes.
const BATCH: usize = 1 << 16;

/// Parses the `bytes` bytes of samples of `grid` from text in which numbers stand between spaces or commas. The text can have no more
/// than `most` bytes, of which a number takes two.
///
/// # Errors
/// Where there are too few of them, or something else.
pub(super) fn parsed(
    reader: impl Read,
    path: &Path,
    most: u64,
    bytes: u64,
    grid: &Grid,
) -> Result<Storage, ImportError> {
    let size = grid.sample_type.size();
    let count = bytes / size as u64;
    let few = |found: u64| too_few(path, &format!("{found} numbers"), bytes, grid);
    if most.saturating_add(1) / 2 < count {
        return Err(too_few(path, &format!("at most {} numbers", most.saturating_add(1) / 2), bytes, grid));
    }
    let mut scratch = Scratch::new(path);
    let mut reader = BufReader::with_capacity(1 << 18, reader);
    let mut samples = Vec::with_capacity(BATCH + 8);
    let mut word = Vec::new();
    let mut found = 0;
    while found < count {
        let buffer = reader
            .fill_buf()
            .map_err(|error| ImportError::malformed(path, "data", in_one_line(&error), format!("{count} numbers")))?;
        let is_end = buffer.is_empty();
        let length = buffer.len();
        // Behind the last byte of the text a word ends, too.
        for &byte in buffer.iter().chain(is_end.then_some(&b' ')) {
            if !byte.is_ascii_whitespace() && byte != b',' {
                word.push(byte);
                if word.len() > LONGEST {
                    return Err(ImportError::malformed(path, "data", "a long word", "numbers"));
                }
                continue;
            }
            if word.is_empty() || found == count {
                continue;
            }
            let text = String::from_utf8_lossy(&word);
            if !grid.sample_type.parse_into(&text, &mut samples) {
                let shown: String = text.chars().filter(|c| !c.is_control()).take(40).collect();
                let expected = format!("a number of type {}", grid.sample_type);
                return Err(ImportError::malformed(path, format!("data: number {}", found + 1), shown, expected));
            }
            word.clear();
            found += 1;
            if samples.len() >= BATCH {
                scratch.write(&samples)?;
                samples.clear();
            }
        }
        reader.consume(length);
        if is_end && found < count {
            return Err(few(found));
        }
    }
    scratch.write(&samples)?;
    scratch.into_storage()
}
