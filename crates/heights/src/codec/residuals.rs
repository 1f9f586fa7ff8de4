//! Whole numbers that are mostly small: Rice codes, with a parameter for every few of them.
//!
//! A group of 32 numbers starts with 6 bits: the parameter `k` from 0 to 62, or 63 for a group of zeros, of which nothing follows. A number `n`,
//! its sign in the lowest bit, is `n >> k` zeros, a one, and the lowest `k` bits; where that would begin with more than 23 zeros, it is 24
//! zeros, a one and all 64 bits.

use super::bits::{BitReader, BitWriter};
use deepfield_data::lanes::in_lanes;

/// Numbers of a group.
const GROUP: usize = 32;
/// Bits of a group's head.
const HEAD: u32 = 6;
/// The head of a group of zeros.
const ZEROS: u64 = 63;
/// So many leading zeros say that the number is written in full.
const ESCAPE: u32 = 24;
/// The largest parameter that one look at the bits is enough for.
const SHORT: u32 = 24;

/// Numbers without sign: 0, -1, 1, -2, 2 ... are 0, 1, 2, 3, 4 ...
#[inline(always)]
fn folded(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

#[inline(always)]
fn unfolded(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

/// The sum of what is left of numbers without their lowest bits, modulo 2^64.
#[inline(always)]
fn sum_above(group: &[u64], bits: u32) -> u64 {
    group.iter().fold(0_u64, |sum, value| sum.wrapping_add(value >> bits))
}

/// Bits of a group with this parameter, without the head, and as if none were written in full.
#[inline(always)]
fn cost(group: &[u64], k: u32) -> u64 {
    sum_above(group, k).saturating_add(group.len() as u64 * (1 + u64::from(k)))
}

/// Appends the codes of numbers.
pub(super) fn encode(values: &[i64], out: &mut Vec<u8>) {
    // Newer processors sum in wider vectors, and shift by a variable in one instruction.
    in_lanes!(encode_in_vectors(values, out));
}

#[inline(always)]
fn encode_in_vectors(values: &[i64], out: &mut Vec<u8>) {
    let mut bits = BitWriter::new(out);
    for group in values.chunks(GROUP) {
        let mut held = [0_u64; GROUP];
        for (held, value) in held.iter_mut().zip(group) {
            *held = folded(*value);
        }
        let held = &held[..group.len()];
        let all = held.iter().fold(0, |all, value| all | value);
        if all == 0 {
            bits.put(ZEROS, HEAD);
            continue;
        }
        // The best parameter is near the logarithm of the mean.
        let few = (64 - all.leading_zeros()).saturating_sub(56);
        let mean = (sum_above(held, few) / group.len() as u64) << few;
        let guess = (64 - mean.leading_zeros()).saturating_sub(1).min(62);
        let below = guess.saturating_sub(1);
        let k = if few == 0 && cost(held, below) < cost(held, guess) { below } else { guess };
        bits.put(u64::from(k), HEAD);
        for &value in held {
            let zeros = value >> k;
            if zeros < u64::from(ESCAPE) {
                let low = value & ((1 << k) - 1);
                if k + (zeros as u32) < 32 {
                    bits.put((1 << k) | low, zeros as u32 + 1 + k);
                } else {
                    bits.put(1, zeros as u32 + 1);
                    bits.put_long(low, k);
                }
            } else {
                bits.put(1, ESCAPE + 1);
                bits.put_long(value, 64);
            }
        }
    }
    bits.finish();
}

/// Reads as many numbers as `out` has from the front of the bytes. Returns how many bytes they take; `None` where there are fewer.
pub(super) fn decode(bytes: &[u8], out: &mut [i64]) -> Option<usize> {
    // As for `encode`.
    in_lanes!(decode_in_vectors(bytes, out))
}

#[inline(always)]
fn decode_in_vectors(bytes: &[u8], out: &mut [i64]) -> Option<usize> {
    let mut bits = BitReader::new(bytes);
    for group in out.chunks_mut(GROUP) {
        let head = bits.get(HEAD);
        if head == ZEROS {
            group.fill(0);
            continue;
        }
        let k = head as u32;
        if k <= SHORT {
            for value in group {
                bits.refill();
                let window = bits.window();
                let zeros = window.leading_zeros();
                *value = if zeros < ESCAPE {
                    // The one and the low bits are `k + 1` bits; taken from the window's top they are the low bits with bit `k` set.
                    let low = (window << zeros) >> (63 - k);
                    bits.skip(zeros + 1 + k);
                    unfolded((u64::from(zeros) << k) + (low - (1 << k)))
                } else {
                    escaped(&mut bits)?
                };
            }
        } else {
            for value in group {
                bits.refill();
                let zeros = bits.window().leading_zeros();
                *value = if zeros < ESCAPE {
                    bits.skip(zeros + 1);
                    unfolded((u64::from(zeros) << k) + bits.get_long(k))
                } else {
                    escaped(&mut bits)?
                };
            }
        }
    }
    let taken = bits.taken();
    (taken <= bytes.len()).then_some(taken)
}

/// A number that is written in full.
#[cold]
fn escaped(bits: &mut BitReader<'_>) -> Option<i64> {
    match bits.get(ESCAPE + 1) {
        1 => Some(unfolded(bits.get_long(64))),
        _ => None,
    }
}
