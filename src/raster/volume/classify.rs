//! Transfer functions for volumes: what density (and an attribute) emit and absorb (F12 3.5.4), as RON and as a table.
//!
//! Density is placed logarithmically in its range; piecewise linear curves over that place give the opacity per unit
//! length and the brightness. The colour comes from a colour map by the brightness, or, where an attribute is drawn, has
//! the attribute's hue and the density's brightness.

use super::super::colormap::ColorMap;
use super::super::transfer::{Hue, Range, Scale, TransferFunction};
use crate::model::ron_file::{self, RonError};
use serde::{Deserialize, Serialize};

/// A piecewise linear curve through points of ascending place, all coordinates within [0, 1]; constant beyond its ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<(f32, f32)>", into = "Vec<(f32, f32)>")]
pub struct Curve(Vec<(f32, f32)>);

impl Curve {
    /// The curve through points.
    ///
    /// # Errors
    /// What is wrong with them, when there are none, they are not sorted, or one is outside [0, 1].
    pub fn new(points: Vec<(f32, f32)>) -> Result<Curve, String> {
        if points.is_empty() {
            return Err("no points, expected one or more (place, value)".into());
        }
        for (index, (place, value)) in points.iter().enumerate() {
            if !((0.0..=1.0).contains(place) && (0.0..=1.0).contains(value)) {
                return Err(format!("point {} is ({place}, {value}), expected numbers from 0 to 1", index + 1));
            }
            if index > 0 && points[index - 1].0 >= *place {
                let before = points[index - 1].0;
                return Err(format!("points are not sorted: {before} comes before {place}, expected ascending places"));
            }
        }
        Ok(Curve(points))
    }

    /// The value at a place.
    pub fn at(&self, place: f32) -> f32 {
        let after = self.0.partition_point(|point| point.0 <= place);
        match (after.checked_sub(1).map(|before| self.0[before]), self.0.get(after)) {
            (Some((from, low)), Some((to, high))) => low + (high - low) * (place - from) / (to - from),
            (Some((_, value)), None) => value,
            (None, first) => first.map_or(0.0, |first| first.1),
        }
    }
}

impl TryFrom<Vec<(f32, f32)>> for Curve {
    type Error = String;

    fn try_from(points: Vec<(f32, f32)>) -> Result<Curve, String> {
        Curve::new(points)
    }
}

impl From<Curve> for Vec<(f32, f32)> {
    fn from(curve: Curve) -> Vec<(f32, f32)> {
        curve.0
    }
}

/// The length over which a volume has the opacity that its curve says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "LengthText", into = "LengthText")]
pub enum UnitLength {
    /// A hundredth of the data's diameter.
    #[default]
    Auto,
    /// This length, world units.
    Fixed(f64),
}

/// A unit length as it is written.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", rename = "UnitLength")]
enum LengthText {
    Auto,
    Fixed(f64),
}

impl TryFrom<LengthText> for UnitLength {
    type Error = String;

    fn try_from(text: LengthText) -> Result<UnitLength, String> {
        match text {
            LengthText::Auto => Ok(UnitLength::Auto),
            LengthText::Fixed(length) if length > 0.0 && length.is_finite() => Ok(UnitLength::Fixed(length)),
            LengthText::Fixed(length) => Err(format!("unit length is {length}, expected a positive number")),
        }
    }
}

impl From<UnitLength> for LengthText {
    fn from(unit: UnitLength) -> LengthText {
        match unit {
            UnitLength::Auto => LengthText::Auto,
            UnitLength::Fixed(length) => LengthText::Fixed(length),
        }
    }
}

/// From a volume's density and attribute to colours and opacities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeTransfer {
    /// Colours from dark to bright; unused when there is a hue.
    #[serde(default)]
    pub color_map: ColorMap,
    /// Range of the density, spread logarithmically.
    #[serde(default)]
    pub range: Range,
    /// Opacity per unit length over the density's place.
    pub opacity: Curve,
    /// Brightness over the density's place.
    pub brightness: Curve,
    /// The length that the opacity is meant for.
    #[serde(default)]
    pub unit_length: UnitLength,
    /// Hue from the attribute, where the picture has one.
    #[serde(default)]
    pub hue: Option<Hue>,
}

