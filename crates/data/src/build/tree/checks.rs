//! Whether what other tasks have left of trees can be what it is taken for: whatever is used as an index, a length or a summand.

use super::{Built, CodedTree, Draft, Kept, Positions};
use crate::codec::positions::most_bytes;
use crate::hierarchy::cell::{CELL_DEPTH, MAX_DEPTH};
use crate::hierarchy::octree::{Piece, Plan, TreeNode};
use crate::hierarchy::{Encoding, LevelInfo, NodeKey};
use crate::model::portable::{expect, expect_that, expect_within, total};
use std::ops::Range;

/// Particles that all nodes of a tree with so many sources have together at most: on each depth no more than there are.
pub(in crate::build) fn most_in_nodes(sources: u64) -> u64 {
    sources.saturating_mul(u64::from(MAX_DEPTH) + 1)
}

/// Whether something was built of a bucket for so many kinds of levels, of a family with so many attributes and particles; else what was found
/// and expected. Gives the sum of all counts that are added up.
pub(in crate::build) fn check_built(
    built: &Built,
    (plan, bucket): (&Plan, usize),
    kinds: usize,
    attributes: usize,
    most: u64,
) -> Result<u64, String> {
    expect("kinds of levels", built.len(), kinds)?;
    let mut counts = 0_u64;
    for (kind, (pieces, open)) in built.iter().enumerate() {
        for piece in pieces {
            piece.check(most)?;
            check_cell(piece, plan.keys(bucket), kind == 0)?;
            let kept = piece.data.as_ref().ok_or("particles of a node: found none, expected where they are")?;
            kept.check(piece.particles, plan.group(bucket), 3 + attributes)?;
            counts = total([counts, piece.input, piece.sources]);
        }
        // The leaves of the first kind are those of all.
        let leaves = built[0].0.iter().filter(|piece| kind > 0 && piece.encoding == Encoding::Leaf);
        let mut cells: Vec<NodeKey> = pieces.iter().chain(leaves).map(|piece| piece.key).collect();
        cells.sort_unstable();
        expect_that(cells.is_sorted_by(|a, b| a < b), "cells of nodes", "each of a bucket once")?;
        open.iter().try_for_each(|open| open.check(plan, bucket, attributes))?;
    }
    Ok(counts)
}

/// Whether a node, or a part of one, is where a bucket with these keys has particles, and is whole where no other bucket has any; leaves are whole,
/// and only where `has_leaves`. So no leaf meets a node of another bucket, which would be told of all files that have nodes, not of the wrong one.
fn check_cell<A>(piece: &Piece<A>, own: Range<u64>, has_leaves: bool) -> Result<(), String> {
    let cell = piece.key.cell();
    let shift = 3 * (CELL_DEPTH - cell.depth);
    // Cells as deep as that have the bits of a key.
    let start = (cell.order() as u64) << shift;
    let end = start + (1_u64 << shift);
    expect_that(start < own.end && own.start < end, "cell of a node", "one where its bucket has particles")?;
    expect("whole node", piece.whole, own.start <= start && end <= own.end)?;
    let is_leaf = piece.encoding == Encoding::Leaf;
    expect_that(!is_leaf || has_leaves && piece.whole, "leaf", "a whole one of the tree that has the leaves")
}

impl Kept {
    /// Whether it is of so many particles with so many columns, of a bucket of this group.
    fn check(&self, particles: u64, group: u32, columns: usize) -> Result<(), String> {
        let Kept { positions, batch } = self;
        expect("particles of a batch", batch.info.particles as u64, particles)?;
        expect("group of a batch", batch.group, group)?;
        batch.check(columns)?;
        let particles = batch.info.particles;
        match positions {
            Positions::Encoded(blob) => {
                expect_within("bytes of positions", blob.len() as u64, 0..=most_bytes(particles) as u64)
            }
            Positions::Words(blob) => expect("bytes of positions", blob.len(), particles * size_of::<u32>()),
        }
    }
}

