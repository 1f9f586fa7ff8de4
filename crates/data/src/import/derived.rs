//! Which quantities are derived for a family, from which of its fields, and their values.
//!
//! Velocities are taken as they are stored, so that rates are in their unit by that of lengths, whatever powers of the scale factor
//! those have; the flow of the expanding universe is not in it. Only the Mach number brings velocity and speed of sound to one unit: it is
//! the peculiar velocity's, of an ideal gas.

use super::attributes::{Part, Planned, has_attribute};
use super::neighbours::{LocalMotion, Moving, Neighbours};
use super::{AttributeChoice, Description, FamilyInfo, FieldKind, ImportError, LoadOptions};
use crate::model::{Derivation, DerivedQuantity, Kernel, Motion, Progress, Unit};

/// Ratio of specific heats of a monatomic gas.
const GAMMA: f64 = 5.0 / 3.0;
/// Boltzmann's constant, J/K (exact).
const BOLTZMANN: f64 = 1.380_649e-23;
/// Mass of a proton, kg (CODATA 2018).
const PROTON: f64 = 1.672_621_923_69e-27;
/// Mean mass of the particles of a fully ionised gas with a quarter of helium by mass, in proton masses.
const MEAN_WEIGHT: f64 = 0.59;

/// What is derived for one family.
pub(super) struct DerivedPlan {
    /// Which quantities.
    pub derivation: Derivation,
    /// The columns it takes.
    pub inputs: Vec<Planned>,
    /// What is assumed, one sentence each.
    pub notes: Vec<String>,
}

/// Which of the quantities that are asked for a family gets; `None`: none.
///
/// # Errors
/// When the units of velocities and of what the speed of sound comes from cannot be compared.
pub(super) fn plan(
    about: &Description,
    info: &FamilyInfo,
    options: &LoadOptions,
) -> Result<Option<DerivedPlan>, ImportError> {
    let Some(velocity) = info.find(FieldKind::Velocity).filter(|field| info.fields[*field].components == 3) else {
        return Ok(None);
    };
    let is_asked = |quantity: DerivedQuantity| options.derive.contains(&quantity);
    let mut notes = Vec::new();
    let sound = match sound(about, info, velocity) {
        _ if !is_asked(DerivedQuantity::MachNumber) => None,
        // Of all what can be had.
        Err(error) if DerivedQuantity::are_all(&options.derive) => {
            notes.push(format!("{}: no mach-number: {error}", info.name));
            None
        }
        sound => sound?,
    };
    let unit = &info.fields[velocity].unit;
    let rate = match (unit.is_unknown(), about.length_unit.is_unknown()) {
        (true, true) => Unit::default(),
        _ => Unit::new(format!("({unit})/({})", about.length_unit)),
    };
    let mut quantities: Vec<(DerivedQuantity, Unit)> = Vec::new();
    for &quantity in &options.derive {
        let unit = match quantity {
            DerivedQuantity::VelocityDispersion => unit.clone(),
            DerivedQuantity::Divergence | DerivedQuantity::Vorticity => rate.clone(),
            DerivedQuantity::MachNumber => Unit::default(),
        };
        let is_known = quantity != DerivedQuantity::MachNumber || sound.is_some();
        if is_known && !quantities.iter().any(|(other, _)| *other == quantity) {
            quantities.push((quantity, unit));
        }
    }
    if quantities.is_empty() {
        return Ok(None);
    }
    let planned = |field: usize, component| Planned {
        name: info.fields[field].name.clone(),
        asked: info.fields[field].name.clone(),
        unit: info.fields[field].unit.clone(),
        field,
        part: Part::Component(component),
    };
    let mut inputs: Vec<Planned> = (0..Derivation::COMPONENTS).map(|component| planned(velocity, component)).collect();
    inputs.extend(sound.iter().map(|sound| planned(sound.field, 0)));
    let name = info.name;
    let near = quantities.iter().map(|(quantity, _)| *quantity).filter(|q| *q != DerivedQuantity::MachNumber);
    let near: Vec<&str> = near.map(DerivedQuantity::name).collect();
    if !near.is_empty() {
        notes.push(format!("{name}: {} from velocities within the smoothing length", near.join(", ")));
    }
    let mach_factor = sound.as_ref().map(|sound| sound.mach_factor);
    notes.extend(sound.map(|sound| format!("{name}: {}", sound.note)));
    let derivation = Derivation { quantities, mach_factor };
    Ok(Some(DerivedPlan { derivation, inputs, notes }))
}