/// Presets: one file each under `assets/transfer`.
const PRESETS: &[(&str, &str)] = &[
    ("volume", include_str!("../../../assets/transfer/volume.ron")),
    ("volume-hue", include_str!("../../../assets/transfer/volume-hue.ron")),
];

impl VolumeTransfer {
    /// Reads RON; `file` is what messages call it.
    ///
    /// # Errors
    /// [`RonError::Syntax`] with line, column and field.
    pub fn parse(text: &str, file: &str) -> Result<VolumeTransfer, RonError> {
        ron_file::parse(file, text)
    }

    /// Names of the built-in ones.
    pub fn presets() -> impl Iterator<Item = &'static str> {
        PRESETS.iter().map(|(name, _)| *name)
    }

    /// A built-in one.
    pub fn preset(name: &str) -> Option<VolumeTransfer> {
        let (_, text) = PRESETS.iter().find(|(known, _)| *known == name)?;
        VolumeTransfer::parse(text, name).ok()
    }

    /// The one that volumes begin with, with an attribute or without.
    pub fn usual(attribute: bool) -> VolumeTransfer {
        let name = if attribute { "volume-hue" } else { "volume" };
        VolumeTransfer::preset(name).unwrap_or_else(|| VolumeTransfer {
            color_map: ColorMap::default(),
            range: Range::Auto,
            opacity: Curve(vec![(0.0, 0.0), (1.0, 0.5)]),
            brightness: Curve(vec![(0.0, 0.0), (1.0, 1.0)]),
            unit_length: UnitLength::Auto,
            hue: None,
        })
    }
}

/// Numbers in place of automatic ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeLevels {
    /// Density at the places 0 and 1; ascending and positive.
    pub density: [f64; 2],
    /// Attribute at the ends of the hues.
    pub attribute: [f64; 2],
    /// Length that opacities are meant for, world units.
    pub unit_length: f64,
}

/// What a sample is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matter {
    /// Extinction per length: `-ln(1 - opacity) / unit length`.
    pub extinction: f32,
    /// Colour, linear light.
    pub color: [f32; 3],
}

/// Bits of a float's mantissa that a table does not see: 64 entries an octave, with linear interpolation between them.
pub const HIDDEN_BITS: u32 = 17;
/// Hues of a table.
pub const HUES: usize = 64;
/// Brightnesses of a table of hues.
pub const BRIGHTNESSES: usize = 256;
/// Opacities are below this, so that the extinction is finite.
const MOST_OPAQUE: f32 = 1.0 - 1e-6;

/// A transfer function as tables, for given ranges. Post-classification: it is asked with interpolated values.
#[derive(Clone, Debug)]
pub struct Classifier {
    /// Index of the first entry: the leading bits of its density.
    first: u32,
    /// Extinction, and colour; or the brightness in place of the colour where there are hues.
    table: Vec<[f32; 4]>,
    /// Colours of each hue, from dark to bright.
    hues: Vec<[f32; 3]>,
    hue: Hue,
    levels: VolumeLevels,
    least: f32,
}

/// What a [`Classifier`] looks up.
#[derive(Clone, Copy, Debug)]
pub struct Tables<'a> {
    /// The leading bits of the first entry's density.
    pub first: u32,
    /// Extinction and colour of each density; or its brightness in place of the colour where there are hues.
    pub densities: &'a [[f32; 4]],
    /// [`BRIGHTNESSES`] colours of each of [`HUES`] hues, from dark to bright; empty without hues.
    pub hues: &'a [[f32; 3]],
    /// How an attribute is placed among the hues.
    pub scale: Scale,
    /// Attribute at the ends of the hues.
    pub attribute: [f64; 2],
}

/// Light from gamma-encoded sRGB.
pub fn to_linear(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Gamma-encoded sRGB from light.
pub fn to_encoded(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.max(0.0).powf(1.0 / 2.4) - 0.055 }
}

