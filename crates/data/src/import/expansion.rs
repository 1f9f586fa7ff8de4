//! What headers of comoving snapshots say of the universe's expansion, held against what it can be. What cannot be is left
//! out with a note: particles are where they are without it.

use crate::model::Cosmology;
use crate::model::cosmology::scale_factor_of;

/// Hubble's constant for lengths in Mpc/h and velocities in km/s.
pub(super) const HUBBLE: f64 = 100.0;

/// Whether a header's time is the scale factor that belongs to its redshift.
pub(super) fn is_scale_factor(time: f64, redshift: f64) -> bool {
    scale_factor_of(redshift).is_some_and(|a| (time / a - 1.0).abs() < 1e-6)
}

/// A number of a header: its name in notes, and its value, where it is there.
#[derive(Clone, Copy)]
pub(super) struct Stated {
    /// Its name with its group.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

impl Stated {
    /// The number if it is finite and above 0, or also at 0; else a note.
    pub(super) fn usable(self, zero: bool, notes: &mut Vec<String>) -> Option<f64> {
        let Stated { name, value } = self;
        if value.is_finite() && (value > 0.0 || (zero && value == 0.0)) {
            return Some(value);
        }
        let expected = if zero { "0 or a positive number" } else { "a positive number" };
        notes.push(format!("{name}: found {value}, expected {expected}: left out"));
        None
    }
}

/// The universe around a comoving snapshot, where its header states both densities and they can be.
pub(super) fn cosmology(
    omega_matter: Option<Stated>,
    omega_lambda: Option<Stated>,
    hubble: f64,
    hubble_assumed: bool,
    notes: &mut Vec<String>,
) -> Option<Cosmology> {
    let (omega_matter, omega_lambda) = (omega_matter?, omega_lambda?);
    let (omega_matter, omega_lambda) = (omega_matter.usable(false, notes), omega_lambda.usable(true, notes));
    Some(Cosmology { omega_matter: omega_matter?, omega_lambda: omega_lambda?, hubble, hubble_assumed })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_held_against_redshifts() {
        assert!(is_scale_factor(1.0, 0.0) && is_scale_factor(0.25, 3.0) && is_scale_factor(0.25 + 1e-8, 3.0));
        assert!(is_scale_factor(1.000_000_000_000_000_2, -2.220_446_049_250_313e-16));
        for (time, redshift) in [(0.0, 0.0), (0.25, 2.99), (1.0, -1.0), (f64::NAN, 0.0), (1.0, f64::NAN), (-1.0, -2.0)]
        {
            assert!(!is_scale_factor(time, redshift), "{time} {redshift}");
        }
        assert!(!is_scale_factor(f64::INFINITY, -1.0) && !is_scale_factor(0.0, f64::INFINITY));
    }

    #[test]
    fn what_cannot_be_is_left_out_with_a_note() {
        let of = |matter: f64, lambda: f64| {
            let mut notes = Vec::new();
            let stated = |name, value| Some(Stated { name, value });
            let found = cosmology(stated("Omega0", matter), stated("OmegaLambda", lambda), HUBBLE, true, &mut notes);
            (found.map(|found| (found.omega_matter, found.omega_lambda)), notes.len())
        };
        assert_eq!(of(0.3, 0.7), (Some((0.3, 0.7)), 0));
        assert_eq!(of(1.0, 0.0), (Some((1.0, 0.0)), 0));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.3] {
            assert_eq!(of(bad, 0.7), (None, 1), "{bad}");
            assert_eq!(of(0.3, bad), (None, 1), "{bad}");
            assert_eq!(of(bad, bad), (None, 2), "{bad}");
        }
        assert_eq!(of(0.0, 0.7), (None, 1));
    }
}
