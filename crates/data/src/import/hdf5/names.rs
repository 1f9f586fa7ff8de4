//! What data sets of simulation snapshots are called, and which quantity each is.

use crate::import::FieldKind;
use crate::model::FamilyName;

/// A quantity that several codes write, under whatever name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Quantity {
    /// The standard name.
    pub name: &'static str,
    /// What it is to the import.
    pub kind: FieldKind,
    /// Powers of mass, length and velocity that its unit has, for files whose data sets do not say; `None` where the unit
    /// is `fixed`.
    pub powers: Option<[f64; 3]>,
    /// The unit where it is the same for every code.
    pub fixed: &'static str,
}

const fn of(name: &'static str, kind: FieldKind, mass: f64, length: f64, velocity: f64) -> Quantity {
    Quantity { name, kind, powers: Some([mass, length, velocity]), fixed: "" }
}

const fn fixed(name: &'static str, unit: &'static str) -> Quantity {
    Quantity { name, kind: FieldKind::Other, powers: None, fixed: unit }
}

/// What places and velocities are called, in lower case; columns of three numbers of a table, too.
pub(in crate::import) const POSITIONS: [&str; 6] =
    ["coordinates", "positions", "position", "pos", "grouppos", "subhalopos"];
pub(in crate::import) const VELOCITIES: [&str; 5] = ["velocities", "velocity", "vel", "groupvel", "subhalovel"];

/// Data set names in lower case by quantity. Of several data sets of one kind in a group the one listed first counts.
const QUANTITIES: &[(Quantity, &[&str])] = &[
    (of("position", FieldKind::Position, 0.0, 1.0, 0.0), &POSITIONS),
    (of("velocity", FieldKind::Velocity, 0.0, 0.0, 1.0), &VELOCITIES),
    (
        of("mass", FieldKind::Mass, 1.0, 0.0, 0.0),
        &["masses", "mass", "dynamicalmasses", "dynamicalmass", "groupmass", "subhalomass"],
    ),
    (
        of("smoothing-length", FieldKind::SmoothingLength, 0.0, 1.0, 0.0),
        &["smoothinglength", "smoothinglengths", "hsml", "subfindhsml"],
    ),
    (
        of("density", FieldKind::Density, 1.0, -3.0, 0.0),
        &["density", "densities", "rho", "subfinddensity", "subfinddmdensity"],
    ),
    (of("id", FieldKind::Id, 0.0, 0.0, 0.0), &["particleids", "ids", "id"]),
    (of("internal-energy", FieldKind::Other, 0.0, 0.0, 2.0), &["internalenergy", "internalenergies", "u"]),
    (fixed("temperature", "K"), &["temperature", "temperatures", "temp"]),
    (of("pressure", FieldKind::Other, 1.0, -3.0, 2.0), &["pressure", "pressures"]),
    (
        of("velocity-dispersion", FieldKind::Other, 0.0, 0.0, 1.0),
        &["velocitydispersion", "velocitydispersions", "subfindveldisp", "veldisp", "subhaloveldisp"],
    ),
    (fixed("scale-factor", ""), &["ascale"]),
    (fixed("metallicity", ""), &["metallicity", "metallicities", "gfm_metallicity", "metalmassfractions"]),
    (of("potential", FieldKind::Other, 0.0, 0.0, 2.0), &["potential", "potentials"]),
    (of("acceleration", FieldKind::Other, 0.0, -1.0, 2.0), &["acceleration", "accelerations"]),
    (of("star-formation-rate", FieldKind::Other, 1.0, -1.0, 1.0), &["starformationrate", "starformationrates", "sfr"]),
];

/// The quantity that a data set of that name holds in a family, with its rank among the names of one kind (0 first).
///
/// Subfind's smoothing lengths and densities are those of the dark matter around a particle, so that they are neither
/// for other families.
pub(super) fn quantity(dataset: &str, family: FamilyName) -> Option<(Quantity, usize)> {
    let name = dataset.to_lowercase();
    let dark = matches!(family, FamilyName::Dark | FamilyName::Type2 | FamilyName::Type3);
    if name.starts_with("subfind") && name != "subfindveldisp" && !dark {
        return None;
    }
    QUANTITIES.iter().find_map(|(quantity, names)| {
        names.iter().position(|candidate| *candidate == name).map(|rank| (*quantity, rank))
    })
}

/// The quantity of a data set that holds its base-10 logarithm (`log10Density`).
pub(super) fn logarithm(dataset: &str, family: FamilyName) -> Option<Quantity> {
    let name = dataset.to_lowercase();
    let rest = name.strip_prefix("log10").map(|rest| rest.trim_start_matches('_'))?;
    quantity(rest, family).map(|(quantity, _)| quantity).filter(|quantity| quantity.kind != FieldKind::Id)
}
