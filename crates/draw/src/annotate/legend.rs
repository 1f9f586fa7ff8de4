//! What the colours of a picture mean: quantities, units, ranges and scales, for the colour bar and the panel.

use super::display_list::Rgba;
use super::ticks::{Tick, ticks};
use super::{KeyArrow, number};
use crate::color::transfer::{Levels, Lut, Scale, TransferFunction};
use crate::cpu::slice::arrows::ArrowKey;
use crate::mode::{Depiction, OwnColors};
use crate::model::Unit;
use crate::modes::slice_overlay;
use crate::modes::volume_fields::DENSITY;
use crate::store::Metadata;
use std::sync::Arc;

/// One axis of the colours.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendAxis {
    /// The quantity.
    pub title: String,
    /// Its unit; empty where it is not known.
    pub unit: String,
    /// The values at the two ends.
    pub range: [f64; 2],
    /// Whether values are placed logarithmically.
    pub log: bool,
    /// Whether there are whole numbers alone.
    pub whole: bool,
}

impl LegendAxis {
    /// Marks along it: where all values are the same, that one in the middle, as it is coloured.
    pub fn ticks(&self) -> Vec<Tick> {
        let [low, high] = self.range;
        if low == high {
            return vec![Tick { place: 0.5, value: low, label: Some(number::quantity(low)) }];
        }
        let mut ticks = ticks(self.range, self.log);
        if self.whole {
            ticks.retain(|tick| (tick.value - tick.value.round()).abs() < 1e-6);
            ticks.iter_mut().for_each(|tick| tick.label = Some(number::quantity(tick.value.round())));
        }
        ticks
    }
}

/// Values of a legend's opacity.
const OPACITIES: usize = 49;

/// Units of what a depiction shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Units {
    /// Of masses.
    pub mass: Unit,
    /// Of positions.
    pub length: Unit,
    /// Of the attribute that colours the picture.
    pub attribute: Unit,
    /// What brightness shows.
    pub value: Shown,
    /// Of the vectors that are drawn.
    pub vector: Unit,
}

/// What the brightness of a picture shows, or its one axis of colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Shown {
    /// The mode's own quantity.
    #[default]
    Mode,
    /// What the data names so, and its unit.
    Named(String, Unit),
    /// Nothing that is measured: colours are the data's own.
    Colors,
}

impl Units {
    /// Those of some data.
    pub fn of(metadata: &Metadata, depiction: &Depiction) -> Units {
        let unit = |name: &str| {
            let families = metadata.families.iter();
            let mut columns = families.flat_map(|family| family.attributes.iter().chain(&family.quantities));
            columns.find(|info| info.name == name).map(|info| info.unit.clone()).unwrap_or_default()
        };
        let has = |name: &&str| {
            metadata.families.iter().any(|family| family.attributes.iter().any(|info| info.name == **name))
        };
        let weight = depiction.mode.weight_attributes;
        // Colours are the first field's, where they are not the mode's own quantity.
        let field = depiction.mode.technique.fields(&depiction.settings).into_iter().next();
        let value = match field.filter(|name| *name != DENSITY) {
            Some(name) => Shown::Named(name.replace('-', " "), unit(&name)),
            None if !weight.is_empty() && !weight.iter().any(has) => {
                Shown::Named("mass per pixel".into(), metadata.mass_unit.clone())
            }
            None => Shown::Mode,
        };
        Units {
            mass: metadata.mass_unit.clone(),
            length: metadata.length_unit.clone(),
            attribute: depiction.attribute.as_ref().map(|named| unit(&named.name)).unwrap_or_default(),
            value,
            vector: slice_overlay::columns(&depiction.settings).map(|[x, ..]| unit(&x)).unwrap_or_default(),
        }
    }
}

/// The axes of the colours, and the colours.
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// Brightness.
    pub p: LegendAxis,
    /// Hue, where it follows an attribute.
    pub s: Option<LegendAxis>,
    /// The colours over both.
    pub lut: Arc<Lut>,
    /// Opacity at evenly spaced places of the brightness' range, where that says more than the colours; else empty.
    pub opacity: Vec<f32>,
    /// How long arrows are, where there are some and that is known.
    pub arrow: Option<KeyArrow>,
}

