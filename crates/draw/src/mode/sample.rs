//! Which particles of a node a thinned picture draws: a stratified sample that the processor and the shaders agree on to
//! the last particle, whose sum is expected to be that of all.
//!
//! The particles of a node lie in Morton order. Each group of [`GROUP`] neighbours is ranked by a tree of coin tosses (Owen
//! scrambling of the van der Corput sequence): among the first `2^k` ranks of a group there is exactly one particle of each
//! of its `2^k` equal runs, so that what is kept is spread over the group as evenly as it can be. With a jitter below one
//! rank, a particle's place `u` in [0, 1) is equally likely everywhere; one that is to be kept with probability `p` is kept
//! if `u < p` and then counts `1/p` times. So
//!
//! - the sum over what is kept is expected to be the sum over all (over the tosses), for every pixel,
//! - what is kept at a smaller `p` is a part of what is kept at a larger one, so that pictures do not flicker,
//! - tosses depend on the node's seed and the particle's number alone.
//!
//! A sample that is drawn only for want of time is even: every particle is as likely as any other, so that no more are looked
//! at than are drawn, and kernels grow to fill the gaps ([`Sample::even`]).
//!
//! The shaders' twin is `shaders/lib/sample.wgsl`. Both compare 24-bit integers with one product of singles, which has the
//! same value on every machine.

use crate::hierarchy::cell::mix;

/// Particles that are ranked among themselves; consecutive in a node.
pub const GROUP: u32 = 64;
/// Places that a particle can have, all equally likely.
const PLACES: f32 = 16_777_216.0;

/// Which particles of one node are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Tosses the coins.
    pub seed: u32,
    /// A particle of importance `q` is kept with probability `min(1, q scale)`; infinite: every one is.
    pub scale: f32,
    /// No particle with this rank or a higher one is kept; at most [`GROUP`].
    pub ranks: u32,
    /// Whether importance does not count: every particle is kept with probability `scale`.
    pub even: bool,
    /// Factor on the smoothing lengths.
    pub growth: f32,
}

impl Default for Sample {
    fn default() -> Sample {
        Sample::ALL
    }
}

impl Sample {
    /// Every particle.
    pub const ALL: Sample = Sample { seed: 0, scale: f32::INFINITY, ranks: GROUP, even: false, growth: 1.0 };

    /// Particles with probability `importance * scale`, where no particle's importance is above `most`.
    pub fn new(seed: u32, scale: f32, most: f32) -> Sample {
        let least = scale * most * GROUP as f32;
        if !(scale.is_finite() && least.is_finite()) {
            return Sample::ALL;
        }
        // One rank more than is expected: rounding must not cut off what the test below keeps.
        let ranks = (least as u32).saturating_add(1).clamp(1, GROUP);
        Sample { seed, scale: scale.max(0.0), ranks, ..Sample::ALL }
    }

    /// A share of the particles, each as likely as any other. Their kernels are [`growth`] times as large.
    pub fn even(seed: u32, share: f32) -> Sample {
        if share.is_nan() || share >= 1.0 {
            return Sample::ALL;
        }
        let scale = share.max(0.0);
        // Exact: products with powers of two are.
        let ranks = ((scale * GROUP as f32).ceil() as u32).clamp(1, GROUP);
        Sample { seed, scale, ranks, even: true, growth: growth(scale) }
    }

    /// Whether every particle is drawn.
    pub fn is_all(&self) -> bool {
        self.scale == f32::INFINITY
    }

    /// Particles that are looked at, of `count`.
    pub fn candidates(&self, count: u32) -> u32 {
        match self.ranks {
            GROUP => count,
            ranks => count.div_ceil(GROUP) * ranks,
        }
    }

    /// The sample of the particles from number `first` on, a multiple of [`GROUP`], numbered from there.
    pub fn from(&self, first: u32) -> Sample {
        Sample { seed: self.seed.wrapping_add(first / GROUP), ..*self }
    }

    /// The factor on the weight of particle `index` of this importance; `None` if it is not drawn.
    #[inline]
    pub fn factor(&self, index: u32, importance: f32) -> Option<f32> {
        let p = if self.even { self.scale } else { importance * self.scale };
        if p >= 1.0 {
            return Some(1.0);
        }
        // NaN is not kept.
        ((self.place(index) as f32) < p * PLACES).then(|| 1.0 / p)
    }

