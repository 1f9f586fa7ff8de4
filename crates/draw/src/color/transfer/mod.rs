//! Transfer functions: brightness from `P` (or a volume's density), optionally hue from `S` (F12 3.5.4 and 4.5), as RON and
//! as lookup tables.
//!
//! A value is placed in its range, logarithmically as a rule. Piecewise linear curves over that place give brightness and
//! opacity; the colour comes from a colour map by the brightness, or has the attribute's hue and that brightness. Over the
//! plane of both places, regions change brightness, opacity and colour.

pub mod presets;

mod bake;
mod curve;
mod levels;
mod plane;
mod scale;
mod shore;

pub use bake::{Appearance, Lut, shade};
pub use curve::{Curve, MOST_POINTS};
pub use levels::Levels;
pub use plane::{Dye, Factors, MOST_FACTOR, MOST_REGIONS, Plane, Region};
pub use scale::{Range, Scale, UnitLength};

use super::colormap::ColorMap;
use crate::model::ron_file::{self, RonError};
use serde::{Deserialize, Serialize};

/// Hue from the attribute `S`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// From an accumulated picture, or from a volume's density and attribute, to colours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TransferFunction {
    /// Colours from dark to bright; unused when there is a hue.
    pub color_map: ColorMap,
    /// Whether dark and bright change places.
    pub reverse: bool,
    /// How `P` is placed in its range.
    pub scale: Scale,
    /// Range of `P`: `P_min` to `P_max` of F12 4.5; of a volume its density.
    pub range: Range,
    /// Exponent on the place of `P`; above 1 is more contrast in the bright parts.
    #[serde(deserialize_with = "positive")]
    pub gamma: f32,
    /// Brightness over the place of `P`. Where it is `None`: the place itself, for volumes a curve of their own.
    pub brightness: Option<Curve>,
    /// Opacity over the place of `P`, of volumes that of a unit length. Where it is `None`: opaque, for volumes a curve of
    /// their own.
    pub opacity: Option<Curve>,
    /// The length that a volume's opacity is meant for.
    pub unit_length: UnitLength,
    /// Hue from `S`, where the picture has one.
    pub hue: Option<Hue>,
    /// Changes over the plane of the places of `P` and `S`; counts where there is a hue.
    pub plane: Plane,
}

impl Default for TransferFunction {
    fn default() -> TransferFunction {
        TransferFunction {
            color_map: ColorMap::default(),
            reverse: false,
            scale: Scale::Log,
            range: Range::Auto,
            gamma: 1.0,
            brightness: None,
            opacity: None,
            unit_length: UnitLength::Auto,
            hue: None,
            plane: Plane::default(),
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

impl TransferFunction {
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

    /// The one that volumes begin with, with an attribute or without.
    pub fn of_volumes(attribute: bool) -> TransferFunction {
        TransferFunction::preset(if attribute { "volume-hue" } else { "volume" }).unwrap_or_default().for_volume()
    }

    /// The one that volumes of measured values begin with, with an attribute or without.
    pub fn of_values(attribute: bool) -> TransferFunction {
        let plain = TransferFunction::preset("volume-values").unwrap_or_default();
        let hue = attribute.then(|| TransferFunction::preset("volume-hue").and_then(|colored| colored.hue)).flatten();
        TransferFunction { hue, ..plain }
    }

    /// With the curves that volumes have where none are set.
    pub fn for_volume(self) -> TransferFunction {
        TransferFunction {
            brightness: self.brightness.or_else(|| Some(Curve::usual_brightness())),
            opacity: self.opacity.or_else(|| Some(Curve::usual_opacity())),
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Accumulation;

    #[test]
    fn what_is_written_reads_back() {
        let text = "(brightness: [(0.0, 0.1), (0.5, 0.9)], opacity: [(0.25, 0.5)], unit_length: fixed(2.0), hue: (), \
                    color_map: [(0.0, \"#000000\"), (1.0, \"#80ff00\")], \
                    plane: (opacity: 0.5, regions: [(at: (0.5, 0.5), radius: (0.1, 0.2), color: \"#ff0000\")]))";
        let all = TransferFunction::parse(text, "x").expect("all fields");
        assert!(all.plane.regions.len() == 1 && all.color_map.stops().is_some());
        assert_eq!(TransferFunction::parse(&all.to_ron(), "x").expect("own text"), all);
        // A name that is wrong by a letter is refused, whichever it is, and named with its place.
        let written = all.to_ron();
        let (mut fields, mut before) = (0, 0);
        for (at, _) in written.match_indices(": ") {
            let start = written[..at].rfind(|c: char| !c.is_alphanumeric() && c != '_').map_or(0, |start| start + 1);
            let name = &written[start..at];
            if name.is_empty() || start < before {
                continue;
            }
            before = at;
            let wrong = format!("{}{name}x{}", &written[..start], &written[at..]);
            let message = TransferFunction::parse(&wrong, "t.ron").expect_err(&wrong).to_string();
            assert!(message.starts_with("t.ron:") && message.contains(&format!("{name}x")), "{name}: {message}");
            fields += 1;
        }
        assert!(fields > 20, "{fields}");
    }

    #[test]
    fn tables_are_the_function() {
        let text = "(brightness: [(0.0, 0.1), (0.5, 0.9), (1.0, 1.0)], opacity: [(0.0, 0.2), (1.0, 1.0)], gamma: 1.3, \
                    hue: (color_map: \"plasma\", reverse: true), \
                    plane: (brightness: 0.7, regions: [(at: (0.6, 0.4), radius: (0.3, 0.4), opacity: 0.5, color: \"#30ff00\")]))";
        let function = TransferFunction::parse(text, "x").expect("right");
        let (opaque, colors, transparent) = (function.bake_lut(), function.bake_colors(), function.bake_transparent());
        for (row, column) in (0..64).step_by(7).flat_map(|row| (0..512).step_by(31).map(move |column| (row, column))) {
            let found = function.appearance(column as f32 / 511.0, row as f32 / 63.0);
            let index = row * 512 + column;
            for k in 0..3 {
                let byte = |share: f32| (255.0 * share).round() as i32;
                assert!((i32::from(colors.rgba[index][k]) - byte(found.color[k])).abs() <= 2, "{row} {column}");
                assert!((i32::from(opaque.rgba[index][k]) - byte(found.color[k] * found.opacity)).abs() <= 2);
            }
            assert_eq!(transparent.rgba[index][3], (255.0 * found.opacity).round() as u8);
        }
    }

    #[test]
    fn fixed_ranges_read_back() {
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
                let function = TransferFunction { scale, ..function.clone() };
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
        // Volumes are dark where they are transparent, not where they are thin; surfaces where they are in the shade.
        let is_of_sums =
            |name: &&str| !name.starts_with("volume") && !["terrain", "land", "signed", "cyclic"].contains(name);
        for name in TransferFunction::presets().filter(is_of_sums) {
            let lut = TransferFunction::preset(name).expect(name).bake_lut();
            assert_eq!(lut.rgba.len(), (lut.width * lut.height) as usize);
            for row in lut.rgba.chunks(lut.width as usize) {
                assert!(luminance(row[0]) < 12.0 && luminance(row[row.len() - 1]) > 180.0, "{name}: {row:?}");
                assert!(row.windows(65).all(|w| luminance(w[64]) > luminance(w[0])), "{name} is not monotonic");
            }
        }
    }
}
