//! Which samples of a block were measured: all, none, lengths of runs, or a bit each, whichever is shortest.

/// First byte: all were measured.
const ALL: u8 = 0;
/// None was.
const NONE: u8 = 1;
/// Runs follow: how many bytes they take (four bytes), then their lengths in turn, those of measured samples first, each in groups of 7 bits,
/// the lowest first, the eighth bit set where another group follows.
const RUNS: u8 = 2;
/// A bit each follows, the lowest of a byte first.
const BITS: u8 = 3;

/// Appends the code.
pub(super) fn encode(valid: &[bool], out: &mut Vec<u8>) {
    let count = valid.iter().filter(|valid| **valid).count();
    if count == valid.len() {
        return out.push(ALL);
    }
    if count == 0 {
        return out.push(NONE);
    }
    let room = valid.len().div_ceil(8);
    let mut runs = Vec::new();
    let mut rest = valid;
    let mut kind = true;
    while !rest.is_empty() && runs.len() < room {
        let len = rest.iter().position(|valid| *valid != kind).unwrap_or(rest.len());
        let mut left = len;
        while left >= 128 {
            runs.push(left as u8 | 128);
            left >>= 7;
        }
        runs.push(left as u8);
        (rest, kind) = (&rest[len..], !kind);
    }
    if rest.is_empty() && runs.len() + 4 < room {
        out.push(RUNS);
        out.extend_from_slice(&(runs.len() as u32).to_le_bytes());
        out.extend_from_slice(&runs);
    } else {
        out.push(BITS);
        let byte = |bits: &[bool]| bits.iter().rev().fold(0, |byte, bit| (byte << 1) | u8::from(*bit));
        out.extend(valid.chunks(8).map(byte));
    }
}

/// Reads it from the front of the bytes: how many of them it takes, and the samples; `None` for these where all were measured.
pub(super) fn decode(bytes: &[u8], samples: usize) -> Option<(usize, Option<Vec<bool>>)> {
    let (&kind, bytes) = bytes.split_first()?;
    match kind {
        ALL => Some((1, None)),
        NONE => Some((1, Some(vec![false; samples]))),
        RUNS => {
            let len = u32::from_le_bytes(*bytes.first_chunk()?) as usize;
            let runs = bytes.get(4..)?.get(..len)?;
            let mut valid = Vec::with_capacity(samples);
            let (mut kind, mut run, mut shift) = (true, 0_u64, 0);
            for &byte in runs {
                run |= u64::from(byte & 127).checked_shl(shift)?;
                shift += 7;
                if byte & 128 != 0 {
                    if shift > 49 {
                        return None;
                    }
                    continue;
                }
                if run > (samples - valid.len()) as u64 {
                    return None;
                }
                valid.resize(valid.len() + run as usize, kind);
                (kind, run, shift) = (!kind, 0, 0);
            }
            (valid.len() == samples && shift == 0).then_some((len + 5, Some(valid)))
        }
        BITS => {
            let len = samples.div_ceil(8);
            let bits = bytes.get(..len)?;
            let valid = (0..samples).map(|at| bits[at / 8] >> (at % 8) & 1 == 1).collect();
            Some((len + 1, Some(valid)))
        }
        _ => None,
    }
}
