//! Units of HDF5 snapshots, put together from what headers and data sets say about them. Values stay as they are: factors
//! of the scale factor `a` and of the Hubble parameter `h` become part of the unit's name.

use super::file::Attributes;
use super::names::Quantity;
use crate::import::units::{KNOWN_LENGTHS, Length, length};
use crate::import::{FieldKind, ImportError};
use crate::model::Unit;

/// Attributes that hold the unit of length in centimetres.
const LENGTHS: [&str; 3] = ["UnitLength_in_cm", "UnitLength_In_CGS", "Unit length in cgs (U_L)"];

/// The unit that a data set names in words, where it does so. For positions and smoothing lengths it must be a length.
///
/// # Errors
/// When a position or smoothing length has a unit that is not known.
pub(super) fn in_words(attributes: &Attributes, kind: FieldKind) -> Result<Option<Unit>, ImportError> {
    let Some((name, text)) = attributes.unit() else { return Ok(None) };
    let is_length = matches!(kind, FieldKind::Position | FieldKind::SmoothingLength);
    match length(&text) {
        None if is_length => Err(attributes.malformed(name, format!("{text:?}"), KNOWN_LENGTHS)),
        Some(Length::Code) if is_length => Ok(None),
        _ => Ok(Some(Unit::new(text.trim()))),
    }
}

/// Powers of the scale factor and of the Hubble parameter in a data set's unit, where its attributes state them (Gadget-4 and
/// AREPO; SWIFT; EAGLE).
pub(super) fn powers_of_a_and_h(attributes: &Attributes) -> Option<(f64, f64)> {
    let names = [
        ("a_scaling", "h_scaling"),
        ("a-scale exponent", "h-scale exponent"),
        ("aexp-scale-exponent", "h-scale-exponent"),
    ];
    names.into_iter().find_map(|(a, h)| Some((attributes.number(a)?, attributes.number(h).unwrap_or(0.0))))
}

/// The base units of a snapshot in cgs, as far as it says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct System {
    /// Gram.
    pub mass: Option<f64>,
    /// Centimetre.
    pub length: Option<f64>,
    /// Centimetre per second.
    pub velocity: Option<f64>,
    /// Second, where the velocity follows from it.
    pub time: Option<f64>,
    /// Power of `a` and `h` of a length where data sets do not say.
    pub comoving: (f64, f64),
}

impl System {
    /// Takes over what a group's attributes say and is not known yet.
    ///
    /// # Errors
    /// When the unit of length is no positive number; other units are labels, which stay unknown then.
    pub(super) fn learn(&mut self, attributes: &Attributes) -> Result<(), ImportError> {
        let usable = |unit: &f64| *unit > 0.0 && unit.is_finite();
        let first = |names: &[&str]| names.iter().find_map(|name| attributes.number(name)).filter(usable);
        for name in LENGTHS.into_iter().filter(|name| attributes.has(name)) {
            let number = attributes.number(name);
            if !number.as_ref().is_some_and(usable) {
                let found =
                    number.map(|number| number.to_string()).or_else(|| attributes.text(name).map(|t| format!("{t:?}")));
                let found = found.unwrap_or_else(|| "something else".into());
                return Err(attributes.malformed(name, found, "a positive number of centimetres"));
            }
        }
        self.mass = self.mass.or_else(|| first(&["UnitMass_in_g", "UnitMass_In_CGS", "Unit mass in cgs (U_M)"]));
        self.length = self.length.or_else(|| first(&LENGTHS));
        let velocity = first(&["UnitVelocity_in_cm_per_s", "UnitVelocity_In_CGS"]);
        self.time = self.time.or_else(|| first(&["Unit time in cgs (U_t)"]));
        self.velocity = self.velocity.or(velocity).or_else(|| Some(self.length? / self.time?));
        Ok(())
    }

    /// Forgets units of 1 cm, 1 g and 1 cm/s in a simulation that sets its own constant of gravity: its numbers have no
    /// dimension.
    pub(super) fn without_nominal(self) -> System {
        let ones = [self.mass, self.length, self.velocity].iter().all(|unit| *unit == Some(1.0));
        if ones { System { comoving: self.comoving, ..System::default() } } else { self }
    }

    /// The unit with the given powers of mass, length, velocity, temperature, `a` and `h`; unknown where a base unit that it
    /// needs is not known.
    fn unit(&self, powers: [f64; 3], kelvin: f64, a: f64, h: f64) -> Unit {
        let mut factors = Vec::new();
        let bases = [self.mass.map(mass_name), self.length.map(length_name), self.velocity_name()];
        for (base, power) in bases.into_iter().zip(powers) {
            match base {
                Some(base) if power != 0.0 => factors.push((base, power)),
                None if power != 0.0 => return Unit::default(),
                _ => {}
            }
        }
        factors.extend((kelvin != 0.0).then(|| ("K".to_string(), kelvin)));
        factors.insert(0, ("a".into(), a));
        factors.push(("h".into(), h));
        let numerator: Vec<String> =
            factors.iter().filter(|(_, power)| *power > 0.0).map(|(name, power)| factor(name, *power)).collect();
        let mut text = if numerator.is_empty() { "1".to_string() } else { numerator.join(" ") };
        for (name, power) in factors.iter().filter(|(_, power)| *power < 0.0) {
            text.push('/');
            text.push_str(&factor(name, -power));
        }
        Unit::new(if text == "1" { "" } else { &text })
    }

