//! Packed positions as they lie in a page file: Morton-sorted words as differences of a few bits each, without loss.
//!
//! Neighbours in Morton order differ little, so each block of [`BLOCK`] words stores the differences of their Morton keys in
//! as many bits as the largest of them needs. Where all words of a block were rounded to the same coarser grid (their lower
//! bits are those of a cell's centre, see [`coarsen_leaf`]), those bits are not stored either.
//!
//! All arithmetic is modulo the number of keys, so words in any order round-trip (unsorted ones merely take more bits), and any
//! bytes of the right length decode to some words: damage cannot reach beyond the section.
//!
//! A section is: a `u16` for each block (bits 0-5: bits of a difference, bits 6-10: dropped levels), then the blocks'
//! differences, `2 * bits` bytes each (a short last block is filled up with zeros), then, where some words have the point
//! flag and some have not, a bit for each word. `docs/page-file.md` has the details.

use super::coordinates::{GRID_BITS, GRID_POINT, LEAF_BITS, LEAF_POINT};
use super::morton;
use crate::lanes::in_lanes;

/// Words of a block.
pub const BLOCK: usize = 16;
/// Bits of a header that hold the width of the differences.
const WIDTH_BITS: u32 = 6;
/// Most bytes that a look at one block may touch: its differences and what a 64-bit read of the last one reaches beyond.
const REACH: usize = 2 * 63 + 9;

/// A kind of packed word: how it becomes a Morton key and back.
trait Word: Copy + Default {
    /// Bits per coordinate.
    const BITS: u32;
    /// Bits of a key.
    const KEY_BITS: u32 = 3 * Self::BITS;
    fn key(self) -> u64;
    fn of_key(key: u64) -> Self;
    fn is_point(self) -> bool;
    /// Sets the point flag if `flag` is 1; it must be 0 or 1.
    fn mark(&mut self, flag: u8);
}

impl Word for u32 {
    const BITS: u32 = GRID_BITS;

    #[inline(always)]
    fn key(self) -> u64 {
        let mask = (1 << GRID_BITS) - 1;
        morton::encode([self & mask, self >> GRID_BITS & mask, self >> (2 * GRID_BITS) & mask])
    }

    #[inline(always)]
    fn of_key(key: u64) -> u32 {
        let key = key as u32;
        compact10(key) | compact10(key >> 1) << GRID_BITS | compact10(key >> 2) << (2 * GRID_BITS)
    }

    fn is_point(self) -> bool {
        self & GRID_POINT != 0
    }

    #[inline(always)]
    fn mark(&mut self, flag: u8) {
        *self |= u32::from(flag) << GRID_POINT.trailing_zeros();
    }
}

impl Word for u64 {
    const BITS: u32 = LEAF_BITS;

    #[inline(always)]
    fn key(self) -> u64 {
        let mask = (1 << LEAF_BITS) - 1;
        let part = |shift: u32| (self >> shift & mask) as u32;
        morton::encode([part(0), part(LEAF_BITS), part(2 * LEAF_BITS)])
    }

    #[inline(always)]
    fn of_key(key: u64) -> u64 {
        morton::compact(key) | morton::compact(key >> 1) << LEAF_BITS | morton::compact(key >> 2) << (2 * LEAF_BITS)
    }

    fn is_point(self) -> bool {
        self & LEAF_POINT != 0
    }

    #[inline(always)]
    fn mark(&mut self, flag: u8) {
        *self |= u64::from(flag) << LEAF_POINT.trailing_zeros();
    }
}

/// The ten-bit coordinate in every third bit: in 32-bit lanes, of which twice as many go into a vector.
#[inline(always)]
fn compact10(v: u32) -> u32 {
    let v = v & 0x0924_9249;
    let v = (v | v >> 2) & 0x030c_30c3;
    let v = (v | v >> 4) & 0x0300_f00f;
    let v = (v | v >> 8) & 0x0300_00ff;
    (v | v >> 16) & 0x3ff
}

/// The Morton key of a grid word inside its node.
#[inline]
pub fn grid_key(word: u32) -> u64 {
    word.key()
}

/// The Morton key of a leaf word inside its node.
pub fn leaf_key(word: u64) -> u64 {
    word.key()
}

