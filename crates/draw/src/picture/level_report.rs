//! What levels a picture was drawn from, and how far it may be from what is left out: for its statistics.

use super::node_traits::misfit;
use crate::cpu::over::Order;
use crate::mode::{Conserved, Depiction};
use crate::model::Bounds;
use crate::stream::SceneNode;
use crate::view::{Extent, Projection, View};
use glam::DVec3;
use serde::Serialize;

/// The levels of a picture of sums.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LevelReport {
    /// Their name: `splats`, `clusters`, or `source`.
    pub levels: &'static str,
    /// Splats that were selected, in all families.
    pub splats: u64,
    /// The largest number of splats, where one was set.
    pub budget: Option<u64>,
    /// Of clusters: no picture of all leaves differs by more, relative L1 of the sums ([`bound`]).
    pub error_bound: Option<f64>,
    /// Of clusters: by how much it is thought to differ ([`estimate`]).
    pub error_estimate: Option<f64>,
    /// In which order splats lie over each other; `null` where they are added.
    pub order: Option<&'static str>,
}

impl LevelReport {
    /// The same of a picture that an adapter has drawn, which knows no order but the exact one.
    #[must_use]
    pub fn by_adapter(self) -> LevelReport {
        LevelReport { order: self.order.map(|_| Order::Exact.name()), ..self }
    }
}

/// A bound on the relative L1 distance of the sums of some nodes, `total` of them over all pixels, from those of all leaves: what the clusters
/// differ in space from the particles they stand for ([`crate::hierarchy::pca::members::misfit`]), which projection does not enlarge. What
/// codes round comes on top, and is far below it. `None` for weights other than mass, whose sums the hierarchy has no bounds for.
pub fn bound(view: &View, depiction: &Depiction, nodes: &[SceneNode], total: f64) -> Option<f64> {
    bound_of(depiction, misfit_in(view, nodes), total)
}

/// The same of a panorama about an eye, over the solid angle; `total`: the integral of its sums over that.
pub fn bound_around(eye: DVec3, depiction: &Depiction, nodes: &[SceneNode], total: f64) -> Option<f64> {
    let misfit =
        misfit_of(nodes, |bounds, size| eye.distance(eye.clamp(bounds.min, bounds.max)).max(0.5 * size).recip());
    bound_of(depiction, misfit, total)
}

/// How much the sums of nodes in a view, over all pixels, may differ from those of all leaves: that of several nodes is the sum of theirs.
pub fn misfit_in(view: &View, nodes: &[SceneNode]) -> f64 {
    misfit_of(nodes, |bounds, size| {
        let nearest = || view.nearest_depth(&Extent { bounds, margin: 0.0 }).max(0.5 * size);
        match view.projection {
            Projection::Orthographic { .. } => view.focal_pixels(),
            Projection::Perspective { .. } => view.focal_pixels() / nearest(),
        }
    })
}

/// The same where a world unit within a node of some bounds and size is so wide at most.
fn misfit_of(nodes: &[SceneNode], widest: impl Fn(Bounds, f64) -> f64) -> f64 {
    let of = |drawn: &SceneNode| {
        let Some(node) = drawn.page.nodes.get(drawn.node.node as usize) else { return 0.0 };
        let Some(misfit) = misfit(drawn) else { return 0.0 };
        misfit * widest(node.bounds.moved(drawn.offset), node.frame.size).powi(2)
    };
    nodes.iter().map(of).sum()
}

/// The bound that a misfit comes to, as [`bound`] says.
pub fn bound_of(depiction: &Depiction, misfit: f64, total: f64) -> Option<f64> {
    if depiction.mode.conserves != Conserved::Mass {
        return None;
    }
    let share = if misfit == 0.0 { 0.0 } else { misfit / total };
    Some((share + ROUNDING).min(2.0))
}

/// By how much two pictures of the same splats may differ, relative L1: what single precision rounds when they are added in another order.
pub const ROUNDING: f64 = 1e-6;

/// Whether any node is drawn as clusters.
pub fn has_clusters(nodes: &[SceneNode]) -> bool {
    let is_clusters = |drawn: &SceneNode| {
        drawn.page.content(drawn.node.node as usize).is_some_and(|content| !content.steps().is_empty())
    };
    nodes.iter().any(is_clusters)
}

/// An estimate of the relative L1 distance of a picture's sums from those of all leaves, from those of another picture with half as many
/// splats: errors fall with a power of the number, so that what the last doubling has changed is about what is left.
pub fn estimate(sums: &[f32], of_half: &[f32]) -> f64 {
    let differ: f64 = sums.iter().zip(of_half).map(|(a, b)| f64::from((a - b).abs())).sum();
    let total: f64 = sums.iter().map(|p| f64::from(p.abs())).sum();
    if differ == 0.0 { ROUNDING } else { (LEFT * differ / total).max(ROUNDING) }
}

/// What is left of an error, in units of what the last doubling of splats has changed: measured on particles of all kinds
/// (`docs/results.md`).
const LEFT: f64 = 0.9;
