//! What is known of nodes that are drawn: their level, what they draw, and how far that is from the particles it stands for.

use crate::cpu::{NodeTraits, SplatKind};
use crate::stream::SceneNode;

/// Sum of the misfits of the clusters that are drawn of a node, times their masses; `None` for other particles.
pub fn misfit(drawn: &SceneNode) -> Option<f64> {
    let index = drawn.node.node as usize;
    let node = drawn.page.nodes.get(index)?;
    let steps = drawn.page.content(index).map_or(&[][..], |content| content.steps());
    let clusters = drawn.part.unwrap_or(node.particles);
    // With fewer clusters the misfit is larger.
    steps.iter().rfind(|step| step.clusters <= clusters).map(|step| step.misfit)
}

/// What is known of a node.
pub fn traits(drawn: &SceneNode) -> Option<NodeTraits> {
    let node = drawn.page.nodes.get(drawn.node.node as usize)?;
    let (kind, misfit) = match misfit(drawn) {
        Some(misfit) => (SplatKind::Cluster, Some((misfit / node.mass).min(2.0))),
        None if node.is_leaf() => (SplatKind::Leaf, Some(0.0)),
        None => (SplatKind::Merged, None),
    };
    Some(NodeTraits { level: node.depth, kind, misfit })
}