/// A leaf word rounded to the centre of its cell `levels` (at most 20) levels up; keeps the point flag.
#[inline]
pub fn coarsen_leaf(word: u64, levels: u32) -> u64 {
    if levels == 0 {
        return word;
    }
    let each = |value: u64| value | value << LEAF_BITS | value << (2 * LEAF_BITS);
    let field = (1 << LEAF_BITS) - 1;
    let kept = field >> levels << levels;
    word & (each(kept) | LEAF_POINT) | each(1 << (levels - 1))
}

/// How many levels up the cell is whose centre a leaf word is: the coarsest that it can be.
#[inline]
pub fn leaf_levels(word: u64) -> u32 {
    levels_dropped(word.key())
}

/// How far at most a coordinate of this leaf word, decoded, may lie from what was rounded to it, in units of `2^-21` of the cell:
/// half a cell of the coarsest grid that the word can be the centre of a cell of, and half a unit where that centre lies between
/// two units.
pub fn leaf_rounding(word: u64) -> f64 {
    match levels_dropped(word.key()) {
        0 => 0.5,
        levels => 0.5 * f64::from(1_u32 << levels) + 0.5,
    }
}

/// How many levels a key may have been rounded by: `n` if its last `3 n` bits are those of a centre.
#[inline(always)]
fn levels_dropped(key: u64) -> u32 {
    let zeros = key.trailing_zeros() / 3;
    if zeros < LEAF_BITS - 1 && key >> (3 * zeros) & 7 == 7 { zeros + 1 } else { 0 }
}

/// Appends a grid node's positions.
pub fn encode_grid(words: &[u32], out: &mut Vec<u8>) {
    encode(words, out);
}

/// Appends a leaf's positions.
pub fn encode_leaf(words: &[u64], out: &mut Vec<u8>) {
    encode(words, out);
}

fn encode<W: Word>(words: &[W], out: &mut Vec<u8>) {
    let blocks = words.len().div_ceil(BLOCK);
    let headers = out.len();
    out.resize(headers + 2 * blocks, 0);
    let mut previous = 0;
    for (number, block) in words.chunks(BLOCK).enumerate() {
        let mut keys = [0; BLOCK];
        keys.iter_mut().zip(block).for_each(|(key, word)| *key = word.key());
        let first = levels_dropped(keys[0]);
        let same = first < W::BITS && keys[..block.len()].iter().all(|&key| levels_dropped(key) == first);
        let levels = if same { first } else { 0 };
        let mask = (1_u64 << (W::KEY_BITS - 3 * levels)) - 1;
        let mut at = previous >> (3 * levels);
        let mut differences = [0; BLOCK];
        let mut any = 0;
        for (difference, key) in differences.iter_mut().zip(&keys[..block.len()]) {
            let key = key >> (3 * levels);
            *difference = key.wrapping_sub(at) & mask;
            any |= *difference;
            at = key;
        }
        previous = at << (3 * levels);
        let width = 64 - any.leading_zeros();
        let header = (width | levels << WIDTH_BITS) as u16;
        out[headers + 2 * number..headers + 2 * number + 2].copy_from_slice(&header.to_le_bytes());
        let (mut bits, mut filled) = (0_u128, 0);
        for difference in differences {
            bits |= u128::from(difference) << filled;
            filled += width;
            while filled >= 8 {
                out.push(bits as u8);
                bits >>= 8;
                filled -= 8;
            }
        }
    }
    let points = words.iter().filter(|word| word.is_point()).count();
    if points != 0 && points != words.len() {
        out.extend(words.chunks(8).map(|chunk| {
            chunk.iter().enumerate().fold(0, |byte, (bit, word)| byte | u8::from(word.is_point()) << bit)
        }));
    }
}

/// Reads the positions of a grid node that start at `bytes` into `words`, `points` of which are points. Returns how many bytes
/// they take; `Err` says what was expected.
pub fn decode_grid(bytes: &[u8], points: usize, words: &mut [u32]) -> Result<usize, &'static str> {
    decode(bytes, points, words)
}

/// The same for a leaf.
pub fn decode_leaf(bytes: &[u8], points: usize, words: &mut [u64]) -> Result<usize, &'static str> {
    decode(bytes, points, words)
}

/// The positions of a leaf with so many particles, in a section of their own; nothing is allocated for what that has no room for.
pub fn leaf_words(bytes: &[u8], points: usize, particles: usize) -> Result<Vec<u64>, &'static str> {
    if bytes.len() < 2 * particles.div_ceil(BLOCK) {
        return Err("room for the headers of its positions");
    }
    let mut words = vec![0; particles];
    decode_leaf(bytes, points, &mut words)?;
    Ok(words)
}

