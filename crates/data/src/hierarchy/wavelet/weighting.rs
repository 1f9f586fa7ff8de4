//! The cut for a number of points where something else than the sum of squared errors is to be small: the largest error, or errors weighted
//! by how fine they are.

use super::cut::{Cut, Drawn};
use super::tree::Hierarchy;

/// What a number of points is to keep small.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Weighting {
    /// The root of the mean squared error.
    #[default]
    Rms,
    /// The largest error, as measured in each node.
    Max,
    /// The same as [`Weighting::Rms`] with errors that count so much, of 1, in nodes of each level, the finest first. Levels beyond count 1.
    Levels(Vec<f32>),
}

impl Hierarchy {
    /// The best cut of at most `most` points; at least one. `curve` is [`Hierarchy::curve`].
    pub fn cut_weighted(&self, curve: &[(f32, usize)], most: usize, weighting: &Weighting) -> Cut {
        match weighting {
            Weighting::Rms => self.cut_on(curve, most),
            Weighting::Max => self.largest_that_fits(most, |error| self.cut_by_maximum(error)),
            Weighting::Levels(weights) => {
                let squares: Vec<f32> = weights.iter().map(|weight| weight * weight).collect();
                self.largest_that_fits(most, |price| self.cut_at_weighted_price(price, &squares))
            }
        }
    }

    /// As [`Hierarchy::cut_at_price`], with squared errors of each level's nodes times a weight.
    fn cut_at_weighted_price(&self, price: f32, weights: &[f32]) -> Cut {
        self.cut(|at, node| {
            let (level, weight) = (&self.levels[at], weights.get(at).copied().unwrap_or(1.0));
            if price < weight * level.refine[node] {
                Drawn::Refined
            } else if price < weight * level.direct[node] {
                Drawn::Directed
            } else {
                Drawn::Large
            }
        })
    }

    /// The cut at the lowest threshold at which it has at most `most` points; points become fewer as thresholds rise.
    fn largest_that_fits(&self, most: usize, cut: impl Fn(f32) -> Cut) -> Cut {
        // Positive numbers are ordered as their bits are.
        let (mut low, mut high) = (0, f32::MAX.to_bits());
        let mut best = cut(f32::MAX);
        while low < high {
            let middle = low + (high - low) / 2;
            let tried = cut(f32::from_bits(middle));
            if tried.points <= most {
                high = middle;
                best = tried;
            } else {
                low = middle + 1;
            }
        }
        best
    }
}
