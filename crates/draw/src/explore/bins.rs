//! The bins of an axis, of equal width along it or in its logarithm.

use super::histogram::Axis;

/// The bins of an axis, in which a value is found at once.
pub(super) struct Bins {
    pub(super) logarithmic: bool,
    /// Whether values beyond the ends are of no bin; of the last ones otherwise.
    has_ends: bool,
    low: f64,
    per_unit: f64,
    pub(super) edges: Vec<f64>,
}

impl Bins {
    pub(super) fn of(axis: &Axis, has_ends: bool) -> Bins {
        let place = |value: f64| if axis.logarithmic { value.log2() } else { value };
        let (low, high) = (place(axis.min), place(axis.max));
        let per_unit = axis.bins as f64 / (high - low);
        Bins { logarithmic: axis.logarithmic, has_ends, low, per_unit, edges: edges(axis) }
    }

    /// Whether something from `low` to `high` has a bin.
    #[inline]
    pub(super) fn reaches(&self, (low, high): (f64, f64)) -> bool {
        !self.has_ends || high >= self.edges[0] && low <= self.edges[self.edges.len() - 1]
    }

    /// The bin of a value, which has its lower edge; one beyond the ends is of the last bin there.
    #[inline]
    pub(super) fn bin(&self, value: f64) -> usize {
        let last = self.edges.len() - 2;
        let at = if self.logarithmic { value.log2() } else { value };
        // The cast saturates. What the logarithm's rounding puts beside its bin goes where the edges say.
        let mut bin = (((at - self.low) * self.per_unit) as usize).min(last);
        while bin > 0 && value < self.edges[bin] {
            bin -= 1;
        }
        while bin < last && value >= self.edges[bin + 1] {
            bin += 1;
        }
        bin
    }

    /// Whether all from `low` to `high` is of a bin.
    #[inline]
    pub(super) fn holds(&self, bin: usize, (low, high): (f64, f64)) -> bool {
        let last = self.edges.len() - 2;
        let is_placed = !self.logarithmic || low > 0.0;
        let is_above = low >= self.edges[bin] || bin == 0 && !self.has_ends;
        let is_below = high < self.edges[bin + 1] || bin == last && (!self.has_ends || high <= self.edges[last + 1]);
        is_placed && is_above && is_below
    }
}

/// The edges of an axis's bins, ascending: one more than it has bins.
pub fn edges(axis: &Axis) -> Vec<f64> {
    // The ends as they are, not as the logarithm rounds them.
    let edge = |bin: usize| if bin == 0 { axis.min } else { axis.edge(bin).clamp(axis.min, axis.max) };
    (0..=axis.bins).map(edge).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Unit;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_value_is_in_the_bin_between_whose_edges_it_is(
            low in 1e-6..1e3_f64, span in 1e-3..1e9_f64, bins in 1..300_usize, share in 0.0..=1.0_f64, logarithmic: bool, has_ends: bool
        ) {
            let axis = Axis {
                field: "mass".into(), unit: Unit::default(), logarithmic, min: low, max: low + span, bins,
            };
            let edges = edges(&axis);
            prop_assert_eq!((edges[0], edges[bins], edges.len()), (axis.min, axis.max, bins + 1));
            prop_assert!(edges.windows(2).all(|pair| pair[0] <= pair[1]));
            let found = Bins::of(&axis, has_ends);
            for value in [low + share * span, edges[(share * bins as f64) as usize], axis.min, axis.max] {
                let bin = found.bin(value);
                prop_assert!(edges[bin] <= value && (value < edges[bin + 1] || bin == bins - 1), "{bin} {value}");
                prop_assert!(found.holds(bin, (value, value)) && found.reaches((value, value)));
            }
            let beyond = 2.0 * axis.max;
            prop_assert_eq!(found.reaches((beyond, beyond)), !has_ends);
            prop_assert_eq!(found.bin(beyond), bins - 1);
        }
    }
}
