//! What time is counted in between the snapshots of a run, and what stored velocities are in that count.
//!
//! A track needs tangents `dx/dtau` in the unit of positions by the unit of the clock `tau`. For comoving positions `x` and
//! scale factor `a`, with `H(a)` of [`Cosmology::hubble_rate`] and `v_pec = a dx/dt`:
//!
//! | stored | `dx/dt` | `dx/da` | `dx/d(ln a)` |
//! |---|---|---|---|
//! | [`Motion::Coordinate`], `v` | `v` | `v / (a H)` | `v / H` |
//! | [`Motion::Peculiar`], `v_pec` | `v / a` | `v / (a^2 H)` | `v / (a H)` |
//! | [`Motion::Gadget`], `u = v_pec / sqrt(a)` | `u a^(-1/2)` | `u a^(-3/2) / H` | `u a^(-1/2) / H` |

use super::Cosmology;
use serde::{Deserialize, Serialize};

/// What stored velocities mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// The source does not say.
    #[default]
    Unknown,
    /// Coordinate velocity: the rate `dx/dt` of stored positions. What does not expand has these.
    Coordinate,
    /// Peculiar velocity `a dx/dt` of comoving positions, as SWIFT writes it.
    Peculiar,
    /// Peculiar velocity by `sqrt(a)`, as Gadget, AREPO, GIZMO and EAGLE write it.
    Gadget,
}

impl Motion {
    /// `dx/dt` by the stored velocity at scale factor `a`.
    fn coordinate_factor(self, a: f64) -> Option<f64> {
        match self {
            Motion::Unknown => None,
            Motion::Coordinate => Some(1.0),
            Motion::Peculiar => Some(1.0 / a),
            Motion::Gadget => Some(1.0 / a.sqrt()),
        }
    }
}

/// What a snapshot says about its own place in time and about its velocities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// The header's time: the scale factor in comoving snapshots of Gadget's family.
    pub time: Option<f64>,
    /// Scale factor of a comoving snapshot; `None` in what does not expand.
    pub scale_factor: Option<f64>,
    /// The universe around it, where the header says so.
    pub cosmology: Option<Cosmology>,
    /// What stored velocities mean.
    pub motion: Motion,
}

impl Epoch {
    /// Whether positions are comoving.
    pub fn is_comoving(&self) -> bool {
        self.scale_factor.is_some() || matches!(self.motion, Motion::Peculiar | Motion::Gadget)
    }
}

/// What time is counted in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockVariable {
    /// Time: the header's; of comoving snapshots that since the beginning, [`Cosmology::age`].
    #[default]
    Time,
    /// The scale factor `a`.
    ScaleFactor,
    /// The scale factor's natural logarithm.
    LogScaleFactor,
}

impl ClockVariable {
    /// Every clock.
    pub const ALL: [ClockVariable; 3] =
        [ClockVariable::Time, ClockVariable::ScaleFactor, ClockVariable::LogScaleFactor];