/// Quantities among named attributes that a source lacks and its velocities give.
pub fn derivable(about: &Description, attributes: &AttributeChoice) -> Vec<DerivedQuantity> {
    let AttributeChoice::Named(names) = attributes else { return Vec::new() };
    if about.families.iter().all(|info| info.find(FieldKind::Velocity).is_none()) {
        return Vec::new();
    }
    let is_lacking = |quantity: &DerivedQuantity| {
        let name = quantity.name();
        names.iter().any(|other| other == name) && !has_attribute(about, name)
    };
    DerivedQuantity::ALL.into_iter().filter(is_lacking).collect()
}

/// Every quantity that is asked for is derived for one family at least; where all are asked for, notes of what is not, if something is.
///
/// # Errors
/// When not: the field that is missing.
pub(super) fn check<'a>(
    about: &Description,
    options: &LoadOptions,
    derivations: impl Iterator<Item = &'a Derivation> + Clone,
) -> Result<Vec<String>, ImportError> {
    let mut notes = Vec::new();
    let is_something = derivations.clone().next().is_some();
    for &quantity in &options.derive {
        if derivations.clone().any(|derivation| derivation.has(quantity)) {
            continue;
        }
        let name = quantity.name();
        let is_chosen = |info: &&FamilyInfo| options.families.is_empty() || options.families.contains(&info.name);
        let moving = about.families.iter().filter(is_chosen).any(|info| info.find(FieldKind::Velocity).is_some());
        let (field, expected) = if moving {
            ("internal-energy", format!("internal-energy or temperature beside velocities, as {name} is to be derived"))
        } else {
            ("velocity", format!("velocities, as {name} is to be derived"))
        };
        if is_something && DerivedQuantity::are_all(&options.derive) {
            notes.push(format!("no {name}: expected {expected}"));
            continue;
        }
        return Err(ImportError::missing(&about.path, field, expected));
    }
    Ok(notes)
}

/// Where the speed of sound comes from.
struct Sound {
    field: usize,
    /// As in [`Derivation::mach_factor`].
    mach_factor: f64,
    note: String,
}

/// Where the speed of sound comes from in a family with velocities in the field `velocity`; `None`: from nowhere.
fn sound(about: &Description, info: &FamilyInfo, velocity: usize) -> Result<Option<Sound>, ImportError> {
    let scalar = |name: &str| info.named(name).filter(|field| info.fields[*field].components == 1);
    let a = about.scale_factor.unwrap_or(1.0);
    let peculiar = match about.motion {
        Motion::Gadget => a.sqrt(),
        Motion::Coordinate => a,
        Motion::Peculiar | Motion::Unknown => 1.0,
    };
    let speed = info.fields[velocity].unit.without_scale_factor();
    let assumed = "from stored velocities and the speed of sound of an ideal gas, ratio of specific heats 5/3";
    if let Some(field) = scalar("internal-energy") {
        let unit = &info.fields[field].unit;
        let energy = unit.without_scale_factor();
        let squares = speed_squares(&energy, &speed).ok_or_else(|| {
            let expected = format!("({speed})^2, as velocities are in {speed}");
            ImportError::malformed(&about.path, "unit of internal-energy", energy.to_string(), expected)
        })?;
        let factor = GAMMA * (GAMMA - 1.0) * squares * a.powf(power_of_a(unit));
        let note = format!("mach-number {assumed}");
        return Ok(Some(Sound { field, mach_factor: peculiar / factor.sqrt(), note }));
    }
    let Some(field) = scalar("temperature") else { return Ok(None) };
    let unit = &info.fields[field].unit;
    if !(unit.is_unknown() || unit.0 == "K") {
        return Err(ImportError::malformed(&about.path, "unit of temperature", unit.to_string(), "K"));
    }
    let Some(metres) = metres_per_second(&speed.0) else {
        let expected = "cm/s, m/s or km/s, as the speed of sound comes from a temperature";
        return Err(ImportError::malformed(&about.path, "unit of velocity", speed.to_string(), expected));
    };
    let factor = GAMMA * BOLTZMANN / (MEAN_WEIGHT * PROTON) / (metres * metres);
    let note = format!("mach-number {assumed}, mean molecular weight {MEAN_WEIGHT}");
    Ok(Some(Sound { field, mach_factor: peculiar / factor.sqrt(), note }))
}