impl Classifier {
    /// Tables of a transfer function; hues count only if the picture has an attribute.
    pub fn new(transfer: &VolumeTransfer, levels: VolumeLevels, attribute: bool) -> Classifier {
        let [min, max] = levels.density;
        let span = (max / min).ln();
        let bits = |density: f64| (density as f32).max(f32::MIN_POSITIVE).to_bits() >> HIDDEN_BITS;
        let (first, last) = (bits(min), bits(max) + 1);
        let hue = transfer.hue.filter(|_| attribute);
        let colors = transfer.color_map.sample(1024);
        let unit = levels.unit_length as f32;
        let entry = |index: u32| {
            let density = f64::from(f32::from_bits(index << HIDDEN_BITS));
            let place = ((density / min).ln() / span).clamp(0.0, 1.0) as f32;
            let opacity = transfer.opacity.at(place).min(MOST_OPAQUE);
            let extinction = -(-opacity).ln_1p() / unit;
            let brightness = transfer.brightness.at(place);
            let [r, g, b] = match hue {
                Some(_) => [brightness, 0.0, 0.0],
                None => colors[(brightness * 1023.0).round() as usize].map(to_linear),
            };
            [extinction, r, g, b]
        };
        let table: Vec<[f32; 4]> = (first..=last.max(first + 1)).map(entry).collect();
        let least = match table.iter().position(|entry| entry[0] > 0.0) {
            Some(0) => f32::MIN_POSITIVE,
            Some(index) => f32::from_bits((first + index as u32 - 1) << HIDDEN_BITS),
            None => f32::INFINITY,
        };
        let hues = hue.map_or(Vec::new(), |hue| {
            let function = TransferFunction { hue: Some(hue), ..TransferFunction::default() };
            let lut = function.bake_lut();
            let texel = |hue: usize, brightness: usize| {
                let row = hue * (lut.height as usize - 1) / (HUES - 1);
                let column = brightness * (lut.width as usize - 1) / (BRIGHTNESSES - 1);
                let [r, g, b, _] = lut.rgba[row * lut.width as usize + column];
                [r, g, b].map(|byte| to_linear(f32::from(byte) / 255.0))
            };
            (0..HUES * BRIGHTNESSES).map(|index| texel(index / BRIGHTNESSES, index % BRIGHTNESSES)).collect()
        });
        Classifier { first, table, hues, hue: hue.unwrap_or_default(), levels, least }
    }

    /// Densities up to this are invisible.
    pub fn least(&self) -> f32 {
        self.least
    }

    /// The ranges in use.
    pub fn levels(&self) -> &VolumeLevels {
        &self.levels
    }

    /// What a positive density and `sum m A W` there stand for.
    #[inline]
    pub fn matter(&self, density: f32, weighted: f32) -> Matter {
        let bits = density.to_bits();
        let index = (bits >> HIDDEN_BITS).saturating_sub(self.first) as usize;
        let (index, share) = match index < self.table.len() - 1 {
            true if bits >> HIDDEN_BITS >= self.first => {
                (index, (bits & ((1 << HIDDEN_BITS) - 1)) as f32 * (1.0 / (1 << HIDDEN_BITS) as f32))
            }
            true => (0, 0.0),
            false => (self.table.len() - 2, 1.0),
        };
        let (low, high) = (self.table[index], self.table[index + 1]);
        let [extinction, r, g, b]: [f32; 4] = std::array::from_fn(|k| low[k] + share * (high[k] - low[k]));
        if self.hues.is_empty() || extinction <= 0.0 {
            return Matter { extinction, color: [r, g, b] };
        }
        Matter { extinction, color: self.tinted(weighted / density, r) }
    }

    /// The colour of an attribute's value at a brightness; of the densities' middle without hues.
    pub fn tinted(&self, attribute: f32, brightness: f32) -> [f32; 3] {
        let place = self.hue.scale.place(attribute, self.levels.attribute);
        let row = (place * (HUES - 1) as f32).round() as usize * BRIGHTNESSES;
        let column = (brightness * (BRIGHTNESSES - 1) as f32).round() as usize;
        self.hues.get(row + column.min(BRIGHTNESSES - 1)).copied().unwrap_or([1.0; 3])
    }

