//! Statistics of a family's columns: ranges, means and histograms of the source values.

use crate::codec::AttributeMerge;
use crate::model::Unit;
use crate::model::portable::{expect, portable, total};

/// Bins of a histogram.
const BINS: usize = 64;
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

/// Extremes and sum of a column, of its finite values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest value; infinite where there is none.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Values that are not finite.
    pub missing: u64,
    sum: f64,
    count: u64,
}

portable!(Range { min, max, missing, sum, count });

impl Range {
    /// Of no values.
    pub const EMPTY: Range = Range { min: f64::INFINITY, max: f64::NEG_INFINITY, missing: 0, sum: 0.0, count: 0 };

    /// Looks through a run of values.
    pub fn of(values: &[f32]) -> Range {
        let mut range = Range::EMPTY;
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for &value in values.iter().filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
            range.sum += f64::from(value);
            range.count += 1;
        }
        Range { min: low.into(), max: high.into(), missing: values.len() as u64 - range.count, ..range }
    }

    /// With the values of another run; the order matters to the last bit of the mean.
    pub fn with(self, next: Range) -> Range {
        Range {
            min: self.min.min(next.min),
            max: self.max.max(next.max),
            missing: self.missing + next.missing,
            sum: self.sum + next.sum,
            count: self.count + next.count,
        }
    }

    /// Number of values, finite or not.
    pub fn values(&self) -> u64 {
        total([self.count, self.missing])
    }

    /// The mean; 0 where there is no value.
    pub fn mean(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum / self.count as f64 }
    }

    /// Smallest and largest value; 0 where there is none.
    fn ends(&self) -> (f64, f64) {
        if self.count == 0 { (0.0, 0.0) } else { (self.min, self.max) }
    }
}

/// Whether these are counts of so many values in the bins of a histogram; else what was found and expected.
pub fn check_counts(counts: &[u64], values: u64) -> Result<(), String> {
    expect("bins", counts.len(), BINS)?;
    expect("counts of a histogram", total(counts.iter().copied()), values)
}

/// Puts the mean in the place of values that are not finite.
pub fn missing_replaced(values: &mut [f32], mean: f32) {
    values.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = mean);
}

/// Gives mass, density and smoothing length their units.
pub fn set_units(quantities: &mut [AttributeInfo; 3], mass: &Unit, length: &Unit) {
    let [mass_info, density_info, smoothing_info] = quantities;
    mass_info.unit = mass.clone();
    smoothing_info.unit = length.clone();
    density_info.unit = match (mass.is_unknown(), length.is_unknown()) {
        (true, true) => Unit::default(),
        _ => Unit::new(format!("({mass})/({length})^3")),
    };
}

impl AttributeInfo {
    /// The same quantity at several times, as one; `None` for none.
    pub fn joined<'a>(all: impl IntoIterator<Item = &'a AttributeInfo>) -> Option<AttributeInfo> {
        let all: Vec<&AttributeInfo> = all.into_iter().collect();
        let first = *all.first()?;
        let values = |info: &AttributeInfo| info.histogram.counts.iter().sum::<u64>();
        let (sum, count) = all.iter().fold((0.0, 0), |(sum, count), info| {
            let own = values(info).max(1);
            (sum + info.mean * own as f64, count + own)
        });
        let least = all.iter().map(|info| info.min).fold(f64::INFINITY, f64::min);
        let most = all.iter().map(|info| info.max).fold(f64::NEG_INFINITY, f64::max);
        let logarithmic = all.iter().all(|info| info.histogram.logarithmic);
        let coordinate = |value: f64| if logarithmic { value.log2() } else { value };
        let (start, end) = (coordinate(least), coordinate(most));
        let factor = if end > start { BINS as f64 / (end - start) } else { 0.0 };
        let mut counts = vec![0; BINS];
        for histogram in all.iter().map(|info| &info.histogram) {
            let bins = histogram.counts.len().max(1) as f64;
            for (bin, own) in histogram.counts.iter().enumerate() {
                let share = (bin as f64 + 0.5) / bins;
                let middle = match histogram.logarithmic {
                    true => histogram.min * (histogram.max / histogram.min).powf(share),
                    false => histogram.min + share * (histogram.max - histogram.min),
                };
                // The cast saturates.
                counts[(((coordinate(middle) - start) * factor) as usize).min(BINS - 1)] += own;
            }
        }
        Some(AttributeInfo {
            min: least,
            max: most,
            mean: sum / count as f64,
            missing: all.iter().map(|info| info.missing).sum(),
            histogram: Histogram { logarithmic, min: least, max: most, counts },
            ..first.clone()
        })
    }

    /// Describes a column that is in memory as a whole.
    pub fn of(name: &str, unit: &Unit, values: &[f32]) -> AttributeInfo {
        let range = Range::of(values);
        let bins = HistogramBins::of(&range);
        let mut values = values.to_vec();
        missing_replaced(&mut values, range.mean() as f32);
        let counts = bins.count(&values);
        AttributeInfo::new(name, unit, &range, bins.finish(counts, range.missing))
    }

    /// Describes a column.
    pub fn new(name: &str, unit: &Unit, range: &Range, histogram: Histogram) -> AttributeInfo {
        let (min, max) = range.ends();
        AttributeInfo {
            name: name.to_owned(),
            unit: unit.clone(),
            min,
            max,
            mean: range.mean(),
            missing: range.missing,
            merge: AttributeMerge::of(name),
            histogram,
        }
    }
}

