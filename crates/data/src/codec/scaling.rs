//! Non-linear scaling of quantities before vector quantisation (F12 4.7.4).
//!
//! Mass, density, smoothing length and every attribute that is positive throughout are coded as `log2`, so that the
//! quantiser minimises relative errors and a factor of two counts the same in each of them. An attribute with zero or
//! negative values is coded as it is, or, where its magnitudes span more than a factor of 1000, as `asinh(a / s)` with
//! `s` the 5 % quantile of the non-zero magnitudes: logarithmic on both sides, linear through zero. Such columns are then
//! scaled to a standard deviation of [`UNIT_DEVIATION`]. No column may swamp the others: each is limited to a standard
//! deviation of [`LARGEST_DEVIATION`].

use crate::model::portable::{Portable, portable, portable_variants};

/// Standard deviation, in octaves, given to columns that are not logarithmic: that of a typical temperature.
const UNIT_DEVIATION: f32 = 2.0;
/// Largest standard deviation of any column, octaves.
const LARGEST_DEVIATION: f32 = 6.0;

/// How an attribute of several particles becomes that of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttributeMerge {
    /// The mean, weighted with mass.
    Mean,
    /// Astronomical magnitudes: their fluxes `10^(-0.4 a)` are added.
    Magnitude,
}

portable_variants!(AttributeMerge { Mean = 0, Magnitude = 1 });

impl AttributeMerge {
    /// The rule for an attribute of that name.
    pub fn of(name: &str) -> AttributeMerge {
        if name == "magnitude" || name.ends_with("-magnitude") {
            AttributeMerge::Magnitude
        } else {
            AttributeMerge::Mean
        }
    }
}

/// How one column is mapped to a coordinate of the quantiser's space.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mapping {
    Log2,
    Linear,
    Asinh { scale: f32 },
}

impl Portable for Mapping {
    fn put(&self, to: &mut Vec<u8>) {
        match self {
            Mapping::Log2 => to.push(0),
            Mapping::Linear => to.push(1),
            Mapping::Asinh { scale } => (2_u8, *scale).put(to),
        }
    }

    fn take(from: &mut &[u8]) -> Option<Mapping> {
        match u8::take(from)? {
            0 => Some(Mapping::Log2),
            1 => Some(Mapping::Linear),
            2 => Some(Mapping::Asinh { scale: f32::take(from)? }),
            _ => None,
        }
    }
}

/// The mapping of one column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColumnScaling {
    mapping: Mapping,
    factor: f32,
    /// What errors are relative to; `None`: to the value itself.
    pub error_scale: Option<f32>,
}

portable!(ColumnScaling { mapping, factor, error_scale });

impl ColumnScaling {
    /// The scaling for a positive column with these values (or a sample of them).
    pub fn positive(values: &[f32]) -> ColumnScaling {
        ColumnScaling { mapping: Mapping::Log2, factor: 1.0, error_scale: None }.limited(values)
    }

    /// The scaling for an attribute with these finite values (or a sample of them) between `low` and `high`; `linear` keeps a
    /// quantity linear that is logarithmic already.
    pub fn attribute(values: &[f32], (low, high): (f32, f32), linear: bool) -> ColumnScaling {
        if low > 0.0 && !linear {
            return ColumnScaling::positive(values);
        }
        let mut sample: Vec<f32> = sample(values).map(f32::abs).filter(|&v| v > 0.0).collect();
        sample.sort_by(f32::total_cmp);
        let small = sample.get(sample.len() / 20).copied().unwrap_or(1.0);
        let wide = sample.last().is_some_and(|&large| large > 1000.0 * small);
        let mapping = if wide && !linear { Mapping::Asinh { scale: small } } else { Mapping::Linear };
        // A constant column has no range, and then no error either.
        let range = if high > low { (f64::from(high) - f64::from(low)).min(f64::from(f32::MAX)) as f32 } else { 1.0 };
        let raw = ColumnScaling { mapping, factor: 1.0, error_scale: Some(range) };
        let deviation = raw.deviation(values);
        if deviation > 0.0 && deviation.is_finite() {
            ColumnScaling { factor: UNIT_DEVIATION / deviation, ..raw }
        } else {
            raw
        }
    }

    /// The same mapping with all distances `weight` times as large: errors of the column count that much more.
    pub fn weighted(self, weight: f32) -> ColumnScaling {
        ColumnScaling { factor: self.factor * weight, ..self }
    }

    /// How far apart a value and its double are; of positive columns.
    pub fn octave(&self) -> f32 {
        self.factor
    }

