//! Transfer functions: brightness from `P`, optionally hue from `S` (F12 4.5), as RON and as a lookup table.

use super::Accumulation;
use super::colormap::{ColorMap, Rgb};
use crate::model::ron_file::{self, RonError};
use colorgrad::Color;
use serde::{Deserialize, Serialize};

/// How a value is placed between the ends of its range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// `log(v / min) / log(max / min)` (F12 4.5).
    #[default]
    Log,
    /// `(v - min) / (max - min)`.
    Linear,
}

impl Scale {
    /// Where `value` lies between `min` and `max`, within [0, 1]; 0 for NaN, and for values at or below zero on a
    /// logarithmic scale.
    pub fn place(self, value: f32, [min, max]: [f64; 2]) -> f32 {
        let value = f64::from(value);
        let place = match self {
            Scale::Log if value <= 0.0 => 0.0,
            Scale::Log => (value / min).ln() / (max / min).ln(),
            Scale::Linear => (value - min) / (max - min),
        };
        if place > 0.0 { place.min(1.0) as f32 } else { 0.0 }
    }

    /// A range that [`Scale::place`] can work with: ascending, and positive on a logarithmic scale.
    pub fn usable(self, [min, max]: [f64; 2]) -> [f64; 2] {
        match self {
            Scale::Log if max <= 0.0 => [1e-6, 1.0],
            Scale::Log if min <= 0.0 => [1e-6 * max, max],
            Scale::Log if min >= max => [0.1 * max, max],
            Scale::Linear if min >= max => [min, min + min.abs().max(1e-30)],
            _ => [min, max],
        }
    }
}

/// The interval of values that a transfer function spreads its colours over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "RangeText", into = "RangeText")]
pub enum Range {
    /// From the picture's own percentiles.
    #[default]
    Auto,
    /// From `min` to `max`, `min < max`.
    Fixed(f64, f64),
}

/// A range as it is written: checked when it becomes a [`Range`].
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", rename = "Range")]
enum RangeText {
    Auto,
    Fixed(f64, f64),
}

impl TryFrom<RangeText> for Range {
    type Error = String;

    fn try_from(text: RangeText) -> Result<Range, String> {
        match text {
            RangeText::Auto => Ok(Range::Auto),
            RangeText::Fixed(min, max) if min < max && min.is_finite() && max.is_finite() => Ok(Range::Fixed(min, max)),
            RangeText::Fixed(min, max) => {
                Err(format!("range from {min} to {max}, expected two finite numbers in ascending order"))
            }
        }
    }
}

impl From<Range> for RangeText {
    fn from(range: Range) -> RangeText {
        match range {
            Range::Auto => RangeText::Auto,
            Range::Fixed(min, max) => RangeText::Fixed(min, max),
        }
    }
}

/// Hue from the attribute `S`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Hue {
    /// Colours from low to high `S`; their hue and chroma count, the lightness comes from `P`.
    pub color_map: ColorMap,
    /// Whether high and low change places.
    pub reverse: bool,
    /// The part of the map that is used, within [0, 1].
    pub span: (f32, f32),
    /// How `S` is placed in its range.
    pub scale: Scale,
    /// Range of `S`.
    pub range: Range,
}

impl Default for Hue {
    fn default() -> Hue {
        Hue { color_map: ColorMap::default(), reverse: false, span: (0.0, 1.0), scale: Scale::Log, range: Range::Auto }
    }
}

/// From an accumulated picture to colours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TransferFunction {
    /// Colours from dark to bright; unused when there is a hue.
    pub color_map: ColorMap,
    /// Whether dark and bright change places.
    pub reverse: bool,
    /// How `P` is placed in its range.
    pub scale: Scale,
    /// Range of `P`: `P_min` to `P_max` of F12 4.5.
    pub range: Range,
    /// Exponent on the brightness after scaling; above 1 is more contrast in the bright parts.
    #[serde(deserialize_with = "positive")]
    pub gamma: f32,
    /// Hue from `S`, where the picture has one.
    pub hue: Option<Hue>,
}

impl Default for TransferFunction {
    fn default() -> TransferFunction {
        TransferFunction {
            color_map: ColorMap::default(),
            reverse: false,
            scale: Scale::Log,
            range: Range::Auto,
            gamma: 1.0,
            hue: None,
        }
    }
}

fn positive<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    let value = f32::deserialize(deserializer)?;
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(serde::de::Error::custom(format!("gamma is {value}, expected a positive number")))
}

/// The ranges in use for one picture, with [`Range::Auto`] replaced by numbers. `min < max`, both positive on a
/// logarithmic scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Levels {
    /// `P_min`, `P_max`.
    pub p: [f64; 2],
    /// Ends of the range of `S`.
    pub s: [f64; 2],
}

