//! What a snapshot says of itself, as attributes: the groups `Header`, `Parameters` and `Units`, and units and powers of `a` and `h` of
//! data sets as Gadget-4 and AREPO state them (Springel et al. 2021, `a_scaling`, `h_scaling`, `to_cgs`, ...).

use super::super::hdf5::{Attributes, Group, Value};
use super::super::stated::Stated;
use super::TYPES;
use super::units::Powers;
use crate::model::{Motion, Unit, redshift_of};

/// 100 km/s/Mpc in 1/s.
const HUBBLE_PER_SECOND: f64 = 1e7 / 3.085_677_581_491_367e24;

/// The groups beside those of particles; `quantities`: names and units of what the particles have.
pub(super) fn groups(counts: [u64; TYPES], stated: &Stated, quantities: &[(&str, &Unit)]) -> Vec<Group> {
    let unit = |name: &str| quantities.iter().find(|(other, _)| *other == name).and_then(|(_, unit)| Powers::of(unit));
    let length = unit("position").filter(|unit| unit.is(0.0, 1.0, 0.0));
    let mass = unit("mass").filter(|unit| unit.is(1.0, 0.0, 0.0));
    let velocity = unit("velocity").filter(|unit| unit.is(0.0, 1.0, -1.0));

    let mut header: Attributes = vec![
        ("NumPart_ThisFile", Value::Counts(counts.to_vec())),
        ("NumPart_Total", Value::Counts(counts.to_vec())),
        ("NumFilesPerSnapshot", Value::Flag(1)),
        // Every particle has its own.
        ("MassTable", Value::Numbers(vec![0.0; TYPES])),
        ("Flag_DoublePrecision", Value::Flag(1)),
    ];
    let mut parameters: Attributes = vec![("ComovingIntegrationOn", Value::Flag(i32::from(stated.is_comoving)))];
    let number = |name: &'static str, value: f64| (name, Value::Numbers(vec![value]));
    header.extend(stated.time.map(|time| number("Time", time)));
    let redshift = stated.redshift.or_else(|| stated.time.filter(|_| stated.is_comoving).and_then(redshift_of));
    header.extend(redshift.map(|redshift| number("Redshift", redshift)));
    // Readers ask for it; 0 is none.
    header.push(number("BoxSize", stated.box_size.unwrap_or(0.0)));
    if let Some(cosmology) = stated.cosmology {
        header.push(number("Omega0", cosmology.omega_matter));
        header.push(number("OmegaLambda", cosmology.omega_lambda));
        // H0 is `h` to this power times 100 km/s/Mpc in the units of lengths and velocities.
        let power = 1.0 + length.map_or(0.0, |unit| unit.h) - velocity.map_or(0.0, |unit| unit.h);
        let hundred = length.zip(velocity).map(|(length, velocity)| HUBBLE_PER_SECOND * length.cgs / velocity.cgs);
        let h = hundred.filter(|_| power == 1.0).map(|hundred| cosmology.hubble / hundred);
        let h = h.filter(|h| *h > 0.0 && h.is_finite());
        header.extend(h.map(|h| number("HubbleParam", h)));
        parameters.extend(h.map(|h| number("HubbleParam", h)));
        if !cosmology.hubble_assumed {
            parameters.push(number("Hubble", cosmology.hubble / h.unwrap_or(1.0)));
        }
    }
    let mut units = Attributes::new();
    // A quantity without a unit would be in those of the system.
    let are_known = quantities.iter().all(|(name, unit)| !unit.is_unknown() || !follows_system(name));
    if let (Some(length), Some(mass), Some(velocity), true) = (length, mass, velocity, are_known) {
        units.push(number("UnitLength_in_cm", length.cgs));
        units.push(number("UnitMass_in_g", mass.cgs));
        units.push(number("UnitVelocity_in_cm_per_s", velocity.cgs));
    }
    parameters.extend(units.iter().cloned());
    let named = |name: &str, attributes| Group { name: name.to_owned(), attributes, datasets: Vec::new() };
    let mut groups = vec![named("Header", header), named("Parameters", parameters)];
    groups.extend((!units.is_empty()).then(|| named("Units", units)));
    groups
}

/// Whether readers take a quantity without a unit for one in the units of the snapshot.
fn follows_system(quantity: &str) -> bool {
    !matches!(quantity, "temperature" | "metallicity") && super::NAMES.iter().any(|(name, _)| *name == quantity)
}

/// The attributes of a data set.
pub(super) fn of_dataset(quantity: &str, unit: &Unit, stated: &Stated) -> Attributes {
    let mut attributes = Attributes::new();
    let number = |name: &'static str, value: f64| (name, Value::Numbers(vec![value]));
    let powers = Powers::of(unit);
    // Readers refuse what is no length where they need one.
    let is_length = matches!(quantity, "position" | "smoothing-length");
    let is_known = powers.is_some_and(|powers| powers.is(0.0, 1.0, 0.0)) && !unit.0.contains(['^', '(']);
    if !unit.is_unknown() && (is_known || !is_length) {
        attributes.push(("unit", Value::Text(unit.0.clone())));
    }
    // What a velocity is says its power of `a`.
    let moves = match stated.motion {
        Motion::Gadget => Some(0.5),
        Motion::Peculiar => Some(0.0),
        Motion::Coordinate => Some(1.0),
        Motion::Unknown => None,
    };
    let moves = moves.filter(|_| quantity == "velocity" && stated.is_comoving);
    let a = moves.or(powers.map(|powers| powers.a));
    if let Some(a) = a {
        attributes.push(number("a_scaling", a));
        attributes.push(number("h_scaling", powers.map_or(0.0, |powers| powers.h)));
    }
    if let Some(powers) = powers {
        attributes.push(number("to_cgs", powers.cgs));
        if powers.temperature == 0.0 {
            // Time is length by velocity.
            attributes.push(number("length_scaling", powers.length + powers.time));
            attributes.push(number("mass_scaling", powers.mass));
            attributes.push(number("velocity_scaling", -powers.time));
        }
    }
    attributes
}
