//! Copies of whole pages in the renderer's arena: how the nodes of a page are named there, put in, looked after and
//! taken out.

use super::scene::{NodeId, NodeState, NodeUpload, ParticleScene, Payload};
use crate::store::{Node, Page, PageId};
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

/// The nodes of a page that hold coded particles: the arena knows no others.
fn drawable(page: &Page) -> impl Iterator<Item = u32> {
    let is_coded = |(index, node): &(usize, &Node)| node.particles > 0 && page.content(*index).is_none();
    page.nodes.iter().enumerate().filter(is_coded).map(|(index, _)| index as u32)
}

/// Queues a page for upload.
pub fn insert(scene: &ParticleScene, source: u32, page: &Arc<Page>) {
    scene.insert_nodes(drawable(page).map(|index| {
        let frame = page.nodes[index as usize].frame;
        NodeUpload {
            id: node_id(source, page.id, index),
            min: frame.min,
            size: frame.size,
            payload: Payload::Page { page: Arc::clone(page), node: index },
        }
    }));
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
