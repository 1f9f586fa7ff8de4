//! Numbers that look random and are the same everywhere.

/// What SplitMix64 (Steele, Lea and Flood 2014) adds to its counter: 2^64 over the golden ratio.
pub const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A hash of an integer, each of whose bits depends on all of it (the output function of SplitMix64). 0 stays 0: whoever may have that adds
/// [`GOLDEN`] before.
pub fn mix_bits(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ (value >> 31)
}

/// A hash as a number from 0 to below 1.
pub fn as_share(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}
