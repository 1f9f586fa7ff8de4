//! Numbers that belong to the places of a lattice: random access instead of a sequence, so that any window can be made
//! alone.

use deepfield_data::model::mixing::{GOLDEN, mix_bits};

/// The noise of one purpose: a lattice of independent numbers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise(u64);

/// One row of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct NoiseRow(u64);

impl Noise {
    /// The lattice that belongs to a seed and a purpose.
    pub(super) fn new(seed: u64, purpose: u64) -> Noise {
        Noise(mix_bits(mix_bits(seed.wrapping_add(GOLDEN)) ^ purpose.wrapping_mul(GOLDEN)))
    }

    /// A row of the lattice.
    pub(super) fn row(self, row: i64) -> NoiseRow {
        NoiseRow(mix_bits(self.0 ^ mix_bits((row as u64).wrapping_add(GOLDEN))))
    }
}

impl NoiseRow {
    /// 64 random bits.
    pub(super) fn bits(self, column: i64) -> u64 {
        mix_bits(self.0.wrapping_add((column as u64).wrapping_mul(GOLDEN)))
    }

    /// Uniform in [0, 1).
    pub(super) fn uniform(self, column: i64) -> f64 {
        (self.bits(column) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Close to normal, with mean 0 and variance 1: the sum of four uniform numbers of 16 bits.
    pub(super) fn normal(self, column: i64) -> f64 {
        /// The mean of the sum.
        const MEAN: f64 = 2.0 * 65535.0;
        /// One over the root of its variance, (65536^2 - 1) / 3.
        const SCALE: f64 = 1.0 / 37_837.227_237_206_48;
        let bits = self.bits(column);
        let sum = (bits & 0xffff) + (bits >> 16 & 0xffff) + (bits >> 32 & 0xffff) + (bits >> 48);
        (sum as f64 - MEAN) * SCALE
    }
}
