//! Values as renderers of densities want them: numbers above zero, with zero for nothing.

use crate::color::transfer::Scale;

/// A scale of values from 1 to 2. What is 0 lies outside of the field; below [`ValueAxis::NOTHING`] is what is mostly outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueAxis {
    /// How values are placed.
    pub scale: Scale,
    /// The values at 1 and 2, usable by the scale.
    pub range: [f64; 2],
}

impl ValueAxis {
    /// Up to here it is more of the outside than of the field.
    pub const NOTHING: f32 = 0.5;

    /// An axis for values of a range.
    pub fn new(scale: Scale, range: [f64; 2]) -> ValueAxis {
        ValueAxis { scale, range: scale.usable(range) }
    }

    /// Where a value lies; 0 for NaN.
    #[inline]
    pub fn place(&self, value: f32) -> f32 {
        if value.is_nan() {
            return 0.0;
        }
        1.0 + match self.scale {
            Scale::Log => self.scale.place(value, self.range),
            Scale::Linear => {
                let [low, high] = self.range;
                ((f64::from(value) - low) / (high - low)).clamp(0.0, 1.0) as f32
            }
        }
    }

    /// The value at place 1, and what a unit of values adds to a place, where that is the same everywhere.
    pub fn linear(&self) -> Option<[f32; 2]> {
        let [low, high] = self.range;
        (self.scale == Scale::Linear).then(|| [low as f32, (1.0 / (high - low)) as f32])
    }

    /// The value at a place.
    pub fn value(&self, place: f32) -> f64 {
        self.scale.value((place - 1.0).clamp(0.0, 1.0), self.range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_values() {
        for (scale, range) in [(Scale::Linear, [-100.0, 300.0]), (Scale::Log, [1e-3, 1e5])] {
            let axis = ValueAxis::new(scale, range);
            for value in [range[0], 0.5, 7.0, 250.0, range[1]] {
                let place = axis.place(value as f32);
                assert!((1.0..=2.0).contains(&place) && (axis.value(place) / value - 1.0).abs() < 1e-4, "{value}");
            }
            assert_eq!(axis.place(f32::NAN), 0.0);
        }
    }
}
