//! A relaxed halo: a Plummer sphere, in whose field each particle moves, so that the halo stays as it is while all of it moves.

use super::{Moving, State, even, scaled, sum};
use crate::model::FamilyName;
use crate::synth::random::Random;

/// Length of the steps in which orbits are followed, a power of two so that they end at the same bits.
const STEP: f64 = 1.0 / 64.0;
/// Share of the mass that is made: what is farther out than 30 scale radii is left away.
const INNER: f64 = 0.998;

/// The halo, as dark matter; scale radius, mass and the constant of gravitation are 1.
#[derive(Clone, Copy, Debug)]
pub struct Halo {
    seed: u64,
    particles: u64,
}

impl Halo {
    /// So many particles.
    pub fn new(seed: u64, particles: u64) -> Halo {
        Halo { seed, particles }
    }

    /// A particle's place and velocity at the time 0: of the Plummer sphere's distribution function.
    fn begin(&self, particle: u64) -> [[f64; 3]; 2] {
        let mut random = Random::new(self.seed, particle);
        // The mass within r is r^3 (1 + r^2)^(-3/2).
        let share = INNER * (1.0 - random.uniform());
        let radius = 1.0 / (libm::pow(share, -2.0 / 3.0) - 1.0).sqrt();
        let speed = loop {
            // Speeds by that of escape are distributed as q^2 (1 - q^2)^(7/2), which is below 0.1.
            let (q, height) = (random.uniform(), 0.1 * random.uniform());
            let left = 1.0 - q * q;
            if height < q * q * left * left * left * left.sqrt() {
                break q * (2.0 / (1.0 + radius * radius).sqrt()).sqrt();
            }
        };
        [scaled(random.direction(), radius), scaled(random.direction(), speed)]
    }
}

/// The field at a place.
fn pull(position: [f64; 3]) -> [f64; 3] {
    let square: f64 = 1.0 + position.iter().map(|x| x * x).sum::<f64>();
    scaled(position, -1.0 / (square * square.sqrt()))
}

/// A step of Runge and Kutta's fourth order.
fn advanced([x, v]: [[f64; 3]; 2], step: f64) -> [[f64; 3]; 2] {
    let after = |a: [f64; 3], rate: [f64; 3], share: f64| sum(a, scaled(rate, share * step));
    let a1 = pull(x);
    let (v2, a2) = (after(v, a1, 0.5), pull(after(x, v, 0.5)));
    let (v3, a3) = (after(v, a2, 0.5), pull(after(x, v2, 0.5)));
    let (v4, a4) = (after(v, a3, 1.0), pull(after(x, v3, 1.0)));
    let mean =
        |a: [f64; 3], b: [f64; 3], c: [f64; 3], d: [f64; 3]| scaled(sum(sum(a, d), scaled(sum(b, c), 2.0)), 1.0 / 6.0);
    [after(x, mean(v, v2, v3, v4), 1.0), after(v, mean(a1, a2, a3, a4), 1.0)]
}

impl Moving for Halo {
    fn len(&self) -> u64 {
        self.particles
    }

    fn times(&self, _steps: usize) -> (f64, f64) {
        // Around the half-mass radius, some ten steps an orbit.
        (0.0, 1.0)
    }

    fn at(&self, particle: u64, _step: usize, time: f64) -> Option<State> {
        let mut state = self.begin(particle);
        let whole = (time / STEP).floor();
        for _ in 0..whole as u64 {
            state = advanced(state, STEP);
        }
        let [position, velocity] = advanced(state, time - whole * STEP);
        Some(even(FamilyName::Dark, position, velocity, self.mass(), 0.1))
    }

    fn mass(&self) -> f64 {
        1.0 / self.particles.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_half_mass_radius_stays_and_energy_is_kept() {
        let halo = Halo::new(2, 4000);
        let half_mass = |time: f64| {
            let radius = |particle| {
                let place = halo.at(particle, 0, time).unwrap().position;
                place.iter().map(|x| x * x).sum::<f64>().sqrt()
            };
            let mut radii: Vec<f64> = (0..4000).map(radius).collect();
            radii.sort_by(f64::total_cmp);
            radii[2000]
        };
        // 1.305 for all of a Plummer sphere.
        for time in [0.0, 1.0, 4.3] {
            assert!((half_mass(time) / 1.305 - 1.0).abs() < 0.06, "{time}: {}", half_mass(time));
        }
        let energy = |particle, time| {
            let State { position: x, velocity: v, .. } = halo.at(particle, 0, time).unwrap();
            let square = |a: [f64; 3]| a.iter().map(|x| x * x).sum::<f64>();
            0.5 * square(v) - 1.0 / (1.0 + square(x)).sqrt()
        };
        for particle in 0..200 {
            assert!((energy(particle, 0.0) - energy(particle, 7.9)).abs() < 1e-7);
        }
    }
}
