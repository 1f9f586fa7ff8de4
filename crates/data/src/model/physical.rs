//! Comoving numbers in the physical frame.

use super::{ClockVariable, Epoch, Motion};

/// What numbers of comoving data are multiplied with at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicalFactors {
    /// Positions and other lengths: the scale factor.
    pub length: f64,
    /// Velocities, to be peculiar ones, `a dx/dt`.
    pub velocity: f64,
}

impl PhysicalFactors {
    /// Of a snapshot, with velocities as it has them. `None` where its header does not say enough.
    pub fn of(epoch: &Epoch) -> Option<PhysicalFactors> {
        PhysicalFactors::at(epoch, |epoch| ClockVariable::Time.velocity_factor(epoch))
    }

    /// Of tracks at a step, with velocities `dx/dtau` by their clock: peculiar velocities are in the snapshots' unit of velocities. `None` where
    /// its header does not say enough.
    pub fn of_tracks(epoch: &Epoch, clock: ClockVariable) -> Option<PhysicalFactors> {
        let epoch = Epoch { motion: Motion::Coordinate, ..*epoch };
        PhysicalFactors::at(&epoch, |epoch| Some(1.0 / clock.velocity_factor(epoch)?))
    }

    /// `rate`: what velocities are multiplied with to be `dx/dt`.
    fn at(epoch: &Epoch, rate: impl Fn(&Epoch) -> Option<f64>) -> Option<PhysicalFactors> {
        if !epoch.is_comoving() {
            return Some(PhysicalFactors { length: 1.0, velocity: 1.0 });
        }
        let length = epoch.scale_factor.filter(|a| *a > 0.0 && a.is_finite())?;
        let velocity = length * rate(epoch)?;
        velocity.is_finite().then_some(PhysicalFactors { length, velocity })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Cosmology;

    #[test]
    fn velocities_are_peculiar_whatever_they_are_stored_as() {
        let cosmology = Cosmology { omega_matter: 0.3, omega_lambda: 0.7, hubble: 100.0, hubble_assumed: false };
        let a = 0.25;
        let epoch = |motion| Epoch { time: Some(a), scale_factor: Some(a), cosmology: Some(cosmology), motion };
        for (motion, velocity) in [(Motion::Gadget, 0.5), (Motion::Peculiar, 1.0), (Motion::Coordinate, a)] {
            let factors = PhysicalFactors::of(&epoch(motion)).unwrap();
            assert_eq!(factors, PhysicalFactors { length: a, velocity });
            // A stored velocity as a tangent by any clock comes to the same.
            for clock in ClockVariable::ALL {
                let tangent = clock.velocity_factor(&epoch(motion)).unwrap();
                let back = PhysicalFactors::of_tracks(&epoch(motion), clock).unwrap().velocity * tangent;
                assert!((back / velocity - 1.0).abs() < 1e-14, "{motion:?} {clock:?}: {back}");
            }
        }
        assert_eq!(PhysicalFactors::of(&epoch(Motion::Unknown)), None);
        let still = Epoch { time: Some(3.0), ..Epoch::default() };
        assert_eq!(PhysicalFactors::of(&still).map(|factors| (factors.length, factors.velocity)), Some((1.0, 1.0)));
    }
}
