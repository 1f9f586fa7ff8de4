//! Units that a source states for what defines positions: lengths and angles. Everything else keeps its unit as a label;
//! these must be understood, since a table may mix them and a parallax becomes a distance.

use super::ImportError;
use std::path::Path;

/// What a stated unit of length means.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Length {
    /// The file says in words that it has no unit.
    Code,
    /// A length of `metres` times powers of the scale factor `a` and the Hubble parameter `h`.
    Known {
        /// SI value without those powers.
        metres: f64,
        /// Power of `a`: 1 for comoving lengths.
        a: i32,
        /// Power of `h`.
        h: i32,
    },
}

/// Spellings of units of length that take no SI prefix, with their metres.
const LENGTHS: &[(&[&str], f64)] = &[
    (&["au", "AU", "ua"], ASTRONOMICAL_UNIT),
    (&["Rsun", "R_sun", "Rsol", "solRad", "R_sol"], 6.957e8),
    (&["Rearth", "R_earth", "earthRad"], 6.3781e6),
    (&["micron", "microns"], 1e-6),
    (&["Angstrom", "angstrom", "Å"], 1e-10),
    (&["PC", "Pc"], PARSEC),
    (&["KPC", "Kpc"], 1e3 * PARSEC),
    (&["MPC"], 1e6 * PARSEC),
    (&["GPC"], 1e9 * PARSEC),
];

/// Units of length that take SI prefixes: short names with short prefixes, long names with long ones. No prefixes below 1
/// for those of the sky: `mpc` is as often meant to be a megaparsec.
const PREFIXED: &[(&[&str], &[&str], f64, bool)] = &[
    (&["pc"], &["parsec", "parsecs"], PARSEC, false),
    (&["ly", "lyr"], &["lightyear", "lightyears", "light-year", "light-years"], 9.460_730_472_580_8e15, false),
    (&["m"], &["meter", "meters", "metre", "metres"], 1.0, true),
];

const PREFIXES: &[(&str, &str, f64)] = &[
    ("", "", 1.0),
    ("k", "kilo", 1e3),
    ("M", "mega", 1e6),
    ("G", "giga", 1e9),
    ("T", "tera", 1e12),
    ("c", "centi", 1e-2),
    ("m", "milli", 1e-3),
    ("u", "micro", 1e-6),
    ("µ", "micro", 1e-6),
    ("n", "nano", 1e-9),
];

const ASTRONOMICAL_UNIT: f64 = 1.495_978_707e11;
const PARSEC: f64 = 3.085_677_581_491_367e16;

/// Words for "no unit".
const CODE: &[&str] =
    &["-", "1", "code", "code units", "code unit", "code_length", "code length", "dimensionless", "internal units"];

/// Spellings of angles, with their degrees.
const ANGLES: &[(&[&str], f64)] = &[
    (&["deg", "degs", "degree", "degrees", "degrees_east", "degrees_north", "°", "deg."], 1.0),
    (&["h", "hr", "hrs", "hour", "hours", "hourangle"], 15.0),
    (&["rad", "radian", "radians"], 180.0 / std::f64::consts::PI),
    (&["arcmin", "arcmins", "arcminute", "arcminutes", "'"], 1.0 / 60.0),
    (&["arcsec", "arcsecs", "arcsecond", "arcseconds", "as", "\"", "''"], 1.0 / 3600.0),
    (&["mas", "marcsec", "milliarcsec", "milliarcsecond", "milliarcseconds"], 1.0 / 3.6e6),
    (&["uas", "µas", "microarcsec", "microarcsecond", "microarcseconds"], 1.0 / 3.6e9),
];

/// Frames of reference that stand where a unit might.
const FRAMES: &[&str] = &["j2000", "j2000.0", "icrs", "fk5", "equatorial"];

