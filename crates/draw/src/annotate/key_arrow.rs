//! The key of a picture's arrows, at the lower edge beside the legend: an arrow of a round length of vectors, to scale.

use super::display_list::{Anchor, Area, DisplayList, Rgba};
use super::{TEXT, legend, number};
use crate::model::Unit;

/// Distance of its tip from the right edge, logical pixels: beside the widest legend.
const BESIDE: f32 = 190.0;
/// What is left of it belongs to the scale bar.
const LEFT: f32 = 210.0;
/// Length of the barbs along the shaft and across it, logical pixels.
const BARB: [f32; 2] = [6.0, 3.5];
/// Behind the arrow.
const BACK: Rgba = [0, 0, 0, 150];

/// An arrow that says how long arrows are.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyArrow {
    /// Length of the vector: 1, 2 or 5 times a power of ten.
    pub value: f64,
    /// Its unit; empty where it is not known.
    pub unit: String,
    /// Length of the arrow, picture pixels.
    pub pixels: f64,
}

impl KeyArrow {
    /// The longest one of a round value that is no longer than arrows are apart, `spacing` pixels, which vectors of the length `scale` are; `None`
    /// where there are none.
    pub fn of(scale: f64, spacing: f64, unit: &Unit) -> Option<KeyArrow> {
        let value = number::round_below(scale)?;
        Some(KeyArrow { value, unit: legend::tidy(unit.0.clone()), pixels: spacing * value / scale })
    }
}

/// Adds the key, where there is room; `scale` is the number of picture pixels in a logical one.
pub fn layout(list: &mut DisplayList, arrow: &KeyArrow, scale: f32) {
    let [width, height] = list.size;
    let (right, y) = (width - BESIDE, height - 22.0);
    let left = right - arrow.pixels as f32 / scale;
    let text = format!("{} {}", number::quantity(arrow.value), arrow.unit);
    if left < LEFT || !list.text_if_free([0.5 * (left + right), y - 7.0], Anchor::BOTTOM, text.trim(), 13.0, TEXT) {
        return;
    }
    let [along, across] = BARB.map(|length| length.min(0.5 * (right - left)));
    for (width, color) in [(4.0, BACK), (1.5, TEXT)] {
        list.line([left, y], [right, y], width, color);
        list.line([right - along, y - across], [right, y], width, color);
        list.line([right - along, y + across], [right, y], width, color);
    }
    list.keep_free(Area { min: [left, y - 5.0], max: [right, y + 5.0] }.grown(4.0));
}

#[cfg(test)]
mod tests {
    use super::super::display_list::Shape;
    use super::*;

    #[test]
    fn the_key_is_round_and_to_scale() {
        for (scale, value) in [(173.0, 100.0), (0.2, 0.2), (7e-5, 5e-5)] {
            let arrow = KeyArrow::of(scale, 24.0, &Unit::new("km/s")).expect("a length");
            assert!((arrow.value / value - 1.0).abs() < 1e-9, "{arrow:?}");
            assert!((arrow.pixels * scale - 24.0 * value).abs() < 1e-9 * scale, "{arrow:?}");
            let mut list = DisplayList::new([800.0, 600.0]);
            layout(&mut list, &arrow, 2.0);
            let shaft = list.shapes.iter().find_map(|shape| match shape {
                Shape::Line { from, to, .. } if from[1] == to[1] => Some(to[0] - from[0]),
                _ => None,
            });
            assert!((f64::from(shaft.expect("a shaft")) - 0.5 * arrow.pixels).abs() < 1e-3, "{shaft:?}");
            assert!(
                list.shapes.iter().any(|shape| matches!(shape, Shape::Text { text, .. } if text.ends_with(" km/s")))
            );
        }
        assert_eq!(KeyArrow::of(0.0, 24.0, &Unit::default()), None);
        let mut small = DisplayList::new([300.0, 200.0]);
        layout(&mut small, &KeyArrow { value: 1.0, unit: String::new(), pixels: 24.0 }, 1.0);
        assert!(small.shapes.is_empty(), "there is no room beside the scale bar");
    }
}
