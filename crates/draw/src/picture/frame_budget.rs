//! How much work there is time for: by what the last pictures took, and by how far apart that lies.
//!
//! A machine that does nothing else draws the same picture in the same time; one with other things to do, or a virtual one, does not. The
//! time that a picture has is planned for the longer the steadier the last pictures were, so that all but a few keep to it.

/// Of the time that a picture has, how much is planned for at least and at most.
const PLANNED: [f64; 2] = [0.7, 0.95];
/// How much longer than its time a picture may take that is among the longest.
const OVER: f64 = 1.08;
/// Which share of the pictures is among the longest.
const TAIL: f64 = 0.05;
/// How fast what the longest pictures take follows from what pictures take.
const PACE: f64 = 0.1;
/// What the longest pictures take before anything was measured.
const USUAL: f64 = 1.2;

/// What the last pictures took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameBudget {
    /// Milliseconds for a unit of work of the last three pictures, the latest first. The middle one counts: a single picture that something
    /// else has held up says nothing of the next.
    costs: Option<[f64; 3]>,
    /// What all pictures but [`TAIL`] of them take at most, in units of what they were expected to.
    longest: f64,
}

impl Default for FrameBudget {
    fn default() -> FrameBudget {
        FrameBudget { costs: None, longest: USUAL }
    }
}

impl FrameBudget {
    /// The work of a picture that may take so many milliseconds; `None` before the first one.
    pub fn fits(&self, milliseconds: f64) -> Option<f64> {
        let planned = (OVER / self.longest).clamp(PLANNED[0], PLANNED[1]);
        Some(planned * milliseconds / middle(self.costs?))
    }

    /// A picture of so much work has taken so long. What is not above zero or not finite says nothing.
    pub fn drew(&mut self, work: f64, milliseconds: f64) {
        let cost = milliseconds / work;
        if !(work > 0.0 && cost > 0.0 && cost.is_finite()) {
            return;
        }
        let Some(costs) = self.costs else {
            self.costs = Some([cost; 3]);
            return;
        };
        // Up by much for one of the longest, down by little for any other: in balance where as many are as should be.
        let is_long = cost > self.longest * middle(costs);
        self.longest = (self.longest + PACE * (f64::from(u8::from(is_long)) - TAIL)).clamp(1.0, 2.0);
        self.costs = Some([cost, costs[0], costs[1]]);
    }
}

fn middle([a, b, c]: [f64; 3]) -> f64 {
    a.min(b).max(a.max(b).min(c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand_pcg::Pcg64Mcg;
    use rand_pcg::rand_core::{Rng, SeedableRng};

    proptest! {
        /// However far apart what pictures take lies, all but a few keep to their time, and they are no smaller than that demands.
        #[test]
        fn all_but_a_few_keep_to_their_time(spread in 0.0..0.5_f64, each in 0.01..10.0_f64, seed in any::<u64>()) {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let mut budget = FrameBudget::default();
            let mut took = Vec::new();
            for frame in 0..3000 {
                let work = budget.fits(50.0).unwrap_or(1.0);
                // One in ten takes up to `spread` longer.
                let (late, by) = (random.next_u32() % 10 == 0, f64::from(random.next_u32()) / f64::from(u32::MAX));
                let milliseconds = each * work * if late { 1.0 + spread * by } else { 1.0 };
                budget.drew(work, milliseconds);
                if frame >= 500 {
                    took.push(milliseconds);
                }
            }
            let longer = took.iter().filter(|&&milliseconds| milliseconds > 50.0 * 1.12).count() as f64 / took.len() as f64;
            prop_assert!(longer <= 0.08, "{longer} take more than 56 ms");
            let mean = took.iter().sum::<f64>() / took.len() as f64;
            prop_assert!(mean >= 50.0 * 0.7, "{mean} ms of 50");
        }
    }

    #[test]
    fn a_picture_that_is_held_up_changes_little() {
        let mut budget = FrameBudget::default();
        assert_eq!(budget.fits(50.0), None);
        for _ in 0..200 {
            budget.drew(10.0, 20.0);
        }
        let before = budget.fits(50.0).unwrap();
        budget.drew(10.0, 400.0);
        let after = budget.fits(50.0).unwrap();
        assert!(after >= 0.9 * before && after <= before, "{before} {after}");
        budget.drew(10.0, 400.0);
        let slow = budget.fits(50.0).unwrap();
        assert!(slow < 0.1 * before, "two in a row do: {before} {slow}");
        for (work, milliseconds) in [(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY), (-1.0, 1.0)] {
            budget.drew(work, milliseconds);
        }
        assert_eq!(budget.fits(50.0), Some(slow));
    }
}
