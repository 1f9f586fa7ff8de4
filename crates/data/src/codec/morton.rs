//! Morton (Z-order) keys: three 21-bit coordinates interleaved into 63 bits, x in the lowest bit of each triple.

/// Bits per coordinate.
pub const MORTON_BITS: u32 = 21;

/// The key of a cell.
#[inline]
pub fn encode([x, y, z]: [u32; 3]) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// The cell of a key.
#[inline]
pub fn decode(key: u64) -> [u32; 3] {
    [compact(key) as u32, compact(key >> 1) as u32, compact(key >> 2) as u32]
}

#[inline(always)]
fn spread(v: u32) -> u64 {
    let mut v = u64::from(v) & 0x1f_ffff;
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// The coordinate in every third bit of a key, from the lowest on.
#[inline(always)]
pub(super) fn compact(v: u64) -> u64 {
    let mut v = v & 0x1249_2492_4924_9249;
    v = (v | v >> 2) & 0x10c3_0c30_c30c_30c3;
    v = (v | v >> 4) & 0x100f_00f0_0f00_f00f;
    v = (v | v >> 8) & 0x001f_0000_ff00_00ff;
    v = (v | v >> 16) & 0x001f_0000_0000_ffff;
    (v | v >> 32) & 0x1f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn keys_round_trip(cell in prop::array::uniform3(0..1_u32 << MORTON_BITS)) {
            prop_assert_eq!(decode(encode(cell)), cell);
        }

        #[test]
        fn a_prefix_is_the_enclosing_cell(cell in prop::array::uniform3(0..1_u32 << MORTON_BITS), up in 0..MORTON_BITS) {
            prop_assert_eq!(decode(encode(cell) >> (3 * up)), cell.map(|v| v >> up));
        }
    }
}
