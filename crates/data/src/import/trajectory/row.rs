//! A row of a frame: words to numbers.

use super::columns::{Layout, Word};
use super::species::Species;
use super::{Damage, quoted};

/// The words of a line.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| byte.is_ascii_whitespace()).filter(|word| !word.is_empty())
}

/// The number that a word is, of single and double precision as C and Fortran write it.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    match text.parse() {
        Ok(number) => Some(number),
        // Exponents of double precision in Fortran.
        Err(_) if text.contains(['d', 'D']) => text.replace(['d', 'D'], "e").parse().ok(),
        Err(_) => None,
    }
}

/// Whether a word says yes or no.
pub(super) fn logical(word: &[u8]) -> Option<bool> {
    match word.to_ascii_lowercase().as_slice() {
        b"t" | b"true" | b"1" => Some(true),
        b"f" | b"false" | b"0" => Some(false),
        _ => None,
    }
}

/// Appends the values of a row, one for each column, and its id, if it has one.
///
/// # Errors
/// Where words are missing or too many, or are no numbers; the field is the column's number.
pub(super) fn read(
    line: &[u8],
    layout: &Layout,
    species: &Species,
    values: &mut Vec<f64>,
    ids: &mut Vec<u64>,
) -> Result<(), Damage> {
    let mut words = words(line);
    for (column, kind) in layout.words.iter().enumerate() {
        let Some(word) = words.next() else {
            let expected = format!("{} columns", layout.words.len());
            return Err(Damage::new("row", format!("{column} columns"), expected));
        };
        let wrong = |expected: &str| Damage::new(format!("column {}", column + 1), quoted(word), expected);
        let value = match kind {
            Word::Number => number(word).ok_or_else(|| wrong("a number"))?,
            Word::Logical => logical(word).map(f64::from).ok_or_else(|| wrong("T or F"))?,
            Word::Label => species.number(word),
            Word::Skipped => f64::NAN,
            Word::Id => {
                let id = std::str::from_utf8(word).ok().and_then(|text| text.parse::<u64>().ok());
                let id = id.ok_or_else(|| wrong("an id, a whole number from 0"))?;
                ids.push(id);
                id as f64
            }
        };
        values.push(value);
    }
    match words.next() {
        Some(word) if !layout.may_have_more => {
            let found = format!("{} after {} columns", quoted(word), layout.words.len());
            Err(Damage::new("row", found, "the end of the row"))
        }
        _ => Ok(()),
    }
}
