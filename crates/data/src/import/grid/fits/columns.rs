//! Columns of tables.

use super::Header;
use crate::import::ImportError;

/// Where a column stands in a row, and the letter of its type.
#[derive(Clone, Copy)]
pub(super) struct Column {
    pub at: usize,
    pub letter: u8,
}

impl Column {
    /// The column of a name, where there is one; `row` are the bytes of a row. A name that ends with `DATA` is that of lists, any other
    /// that of doubles.
    ///
    /// # Errors
    /// Where the table contradicts itself, or the column is of another type.
    pub(super) fn of(header: &Header, name: &str, row: u64) -> Result<Option<Column>, ImportError> {
        let mut at: usize = 0;
        for number in 1..=header.whole("TFIELDS", 0)?.clamp(0, 999) {
            let key = format!("TFORM{number}");
            let form = header.needed(&key, "the type of a column")?;
            let digits = form.text.chars().take_while(char::is_ascii_digit).count();
            let (repeat, kind) = form.text.split_at(digits);
            let repeat =
                if repeat.is_empty() { 1 } else { repeat.parse().map_err(|_| form.wrong("a type with a count"))? };
            let letter = kind.bytes().next().unwrap_or_default();
            let size: usize = match letter {
                b'L' | b'B' | b'A' => 1,
                b'I' => 2,
                b'J' | b'E' => 4,
                b'K' | b'D' | b'C' | b'P' => 8,
                b'M' | b'Q' => 16,
                _ => return Err(form.wrong("a type of columns")),
            };
            let end = size.checked_mul(repeat).and_then(|bytes| bytes.checked_add(at)).filter(|end| *end as u64 <= row);
            let end = end.ok_or_else(|| form.wrong(format!("columns of no more than {row} bytes")))?;
            if header.entry(&format!("TTYPE{number}")).is_some_and(|entry| entry.text == name) {
                let is_list = name.ends_with("DATA");
                let fits = if is_list { matches!(letter, b'P' | b'Q') } else { letter == b'D' } && repeat == 1;
                return if fits {
                    Ok(Some(Column { at, letter }))
                } else {
                    Err(form.wrong(if is_list { "a list" } else { "a double" }))
                };
            }
            at = end;
        }
        Ok(None)
    }
}
