//! The values: words between blanks, several pieces of the text at a time.

use crate::import::content::{Content, in_one_line};
use crate::import::unpack::{Unpacked, unpacked};
use deepfield_data::import::ImportError;
use deepfield_data::model::SampleType;
use rayon::prelude::*;
use std::io::{Error, Read};

/// Bytes of text that are read at once, and those of a part of it that a thread reads.
const PIECE: usize = 4 << 20;
const PART: usize = 256 << 10;

/// The longest word; numbers have some twenty letters.
const LONGEST_WORD: usize = 4096;

/// All values of a file, as `f64` of this machine's byte order.
pub(super) struct Values {
    pub unpacked: Unpacked,
    /// The least type that holds all of them: whole numbers of 16 or 32 bits, or floats.
    pub sample_type: SampleType,
}

/// Reads as many values as the header says, from byte `start` on.
///
/// # Errors
/// Where there are fewer or more, or a word is no number.
pub(super) fn read(content: &Content, start: u64, [columns, rows]: [u64; 2]) -> Result<Values, ImportError> {
    let samples = columns * rows;
    // A value takes a digit and a blank.
    let most = content.length.saturating_sub(start).div_ceil(2);
    if most < samples {
        return Err(wrong_count(content, start, [columns, rows]));
    }
    let mut words = Words {
        content,
        at: start,
        text: Vec::new(),
        columns,
        read: 0,
        samples,
        bytes: Vec::new(),
        given: 0,
        kind: Kind::default(),
        failed: None,
    };
    let asked = format!("{columns} x {rows} values");
    let result = unpacked(content, "values", &mut words, samples * 8, &asked, |_| ());
    if let Some(error) = words.failed.take() {
        return Err(error);
    }
    if words.read != samples {
        return Err(wrong_count(content, start, [columns, rows]));
    }
    Ok(Values { unpacked: result?, sample_type: words.kind.sample_type() })
}

/// The message that there are not as many values as the header says: how many there are, and where they end.
fn wrong_count(content: &Content, start: u64, [columns, rows]: [u64; 2]) -> ImportError {
    let Ends { values, line } = match Ends::find(content, start) {
        Ok(ends) => ends,
        Err(error) => return error,
    };
    let found = if values == 0 { "0".into() } else { format!("{values}, the last in line {line}") };
    content.malformed("values", found, format!("{} ({columns} x {rows})", columns * rows))
}

/// Where the values of a file end.
struct Ends {
    /// How many there are.
    values: u64,
    /// The line that the last one is in, from 1.
    line: u64,
}

impl Ends {
    /// Reads a file once more, whose values begin at byte `start`.
    fn find(content: &Content, start: u64) -> Result<Ends, ImportError> {
        let mut piece = vec![0; content.length.min(PIECE as u64) as usize];
        let mut found = Ends { values: 0, line: 1 };
        let (mut at, mut breaks, mut is_in_word) = (0, 0, false);
        while at < content.length {
            let length = (content.length - at).min(PIECE as u64) as usize;
            let text = &mut piece[..length];
            content.read("values", at, text)?;
            for (place, byte) in (at..).zip(text.iter()) {
                if byte.is_ascii_whitespace() {
                    breaks += u64::from(*byte == b'\n');
                    is_in_word = false;
                } else if place >= start {
                    found.values += u64::from(!is_in_word);
                    found.line = breaks + 1;
                    is_in_word = true;
                }
            }
            at += length as u64;
        }
        Ok(found)
    }
}

/// What all values are.
#[derive(Clone, Copy, Debug)]
struct Kind {
    is_whole: bool,
    low: f64,
    high: f64,
}

impl Default for Kind {
    fn default() -> Kind {
        Kind { is_whole: true, low: 0.0, high: 0.0 }
    }
}

impl Kind {
    fn see(&mut self, value: f64) {
        self.is_whole &= value.fract() == 0.0 && !(value == 0.0 && value.is_sign_negative());
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
    }

