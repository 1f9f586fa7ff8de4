//! Random numbers and the few functions of the generators, the same to the last bit on every machine.

use crate::model::mixing::{GOLDEN, mix_bits};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};

/// A stream of random numbers.
pub struct Random(Pcg64Mcg);

impl Random {
    /// The stream that belongs to a seed and a number.
    pub fn new(seed: u64, stream: u64) -> Random {
        // Two rounds of an integer hash keep neighbouring seeds and streams apart.
        Random(Pcg64Mcg::seed_from_u64(mix_bits(mix_bits(seed.wrapping_add(GOLDEN)) ^ stream)))
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    /// Close to normal with unit variance: the sum of twelve uniform numbers.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// Nearly as close to normal with unit variance, and quicker: the sum of eight uniform numbers of 16 bits.
    pub fn quick_normal(&mut self) -> f64 {
        let lanes = |bits: u64| (bits & 0xffff) + (bits >> 16 & 0xffff) + (bits >> 32 & 0xffff) + (bits >> 48);
        let sum = lanes(self.0.next_u64()) + lanes(self.0.next_u64());
        // Eight numbers with a variance of 1/12 each; the square root of 12/8.
        (sum as f64 / 65536.0 - 4.0 + 8.0 / 131_072.0) * 1.224_744_871_391_589
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let point = [self.signed(), self.signed(), self.signed()];
            let square: f64 = point.iter().map(|x| x * x).sum();
            if (1e-6..1.0).contains(&square) {
                return point.map(|x| x / square.sqrt());
            }
        }
    }
}

/// Into [0, 1).
pub fn wrap(x: f64) -> f64 {
    let wrapped = x - x.floor();
    if wrapped < 1.0 { wrapped } else { 0.0 }
}

/// The cross product of two vectors.
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Cube root of a positive number, to within two units of the last place.
pub fn cbrt(x: f64) -> f64 {
    // A first guess from a third of the exponent, then Newton's iteration.
    let mut root = f64::from_bits(x.to_bits() / 3 + (0x3ff0_0000_0000_0000 / 3) * 2);
    for _ in 0..5 {
        root -= (root - x / (root * root)) / 3.0;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_roots() {
        for x in [1e-300, 1e-9, 0.1, 1.0, 2.0, 27.0, 1e12, 1e300] {
            assert!((cbrt(x).powi(3) / x - 1.0).abs() < 1e-14, "{x}");
        }
    }

    #[test]
    fn streams_are_repeatable_and_differ() {
        let take = |seed, stream| (0..4).map(|_| Random::new(seed, stream).uniform()).next();
        assert_eq!(take(1, 2), take(1, 2));
        assert_ne!(take(1, 2), take(2, 1));
        let mut random = Random::new(0, 0);
        for normal in [Random::normal, Random::quick_normal] {
            let numbers: Vec<f64> = (0..20_000).map(|_| normal(&mut random)).collect();
            let mean = numbers.iter().sum::<f64>() / 20_000.0;
            let square = numbers.iter().map(|x| x * x).sum::<f64>() / 20_000.0;
            assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.05, "{mean} {square}");
        }
    }
}
