//! Whether and how space expands in an HDF5 snapshot, and what its velocities are, whichever code wrote it.
//!
//! Positions are comoving where `ComovingIntegrationOn` (Gadget-4, AREPO, GIZMO) or `Cosmological run` (SWIFT) says so, or
//! there is an `ExpansionFactor` (EAGLE); without any of these (Gadget-2), where there is matter and the time is the scale
//! factor of the redshift.

use super::file::Attributes;
use super::header::Header;
use crate::import::Description;
use crate::import::expansion::{HUBBLE, Stated, cosmology, is_scale_factor};
use crate::model::Motion;
use crate::model::cosmology::scale_factor_of;

/// 100 km/s/Mpc in 1/s.
const HUBBLE_PER_SECOND: f64 = 1e7 / 3.085_677_581_491_367e24;

/// Names of the density of matter (Gadget and its kin; GIZMO since 2020; SWIFT).
const MATTER: [&str; 3] = ["Omega0", "Omega_Matter", "Omega_m"];
/// Names of the density of the cosmological constant, likewise.
const LAMBDA: [&str; 3] = ["OmegaLambda", "Omega_Lambda", "Omega_lambda"];

/// What the groups of a header say of the expansion.
pub(super) struct Expansion {
    /// Gadget-4, AREPO, GIZMO: whether the equations are the comoving ones.
    comoving_integration: Option<bool>,
    /// The same of SWIFT.
    cosmological_run: Option<bool>,
    /// The scale factor under a name of its own (SWIFT, EAGLE); elsewhere it is the time.
    scale_factor: Option<Stated>,
    omega_matter: Option<Stated>,
    omega_lambda: Option<Stated>,
    /// Hubble's constant in inverse units of time: Gadget's without the factor `h`, SWIFT's with it.
    hubble: Option<Stated>,
    /// What makes of it one of the snapshot's units: SWIFT may compute in others.
    hubble_factor: f64,
    /// `h`.
    hubble_parameter: Option<Stated>,
}

impl Expansion {
    /// From the groups `Header`, `Parameters` and `Cosmology`, and from those of the units of the snapshot and of the code.
    pub(super) fn read(groups: [Option<&Attributes>; 3], units: [Option<&Attributes>; 2]) -> Expansion {
        let stated = |names: &[&'static str]| {
            let mut found = groups.into_iter().flatten().flat_map(|group| names.iter().map(move |name| (group, *name)));
            found.find_map(|(group, name)| Some(Stated { name, value: group.number(name)? }))
        };
        let is_on = |name| stated(&[name]).map(|on| on.value != 0.0);
        let [time, code_time] = units.map(|group| group?.number("Unit time in cgs (U_t)"));
        let ratio = time.zip(code_time).map(|(time, code_time)| time / code_time);
        Expansion {
            comoving_integration: is_on("ComovingIntegrationOn"),
            cosmological_run: is_on("Cosmological run"),
            scale_factor: stated(&["Scale-factor", "ExpansionFactor"]),
            omega_matter: stated(&MATTER),
            omega_lambda: stated(&LAMBDA),
            hubble: stated(&["Hubble", "H0 [internal units]"]),
            hubble_factor: ratio.filter(|ratio| *ratio > 0.0 && ratio.is_finite()).unwrap_or(1.0),
            hubble_parameter: stated(&["HubbleParam", "h"]),
        }
    }

    /// Adds to the description scale factor, cosmology and what velocities are. `position` and `velocity` are the powers of
    /// `a` and `h` that their data sets state.
    pub(super) fn describe(
        &self,
        header: &Header,
        position: Option<(f64, f64)>,
        velocity: Option<(f64, f64)>,
        description: &mut Description,
    ) {
        if header.is_light_cone {
            let note = "a light cone: comoving positions, each at its own scale factor, that of stored velocities too";
            description.notes.push(note.into());
            return;
        }
        // Bare files and group catalogues follow no code's convention.
        let convention = |motion| if header.counts.is_some() { motion } else { Motion::Unknown };
        if !self.is_comoving(header, position) {
            description.motion = convention(Motion::Coordinate);
            return;
        }
        description.motion = match velocity {
            // Writers of states for SWIFT label them with a power that they do not have.
            _ if header.swift => Motion::Peculiar,
            // The peculiar velocity is the stored one times this power of `a`.
            Some((0.0, _)) => Motion::Peculiar,
            Some((0.5, _)) => Motion::Gadget,
            Some((1.0, _)) => Motion::Coordinate,
            Some(_) => Motion::Unknown,
            None => convention(Motion::Gadget),
        };
        let notes = &mut description.notes;
        description.scale_factor = self.scale_factor_of(header, notes);
        // Nobody asks for Hubble's constant without densities.
        if let (Some(_), Some(_)) = (self.omega_matter, self.omega_lambda) {
            let (hubble, assumed) = self.hubble(header, position, velocity, notes);
            description.cosmology = cosmology(self.omega_matter, self.omega_lambda, hubble, assumed, notes);
        }
    }

    fn is_comoving(&self, header: &Header, position: Option<(f64, f64)>) -> bool {
        if header.swift {
            let stated = self.scale_factor.is_some_and(|a| a.value != 1.0);
            return self.cosmological_run.unwrap_or(stated);
        }
        if let Some(on) = self.comoving_integration {
            return on;
        }
        let labelled = position.is_some_and(|(a, _)| a == 1.0);
        let expands = match self.omega_matter.map(|omega| omega.value) {
            Some(omega) if omega >= 0.0 => omega > 0.0,
            _ => labelled,
        };
        let times = header.time.zip(header.redshift);
        self.scale_factor.is_some() || (expands && times.is_some_and(|(time, z)| is_scale_factor(time, z)))
    }

    /// The scale factor of a comoving snapshot: under its own name, else as the time, which SWIFT counts otherwise, else from the
    /// redshift.
    fn scale_factor_of(&self, header: &Header, notes: &mut Vec<String>) -> Option<f64> {
        let time = header.time.filter(|_| !header.swift).map(|value| Stated { name: "Time", value });
        let stated = [self.scale_factor, time].into_iter().flatten().find_map(|stated| stated.usable(false, notes));
        stated.or_else(|| scale_factor_of(header.redshift?))
    }

    /// Hubble's constant in the units of stored velocities and lengths (`Cosmology::hubble`), and whether nothing says those units.
    ///
    /// With lengths in `L h^p` and velocities in `V h^q` it is `h^(1+p-q)` times 100 km/s/Mpc in `V/L`.
    fn hubble(
        &self,
        header: &Header,
        position: Option<(f64, f64)>,
        velocity: Option<(f64, f64)>,
        notes: &mut Vec<String>,
    ) -> (f64, bool) {
        // Gadget-4 writes 0 where it does not use it.
        let stated = self.hubble.filter(|hubble| hubble.value != 0.0).and_then(|hubble| hubble.usable(false, notes));
        if let Some(hubble) = stated.filter(|_| header.swift) {
            return (hubble * self.hubble_factor, false);
        }
        let units = header.units.length.zip(header.units.velocity);
        let known = stated.or_else(|| units.map(|(length, velocity)| HUBBLE_PER_SECOND * length / velocity));
        let length_power = position.map_or(header.units.comoving.1, |(_, h)| h);
        let power = 1.0 + length_power - velocity.map_or(0.0, |(_, h)| h);
        let h = self.hubble_parameter.filter(|_| power != 0.0).and_then(|h| h.usable(false, notes));
        (known.unwrap_or(HUBBLE) * h.map_or(1.0, |h| libm::pow(h, power)), known.is_none())
    }
}
