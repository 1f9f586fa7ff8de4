//! A steady frame rate: how large a sample of a view's particles can be drawn in the time that a frame has.
//!
//! What drawing costs is about proportional to the particles that are drawn, with a factor that depends on the machine, the
//! mode and the view. It is measured picture by picture; the sample is then the largest that fits, found
//! from the nodes alone, so that its cost does not depend on how many particles they hold. The sample is even
//! ([`crate::mode::sample`]): no light is lost on average, and larger samples contain the smaller ones, so that a
//! picture that comes to rest gains particles and none moves.

use crate::mode::lod_budget::Plan;
use crate::mode::{CodeTable, Depiction, Output};
use crate::store::Metadata;
use crate::stream::SceneNode;
use crate::view::View;

/// How much drawing costs, from the pictures drawn so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawingCost {
    /// Milliseconds for each particle, smoothed; none before the first picture.
    milliseconds: Option<f64>,
}

/// How many particles pictures have, whatever they cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleSizes {
    /// The first picture's, before anything was measured.
    pub first: u64,
    /// No picture has fewer, however slow the machine is: a picture must remain. At least [`LEAST`], below which no picture
    /// is measured.
    pub least: u64,
}

impl Default for SampleSizes {
    fn default() -> SampleSizes {
        SampleSizes { first: 200_000, least: LEAST }
    }
}

/// A picture of fewer particles says what a frame costs, not what a particle does.
pub const LEAST: u64 = 20_000;
/// Weight of a new measurement. Half: costs change as fast as the view does.
const WEIGHT: f64 = 0.5;

impl DrawingCost {
    /// How many particles a picture may have to be drawn in so many milliseconds.
    pub fn limit(&self, frame_ms: f64, sizes: SampleSizes) -> u64 {
        self.milliseconds.map_or(sizes.first, |each| ((frame_ms / each) as u64).max(sizes.least))
    }

    /// A picture of so many particles has taken so long.
    pub fn drew(&mut self, particles: u64, milliseconds: f64) {
        if particles < LEAST || !(milliseconds > 0.0 && milliseconds.is_finite()) {
            return;
        }
        let each = milliseconds / particles as f64;
        self.milliseconds = Some(self.milliseconds.map_or(each, |old| old + WEIGHT * (each - old)));
    }
}

/// `plan`, or where that looks at more than `limit` particles, an even sample of as many as `limit`; and how many that
/// are. `most_important` has for each family and codebook that of its table.
///
/// Of an even sample what counts is what is drawn, not what is looked at: one particle of each group is looked at however small
/// the share, but told from its number alone, while the fewer are drawn the larger their kernels.
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
        let most_important = match drawn.page.content(drawn.node.node as usize) {
            // All clusters that were chosen are drawn.
            Some(content) if !content.steps().is_empty() => {
                let clusters = u64::from(drawn.part.unwrap_or(node.particles));
                return Some((clusters, clusters));
            }
            // Not known without a look at its particles.
            Some(_) => f32::INFINITY,
            None => *most_important.get(family)?.get(usize::from(node.codebook))?,
        };
        let sample =
            plan.sample(&view.of_image(drawn.offset), depiction, metadata.families.get(family)?, node, most_important);
        Some((u64::from(sample.candidates(node.particles)), u64::from(node.particles)))
    };
    let (usual, all) = nodes.iter().filter_map(part).fold((0, 0), |(usual, all), part| (usual + part.0, all + part.1));
    // Of a maximum or a first hit a sample is another picture.
    if usual <= limit || depiction.mode.technique.output() == Output::Values {
        return (plan, usual);
    }
    // Not above 1: a plan looks at no more than there are.
    (Plan { share: (limit as f64 / all as f64) as f32, ..plan }, limit)
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

    proptest! {
        #[test]
        fn the_limit_follows_what_pictures_cost(each_us in 0.01..50.0_f64, then_us in 0.01..50.0_f64, target in 5.0..200.0_f64) {
            let mut drawing_cost = DrawingCost::default();
            let mut limit = drawing_cost.limit(target, SampleSizes::default());
            for each in [each_us, then_us] {
                for _ in 0..40 {
                    drawing_cost.drew(limit, limit as f64 * each * 1e-3);
                    limit = drawing_cost.limit(target, SampleSizes::default());
                }
                let took = limit as f64 * each * 1e-3;
                prop_assert!(took <= 1.02 * target || limit == LEAST, "{took} ms of {target}");
                prop_assert!(took >= 0.98 * target || limit == LEAST, "{took} ms of {target}");
            }
            drawing_cost.drew(3, 1e9);
            drawing_cost.drew(1 << 30, f64::NAN);
            prop_assert_eq!(drawing_cost.limit(target, SampleSizes::default()), limit);
            let sizes = SampleSizes { first: 5, least: 1 << 40 };
            prop_assert_eq!(DrawingCost::default().limit(target, sizes), 5);
            prop_assert_eq!(drawing_cost.limit(target, sizes), 1 << 40);
        }
    }
}
