//! The ids of a leaf of tracks.
//!
//! Neighbours in space have ids that have nothing to do with each other, or nearly follow one another; and few bits of 64 differ from
//! particle to particle, though those may be anywhere: families, generations and halves of a run begin at numbers far apart. So an id
//! is cut in two: the upper parts are few, and are kept as a table; the lower ones are kept as they are, or as differences.

use crate::codec::states::{as_before, decode, decode_unsigned, encode, encode_unsigned};

/// In the first byte: lower parts are differences to those before.
const DIFFERENCES: u8 = 0x80;

/// Ids, as bytes.
pub fn encode_ids(ids: &[u64]) -> Vec<u8> {
    let bits = lower_bits(ids);
    let ways = [(bits, false), (bits, true), (u64::BITS, true)];
    let all = ways.map(|(bits, by_differences)| encode_cut(ids, bits, by_differences));
    all.into_iter().min_by_key(Vec::len).unwrap_or_default()
}

/// Of how many bits lower parts are, so that those and the numbers of upper ones take the least room.
fn lower_bits(ids: &[u64]) -> u32 {
    let mut sorted = ids.to_vec();
    sorted.sort_unstable();
    // How many neighbours there are whose highest bit that differs is this one: above it they are the same.
    let mut highest = [0_u64; u64::BITS as usize];
    for pair in sorted.windows(2).filter(|pair| pair[0] != pair[1]) {
        highest[(pair[0] ^ pair[1]).ilog2() as usize] += 1;
    }
    let room = |bits: u32| {
        let upper = 1 + highest[bits as usize..].iter().sum::<u64>();
        let number = u64::BITS - (upper - 1).leading_zeros();
        ids.len() as u64 * u64::from(bits + number) + upper * u64::from(u64::BITS - bits)
    };
    (0..u64::BITS).min_by_key(|bits| room(*bits)).unwrap_or(0)
}

fn encode_cut(ids: &[u64], bits: u32, by_differences: bool) -> Vec<u8> {
    let upper = |id: &u64| id.unbounded_shr(bits);
    let lower = |id: &u64| id & !u64::MAX.unbounded_shl(bits);
    let mut table: Vec<u64> = ids.iter().map(upper).collect();
    table.sort_unstable();
    table.dedup();
    let mut out = Vec::with_capacity(4 * ids.len());
    out.push(bits as u8 | if by_differences { DIFFERENCES } else { 0 });
    out.extend((table.len() as u32).to_le_bytes());
    encode(&table.iter().map(|value| *value as i64).collect::<Vec<_>>(), as_before(0), &mut out);
    encode_unsigned(ids.iter().map(|id| table.partition_point(|known| *known < upper(id)) as u64), &mut out);
    if by_differences {
        encode(&ids.iter().map(|id| lower(id) as i64).collect::<Vec<_>>(), as_before(0), &mut out);
    } else {
        encode_unsigned(ids.iter().map(lower), &mut out);
    }
    out
}

/// Reads `count` ids.
///
/// # Errors
/// What was expected.
pub(super) fn decode_ids(bytes: &[u8], count: usize) -> Result<Vec<u64>, &'static str> {
    if bytes.is_empty() && count == 0 {
        return Ok(Vec::new());
    }
    let (head, mut input) = bytes.split_first_chunk::<5>().ok_or("room for how ids are cut")?;
    let [first, len @ ..] = *head;
    let (bits, len) = (u32::from(first & !DIFFERENCES), u32::from_le_bytes(len) as usize);
    if bits > u64::BITS || len > count {
        return Err("ids that are cut in two, and no more upper parts than ids");
    }
    let table: Vec<u64> = decode(&mut input, len, as_before(0))?.into_iter().map(|value| value as u64).collect();
    let upper = decode_unsigned(&mut input, count)?;
    let lower = match first & DIFFERENCES {
        0 => decode_unsigned(&mut input, count)?,
        _ => decode(&mut input, count, as_before(0))?.into_iter().map(|value| value as u64).collect(),
    };
    if !input.is_empty() {
        return Err("nothing after the ids");
    }
    let id = |(upper, lower): (u64, u64)| {
        let upper = *table.get(usize::try_from(upper).ok()?)?;
        let is_whole = upper.unbounded_shl(bits).unbounded_shr(bits) == upper && lower.unbounded_shr(bits) == 0;
        is_whole.then(|| upper.unbounded_shl(bits) | lower)
    };
    upper.into_iter().zip(lower).map(id).collect::<Option<_>>().ok_or("an upper part of the table for each id")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(cases(128))]

        #[test]
        fn ids_come_back(
            ids in prop::collection::vec((any::<u64>(), 0_u32..64), 0..300), at: usize, byte: u8,
        ) {
            let ids: Vec<u64> = ids.into_iter().map(|(id, shift)| id >> shift).collect();
            let mut bytes = encode_ids(&ids);
            prop_assert_eq!(decode_ids(&bytes, ids.len()).unwrap(), ids.clone());
            prop_assert!(decode_ids(&bytes[..bytes.len() - 1], ids.len()).is_err());
            // Damage that a checksum does not find is no panic.
            let at = at % bytes.len();
            bytes[at] = byte;
            drop(decode_ids(&bytes, ids.len()));
        }

        /// What has been shuffled takes the bits that tell particles apart, wherever those are; what is in order takes few.
        #[test]
        fn ids_take_the_bits_that_differ(bits in 8_u32..30, shift in 0_u32..30, seed in 1_u64..1 << 40) {
            let mut random = seed;
            let ids: Vec<u64> = (0..4096).map(|_| {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let id = (random >> 20) & ((1 << bits) - 1);
                if random >> 61 == 0 { id | 1 << (bits + shift) } else { id }
            }).collect();
            let most = 4096 * (bits as usize + 1) / 8 + 2 * 4096 / 32 + 64;
            prop_assert!(encode_ids(&ids).len() <= most, "{} of {most}", encode_ids(&ids).len());
            let in_order: Vec<u64> = (0..4096).map(|i| seed + 3 * i).collect();
            prop_assert!(encode_ids(&in_order).len() <= 4096 * 3 / 8 + 2 * 4096 / 32 + 256);
        }
    }
}