    /// Its word on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            ClockVariable::Time => "time",
            ClockVariable::ScaleFactor => "scale-factor",
            ClockVariable::LogScaleFactor => "log-scale-factor",
        }
    }

    /// The clock of a run like this snapshot, where nobody chooses one: the scale factor of comoving data, else time.
    pub fn of(epoch: &Epoch) -> ClockVariable {
        if epoch.is_comoving() { ClockVariable::ScaleFactor } else { ClockVariable::Time }
    }

    /// The clock's value `tau` at a snapshot: in the header's unit of time, in scale factors, or (time of comoving data) in the
    /// unit of lengths by that of velocities. `None` where the header does not say enough.
    pub fn value(self, epoch: &Epoch) -> Option<f64> {
        let value = match (self, epoch.scale_factor) {
            (ClockVariable::Time, Some(a)) => epoch.cosmology?.age(a),
            (ClockVariable::Time, None) => epoch.time.filter(|_| !epoch.is_comoving()),
            (ClockVariable::ScaleFactor, a) => a.filter(|a| *a > 0.0),
            // As elsewhere in files, the same bits on every machine.
            (ClockVariable::LogScaleFactor, a) => a.filter(|a| *a > 0.0).map(libm::log),
        };
        value.filter(|value| value.is_finite())
    }

    /// What a stored velocity is multiplied with to give `dx/dtau` (the table at the top of this file). `None` where the header
    /// does not say enough. Velocities of [`Motion::Unknown`] are taken for `dx/dt` where nothing says that space expands: whether
    /// displacements bear that out has to be measured.
    pub fn velocity_factor(self, epoch: &Epoch) -> Option<f64> {
        let factor = match (self, epoch.scale_factor) {
            (ClockVariable::Time, None) => (!epoch.is_comoving()).then_some(1.0),
            (_, None) => None,
            (ClockVariable::Time, Some(a)) => epoch.motion.coordinate_factor(a),
            (ClockVariable::ScaleFactor, Some(a)) => {
                Some(epoch.motion.coordinate_factor(a)? / (a * epoch.cosmology?.hubble_rate(a)?))
            }
            (ClockVariable::LogScaleFactor, Some(a)) => {
                Some(epoch.motion.coordinate_factor(a)? / epoch.cosmology?.hubble_rate(a)?)
            }
        };
        factor.filter(|factor| *factor > 0.0 && factor.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIVERSE: Cosmology = Cosmology { omega_matter: 0.3, omega_lambda: 0.6, hubble: 70.0, hubble_assumed: false };

    fn comoving(a: f64, motion: Motion) -> Epoch {
        Epoch { time: Some(a), scale_factor: Some(a), cosmology: Some(UNIVERSE), motion }
    }

    fn close(found: f64, expected: f64, relative: f64) {
        assert!((found / expected - 1.0).abs() < relative, "{found} {expected}");
    }

    #[test]
    fn names_in_files() {
        let names = ClockVariable::ALL.map(|clock| serde_json::to_string(&clock).unwrap());
        assert_eq!(names, [r#""time""#, r#""scale-factor""#, r#""log-scale-factor""#]);
        assert_eq!(names, ClockVariable::ALL.map(|clock| format!("{:?}", clock.name())));
    }

    #[test]
    fn what_does_not_expand_moves_as_stored() {
        for motion in [Motion::Coordinate, Motion::Unknown] {
            let epoch = Epoch { time: Some(2.5), motion, ..Epoch::default() };
            assert_eq!(ClockVariable::of(&epoch), ClockVariable::Time);
            assert_eq!(ClockVariable::Time.value(&epoch), Some(2.5));
            assert_eq!(ClockVariable::Time.velocity_factor(&epoch), Some(1.0));
            for clock in [ClockVariable::ScaleFactor, ClockVariable::LogScaleFactor] {
                assert_eq!((clock.value(&epoch), clock.velocity_factor(&epoch)), (None, None));
            }
        }
    }

    #[test]
    fn factors_are_those_of_the_table() {
        let (a, h) = (0.25, UNIVERSE.hubble_rate(0.25).unwrap());
        close(h, 70.0 * (0.3f64 * 64.0 + 0.1 * 16.0 + 0.6).sqrt(), 1e-15);
        let cases = [
            (Motion::Coordinate, [1.0, 1.0 / (a * h), 1.0 / h]),
            (Motion::Peculiar, [1.0 / a, 1.0 / (a * a * h), 1.0 / (a * h)]),
            (Motion::Gadget, [a.powf(-0.5), a.powf(-1.5) / h, a.powf(-0.5) / h]),
        ];
        for (motion, factors) in cases {
            let epoch = comoving(a, motion);
            assert_eq!(ClockVariable::of(&epoch), ClockVariable::ScaleFactor);
            for (clock, expected) in ClockVariable::ALL.into_iter().zip(factors) {
                close(clock.velocity_factor(&epoch).unwrap(), expected, 1e-14);
            }
        }
        assert!(ClockVariable::ALL.iter().all(|clock| clock.velocity_factor(&comoving(a, Motion::Unknown)).is_none()));
    }

    #[test]
    fn every_clock_sees_the_same_displacement() {
        // Velocities that are constant in one clock displace as much in each over a short interval.
        for motion in [Motion::Coordinate, Motion::Peculiar, Motion::Gadget] {
            let [before, at, after] = [0.4 - 1e-4, 0.4, 0.4 + 1e-4].map(|a| comoving(a, motion));
            let displacement = ClockVariable::ALL.map(|clock| {
                let step = clock.value(&after).unwrap() - clock.value(&before).unwrap();
                clock.velocity_factor(&at).unwrap() * step
            });
            close(displacement[1], displacement[0], 1e-6);
            close(displacement[2], displacement[0], 1e-6);
        }
    }

    #[test]
    fn a_growing_mode_moves_as_its_scale_factor() {
        // Einstein and de Sitter: x = q + a s, so that u = sqrt(a) dx/dt = a^1.5 H s = H0 s at every time.
        let universe = Cosmology { omega_matter: 1.0, omega_lambda: 0.0, hubble: 100.0, hubble_assumed: true };
        for a in [0.02, 0.1, 0.7, 1.0] {
            let epoch = Epoch { cosmology: Some(universe), ..comoving(a, Motion::Gadget) };
            close(ClockVariable::ScaleFactor.velocity_factor(&epoch).unwrap() * 100.0, 1.0, 1e-14);
        }
    }

    #[test]
    fn headers_that_do_not_say_enough_have_no_clock() {
        let without = Epoch { cosmology: None, ..comoving(0.5, Motion::Gadget) };
        assert_eq!(ClockVariable::ScaleFactor.value(&without), Some(0.5));
        assert_eq!(ClockVariable::Time.value(&without), None);
        assert_eq!(ClockVariable::ScaleFactor.velocity_factor(&without), None);
        // Comoving, but nobody knows at which scale factor.
        let lost = Epoch { scale_factor: None, ..comoving(0.5, Motion::Gadget) };
        for clock in ClockVariable::ALL {
            assert_eq!((clock.value(&lost), clock.velocity_factor(&lost)), (None, None));
        }
        for a in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
            for clock in ClockVariable::ALL {
                let epoch = comoving(a, Motion::Gadget);
                assert_eq!((clock.value(&epoch), clock.velocity_factor(&epoch)), (None, None), "{a}");
            }
        }
        assert_eq!(ClockVariable::Time.value(&Epoch { time: Some(f64::NAN), ..Epoch::default() }), None);
    }
}