    /// Calls `keep` with the number and the factor on the weight of each particle that is drawn.
    pub fn each(&self, count: u32, importance: impl Fn(u32) -> f32, mut keep: impl FnMut(u32, f32)) {
        if self.is_all() {
            return (0..count).for_each(|index| keep(index, 1.0));
        }
        if self.ranks == GROUP {
            for index in 0..count {
                if let Some(factor) = self.factor(index, importance(index)) {
                    keep(index, factor);
                }
            }
            return;
        }
        for group in 0..count.div_ceil(GROUP) {
            let tosses = Tosses::new(self.seed.wrapping_add(group));
            for rank in 0..self.ranks {
                let index = group * GROUP + tosses.lane(rank);
                if index < count
                    && let Some(factor) = self.factor(index, importance(index))
                {
                    keep(index, factor);
                }
            }
        }
    }

    /// The place of a particle among [`PLACES`].
    #[inline]
    fn place(&self, index: u32) -> u32 {
        let group = self.seed.wrapping_add(index / GROUP);
        let rank = Tosses::new(group).rank(index % GROUP);
        (rank << 18) | (mix(group ^ (index % GROUP + 1).wrapping_mul(0x9e37_79b9)) >> 14)
    }
}

/// Factor on the smoothing lengths of an even sample: `share^(-1/5)`, at most 4. Kernels that grow blur what fewer of them
/// would leave as noise; `share^(-1/3)` would keep the number of kernels over a point, and costs dense places more colour than
/// the noise does (docs/results.md).
fn growth(share: f32) -> f32 {
    libm::powf(share.max(1e-6), -0.2).min(4.0)
}

/// The coins of one group: one for each inner node of a binary tree over its particles, in the order of a heap.
struct Tosses(u32, u32);

impl Tosses {
    #[inline]
    fn new(group: u32) -> Tosses {
        let first = mix(group);
        Tosses(first, mix(first ^ 0x9e37_79b9))
    }

    /// The coin at the end of `path`, which has `level` steps.
    #[inline]
    fn coin(&self, level: u32, path: u32) -> u32 {
        // 1 + 2 + .. + 16 coins are in the first word, the other 32 in the second.
        if level < 5 { self.0 >> ((1 << level) - 1 + path) & 1 } else { self.1 >> path & 1 }
    }

    /// The place in the group of the particle with this rank.
    #[inline]
    fn lane(&self, rank: u32) -> u32 {
        (0..6).fold(0, |path, level| path << 1 | (rank >> level & 1 ^ self.coin(level, path)))
    }

