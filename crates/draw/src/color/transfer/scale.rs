//! Ranges of values, how values are placed in them, and lengths that opacities belong to.

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

    /// The value at a place of a usable range: the inverse of [`Scale::place`].
    pub fn value(self, place: f32, [min, max]: [f64; 2]) -> f64 {
        match self {
            Scale::Log => min * (max / min).powf(f64::from(place)),
            Scale::Linear => min + (max - min) * f64::from(place),
        }
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

impl Range {
    /// An automatic range, widened where it is so narrow that colours would show nothing but rounding: to 2 % of its larger
    /// end.
    pub fn apart([min, max]: [f64; 2]) -> [f64; 2] {
        let missing = 0.5 * (0.02 * min.abs().max(max.abs()) - (max - min));
        if missing > 0.0 { [min - missing, max + missing] } else { [min, max] }
    }
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