/// The bins of a histogram that is being counted.
#[derive(Clone, Debug)]
pub struct HistogramBins {
    logarithmic: bool,
    min: f64,
    max: f64,
    start: f64,
    factor: f64,
    /// Where the mean falls that stands for missing values.
    mean: usize,
}

impl HistogramBins {
    /// The bins for a column.
    pub fn of(range: &Range) -> HistogramBins {
        let (min, max) = range.ends();
        let logarithmic = min > 0.0 && max > 10.0 * min;
        let coordinate = |value: f64| if logarithmic { value.log2() } else { value };
        let (start, end) = (coordinate(min), coordinate(max));
        let factor = if end > start { BINS as f64 / (end - start) } else { 0.0 };
        let bins = HistogramBins { logarithmic, min, max, start, factor, mean: 0 };
        HistogramBins { mean: bins.bin(range.mean() as f32), ..bins }
    }

    /// Counts finite values.
    pub fn count(&self, values: &[f32]) -> Vec<u64> {
        // Columns have long runs of one value: with several counters of a bin, additions need not wait for each other.
        let mut counts = [[0_u64; BINS]; 4];
        for values in values.chunks(BINS) {
            let mut bins = [0_u8; BINS];
            bins.iter_mut().zip(values).for_each(|(bin, &value)| *bin = self.bin(value) as u8);
            for (i, &bin) in bins[..values.len()].iter().enumerate() {
                counts[i % 4][usize::from(bin) % BINS] += 1;
            }
        }
        (0..BINS).map(|bin| counts.iter().map(|counts| counts[bin]).sum()).collect()
    }

    #[inline(always)]
    fn bin(&self, value: f32) -> usize {
        let x = if self.logarithmic { f64::from(crate::codec::scaling::fast_log2(value)) } else { f64::from(value) };
        // The cast saturates.
        (((x - self.start) * self.factor) as i32).clamp(0, BINS as i32 - 1) as usize
    }

    /// The histogram, without the means that stand for `missing` values.
    pub fn finish(self, mut counts: Vec<u64>, missing: u64) -> Histogram {
        counts[self.mean] = counts[self.mean].saturating_sub(missing);
        Histogram { logarithmic: self.logarithmic, min: self.min, max: self.max, counts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn describe(values: &[f32]) -> AttributeInfo {
        AttributeInfo::of("temperature", &Unit::new("K"), values)
    }

    #[test]
    fn columns_are_described() {
        let info = describe(&[1.0, f32::NAN, 3.0, 8.0, 1000.0]);
        assert_eq!((info.min, info.max, info.mean, info.missing), (1.0, 1000.0, 253.0, 1));
        assert!(info.histogram.logarithmic);
        assert_eq!(info.histogram.counts.iter().sum::<u64>(), 4);
        assert_eq!((info.histogram.counts[0], info.histogram.counts[63]), (1, 1));
        let empty = describe(&[f32::NAN]);
        assert_eq!((empty.min, empty.max, empty.mean, empty.missing), (0.0, 0.0, 0.0, 1));
        assert_eq!(empty.histogram.counts.iter().sum::<u64>(), 0);
    }
}