    /// The coordinate of a value.
    #[inline]
    pub fn map(&self, value: f32) -> f32 {
        self.factor
            * match self.mapping {
                Mapping::Log2 => fast_log2(value),
                Mapping::Linear => value,
                Mapping::Asinh { scale } => {
                    let x = value / scale;
                    fast_log2(x.abs() + (x * x + 1.0).sqrt().min(f32::MAX)).copysign(x)
                }
            }
    }

    /// The coordinates of a run of values.
    pub fn map_all(&self, values: &[f32], out: &mut [f32]) {
        // A loop for each mapping, so that each is one for SIMD lanes.
        let out = out.iter_mut().zip(values);
        match self.mapping {
            Mapping::Log2 => out.for_each(|(out, &value)| *out = self.factor * fast_log2(value)),
            Mapping::Linear | Mapping::Asinh { .. } => out.for_each(|(out, &value)| *out = self.map(value)),
        }
    }

    /// Error of decoding `value` as `decoded`, relative as [`ColumnScaling::error_scale`] says.
    #[inline]
    pub fn error(&self, value: f32, decoded: f32) -> f64 {
        let difference = f64::from((decoded - value).abs());
        if difference == 0.0 { 0.0 } else { difference / f64::from(self.error_scale.unwrap_or(value.abs())) }
    }

    fn limited(self, values: &[f32]) -> ColumnScaling {
        let deviation = self.deviation(values);
        if deviation > LARGEST_DEVIATION && deviation.is_finite() {
            ColumnScaling { factor: LARGEST_DEVIATION / deviation, ..self }
        } else {
            self
        }
    }

    /// Standard deviation of the mapped values, over a sample.
    fn deviation(&self, values: &[f32]) -> f32 {
        let (count, _, squares) = sample(values).map(|v| f64::from(self.map(v))).fold(
            (0.0_f64, 0.0_f64, 0.0_f64),
            // Welford's update: no cancellation for columns far from zero.
            |(n, mean, squares), v| {
                let n = n + 1.0;
                let step = v - mean;
                let mean = mean + step / n;
                (n, mean, squares + step * (v - mean))
            },
        );
        (squares / count.max(1.0)).sqrt() as f32
    }
}

/// At most about 64 k evenly spread values.
fn sample(values: &[f32]) -> impl Iterator<Item = f32> + '_ {
    values.iter().copied().step_by((values.len() >> 16).max(1))
}

/// `log2` of a positive number to about 1e-6 (absolute, or relative where the result is large); what is not a normal
/// positive number counts as the smallest one. Only the quantiser's metric depends on it, no stored value does.
#[inline]
pub fn fast_log2(value: f32) -> f32 {
    let bits = if value > f32::MIN_POSITIVE { value.min(f32::MAX) } else { f32::MIN_POSITIVE }.to_bits();
    // Significand in [sqrt(1/2), sqrt(2)), so that the logarithm's series converges fast.
    let exponent = (bits.wrapping_sub(0x3f35_04f3) as i32) >> 23;
    let significand = f32::from_bits(bits.wrapping_sub((exponent as u32) << 23));
    let t = (significand - 1.0) / (significand + 1.0);
    let t2 = t * t;
    let series = t * (2.885_39 + t2 * (0.961_796_7 + t2 * (0.577_078 + t2 * (0.412_198_6 + t2 * 0.320_598_9))));
    exponent as f32 + series
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn fast_log2_is_log2(exponent in -125.0..127.0_f32) {
            let value = exponent.exp2();
            prop_assert!((fast_log2(value) - value.log2()).abs() <= 2e-6 * exponent.abs().max(1.0));
        }

        #[test]
        fn mappings_are_monotonic(mut values in prop::collection::vec(-1e20..1e20_f32, 2..40), linear: bool) {
            values.sort_by(f32::total_cmp);
            let scaling = ColumnScaling::attribute(&values, (values[0], values[values.len() - 1]), linear);
            for pair in values.windows(2) {
                prop_assert!(scaling.map(pair[0]) <= scaling.map(pair[1]) + 1e-4);
                prop_assert!(scaling.map(pair[0]).is_finite());
            }
        }
    }

    #[test]
    fn constant_columns_and_extremes_stay_finite() {
        for column in [[0.0; 3], [-7.0; 3], [1e-38, 1.0, 3e38], [-3e38, 0.0, 3e38], [f32::MIN, f32::MAX, 1.0]] {
            let range = column.iter().fold((column[0], column[0]), |(low, high), &v| (v.min(low), v.max(high)));
            let scaling = ColumnScaling::attribute(&column, range, false);
            assert!(column.iter().all(|&v| scaling.map(v).is_finite() && scaling.error(v, v) == 0.0), "{column:?}");
        }
    }
}
