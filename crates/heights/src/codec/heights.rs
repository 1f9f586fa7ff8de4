//! A block of samples of any type, without loss of what they are rounded to ([`super::values`]), if they are.
//!
//! Bytes: which samples were measured ([`super::validity`]); of every eight rows the number of their predictor ([`super::predict`]), two numbers a
//! byte, the first in the lower bits; what is left of the measured samples, row by row ([`super::residuals`]). Where no sample was measured,
//! nothing follows the first. Samples that were not measured are passed over; for their neighbours the sample to the left stands in.

use super::predict::{self, Predictor};
use super::values::Values;
use super::words::Words;
use super::{residuals, validity};
use deepfield_data::model::SampleType;

/// Whether samples of a type can be coded: all but whole numbers of 64 bits.
pub fn is_coded(sample_type: SampleType) -> bool {
    Words::of(sample_type).is_some()
}

/// Appends the code of samples as they are stored, row by row; NaN, and what is infinite, was not measured. Samples are among the values;
/// others come back as another one. `columns` is at least 1.
pub fn encode(values: &Values, stored: &[f64], columns: usize, out: &mut Vec<u8>) {
    let valid: Vec<bool> = stored.iter().map(|value| value.is_finite()).collect();
    // Doubles can stand for what is no type of heights.
    let words = values.words().unwrap_or(Words::Double);
    let mut coded = vec![0; stored.len()];
    words.encode(stored, &mut coded);
    encode_words(&mut coded, &valid, columns, out);
}

/// Reads `out.len()` samples of rows of `columns` from the front of the bytes; NaN where nothing was measured. Returns how many bytes they
/// take; `None` where the bytes are no such block. The work is bounded by the number of samples, whatever the bytes are.
pub fn decode(values: &Values, bytes: &[u8], columns: usize, out: &mut [f64]) -> Option<usize> {
    let words = values.words()?;
    let mut coded = vec![0; out.len()];
    let (taken, valid) = decode_words(bytes, columns, &mut coded)?;
    let is_right = words.decode(&coded, out);
    match valid {
        // Stand-ins before the first measured sample may be no samples of the type, and are of no account.
        Some(valid) => {
            out.iter_mut().zip(&valid).filter(|(_, valid)| !**valid).for_each(|(value, _)| *value = f64::NAN)
        }
        None if !is_right => return None,
        None => {}
    }
    match is_right || out.iter().zip(&coded).all(|(value, word)| value.is_nan() || words.is_one(*word)) {
        true => Some(taken),
        false => None,
    }
}

/// Rows that share a predictor.
const ROWS: usize = 8;

/// The same for values of 8 bits, all of which are there, with 128 for nothing: values are coded less 128.
pub fn encode_bytes(values: &[u8], columns: usize, out: &mut Vec<u8>) {
    let mut words: Vec<i64> = values.iter().map(|value| i64::from(*value) - 128).collect();
    let valid = vec![true; words.len()];
    encode_words(&mut words, &valid, columns, out);
}

/// Reads what [`encode_bytes`] has written, as [`decode`] does.
pub fn decode_bytes(bytes: &[u8], columns: usize, out: &mut [u8]) -> Option<usize> {
    let mut words = vec![0; out.len()];
    let (taken, valid) = decode_words(bytes, columns, &mut words)?;
    let is_right = valid.is_none() && words.iter().all(|word| (-128..128).contains(word));
    out.iter_mut().zip(&words).for_each(|(value, word)| *value = (*word + 128) as u8);
    is_right.then_some(taken)
}

fn encode_words(words: &mut [i64], valid: &[bool], columns: usize, out: &mut Vec<u8>) {
    validity::encode(valid, out);
    let is_whole = valid.iter().all(|valid| *valid);
    if !is_whole {
        if !valid.iter().any(|valid| *valid) {
            return;
        }
        predict::stand_in(words, columns, valid);
    }
    let mut left = Vec::with_capacity(words.len());
    let mut rest = vec![0; columns];
    let mut numbers = Vec::with_capacity(words.len() / columns / ROWS + 1);
    let (mut number, mut above): (u8, Option<&[i64]>) = (0, None);
    for (row_number, row) in words.chunks_exact(columns).enumerate() {
        if row_number % ROWS == 0 {
            number = best(words, columns, row_number, &mut rest);
            numbers.push(number);
        }
        let predictor = Predictor::numbered(number).unwrap_or(Predictor::Plane);
        match is_whole {
            true => {
                let first = left.len();
                left.resize(first + columns, 0);
                predict::differences(predictor, row, above, &mut left[first..]);
            }
            false => {
                predict::differences(predictor, row, above, &mut rest);
                let valid = &valid[row_number * columns..][..columns];
                left.extend(rest.iter().zip(valid).filter(|(_, valid)| **valid).map(|(value, _)| *value));
            }
        }
        above = Some(row);
    }
    out.extend(numbers.chunks(2).map(|some| some.iter().rev().fold(0, |byte, number| (byte << 4) | number)));
    residuals::encode(&left, out);
}

/// The number of the predictor that leaves least of a row in the middle of those from `first` on.
fn best(words: &[i64], columns: usize, first: usize, rest: &mut [i64]) -> u8 {
    let rows = words.len() / columns;
    let row = (first + ROWS / 2).min(rows - 1);
    let above = row.checked_sub(1).map(|above| &words[above * columns..][..columns]);
    let mut best = (f64::INFINITY, 0);
    for (number, predictor) in Predictor::ALL.into_iter().enumerate() {
        predict::differences(predictor, &words[row * columns..][..columns], above, rest);
        let size: f64 = rest.iter().map(|value| (*value as f64).abs()).sum();
        if size < best.0 {
            best = (size, number as u8);
        }
    }
    best.1
}

fn decode_words(bytes: &[u8], columns: usize, words: &mut [i64]) -> Option<(usize, Option<Vec<bool>>)> {
    if columns == 0 || !words.len().is_multiple_of(columns) {
        return None;
    }
    let (mut taken, valid) = validity::decode(bytes, words.len())?;
    let count = valid.as_ref().map_or(words.len(), |valid| valid.iter().filter(|valid| **valid).count());
    if count == 0 {
        return Some((taken, valid));
    }
    let rows = words.len() / columns;
    let numbers = bytes.get(taken..)?.get(..rows.div_ceil(ROWS).div_ceil(2))?;
    taken += numbers.len();
    taken += residuals::decode(bytes.get(taken..)?, &mut words[..count])?;
    if let Some(valid) = &valid {
        spread(words, count, valid);
    }
    for row in 0..rows {
        let group = row / ROWS;
        let predictor = Predictor::numbered(numbers[group / 2] >> (4 * (group % 2)) & 15)?;
        let (before, rest) = words.split_at_mut(row * columns);
        let above = (row > 0).then(|| &before[(row - 1) * columns..]);
        let valid = valid.as_ref().map(|valid| &valid[row * columns..][..columns]);
        predict::restore(predictor, &mut rest[..columns], above, valid);
    }
    Some((taken, valid))
}

/// Moves the first `count` words to the places of the measured samples.
fn spread(words: &mut [i64], mut count: usize, valid: &[bool]) {
    for at in (0..words.len()).rev() {
        if valid[at] {
            count -= 1;
            words[at] = words[count];
        }
    }
}

#[cfg(test)]
mod tests;