/// The most bytes that a section with so many words takes.
pub fn most_bytes(words: usize) -> usize {
    // Of each block a header, differences of all bits of a key, and flags.
    words.div_ceil(BLOCK).saturating_mul(2 + 2 * 63 + 2)
}

fn decode<W: Word>(bytes: &[u8], points: usize, words: &mut [W]) -> Result<usize, &'static str> {
    let blocks = words.len().div_ceil(BLOCK);
    let headers = bytes.get(..2 * blocks).ok_or("room for the headers of its positions")?;
    let mut payload = 0;
    for header in headers.as_chunks::<2>().0 {
        let (width, levels) = split(*header);
        if levels >= W::BITS || width > W::KEY_BITS - 3 * levels {
            return Err("positions of at most the bits of a key");
        }
        payload += 2 * width as usize;
    }
    let differences = bytes.get(headers.len()..headers.len() + payload).ok_or("room for its positions")?;
    let mut end = headers.len() + payload;
    in_lanes!(decode_blocks(headers, differences, words));
    if points == words.len() {
        words.iter_mut().for_each(|word| word.mark(1));
    } else if points != 0 {
        let flags = bytes.get(end..end + words.len().div_ceil(8)).ok_or("room for its point flags")?;
        end += flags.len();
        for (words, flags) in words.chunks_mut(8).zip(flags) {
            words.iter_mut().enumerate().for_each(|(bit, word)| word.mark(flags >> bit & 1));
        }
        if flags.iter().map(|byte| byte.count_ones() as usize).sum::<usize>() != points {
            return Err("as many point flags as points");
        }
    }
    Ok(end)
}

/// Width and dropped levels of a block.
#[inline(always)]
fn split(header: [u8; 2]) -> (u32, u32) {
    let header = u32::from(u16::from_le_bytes(header));
    (header & ((1 << WIDTH_BITS) - 1), header >> WIDTH_BITS)
}

/// Decodes the keys of all blocks.
#[inline(always)]
fn decode_blocks<W: Word>(headers: &[u8], differences: &[u8], words: &mut [W]) {
    let mut rest = differences;
    let mut previous = 0;
    for (header, words) in headers.as_chunks::<2>().0.iter().zip(words.chunks_mut(BLOCK)) {
        previous = decode_block(*header, &mut rest, previous, words);
    }
}

/// Decodes one block from the front of `rest`; returns the last key without what was dropped of it.
#[inline(always)]
fn decode_block<W: Word>(header: [u8; 2], rest: &mut &[u8], previous: u64, words: &mut [W]) -> u64 {
    let (width, levels) = split(header);
    let mut keys = [0; BLOCK];
    let mut copy = [0; REACH];
    let (own, after) = rest.split_at(2 * width as usize);
    let block: &[u8; REACH] = match rest.first_chunk() {
        Some(block) => block,
        None => {
            copy[..own.len()].copy_from_slice(own);
            &copy
        }
    };
    unpack(width, block, &mut keys);
    *rest = after;
    let mask = (1_u64 << (W::KEY_BITS - 3 * levels)) - 1;
    let mut at = previous >> (3 * levels);
    for key in &mut keys {
        at = at.wrapping_add(*key);
        *key = at;
    }
    let center = if levels == 0 { 0 } else { 7 << (3 * (levels - 1)) };
    let mut decoded = [W::default(); BLOCK];
    for lane in 0..BLOCK {
        decoded[lane] = W::of_key((keys[lane] & mask) << (3 * levels) | center);
    }
    words.copy_from_slice(&decoded[..words.len()]);
    // The zeros that fill up a short block leave the last key as it was.
    (at & mask) << (3 * levels)
}

/// Unpacks the differences of a block; each width has a function of its own, in which every shift is a constant.
#[inline(always)]
fn unpack(width: u32, block: &[u8; REACH], out: &mut [u64; BLOCK]) {
    macro_rules! widths {
        ($($width:literal)*) => {
            match width {
                $($width => unpack_width::<$width>(block, out),)*
                _ => {}
            }
        };
    }
    widths!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32 33 34 35 36 37 38 39 40 41 42
        43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63);
}

