//! Mean and dispersion of many values, plain and weighted, put together from runs without cancellation (Chan, Golub and LeVeque's
//! pairwise update).

/// Count, weight, mean and squared deviations of values; those that are not finite are left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// How many values.
    pub count: u64,
    /// Sum of their weights.
    pub weight: f64,
    /// Smallest value; infinite for none.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Smallest positive value; infinite for none.
    pub min_positive: f64,
    plain: Central,
    weighted: Central,
}

/// A mean and the sum of (weighted) squared deviations from it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Central {
    mean: f64,
    squares: f64,
}

impl Central {
    /// Joins two; `a` and `b` are their weights.
    fn join(self, a: f64, other: Central, b: f64) -> Central {
        if b == 0.0 {
            return self;
        }
        if a == 0.0 {
            return other;
        }
        let step = other.mean - self.mean;
        let share = b / (a + b);
        Central { mean: self.mean + step * share, squares: self.squares + other.squares + step * step * a * share }
    }
}

impl Default for Moments {
    fn default() -> Moments {
        Moments::NONE
    }
}

impl Moments {
    /// Of no values.
    pub const NONE: Moments = Moments {
        count: 0,
        weight: 0.0,
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        min_positive: f64::INFINITY,
        plain: Central { mean: 0.0, squares: 0.0 },
        weighted: Central { mean: 0.0, squares: 0.0 },
    };

    /// Of values with weights, which are not negative.
    pub fn of(values: &[f64], weights: &[f64]) -> Moments {
        let finite = || values.iter().zip(weights).filter(|(value, _)| value.is_finite());
        let mut all = Moments::NONE;
        let (mut sum, mut weighted) = (0.0, 0.0);
        // Offsets from the first value keep the digits of columns far from zero.
        let Some(first) = finite().next().map(|(value, _)| *value) else { return all };
        for (&value, &weight) in finite() {
            all.count += 1;
            all.weight += weight;
            all.min = all.min.min(value);
            all.max = all.max.max(value);
            all.min_positive = if value > 0.0 { all.min_positive.min(value) } else { all.min_positive };
            sum += value - first;
            weighted += (value - first) * weight;
        }
        all.plain.mean = first + sum / all.count as f64;
        all.weighted.mean = if all.weight > 0.0 { first + weighted / all.weight } else { 0.0 };
        for (&value, &weight) in finite() {
            all.plain.squares += (value - all.plain.mean).powi(2);
            all.weighted.squares += weight * (value - all.weighted.mean).powi(2);
        }
        all
    }

    /// Adds one value.
    #[inline]
    pub fn add(&mut self, value: f64, weight: f64) {
        if !value.is_finite() {
            return;
        }
        self.count += 1;
        self.weight += weight;
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        self.min_positive = if value > 0.0 { self.min_positive.min(value) } else { self.min_positive };
        let step = value - self.plain.mean;
        self.plain.mean += step / self.count as f64;
        self.plain.squares += step * (value - self.plain.mean);
        if self.weight > 0.0 {
            let step = value - self.weighted.mean;
            self.weighted.mean += step * (weight / self.weight);
            self.weighted.squares += weight * step * (value - self.weighted.mean);
        }
    }

    /// Adds the values of another run.
    pub fn join(&mut self, other: &Moments) {
        self.plain = self.plain.join(self.count as f64, other.plain, other.count as f64);
        self.weighted = self.weighted.join(self.weight, other.weighted, other.weight);
        self.count += other.count;
        self.weight += other.weight;
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.min_positive = self.min_positive.min(other.min_positive);
    }

    /// As though each value had been there so many times, up to rounding of their number.
    pub(super) fn scaled(mut self, factor: f64) -> Moments {
        let count = (factor * self.count as f64).round();
        self.plain.squares *= if self.count > 0 { count / self.count as f64 } else { 0.0 };
        self.count = count as u64;
        self.weight *= factor;
        self.weighted.squares *= factor;
        self
    }

    /// The mean; `None` of no values.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then_some(self.plain.mean)
    }

    /// The root of the mean squared deviation (of the population: divided by the count).
    pub fn dispersion(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.plain.squares / self.count as f64).max(0.0).sqrt())
    }

    /// The weighted mean; `None` without weight.
    pub fn weighted_mean(&self) -> Option<f64> {
        (self.weight > 0.0).then_some(self.weighted.mean)
    }

    /// The weighted root of the mean squared deviation from the weighted mean.
    pub fn weighted_dispersion(&self) -> Option<f64> {
        (self.weight > 0.0).then(|| (self.weighted.squares / self.weight).max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(a: Option<f64>, b: f64, scale: f64) -> bool {
        a.is_some_and(|a| (a - b).abs() <= 1e-9 * scale)
    }

    proptest! {
        #[test]
        fn moments_are_those_of_all_values_however_they_come(
            offset in prop_oneof![Just(0.0), -1e6..1e6_f64],
            pairs in prop::collection::vec((-1.0..1.0_f64, 0.0..3.0_f64), 1..200),
            cut in 0.0..1.0_f64,
        ) {
            let values: Vec<f64> = pairs.iter().map(|(value, _)| value + offset).collect();
            let weights: Vec<f64> = pairs.iter().map(|(_, weight)| *weight).collect();
            let cut = (cut * pairs.len() as f64) as usize;
            let mut joined = Moments::of(&values[..cut], &weights[..cut]);
            joined.join(&Moments::of(&values[cut..], &weights[cut..]));
            let mut added = Moments::NONE;
            values.iter().zip(&weights).for_each(|(value, weight)| added.add(*value, *weight));
            let n = values.len() as f64;
            let total: f64 = weights.iter().sum();
            let mean = values.iter().map(|v| v - offset).sum::<f64>() / n;
            let spread = (values.iter().map(|v| (v - offset - mean).powi(2)).sum::<f64>() / n).sqrt();
            let zip = || values.iter().zip(&weights).map(|(v, w)| (v - offset, w));
            let weighted = zip().map(|(v, w)| v * w).sum::<f64>() / total;
            let weighted_spread = (zip().map(|(v, w)| w * (v - weighted).powi(2)).sum::<f64>() / total).sqrt();
            for moments in [joined, added] {
                prop_assert_eq!(moments.count, values.len() as u64);
                prop_assert_eq!(moments.min, values.iter().copied().fold(f64::INFINITY, f64::min));
                prop_assert_eq!(moments.max, values.iter().copied().fold(f64::NEG_INFINITY, f64::max));
                prop_assert!(close(moments.mean(), mean + offset, 1.0 + 1e-3 * offset.abs()));
                prop_assert!(close(moments.dispersion(), spread, 1.0 + offset.abs()));
                if total > 1e-3 {
                    prop_assert!(close(moments.weighted_mean(), weighted + offset, 1.0 + offset.abs()));
                    prop_assert!(close(moments.weighted_dispersion(), weighted_spread, 1.0 + offset.abs()));
                }
            }
        }
    }

    #[test]
    fn values_that_are_not_finite_are_left_out() {
        let moments = Moments::of(&[f64::NAN, 2.0, f64::INFINITY, 4.0], &[1.0, 1.0, 1.0, 3.0]);
        assert_eq!((moments.count, moments.weight), (2, 4.0));
        assert_eq!((moments.mean(), moments.weighted_mean()), (Some(3.0), Some(3.5)));
        let none = Moments::of(&[f64::NAN], &[1.0]);
        assert_eq!((none.mean(), none.dispersion(), none.weighted_mean()), (None, None, None));
    }
}
