//! Units by their names, taken apart for what snapshots state of them: their size in cgs, and powers of the scale factor, of the Hubble
//! parameter, and of mass, length and time.

use crate::model::Unit;

/// Longest name that is taken apart.
const LONGEST: usize = 200;

/// Names of units with their size in cgs, and what they are a unit of.
const KNOWN: [(&str, f64, Kind); 25] = [
    ("nm", 1e-7, Kind::Length),
    ("micron", 1e-4, Kind::Length),
    ("mm", 0.1, Kind::Length),
    ("cm", 1.0, Kind::Length),
    ("m", 100.0, Kind::Length),
    ("km", 1e5, Kind::Length),
    ("Rsun", 6.957e10, Kind::Length),
    ("au", 1.495_978_707e13, Kind::Length),
    ("ly", 9.460_730_472_580_8e17, Kind::Length),
    ("pc", PARSEC, Kind::Length),
    ("kpc", 1e3 * PARSEC, Kind::Length),
    ("Mpc", 1e6 * PARSEC, Kind::Length),
    ("Gpc", 1e9 * PARSEC, Kind::Length),
    ("g", 1.0, Kind::Mass),
    ("kg", 1e3, Kind::Mass),
    ("Msun", 1.988_409_870_698_051e33, Kind::Mass),
    ("s", 1.0, Kind::Time),
    ("yr", YEAR, Kind::Time),
    ("kyr", 1e3 * YEAR, Kind::Time),
    ("Myr", 1e6 * YEAR, Kind::Time),
    ("Gyr", 1e9 * YEAR, Kind::Time),
    ("K", 1.0, Kind::Temperature),
    // Without a size of their own.
    ("a", 1.0, Kind::ScaleFactor),
    ("h", 1.0, Kind::Hubble),
    ("1", 1.0, Kind::None),
];

/// Centimetres.
const PARSEC: f64 = 3.085_677_581_491_367e18;

/// Seconds of a Julian year.
const YEAR: f64 = 3.155_76e7;

/// What a name is a power of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    ScaleFactor,
    Hubble,
    Mass,
    Length,
    Time,
    Temperature,
    None,
}

/// A unit taken apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Powers {
    /// Its size in cgs, apart from what `a` and `h` are.
    pub cgs: f64,
    /// Power of the scale factor.
    pub a: f64,
    /// Power of the Hubble parameter.
    pub h: f64,
    pub mass: f64,
    pub length: f64,
    pub time: f64,
    pub temperature: f64,
}

impl Powers {
    const ONE: Powers = Powers { cgs: 1.0, a: 0.0, h: 0.0, mass: 0.0, length: 0.0, time: 0.0, temperature: 0.0 };

    /// Takes a unit apart; `None` where it is unknown or has parts that are.
    pub(super) fn of(unit: &Unit) -> Option<Powers> {
        if unit.is_unknown() || unit.0.len() > LONGEST {
            return None;
        }
        let mut text = Text { rest: &unit.0 };
        let powers = text.product()?;
        (text.rest.is_empty() && powers.cgs > 0.0 && powers.cgs.is_finite()).then_some(powers)
    }

    /// Whether it is a unit with these powers of mass, length and time, whatever `a` and `h` are to it.
    pub(super) fn is(&self, mass: f64, length: f64, time: f64) -> bool {
        (self.mass, self.length, self.time, self.temperature) == (mass, length, time, 0.0)
    }

    fn word(word: &str) -> Option<Powers> {
        if let Some((_, cgs, kind)) = KNOWN.iter().find(|(name, ..)| *name == word) {
            let one = Powers { cgs: *cgs, ..Powers::ONE };
            return Some(match kind {
                Kind::ScaleFactor => Powers { a: 1.0, ..one },
                Kind::Hubble => Powers { h: 1.0, ..one },
                Kind::Mass => Powers { mass: 1.0, ..one },
                Kind::Length => Powers { length: 1.0, ..one },
                Kind::Time => Powers { time: 1.0, ..one },
                Kind::Temperature => Powers { temperature: 1.0, ..one },
                Kind::None => one,
            });
        }
        word.parse().ok().map(|cgs| Powers { cgs, ..Powers::ONE })
    }

