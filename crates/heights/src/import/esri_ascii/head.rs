//! The header: names and numbers, before the first number that has no name.

use crate::import::content::{Content, in_one_line};
use deepfield_data::import::ImportError;

/// The names that there are; the first one tells the format.
const NAMES: [&str; 10] =
    ["ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value"];

/// How many of them begin a file.
const FIRST: usize = 7;

/// The most entries of a header.
const MOST_ENTRIES: usize = 64;

/// What a file begins with before its text, in some programs.
const MARK: &[u8] = b"\xef\xbb\xbf";

/// The entries of a header.
#[derive(Debug)]
pub(super) struct Head {
    /// Names in small letters and what stands behind them.
    entries: Vec<(String, String)>,
    /// The byte where the values begin.
    pub end: u64,
}

/// Words between blanks, each with the byte where it begins.
fn words(text: &[u8], mut at: usize) -> impl Iterator<Item = (usize, &[u8])> {
    std::iter::from_fn(move || {
        at += text.get(at..)?.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let rest = &text[at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let found = (at, &rest[..length]);
        at += length;
        Some(found)
    })
}

fn start_of(text: &[u8]) -> usize {
    if text.starts_with(MARK) { MARK.len() } else { 0 }
}

/// Whether a text begins as a grid does.
pub(super) fn is_head(text: &[u8]) -> bool {
    let first = words(text, start_of(text)).next();
    first.is_some_and(|(_, word)| NAMES[..FIRST].iter().any(|name| word.eq_ignore_ascii_case(name.as_bytes())))
}

/// Whether a word is a name, and no number: numbers that begin with a letter are NaN and infinite.
fn is_name(word: &[u8]) -> bool {
    let is_number = || ["nan", "inf", "infinity"].iter().any(|number| word.eq_ignore_ascii_case(number.as_bytes()));
    word.first().is_some_and(u8::is_ascii_alphabetic) && !is_number()
}

impl Head {
    /// Reads it from what a file begins with.
    ///
    /// # Errors
    /// Where an entry has nothing behind it, or there is no end to them.
    pub(super) fn read(content: &Content) -> Result<Head, ImportError> {
        let text = &content.head;
        let mut entries = Vec::new();
        let mut found = words(text, start_of(text));
        let word = |word: &[u8]| in_one_line(&String::from_utf8_lossy(&word[..word.len().min(100)]));
        let mut end = text.len();
        while let Some((at, name)) = found.next() {
            if !is_name(name) {
                end = at;
                break;
            }
            if entries.len() == MOST_ENTRIES {
                return Err(content.malformed("header", format!("{MOST_ENTRIES} entries and more"), "values"));
            }
            let Some((_, value)) = found.next() else {
                return Err(content.missing(&word(name), "a number behind it"));
            };
            entries.push((word(name).to_lowercase(), word(value)));
        }
        Ok(Head { entries, end: end as u64 })
    }

    /// Whether there is an entry of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.entries.iter().any(|(own, _)| own == name)
    }

    fn entry(&self, name: &str) -> Option<&str> {
        self.entries.iter().find(|(own, _)| own == name).map(|(_, value)| &**value)
    }

    /// An entry's number; `None` where there is none.
    ///
    /// # Errors
    /// Where it is none.
    pub(super) fn number(&self, content: &Content, name: &str) -> Result<Option<f64>, ImportError> {
        let wrong = |value: &str| content.malformed(name, value, "a number");
        self.entry(name).map(|value| value.parse().map_err(|_| wrong(value))).transpose()
    }

    /// How many samples an entry says.
    ///
    /// # Errors
    /// Where there is none, or it is no whole number.
    pub(super) fn count(&self, content: &Content, name: &str) -> Result<i128, ImportError> {
        let value = self.entry(name).ok_or_else(|| content.missing(name, "an entry of the header"))?;
        let whole = || value.parse::<f64>().ok().filter(|number| number.fract() == 0.0).map(|number| number as i128);
        value.parse().ok().or_else(whole).ok_or_else(|| content.malformed(name, value, "a whole number of samples"))
    }

    /// What is left out.
    pub(super) fn notes(&self) -> Vec<String> {
        let unknown = self.entries.iter().filter(|(name, _)| !NAMES.contains(&&**name));
        let unknown: Vec<String> = unknown.take(8).map(|(name, value)| format!("{name} {value}")).collect();
        if unknown.is_empty() {
            Vec::new()
        } else {
            vec![format!("entries of the header are left out: {}", unknown.join(", "))]
        }
    }
}
