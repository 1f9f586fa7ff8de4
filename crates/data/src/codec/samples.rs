//! Samples of a brick of a grid, without loss.
//!
//! Samples are words of 8, 16, 32 or 64 bits. A word is predicted from its seven neighbours that come before it along one, two or three axes
//! (Lorenzo's predictor: what is left of polynomials that lack the product of all coordinates is nothing), modulo the size of a word, so that
//! every bit comes back. What is left is coded in blocks of 16: as zeros, in as many bits as the largest takes, or by Rice codes, whichever is
//! shortest. Floats are turned into whole numbers of the same order first; what is left of a channel may have that of the channel before it
//! taken away, as of red, green and blue.

/// Words in a block.
const BLOCK: usize = 16;
/// Most leading bits of a Rice code: what takes more is written in as many bits as it has.
const LONGEST: u64 = 40;

/// What a brick's words are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Words {
    /// Bits of a word: 8, 16, 32 or 64.
    pub bits: u32,
    /// Whether they are floats.
    pub is_float: bool,
}

impl Words {
    fn mask(self) -> u64 {
        u64::MAX >> (64 - self.bits)
    }

    /// Bits of a block's head: it names a width from 0 to `bits`, or the parameter of a Rice code from 0 to `bits - 2`.
    fn head(self) -> u32 {
        self.bits.trailing_zeros() + 1
    }

    /// A float's bits as a whole number of the same order, and back.
    fn ordered(self, word: u64) -> u64 {
        let is_negative = self.is_float && word >> (self.bits - 1) & 1 == 1;
        if is_negative { word ^ (self.mask() >> 1) } else { word }
    }
}

/// Appends the code of a brick: its channels, each of `shape[0] shape[1] shape[2]` words, the first axis fastest.
pub fn encode(words: Words, shape: [usize; 3], channels: &[Vec<u64>], out: &mut Vec<u8>) {
    let mut before: Vec<u64> = Vec::new();
    for channel in channels {
        let mut left: Vec<u64> = channel.iter().map(|word| words.ordered(*word)).collect();
        differences(&mut left, shape);
        left.iter_mut().for_each(|word| *word &= words.mask());
        let apart: Vec<u64> =
            left.iter().zip(&before).map(|(own, other)| own.wrapping_sub(*other) & words.mask()).collect();
        let magnitude = |values: &[u64]| -> u64 {
            values.iter().map(|value| u64::from(64 - zigzag(*value, words.bits).leading_zeros())).sum()
        };
        let is_apart = !apart.is_empty() && magnitude(&apart) < magnitude(&left);
        out.push(u8::from(is_apart));
        let coded = if is_apart { &apart } else { &left };
        let mut bits = BitWriter { out, held: 0, count: 0 };
        coded.chunks(BLOCK).for_each(|block| encode_block(block, words, &mut bits));
        bits.finish();
        before = left;
    }
}

/// The channels of a brick, and how many bytes they took; `None` where the bytes end too early or make no sense.
pub fn decode(words: Words, shape: [usize; 3], channels: usize, bytes: &[u8]) -> Option<(Vec<Vec<u64>>, usize)> {
    let count = shape.iter().try_fold(1usize, |count, side| count.checked_mul(*side))?;
    // A block takes its head at least.
    let least = count.div_ceil(BLOCK).checked_mul(words.head() as usize)?.div_ceil(8).checked_add(1)?;
    if least.checked_mul(channels)? > bytes.len() {
        return None;
    }
    let mut at = 0;
    let mut all = Vec::with_capacity(channels);
    let mut before: Vec<u64> = Vec::new();
    for _ in 0..channels {
        let is_apart = match *bytes.get(at)? {
            0 => false,
            1 if !before.is_empty() => true,
            _ => return None,
        };
        let mut bits = BitReader { bytes: &bytes[at + 1..], at: 0 };
        let mut left = vec![0u64; count];
        for block in left.chunks_mut(BLOCK) {
            decode_block(block, words, &mut bits)?;
        }
        at += 1 + bits.finish()?;
        if is_apart {
            left.iter_mut().zip(&before).for_each(|(own, other)| *own = own.wrapping_add(*other));
        }
        if channels > 1 {
            before.clone_from(&left);
        }
        sums(&mut left, shape);
        left.iter_mut().for_each(|word| *word = words.ordered(*word & words.mask()));
        all.push(left);
    }
    Some((all, at))
}

/// Replaces words by their differences along every axis; what is before the first is 0.
fn differences(values: &mut [u64], [width, height, _]: [usize; 3]) {
    if values.is_empty() {
        return;
    }
    let along = |values: &mut [u64], step: usize| {
        for i in (step..values.len()).rev() {
            values[i] = values[i].wrapping_sub(values[i - step]);
        }
    };
    values.chunks_mut(width).for_each(|row| along(row, 1));
    values.chunks_mut(width * height).for_each(|slice| along(slice, width));
    along(values, width * height);
}

