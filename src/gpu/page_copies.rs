//! Copies of whole pages in the renderer's arena: how the nodes of a page are named there, put in, looked after and
//! taken out.

use super::clusters::ClusterNode;
use super::content_look::ContentLook;
use super::moving::MovingNode;
use super::scene::{NodeId, NodeState, NodeUpload, ParticleScene, Payload, TableId};
use super::view::DrawItem;
use crate::codec::clusters::cluster_limit;
use crate::mode::sample::Sample;
use crate::mode::{Depiction, Plan};
use crate::store::{Content, Metadata, Node, Page, PageId};
use crate::stream::SceneNode;
use crate::view::View;
use std::sync::Arc;

/// Where the copy of a page stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CopyState {
    /// Some of its nodes wait for their turn.
    Waiting,
    /// All of it is there.
    Complete,
    /// There was no room for all of it.
    Rejected,
}

/// The renderer's name for a node of a page; `source` tells open files apart.
pub fn node_id(source: u32, page: PageId, node: u32) -> NodeId {
    NodeId { source, page: page.0, node }
}

/// The nodes of a page that hold coded particles, such as move, or clusters: the arena knows no others.
fn drawable(page: &Page) -> impl Iterator<Item = u32> {
    let is_known = |(index, node): &(usize, &Node)| {
        let is_known = |content: &dyn Content| content.moves() || !content.steps().is_empty();
        node.particles > 0 && page.content(*index).is_none_or(is_known)
    };
    page.nodes.iter().enumerate().filter(is_known).map(|(index, _)| index as u32)
}

/// Queues a page for upload; what moves, and clusters, for a look at them, and no other one.
pub fn insert(scene: &ParticleScene, source: u32, page: &Arc<Page>, look: &Arc<ContentLook>) {
    scene.insert_nodes(drawable(page).map(|node| {
        let frame = page.nodes[node as usize].frame;
        let (page, look) = (Arc::clone(page), Arc::clone(look));
        NodeUpload {
            id: node_id(source, page.id, node),
            min: frame.min,
            size: frame.size,
            payload: match page.content(node as usize) {
                Some(content) if content.moves() => Payload::Moving(MovingNode { page, node, look }),
                Some(_) => Payload::Clusters(ClusterNode { page, node, look }),
                None => Payload::Page { page, node },
            },
        }
    }));
}

/// What is drawn of a node that is selected for a view: the sample that `plan` says. `tables` has a table for each family and codebook, and
/// its largest importance.
pub fn item(
    source: u32,
    drawn: &SceneNode,
    view: &View,
    (depiction, metadata, plan): (&Depiction, &Metadata, &Plan),
    tables: &[Vec<(TableId, f32)>],
) -> Option<DrawItem> {
    let (index, family) = (drawn.node.node as usize, drawn.page.family as usize);
    let node = drawn.page.nodes.get(index)?;
    let sample = |most_important: f32| {
        Some(plan.sample(&view.of_image(drawn.offset), depiction, metadata.families.get(family)?, node, most_important))
    };
    let (table, sample) = match drawn.page.content(index) {
        // Its particles' importance is known to nobody beforehand: of what moves, samples are even ones or everything.
        Some(_) => (None, sample(f32::INFINITY).filter(|sample| sample.even).unwrap_or(Sample::ALL)),
        None => {
            let (table, most_important) = *tables.get(family)?.get(usize::from(node.codebook))?;
            (Some(table), sample(most_important)?)
        }
    };
    Some(DrawItem {
        node: node_id(source, drawn.node.page, drawn.node.node),
        table,
        weight_scale: depiction.node_scale(node),
        offset: drawn.offset,
        sample,
        limit: cluster_limit(drawn.part, node.particles),
    })
}

/// Where the copy of a page that was put in stands.
pub fn state(scene: &ParticleScene, source: u32, page: &Page) -> CopyState {
    let mut state = CopyState::Complete;
    for index in drawable(page) {
        match scene.node_state(node_id(source, page.id, index)) {
            Some(NodeState::Resident) => {}
            Some(NodeState::Rejected) => return CopyState::Rejected,
            Some(NodeState::Queued) | None => state = CopyState::Waiting,
        }
    }
    state
}

/// Frees the copy of a page with so many nodes.
pub fn remove(scene: &ParticleScene, source: u32, page: PageId, nodes: u32) {
    scene.remove_nodes((0..nodes).map(|node| node_id(source, page, node)));
}
