//! Units as the source names them. Values keep the source's unit; nothing is converted silently.

use serde::{Deserialize, Serialize};

/// The unit of a field, as text in the source's own terms (`kpc/h`, `1e10 Msun/h`, `K`); empty when unknown.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Unit(pub String);

impl Unit {
    /// A unit by its name.
    pub fn new(name: impl Into<String>) -> Unit {
        Unit(name.into())
    }

    /// Whether the source says nothing about the unit.
    pub fn is_unknown(&self) -> bool {
        self.0.is_empty()
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.is_unknown() { "code units" } else { &self.0 })
    }
}

/// Lengths of known names, metres.
const LENGTHS: [(&str, f64); 9] = [
    ("cm", 1e-2),
    ("m", 1.0),
    ("km", 1e3),
    ("au", 1.495_978_707e11),
    ("ly", 9.460_730_472_580_8e15),
    ("pc", PARSEC),
    ("kpc", 1e3 * PARSEC),
    ("Mpc", 1e6 * PARSEC),
    ("Gpc", 1e9 * PARSEC),
];
const PARSEC: f64 = 3.085_677_581_491_367e16;

/// Masses of known names, kilogrammes.
const MASSES: [(&str, f64); 3] = [("g", 1e-3), ("kg", 1.0), ("Msun", 1.988_409_870_698_051e30)];

impl Unit {
    /// How many of `other` one of this unit is, where both are known and differ in nothing but a number and the name of a length
    /// or a mass: 1000 for `a Mpc/h` and `a kpc/h`; what `h` and `a` are is not known.
    pub fn ratio(&self, other: &Unit) -> Option<f64> {
        let ((own, like), (others, alike)) = (self.parsed()?, other.parsed()?);
        (like == alike).then_some(own / others)
    }

    /// The same without the powers of the scale factor `a`: `Mpc/h` of `a Mpc/h`, `km/s` of `a^0.5 km/s`.
    pub fn without_scale_factor(&self) -> Unit {
        let is_other = |part: &&str| *part != "a" && !part.starts_with("a^");
        let mut parts = self.0.split('/');
        let above: Vec<&str> = parts.next().unwrap_or_default().split(' ').filter(is_other).collect();
        Unit(
            std::iter::once(above.join(" "))
                .chain(parts.filter(is_other).map(str::to_owned))
                .collect::<Vec<_>>()
                .join("/"),
        )
    }

    /// The number in front times the known unit's size, and all the rest with the kind in the known unit's place.
    fn parsed(&self) -> Option<(f64, String)> {
        let mut size = 1.0;
        let mut rest = String::new();
        let mut known = 0;
        // `1e10` is a number; names have powers, and a stroke before those that divide.
        for (i, word) in self.0.split_whitespace().enumerate() {
            if let (0, Ok(number)) = (i, word.parse::<f64>()) {
                size *= number;
                continue;
            }
            for (k, factor) in word.split('/').enumerate() {
                rest.push(if k == 0 { ' ' } else { '/' });
                let (name, power) = factor.split_once('^').map_or((factor, None), |(name, power)| (name, Some(power)));
                let of = |table: &[(&str, f64)]| table.iter().find(|(known, _)| *known == name).map(|(_, size)| *size);
                let found =
                    of(&LENGTHS).map(|size| (size, "length")).or_else(|| of(&MASSES).map(|size| (size, "mass")));
                let exponent = power.map_or(Some(1.0), |power| power.parse::<f64>().ok());
                match found.zip(exponent) {
                    Some(((of, kind), exponent)) => {
                        size *= of.powf(if k == 0 { exponent } else { -exponent });
                        known += 1;
                        rest.push_str(kind);
                        rest.push_str(&factor[name.len()..]);
                    }
                    None => rest.push_str(factor),
                }
            }
        }
        (known == 1 && size > 0.0 && size.is_finite()).then_some((size, rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_a_kind_have_a_ratio() {
        let ratio = |a: &str, b: &str| Unit::new(a).ratio(&Unit::new(b));
        assert_eq!(ratio("kpc", "kpc"), Some(1.0));
        assert!((ratio("Mpc", "kpc").unwrap() / 1e3 - 1.0).abs() < 1e-12);
        assert!((ratio("a Mpc/h", "a kpc/h").unwrap() / 1e3 - 1.0).abs() < 1e-12);
        assert!((ratio("1e10 Msun/h", "Msun/h").unwrap() / 1e10 - 1.0).abs() < 1e-12);
        assert!((ratio("pc", "ly").unwrap() - 3.261_563_777).abs() < 1e-9);
        for (a, b, expected) in [("kpc^2", "pc^2", 1e6), ("1e3 /kpc^3", "/Mpc^3", 1e12), ("km^-1", "m^-1", 1e-3)] {
            assert!((ratio(a, b).unwrap() / expected - 1.0).abs() < 1e-12, "{a} {b}: {:?}", ratio(a, b));
        }
        for (a, b) in [
            ("kpc^x", "pc^x"),
            ("kpc^2", "kpc"),
            ("a Mpc/h", "Mpc"),
            ("kpc", "Msun"),
            ("", "kpc"),
            ("K", "K"),
            ("kpc", "a kpc"),
            ("0 kpc", "kpc"),
        ] {
            assert_eq!(ratio(a, b), None, "{a} {b}");
        }
        let physical = |name: &str| Unit::new(name).without_scale_factor().0;
        assert_eq!(
            ["a Mpc/h", "a^0.5 km/s", "1e10 Msun h^2/a^3/Mpc^3", "au/a", "", "kpc"].map(physical),
            ["Mpc/h", "km/s", "1e10 Msun h^2/Mpc^3", "au", "", "kpc"]
        );
        // One name only: speeds are no lengths.
        assert_eq!(ratio("kpc kpc", "kpc kpc"), None);
    }
}