    /// `km/s`, or length by time for velocities that have no name of their own.
    fn velocity_name(&self) -> Option<String> {
        let value = self.velocity?;
        let named = [(1.0, "cm/s"), (100.0, "m/s"), (1e5, "km/s")].into_iter().find(|(unit, _)| close(value, *unit));
        let by_time = || Some(format!("{}/{}", length_name(self.length?), time_name(self.time?)));
        named.map(|(_, name)| name.to_string()).or_else(by_time).or_else(|| Some(format!("{value:e} cm/s")))
    }

    /// The unit of a data set: what its own attributes say (Gadget-4, AREPO, SWIFT, EAGLE), else what the quantity is
    /// in the snapshot's system.
    pub(super) fn unit_of(&self, attributes: &Attributes, quantity: Option<Quantity>) -> Unit {
        let number = |name: &str| attributes.number(name);
        if let (Some(length), Some(mass), Some(velocity)) =
            (number("length_scaling"), number("mass_scaling"), number("velocity_scaling"))
        {
            let (a, h) = (number("a_scaling").unwrap_or(0.0), number("h_scaling").unwrap_or(0.0));
            return self.unit([mass, length, velocity], 0.0, a, h);
        }
        if let (Some(mass), Some(length), Some(time)) =
            (number("U_M exponent"), number("U_L exponent"), number("U_t exponent"))
        {
            let (a, h) = (number("a-scale exponent").unwrap_or(0.0), number("h-scale exponent").unwrap_or(0.0));
            let kelvin = number("U_T exponent").unwrap_or(0.0);
            return self.unit([mass, length + time, -time], kelvin, a, h);
        }
        let Some(quantity) = quantity else { return Unit::default() };
        let Some(powers) = quantity.powers else { return Unit::new(quantity.fixed) };
        let (a, h) = match (number("aexp-scale-exponent"), number("h-scale-exponent")) {
            (Some(a), Some(h)) => (a, h),
            // Lengths and masses carry 1/h, lengths a; peculiar velocities are written as sqrt(a) times the velocity.
            _ => {
                let (a, h) = self.comoving;
                let root = if quantity.name == "velocity" { 0.5 * a } else { 0.0 };
                (a * powers[1] + root, h * (powers[0] + powers[1]))
            }
        };
        self.unit(powers, 0.0, a, h)
    }
}

fn factor(name: &str, power: f64) -> String {
    match power {
        1.0 => name.to_string(),
        _ if name.contains(['/', ' ']) => format!("({name})^{power}"),
        _ => format!("{name}^{power}"),
    }
}

fn close(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 5e-3
}

/// `1e10` for 10, nothing for 0.
fn decade(value: f64, unit: f64, name: &str) -> Option<String> {
    let exponent = (value / unit).log10().round();
    let matches = exponent.abs() <= 15.0 && close(value, unit * 10f64.powf(exponent));
    matches.then(|| if exponent == 0.0 { name.to_string() } else { format!("1e{exponent} {name}") })
}

/// The name of a unit of length.
pub(in crate::import) fn length_name(cm: f64) -> String {
    let named = [(1.0, "cm"), (100.0, "m"), (1e5, "km"), (6.957e10, "Rsun"), (1.495_978_7e13, "au")];
    let parsecs = [(3.085_678e18, "pc"), (3.085_678e21, "kpc"), (3.085_678e24, "Mpc"), (3.085_678e27, "Gpc")];
    let exact = named.iter().chain(&parsecs).find(|(unit, _)| close(cm, *unit));
    exact.map_or_else(|| format!("{cm:e} cm"), |(_, name)| name.to_string())
}

/// The name of a unit of mass.
pub(in crate::import) fn mass_name(gram: f64) -> String {
    let named = [(1.0, "g"), (1000.0, "kg")].into_iter().find(|(unit, _)| close(gram, *unit));
    let named = named.map(|(_, name)| name.to_string());
    named.or_else(|| decade(gram, 1.988_5e33, "Msun")).unwrap_or_else(|| format!("{gram:e} g"))
}

fn time_name(second: f64) -> String {
    let named = [(1.0, "s"), (3.155_76e7, "yr"), (3.155_76e13, "Myr"), (3.155_76e16, "Gyr")];
    let named = named.into_iter().find(|(unit, _)| close(second, *unit));
    named.map_or_else(|| format!("({second:e} s)"), |(_, name)| name.to_string())
}
