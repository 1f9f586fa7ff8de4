//! How bright and how coloured the data of the present view are: the histograms that the panel shows, and the ranges
//! that are used where the user has chosen none.

use super::panel::histogram::Histogram;
use bevy::prelude::*;

/// One quantity of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// What it is.
    pub title: String,
    /// Its unit.
    pub unit: String,
    /// How often values occur in the picture.
    pub histogram: Histogram,
    /// The range that shows the picture well.
    pub automatic: [f64; 2],
}

/// What the picture's brightness and hue stand for.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct Exposure {
    /// `P`: the weight per area along the line of sight.
    pub brightness: Option<Channel>,
    /// `S`: the weighted mean of the attribute.
    pub hue: Option<Channel>,
}

/// Number of bins of the histograms.
const BINS: usize = 96;

/// The range from dark to bright and its histogram, for positive values (others are ignored): a logarithmic axis from
/// the faintest to the brightest value, at most ten decades, and the range between the 2nd and the 99.9th percentile.
pub fn brightness_of(values: impl Iterator<Item = f32>) -> Option<(Histogram, [f64; 2])> {
    let mut logs: Vec<f32> = values.filter(|v| *v > 0.0 && v.is_finite()).map(f32::log10).collect();
    logs.sort_unstable_by(f32::total_cmp);
    let high = *logs.last()?;
    let low = logs[0].max(high - 10.0);
    let percentile = |share: f64| f64::from(logs[((logs.len() - 1) as f64 * share) as usize]);
    let [a, b] = widened(percentile(0.02).max(f64::from(low)), percentile(0.999), 0.5);
    let span = [f64::from(low).min(a), f64::from(high).max(b)];
    let counts = bins(logs.iter().map(|&log| f64::from(log)), span);
    let power = |log: f64| 10f64.powf(log);
    Some((Histogram { counts, span: span.map(power), log: true }, [power(a), power(b)]))
}

/// The range of hues and its histogram: a logarithmic axis where all values are positive and span more than a decade.
pub fn hue_of(values: impl Iterator<Item = f32>) -> Option<(Histogram, [f64; 2])> {
    let mut values: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    values.sort_unstable_by(f32::total_cmp);
    let (low, high) = (f64::from(*values.first()?), f64::from(*values.last()?));
    let log = low > 0.0 && high > 10.0 * low;
    let scale = |value: f64| if log { value.log10() } else { value };
    let percentile = |share: f64| scale(f64::from(values[((values.len() - 1) as f64 * share) as usize]));
    let least = if log { 0.1 } else { 1e-3 * low.abs().max(high.abs()).max(1e-30) };
    let [a, b] = widened(percentile(0.01), percentile(0.99), least);
    let span = [scale(low).min(a), scale(high).max(b)];
    let counts = bins(values.iter().map(|&value| scale(f64::from(value))), span);
    let back = |x: f64| if log { 10f64.powf(x) } else { x };
    Some((Histogram { counts, span: span.map(back), log }, [back(a), back(b)]))
}

/// A range that is at least `least` wide, around the same middle.
fn widened(low: f64, high: f64, least: f64) -> [f64; 2] {
    let missing = (least - (high - low)).max(0.0);
    [low - 0.5 * missing, high + 0.5 * missing]
}

fn bins(values: impl Iterator<Item = f64>, span: [f64; 2]) -> Vec<f64> {
    let mut counts = vec![0.0; BINS];
    let scale = BINS as f64 / (span[1] - span[0]);
    for value in values {
        let bin = (value - span[0]) * scale;
        if bin >= 0.0 {
            counts[(bin as usize).min(BINS - 1)] += 1.0;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_ignores_the_empty_sky_and_keeps_the_data() {
        let values = (0..10_000).map(|i| if i % 2 == 0 { 0.0 } else { 10f32.powf(i as f32 / 2000.0) });
        let (histogram, [low, high]) = brightness_of(values).unwrap();
        assert!(histogram.log && histogram.counts.iter().sum::<f64>() == 5000.0);
        assert!(low > 1.0 && low < 2.0 && high > 9e4 && high <= 1.01e5, "{low} {high}");
        assert!(brightness_of([0.0, f32::NAN, -1.0].into_iter()).is_none());
    }

    #[test]
    fn constant_values_still_give_a_range() {
        for (histogram, [low, high]) in
            [brightness_of(vec![3.0; 9].into_iter()).unwrap(), hue_of(vec![-3.0; 9].into_iter()).unwrap()]
        {
            assert!(high > low && histogram.counts.iter().sum::<f64>() == 9.0);
            assert!(histogram.span[0] <= low && high <= histogram.span[1]);
        }
        assert!(hue_of(vec![0.0; 3].into_iter()).is_some());
    }

    #[test]
    fn hue_is_logarithmic_only_over_decades() {
        assert!(hue_of((1..100).map(|i| i as f32)).unwrap().0.log);
        assert!(!hue_of((50..100).map(|i| i as f32)).unwrap().0.log);
        assert!(!hue_of((-10..100).map(|i| i as f32)).unwrap().0.log);
    }
}