/// What the unit of a length means; `None` if it is none that deepfield knows.
pub(super) fn length(text: &str) -> Option<Length> {
    let text = text.trim();
    if text.is_empty() || CODE.contains(&text.to_lowercase().as_str()) {
        return Some(Length::Code);
    }
    let spaced = text.replace("h^-1", " h^-1 ").replace("h**-1", " h^-1 ").replace('/', " / ").replace('*', " ");
    let (mut factor, mut base, mut a, mut h, mut divide) = (1.0, None, 0, 0, false);
    for token in spaced.split_whitespace() {
        if token == "/" {
            if divide {
                return None;
            }
            divide = true;
            continue;
        }
        let sign = if std::mem::take(&mut divide) { -1 } else { 1 };
        match token {
            "h" => h += sign,
            "h^-1" | "h-1" => h -= sign,
            "a" => a += sign,
            "comoving" => a += 1,
            "proper" | "physical" => {}
            _ => match (number(token), base) {
                (Some(number), _) => factor *= if sign > 0 { number } else { 1.0 / number },
                (None, None) if sign > 0 => {
                    let (metres, comoving) = base_length(token)?;
                    base = Some(metres);
                    a += i32::from(comoving);
                }
                _ => return None,
            },
        }
    }
    let metres = factor * base.filter(|_| !divide)?;
    (metres > 0.0 && metres.is_finite()).then_some(Length::Known { metres, a, h })
}

/// A positive number such as `1000`, `1e3` or `10^3`.
fn number(token: &str) -> Option<f64> {
    let power = token.strip_prefix("10^").and_then(|power| power.parse().ok()).map(|power: i32| 10f64.powi(power));
    power.or_else(|| token.parse().ok()).filter(|number| *number > 0.0 && number.is_finite())
}

/// Metres of a unit without factors, and whether it is marked as comoving (`cMpc`).
fn base_length(name: &str) -> Option<(f64, bool)> {
    if let Some((_, metres)) = LENGTHS.iter().find(|(names, _)| names.contains(&name)) {
        return Some((*metres, false));
    }
    let plain = |name: &str, sky: bool| {
        PREFIXED.iter().filter(|(.., small)| !(sky && *small)).find_map(|(short, long, metres, small)| {
            let prefixes = PREFIXES.iter().filter(|(.., factor)| *small || *factor >= 1.0);
            prefixes.into_iter().find_map(|(short_prefix, long_prefix, factor)| {
                let short = name.strip_prefix(short_prefix).is_some_and(|rest| short.contains(&rest));
                let lower = name.to_lowercase();
                let long = lower.strip_prefix(long_prefix).is_some_and(|rest| long.contains(&rest));
                (short || long).then_some(metres * factor)
            })
        })
    };
    // `cm` and `pm` are no comoving or proper metres.
    let marked = |mark: char| name.strip_prefix(mark).and_then(|rest| plain(rest, true));
    let unmarked = plain(name, false).map(|metres| (metres, false));
    unmarked.or_else(|| marked('c').map(|metres| (metres, true))).or_else(|| marked('p').map(|metres| (metres, false)))
}

/// Degrees in the unit of an angle; `None` if it is none that deepfield knows.
pub(super) fn degrees(text: &str) -> Option<f64> {
    let lower = text.trim().to_lowercase();
    ANGLES.iter().find(|(names, _)| names.contains(&lower.as_str())).map(|(_, degrees)| *degrees)
}

/// What an error says is known.
pub(super) const KNOWN_LENGTHS: &str =
    "a length: pc, kpc, Mpc, Gpc, ly, au, Rsun, m, cm, km, ..., possibly with /h, a or a number; or no unit";

/// Whether text in the place of an angle's unit names a frame of reference and no unit.
pub(super) fn is_frame(text: &str) -> bool {
    FRAMES.contains(&text.trim().to_lowercase().as_str())
}

/// [`length`], with an error that names the file, the field and the units that are known.
pub(super) fn length_of(path: &Path, field: &str, text: &str) -> Result<Length, ImportError> {
    length(text)
        .ok_or_else(|| ImportError::malformed(path, format!("unit of {field}"), format!("{text:?}"), KNOWN_LENGTHS))
}

/// [`degrees`], with an error that names the file, the field and the units that are known. Without a unit, or with a frame
/// of reference in its place, `unstated`.
pub(super) fn degrees_of(path: &Path, field: &str, text: &str, unstated: f64) -> Result<f64, ImportError> {
    if text.trim().is_empty() || is_frame(text) {
        return Ok(unstated);
    }
    degrees(text).ok_or_else(|| {
        let expected = "an angle: deg, h (15 deg), rad, arcmin, arcsec, mas, uas; or no unit";
        ImportError::malformed(path, format!("unit of {field}"), format!("{text:?}"), expected)
    })
}

