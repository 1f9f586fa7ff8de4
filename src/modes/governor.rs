//! A steady frame rate: how large a sample of a view's particles can be drawn in the time that a frame has.
//!
//! What drawing costs is proportional to the particles that are looked at, with a factor that depends on the machine, the
//! mode and the view. The governor measures it picture by picture; the sample is then the largest that fits, found
//! from the nodes alone, so that its cost does not depend on how many particles they hold. The sample is even
//! ([`crate::raster::sample`]): no light is lost on average, and larger samples contain the smaller ones, so that a
//! picture that comes to rest gains particles and none moves.

use super::economy::Plan;
use super::{CodeTable, Depiction};
use crate::raster::sample::GROUP;
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

/// `plan`, or where that looks at more than `limit` particles, the largest even sample that does not; and how many particles
/// are looked at. `most_important` has for each family and codebook that of its table.
pub fn within(
    limit: u64,
    plan: Plan,
    view: &View,
    depiction: &Depiction,
    metadata: &Metadata,
    nodes: &[SceneNode],
    most_important: &[Vec<f32>],
) -> (Plan, u64) {
    let part = |drawn: &SceneNode| {
        let family = drawn.page.family as usize;
        let node = drawn.page.nodes.get(drawn.node.node as usize)?;
        let most_important = *most_important.get(family)?.get(usize::from(node.codebook))?;
        let sample = plan.sample(view, depiction, metadata.families.get(family)?, node, most_important);
        Some((u64::from(sample.candidates(node.particles)), node.particles))
    };
    let parts: Vec<(u64, u32)> = nodes.iter().filter_map(part).collect();
    let usual: u64 = parts.iter().map(|part| part.0).sum();
    if usual <= limit {
        return (plan, usual);
    }
    let (share, looked_at) = share_within(limit, parts.iter().map(|part| part.1));
    (Plan { share, ..plan }, looked_at)
}

/// The largest share of nodes with so many particles that looks at no more than `limit` of them, and at how many it does. One
/// of each group is looked at for any share.
fn share_within(limit: u64, particles: impl Iterator<Item = u32>) -> (f32, u64) {
    let (groups, all) = particles
        .fold((0, 0), |(groups, all), count| (groups + u64::from(count.div_ceil(GROUP)), all + u64::from(count)));
    if all <= limit {
        return (1.0, all);
    }
    match limit / groups {
        // Not even one of each group is kept.
        0 => (limit as f32 / all as f32, groups),
        ranks => (ranks.min(u64::from(GROUP) - 1) as f32 / GROUP as f32, ranks * groups),
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
    use crate::hierarchy::NodeKey;
    use crate::raster::sample::Sample;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn samples_stay_within_the_limit_and_use_it(
            counts in prop::collection::vec(1..200_000_u32, 1..40),
            limit_share in 0.0..1.2_f64,
        ) {
            let all: u64 = counts.iter().map(|&count| u64::from(count)).sum();
            let groups: u64 = counts.iter().map(|count| u64::from(count.div_ceil(GROUP))).sum();
            let limit = (limit_share * all as f64) as u64;
            let (share, looked_at) = share_within(limit, counts.iter().copied());
            let sample = |i: usize| Sample::even(NodeKey { depth: 14, x: i as u32, y: 3, z: 5 }, share);
            let found: u64 = counts.iter().enumerate().map(|(i, &n)| u64::from(sample(i).candidates(n))).sum();
            prop_assert_eq!(looked_at, found);
            prop_assert!(looked_at <= limit.max(groups), "{looked_at} of {limit}, {groups} groups");
            prop_assert!(looked_at + groups > limit.min(all), "{looked_at} of {limit}: one rank more would fit");
            prop_assert!(share >= 1.0 || f64::from(share) <= limit_share + 1e-6);
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
