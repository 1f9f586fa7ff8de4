//! Transfer functions for volumes as tables: what density (and an attribute) emit and absorb (F12 3.5.4).
//!
//! Density is placed logarithmically in its range; piecewise linear curves over that place give the opacity per unit
//! length and the brightness. The colour comes from a colour map by the brightness, or, where an attribute is drawn, has
//! the attribute's hue and the density's brightness.

use crate::color::colors::to_linear;
use crate::color::transfer::{Curve, Hue, Scale, TransferFunction, shade};
use crate::cpu::field::ValueAxis;
use rayon::prelude::*;

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
    /// Colour and factor on the extinction for each hue, from the low end of the densities to the high one; empty where the
    /// plane of densities and attributes has no regions.
    plane: Vec<[f32; 4]>,
    hue: Hue,
    levels: VolumeLevels,
    least: f32,
    /// Whether entries lie evenly between 1 and 2 ([`ValueAxis`]), not by leading bits.
    is_even: bool,
}

/// Entries of a table of values.
pub const VALUES: usize = 4096;

/// What a [`Classifier`] looks up.
#[derive(Clone, Copy, Debug)]
pub struct Tables<'a> {
    /// The leading bits of the first entry's density.
    pub first: u32,
    /// Extinction and colour of each density; or its brightness and its place in the range in place of the colour where there
    /// are hues.
    pub densities: &'a [[f32; 4]],
    /// [`BRIGHTNESSES`] colours of each of [`HUES`] hues, from dark to bright; empty without hues.
    pub hues: &'a [[f32; 3]],
    /// Colour and factor on the extinction of [`BRIGHTNESSES`] places of the density for each of [`HUES`] hues; empty where
    /// these follow from the density's brightness alone.
    pub plane: &'a [[f32; 4]],
    /// How an attribute is placed among the hues.
    pub scale: Scale,
    /// Attribute at the ends of the hues.
    pub attribute: [f64; 2],
}

impl Classifier {
    /// Tables of a transfer function; hues count only if the picture has an attribute.
    pub fn new(transfer: &TransferFunction, levels: VolumeLevels, attribute: bool) -> Classifier {
        let bits = |density: f64| (density as f32).max(f32::MIN_POSITIVE).to_bits() >> HIDDEN_BITS;
        let (first, last) = (bits(levels.density[0]), bits(levels.density[1]) + 1);
        let densities = (first..=last.max(first + 1)).map(|index| f32::from_bits(index << HIDDEN_BITS));
        let mut classifier = Classifier::of(transfer, levels, attribute, densities.collect());
        classifier.first = first;
        let visible = classifier.table.iter().position(|entry| entry[0] > 0.0);
        classifier.least = match visible {
            Some(0) => f32::MIN_POSITIVE,
            Some(index) => f32::from_bits((first + index as u32 - 1) << HIDDEN_BITS),
            None => f32::INFINITY,
        };
        classifier
    }

    /// The same for values on an axis, whatever their sign, in place of densities: light is the colour map's at the value's place, times
    /// the brightness there; where there are hues, it is as of densities.
    pub fn of_values(
        transfer: &TransferFunction,
        levels: VolumeLevels,
        attribute: bool,
        axis: &ValueAxis,
    ) -> Classifier {
        if transfer.hue.is_none() || !attribute {
            let even = TransferFunction { brightness: Some(Curve::identity()), ..transfer.clone() };
            let mut classifier = Classifier::of_hues(&even, levels, false, axis);
            if let Some(brightness) = &transfer.brightness {
                for (index, entry) in classifier.table.iter_mut().enumerate() {
                    let value = axis.value(1.0 + index as f32 / (VALUES - 1) as f32) as f32;
                    let factor = brightness.at(transfer.scale.place(value, levels.density));
                    entry[1..].iter_mut().for_each(|light| *light *= factor);
                }
            }
            return classifier;
        }
        Classifier::of_hues(transfer, levels, attribute, axis)
    }

    /// Tables of values whose light goes by a brightness.
    fn of_hues(transfer: &TransferFunction, levels: VolumeLevels, attribute: bool, axis: &ValueAxis) -> Classifier {
        let place = |index: usize| 1.0 + index as f32 / (VALUES - 1) as f32;
        let values = (0..VALUES).map(|index| axis.value(place(index)) as f32).collect();
        let mut classifier = Classifier::of(transfer, levels, attribute, values);
        classifier.is_even = true;
        classifier.least = match classifier.table.iter().position(|entry| entry[0] > 0.0) {
            Some(0) => ValueAxis::NOTHING,
            Some(index) => place(index - 1),
            None => f32::INFINITY,
        };
        classifier
    }

