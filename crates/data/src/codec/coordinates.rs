//! Positions inside a node's cubic cell as packed integers.
//!
//! A cell is divided into `2^bits` bins along each axis; a bin decodes to its centre, `(v + 0.5) / 2^bits` of the cell's
//! edge, so that a world position is `cell.min + cell.size * decoded`. Both decoded forms are exact in `f32`: the
//! centre of a 21-bit bin needs 22 bits of significand.
//!
//! | word | bits | holds |
//! |---|---|---|
//! | grid, `u32` | 0-9, 10-19, 20-29 | x, y, z: 8 bits of merging cell, then 2 bits that place the centroid in it |
//! | | 30 | point (1) or sprite (0) |
//! | | 31 | zero |
//! | leaf, `u64` | 0-20, 21-41, 42-62 | x, y, z |
//! | | 63 | point (1) or sprite (0) |

/// Bits per coordinate of the merging grid of an inner node: 256^3 cells (F12 4.7).
pub const CELL_BITS: u32 = 8;
/// Bits per coordinate of a grid particle: its cell, and two bits that place the merged centroid inside the cell.
pub const GRID_BITS: u32 = 10;
/// Bits per coordinate of a leaf particle.
pub const LEAF_BITS: u32 = 21;
/// The bit of a grid word that marks a point.
pub const GRID_POINT: u32 = 1 << 30;
/// The bit of a leaf word that marks a point.
pub const LEAF_POINT: u64 = 1 << 63;

const GRID_MASK: u32 = (1 << GRID_BITS) - 1;
const LEAF_MASK: u64 = (1 << LEAF_BITS) - 1;

/// Packs bin numbers (each below `2^10`) and the point flag into a grid word.
#[inline]
pub fn pack_grid([x, y, z]: [u32; 3], point: bool) -> u32 {
    (x & GRID_MASK)
        | (y & GRID_MASK) << GRID_BITS
        | (z & GRID_MASK) << (2 * GRID_BITS)
        | if point { GRID_POINT } else { 0 }
}

/// Position of a grid word in its cell, each coordinate in `(0, 1)`.
pub fn unpack_grid(word: u32) -> [f32; 3] {
    const STEP: f32 = 1.0 / (1 << GRID_BITS) as f32;
    [0, GRID_BITS, 2 * GRID_BITS].map(|shift| ((word >> shift & GRID_MASK) as f32 + 0.5) * STEP)
}

/// Packs bin numbers (each below `2^21`) and the point flag into a leaf word.
#[inline]
pub fn pack_leaf([x, y, z]: [u32; 3], point: bool) -> u64 {
    (u64::from(x) & LEAF_MASK)
        | (u64::from(y) & LEAF_MASK) << LEAF_BITS
        | (u64::from(z) & LEAF_MASK) << (2 * LEAF_BITS)
        | if point { LEAF_POINT } else { 0 }
}

/// Position of a leaf word in its cell, each coordinate in `(0, 1)`.
#[inline]
pub fn unpack_leaf(word: u64) -> [f32; 3] {
    const STEP: f32 = 1.0 / (1 << LEAF_BITS) as f32;
    [0, LEAF_BITS, 2 * LEAF_BITS].map(|shift| ((word >> shift & LEAF_MASK) as f32 + 0.5) * STEP)
}

/// The bin, of `2^bits`, that holds `fraction` of a cell's edge; what lies outside `[0, 1)` goes to the nearest bin.
#[inline]
pub fn bin(fraction: f64, bits: u32) -> u32 {
    let bins = 1_u32 << bits;
    // `as` saturates: negative and NaN become 0.
    ((fraction * f64::from(bins)) as u32).min(bins - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn grid_words_decode_within_half_a_bin(p in prop::array::uniform3(0.0..1.0_f64), point: bool) {
            let word = pack_grid(p.map(|x| bin(x, GRID_BITS)), point);
            prop_assert_eq!(word & GRID_POINT != 0, point);
            prop_assert_eq!(word >> 31, 0);
            for (decoded, x) in unpack_grid(word).into_iter().zip(p) {
                prop_assert!((f64::from(decoded) - x).abs() <= 0.5 / 1024.0);
            }
        }

        #[test]
        fn leaf_words_decode_within_half_a_bin(p in prop::array::uniform3(0.0..1.0_f64), point: bool) {
            let word = pack_leaf(p.map(|x| bin(x, LEAF_BITS)), point);
            prop_assert_eq!(word & LEAF_POINT != 0, point);
            for (decoded, x) in unpack_leaf(word).into_iter().zip(p) {
                prop_assert!((f64::from(decoded) - x).abs() <= 0.5 / f64::from(1 << LEAF_BITS));
            }
        }
    }

    #[test]
    fn bins_saturate() {
        assert_eq!(bin(-3.0, 10), 0);
        assert_eq!(bin(f64::NAN, 10), 0);
        assert_eq!(bin(1.0, 10), 1023);
        assert_eq!(bin(1e300, 21), (1 << 21) - 1);
    }
}
