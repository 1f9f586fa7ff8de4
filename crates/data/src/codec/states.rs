//! Columns of whole numbers: the states of particles at the steps of a run, and their ids.
//!
//! A column is coded in blocks as differences to what neighbours or other columns predict, in as many bits as the largest of a block
//! needs and without the zero bits that a block has in common: what was rounded coarsely ends in such. Floats become numbers by
//! keeping some bits of their mantissa. `docs/series-file.md` has the details.

/// Values of a block.
pub const BLOCK: usize = 32;
/// Numbers beyond this are refused: nothing that is stored comes near, and sums of a few of them do not overflow.
const LIMIT: i64 = 1 << 60;
/// Bits of a mantissa that masses keep: a relative error of at most 2^-14.
pub const MASS_BITS: u32 = 13;
/// Bits of a mantissa that densities, smoothing lengths and attributes keep: at most 2^-8.
pub const VALUE_BITS: u32 = 7;

/// In the header of a block: its numbers lack another number of zero bits than those of the block before.
const SHIFTED: u8 = 0x80;

/// A number whose order is that of floats, with `bits` bits of the mantissa; infinite and undefined values come back as such.
pub fn round_float(value: f32, bits: u32) -> i64 {
    let shift = 23 - bits;
    let magnitude = i64::from(value.to_bits() & 0x7fff_ffff);
    // Rounding the bits rounds the value, and the largest finite values stay finite.
    let half = (1_i64 << shift) >> 1;
    let up = magnitude + half;
    let is_finite_above = magnitude >= 0x7f80_0000 || up < 0x7f80_0000;
    let number = if is_finite_above {
        (if magnitude >= 0x7f80_0000 { magnitude } else { up }) >> shift
    } else {
        magnitude >> shift
    };
    if value.is_sign_negative() { -number } else { number }
}

/// The value of [`round_float`]'s number.
pub fn float_of(number: i64, bits: u32) -> f32 {
    let shift = 23 - bits;
    let magnitude = (number.unsigned_abs().min(0x7fff_ffff >> shift) as u32) << shift;
    f32::from_bits(magnitude | if number < 0 { 1 << 31 } else { 0 })
}

/// Appends a column: `predict(i, values)` says from the values before the block of `i`, and from what else is known on both sides, what
/// the value `i` may be; the `values` it is given end where `i` stands.
///
/// A block has a header (bits 0-6: bits of a number, bit 7: a byte follows that says how many zero bits were dropped; without it as many
/// as in the block before), and its numbers: the differences to the predictions, in a zigzag so that small ones of either sign need few
/// bits.
pub fn encode(values: &[i64], predict: impl Fn(usize, &[i64]) -> i64, out: &mut Vec<u8>) {
    let mut shift_before = 0;
    for first in (0..values.len()).step_by(BLOCK) {
        let block = first..values.len().min(first + BLOCK);
        let any = values[block.clone()].iter().fold(0, |any, value| any | value);
        let shift = if any == 0 { shift_before } else { any.trailing_zeros() };
        let mut numbers = [0_u64; BLOCK];
        for (number, i) in numbers.iter_mut().zip(block.clone()) {
            let prediction = shifted(predict(i, &values[..i]), shift);
            let difference = (values[i] >> shift).wrapping_sub(prediction);
            *number = ((difference << 1) ^ (difference >> 63)) as u64;
        }
        let width = 64 - numbers.iter().fold(0, |any, number| any | number).leading_zeros();
        if shift == shift_before {
            out.push(width as u8);
        } else {
            out.extend_from_slice(&[width as u8 | SHIFTED, shift as u8]);
        }
        shift_before = shift;
        let (mut bits, mut filled) = (0_u128, 0);
        for number in &numbers[..block.len()] {
            bits |= u128::from(*number) << filled;
            filled += width;
            while filled >= 8 {
                out.push(bits as u8);
                bits >>= 8;
                filled -= 8;
            }
        }
        if filled > 0 {
            out.push(bits as u8);
        }
    }
}

/// Reads a column of `count` values from the front of `input`, with the same predictions.
///
/// # Errors
/// What was expected.
pub fn decode(
    input: &mut &[u8],
    count: usize,
    predict: impl Fn(usize, &[i64]) -> i64,
) -> Result<Vec<i64>, &'static str> {
    if input.len() < count.div_ceil(BLOCK) {
        return Err("room for the headers of a column");
    }
    let mut values = Vec::with_capacity(count);
    let mut shift = 0;
    for first in (0..count).step_by(BLOCK) {
        let len = (count - first).min(BLOCK);
        let (header, mut rest) = input.split_first().ok_or("room for the header of a block")?;
        let width = u32::from(header & !SHIFTED);
        if header & SHIFTED != 0 {
            let (own, more) = rest.split_first().ok_or("room for the header of a block")?;
            (shift, rest) = (u32::from(*own), more);
        }
        if width > 64 || shift > 63 {
            return Err("numbers of at most 64 bits");
        }
        let (payload, rest) = rest.split_at_checked((width as usize * len).div_ceil(8)).ok_or("room for a block")?;
        *input = rest;
        let (mut bits, mut filled, mut bytes) = (0_u128, 0, payload.iter());
        let mask = if width == 64 { u64::MAX } else { (1 << width) - 1 };
        for i in first..first + len {
            while filled < width {
                // The payload has all bits of the block.
                bits |= u128::from(bytes.next().copied().unwrap_or(0)) << filled;
                filled += 8;
            }
            let number = bits as u64 & mask;
            bits >>= width;
            filled -= width;
            let difference = (number >> 1) as i64 ^ -((number & 1) as i64);
            let prediction = shifted(predict(i, &values), shift);
            values.push(prediction.wrapping_add(difference) << shift);
        }
    }
    Ok(values)
}

