//! What a codebook is trained on.

use super::batches::{BatchInfo, Batches};
use super::vectors::Scaling;
use crate::codec::packing::VqBits;
use crate::codec::quantizer::LbgLimits;
use rayon::prelude::*;

/// Vectors for each entry in the sample where several codebooks share the effort.
const LEAST_SAMPLE: usize = 32;

/// Training effort for a number of bits, and a number of codebooks that share it: vectors in the sample, and LBG's limits. The sample is large enough to give
/// each code a few vectors, and bounded, so that training does not grow with the data.
pub(super) fn effort(bits: VqBits, books: usize) -> (usize, LbgLimits) {
    let (sample, limits) = match bits {
        VqBits::Eight => (1 << 15, LbgLimits { k_max: 8, epsilon: 0.01 }),
        VqBits::Twelve => (1 << 17, LbgLimits { k_max: 3, epsilon: 0.02 }),
        VqBits::Sixteen => (1 << 18, LbgLimits { k_max: 1, epsilon: 0.05 }),
    };
    ((sample / books.max(1)).max(LEAST_SAMPLE * bits.entries()).min(sample), limits)
}

/// About `len` vectors for training (all of them if there are no more). Half of the sample is spread evenly over the
/// particles, half over their shares of `sum m` and `sum m rho`: what dominates the picture gets its codes even if it is
/// rare. Without that, one bright outlier can end in a cluster of faint particles, whose mean it then is.
pub(super) fn sample<const L: usize, B: Batches>(
    batches: &B,
    scaling: &Scaling,
    len: usize,
) -> Result<Vec<[f32; L]>, B::Error> {
    let infos: Vec<BatchInfo> = (0..batches.len()).map(|batch| batches.info(batch)).collect();
    let all = infos.iter().fold(BatchInfo::default(), |sum, info| BatchInfo {
        particles: sum.particles + info.particles,
        mass: sum.mass + info.mass,
        mass_density: sum.mass_density + info.mass_density,
    });
    let everything = all.particles <= len;
    let by_count = 0.5 * len as f64 / all.particles.max(1) as f64;
    let share = |all: f64| if all > 0.0 && all.is_finite() { 0.25 * len as f64 / all } else { 0.0 };
    let (by_mass, by_presence) = (share(all.mass), share(all.mass_density));
    // Where each batch starts in the running sum that decides which particles are taken.
    let starts: Vec<f64> = infos
        .iter()
        .scan(0.0, |at, info| {
            let start = *at;
            *at += info.particles as f64 * by_count + info.mass * by_mass + info.mass_density * by_presence;
            Some(start)
        })
        .collect();
    let parts: Vec<Vec<[f32; L]>> = starts
        .into_par_iter()
        .enumerate()
        .map(|(batch, start)| {
            batches.with(batch, |batch| {
                let (mut at, mut passed) = (start, start.floor());
                let taken = (0..batch.len()).filter(|&i| {
                    let mass = f64::from(batch.mass[i]);
                    at += by_count + mass * by_mass + mass * f64::from(batch.density[i]) * by_presence;
                    let before = passed;
                    // Most stay between the same whole numbers; rounding down is a call where no instruction is known to do it.
                    if !(passed..passed + 1.0).contains(&at) {
                        passed = at.floor();
                    }
                    everything || passed > before
                });
                taken.map(|i| scaling.vector(batch, i)).collect()
            })
        })
        .collect::<Result<_, _>>()?;
    Ok(parts.concat())
}
