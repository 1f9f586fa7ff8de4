//! The grid that the states of a run's particles are rounded to, so that they are the same on both sides of a step.
//!
//! A state is rounded by a rule that looks at its own step alone, so that the end of a track and the beginning of its successor have
//! the same bits: positions to a multiple of a power of two units that is at most 1/1024 of the smoothing length there, velocities to
//! the movement by as much within the longer one of the intervals that adjoin the step. Multiples of powers of two end in zero
//! bits, so nothing about the rule is stored.

use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::RootCell;

/// Bits of a coordinate within the root cell.
pub const LATTICE_BITS: u32 = 34;
/// What smoothing lengths are divided by for the longest step of positions. Distances are up to 0.87 steps off then; leaving every second
/// step of a collapse from rest out showed that twice as long steps cost a fifth of the spline's accuracy.
const ROUNDING: f64 = 1024.0;
/// Coordinates and movements are clamped to this, so that sums of a few of them do not overflow.
const LIMIT: f64 = (1_u64 << 58) as f64;

/// The grid that positions of a run are rounded to: [`LATTICE_BITS`] bits along each edge of a cell that holds all steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// The cell.
    pub root: RootCell,
}

impl Lattice {
    /// The length of a unit, world units.
    #[inline]
    pub fn unit(&self) -> f64 {
        self.root.size / (1_u64 << LATTICE_BITS) as f64
    }

    /// The exponent of the power of two units that positions with this smoothing length are multiples of: 0 where none is known.
    #[inline]
    pub fn exponent(&self, smoothing_length: f32) -> u32 {
        let units = f64::from(smoothing_length) / ROUNDING / self.unit();
        // The largest power of two that is not above it; what is no number gives 0.
        if units >= 2.0 { (units.log2().floor() as u32).min(LATTICE_BITS - 1) } else { 0 }
    }

    /// The coordinates of a position, to a unit.
    #[inline]
    pub fn place(&self, position: [f64; 3]) -> [i64; 3] {
        let min = self.root.min.to_array();
        std::array::from_fn(|axis| rounded((position[axis] - min[axis]) / self.unit(), 0))
    }

    /// Coordinates rounded to multiples of `2^exponent`.
    #[inline]
    pub fn settled(place: [i64; 3], exponent: u32) -> [i64; 3] {
        let half = (1_i64 << exponent) >> 1;
        place.map(|x| x.saturating_add(half) >> exponent << exponent)
    }

    /// The same of coordinates that are no whole numbers.
    #[inline]
    pub fn settle(place: [f64; 3], exponent: u32) -> [i64; 3] {
        place.map(|x| rounded(x, exponent))
    }

    /// The position of coordinates.
    #[inline]
    pub fn position(&self, place: [i64; 3]) -> [f64; 3] {
        let min = self.root.min.to_array();
        std::array::from_fn(|axis| min[axis] + place[axis] as f64 * self.unit())
    }

    /// A velocity as the movement in units within `span`, the longer interval that adjoins the step, rounded to multiples of
    /// `2^exponent`. `velocity` in world units by the unit of `span`.
    #[inline]
    pub fn movement(&self, velocity: [f64; 3], span: f64, exponent: u32) -> [i64; 3] {
        velocity.map(|v| rounded(v * span / self.unit(), exponent))
    }
}

/// The Morton key of a place; that of the nearest one in the root cell for what lies outside. Tracks are in the file in the order of the
/// keys of their beginnings.
#[inline]
pub fn morton_key(place: [i64; 3]) -> u64 {
    let most = (1 << LATTICE_BITS) - 1;
    morton::encode(place.map(|x| (x.clamp(0, most) >> (LATTICE_BITS - MORTON_BITS)) as u32))
}

/// `value` to the nearest multiple of `2^exponent`; 0 for what is no number.
fn rounded(value: f64, exponent: u32) -> i64 {
    let step = (1_u64 << exponent) as f64;
    ((value.clamp(-LIMIT, LIMIT) / step).round_ties_even() as i64) << exponent
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use glam::DVec3;
    use proptest::prelude::*;

    fn lattice() -> Lattice {
        Lattice { root: RootCell { min: DVec3::new(-3.0, 5.0, 100.0), size: 40.0 } }
    }

    proptest! {
        #![proptest_config(cases(256))]

        #[test]
        fn places_are_within_half_of_what_is_asked(
            position in prop::array::uniform3(0.0..40.0f64), h in -9.0..1.0f64, velocity in prop::array::uniform3(-5.0..5.0f64),
        ) {
            let (lattice, h) = (lattice(), 10f64.powf(h) as f32);
            let position: [f64; 3] = std::array::from_fn(|axis| lattice.root.min.to_array()[axis] + position[axis]);
            let exponent = lattice.exponent(h);
            let step = lattice.unit() * f64::from(1_u32 << exponent.min(31));
            prop_assert!(exponent == 0 || (step <= f64::from(h) / ROUNDING && 2.0 * step > f64::from(h) / ROUNDING * (1.0 - 1e-12)));
            let place = Lattice::settled(lattice.place(position), exponent);
            for (found, wanted) in lattice.position(place).into_iter().zip(position) {
                prop_assert!((found - wanted).abs() <= 0.5 * (step + lattice.unit()) + 1e-13);
            }
            // A state is a fixed point: rounding it again changes nothing.
            prop_assert_eq!(Lattice::settled(place, exponent), place);
            for (number, v) in lattice.movement(velocity, 0.25, exponent).into_iter().zip(velocity) {
                prop_assert!((number as f64 * lattice.unit() - v * 0.25).abs() <= 0.5 * step * (1.0 + 1e-12));
            }
        }
    }
}
