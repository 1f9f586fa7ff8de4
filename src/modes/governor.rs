//! A steady frame rate: how large a sample of a view's particles can be drawn in the time that a frame has.
//!
//! What drawing costs is proportional to the particles that are looked at, with a factor that depends on the machine, the
//! mode and the view. The governor measures it picture by picture; the sample is then the largest that fits, found
//! from the nodes alone, so that its cost does not depend on how many particles they hold. The sample is that of
//! thinning ([`super::economy`]): no light is lost on average, and larger samples contain the smaller ones, so that a
//! picture that comes to rest gains particles and none moves.

use super::economy::{Plan, sampling_scale};
use super::{CodeTable, Depiction};
use crate::hierarchy::NodeKey;
use crate::raster::sample::Sample;
use crate::store::Metadata;
use crate::stream::SceneNode;
use crate::view::View;

/// How much drawing costs, from the pictures drawn so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Governor {
    /// Milliseconds for each particle that is looked at, smoothed; none before the first picture.
    milliseconds: Option<f64>,
}

/// Particles of the first picture, before anything was measured.
const FIRST: u64 = 200_000;
/// No picture has fewer, however slow the machine is: a picture must remain.
const LEAST: u64 = 20_000;
/// Weight of a new measurement. Half: costs change as fast as the view does.
const WEIGHT: f64 = 0.5;

impl Governor {
    /// How many particles a picture may look at to be drawn in so many milliseconds.
    pub fn limit(&self, frame_ms: f64) -> u64 {
        self.milliseconds.map_or(FIRST, |each| ((frame_ms / each) as u64).max(LEAST))
    }

    /// A picture that looked at so many particles has taken so long.
    pub fn drew(&mut self, particles: u64, milliseconds: f64) {
        // A nearly empty picture says what a frame costs, not what a particle does.
        if particles < LEAST || !(milliseconds > 0.0 && milliseconds.is_finite()) {
            return;
        }
        let each = milliseconds / particles as f64;
        self.milliseconds = Some(self.milliseconds.map_or(each, |old| old + WEIGHT * (each - old)));
    }
}

/// How many particles of a selection a sample looks at.
pub struct Workload {
    nodes: Vec<Part>,
}

/// One node's part of a workload.
struct Part {
    key: NodeKey,
    particles: u32,
    most_important: f32,
    /// See [`sampling_scale`].
    scale: Option<f64>,
}

impl Workload {
    /// The workload of `nodes` in `view`. `most_important` has for each family and codebook that of its table.
    pub fn new(
        view: &View,
        depiction: &Depiction,
        metadata: &Metadata,
        nodes: &[SceneNode],
        most_important: &[Vec<f32>],
    ) -> Workload {
        let part = |drawn: &SceneNode| {
            let family = drawn.page.family as usize;
            let node = drawn.page.nodes.get(drawn.node.node as usize)?;
            Some(Part {
                key: node.key,
                particles: node.particles,
                most_important: *most_important.get(family)?.get(usize::from(node.codebook))?,
                scale: sampling_scale(view, depiction, metadata.families.get(family)?, node),
            })
        };
        Workload { nodes: nodes.iter().filter_map(part).collect() }
    }

    /// The number of particles in all nodes.
    pub fn particles(&self) -> u64 {
        self.nodes.iter().map(|part| u64::from(part.particles)).sum()
    }

    /// The number of particles that a sample with the factor `c` looks at.
    pub fn candidates(&self, c: f32) -> u64 {
        let of = |part: &Part| match part.scale {
            Some(scale) if c < f32::INFINITY => {
                let sample = Sample::new(part.key, (f64::from(c) * scale) as f32, part.most_important);
                u64::from(sample.candidates(part.particles))
            }
            _ => u64::from(part.particles),
        };
        self.nodes.iter().map(of).sum()
    }

    /// `plan` with a sample that looks at no more than `limit` particles, or at the fewest there can be, and how many
    /// it looks at.
    pub fn within(&self, limit: u64, plan: Plan) -> (Plan, u64) {
        let all = self.candidates(plan.keep);
        if all <= limit {
            return (plan, all);
        }
        // Bisection of the logarithm: larger factors look at more.
        let (mut low, mut high) = (-40.0_f32, plan.keep.log2().min(16.0));
        for _ in 0..14 {
            let middle = 0.5 * (low + high);
            if self.candidates(middle.exp2()) > limit { high = middle } else { low = middle }
        }
        let keep = low.exp2();
        (Plan { keep, ..plan }, self.candidates(keep))
    }
}

/// For each family and codebook the largest importance in its table.
pub fn most_important(depiction: &Depiction, metadata: &Metadata) -> Vec<Vec<f32>> {
    let of = |table: CodeTable| table.most_important;
    let families = metadata.families.iter();
    families.map(|family| family.codebooks.iter().map(|book| of(depiction.table(family, book))).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn workload(parts: &[(u32, f32, bool)]) -> Workload {
        let part = |(i, &(particles, scale, thins)): (usize, &(u32, f32, bool))| Part {
            key: NodeKey { depth: 14, x: i as u32, y: 3, z: 5 },
            particles,
            most_important: 2.0,
            scale: thins.then_some(f64::from(scale)),
        };
        Workload { nodes: parts.iter().enumerate().map(part).collect() }
    }

    proptest! {
        #[test]
        fn samples_stay_within_the_limit_and_use_it(
            parts in prop::collection::vec((1..200_000_u32, 0.01..10.0_f32, prop::bool::weighted(0.9)), 1..40),
            share in 0.0..1.2_f64,
        ) {
            let workload = workload(&parts);
            let all = workload.particles();
            prop_assert_eq!(workload.candidates(f32::INFINITY), all);
            let limit = (share * all as f64) as u64;
            let (plan, looked_at) = workload.within(limit, Plan::default());
            prop_assert_eq!(looked_at, workload.candidates(plan.keep));
            let least = workload.candidates(0.0);
            prop_assert!(looked_at <= limit.max(least), "{looked_at} of {limit}, at least {least}");
            if limit >= all {
                prop_assert_eq!(plan, Plan::default());
            } else if limit > least {
                // One rank more in every node would be too much: the limit is used up to that.
                let rank: u64 = parts.iter().map(|part| u64::from(part.0.div_ceil(64))).sum();
                prop_assert!(looked_at + rank >= limit.min(workload.candidates(60_000.0)), "{looked_at} of {limit}");
            }
            // A plan that leaves out more already stays as it is.
            let thin = Plan { keep: 1e-9, ..Plan::default() };
            prop_assert_eq!(workload.within(least.max(limit), thin).0, thin);
        }

        #[test]
        fn the_limit_follows_what_pictures_cost(each_us in 0.01..50.0_f64, then_us in 0.01..50.0_f64, target in 5.0..200.0_f64) {
            let mut governor = Governor::default();
            let mut limit = governor.limit(target);
            for each in [each_us, then_us] {
                for _ in 0..40 {
                    governor.drew(limit, limit as f64 * each * 1e-3);
                    limit = governor.limit(target);
                }
                let took = limit as f64 * each * 1e-3;
                prop_assert!(took <= 1.02 * target || limit == LEAST, "{took} ms of {target}");
                prop_assert!(took >= 0.98 * target || limit == LEAST, "{took} ms of {target}");
            }
            governor.drew(3, 1e9);
            governor.drew(1 << 30, f64::NAN);
            prop_assert_eq!(governor.limit(target), limit);
        }
    }
}
