//! Codebook indices as bytes: 8 bits, 12 bits (two indices in three bytes) or 16 bits, little-endian.

use super::refinement::REFINEMENT_BITS;
use serde::{Deserialize, Serialize};

/// Bits of a codebook index on disk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum VqBits {
    /// At most 256 entries for each codebook.
    #[default]
    Eight,
    /// At most 4096 entries.
    Twelve,
    /// At most 65536 entries.
    Sixteen,
}

impl VqBits {
    /// The number of bits.
    pub const fn bits(self) -> u8 {
        match self {
            VqBits::Eight => 8,
            VqBits::Twelve => 12,
            VqBits::Sixteen => 16,
        }
    }

    /// The largest number of entries that an index can name.
    pub const fn entries(self) -> usize {
        1 << self.bits()
    }

    /// The bits of an index that is refined, too; 16 have none left over.
    pub const fn refined(self) -> VqBits {
        match self {
            VqBits::Eight => VqBits::Twelve,
            VqBits::Twelve | VqBits::Sixteen => VqBits::Sixteen,
        }
    }

    /// Bytes that `count` packed indices take; `None` where that overflows.
    pub fn packed_len(self, count: usize) -> Option<usize> {
        match self {
            VqBits::Eight => Some(count),
            VqBits::Twelve => count.checked_mul(3).map(|bits| bits.div_ceil(2)),
            VqBits::Sixteen => count.checked_mul(2),
        }
    }

    /// Appends the packed `codes` to `out`.
    pub fn pack(self, codes: &[u16], out: &mut Vec<u8>) {
        match self {
            VqBits::Eight => out.extend(codes.iter().map(|&code| code as u8)),
            VqBits::Sixteen => out.extend(codes.iter().flat_map(|code| code.to_le_bytes())),
            VqBits::Twelve => {
                let (pairs, odd) = codes.as_chunks::<2>();
                let start = out.len();
                out.resize(start + 3 * pairs.len(), 0);
                for (triple, &[a, b]) in out[start..].as_chunks_mut::<3>().0.iter_mut().zip(pairs) {
                    *triple = [a as u8, (a >> 8 & 0xf) as u8 | (b << 4) as u8, (b >> 4) as u8];
                }
                out.extend(odd.iter().flat_map(|code| [*code as u8, (code >> 8 & 0xf) as u8]));
            }
        }
    }

    /// Appends `count` codes to `out`. `bytes` holds exactly [`VqBits::packed_len`] bytes; fewer give fewer codes.
    pub fn unpack(self, bytes: &[u8], count: usize, out: &mut Vec<u16>) {
        match self {
            VqBits::Eight => out.extend(bytes.iter().take(count).map(|&byte| u16::from(byte))),
            VqBits::Sixteen => {
                out.extend(bytes.chunks_exact(2).take(count).map(|pair| u16::from_le_bytes([pair[0], pair[1]])));
            }
            VqBits::Twelve => {
                let triples = bytes.as_chunks::<3>().0;
                let triples = &triples[..triples.len().min(count / 2)];
                let start = out.len();
                out.resize(start + 2 * triples.len(), 0);
                for (pair, triple) in out[start..].as_chunks_mut::<2>().0.iter_mut().zip(triples) {
                    let [a, b, c] = triple.map(u16::from);
                    *pair = [a | (b & 0xf) << 8, b >> 4 | c << 4];
                }
                // The last of an odd number has two bytes of its own.
                if let ([a, b, ..], 1) = (&bytes[3 * triples.len()..], count % 2) {
                    out.push(u16::from(*a) | (u16::from(*b) & 0xf) << 8);
                }
            }
        }
    }
}

/// Bits of the codes of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeBits {
    /// Those that name an entry of a codebook.
    pub entries: VqBits,
    /// Those of a leaf's code: the same, or [`VqBits::refined`].
    pub leaves: VqBits,
}

impl CodeBits {
    /// Leaves are coded like all else.
    pub const fn plain(bits: VqBits) -> CodeBits {
        CodeBits { entries: bits, leaves: bits }
    }

    /// Codes of leaves tell smoothing lengths more finely.
    pub const fn refined(bits: VqBits) -> CodeBits {
        CodeBits { entries: bits, leaves: bits.refined() }
    }

    /// Whether codes of leaves are refined.
    pub fn is_refined(self) -> bool {
        self.leaves != self.entries
    }

    /// The bits of a leaf's codes, or of other nodes'.
    pub const fn of(self, is_leaf: bool) -> VqBits {
        if is_leaf { self.leaves } else { self.entries }
    }
}

// Where a code is refined it has as many bits more.
const _: () = assert!(VqBits::Eight.refined().bits() as u32 == VqBits::Eight.bits() as u32 + REFINEMENT_BITS);
const _: () = assert!(VqBits::Twelve.refined().bits() as u32 == VqBits::Twelve.bits() as u32 + REFINEMENT_BITS);

impl TryFrom<u8> for VqBits {
    type Error = String;

    fn try_from(bits: u8) -> Result<VqBits, String> {
        match bits {
            8 => Ok(VqBits::Eight),
            12 => Ok(VqBits::Twelve),
            16 => Ok(VqBits::Sixteen),
            _ => Err(format!("{bits} bits: expected 8, 12 or 16")),
        }
    }
}

impl From<VqBits> for u8 {
    fn from(bits: VqBits) -> u8 {
        bits.bits()
    }
}

impl std::str::FromStr for VqBits {
    type Err = String;

    fn from_str(text: &str) -> Result<VqBits, String> {
        text.parse::<u8>().map_err(|_| format!("{text:?}: expected 8, 12 or 16")).and_then(VqBits::try_from)
    }
}

impl std::fmt::Display for VqBits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.bits())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn codes_round_trip(
            bits in prop::sample::select(vec![VqBits::Eight, VqBits::Twelve, VqBits::Sixteen]),
            codes in prop::collection::vec(any::<u16>(), 0..50),
        ) {
            let codes: Vec<u16> = codes.into_iter().map(|code| code & (bits.entries() - 1) as u16).collect();
            let mut bytes = Vec::new();
            bits.pack(&codes, &mut bytes);
            prop_assert_eq!(Some(bytes.len()), bits.packed_len(codes.len()));
            let mut back = Vec::new();
            bits.unpack(&bytes, codes.len(), &mut back);
            prop_assert_eq!(&back, &codes);
            // One code's bits follow those of the one before.
            let width = usize::from(bits.bits());
            let bit = |at: usize| u16::from(bytes[at / 8] >> (at % 8) & 1);
            for (i, &code) in codes.iter().enumerate() {
                prop_assert_eq!((0..width).fold(0, |read, k| read | bit(i * width + k) << k), code);
            }
            let mut fewer = Vec::new();
            bits.unpack(&bytes[..bytes.len() / 2], codes.len(), &mut fewer);
            prop_assert!(codes.starts_with(&fewer), "{:?} of {:?}", fewer, codes);
        }
    }
}
