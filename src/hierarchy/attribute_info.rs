//! Statistics of a family's columns: ranges, means and histograms of the source values.

use crate::codec::AttributeMerge;
use crate::model::Unit;
use rayon::prelude::*;

/// Bins of a histogram.
const BINS: usize = 64;
/// Values are summed in runs of this length, whatever the number of threads.
const RUN: usize = 1 << 16;

/// One quantity of a family, over its source particles.
#[derive(Clone, Debug, PartialEq)]
pub struct AttributeInfo {
    /// Standard name in kebab case.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// Smallest finite value; 0 where there is none.
    pub min: f64,
    /// Largest finite value.
    pub max: f64,
    /// Mean of the finite values.
    pub mean: f64,
    /// Values that were not finite; the tree holds the mean in their place.
    pub missing: u64,
    /// How it is merged.
    pub merge: AttributeMerge,
    /// Distribution of the finite values.
    pub histogram: Histogram,
}

/// Counts in bins of equal width, linear or logarithmic.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Whether the bins are equal in the logarithm (all values are positive then).
    pub logarithmic: bool,
    /// Lower edge of the first bin, a value (not its logarithm).
    pub min: f64,
    /// Upper edge of the last bin.
    pub max: f64,
    /// The counts.
    pub counts: Vec<u64>,
}

impl AttributeInfo {
    /// Looks through a column.
    pub fn of(name: &str, unit: &Unit, values: &[f32]) -> AttributeInfo {
        let runs: Vec<_> = values
            .par_chunks(RUN)
            .map(|run| {
                let (mut low, mut high, mut sum, mut count) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0_u64);
                for &value in run.iter().filter(|value| value.is_finite()) {
                    (low, high) = (low.min(value), high.max(value));
                    sum += f64::from(value);
                    count += 1;
                }
                (low, high, sum, count)
            })
            .collect();
        let (low, high, sum, count) = runs
            .into_iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY, 0.0, 0), |(low, high, sum, count), (l, h, s, c)| {
                (low.min(l), high.max(h), sum + s, count + c)
            });
        let (low, high) = if count == 0 { (0.0, 0.0) } else { (f64::from(low), f64::from(high)) };
        AttributeInfo {
            name: name.to_owned(),
            unit: unit.clone(),
            min: low,
            max: high,
            mean: if count == 0 { 0.0 } else { sum / count as f64 },
            missing: values.len() as u64 - count,
            merge: AttributeMerge::of(name),
            histogram: Histogram::of(values, low, high),
        }
    }
}

impl Histogram {
    /// Counts the finite values; `low` and `high` are their extremes.
    fn of(values: &[f32], low: f64, high: f64) -> Histogram {
        let logarithmic = low > 0.0 && high > 10.0 * low;
        let coordinate = |value: f64| if logarithmic { value.log2() } else { value };
        let (start, end) = (coordinate(low), coordinate(high));
        let factor = if end > start { BINS as f64 / (end - start) } else { 0.0 };
        let counts = values
            .par_chunks(RUN)
            .map(|run| {
                let mut counts = vec![0_u64; BINS];
                for &value in run.iter().filter(|value| value.is_finite()) {
                    let x =
                        if logarithmic { f64::from(crate::codec::scaling::fast_log2(value)) } else { f64::from(value) };
                    counts[(((x - start) * factor) as usize).min(BINS - 1)] += 1;
                }
                counts
            })
            .reduce(
                || vec![0; BINS],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        Histogram { logarithmic, min: low, max: high, counts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_described() {
        let info = AttributeInfo::of("temperature", &Unit::new("K"), &[1.0, f32::NAN, 3.0, 8.0, 1000.0]);
        assert_eq!((info.min, info.max, info.mean, info.missing), (1.0, 1000.0, 253.0, 1));
        assert!(info.histogram.logarithmic);
        assert_eq!(info.histogram.counts.iter().sum::<u64>(), 4);
        assert_eq!((info.histogram.counts[0], info.histogram.counts[63]), (1, 1));
        let empty = AttributeInfo::of("x", &Unit::default(), &[f32::NAN]);
        assert_eq!((empty.min, empty.max, empty.mean, empty.missing), (0.0, 0.0, 0.0, 1));
    }
}