/// Undoes [`differences`].
fn sums(values: &mut [u64], [width, height, _]: [usize; 3]) {
    if values.is_empty() {
        return;
    }
    let slice = width * height;
    for i in slice..values.len() {
        values[i] = values[i].wrapping_add(values[i - slice]);
    }
    for slice in values.chunks_mut(slice) {
        for i in width..slice.len() {
            slice[i] = slice[i].wrapping_add(slice[i - width]);
        }
    }
    for row in values.chunks_mut(width) {
        let mut sum = 0u64;
        for value in row {
            sum = sum.wrapping_add(*value);
            *value = sum;
        }
    }
}

/// A difference of `bits` bits as a whole number that is small where its magnitude is.
fn zigzag(value: u64, bits: u32) -> u64 {
    let signed = (value << (64 - bits)) as i64 >> (64 - bits);
    ((signed << 1) ^ (signed >> 63)) as u64 & (u64::MAX >> (64 - bits))
}

fn from_zigzag(code: u64) -> u64 {
    (code >> 1) ^ (code & 1).wrapping_neg()
}

fn encode_block(block: &[u64], words: Words, out: &mut BitWriter<'_>) {
    let mut codes = [0u64; BLOCK];
    codes.iter_mut().zip(block).for_each(|(code, value)| *code = zigzag(*value, words.bits));
    let codes = &codes[..block.len()];
    let largest = codes.iter().fold(0, |all, code| all | code);
    let width = 64 - largest.leading_zeros();
    let count = codes.len() as u64;
    // Near the logarithm of the mean a Rice code is shortest.
    let mean = codes.iter().fold(0u64, |sum, code| sum.saturating_add(*code)) / count;
    let middle = (64 - mean.leading_zeros()).saturating_sub(1);
    let cost = |k: u32| -> Option<u64> {
        let is_short = codes.iter().all(|code| code >> k <= LONGEST);
        is_short.then(|| codes.iter().map(|code| code >> k).sum::<u64>() + count * u64::from(1 + k))
    };
    let candidates = middle.saturating_sub(1)..=(middle + 1).min(words.bits - 2);
    let rice = candidates.filter_map(|k| cost(k).map(|cost| (cost, k))).min();
    match rice.filter(|(cost, _)| width > 0 && *cost < count * u64::from(width)) {
        Some((_, k)) => {
            out.put(u64::from(words.bits + 1 + k), words.head());
            for code in codes {
                // As many zeros as it has multiples of 2^k, then a one.
                out.put(1 << (code >> k), (code >> k) as u32 + 1);
                out.put(code & !(u64::MAX << k), k);
            }
        }
        None => {
            out.put(u64::from(width), words.head());
            codes.iter().for_each(|code| out.put(*code, width));
        }
    }
}

fn decode_block(block: &mut [u64], words: Words, bits: &mut BitReader<'_>) -> Option<()> {
    let head = bits.take(words.head()) as u32;
    if head <= words.bits {
        block.iter_mut().for_each(|value| *value = from_zigzag(bits.take(head)));
        return Some(());
    }
    let k = head - words.bits - 1;
    for value in block {
        let multiples = bits.zeros().filter(|zeros| *zeros <= LONGEST)?;
        let code = multiples << k | bits.take(k);
        *value = from_zigzag(code);
    }
    Some(())
}

/// Appends bits, the lowest of each byte first.
struct BitWriter<'a> {
    out: &'a mut Vec<u8>,
    held: u64,
    count: u32,
}

impl BitWriter<'_> {
    /// Appends the lowest `width` bits of a value that has no others.
    fn put(&mut self, value: u64, width: u32) {
        self.held |= value.checked_shl(self.count).unwrap_or(0);
        let total = self.count + width;
        if total >= 64 {
            self.out.extend_from_slice(&self.held.to_le_bytes());
            self.held = value.checked_shr(64 - self.count).unwrap_or(0);
            self.count = total - 64;
        } else {
            self.count = total;
        }
    }

    /// Fills the last byte up with zeros.
    fn finish(self) {
        let bytes = self.held.to_le_bytes();
        self.out.extend_from_slice(&bytes[..self.count.div_ceil(8) as usize]);
    }
}

