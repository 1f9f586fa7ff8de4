//! Presence thinning (F12 4.7.3): the faintest particles of an inner node (of each bucket's part of it) are left out.
//!
//! The paper drops a particle when `n P_i < P_min`, with an `n` found by looking at pictures. Here the rule is a budget:
//! those left out have together at most a stated share of the node's mass and of its `sum m rho`, whatever the picture's
//! range. A particle's rank is the larger of its two shares. The node's mass scale gives the lost mass back.

/// Bins of the histogram of shares: the exponent and three bits of the significand of a single.
const BINS: usize = 1 << 12;

/// Which particles to draw so that those left out have at most `budget` of the mass and of the `sum m rho`; `None`: all.
pub(super) fn thin(mass: &[f32], density: &[f32], budget: f64) -> Option<Vec<bool>> {
    let particles = || mass.iter().zip(density).map(|(&m, &rho)| (m, f64::from(m) * f64::from(rho)));
    let (total, presence) =
        particles().fold((0.0, 0.0), |(total, sum), (m, presence)| (total + f64::from(m), sum + presence));
    if budget <= 0.0 || !(total > 0.0 && presence > 0.0 && total.is_finite() && presence.is_finite()) {
        return None;
    }
    let share = |(m, own): (f32, f64)| (f64::from(m) / total).max(own / presence) as f32;
    // What lies in each bin of shares, up to that of the budget: whatever is brighter cannot be left out.
    let ceiling = bin(budget.min(1.0) as f32);
    let mut bins = vec![(0.0_f64, 0.0_f64); ceiling + 1];
    for particle in particles() {
        if let Some(bin) = bins.get_mut(bin(share(particle))) {
            bin.0 += f64::from(particle.0);
            bin.1 += particle.1;
        }
    }
    let (mut mass_left, mut presence_left) = (budget * total, budget * presence);
    let mut limit = 0;
    for (mass, presence) in bins {
        mass_left -= mass;
        presence_left -= presence;
        if mass_left < 0.0 || presence_left < 0.0 {
            break;
        }
        limit += 1;
    }
    let drawn: Vec<bool> = particles().map(|particle| bin(share(particle)) >= limit).collect();
    drawn.contains(&false).then_some(drawn)
}

/// The bin of a non-negative share.
fn bin(share: f32) -> usize {
    (share.to_bits() >> 20) as usize & (BINS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_faintest_go_and_the_budget_holds(
            particles in prop::collection::vec((-20.0..5.0_f32, -20.0..5.0_f32), 1..400),
            budget in 1e-5..0.2_f64,
        ) {
            let mass: Vec<f32> = particles.iter().map(|p| p.0.exp2()).collect();
            let density: Vec<f32> = particles.iter().map(|p| p.1.exp2()).collect();
            let drawn = thin(&mass, &density, budget).unwrap_or_else(|| vec![true; mass.len()]);
            let presence = |i: usize| f64::from(mass[i]) * f64::from(density[i]);
            for value in [&|i: usize| f64::from(mass[i]), &presence as &dyn Fn(usize) -> f64] {
                let all: f64 = (0..mass.len()).map(value).sum();
                let lost: f64 = (0..mass.len()).filter(|&i| !drawn[i]).map(value).sum();
                prop_assert!(lost <= budget * all * (1.0 + 1e-9));
            }
        }
    }

    #[test]
    fn much_fainter_particles_are_left_out() {
        let mass: Vec<f32> = (0..100).map(|i| if i % 2 == 0 { 1.0 } else { 1e-7 }).collect();
        let drawn = thin(&mass, &[1.0; 100], 5e-4).unwrap();
        assert!((0..100).all(|i| drawn[i] == (i % 2 == 0)));
        assert!(thin(&[], &[], 5e-4).is_none());
        assert!(thin(&[1.0; 5], &[1.0; 5], 5e-4).is_none());
    }
}
