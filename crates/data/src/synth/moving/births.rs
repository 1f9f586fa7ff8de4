//! Particles on straight lines, of which some are born, some vanish and some change from gas to stars at a step.

use super::{Moving, State, even, scaled, sum, wide_id};
use crate::model::FamilyName;
use crate::synth::random::Random;

/// How many ids at the end are those of the particles before them.
const REPEATED: u64 = 10;

/// What becomes of a particle, at a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is always there, as gas.
    Stays,
    /// It is there from this step on.
    Born(usize),
    /// It is there for the last time at this step.
    Vanishes(usize),
    /// It is gas before this step, and a star from it on.
    Changes(usize),
}

/// The particles, which are gas unless they change.
#[derive(Clone, Copy, Debug)]
pub struct Births {
    seed: u64,
    particles: u64,
    steps: usize,
}

impl Births {
    /// So many particles in a run of so many steps: a tenth is born, a tenth vanishes, a fifteenth changes.
    pub fn new(seed: u64, particles: u64, steps: usize) -> Births {
        Births { seed, particles, steps }
    }

    /// What becomes of a particle.
    pub fn fate(&self, particle: u64) -> Fate {
        let later = self.steps.saturating_sub(1) as u64;
        if later == 0 {
            return Fate::Stays;
        }
        let tenth = self.particles / 10;
        // Evenly over the steps: 1 to the last one, or 0 to the last but one.
        let step = particle % later;
        match particle {
            _ if particle < tenth => Fate::Born(step as usize + 1),
            _ if particle < 2 * tenth => Fate::Vanishes(step as usize),
            _ if particle < 2 * tenth + self.particles / 15 => Fate::Changes(step as usize + 1),
            _ => Fate::Stays,
        }
    }
}

impl Moving for Births {
    fn len(&self) -> u64 {
        self.particles
    }

    fn times(&self, _steps: usize) -> (f64, f64) {
        (0.0, 1.0)
    }

    fn at(&self, particle: u64, step: usize, time: f64) -> Option<State> {
        let family = match self.fate(particle) {
            Fate::Born(first) if step < first => return None,
            Fate::Vanishes(last) if step > last => return None,
            Fate::Changes(first) if step >= first => FamilyName::Stars,
            _ => FamilyName::Gas,
        };
        let mut random = Random::new(self.seed, particle);
        let start = [(); 3].map(|()| 10.0 * random.uniform());
        let velocity = [(); 3].map(|()| 0.1 * random.normal());
        Some(even(family, sum(start, scaled(velocity, time)), velocity, self.mass(), 0.2))
    }

    fn id(&self, particle: u64) -> u64 {
        let is_repeated = self.particles >= 2 * REPEATED && particle >= self.particles - REPEATED;
        wide_id(if is_repeated { particle - REPEATED } else { particle })
    }

    fn mass(&self) -> f64 {
        1.0 / 1024.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_are_born_and_vanish_as_is_said() {
        let births = Births::new(1, 3000, 5);
        let at = |step: usize, family: FamilyName| {
            let there = (0..3000).filter_map(|particle| births.at(particle, step, step as f64));
            there.filter(|state| state.family == family).count()
        };
        // 300 are born at the steps 1 to 4, 75 at each; 300 vanish after the steps 0 to 3; 200 change at the steps 1 to 4.
        for step in 0..5 {
            assert_eq!(at(step, FamilyName::Stars), 50 * step);
            assert_eq!(at(step, FamilyName::Gas) + 50 * step, 3000 - 300 + 75 * step - 75 * step, "{step}");
        }
        assert_eq!(births.id(2999), births.id(2989));
        assert_eq!(Births::new(1, 30, 1).fate(0), Fate::Stays);
    }
}
