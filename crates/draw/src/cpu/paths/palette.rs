//! Colours of paths: what they follow, and how values become them.

use crate::color::colors::to_linear;
use crate::color::transfer::Scale;
use std::sync::LazyLock;

/// What the colour of a path follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Quantity {
    /// How fast it goes.
    #[default]
    Speed,
    /// Where it goes: red, green and blue are the shares of the axes.
    Direction,
    /// Its mass.
    Mass,
    /// When it is there: from the end of the tail to that of the lead.
    Time,
    /// The values that come with the curves.
    Value,
    /// Nothing: this colour, gamma-encoded sRGB.
    Plain([u8; 3]),
}

/// How a quantity becomes a colour.
#[derive(Clone, Debug)]
pub struct Palette {
    /// What is coloured.
    pub quantity: Quantity,
    /// Colours from the smallest to the largest value, gamma-encoded sRGB; never empty.
    pub colors: Vec<[u8; 3]>,
    /// How values are placed.
    pub scale: Scale,
    /// Between which ends.
    pub range: [f64; 2],
}

impl Palette {
    /// One colour.
    pub fn plain(color: [u8; 3]) -> Palette {
        Palette { quantity: Quantity::Plain(color), colors: vec![color], scale: Scale::Linear, range: [0.0, 1.0] }
    }

    /// The colour of a value.
    #[inline]
    pub fn of_value(&self, value: f32) -> [u8; 3] {
        let last = self.colors.len().saturating_sub(1);
        let place = self.scale.place(value, self.range);
        self.colors.get((place * last as f32).round() as usize).copied().unwrap_or([255; 3])
    }

    /// The colour of a direction, which need not have unit length.
    #[inline]
    pub fn of_direction(direction: [f32; 3]) -> [u8; 3] {
        let [x, y, z] = direction;
        let length = (x * x + y * y + z * z).sqrt();
        let share = |part: f32| if length > 0.0 { (255.0 * (part.abs() / length)).round() as u8 } else { 255 };
        direction.map(share)
    }
}

/// Light of each gamma-encoded byte.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|byte| to_linear(byte as f32 / 255.0)));

/// A colour as light.
#[inline]
pub fn light(color: [u8; 3], shade: f32) -> [f32; 3] {
    color.map(|byte| LINEAR[usize::from(byte)] * shade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_colours_of_their_places() {
        let colors = vec![[0, 0, 0], [100, 0, 0], [200, 0, 0]];
        let palette = Palette { quantity: Quantity::Speed, colors, scale: Scale::Log, range: [1.0, 100.0] };
        assert_eq!([0.1, 10.0, 1e9].map(|value| palette.of_value(value)[0]), [0, 100, 200]);
        assert_eq!(palette.of_value(f32::NAN), [0; 3]);
        assert_eq!(Palette::of_direction([0.0, -3.0, 0.0]), [0, 255, 0]);
        assert_eq!(light([255, 0, 255], 0.5), [0.5, 0.0, 0.5]);
    }
}