/// A baked transfer function: brightness along rows, hue down columns, sRGB-encoded.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut {
    /// Brightness steps; texel `i` belongs to brightness `i / (width - 1)`.
    pub width: u32,
    /// Hue steps; texel `j` belongs to `S` at `j / (height - 1)` of its range. 1 without hue.
    pub height: u32,
    /// RGBA8, gamma-encoded (store it as a UNORM texture to sample encoded values), row by row from low `S`.
    pub rgba: Vec<[u8; 4]>,
}

/// Presets: one file each under `assets/transfer`.
const PRESETS: &[(&str, &str)] = &[
    ("density", include_str!("../../assets/transfer/density.ron")),
    ("density-hue", include_str!("../../assets/transfer/density-hue.ron")),
    ("stars", include_str!("../../assets/transfer/stars.ron")),
];

impl TransferFunction {
    /// Brightness steps of a baked table.
    pub const LUT_WIDTH: u32 = 512;
    /// Hue steps of a baked table that has a hue.
    pub const LUT_HEIGHT: u32 = 64;

    /// Reads RON; `file` is what messages call it.
    ///
    /// # Errors
    /// [`RonError::Syntax`] with line and column.
    pub fn parse(text: &str, file: &str) -> Result<TransferFunction, RonError> {
        ron_file::parse(file, text)
    }

    /// RON that reads back as this transfer function.
    pub fn to_ron(&self) -> String {
        // Plain numbers, names and options always have a RON form.
        ron::ser::to_string_pretty(self, ron::ser::PrettyConfig::default()).unwrap_or_default()
    }

    /// Names of the built-in transfer functions.
    pub fn presets() -> impl Iterator<Item = &'static str> {
        PRESETS.iter().map(|(name, _)| *name)
    }

    /// A built-in transfer function.
    pub fn preset(name: &str) -> Option<TransferFunction> {
        let (_, text) = PRESETS.iter().find(|(known, _)| *known == name)?;
        TransferFunction::parse(text, name).ok()
    }

    /// The ranges for a picture. Automatic ones come from percentiles of the pixels where anything was drawn (for `S`:
    /// of those that are not black), and never are empty. On a logarithmic scale a range that is not positive becomes
    /// the six decades below its maximum.
    pub fn levels(&self, picture: &Accumulation) -> Levels {
        let p = match self.range {
            Range::Fixed(min, max) => self.scale.usable([min, max]),
            Range::Auto => {
                let above = |least: f64| picture.p.iter().copied().filter(move |&p| f64::from(p) > least);
                let [max] = percentiles(above(0.0), [0.9995]);
                // The least that a scale begins with. What is fainter does not count below either: it is as much the
                // interpolation's ringing as light.
                let least = 1e-6 * max;
                let [quarter] = percentiles(above(least), [0.25]);
                // A little below the first quarter: the faint rims of kernels would waste most of the scale.
                let min = (0.25 * quarter).max(least);
                self.scale.usable([if self.scale == Scale::Log { min } else { 0.0 }, max])
            }
        };
        let hue = self.hue.unwrap_or_default();
        let s = match hue.range {
            Range::Fixed(min, max) => hue.scale.usable([min, max]),
            Range::Auto => {
                let pairs = picture.p.iter().zip(&picture.ps);
                let lit = pairs.filter(|&(&value, _)| f64::from(value) > p[0]).map(|(&value, &ps)| ps / value);
                hue.scale.usable(percentiles(lit, [0.02, 0.98]))
            }
        };
        Levels { p, s }
    }

    /// The table of colours.
    pub fn bake_lut(&self) -> Lut {
        let width = TransferFunction::LUT_WIDTH;
        let brightness = |i: u32| {
            let b = (i as f32 / (width - 1) as f32).powf(self.gamma);
            if self.reverse { 1.0 - b } else { b }
        };
        let bytes = |[r, g, b]: Rgb| [r, g, b, 1.0].map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8);
        let Some(hue) = self.hue else {
            let colors = self.color_map.sample(4 * width as usize);
            let rgba = (0..width)
                .map(|i| bytes(colors[(brightness(i) * (colors.len() - 1) as f32).round() as usize]))
                .collect();
            return Lut { width, height: 1, rgba };
        };
        let height = TransferFunction::LUT_HEIGHT;
        let mut hues = hue.color_map.sample_span(hue.span, height as usize);
        if hue.reverse {
            hues.reverse();
        }
        let rgba = hues.into_iter().flat_map(|hue| (0..width).map(move |i| bytes(shade(hue, brightness(i))))).collect();
        Lut { width, height, rgba }
    }
}

/// Values at two shares of the sorted finite values; zeros for none. At most a few hundred thousand values are looked
/// at, evenly spread.
fn percentiles<const N: usize>(values: impl Iterator<Item = f32>, shares: [f64; N]) -> [f64; N] {
    const ENOUGH: usize = 1 << 18;
    let mut sample: Vec<f32> = values.filter(|value| value.is_finite()).collect();
    if sample.len() > 2 * ENOUGH {
        let step = sample.len() / ENOUGH;
        sample = sample.into_iter().step_by(step).collect();
    }
    if sample.is_empty() {
        return [0.0; N];
    }
    shares.map(|share| {
        let rank = ((sample.len() - 1) as f64 * share).round() as usize;
        f64::from(*sample.select_nth_unstable_by(rank, f32::total_cmp).1)
    })
}