    fn and(self, other: Kind) -> Kind {
        Kind {
            is_whole: self.is_whole && other.is_whole,
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    fn sample_type(self) -> SampleType {
        let fits = |low: i32, high: i32| self.is_whole && self.low >= low.into() && self.high <= high.into();
        if fits(i16::MIN.into(), i16::MAX.into()) {
            SampleType::I16
        } else if fits(i32::MIN, i32::MAX) {
            SampleType::I32
        } else {
            SampleType::F64
        }
    }
}

/// Reads text as the bytes of its values. Those beyond what the header says are counted and not given.
struct Words<'c> {
    content: &'c Content,
    /// The byte where the next piece of the file begins.
    at: u64,
    /// Text that is not read yet: the last word may go on in the next piece.
    text: Vec<u8>,
    columns: u64,
    /// Values so far.
    read: u64,
    samples: u64,
    /// Bytes of values, and how many of them are given.
    bytes: Vec<u8>,
    given: usize,
    kind: Kind,
    failed: Option<ImportError>,
}

impl Words<'_> {
    /// Reads values from the next piece; false at the end of the file.
    fn next_piece(&mut self) -> Result<bool, ImportError> {
        let left = self.content.length.saturating_sub(self.at);
        let length = left.min(PIECE as u64) as usize;
        let before = self.text.len();
        self.text.resize(before + length, 0);
        self.content.read("values", self.at, &mut self.text[before..])?;
        self.at += length as u64;
        let is_last = left == length as u64;
        let end = match self.text.iter().rposition(u8::is_ascii_whitespace) {
            _ if is_last => self.text.len(),
            Some(blank) => blank + 1,
            None => 0,
        };
        if self.text.len() - end > LONGEST_WORD {
            let found = format!("a word of {} bytes and more as value {}", self.text.len() - end, self.read);
            return Err(self.content.malformed("values", found, "numbers with blanks between them"));
        }
        let parts: Vec<Result<(Vec<f64>, Kind), (usize, String)>> =
            parts(&self.text[..end]).par_iter().map(|part| numbers(part)).collect();
        self.bytes.clear();
        self.given = 0;
        for part in parts {
            let (values, kind) = part.map_err(|(before, word)| {
                let number = self.read + before as u64;
                let (row, column) = (number / self.columns, number % self.columns);
                self.content.malformed("values", format!("\"{word}\" in row {row}, column {column}"), "a number")
            })?;
            let wanted = self.samples.saturating_sub(self.read).min(values.len() as u64) as usize;
            for value in &values[..wanted] {
                self.bytes.extend_from_slice(&value.to_ne_bytes());
            }
            self.kind = self.kind.and(kind);
            self.read += values.len() as u64;
        }
        self.text.drain(..end);
        Ok(!is_last)
    }
}

impl Read for Words<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let mut is_more = true;
        while self.given == self.bytes.len() && is_more && self.failed.is_none() {
            match self.next_piece() {
                Ok(more) => is_more = more,
                Err(error) => {
                    self.failed = Some(error);
                    return Err(Error::other("no number"));
                }
            }
        }
        let count = out.len().min(self.bytes.len() - self.given);
        out[..count].copy_from_slice(&self.bytes[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

/// A text in parts that end behind a blank.
fn parts(text: &[u8]) -> Vec<&[u8]> {
    let mut parts = Vec::new();
    let mut rest = text;
    while rest.len() > PART {
        let blank = rest[PART..].iter().position(u8::is_ascii_whitespace);
        let (part, behind) = rest.split_at(blank.map_or(rest.len(), |blank| PART + blank));
        parts.push(part);
        rest = behind;
    }
    parts.push(rest);
    parts
}

/// The numbers of a text; or how many there are before a word that is none, and that word.
fn numbers(text: &[u8]) -> Result<(Vec<f64>, Kind), (usize, String)> {
    let mut values = Vec::with_capacity(text.len() / 4);
    let mut kind = Kind::default();
    for word in text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
        let Some(value) = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()) else {
            return Err((values.len(), in_one_line(&String::from_utf8_lossy(&word[..word.len().min(60)]))));
        };
        kind.see(value);
        values.push(value);
    }
    Ok((values, kind))
}
