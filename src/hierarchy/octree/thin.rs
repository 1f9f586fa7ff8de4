//! Presence thinning (F12 4.7.3): the faintest particles of an inner node are left out.
//!
//! The paper drops a particle when `n P_i < P_min`, with an `n` found by looking at pictures. Here the rule is a budget:
//! those left out have together at most a stated share of the node's mass and of its `sum m rho`, whatever the picture's
//! range. A particle's rank is the larger of its two shares. The node's mass scale gives the lost mass back.

use super::block::Block;

/// Bins of the histogram of shares: the exponent and three bits of the significand of a single.
const BINS: usize = 1 << 12;

/// Marks the particles of a node to leave out, with at most `budget` of its mass and of its `sum m rho`.
pub(super) fn thin(blocks: &mut [Block], budget: f64) {
    let total: f64 = blocks.iter().flat_map(|block| &block.columns.mass).map(|&m| f64::from(m)).sum();
    let presence: f64 = blocks.iter().flat_map(presences).sum();
    if budget <= 0.0 || !(total > 0.0 && presence > 0.0 && total.is_finite() && presence.is_finite()) {
        return;
    }
    let share = |mass: f32, density: f32| {
        let m = f64::from(mass);
        (m / total).max(m * f64::from(density) / presence) as f32
    };
    // What lies in each bin of shares, up to that of the budget: whatever is brighter cannot be left out.
    let ceiling = bin(budget.min(1.0) as f32);
    let mut bins = vec![(0.0_f64, 0.0_f64); ceiling + 1];
    for block in &*blocks {
        for (&mass, &density) in block.columns.mass.iter().zip(&block.columns.density) {
            let bin = bin(share(mass, density));
            if bin <= ceiling {
                bins[bin].0 += f64::from(mass);
                bins[bin].1 += f64::from(mass) * f64::from(density);
            }
        }
    }
    let (mut mass_left, mut presence_left) = (budget * total, budget * presence);
    let mut limit = 0;
    for (mass, density) in bins {
        mass_left -= mass;
        presence_left -= density;
        if mass_left < 0.0 || presence_left < 0.0 {
            break;
        }
        limit += 1;
    }
    for block in blocks {
        let marks: Vec<bool> = (block.columns.mass.iter().zip(&block.columns.density))
            .map(|(&mass, &density)| bin(share(mass, density)) < limit)
            .collect();
        if marks.contains(&true) {
            block.skipped = marks;
        }
    }
}

fn presences(block: &Block) -> impl Iterator<Item = f64> + '_ {
    block.columns.mass.iter().zip(&block.columns.density).map(|(&m, &rho)| f64::from(m) * f64::from(rho))
}

/// The bin of a non-negative share.
fn bin(share: f32) -> usize {
    (share.to_bits() >> 20) as usize & (BINS - 1)
}

#[cfg(test)]
mod tests {
    use super::super::sorted::Columns;
    use super::*;
    use proptest::prelude::*;

    fn block(particles: &[(f32, f32)]) -> Block {
        let columns = Columns {
            mass: particles.iter().map(|p| p.0).collect(),
            density: particles.iter().map(|p| p.1).collect(),
            ..Columns::default()
        };
        Block { keys: vec![0; particles.len()], columns, ..Block::default() }
    }

    proptest! {
        #[test]
        fn the_faintest_go_and_the_budget_holds(
            particles in prop::collection::vec((-20.0..5.0_f32, -20.0..5.0_f32), 1..400),
            budget in 1e-5..0.2_f64,
        ) {
            let particles: Vec<(f32, f32)> = particles.iter().map(|p| (p.0.exp2(), p.1.exp2())).collect();
            let mut blocks = [block(&particles[..particles.len() / 2]), block(&particles[particles.len() / 2..])];
            thin(&mut blocks, budget);
            let skipped: Vec<bool> =
                blocks.iter().flat_map(|block| (0..block.len()).map(|i| block.is_skipped(i))).collect();
            let presence = |p: &(f32, f32)| f64::from(p.0) * f64::from(p.1);
            for value in [&|p: &(f32, f32)| f64::from(p.0), &presence as &dyn Fn(&(f32, f32)) -> f64] {
                let all: f64 = particles.iter().map(value).sum();
                let lost: f64 = particles.iter().zip(&skipped).filter(|(_, skipped)| **skipped).map(|(p, _)| value(p)).sum();
                prop_assert!(lost <= budget * all * (1.0 + 1e-9));
            }
        }
    }

    #[test]
    fn much_fainter_particles_are_left_out() {
        let particles: Vec<(f32, f32)> = (0..100).map(|i| if i % 2 == 0 { (1.0, 1.0) } else { (1e-7, 1.0) }).collect();
        let mut blocks = [block(&particles)];
        thin(&mut blocks, 5e-4);
        assert!((0..100).all(|i| blocks[0].is_skipped(i) == (i % 2 == 1)));
        thin(&mut [block(&[])], 5e-4);
    }
}
