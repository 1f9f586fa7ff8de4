//! The joint plane of `P` (or density) and `S`: soft regions that change brightness, opacity and colour there.
//!
//! The simplified two-dimensional function of F12 3.5.4 gives brightness and opacity by the density and hue by the attribute.
//! Regions bring out what that cannot: an ellipse over the two places with a soft rim stands for matter of some density and
//! some temperature. Where regions lie over each other, later ones cover earlier ones.

use crate::color::colormap::{HexColor, Rgb};
use serde::{Deserialize, Serialize};

/// Regions that a plane may have.
pub const MOST_REGIONS: usize = 32;
/// The largest factor on brightness and opacity.
pub const MOST_FACTOR: f32 = 8.0;

/// Factors over the plane of the places of `P` and `S`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Plane {
    /// Factor on the brightness outside of all regions.
    #[serde(deserialize_with = "factor")]
    pub brightness: f32,
    /// Factor on the opacity outside of all regions; of volumes on the extinction.
    #[serde(deserialize_with = "factor")]
    pub opacity: f32,
    /// The regions; later ones cover earlier ones.
    #[serde(deserialize_with = "regions")]
    pub regions: Vec<Region>,
}

impl Default for Plane {
    fn default() -> Plane {
        Plane { brightness: 1.0, opacity: 1.0, regions: Vec::new() }
    }
}

/// An ellipse in the plane of places, and what it changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Its middle: places of `P` and `S`, within [0, 1].
    #[serde(deserialize_with = "middle")]
    pub at: (f32, f32),
    /// Half its width and height.
    #[serde(deserialize_with = "radius")]
    pub radius: (f32, f32),
    /// The outer share of the radius over which it fades, within [0, 1].
    #[serde(default = "half", deserialize_with = "share")]
    pub soft: f32,
    /// Factor on the brightness.
    #[serde(default = "one", deserialize_with = "factor")]
    pub brightness: f32,
    /// Factor on the opacity; of volumes on the extinction.
    #[serde(default = "one", deserialize_with = "factor")]
    pub opacity: f32,
    /// Its hue, in place of the attribute's.
    #[serde(default)]
    pub color: Option<HexColor>,
}

fn half() -> f32 {
    0.5
}

fn one() -> f32 {
    1.0
}

fn within<'de, D: serde::Deserializer<'de>>(value: f32, [least, most]: [f32; 2]) -> Result<f32, D::Error> {
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    Err(serde::de::Error::custom(format!("{value}, expected a number from {least} to {most}")))
}

fn factor<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    within::<D>(f32::deserialize(deserializer)?, [0.0, MOST_FACTOR])
}

fn share<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    within::<D>(f32::deserialize(deserializer)?, [0.0, 1.0])
}

fn middle<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<(f32, f32), D::Error> {
    let (p, s) = <(f32, f32)>::deserialize(deserializer)?;
    Ok((within::<D>(p, [0.0, 1.0])?, within::<D>(s, [0.0, 1.0])?))
}

fn radius<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<(f32, f32), D::Error> {
    let (p, s) = <(f32, f32)>::deserialize(deserializer)?;
    Ok((within::<D>(p, [0.001, 4.0])?, within::<D>(s, [0.001, 4.0])?))
}

fn regions<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<Region>, D::Error> {
    let regions = Vec::<Region>::deserialize(deserializer)?;
    if regions.len() > MOST_REGIONS {
        return Err(serde::de::Error::custom(format!("{} regions, expected up to {MOST_REGIONS}", regions.len())));
    }
    Ok(regions)
}

/// What a place of the plane changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factors {
    /// On the brightness.
    pub brightness: f32,
    /// On the opacity.
    pub opacity: f32,
    /// On the hue.
    pub dye: Dye,
}

/// A colour that covers a share of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dye {
    /// The colour times its share.
    color: Rgb,
    /// What is left of the other.
    left: f32,
}

impl Dye {
    /// The other colour, covered.
    pub fn mix(&self, other: Rgb) -> Rgb {
        std::array::from_fn(|k| self.color[k] + self.left * other[k])
    }
}

impl Region {
    /// A region that changes nothing yet.
    pub fn new(at: (f32, f32), radius: (f32, f32)) -> Region {
        Region { at, radius, soft: half(), brightness: 1.0, opacity: 1.0, color: None }
    }