    /// The rank of the particle at this place in the group.
    #[inline]
    fn rank(&self, lane: u32) -> u32 {
        (0..6).fold(0, |rank, level| {
            let path = lane >> (6 - level);
            rank | (lane >> (5 - level) & 1 ^ self.coin(level, path)) << level
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hierarchy::NodeKey;
    use proptest::prelude::*;

    fn kept(sample: Sample, count: u32, importance: impl Fn(u32) -> f32) -> Vec<(u32, f32)> {
        let mut all = Vec::new();
        sample.each(count, importance, |index, factor| all.push((index, factor)));
        all.sort_unstable_by_key(|kept| kept.0);
        all
    }

    fn seed(x: u32) -> u32 {
        NodeKey { depth: 14, x, y: 3, z: 5 }.seed()
    }

    proptest! {
        #[test]
        fn ranks_are_a_permutation_and_every_prefix_is_even(seed in any::<u32>(), level in 0..6u32) {
            let tosses = Tosses::new(seed);
            for rank in 0..GROUP {
                prop_assert_eq!(tosses.rank(tosses.lane(rank)), rank);
            }
            let run = GROUP >> level;
            let mut runs: Vec<u32> = (0..1 << level).map(|rank| tosses.lane(rank) / run).collect();
            runs.sort_unstable();
            prop_assert_eq!(runs, (0..1 << level).collect::<Vec<_>>());
        }

        #[test]
        fn smaller_samples_are_parts_of_larger_ones(x in 0..9999u32, count in 1..500u32, p in 0.0..1.2f32, share in 0.0..1.0f32) {
            let importance = |index: u32| 1.0 / (1.0 + (index % 7) as f32);
            let large = kept(Sample::new(seed(x), p, 1.0), count, importance);
            let small = kept(Sample::new(seed(x), p * share, 1.0), count, importance);
            prop_assert!(small.iter().all(|s| large.iter().any(|l| l.0 == s.0)));
            // Skipping ranks leaves out nothing that is kept.
            prop_assert_eq!(kept(Sample { ranks: GROUP, ..Sample::new(seed(x), p, 1.0) }, count, importance), large);
            // A part of a node has the tosses of the whole.
            let behind: Vec<_> = kept(Sample::new(seed(x), p, 1.0).from(128), count, |i| importance(i + 128));
            let whole = kept(Sample::new(seed(x), p, 1.0), count + 128, importance);
            prop_assert_eq!(behind, whole.into_iter().filter(|k| k.0 >= 128).map(|k| (k.0 - 128, k.1)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn sums_are_expected_to_be_those_of_all() {
        let importance = |index: u32| 0.02 + 1.5 * (index % 50) as f32 / 50.0;
        let (count, nodes) = (199, 4000);
        let mut sums = vec![0.0; count as usize];
        for x in 0..nodes {
            for (index, factor) in kept(Sample::new(seed(x), 0.7, 1.6), count, importance) {
                sums[index as usize] += f64::from(factor) / f64::from(nodes);
            }
        }
        for (index, mean) in sums.iter().enumerate() {
            let p = f64::from(importance(index as u32) * 0.7).min(1.0);
            // Five standard deviations.
            let bound = 5.0 * ((1.0 / p - 1.0) / f64::from(nodes)).sqrt();
            assert!((mean - 1.0).abs() <= bound + 1e-6, "{index}: {mean}, p {p}");
        }
    }

    #[test]
    fn even_samples_look_at_what_they_keep_and_are_parts_of_larger_ones() {
        for count in [64, 6400, 6401] {
            let mut last = Vec::new();
            for share in (1..=128).map(|part| part as f32 / 128.0) {
                let sample = Sample::even(seed(7), share);
                let now = kept(sample, count, |_| f32::NAN);
                let ranks = share * GROUP as f32;
                if ranks.fract() == 0.0 && count.is_multiple_of(GROUP) {
                    assert_eq!(sample.candidates(count), now.len() as u32, "whole ranks: {share}");
                }
                assert!(now.iter().all(|&(_, factor)| factor == 1.0 / share));
                let mean = f64::from(count) * f64::from(share);
                let kept = now.len() as f64;
                assert!((kept - mean).abs() <= 4.0 * (mean + 1.0).sqrt(), "{kept} of {count} for {share}");
                let has = |index: u32| now.binary_search_by_key(&index, |kept| kept.0).is_ok();
                assert!(last.iter().all(|&(index, _): &(u32, f32)| has(index)));
                last = now;
            }
            assert_eq!(last.len() as u32, count);
        }
        assert_eq!(Sample::even(seed(7), f32::NAN), Sample::ALL);
        assert_eq!(Sample::even(seed(7), 0.5).growth, 2_f32.powf(0.2));
        assert_eq!(Sample::even(seed(7), 0.0).growth, 4.0);
        assert_eq!(kept(Sample::even(seed(7), 0.0), 640, |_| 1.0), []);
    }

    #[test]
    fn everything_is_drawn_unless_asked_otherwise() {
        assert_eq!(kept(Sample::ALL, 130, |_| 0.0).len(), 130);
        assert_eq!(Sample::new(seed(1), f32::INFINITY, 1.0), Sample::ALL);
        assert_eq!(Sample::new(seed(1), 1.0, f32::NAN), Sample::ALL);
        assert!(kept(Sample::new(seed(1), 0.0, 1.0), 130, |_| 1.0).is_empty());
        assert_eq!(Sample::new(seed(1), 0.1, 1.0).candidates(130), 3 * 7);
    }
}