    /// Tables with an entry for each of some densities.
    fn of(transfer: &TransferFunction, levels: VolumeLevels, attribute: bool, densities: Vec<f32>) -> Classifier {
        let [min, max] = levels.density;
        let usual = (Curve::usual_opacity(), Curve::usual_brightness());
        let opacity = transfer.opacity.as_ref().unwrap_or(&usual.0);
        let brightness = transfer.brightness.as_ref().unwrap_or(&usual.1);
        let brightness_at = |place: f32| {
            let brightness = brightness.at(place.powf(transfer.gamma));
            if transfer.reverse { 1.0 - brightness } else { brightness }
        };
        let hue = transfer.hue.as_ref().filter(|_| attribute);
        let colors = transfer.color_map.sample(1024);
        let unit = levels.unit_length as f32;
        let entry = |density: f32| {
            let place = transfer.scale.place(density, [min, max]);
            let extinction = -(-opacity.at(place).min(MOST_OPAQUE)).ln_1p() / unit;
            let brightness = brightness_at(place);
            let [r, g, b] = match hue {
                Some(_) => [brightness, place, 0.0],
                None => colors[(brightness * 1023.0).round() as usize].map(to_linear),
            };
            [extinction, r, g, b]
        };
        let table: Vec<[f32; 4]> = densities.into_iter().map(entry).collect();
        let hues = hue.map_or(Vec::new(), |hue| {
            let function = TransferFunction { hue: Some(hue.clone()), ..TransferFunction::default() };
            let lut = function.bake_lut();
            let texel = |hue: usize, brightness: usize| {
                let row = hue * (lut.height as usize - 1) / (HUES - 1);
                let column = brightness * (lut.width as usize - 1) / (BRIGHTNESSES - 1);
                let [r, g, b, _] = lut.rgba[row * lut.width as usize + column];
                [r, g, b].map(|byte| to_linear(f32::from(byte) / 255.0))
            };
            (0..HUES * BRIGHTNESSES).map(|index| texel(index / BRIGHTNESSES, index % BRIGHTNESSES)).collect()
        });
        let plane = match hue {
            Some(hue) if !transfer.plane.is_plain() => {
                let colors = hue.colors(HUES);
                let share = |index: usize, count: usize| index as f32 / (count - 1) as f32;
                let texel = |index: usize| {
                    let (row, column) = (index / BRIGHTNESSES, index % BRIGHTNESSES);
                    let (p, s) = (share(column, BRIGHTNESSES), share(row, HUES));
                    let factors = transfer.plane.factors(p, s);
                    let brightness = (brightness_at(p) * factors.brightness).clamp(0.0, 1.0);
                    let [r, g, b] = shade(factors.dye.mix(colors[row]), brightness).map(to_linear);
                    [r, g, b, factors.opacity]
                };
                (0..HUES * BRIGHTNESSES).into_par_iter().map(texel).collect()
            }
            _ => Vec::new(),
        };
        let hue = hue.cloned().unwrap_or_default();
        Classifier { first: 0, table, hues, plane, hue, levels, least: f32::INFINITY, is_even: false }
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
    #[inline(always)]
    pub fn matter(&self, density: f32, weighted: f32) -> Matter {
        let bits = density.to_bits();
        let index = (bits >> HIDDEN_BITS).saturating_sub(self.first) as usize;
        let (index, share) = match index < self.table.len() - 1 {
            _ if self.is_even => {
                let place = ((density - 1.0) * (VALUES - 1) as f32).clamp(0.0, (VALUES - 1) as f32);
                let index = (place as usize).min(self.table.len() - 2);
                (index, place - index as f32)
            }
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
        if self.plane.is_empty() {
            return Matter { extinction, color: self.tinted(weighted / density, r) };
        }
        let [r, g, b, factor] = self.plane[self.row(weighted / density) + column(g)];
        Matter { extinction: extinction * factor, color: [r, g, b] }
    }

    /// Where the hues of an attribute's value begin.
    fn row(&self, attribute: f32) -> usize {
        let place = self.hue.scale.place(attribute, self.levels.attribute);
        (place * (HUES - 1) as f32).round() as usize * BRIGHTNESSES
    }

    /// The colour of an attribute's value at a brightness; of the densities' middle without hues.
    pub fn tinted(&self, attribute: f32, brightness: f32) -> [f32; 3] {
        self.hues.get(self.row(attribute) + column(brightness)).copied().unwrap_or([1.0; 3])
    }

    /// The tables, for those who look things up elsewhere.
    pub fn tables(&self) -> Tables<'_> {
        Tables {
            first: self.first,
            densities: &self.table,
            hues: &self.hues,
            plane: &self.plane,
            scale: self.hue.scale,
            attribute: self.levels.attribute,
        }
    }

    /// Whether colours follow an attribute.
    pub fn has_hues(&self) -> bool {
        !self.hues.is_empty()
    }
}

/// Where a brightness or a place is among [`BRIGHTNESSES`].
fn column(brightness: f32) -> usize {
    ((brightness * (BRIGHTNESSES - 1) as f32).round() as usize).min(BRIGHTNESSES - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::colormap::HexColor;
    use crate::color::colors::to_encoded;
    use crate::color::transfer::{Plane, Region};

    const LEVELS: VolumeLevels = VolumeLevels { density: [1e-3, 1e3], attribute: [0.0, 1.0], unit_length: 2.0 };

    #[test]
    fn presets_parse_and_begin_invisible() {
        for name in ["volume", "volume-hue"] {
            let transfer = TransferFunction::preset(name).expect(name);
            assert_eq!(transfer.opacity_at(0.0), 0.0, "{name}: empty space is invisible");
        }
        assert!(TransferFunction::of_volumes(true).hue.is_some() && TransferFunction::of_volumes(false).hue.is_none());
    }

    #[test]
    fn mistakes_are_located_and_named() {
        let message = |text: &str| TransferFunction::parse(text, "my.ron").expect_err(text).to_string();
        let with = |opacity: &str| format!("(\n  opacity: {opacity},\n  brightness: [(0.0, 1.0)],\n)");
        for (text, expected) in [
            (
                with("[(0.0, 0.0), (0.7, 0.1), (0.5, 1.0)]"),
                ["my.ron:2:", "opacity", "not sorted: 0.7 comes before 0.5"],
            ),
            (with("[]"), ["my.ron:2:", "opacity", "no points"]),
            (with("[(0.0, 1.5)]"), ["my.ron:2:", "opacity", "point 1 is (0, 1.5)"]),
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
        let transfer = TransferFunction::parse(text, "t").unwrap();
        let classifier = Classifier::new(&transfer, LEVELS, false);
        for i in 0..=120 {
            let place = (i as f32 / 100.0 - 0.1).clamp(0.0, 1.0);
            let density = 10f64.powf(6.0 * (i as f64 / 100.0 - 0.1) - 3.0) as f32;
            let expected = -(-transfer.opacity_at(place)).ln_1p() / 2.0;
            let matter = classifier.matter(density, 0.0);
            assert!((matter.extinction - expected).abs() < 2e-3, "{place}: {} {expected}", matter.extinction);
            assert!(density > classifier.least() || matter.extinction == 0.0);
        }
        // The least visible density is at place 0.25, to an entry.
        assert!((classifier.least() / 10f32.powf(-1.5) - 1.0).abs() < 0.05);
    }

    #[test]
    fn hues_follow_the_attribute_and_brightness_the_density() {
        let transfer = TransferFunction::of_volumes(true);
        let mut linear = transfer.clone();
        linear.hue = linear.hue.map(|hue| Hue { scale: Scale::Linear, ..hue });
        let classifier = Classifier::new(&linear, LEVELS, true);
        let light = |density: f32, s: f32| classifier.matter(density, s * density).color;
        let luminance = |[r, g, b]: [f32; 3]| 0.21 * r + 0.72 * g + 0.07 * b;
        assert!(luminance(light(500.0, 0.5)) > luminance(light(1.0, 0.5)));
        assert_ne!(light(500.0, 0.0), light(500.0, 1.0));
        assert!(!Classifier::new(&linear, LEVELS, false).has_hues());
    }

    #[test]
    fn a_plane_is_what_it_says() {
        let region = Region {
            brightness: 0.8,
            opacity: 3.0,
            color: Some(HexColor([40, 200, 90])),
            ..Region::new((0.7, 0.6), (0.25, 0.3))
        };
        let plane = Plane { brightness: 0.6, opacity: 0.25, regions: vec![region] };
        let usual = TransferFunction::of_volumes(true);
        let linear = usual.hue.clone().map(|hue| Hue { scale: Scale::Linear, ..hue });
        let plain = TransferFunction { hue: linear.clone(), ..usual.clone() };
        let transfer = TransferFunction { hue: linear, plane, ..usual };
        let [plain, planar] = [&plain, &transfer].map(|function| Classifier::new(function, LEVELS, true));
        for (i, j) in (0..40).flat_map(|i| (0..21).map(move |j| (i, j))) {
            let (p, s) = ((i as f32 + 0.5) / 40.0, j as f32 / 20.0);
            let density = 10f32.powf(6.0 * p - 3.0);
            let [before, after] = [&plain, &planar].map(|classifier| classifier.matter(density, s * density));
            let factors = transfer.plane.factors(p, s);
            // The table has 64 hues and 256 places, and the region fades over an eighth of the plane.
            let expected = before.extinction * factors.opacity;
            assert!((after.extinction - expected).abs() <= 0.25 * before.extinction + 1e-6, "{p} {s}");
            let color = transfer.appearance(p, s).color.map(to_linear);
            assert!((0..3).all(|k| (after.color[k] - color[k]).abs() < 0.12), "{p} {s}: {:?} {color:?}", after.color);
        }
        assert!(Classifier::new(&transfer, LEVELS, false).tables().plane.is_empty());
    }

    #[test]
    fn light_is_encoded_and_decoded() {
        for i in 0..=255 {
            let encoded = i as f32 / 255.0;
            assert!((to_encoded(to_linear(encoded)) - encoded).abs() < 1e-5);
        }
    }
}
