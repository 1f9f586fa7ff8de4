//! A tile of a photo as bytes and back.
//!
//! A byte whose bit 0 says that the texels' shares of T are kept, and bit 1 that red and blue are, as what they are more than green; shares; the
//! photo's planes ([`crate::codec::heights`]). Shares that are not kept are 255.

use crate::codec::heights;
use crate::hierarchy::chunks::Part;
use crate::hierarchy::photo::means::Texel;
use crate::hierarchy::photo::{PhotoLattice, TileKey};

/// Bit of the first byte: shares of T are kept.
const SHARES: u8 = 1;
/// Bit of the first byte: of red and blue the differences from green are kept.
const DIFFERENCES: u8 = 2;

/// A tile of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// Which one it is.
    pub key: TileKey,
    /// Its texels, among those of its level.
    pub part: Part,
    /// The texels, row by row.
    pub texels: Vec<Texel>,
}

/// The bytes of a tile's texels, in rows of `columns`, of a photo with so many planes.
pub fn encode(texels: &[Texel], columns: usize, planes: usize) -> Vec<u8> {
    let plane = |number: usize| texels.iter().map(|texel| texel[number]).collect::<Vec<u8>>();
    let coded = |planes: &[Vec<u8>]| {
        let mut out = Vec::with_capacity(texels.len() * planes.len() / 2);
        planes.iter().for_each(|plane| heights::encode_bytes(plane, columns, &mut out));
        out
    };
    let own: Vec<Vec<u8>> = (0..planes.min(3)).map(plane).collect();
    let mut best = (0, coded(&own));
    if let [red, green, blue] = &own[..] {
        let less = |plane: &[u8]| plane.iter().zip(green).map(|(value, green)| difference(*value, *green)).collect();
        let other = coded(&[less(red), green.clone(), less(blue)]);
        if other.len() < best.1.len() {
            best = (DIFFERENCES, other);
        }
    }
    let shares = plane(3);
    let has_shares = shares.iter().any(|share| *share != u8::MAX);
    let mut out = vec![best.0 | if has_shares { SHARES } else { 0 }];
    if has_shares {
        heights::encode_bytes(&shares, columns, &mut out);
    }
    out.extend_from_slice(&best.1);
    out
}

/// What a value is more than green, as a byte that is 128 where both are the same.
fn difference(value: u8, green: u8) -> u8 {
    value.wrapping_sub(green).wrapping_add(128)
}

/// Reads a tile from all of the bytes; `None` where they are none.
pub fn decode(bytes: &[u8], key: TileKey, lattice: &PhotoLattice, planes: usize) -> Option<Tile> {
    let part = lattice.part(key);
    let (&flags, mut rest) = bytes.split_first()?;
    if flags & !(SHARES | DIFFERENCES) != 0 || flags & DIFFERENCES != 0 && planes != 3 {
        return None;
    }
    let mut texels = vec![[u8::MAX; 4]; part.len()];
    let mut values = vec![0; part.len()];
    let shares = (flags & SHARES != 0).then_some(3);
    for plane in shares.into_iter().chain(0..planes) {
        rest = rest.get(heights::decode_bytes(rest, part.columns, &mut values)?..)?;
        texels.iter_mut().zip(&values).for_each(|(texel, value)| texel[plane] = *value);
    }
    for texel in &mut texels {
        match planes {
            1 => (texel[1], texel[2]) = (texel[0], texel[0]),
            _ if flags & DIFFERENCES != 0 => {
                [texel[0], texel[2]] = [texel[0], texel[2]].map(|less| less.wrapping_sub(128).wrapping_add(texel[1]));
            }
            _ => {}
        }
    }
    rest.is_empty().then_some(Tile { key, part, texels })
}

/// Bytes that a tile takes in memory.
pub fn memory(part: &Part) -> u64 {
    part.len() as u64 * 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tiles_come_back(rows in 1..9_u64, columns in 1..40_u64, planes in prop_oneof![Just(1_usize), Just(3)], spread in 1..=255_u8, seed: u64) {
            let lattice = PhotoLattice::new([rows, columns]);
            let key = TileKey { level: 0, row: 0, column: 0 };
            let mut state = seed | 1;
            let mut next = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) as u8
            };
            let texel = |_| {
                let [base, red, blue] = [next(), next() % spread, next() % spread];
                let share = if seed % 2 == 0 { 255 } else { next() };
                if planes == 1 { [base, base, base, share] } else { [base.wrapping_add(red), base, base.wrapping_add(blue), share] }
            };
            let texels: Vec<Texel> = (0..rows * columns).map(texel).collect();
            let bytes = encode(&texels, columns as usize, planes);
            let tile = decode(&bytes, key, &lattice, planes);
            prop_assert_eq!(tile.map(|tile| tile.texels), Some(texels));
            // No bytes are damage enough for a panic, and what is left over is damage.
            for cut in 0..bytes.len() {
                prop_assert!(decode(&bytes[..cut], key, &lattice, planes).is_none());
            }
            let mut more = bytes.clone();
            more.push(0);
            prop_assert!(decode(&more, key, &lattice, planes).is_none());
            for at in 0..bytes.len() {
                let mut other = bytes.clone();
                other[at] ^= 1 << (seed % 8);
                let _ = decode(&other, key, &lattice, planes);
            }
        }
    }
}
