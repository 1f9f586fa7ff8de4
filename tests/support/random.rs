//! Numbers at random that are the same everywhere.

use deepfield::model::mixing::{GOLDEN, mix_bits};

/// A small, fast, seeded generator (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// Any number.
    pub fn whole(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        mix_bits(self.0)
    }

    /// Uniform in [0, 1).
    pub fn next(&mut self) -> f64 {
        (self.whole() >> 11) as f64 / (1_u64 << 53) as f64
    }
}
