//! Which node goes into which page (F12 4.8.1), and writing a tree's pages.
//!
//! A page begins with the children of one parent and is filled breadth-first with nodes below them while they fit. Where
//! that leaves it half empty, the next families of siblings that hang below the same parent page join it, so that
//! shallow subtrees do not end as pages of a few kilobytes. Siblings that are together larger than a page are spread over
//! several.

use super::error::StoreError;
use super::metadata::FamilyMetadata;
use super::page::{Node, NodeRef, PageId, Positions};
use super::writer::{PageFileWriter, PageNode, encode_page, node_bytes};
use crate::codec::VqBits;
use crate::hierarchy::octree::TreeNode;
use crate::hierarchy::{Encoding, Octree};
use crate::model::progress::Progress;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Bytes that a page aims at (F12 4.8.1); only a page of a single node may be longer.
pub const PAGE_BYTES: usize = 3 << 20;
/// Pages that are encoded at a time: memory for them is needed beside the tree.
const BATCH: usize = 16;

/// A node of the tree: depth and index.
type Place = (usize, usize);

/// Siblings that wait for a page, and the number of the page that holds their parent.
struct Group {
    members: Vec<Place>,
    parent_page: Option<usize>,
}

/// The nodes of each page, in order. Parents come before children.
fn plan(nodes: &[Vec<TreeNode>], vq_bits: VqBits) -> Vec<Vec<Place>> {
    let bytes = |&(depth, index): &Place| {
        let node = &nodes[depth][index];
        node_bytes(node.encoding, node.particles as usize, vq_bits)
    };
    let children = |(depth, index): Place| -> Vec<Place> {
        nodes[depth][index].children.iter().flatten().map(|&child| (depth + 1, child)).collect()
    };
    let mut pages: Vec<Vec<Place>> = Vec::new();
    let mut waiting = VecDeque::from([Group { members: vec![(0, 0)], parent_page: None }]);
    while let Some(mut group) = waiting.pop_front() {
        let mut page = Vec::new();
        let mut len = 0;
        // Siblings that do not fit go on waiting, at the front.
        let fitting = group.members.iter().take_while(|member| {
            len += bytes(member);
            len <= PAGE_BYTES
        });
        let fitting = fitting.count().max(1);
        let rest = group.members.split_off(fitting);
        if !rest.is_empty() {
            waiting.push_front(Group { members: rest, parent_page: group.parent_page });
        }
        len = group.members.iter().map(bytes).sum();
        page.append(&mut group.members);
        let mut next = 0;
        loop {
            // Breadth-first below what the page holds.
            while next < page.len() {
                let below = children(page[next]);
                next += 1;
                let more: usize = below.iter().map(bytes).sum();
                if below.is_empty() {
                    continue;
                }
                if len + more <= PAGE_BYTES {
                    len += more;
                    page.extend(below);
                } else {
                    waiting.push_back(Group { members: below, parent_page: Some(pages.len()) });
                }
            }
            let joins = |other: &Group| {
                other.parent_page == group.parent_page
                    && other.parent_page.is_some()
                    && len + other.members.iter().map(bytes).sum::<usize>() <= PAGE_BYTES
            };
            if len > PAGE_BYTES / 2 || !waiting.front().is_some_and(joins) {
                break;
            }
            let Some(other) = waiting.pop_front() else { break };
            len += other.members.iter().map(bytes).sum::<usize>();
            page.extend(other.members);
        }
        pages.push(page);
    }
    pages
}

/// Appends a tree's pages to a file and returns what its footer says about the family, number `family`.
pub fn write_tree(
    writer: &mut PageFileWriter,
    family: u32,
    tree: &Octree,
    vq_bits: VqBits,
    progress: &dyn Progress,
) -> Result<FamilyMetadata, StoreError> {
    let pages = plan(&tree.nodes, vq_bits);
    progress.begin(&format!("writing {}", tree.name), pages.len() as u64);
    let first = writer.page_count();
    let mut places: Vec<Vec<NodeRef>> =
        tree.nodes.iter().map(|level| vec![NodeRef { page: PageId(first), node: 0 }; level.len()]).collect();
    for (number, page) in pages.iter().enumerate() {
        for (i, &(depth, index)) in page.iter().enumerate() {
            places[depth][index] = NodeRef { page: PageId(first + number as u32), node: i as u32 };
        }
    }
    let mut levels = tree.levels.clone();
    for (level, nodes) in levels.iter_mut().zip(&tree.nodes) {
        level.bytes = nodes.iter().map(|node| node_bytes(node.encoding, node.particles as usize, vq_bits) as u64).sum();
    }
    for (batch, numbers) in pages.chunks(BATCH).zip((first..).step_by(BATCH)) {
        let encoded: Vec<Option<Vec<u8>>> = batch
            .par_iter()
            .zip(numbers..numbers + batch.len() as u32)
            .map(|(page, number)| encode(tree, page, PageId(number), family, &places, vq_bits))
            .collect();
        for (page, bytes) in batch.iter().zip(encoded) {
            let bytes = bytes.ok_or_else(|| writer.unwritable("a page would be longer than 4 GiB"))?;
            writer.append(family, page.len() as u32, &bytes)?;
            progress.advance(1);
        }
    }
    Ok(FamilyMetadata {
        name: tree.name,
        count: tree.count,
        mass: tree.mass,
        mass_density: tree.mass_density,
        bounds: tree.bounds,
        root: tree.root,
        root_page: PageId(first),
        quantities: tree.quantities.clone(),
        attributes: tree.attributes.clone(),
        levels,
        codebooks: tree.codebooks.clone(),
    })
}

fn encode(
    tree: &Octree,
    page: &[Place],
    id: PageId,
    family: u32,
    places: &[Vec<NodeRef>],
    vq_bits: VqBits,
) -> Option<Vec<u8>> {
    let nodes: Vec<(Node, Vec<u64>)> = page
        .iter()
        .map(|&(depth, index)| {
            let node = &tree.nodes[depth][index];
            let words = if node.encoding == Encoding::Leaf { tree.leaf_words(node) } else { Vec::new() };
            (record(node, places.get(depth + 1).map_or(&[], Vec::as_slice)), words)
        })
        .collect();
    let nodes: Vec<PageNode> = page
        .iter()
        .zip(&nodes)
        .map(|(&(depth, index), (node, words))| {
            let tree_node = &tree.nodes[depth][index];
            let positions = match node.encoding {
                Encoding::Leaf => Positions::Leaf(words),
                Encoding::Grid | Encoding::Relay => Positions::Grid(&tree_node.words),
            };
            PageNode { node, positions, codes: &tree_node.codes }
        })
        .collect();
    encode_page(id, family, &nodes, vq_bits)
}

/// The node as it is stored; `below` are the places of the next depth's nodes.
fn record(node: &TreeNode, below: &[NodeRef]) -> Node {
    Node {
        key: node.key,
        encoding: node.encoding,
        codebook: node.codebook,
        particles: node.particles,
        points: node.points,
        source_particles: node.source_particles(),
        delta: node.delta,
        bounds: node.bounds,
        smoothing_length_max: node.smoothing_length_max,
        mass: node.mass,
        mass_density: node.mass_density,
        mass_scale: node.mass_scale,
        mass_density_scale: node.mass_density_scale,
        children: node.children.map(|child| child.map(|child| below[child])),
    }
}
