//! Non-linear scaling of quantities before vector quantisation (F12 4.7.4).
//!
//! Mass, density, smoothing length and every attribute that is positive throughout are coded as `log2`, so that the
//! quantiser minimises relative errors and a factor of two counts the same in each of them. An attribute with zero or
//! negative values is coded as it is, or, where its magnitudes span more than a factor of 1000, as `asinh(a / s)` with
//! `s` the 5 % quantile of the non-zero magnitudes: logarithmic on both sides, linear through zero. Such columns are then
//! scaled to a standard deviation of [`UNIT_DEVIATION`]. No column may swamp the others: each is limited to a standard
//! deviation of [`LARGEST_DEVIATION`].

use crate::lanes::in_lanes;
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
        match self.mapping {
            Mapping::Log2 => fast_log2_all(self.factor, values, out),
            Mapping::Linear | Mapping::Asinh { .. } => {
                out.iter_mut().zip(values).for_each(|(out, &value)| *out = self.map(value));
            }
        }
    }

    /// Errors of decoding a run of values like this, relative as [`ColumnScaling::error_scale`] says.
    pub fn errors(&self, values: &[f32], decoded: &[f32], out: &mut [f64]) {
        in_lanes!(errors(self.error_scale, values, decoded, out));
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
#[inline(always)]
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

/// The work of [`ColumnScaling::errors`].
#[inline(always)]
fn errors(scale: Option<f32>, values: &[f32], decoded: &[f32], out: &mut [f64]) {
    for (out, (&value, &decoded)) in out.iter_mut().zip(values.iter().zip(decoded)) {
        let difference = f64::from((decoded - value).abs());
        let error = difference / f64::from(scale.unwrap_or(value.abs()));
        *out = if difference == 0.0 { 0.0 } else { error };
    }
}

/// `factor` times [`fast_log2`] of each value, to the same last bit.
pub fn fast_log2_all(factor: f32, values: &[f32], out: &mut [f32]) {
    in_lanes!(logarithms(factor, values, out));
}

/// The work of [`fast_log2_all`].
#[inline(always)]
fn logarithms(factor: f32, values: &[f32], out: &mut [f32]) {
    for (out, &value) in out.iter_mut().zip(values) {
        *out = factor * fast_log2(value);
    }
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

        /// In lanes as one after the other, numbers that are none included.
        #[test]
        fn runs_are_mapped_like_single_values(bits in prop::collection::vec(any::<u32>(), 0..70), weight in 0.1..4.0_f32) {
            let values: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
            let scaling = ColumnScaling::positive(&[1.0, 2.0, 5.0]).weighted(weight);
            let mut mapped = vec![0.0; values.len()];
            scaling.map_all(&values, &mut mapped);
            for (&value, mapped) in values.iter().zip(mapped) {
                prop_assert_eq!(scaling.map(value).to_bits(), mapped.to_bits());
            }
        }

        #[test]
        fn errors_are_relative(pairs in prop::collection::vec((-9..9_i32, -9..9_i32), 0..70), scale in prop::option::of(0.1..9.0_f32)) {
            let (values, decoded): (Vec<f32>, Vec<f32>) = pairs.iter().map(|&(a, b)| (a as f32, b as f32)).unzip();
            let mut errors = vec![-1.0; values.len()];
            let scaling = ColumnScaling { error_scale: scale, ..ColumnScaling::positive(&[1.0]) };
            scaling.errors(&values, &decoded, &mut errors);
            for ((value, decoded), error) in values.into_iter().zip(decoded).zip(errors) {
                let of = f64::from(scale.unwrap_or(value.abs()));
                prop_assert_eq!(error, if value == decoded { 0.0 } else { f64::from((value - decoded).abs()) / of });
            }
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
            let mut errors = [1.0; 3];
            scaling.errors(&column, &column, &mut errors);
            assert!(column.iter().all(|&v| scaling.map(v).is_finite()) && errors == [0.0; 3], "{column:?}");
        }
    }
}