    /// How much of it there is at a place: 1 inside, 0 outside, in between over the soft rim.
    pub fn weight(&self, p: f32, s: f32) -> f32 {
        let distance = ((p - self.at.0) / self.radius.0).hypot((s - self.at.1) / self.radius.1);
        if distance >= 1.0 {
            return 0.0;
        }
        if distance <= 1.0 - self.soft {
            return 1.0;
        }
        let t = (1.0 - distance) / self.soft;
        t * t * (3.0 - 2.0 * t)
    }
}

impl Plane {
    /// Whether it changes nothing anywhere.
    pub fn is_plain(&self) -> bool {
        self.regions.is_empty() && self.brightness == 1.0 && self.opacity == 1.0
    }

    /// The changes at places of `P` and `S`.
    pub fn factors(&self, p: f32, s: f32) -> Factors {
        let none = Dye { color: [0.0; 3], left: 1.0 };
        let start = Factors { brightness: self.brightness, opacity: self.opacity, dye: none };
        self.regions.iter().fold(start, |below, region| {
            let weight = region.weight(p, s);
            let mix = |below: f32, own: f32| below + weight * (own - below);
            let own = region.color.map_or([0.0; 3], HexColor::rgb);
            // A region without a colour of its own leaves the hue as it is.
            let cover = if region.color.is_some() { weight } else { 0.0 };
            let left = 1.0 - cover;
            let dye = Dye {
                color: std::array::from_fn(|k| left * below.dye.color[k] + cover * own[k]),
                left: left * below.dye.left,
            };
            Factors {
                brightness: mix(below.brightness, region.brightness),
                opacity: mix(below.opacity, region.opacity),
                dye,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::TransferFunction;
    use crate::model::ron_file;

    #[test]
    fn regions_fade_at_their_rims_and_cover_each_other() {
        let region = Region { brightness: 0.0, ..Region::new((0.5, 0.5), (0.2, 0.4)) };
        assert_eq!([region.weight(0.5, 0.5), region.weight(0.59, 0.5), region.weight(0.71, 0.5)], [1.0, 1.0, 0.0]);
        assert!((region.weight(0.65, 0.5) - region.weight(0.5, 0.8)).abs() < 1e-5);
        assert!((region.weight(0.65, 0.5) - 0.5).abs() < 1e-5);
        let red = Region { color: Some(HexColor([255, 0, 0])), opacity: 3.0, ..region.clone() };
        let plane = Plane { brightness: 0.5, opacity: 1.0, regions: vec![region, red] };
        let outside = plane.factors(0.0, 0.0);
        assert_eq!(
            (outside.brightness, outside.opacity, outside.dye.mix([0.1, 0.2, 0.3])),
            (0.5, 1.0, [0.1, 0.2, 0.3])
        );
        let inside = plane.factors(0.5, 0.5);
        assert_eq!((inside.brightness, inside.opacity, inside.dye.mix([0.1, 0.2, 0.3])), (0.0, 3.0, [1.0, 0.0, 0.0]));
        assert!(!plane.is_plain() && Plane::default().is_plain());
    }

    #[test]
    fn mistakes_are_named() {
        let message = |text: &str| ron_file::parse::<TransferFunction>("t.ron", text).unwrap_err().to_string();
        let with = |region: &str| format!("(plane: (\n regions: [({region})]))");
        for (text, expected) in [
            (with("at: (0.5, 1.5), radius: (0.1, 0.1)"), "at: 1.5, expected a number from 0 to 1"),
            (with("at: (0.5, 0.5), radius: (0.0, 0.1)"), "radius: 0, expected a number from 0.001"),
            (with("at: (0.5, 0.5)"), "radius"),
            (with("at: (0.5, 0.5), radius: (0.1, 0.1), soft: 2.0"), "soft: 2, expected"),
            (with("at: (0.5, 0.5), radius: (0.1, 0.1), colour: \"#ff0000\""), "colour"),
            (with("at: (0.5, 0.5), radius: (0.1, 0.1), color: \"red\""), "`red`, expected a colour like \"#ff8000\""),
            ("(\nplane: (brightness: -1.0))".into(), "t.ron:2:"),
        ] {
            let found = message(&text);
            assert!(found.contains(expected), "{text}: {found}");
        }
    }
}