    /// The tables, for those who look things up elsewhere.
    pub fn tables(&self) -> Tables<'_> {
        Tables {
            first: self.first,
            densities: &self.table,
            hues: &self.hues,
            scale: self.hue.scale,
            attribute: self.levels.attribute,
        }
    }

    /// Whether colours follow an attribute.
    pub fn has_hues(&self) -> bool {
        !self.hues.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEVELS: VolumeLevels = VolumeLevels { density: [1e-3, 1e3], attribute: [0.0, 1.0], unit_length: 2.0 };

    #[test]
    fn presets_parse_and_begin_invisible() {
        for (name, text) in PRESETS {
            let transfer = VolumeTransfer::parse(text, name).expect(name);
            assert_eq!(transfer.opacity.at(0.0), 0.0, "{name}: empty space is invisible");
            assert!(VolumeTransfer::presets().any(|preset| preset == *name));
        }
        assert!(VolumeTransfer::usual(true).hue.is_some() && VolumeTransfer::usual(false).hue.is_none());
    }

    #[test]
    fn mistakes_are_located_and_named() {
        let message = |text: &str| VolumeTransfer::parse(text, "my.ron").expect_err(text).to_string();
        let with = |opacity: &str| format!("(\n  opacity: {opacity},\n  brightness: [(0.0, 1.0)],\n)");
        for (text, expected) in [
            (
                with("[(0.0, 0.0), (0.7, 0.1), (0.5, 1.0)]"),
                ["my.ron:2:", "opacity", "not sorted: 0.7 comes before 0.5"],
            ),
            (with("[]"), ["my.ron:2:", "opacity", "no points"]),
            (with("[(0.0, 1.5)]"), ["my.ron:2:", "opacity", "point 1 is (0, 1.5)"]),
            ("(opacity: [(0.0, 0.0)])".into(), ["my.ron:1:", "brightness", "missing"]),
            (with("[(0.0, 1.0)], unit_length: fixed(-1.0)"), ["my.ron:2:", "unit_length", "unit length is -1"]),
            (with("[(0.0, 1.0)], rage: auto"), ["my.ron:2:", "rage", ""]),
        ] {
            let found = message(&text);
            assert!(expected.iter().all(|part| found.contains(part)), "{text:?} gave {found:?}");
        }
    }

    #[test]
    fn tables_follow_the_curves() {
        let text = "(range: auto, opacity: [(0.25, 0.0), (0.75, 0.5)], brightness: [(0.0, 0.0), (1.0, 1.0)], \
                    color_map: \"greys\")";
        let transfer = VolumeTransfer::parse(text, "t").unwrap();
        let classifier = Classifier::new(&transfer, LEVELS, false);
        for i in 0..=120 {
            let place = (i as f32 / 100.0 - 0.1).clamp(0.0, 1.0);
            let density = 10f64.powf(6.0 * (i as f64 / 100.0 - 0.1) - 3.0) as f32;
            let expected = -(-transfer.opacity.at(place)).ln_1p() / 2.0;
            let matter = classifier.matter(density, 0.0);
            assert!((matter.extinction - expected).abs() < 2e-3, "{place}: {} {expected}", matter.extinction);
            assert!(density > classifier.least() || matter.extinction == 0.0);
        }
        // The least visible density is at place 0.25, to an entry.
        assert!((classifier.least() / 10f32.powf(-1.5) - 1.0).abs() < 0.05);
    }

    #[test]
    fn hues_follow_the_attribute_and_brightness_the_density() {
        let transfer = VolumeTransfer::usual(true);
        let mut linear = transfer.clone();
        linear.hue = linear.hue.map(|hue| Hue { scale: super::super::super::transfer::Scale::Linear, ..hue });
        let classifier = Classifier::new(&linear, LEVELS, true);
        let light = |density: f32, s: f32| classifier.matter(density, s * density).color;
        let luminance = |[r, g, b]: [f32; 3]| 0.21 * r + 0.72 * g + 0.07 * b;
        assert!(luminance(light(500.0, 0.5)) > luminance(light(1.0, 0.5)));
        assert_ne!(light(500.0, 0.0), light(500.0, 1.0));
        assert!(!Classifier::new(&linear, LEVELS, false).has_hues());
    }

    #[test]
    fn light_is_encoded_and_decoded() {
        for i in 0..=255 {
            let encoded = i as f32 / 255.0;
            assert!((to_encoded(to_linear(encoded)) - encoded).abs() < 1e-5);
        }
    }
}
