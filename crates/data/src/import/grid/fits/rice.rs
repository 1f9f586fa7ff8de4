//! The Rice code of FITS (section 10.4.1 of the standard): differences of neighbours in blocks, each with as many low bits as suit it.

/// Bits of a string, the highest of each byte first.
struct Bits<'a> {
    bytes: &'a [u8],
    /// Bits that were read.
    at: usize,
}

impl Bits<'_> {
    fn bit(&mut self) -> Option<u32> {
        let byte = *self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(bit.into())
    }

    fn number(&mut self, count: u32) -> Option<u32> {
        (0..count).try_fold(0, |number: u32, _| Some(number << 1 | self.bit()?))
    }

    /// How many zeros stand in front of the next one.
    fn zeros(&mut self) -> Option<u32> {
        let mut count = 0;
        while self.bit()? == 0 {
            count += 1;
        }
        Some(count)
    }
}

/// Decodes `count` whole numbers of `size` bytes (1, 2 or 4) in blocks of `block`; `None` where the string ends before.
pub(super) fn decoded(bytes: &[u8], size: usize, block: usize, count: usize) -> Option<Vec<i32>> {
    // Bits of a block's head, and the head of a block whose differences are stored as they are.
    let (head, plain) = match size {
        1 => (3, 6),
        2 => (4, 14),
        _ => (5, 25),
    };
    let width = 8 * size as u32;
    let mask = u32::MAX >> (32 - width);
    let mut bits = Bits { bytes, at: 0 };
    let mut last = bits.number(width)?;
    let mut values = Vec::new();
    while values.len() < count {
        let code = bits.number(head)?;
        for _ in 0..block.min(count - values.len()) {
            let difference = match code {
                // All are as the one before.
                0 => 0,
                code if code == plain + 1 => bits.number(width)?,
                code => {
                    let low = code - 1;
                    let high = bits.zeros()?;
                    high.checked_shl(low)? | bits.number(low)?
                }
            };
            let step = if difference & 1 == 0 { difference >> 1 } else { !(difference >> 1) };
            last = last.wrapping_add(step) & mask;
            values.push(match size {
                // Bytes have no sign.
                1 => last as i32,
                2 => (last as u16 as i16).into(),
                _ => last as i32,
            });
        }
    }
    Some(values)
}

#[cfg(test)]
pub(in super::super) mod tests {
    use super::*;

    /// The code of numbers of so many bytes, in blocks of 32.
    pub fn coded(values: &[i32], size: usize) -> Vec<u8> {
        let (head, plain) = match size {
            1 => (3, 6),
            2 => (4, 14),
            _ => (5, 25),
        };
        let width = 8 * size;
        let mut bits: Vec<bool> = Vec::new();
        let mut put = |number: u64, count: usize| bits.extend((0..count).rev().map(|bit| number >> bit & 1 == 1));
        put(values[0] as u32 as u64 & (u64::MAX >> (64 - width)), width);
        let mut last = values[0];
        for block in values.chunks(32) {
            let mapped = |value: &i32| {
                let shift = 32 - width;
                let step = value.wrapping_sub(std::mem::replace(&mut last, *value)) << shift >> shift;
                u64::from((step << 1 ^ step >> 31) as u32) & (u64::MAX >> (64 - width))
            };
            let mapped: Vec<u64> = block.iter().map(mapped).collect();
            let mean = mapped.iter().sum::<u64>() / mapped.len() as u64;
            let low = (mean.max(1).ilog2() as u64).min(plain + 1);
            match () {
                () if mapped.iter().all(|step| *step == 0) => put(0, head),
                () if low >= plain => {
                    put(plain + 1, head);
                    mapped.iter().for_each(|step| put(*step, width));
                }
                () => {
                    put(low + 1, head);
                    for step in mapped {
                        put(1, (step >> low) as usize + 1);
                        put(step & ((1 << low) - 1), low as usize);
                    }
                }
            }
        }
        bits.chunks(8).map(|byte| (0..8).fold(0, |all, at| all << 1 | u8::from(byte.get(at) == Some(&true)))).collect()
    }

    #[test]
    fn what_was_coded_comes_back() {
        for (size, least, most) in [(1, 0, 255), (2, -32768, 32767), (4, i32::MIN, i32::MAX)] {
            let mut values: Vec<i32> = (0..200).map(|i| (i * i / 7) % 250).collect();
            values.extend([least, most, most, least, 0, 0, 0, most]);
            values.extend([9; 70]);
            let code = coded(&values, size);
            assert_eq!(decoded(&code, size, 32, values.len()).unwrap(), values, "{size}");
            assert_eq!(decoded(&code[..code.len() / 2], size, 32, values.len()), None);
            assert!(decoded(&[], size, 32, 1).is_none());
        }
    }
}