/// A colour of the given hue at brightness `b`: lightness follows `b` in Oklab, chroma rises from black, holds, and falls
/// towards white, as far as sRGB reaches.
fn shade([r, g, b]: Rgb, brightness: f32) -> Rgb {
    let [_, along_a, along_b, _] = Color::new(r, g, b, 1.0).to_oklaba();
    let lightness = 0.98 * brightness;
    let mut chroma = 0.95 * (4.0 * brightness * (1.0 - brightness)).powf(0.55).min(1.0);
    loop {
        let color = Color::from_oklaba(lightness, chroma * along_a, chroma * along_b, 1.0);
        let rgb = [color.r, color.g, color.b];
        if chroma < 1e-3 || rgb.iter().all(|component| (-1e-3..=1.001).contains(component)) {
            return rgb.map(|component| component.clamp(0.0, 1.0));
        }
        chroma *= 0.94;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_parse_and_round_trip() {
        for (name, text) in PRESETS {
            let function = TransferFunction::parse(text, name).expect(name);
            assert_eq!(TransferFunction::parse(&function.to_ron(), name).expect(name), function);
        }
        let fixed = TransferFunction { range: Range::Fixed(1e-3, 7.5), gamma: 1.5, ..TransferFunction::default() };
        assert_eq!(TransferFunction::parse(&fixed.to_ron(), "x").expect("own text"), fixed);
    }

    #[test]
    fn mistakes_are_located_and_named() {
        let message = |text: &str| TransferFunction::parse(text, "my.ron").expect_err(text).to_string();
        for (text, expected) in [
            ("(\n  colour_map: \"inferno\",\n)", ["my.ron:2:", "colour_map"]),
            ("(\n\n  color_map: \"infern\",\n)", ["my.ron:3:", "no colour map `infern`"]),
            ("(range: fixed(3.0, 1.0))", ["my.ron:1:", "range from 3 to 1"]),
            ("(gamma: -1.0)", ["my.ron:1:", "gamma is -1"]),
            ("(scale: cubic)", ["my.ron:1:", "cubic"]),
            ("(hue: Some((color: 1)))", ["my.ron:1:", "color"]),
            ("(", ["my.ron:1:", ""]),
        ] {
            let found = message(text);
            assert!(expected.iter().all(|part| found.contains(part)), "{text:?} gave {found:?}");
        }
    }

    #[test]
    fn brightness_is_the_papers_logarithm() {
        let range = [1e-3, 1e3];
        for (value, expected) in [(1e-3, 0.0), (1.0, 0.5), (1e3, 1.0), (1e9, 1.0), (0.0, 0.0), (-1.0, 0.0)] {
            assert!((Scale::Log.place(value, range) - expected).abs() < 1e-6, "{value}");
        }
        assert_eq!(Scale::Linear.place(f32::NAN, range), 0.0);
        assert_eq!(Scale::Linear.place(3.0, [1.0, 5.0]), 0.5);
    }

    #[test]
    fn levels_are_never_empty() {
        let function = TransferFunction { hue: Some(Hue::default()), ..TransferFunction::default() };
        for (p, ps) in
            [(vec![0.0; 4], vec![0.0; 4]), (vec![2.0; 4], vec![2.0; 4]), (vec![f32::INFINITY; 4], vec![f32::NAN; 4])]
        {
            for scale in [Scale::Log, Scale::Linear] {
                let function = TransferFunction { scale, ..function };
                let levels = function.levels(&Accumulation { width: 2, height: 2, p: p.clone(), ps: ps.clone() });
                assert!(
                    levels.p[0] < levels.p[1] && levels.s[0] < levels.s[1] && levels.p[1].is_finite(),
                    "{levels:?}"
                );
            }
        }
    }

    #[test]
    fn tables_rise_from_black_to_bright() {
        let luminance = |[r, g, b, _]: [u8; 4]| 0.21 * f32::from(r) + 0.72 * f32::from(g) + 0.07 * f32::from(b);
        for name in TransferFunction::presets() {
            let lut = TransferFunction::preset(name).expect(name).bake_lut();
            assert_eq!(lut.rgba.len(), (lut.width * lut.height) as usize);
            for row in lut.rgba.chunks(lut.width as usize) {
                assert!(luminance(row[0]) < 12.0 && luminance(row[row.len() - 1]) > 180.0, "{name}: {row:?}");
                assert!(row.windows(65).all(|w| luminance(w[64]) > luminance(w[0])), "{name} is not monotonic");
            }
        }
    }
}
