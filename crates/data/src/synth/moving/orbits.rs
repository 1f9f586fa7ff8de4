//! Closed orbits: half of them ellipses around their middle, half Kepler's around a focus.

use super::{Moving, State, across, even, scaled, sum};
use crate::model::FamilyName;
use crate::synth::random::Random;

/// Steps in a period of the fastest particle.
const STEPS_AN_ORBIT: f64 = 16.0;

/// Particles on closed orbits around the origin, as gas.
#[derive(Clone, Copy, Debug)]
pub struct Orbits {
    seed: u64,
    particles: u64,
}

impl Orbits {
    /// So many particles; the first half is harmonic.
    pub fn new(seed: u64, particles: u64) -> Orbits {
        Orbits { seed, particles }
    }

    /// The smoothing length of all particles.
    pub fn smoothing_length(&self) -> f64 {
        0.02
    }
}

impl Moving for Orbits {
    fn len(&self) -> u64 {
        self.particles
    }

    fn times(&self, _steps: usize) -> (f64, f64) {
        (0.0, std::f64::consts::TAU / STEPS_AN_ORBIT)
    }

    fn at(&self, particle: u64, _step: usize, time: f64) -> Option<State> {
        let mut random = Random::new(self.seed, particle);
        let rate = 0.7 + 0.3 * random.uniform();
        let phase = std::f64::consts::TAU * random.uniform();
        let along = random.direction();
        let beside = across(along, &mut random);
        let mean_anomaly = rate * time + phase;
        let (a, b, eccentricity) = if particle < self.particles / 2 {
            let size = 0.5 + 0.5 * random.uniform();
            let width = size * (0.2 + 0.8 * random.uniform());
            (scaled(along, size), sum(scaled(beside, width), scaled(along, 0.3 * size)), 0.0)
        } else {
            // Kepler's third law, with a mass of 1 in the focus.
            let eccentricity = 0.9 * random.uniform();
            let size = libm::pow(rate, -2.0 / 3.0);
            let width = size * (1.0 - eccentricity * eccentricity).sqrt();
            (scaled(along, size), scaled(beside, width), eccentricity)
        };
        let anomaly = eccentric_anomaly(mean_anomaly, eccentricity);
        let (cos, sin) = (libm::cos(anomaly), libm::sin(anomaly));
        let speed = rate / (1.0 - eccentricity * cos);
        let position = sum(scaled(a, cos - eccentricity), scaled(b, sin));
        let velocity = scaled(sum(scaled(b, cos), scaled(a, -sin)), speed);
        Some(even(FamilyName::Gas, position, velocity, self.mass(), self.smoothing_length()))
    }

    fn mass(&self) -> f64 {
        1.0 / 1024.0
    }
}

/// The solution `E` of Kepler's equation `M = E - e sin E`.
fn eccentric_anomaly(mean: f64, eccentricity: f64) -> f64 {
    let turns = (mean / std::f64::consts::TAU).round();
    let mean = mean - std::f64::consts::TAU * turns;
    let mut anomaly = mean + 0.85 * eccentricity * mean.signum();
    // Newton's iteration from there converges for all eccentricities.
    for _ in 0..20 {
        let off = anomaly - eccentricity * libm::sin(anomaly) - mean;
        anomaly -= off / (1.0 - eccentricity * libm::cos(anomaly));
    }
    anomaly
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energy_and_angular_momentum_stay() {
        let orbits = Orbits::new(5, 60);
        for particle in 30..60 {
            let of = |time: f64| {
                let State { position: x, velocity: v, .. } = orbits.at(particle, 0, time).unwrap();
                let square = |a: [f64; 3]| a.iter().map(|x| x * x).sum::<f64>();
                let momentum = [x[1] * v[2] - x[2] * v[1], x[2] * v[0] - x[0] * v[2], x[0] * v[1] - x[1] * v[0]];
                [0.5 * square(v) - square(x).sqrt().recip(), momentum[0], momentum[1], momentum[2]]
            };
            let first = of(0.0);
            for time in [0.3, 1.7, 6.0, 100.0] {
                let now = of(time);
                assert!(first.iter().zip(now).all(|(a, b)| (a - b).abs() < 1e-9), "{first:?} {now:?}");
            }
        }
    }

    #[test]
    fn keplers_equation_is_solved() {
        for eccentricity in [0.0, 0.3, 0.9] {
            for mean in [-7.0, -3.1, -1e-3, 0.0, 0.1, 2.0, 50.0] {
                let anomaly = eccentric_anomaly(mean, eccentricity);
                let turns = (mean / std::f64::consts::TAU).round() * std::f64::consts::TAU;
                assert!((anomaly - eccentricity * anomaly.sin() + turns - mean).abs() < 1e-12, "{eccentricity} {mean}");
            }
        }
    }
}
