//! A Fourier transform of lines whose length is a power of two, in double precision and the same to the last bit on every machine.

use std::f64::consts::PI;

/// A complex number.
pub(crate) type Complex = [f64; 2];

/// What transforms of lines of one length need.
pub(crate) struct Transform {
    roots: Vec<Complex>,
    reversed: Vec<u32>,
}

impl Transform {
    /// For lines of `size` numbers, a power of two of at least 2 and at most 2^31.
    pub(crate) fn new(size: usize) -> Transform {
        let root = |number: usize| {
            let angle = 2.0 * PI * number as f64 / size as f64;
            [libm::cos(angle), -libm::sin(angle)]
        };
        let bits = size.trailing_zeros();
        let reversed = (0..size as u32).map(|index| index.reverse_bits() >> (32 - bits)).collect();
        Transform { roots: (0..size / 2).map(root).collect(), reversed }
    }

    /// Transforms a line in place, with `exp(-i k x)`, or `exp(+i k x)` for the way back; neither divides by the number of elements.
    pub(crate) fn apply(&self, line: &mut [Complex], is_back: bool) {
        for (index, &to) in self.reversed.iter().enumerate() {
            if index < to as usize {
                line.swap(index, to as usize);
            }
        }
        let sign = if is_back { -1.0 } else { 1.0 };
        let mut half = 1;
        while half < line.len() {
            let stride = self.roots.len() / half;
            for block in line.chunks_exact_mut(2 * half) {
                let (low, high) = block.split_at_mut(half);
                for ((a, b), root) in low.iter_mut().zip(high).zip(self.roots.iter().step_by(stride)) {
                    let (cos, sin) = (root[0], sign * root[1]);
                    let turned = [b[0] * cos - b[1] * sin, b[0] * sin + b[1] * cos];
                    *b = [a[0] - turned[0], a[1] - turned[1]];
                    *a = [a[0] + turned[0], a[1] + turned[1]];
                }
            }
            half *= 2;
        }
    }
}
