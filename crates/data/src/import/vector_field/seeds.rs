//! Where particles begin.

use super::field::VectorField;
use super::interval::Interval;
use super::particle::Particle;
use crate::import::ImportError;
use crate::model::Bounds;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

/// Places that are tried for each particle, and beside.
const TRIES: u64 = 64;
const MORE_TRIES: u64 = 1 << 16;
/// Places that are tried at once.
const BLOCK: u64 = 1 << 14;
/// The roots of x^(d+1) = x + 1 for d dimensions: multiples of their inverse powers are spread evenly (M. Roberts 2018, The unreasonable
/// effectiveness of quasirandom sequences).
const ROOTS: [f64; 3] = [1.618_033_988_749_895, 1.324_717_957_244_746, 1.220_744_084_605_759_5];

/// Where particles begin.
#[derive(Clone, Debug, PartialEq)]
pub enum Seeds {
    /// Spread evenly where the field has velocities.
    Spread {
        /// How many.
        count: u64,
        /// In this box, as far as it is in that of the field; `None`: in all of it. It may have no thickness.
        within: Option<Bounds>,
        /// Another number spreads them otherwise.
        random: u64,
    },
    /// At these places.
    At(Vec<[f64; 3]>),
}

/// Particles at their beginnings.
pub(super) struct Seeded {
    pub particles: Vec<Particle>,
    /// The volume that each stands for; of a flat field the area times the spacing.
    pub volume: f64,
    /// Their mean distance.
    pub spacing: f64,
    /// How many were asked for.
    pub asked: u64,
}

impl Seeds {
    /// Puts particles to where they begin.
    ///
    /// # Errors
    /// Where that is nowhere in the field.
    pub(super) fn begin(&self, field: &VectorField, interval: &Interval) -> Result<Seeded, ImportError> {
        let whole = field.bounds();
        let (particles, tried, bounds, asked) = match self {
            Seeds::At(places) => {
                let all = places.iter().zip(0..);
                let found = all.filter_map(|(place, id)| Particle::new(interval, id, *place));
                (found.collect(), places.len() as u64, whole, places.len() as u64)
            }
            Seeds::Spread { count, within, random } => {
                let within = within.unwrap_or(whole);
                let bounds = Bounds { min: whole.min.max(within.min), max: whole.max.min(within.max) };
                let (particles, tried) = spread(bounds, *count, *random, interval);
                (particles, tried, bounds, *count)
            }
        };
        if particles.is_empty() {
            let expected = "a place where the field has a velocity";
            return Err(ImportError::missing(field.path(), "seeds", expected));
        }
        let mut sides: Vec<f64> = bounds.size().to_array().into_iter().filter(|side| *side > 0.0).collect();
        sides.sort_unstable_by(|a, b| b.total_cmp(a));
        let spacing = spacing(&sides, tried);
        if !(spacing > 0.0 && spacing.is_finite()) {
            return Err(ImportError::malformed(field.path(), "seeds", "a box without extent", "one with some"));
        }
        let across = spacing.powi(3 - sides.len() as i32);
        Ok(Seeded { particles, volume: sides.iter().product::<f64>() / tried as f64 * across, spacing, asked })
    }
}

/// The mean distance of so many places in a box with these sides, the longest first. Sides shorter than that do not count.
fn spacing(sides: &[f64], count: u64) -> f64 {
    let of = |dimensions: usize| {
        (sides.iter().take(dimensions).product::<f64>() / count.max(1) as f64).powf(1.0 / dimensions as f64)
    };
    let is_thick = |dimensions: &usize| sides.get(dimensions - 1).is_some_and(|side| *side >= of(*dimensions));
    (1..=sides.len()).rev().find(is_thick).map_or(0.0, of)
}

/// Spreads particles in a box; how many places were tried.
fn spread(bounds: Bounds, count: u64, random: u64, interval: &Interval) -> (Vec<Particle>, u64) {
    let size = bounds.size();
    let dimensions = size.to_array().iter().filter(|side| **side > 0.0).count();
    if bounds.is_empty() || dimensions == 0 {
        return (Vec::new(), 0);
    }
    let mut numbers = Pcg64Mcg::seed_from_u64(random);
    let offsets: [f64; 3] = std::array::from_fn(|_| (numbers.next_u64() >> 11) as f64 / (1_u64 << 53) as f64);
    let root = ROOTS[dimensions - 1];
    let mut power = 1.0;
    let steps: [f64; 3] = std::array::from_fn(|axis| {
        if size[axis] > 0.0 {
            power /= root;
            power
        } else {
            0.0
        }
    });
    let place = |number: u64| -> [f64; 3] {
        std::array::from_fn(|axis| {
            bounds.min[axis] + size[axis] * (offsets[axis] + steps[axis] * number as f64).fract()
        })
    };
    let most = count.saturating_mul(TRIES).saturating_add(MORE_TRIES);
    let (mut particles, mut tried) = (Vec::new(), 0);
    while tried < most {
        let block = tried..most.min(tried + BLOCK);
        let found: Vec<Option<Particle>> =
            block.into_par_iter().map(|number| Particle::new(interval, 0, place(number))).collect();
        for particle in found {
            tried += 1;
            if let Some(mut particle) = particle {
                particle.id = particles.len() as u64;
                particles.push(particle);
                if particles.len() as u64 == count {
                    return (particles, tried);
                }
            }
        }
    }
    (particles, tried)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_sides_that_count() {
        assert!((spacing(&[4.0, 2.0, 1.0], 64) - 0.5).abs() < 1e-12);
        assert!((spacing(&[4.0, 4.0], 64) - 0.5).abs() < 1e-12);
        // Thinner than the distance within it.
        assert!((spacing(&[4.0, 4.0, 0.01], 64) - 0.5).abs() < 1e-12);
        assert_eq!(spacing(&[], 64), 0.0);
    }
}
