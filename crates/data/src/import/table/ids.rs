//! Ids to all 64 bits among numbers of double precision: the number nearest to an id, and what that lacks, which is a number, too.

use super::columns::Table;
use crate::import::ImportError;
use crate::import::source::exact_id;
use std::ops::Range;

/// What `number`, the nearest to an id, lacks to be it; NaN where there is none.
pub(super) fn rest(number: f64, id: Option<u64>) -> f64 {
    let id = id.filter(|_| !number.is_nan());
    id.map_or(f64::NAN, |id| (i128::from(id) - number as i128) as f64)
}

/// The id that lacks `rest` beyond `number`; `None` where there is none.
pub(super) fn joined(number: f64, rest: f64) -> Option<u64> {
    if rest.is_nan() { None } else { u64::try_from(number as i128 + rest as i128).ok() }
}

/// The id that a text stands for, which is a whole number from 0; `number` is the number nearest to it.
pub(super) fn of_text(text: &str, number: f64) -> Option<u64> {
    let text = text.trim();
    let hexadecimal = || u64::from_str_radix(text.strip_prefix("0x")?, 16).ok();
    text.parse().ok().or_else(hexadecimal).or_else(|| exact_id(number))
}

/// Reads the ids of a column of one number a row; `None` where a row has none.
///
/// # Errors
/// When the table cannot be read there.
pub(super) fn read(table: &dyn Table, column: usize, rows: Range<u64>) -> Result<Vec<Option<u64>>, ImportError> {
    let mut ids = vec![None; (rows.end - rows.start) as usize];
    if !table.read_whole(column, rows.clone(), &mut ids)? {
        let mut numbers = vec![0.0; ids.len()];
        table.read(column, rows, &mut numbers)?;
        ids.iter_mut().zip(numbers).for_each(|(id, number)| *id = exact_id(number));
    }
    Ok(ids)
}