    fn to_the(self, power: f64) -> Powers {
        let Powers { cgs, a, h, mass, length, time, temperature } = self;
        let [a, h, mass, length, time, temperature] = [a, h, mass, length, time, temperature].map(|own| own * power);
        Powers { cgs: libm::pow(cgs, power), a, h, mass, length, time, temperature }
    }

    fn times(self, other: Powers) -> Powers {
        Powers {
            cgs: self.cgs * other.cgs,
            a: self.a + other.a,
            h: self.h + other.h,
            mass: self.mass + other.mass,
            length: self.length + other.length,
            time: self.time + other.time,
            temperature: self.temperature + other.temperature,
        }
    }
}

/// What is left of a unit's name: names, numbers and parts in brackets, with powers, one behind the other; `/` divides by the next one.
struct Text<'t> {
    rest: &'t str,
}

impl Text<'_> {
    fn product(&mut self) -> Option<Powers> {
        let mut all = Powers::ONE;
        let mut divides = false;
        loop {
            self.rest = self.rest.trim_start();
            if self.rest.is_empty() || self.rest.starts_with(')') {
                return (!divides).then_some(all);
            }
            if let Some(rest) = self.rest.strip_prefix('/') {
                if divides {
                    return None;
                }
                (self.rest, divides) = (rest, true);
                continue;
            }
            let factor = self.factor()?;
            all = all.times(factor.to_the(if divides { -1.0 } else { 1.0 }));
            divides = false;
        }
    }

    fn factor(&mut self) -> Option<Powers> {
        let base = match self.rest.strip_prefix('(') {
            Some(rest) => {
                self.rest = rest;
                let inner = self.product()?;
                self.rest = self.rest.strip_prefix(')')?;
                inner
            }
            None => Powers::word(self.word())?,
        };
        let Some(rest) = self.rest.strip_prefix('^') else { return Some(base) };
        self.rest = rest;
        let power = self.word().parse().ok().filter(|power: &f64| power.is_finite())?;
        Some(base.to_the(power))
    }

    /// The next letters up to what separates.
    fn word(&mut self) -> &str {
        let end = self.rest.find([' ', '/', '(', ')', '^']).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        word
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_come_apart() {
        let of = |name: &str| Powers::of(&Unit::new(name));
        let close = |name: &str, expected: Powers| {
            let found = of(name).unwrap();
            assert!((found.cgs / expected.cgs - 1.0).abs() < 1e-12, "{name}: {found:?}");
            assert_eq!(Powers { cgs: expected.cgs, ..found }, expected, "{name}");
        };
        close("a kpc/h", Powers { cgs: 1e3 * PARSEC, a: 1.0, h: -1.0, length: 1.0, ..Powers::ONE });
        close("a^0.5 km/s", Powers { cgs: 1e5, a: 0.5, length: 1.0, time: -1.0, ..Powers::ONE });
        let density = 1e10 * 1.988_409_870_698_051e33 / (1e6 * PARSEC * 1e6 * PARSEC * 1e6 * PARSEC);
        close(
            "1e10 Msun h^2/a^3/Mpc^3",
            Powers { cgs: density, a: -3.0, h: 2.0, mass: 1.0, length: -3.0, ..Powers::ONE },
        );
        close("(km/s)^2", Powers { cgs: 1e10, length: 2.0, time: -2.0, ..Powers::ONE });
        close("K", Powers { temperature: 1.0, ..Powers::ONE });
        for wrong in ["", "furlong", "km/", "km//s", "(km/s", "km)", "km^", "km^s", "^2", "0 km", "-1 km", "1e999 km"] {
            assert_eq!(of(wrong), None, "{wrong}");
        }
        assert_eq!(of(&"(".repeat(LONGEST + 1)), None);
        assert_eq!(of(&"(".repeat(LONGEST)), None);
    }
}