/// Reads bits, the lowest of each byte first; what is beyond the end is zeros.
struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl BitReader<'_> {
    /// The next 57 bits at least.
    fn peek(&self) -> u64 {
        let start = (self.at / 8).min(self.bytes.len());
        let word = match self.bytes[start..].first_chunk::<8>() {
            Some(bytes) => u64::from_le_bytes(*bytes),
            None => {
                let mut bytes = [0; 8];
                let rest = &self.bytes[start..];
                bytes[..rest.len()].copy_from_slice(rest);
                u64::from_le_bytes(bytes)
            }
        };
        word >> (self.at % 8)
    }

    /// The next bits, 64 at most.
    fn take(&mut self, width: u32) -> u64 {
        if width > 32 {
            let low = self.take(32);
            return low | self.take(width - 32) << 32;
        }
        let value = self.peek() & !(u64::MAX << width);
        self.at += width as usize;
        value
    }

    /// How many zeros come before the next one, which is taken, too; `None` where there are more than any code has.
    fn zeros(&mut self) -> Option<u64> {
        let zeros = self.peek().trailing_zeros();
        self.at += zeros as usize + 1;
        (zeros < 57).then_some(u64::from(zeros))
    }

    /// Bytes that were taken; `None` where there were fewer, or bits that fill up the last one are set.
    fn finish(self) -> Option<usize> {
        let taken = self.at.div_ceil(8);
        let rest = self.at % 8;
        let last = *self.bytes.get(..taken)?.last().unwrap_or(&0);
        (rest == 0 || last >> rest == 0).then_some(taken)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use proptest::prelude::*;

    fn any_words() -> impl Strategy<Value = Words> {
        prop_oneof![
            Just((8, false)),
            Just((16, false)),
            Just((32, false)),
            Just((64, false)),
            Just((32, true)),
            Just((64, true))
        ]
        .prop_map(|(bits, is_float)| Words { bits, is_float })
    }

    proptest! {
        /// Whatever the samples, every bit comes back: noise, ramps, constants, sparse ones, of any shape and number of channels.
        #[test]
        fn bricks_come_back(
            words in any_words(), shape in prop::array::uniform3(1usize..9), channels in 1usize..4, seed in any::<u64>(), kind in 0..4,
        ) {
            let mut state = seed;
            let mut random = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                state ^ state >> 29
            };
            let count = shape.iter().product::<usize>();
            let all: Vec<Vec<u64>> = (0..channels).map(|channel| (0..count as u64).map(|i| words.mask() & match kind {
                0 => random(),
                1 => i.wrapping_mul(seed % 7).wrapping_add(channel as u64),
                2 => if random() % 17 == 0 { random() } else { seed },
                _ => (i / 3).wrapping_add(random() % 5),
            }).collect()).collect();
            let mut bytes = Vec::new();
            encode(words, shape, &all, &mut bytes);
            let (back, taken) = decode(words, shape, channels, &bytes).unwrap();
            prop_assert_eq!(taken, bytes.len());
            prop_assert_eq!(&back, &all);
            // Noise takes hardly more than it has.
            let raw = count * channels * words.bits as usize / 8;
            prop_assert!(bytes.len() <= raw + raw / 8 + 8 * channels + count / 2, "{} of {raw}", bytes.len());
            // Cut short it is refused; changed it is refused or is another brick.
            prop_assert!(decode(words, shape, channels, &bytes[..bytes.len() - 1]).is_none());
            let at = (seed as usize) % bytes.len();
            bytes[at] ^= 1 << (seed >> 32 & 7);
            prop_assert!(decode(words, shape, channels, &bytes).is_none_or(|(other, _)| other.len() == channels));
        }

        #[test]
        fn any_bytes_are_read_or_refused(
            words in any_words(), shape in prop::array::uniform3(0usize..6), bytes in prop::collection::vec(any::<u8>(), 0..200),
        ) {
            if let Some((channels, taken)) = decode(words, shape, 2, &bytes) {
                prop_assert!(taken <= bytes.len() && channels.len() == 2);
            }
        }
    }

    #[test]
    fn what_is_smooth_is_short() {
        let words = Words { bits: 16, is_float: false };
        let ramp = (0..32 * 32 * 32u64).map(|i| 5 * (i % 32) + 3 * (i / 32 % 32) + (i % 32) * (i / 1024)).collect();
        let mut bytes = Vec::new();
        encode(words, [32; 3], &[ramp], &mut bytes);
        assert!(bytes.len() < 2400, "{}", bytes.len());
        // A constant takes the heads of blocks.
        bytes.clear();
        let floats = Words { bits: 32, is_float: true };
        encode(floats, [32; 3], &[vec![u64::from((-0.1f32).to_bits()); 1 << 15]], &mut bytes);
        assert!(bytes.len() < 1 + (1 << 11) * 6 / 8 + 60, "{}", bytes.len());
    }
}
