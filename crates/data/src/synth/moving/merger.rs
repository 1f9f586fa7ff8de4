//! Two stars that move around each other in a disk, and what leaves them: the merger of one snapshot, set in motion.

use super::{Moving, State, scaled, sum};
use crate::model::FamilyName;
use crate::synth::Generator;
use crate::synth::merger::{self, Drawn, Part, disk_rate, orbital_rate};
use crate::synth::random::Random;

/// Steps in the shortest period, which is that of the middle of the disk.
const STEPS_AN_ORBIT: f64 = 16.0;

/// Gas of two white dwarfs, as [`merger::Merger`] places it at time 0. Times are in Mm/(km/s), 1000 seconds.
pub struct Merger {
    seed: u64,
    still: merger::Merger,
}

impl Merger {
    /// So many particles.
    pub fn new(seed: u64, particles: u64) -> Merger {
        Merger { seed, still: merger::Merger::new(seed, particles) }
    }
}

impl Moving for Merger {
    fn len(&self) -> u64 {
        self.still.len()
    }

    fn times(&self, _steps: usize) -> (f64, f64) {
        (0.0, std::f64::consts::TAU / disk_rate(0.0) / STEPS_AN_ORBIT)
    }

    fn at(&self, particle: u64, _step: usize, time: f64) -> Option<State> {
        let Drawn { part, place, velocity, density, smoothing_length, .. } =
            self.still.draw(&mut Random::new(self.seed, particle));
        let rate = match part {
            Part::Core => orbital_rate(),
            Part::Disk => disk_rate(libm::hypot(place[0], place[1])),
            Part::Ejecta => {
                // What leaves the middle grows as its distance does.
                let square = place.iter().map(|x| x * x).sum::<f64>().max(1.0);
                let leaving = (0..3).map(|axis| place[axis] * velocity[axis]).sum::<f64>() / square;
                let growth = (1.0 + leaving * time).max(0.1);
                return Some(State {
                    family: FamilyName::Gas,
                    position: sum(place, scaled(velocity, time)),
                    velocity,
                    density: density / (growth * growth * growth),
                    smoothing_length: smoothing_length * growth,
                });
            }
        };
        let (sin, cos) = libm::sincos(rate * time);
        let [x, y, z] = place;
        let position = [x * cos - y * sin, x * sin + y * cos, z];
        let velocity = [-rate * position[1], rate * position[0], 0.0];
        Some(State { family: FamilyName::Gas, position, velocity, density, smoothing_length })
    }

    fn mass(&self) -> f64 {
        self.still.particle_mass()
    }
}
