//! How many splats there is time for: from what the last pictures took, for pictures of clusters, which are few, of all sizes, and cost the
//! more each the fewer there are.

use super::frame_budget::FrameBudget;

/// How the number follows from times: that of splats falls more slowly than their time, since fewer are wider.
const POWER: f64 = 0.8;
/// The number changes by this factor at most from picture to picture, up or down.
const CHANGE: f64 = 3.0;
/// Splats of the first picture, before anything was measured.
const FIRST: f64 = 20_000.0;
/// Splats of any picture at least: a picture must remain.
const LEAST: f64 = 1_000.0;

/// What the last pictures took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatBudget {
    budget: FrameBudget,
    /// Splats of the last one.
    last: f64,
}

impl SplatBudget {
    /// How many splats a picture may have to be drawn in so many milliseconds.
    pub fn limit(&self, milliseconds: f64) -> u64 {
        let fits = self
            .budget
            .fits(milliseconds)
            .map_or(FIRST, |work| work.powf(POWER).clamp(self.last / CHANGE, CHANGE * self.last));
        // What is not finite becomes a number of splats nevertheless.
        fits.clamp(LEAST, 1e12) as u64
    }

    /// A picture of so many splats has taken so long.
    pub fn drew(&mut self, splats: u64, milliseconds: f64) {
        if splats > 0 && milliseconds > 0.0 && milliseconds.is_finite() {
            self.budget.drew((splats as f64).powf(1.0 / POWER), milliseconds);
            self.last = splats as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever a splat costs, and however that depends on their number, pictures soon take the time that is planned.
        #[test]
        fn the_number_follows_the_time(each_us in 0.02..20.0_f64, fixed_ms in 0.0..10.0_f64, power in 0.5..1.1_f64, target in 20.0..200.0_f64) {
            let takes = |splats: u64| fixed_ms + 1e-3 * each_us * 1e4 * (splats as f64 / 1e4).powf(power);
            let mut budget = SplatBudget::default();
            for _ in 0..60 {
                let splats = budget.limit(target);
                budget.drew(splats, takes(splats));
            }
            let splats = budget.limit(target);
            let took = takes(splats);
            prop_assert!(took <= target || splats as f64 <= LEAST, "{took} ms of {target} with {splats}");
            prop_assert!(took >= 0.8 * target || splats as f64 >= 1e11, "{took} ms of {target} with {splats}");
            budget.drew(0, 1.0);
            budget.drew(5, f64::NAN);
            prop_assert_eq!(budget.limit(target), splats);
        }
    }
}