/// A column whose numbers any sums of a few of them fit in 64 bits.
///
/// # Errors
/// Where it is not.
pub fn decode_bounded(
    input: &mut &[u8],
    count: usize,
    predict: impl Fn(usize, &[i64]) -> i64,
) -> Result<Vec<i64>, &'static str> {
    let values = decode(input, count, predict)?;
    if values.iter().any(|value| !(-LIMIT..=LIMIT).contains(value)) {
        return Err("numbers of at most 60 bits");
    }
    Ok(values)
}

/// Appends a column of whole numbers that are not negative and that nothing predicts: they need no bit for a sign.
pub fn encode_unsigned(values: impl Iterator<Item = u64>, out: &mut Vec<u8>) {
    let halves: Vec<i64> = values.map(|value| (value >> 1) as i64 ^ -((value & 1) as i64)).collect();
    encode(&halves, |_, _| 0, out);
}

/// Reads [`encode_unsigned`]'s column.
///
/// # Errors
/// What was expected.
pub fn decode_unsigned(input: &mut &[u8], count: usize) -> Result<Vec<u64>, &'static str> {
    let values = decode(input, count, |_, _| 0)?;
    Ok(values.into_iter().map(|value| ((value << 1) ^ (value >> 63)) as u64).collect())
}

/// What predicts that each value is like the one before; the first is like `first`.
pub fn as_before(first: i64) -> impl Fn(usize, &[i64]) -> i64 {
    move |_, values| values.last().copied().unwrap_or(first)
}

fn shifted(prediction: i64, shift: u32) -> i64 {
    if shift == 0 { prediction } else { prediction.wrapping_add(1 << (shift - 1)) >> shift }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(cases(256))]

        #[test]
        fn columns_come_back(
            values in prop::collection::vec((any::<i64>(), 0_u32..64), 0..100), wild in any::<bool>(), first: i64,
        ) {
            let values: Vec<i64> = values.into_iter().map(|(value, shift)| value >> shift << (shift % 7)).collect();
            let other = |i: usize, _: &[i64]| first.wrapping_mul(i as i64);
            let mut bytes = Vec::new();
            if wild { encode(&values, other, &mut bytes) } else { encode(&values, as_before(first), &mut bytes) }
            let mut rest = &bytes[..];
            let back = if wild { decode(&mut rest, values.len(), other) } else { decode(&mut rest, values.len(), as_before(first)) };
            prop_assert_eq!(back.unwrap(), values.clone());
            prop_assert!(rest.is_empty());
            for cut in 0..bytes.len() {
                prop_assert!(decode(&mut &bytes[..cut], values.len(), as_before(first)).is_err());
            }
        }

        #[test]
        fn any_bytes_decode_or_fail(bytes in prop::collection::vec(any::<u8>(), 0..600), count in 0_usize..200) {
            drop(decode_bounded(&mut &bytes[..], count, as_before(0)));
        }

        #[test]
        fn floats_keep_their_order_and_leading_digits(value: f32, other: f32, bits in 4_u32..=23) {
            let back = float_of(round_float(value, bits), bits);
            if value.is_nan() {
                // The payload may be lost, and with it that it is none.
                return Ok(());
            }
            if value.is_finite() && value.is_normal() && value.abs() < 1e38 {
                prop_assert!((back / value - 1.0).abs() <= 2f32.powi(-(bits as i32) - 1), "{value} {back}");
            }
            prop_assert!(value.is_finite() == back.is_finite());
            if value <= other && value != 0.0 {
                prop_assert!(round_float(value, bits) <= round_float(other, bits));
            }
            prop_assert_eq!(float_of(round_float(back, bits), bits).to_bits(), if back == 0.0 { 0 } else { back.to_bits() });
        }
    }

    #[test]
    fn what_is_even_takes_no_room() {
        let values: Vec<i64> = (0..320).map(|i| 1024 * 7 * i).collect();
        let mut bytes = Vec::new();
        encode(&values, |_, before| before.last().map_or(0, |last| last + 7 * 1024), &mut bytes);
        assert_eq!(bytes.len(), 10 + 1);
        // The zero bits that all have are not stored, whatever the prediction.
        let jumps: Vec<i64> = (0..32).map(|i| ((i * 5) % 8) << 20).collect();
        bytes.clear();
        encode(&jumps, |_, _| 12345, &mut bytes);
        assert!(bytes.len() <= 2 + 32 * 4 / 8, "{}", bytes.len());
    }
}