/// The factor that brings lengths of unit `from` to unit `to`; 1 where `from` has none. An error where the two cannot be
/// compared: one has no unit, or they differ in powers of `a` or `h`.
pub(super) fn conversion(path: &Path, field: &str, from: &str, to: &str) -> Result<f64, ImportError> {
    match (length_of(path, field, from)?, length(to)) {
        (Length::Code, _) => Ok(1.0),
        (Length::Known { metres, a, h }, Some(Length::Known { metres: other, a: other_a, h: other_h }))
            if (a, h) == (other_a, other_h) =>
        {
            Ok(if metres == other { 1.0 } else { metres / other })
        }
        _ => {
            let expected = if to.is_empty() { "none, as positions have none".into() } else { format!("one like {to}") };
            Err(ImportError::malformed(path, format!("unit of {field}"), format!("{from:?}"), expected))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_in_every_spelling() {
        let pc = PARSEC;
        let cases = [
            ("pc", pc, 0, 0),
            ("kpc", 1e3 * pc, 0, 0),
            ("Mpc/h", 1e6 * pc, 0, -1),
            ("Mpc h^-1", 1e6 * pc, 0, -1),
            ("h^-1Mpc", 1e6 * pc, 0, -1),
            ("h-1 kpc", 1e3 * pc, 0, -1),
            ("a Mpc/h", 1e6 * pc, 1, -1),
            ("ckpc/h", 1e3 * pc, 1, -1),
            ("pkpc", 1e3 * pc, 0, 0),
            ("comoving Gpc", 1e9 * pc, 1, 0),
            ("1000 kpc", 1e6 * pc, 0, 0),
            ("10^3 km", 1e6, 0, 0),
            ("KPC", 1e3 * pc, 0, 0),
            ("Megaparsecs", 1e6 * pc, 0, 0),
            ("km", 1e3, 0, 0),
            ("cm", 1e-2, 0, 0),
            ("metres", 1.0, 0, 0),
            ("AU", ASTRONOMICAL_UNIT, 0, 0),
            ("Rsun", 6.957e8, 0, 0),
            ("kly", 9.460_730_472_580_8e18, 0, 0),
            ("light-years", 9.460_730_472_580_8e15, 0, 0),
        ];
        for (text, metres, a, h) in cases {
            match length(text) {
                Some(Length::Known { metres: found, a: found_a, h: found_h }) => {
                    assert!((found / metres - 1.0).abs() < 1e-12, "{text}: {found}");
                    assert_eq!((found_a, found_h), (a, h), "{text}");
                }
                other => panic!("{text}: {other:?}"),
            }
        }
        for text in ["", " ", "-", "code units", "Code_Length"] {
            assert_eq!(length(text), Some(Length::Code), "{text}");
        }
        for text in ["furlong", "kg", "mpc", "kpc/", "/h", "kpc//h", "1e3", "kpc kpc", "1/kpc", "-3 km", "km/s", "deg"]
        {
            assert_eq!(length(text), None, "{text}");
        }
    }

    #[test]
    fn angles_in_every_spelling() {
        let cases = [("deg", 1.0), ("Degrees", 1.0), ("h", 15.0), ("hourangle", 15.0), ("arcmin", 1.0 / 60.0)];
        let small = [("rad", 57.295_779_513_082_32), ("mas", 1.0 / 3.6e6), ("arcsec", 1.0 / 3600.0)];
        for (text, expected) in cases.into_iter().chain(small) {
            assert!((degrees(text).unwrap() / expected - 1.0).abs() < 1e-12, "{text}");
        }
        assert!(degrees("gon").is_none() && degrees("").is_none() && degrees("hectare").is_none());
        let path = Path::new("stars.csv");
        assert_eq!(degrees_of(path, "ra", "J2000", 1.0).unwrap(), 1.0);
        let text = degrees_of(path, "ra", "gradian?", 1.0).unwrap_err().to_string();
        assert!(text.contains("stars.csv: unit of ra: found \"gradian?\", expected an angle: deg, h"), "{text}");
    }

    #[test]
    fn lengths_of_other_frames_are_not_mixed() {
        let factor = |from: &str, to: &str| conversion(Path::new("t.csv"), "h", from, to);
        assert!((factor("pc", "kpc").unwrap() - 1e-3).abs() < 1e-15);
        assert_eq!(factor("", "kpc").unwrap(), 1.0);
        assert!(factor("Mpc/h", "a Mpc/h").is_err());
        assert!(factor("kpc", "").unwrap_err().to_string().contains("expected none"));
        assert!(factor("ell", "kpc").unwrap_err().to_string().contains("t.csv: unit of h: found \"ell\""));
    }
}