impl Legend {
    /// What the colours of a depiction's pictures mean with these ranges in use; `None` where no axis tells it.
    pub fn told(
        depiction: &Depiction,
        transfer: &TransferFunction,
        lut: Arc<Lut>,
        levels: &Levels,
        units: &Units,
    ) -> Option<Legend> {
        if units.value == Shown::Colors {
            return None;
        }
        match depiction.mode.technique.own_colors(&depiction.settings, transfer) {
            None => Some(Legend::of(depiction, transfer, lut, levels, units)),
            Some(OwnColors::Names) => None,
            Some(OwnColors::Axis { title, is_length, is_whole, log, colors }) => {
                let unit = if is_length { tidy(units.length.0.clone()) } else { String::new() };
                let p = LegendAxis { title: capitalized(title), unit, range: levels.p, log, whole: is_whole };
                let lut = Arc::new(Lut { width: colors.len() as u32, height: 1, rgba: colors });
                Some(Legend { p, s: None, lut, opacity: Vec::new(), arrow: None })
            }
        }
    }

    /// What the colours of a transfer function mean with these ranges in use.
    pub fn of(
        depiction: &Depiction,
        transfer: &TransferFunction,
        lut: Arc<Lut>,
        levels: &Levels,
        units: &Units,
    ) -> Legend {
        let mode = depiction.mode;
        let (title, unit) = match &units.value {
            Shown::Named(name, unit) => (name.as_str(), unit.clone()),
            Shown::Mode | Shown::Colors => (mode.quantity, (mode.unit)(&units.mass, &units.length)),
        };
        let p = LegendAxis {
            title: capitalized(title),
            unit: tidy(unit.0),
            range: levels.p,
            log: transfer.scale == Scale::Log,
            whole: false,
        };
        let hue = transfer.hue.as_ref().zip(depiction.attribute.as_ref());
        let s = hue.map(|(hue, coloring)| LegendAxis {
            title: capitalized(&coloring.name.replace('-', " ")),
            unit: tidy(units.attribute.0.clone()),
            range: levels.s,
            log: hue.scale == Scale::Log,
            whole: false,
        });
        // A volume's opacity belongs to a length, and colours do not show it.
        let opacity = match mode.is_light() {
            true => (0..OPACITIES).map(|i| transfer.opacity_at(i as f32 / (OPACITIES - 1) as f32)).collect(),
            false => Vec::new(),
        };
        let arrow = slice_overlay::key(&depiction.settings);
        let arrow = arrow.and_then(|ArrowKey { scale, spacing }| KeyArrow::of(scale, spacing, &units.vector));
        Legend { p, s, lut, opacity, arrow }
    }

    /// The colour at a brightness and a hue, both within [0, 1].
    pub fn color(&self, brightness: f32, hue: f32) -> Rgba {
        let at = |share: f32, size: u32| (share.clamp(0.0, 1.0) * size.saturating_sub(1) as f32).round() as usize;
        let index = at(hue, self.lut.height) * self.lut.width as usize + at(brightness, self.lut.width);
        self.lut.rgba.get(index).copied().unwrap_or([0, 0, 0, 255])
    }
}

/// A name with a capital first letter.
fn capitalized(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A unit with superscripts in place of carets: `km^2` becomes `km²`.
pub fn tidy(unit: String) -> String {
    let mut text = String::with_capacity(unit.len());
    let mut raised = false;
    for c in unit.chars() {
        match (c, raised) {
            ('^', _) => raised = true,
            ('-', true) => text.push(number::MINUS),
            ('0'..='9', true) => {
                text.push(['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c as usize - '0' as usize])
            }
            _ => {
                raised = false;
                text.push(c);
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_have_whole_marks_and_one_value_has_one() {
        let axis = |range| LegendAxis { title: "Level".into(), unit: String::new(), range, log: false, whole: true };
        let labels = |range| axis(range).ticks().into_iter().filter_map(|tick| tick.label).collect::<Vec<_>>();
        assert_eq!(labels([2.0, 3.0]), ["2", "3"]);
        assert_eq!(labels([2.0, 2.0]), ["2"]);
        assert_eq!(labels([0.0, 12.0]), ["0", "5", "10"]);
        assert_eq!(axis([2.0, 2.0]).ticks()[0].place, 0.5);
    }

    #[test]
    fn units_and_names_are_typeset() {
        assert_eq!(tidy("(1e10 Msun)^2 / (kpc)^-5 K".into()), "(1e10 Msun)² / (kpc)¯⁵ K");
        assert_eq!(tidy("km/s".into()), "km/s");
        assert_eq!(capitalized("velocity dispersion"), "Velocity dispersion");
        assert_eq!(capitalized(""), "");
    }
}