impl Draft {
    /// Whether all nodes hang below one root, and are as their levels tell; else what was found and expected. `sources` is the number of
    /// particles of the family.
    pub fn check(&self, sources: u64) -> Result<(), String> {
        let Draft { nodes, positions, levels } = self;
        expect_within("depths", nodes.len() as u64, 1..=u64::from(MAX_DEPTH) + 1)?;
        expect("depths with positions", positions.len(), nodes.len())?;
        expect("levels", levels.len(), nodes.len())?;
        expect("roots", nodes[0].len(), 1)?;
        let mut particles = 0_u64;
        for (depth, ((level, positions), info)) in nodes.iter().zip(positions).zip(levels).enumerate() {
            expect("positions of a depth", positions.len(), level.len())?;
            for (node, positions) in level.iter().zip(positions) {
                check_node(node, depth)?;
                let bytes = positions.as_ref().map_or(0, |blob| blob.len() as u64);
                expect_within("bytes of positions", bytes, 0..=most_bytes(node.particles as usize) as u64)?;
            }
            particles = level.iter().fold(particles, |sum, node| sum.saturating_add(node.particles));
            check_links(level, nodes.get(depth + 1).map_or(0, Vec::len))?;
            check_level(level, info)?;
        }
        expect_within("particles of nodes", particles, 0..=most_in_nodes(sources))
    }

    /// Particles of all its leaves.
    pub fn leaf_particles(&self) -> u64 {
        total(self.levels.iter().map(|level| level.leaf_particles))
    }

    /// Whether it has the cells of the tree that has the leaves, and the same of them are leaves; else what was found and expected.
    pub fn check_cells(
        &self,
        other: impl ExactSizeIterator<Item = impl Iterator<Item = (NodeKey, bool)>>,
    ) -> Result<(), String> {
        expect("depths", self.nodes.len(), other.len())?;
        let is_same = self.cells().zip(other).all(|(own, other)| own.eq(other));
        expect_that(is_same, "cells", "those of the tree that has the leaves")
    }

    /// Its cells by depth, each with whether it is a leaf.
    pub fn cells(&self) -> impl ExactSizeIterator<Item = impl Iterator<Item = (NodeKey, bool)>> {
        self.nodes.iter().map(|level| level.iter().map(|node| (node.key, node.encoding == Encoding::Leaf)))
    }
}

impl CodedTree {
    /// Its cells by depth, each with whether it is a leaf.
    pub fn cells(&self) -> impl ExactSizeIterator<Item = impl Iterator<Item = (NodeKey, bool)>> {
        let levels = self.nodes.iter();
        levels.map(|level| level.iter().map(|planned| (planned.node.key, planned.node.encoding == Encoding::Leaf)))
    }
}

fn check_node(node: &TreeNode<()>, depth: usize) -> Result<(), String> {
    let TreeNode { key, encoding, particles, points, data, .. } = node;
    expect("depth of a node", usize::from(key.depth), depth)?;
    expect_that(key.is_valid(), "key of a node", "a cell of a tree")?;
    expect_that(!encoding.is_clusters(), "encoding of a node", "none of clusters")?;
    expect_within("particles of a node", *particles, 0..=u32::MAX.into())?;
    expect_within("points of a node", *points, 0..=*particles)?;
    expect("pieces of a node", data.len(), 0)
}

/// Whether each of the nodes of the next depth has one parent.
fn check_links(level: &[TreeNode<()>], below: usize) -> Result<(), String> {
    let mut has_parent = vec![false; below];
    for &child in level.iter().flat_map(|node| node.children.iter().flatten()) {
        match has_parent.get_mut(child) {
            Some(has_parent) if !*has_parent => *has_parent = true,
            _ => return Err(format!("child of a node: found number {child}, expected each of {below} once")),
        }
    }
    expect_that(!has_parent.contains(&false), "child of a node", "each of the next depth once")
}

