//! Plane waves in a periodic box that collapse: Zeldovich's pancake along each axis, in an Einstein and de Sitter universe.

use super::{Moving, State, even};
use crate::model::FamilyName;
use crate::synth::random::{Random, cbrt};

/// Edge of the box, Mpc/h.
const EDGE: f64 = 100.0;
/// Scale factor at which shells first cross.
const CROSSING: f64 = 0.6;
/// Scale factors of the first and the last step of a regular run.
const FROM_TO: [f64; 2] = [0.2, 1.0];

/// The pancake, as gas.
#[derive(Clone, Copy, Debug)]
pub struct Pancake {
    seed: u64,
    particles: u64,
}

impl Pancake {
    /// So many particles, spread evenly before they move.
    pub fn new(seed: u64, particles: u64) -> Pancake {
        Pancake { seed, particles }
    }

    /// The smoothing length of all particles: their mean distance.
    pub fn smoothing_length(&self) -> f64 {
        EDGE / cbrt(self.particles.max(1) as f64)
    }
}

impl Moving for Pancake {
    fn len(&self) -> u64 {
        self.particles
    }

    fn times(&self, steps: usize) -> (f64, f64) {
        (FROM_TO[0], (FROM_TO[1] - FROM_TO[0]) / steps.saturating_sub(1).max(1) as f64)
    }

    fn at(&self, particle: u64, _step: usize, time: f64) -> Option<State> {
        let mut random = Random::new(self.seed, particle);
        let wave = std::f64::consts::TAU / EDGE;
        let start = [(); 3].map(|()| EDGE * random.uniform());
        // dx/da.
        let growth = start.map(|q| -libm::sin(wave * q) / (wave * CROSSING));
        let position = [0, 1, 2].map(|axis| start[axis] + time * growth[axis]);
        // u = a^1.5 H dx/da, with H = 100 a^-1.5.
        let velocity = growth.map(|growth| 100.0 * growth);
        Some(even(FamilyName::Gas, position, velocity, self.mass(), self.smoothing_length()))
    }

    fn edge(&self) -> Option<f64> {
        Some(EDGE)
    }

    fn mass(&self) -> f64 {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shells_cross_and_faces_are_crossed() {
        let pancake = Pancake::new(1, 4000);
        let at = |particle, time| pancake.at(particle, 0, time).unwrap().position;
        let spread = |time: f64| {
            // They gather at the faces.
            let from_face = |x: f64| (x - EDGE * (x / EDGE).round()).abs();
            let near = (0..4000).filter(|&particle| from_face(at(particle, time)[0]) < 2.0).count();
            near as f64 / 4000.0
        };
        assert!(spread(0.0) < 0.06 && spread(CROSSING) > 0.25, "{} {}", spread(0.0), spread(CROSSING));
        // Past the crossing, what began within the box lies beyond its faces.
        assert!((0..4000).any(|particle| at(particle, 1.0)[0] < 0.0));
        assert!((0..4000).any(|particle| at(particle, 1.0)[0] > EDGE));
        assert!((0..4000).all(|particle| at(particle, 1.0).iter().all(|x| (-EDGE..2.0 * EDGE).contains(x))));
    }
}