#[inline(always)]
fn unpack_width<const WIDTH: usize>(block: &[u8; REACH], out: &mut [u64; BLOCK]) {
    for (i, out) in out.iter_mut().enumerate() {
        let (byte, bit) = (i * WIDTH / 8, i * WIDTH % 8);
        // All of them lie within `REACH`.
        let Some(low) = block[byte..].first_chunk::<8>() else { return };
        let low = u64::from_le_bytes(*low) >> bit;
        // A wide difference reaches into a ninth byte.
        let high = if bit + WIDTH > 64 { u64::from(block[byte + 8]) << (64 - bit) } else { 0 };
        *out = (low | high) & ((1 << WIDTH) - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn leaf(keys: impl IntoIterator<Item = u64>) -> Vec<u64> {
        keys.into_iter().map(u64::of_key).collect()
    }

    fn leaf_round_trip(words: &[u64]) -> usize {
        let mut bytes = vec![0xab; 3];
        encode_leaf(words, &mut bytes);
        let points = words.iter().filter(|word| word.is_point()).count();
        let mut back = vec![0; words.len()];
        assert_eq!(decode_leaf(&bytes[3..], points, &mut back), Ok(bytes.len() - 3));
        assert_eq!(back, words);
        bytes.len() - 3
    }

    proptest! {
        #[test]
        fn any_leaf_words_round_trip(words in prop::collection::vec(any::<u64>(), 0..70)) {
            leaf_round_trip(&words);
        }

        #[test]
        fn any_grid_words_round_trip(words in prop::collection::vec(0..1_u32 << 31, 0..70)) {
            let mut bytes = Vec::new();
            encode_grid(&words, &mut bytes);
            let points = words.iter().filter(|word| word.is_point()).count();
            let mut back = vec![0; words.len()];
            prop_assert_eq!(decode_grid(&bytes, points, &mut back), Ok(bytes.len()));
            prop_assert_eq!(back, words);
        }

        /// Sorted words take about the logarithm of their mean distance, and coarser ones three bits a level less.
        #[test]
        fn sorted_and_coarsened_words_are_small(
            mut keys in prop::collection::vec(0..1_u64 << 63, 320..800),
            levels in prop::collection::vec(1..12_u32, 50),
        ) {
            keys.sort_unstable();
            let words = leaf(keys);
            let fine = leaf_round_trip(&words);
            prop_assert!(fine * 8 < words.len() * 62);
            let coarse: Vec<u64> = words
                .chunks(BLOCK)
                .zip(&levels)
                .flat_map(|(block, &levels)| block.iter().map(move |&word| coarsen_leaf(word, levels)))
                .collect();
            for (block, levels) in words.chunks(BLOCK).zip(&levels) {
                for &word in block {
                    let rounded = coarsen_leaf(word, *levels);
                    prop_assert!(leaf_rounding(rounded) >= 0.5 * f64::from(1_u32 << levels));
                    for axis in 0..3 {
                        let part = |word: u64| (word >> (21 * axis) & 0x1f_ffff) as f64;
                        prop_assert!((part(rounded) - part(word)).abs() <= leaf_rounding(rounded));
                    }
                }
            }
            let dropped: u32 = words.chunks(BLOCK).zip(&levels).map(|(block, levels)| 3 * levels * block.len() as u32).sum();
            // The last block is filled up; a difference may cross into a longer one by rounding.
            prop_assert!(leaf_round_trip(&coarse) * 8 + dropped as usize <= fine * 8 + 2 * words.len() + 16 * 64);
        }

        #[test]
        fn any_bytes_decode_or_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..400), count in 0..200_usize, points in 0..200_usize) {
            let mut words = vec![0_u64; count];
            if let Ok(used) = decode_leaf(&bytes, points.min(count), &mut words) {
                prop_assert!(used <= bytes.len());
            }
            let mut words = vec![0_u32; count];
            if let Ok(used) = decode_grid(&bytes, points.min(count), &mut words) {
                prop_assert!(used <= bytes.len() && words.iter().all(|word| word >> 31 == 0));
            }
        }
    }

    #[test]
    fn extremes_round_trip() {
        leaf_round_trip(&[]);
        leaf_round_trip(&[0; 40]);
        leaf_round_trip(&leaf([(1 << 63) - 1, 0, 7 << 60, 7 << 57, 1 << 62]));
        leaf_round_trip(&[coarsen_leaf(0, 20), coarsen_leaf(u64::MAX >> 1, 20)]);
    }
}