/// A unit of energy by mass in squares of a unit of speed, neither of which has powers of the scale factor; those that are unknown are of
/// one system.
fn speed_squares(energy: &Unit, speed: &Unit) -> Option<f64> {
    if energy.is_unknown() || speed.is_unknown() || energy.0 == format!("({speed})^2") {
        return Some(1.0);
    }
    let square =
        |text: &str| metres_per_second(text.strip_prefix('(')?.strip_suffix(")^2")?).map(|speed| speed * speed);
    let joules = match energy.0.as_str() {
        "erg/g" | "cm^2/s^2" => Some(1e-4),
        "J/kg" | "m^2/s^2" => Some(1.0),
        "km^2/s^2" => Some(1e6),
        other => square(other),
    };
    Some(joules? / metres_per_second(&speed.0)?.powi(2))
}

fn metres_per_second(unit: &str) -> Option<f64> {
    match unit {
        "cm/s" => Some(1e-2),
        "m/s" => Some(1.0),
        "km/s" => Some(1e3),
        _ => None,
    }
}

/// The power of the scale factor that stored values take to be what the rest of the unit says.
fn power_of_a(unit: &Unit) -> f64 {
    let power = |word: &str| -> f64 {
        match word.strip_prefix("a^") {
            _ if word == "a" => 1.0,
            Some(power) => power.parse().unwrap_or(0.0),
            None => 0.0,
        }
    };
    let mut parts = unit.0.split('/');
    let above: f64 = parts.next().unwrap_or_default().split(' ').map(power).sum();
    above - parts.map(power).sum::<f64>()
}

/// Velocities from the columns that a derivation takes.
pub(crate) fn velocities(inputs: &[Vec<f32>]) -> Vec<[f64; 3]> {
    let [x, y, z, ..] = inputs else { return Vec::new() };
    x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z].map(f64::from)).collect()
}

/// The quantities of the first `count` of several particles, with what their speed of sound comes from where Mach numbers are among them:
/// a column each. What cannot be known is NaN.
pub(crate) fn columns(
    derivation: &Derivation,
    kernel: Kernel,
    all: &Moving,
    (count, heat): (usize, Option<&[f32]>),
    progress: &dyn Progress,
) -> Vec<Vec<f32>> {
    let mut motions = Vec::new();
    if derivation.needs_neighbours()
        && let Some(tree) = Neighbours::of(all.positions, all.edge, progress)
    {
        let wanted: Vec<bool> = (0..all.positions.len()).map(|particle| particle < count).collect();
        motions = tree.local_motion(kernel, all, Some(&wanted), progress);
    }
    motions.resize(count, LocalMotion::UNKNOWN);
    let motion =
        |value: fn(&LocalMotion) -> f64| -> Vec<f32> { motions.iter().map(|motion| known(value(motion))).collect() };
    let mach = || -> Vec<f32> {
        let factor = derivation.mach_factor.unwrap_or(f64::NAN);
        let of = |(&[x, y, z], &heat): (&[f64; 3], &f32)| {
            let speed = (x * x + y * y + z * z).sqrt();
            known(speed * factor / f64::from(heat).sqrt())
        };
        all.velocities.iter().zip(heat.unwrap_or_default()).take(count).map(of).collect()
    };
    let column = |(quantity, _): &(DerivedQuantity, Unit)| match quantity {
        DerivedQuantity::VelocityDispersion => motion(|motion| motion.dispersion),
        DerivedQuantity::Divergence => motion(|motion| motion.divergence),
        DerivedQuantity::Vorticity => motion(|motion| motion.vorticity),
        DerivedQuantity::MachNumber => mach(),
    };
    derivation.quantities.iter().map(column).collect()
}

/// A number in single precision; NaN where it has none.
fn known(value: f64) -> f32 {
    let value = value as f32;
    if value.is_finite() { value } else { f32::NAN }
}