/// Whether a level tells of its leaves what they are: where these are another tree's they are taken off.
fn check_level(level: &[TreeNode<()>], info: &LevelInfo) -> Result<(), String> {
    let leaves = || level.iter().filter(|node| node.encoding == Encoding::Leaf);
    expect("leaves of a level", info.leaf_nodes, leaves().count() as u64)?;
    expect("particles of a level's leaves", info.leaf_particles, total(leaves().map(|leaf| leaf.particles)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::coding::Coding;
    use crate::build::tree::Books;
    use crate::codec::{CodeBits, VqBits};
    use crate::hierarchy::Purpose;
    use crate::model::Bounds;

    fn node(key: NodeKey, encoding: Encoding, children: [Option<usize>; 8]) -> TreeNode<()> {
        TreeNode {
            key,
            encoding,
            particles: 4,
            points: 1,
            source_particles: 4,
            delta: 0.0,
            bounds: Bounds::EMPTY,
            smoothing_length_max: 1.0,
            mass: 1.0,
            mass_density: 1.0,
            children,
            data: Vec::new(),
        }
    }

    /// A root above two leaves.
    fn draft() -> Draft {
        let mut children = [None; 8];
        (children[0], children[5]) = (Some(0), Some(1));
        let leaf = |octant: u8| node(NodeKey::ROOT.child(octant), Encoding::Leaf, [None; 8]);
        let nodes = vec![vec![node(NodeKey::ROOT, Encoding::Grid, children)], vec![leaf(0), leaf(5)]];
        let leaves = LevelInfo { depth: 1, leaf_nodes: 2, leaf_particles: 8, ..LevelInfo::default() };
        let levels = vec![LevelInfo { grid_nodes: 1, ..LevelInfo::default() }, leaves];
        let positions = nodes.iter().map(|level| level.iter().map(|_| None).collect()).collect();
        Draft { nodes, positions, levels }
    }

    #[test]
    fn forged_trees_are_told() {
        assert_eq!((draft().check(8), draft().leaf_particles()), (Ok(()), 8));
        let forgeries: [(&str, fn(&mut Draft)); 10] = [
            ("roots: found 0", |draft| draft.nodes[0].clear()),
            ("depths with positions: found 1", |draft| draft.positions.truncate(1)),
            ("child of a node: found number 2", |draft| draft.nodes[0][0].children[7] = Some(2)),
            ("child of a node: found number 1", |draft| draft.nodes[0][0].children[7] = Some(1)),
            ("child of a node: found something else", |draft| draft.nodes[0][0].children[5] = None),
            ("depth of a node: found 0", |draft| draft.nodes[1][0].key = NodeKey::ROOT),
            ("particles of a node: found 18446744073709551615", |draft| draft.nodes[1][0].particles = u64::MAX),
            ("points of a node: found 5", |draft| draft.nodes[1][0].points = 5),
            ("leaves of a level: found 1", |draft| draft.levels[1].leaf_nodes = 1),
            ("particles of nodes: found 508", |draft| draft.nodes[0][0].particles = 500),
        ];
        for (told, forge) in forgeries {
            let mut forged = draft();
            forge(&mut forged);
            let found = forged.check(8).unwrap_err();
            assert!(found.starts_with(told), "{told}: {found}");
        }
    }

    /// By those of a tree before it is coded and after.
    #[test]
    fn trees_of_other_cells_are_told() {
        let coded = |draft: Draft| {
            let coding = Coding::of(&draft.nodes);
            draft.coded(Purpose::Splats, coding, None, CodeBits::plain(VqBits::Eight), &mut Books::default())
        };
        assert_eq!(draft().check_cells(draft().cells()), Ok(()));
        assert_eq!(draft().check_cells(coded(draft()).cells()), Ok(()));
        let forgeries: [(&str, fn(&mut Draft)); 4] = [
            ("cells", |draft| draft.nodes[1][1].encoding = Encoding::Grid),
            ("cells", |draft| draft.nodes[1][1].key = NodeKey::ROOT.child(6)),
            ("cells", |draft| drop(draft.nodes[1].pop())),
            ("depths: found 2, expected 1", |draft| drop(draft.nodes.pop())),
        ];
        for (told, forge) in forgeries {
            let mut other = draft();
            forge(&mut other);
            assert!(draft().check_cells(other.cells()).unwrap_err().starts_with(told), "{told}");
            assert!(draft().check_cells(coded(other).cells()).unwrap_err().starts_with(told), "{told}, coded");
        }
    }
}
