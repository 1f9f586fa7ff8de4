//! Values on the command line that several commands share, parsed with messages that say what was expected.

use crate::color::transfer::{TransferFunction, presets};
pub use crate::look::page_cache::bytes;
use crate::mode::Mode;
use crate::model::FamilyName;
use crate::modes;
use glam::DVec3;

/// An option's name, and whether it is given.
pub type Given = (&'static str, bool);

/// Width and height of a picture: `1200x800`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureSize {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
}

impl std::str::FromStr for PictureSize {
    type Err = String;

    fn from_str(text: &str) -> Result<PictureSize, String> {
        let parsed = text
            .split_once('x')
            .and_then(|(width, height)| Some(PictureSize { width: width.parse().ok()?, height: height.parse().ok()? }));
        parsed
            .filter(|size| (1..=32768).contains(&size.width) && (1..=32768).contains(&size.height))
            .ok_or_else(|| "expected WIDTHxHEIGHT in pixels up to 32768, such as 1200x800".into())
    }
}

/// A point or direction: `x,y,z`.
pub fn vector(text: &str) -> Result<DVec3, String> {
    let parts: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|value: &f64| value.is_finite()))
        .collect::<Option<_>>()
        .unwrap_or_default();
    match parts[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three numbers x,y,z such as 0,0,1.5".into()),
    }
}

/// The transfer function of that name, or in that file.
///
/// # Errors
/// The names that there are, or what is wrong with the file.
pub fn transfer_named(text: &str) -> Result<TransferFunction, String> {
    TransferFunction::named(text, presets::folder().as_deref()).map_err(|error| error.to_string())
}

/// The mode of that name.
///
/// # Errors
/// The names that there are.
pub fn mode_name(text: &str) -> Result<&'static Mode, String> {
    modes::find(text).ok_or_else(|| format!("expected one of {}", modes::names()))
}

/// The family of that name.
///
/// # Errors
/// The names that there are.
pub fn family_name(text: &str) -> Result<FamilyName, String> {
    FamilyName::parse(text)
        .ok_or_else(|| "expected the name of a family: lower-case letters, digits and hyphens".into())
}

/// A number greater than zero.
pub fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|&value: &f64| value > 0.0 && value.is_finite())
        .ok_or_else(|| "expected a number greater than 0".into())
}

/// Zero or a number greater than it.
pub fn not_negative(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|&value: &f64| value >= 0.0 && value.is_finite())
        .ok_or_else(|| "expected 0 or a number greater than 0".into())
}

/// A whole number greater than zero: `1000000`, `1e9`, `2.5e6`.
pub fn count(text: &str) -> Result<u64, String> {
    // Whole numbers beyond 2^53 are exact only as such.
    let number = text.parse().ok().or_else(|| {
        let value: f64 = text.parse().ok()?;
        (value.fract() == 0.0 && (1.0..2f64.powi(63)).contains(&value)).then_some(value as u64)
    });
    number.filter(|&number| number > 0).ok_or_else(|| "expected a whole number such as 1000000 or 1e9".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_vectors_and_amounts_are_read_or_refused() {
        assert_eq!("1200x800".parse(), Ok(PictureSize { width: 1200, height: 800 }));
        for wrong in ["", "1200", "0x5", "-1x5", "99999x1", "1x2x3"] {
            assert!(wrong.parse::<PictureSize>().is_err(), "{wrong}");
        }
        assert_eq!(vector("1, -2,3e2"), Ok(DVec3::new(1.0, -2.0, 300.0)));
        for wrong in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan"] {
            assert!(vector(wrong).is_err(), "{wrong}");
        }
        assert_eq!(bytes("2GiB"), Ok(2 << 30));
        assert_eq!(bytes("1.5 MB"), Ok(1_500_000));
        for wrong in ["", "GiB", "-1GiB", "2 apples", "0"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
        assert_eq!([count("17"), count("1e9"), count("2.5e6")], [Ok(17), Ok(1_000_000_000), Ok(2_500_000)]);
        for wrong in ["", "0", "-1", "1.5", "1e-3", "1e30", "nan", "many"] {
            assert!(count(wrong).is_err(), "{wrong}");
        }
        assert!(positive("0.8").is_ok() && positive("0").is_err() && positive("inf").is_err());
        assert!(not_negative("0").is_ok() && not_negative("-1").is_err() && not_negative("nan").is_err());
    }
}
