//! Whether what other tasks have left of trees can be what it is taken for: whatever is used as an index, a length or a summand.

use super::{Built, Draft, Kept, Positions};
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

/// A tree that is looked through as its nodes come, those of each depth in order, children with their parents or before them.
#[derive(Default)]
pub(in crate::build) struct Checked {
    depths: Vec<Counted>,
    particles: u64,
}

/// Nodes of a depth that have come.
#[derive(Clone, Copy, Default)]
struct Counted {
    nodes: usize,
    /// Those that have a parent, which are the first ones.
    children: usize,
    leaves: u64,
    leaf_particles: u64,
}

impl Checked {
    /// Whether nodes can follow those before them; else what was found and expected.
    pub fn add(&mut self, draft: &Draft) -> Result<(), String> {
        let Draft { nodes, positions } = draft;
        expect_within("depths", nodes.len() as u64, 0..=u64::from(MAX_DEPTH) + 1)?;
        expect("depths with positions", positions.len(), nodes.len())?;
        self.depths.resize(nodes.len().max(self.depths.len()), Counted::default());
        for (depth, (level, positions)) in nodes.iter().zip(positions).enumerate().rev() {
            expect("positions of a depth", positions.len(), level.len())?;
            for (node, positions) in level.iter().zip(positions) {
                check_node(node, depth)?;
                let bytes = positions.as_ref().map_or(0, |blob| blob.len() as u64);
                expect_within("bytes of positions", bytes, 0..=most_bytes(node.particles as usize) as u64)?;
                self.take(node, depth)?;
            }
            expect_within("nodes of a depth", self.depths[depth].nodes as u64, 0..=u32::MAX.into())?;
        }
        Ok(())
    }

    /// Counts a node and its children.
    fn take(&mut self, node: &TreeNode<()>, depth: usize) -> Result<(), String> {
        self.particles = self.particles.saturating_add(node.particles);
        let own = &mut self.depths[depth];
        own.nodes += 1;
        if node.encoding == Encoding::Leaf {
            own.leaves += 1;
            own.leaf_particles = own.leaf_particles.saturating_add(node.particles);
        }
        let mut below = self.depths.get_mut(depth + 1);
        for &child in node.children.iter().flatten() {
            match &mut below {
                Some(below) if child == below.children && child < below.nodes => below.children += 1,
                _ => return Err(format!("child of a node: found number {child}, expected the next one of its depth")),
            }
        }
        Ok(())
    }

    /// Number of nodes of each depth that have come.
    pub fn nodes(&self) -> impl Iterator<Item = usize> {
        self.depths.iter().map(|depth| depth.nodes)
    }

    /// Whether all nodes hang below one root, and are as their levels tell; else what was found and expected. `sources` is the number of
    /// particles of the family.
    pub fn end(&self, levels: &[LevelInfo], sources: u64) -> Result<(), String> {
        let Checked { depths, particles } = self;
        expect("roots", depths.first().map_or(0, |root| root.nodes), 1)?;
        expect("levels", levels.len(), depths.len())?;
        let have_parents = depths.iter().skip(1).all(|depth| depth.children == depth.nodes);
        expect_that(have_parents, "child of a node", "each of the next depth once")?;
        for (depth, info) in depths.iter().zip(levels) {
            expect("leaves of a level", info.leaf_nodes, depth.leaves)?;
            expect("particles of a level's leaves", info.leaf_particles, depth.leaf_particles)?;
        }
        expect_within("particles of nodes", *particles, 0..=most_in_nodes(sources))
    }
}

impl Draft {
    /// Whether it has the cells of the tree that has the leaves, and the same of them are leaves; else what was found and expected.
    pub fn check_cells(&self, other: &Draft) -> Result<(), String> {
        expect("depths", self.nodes.len(), other.nodes.len())?;
        let cells = |draft: &Draft, depth: usize| -> Vec<(NodeKey, bool)> {
            draft.nodes[depth].iter().map(|node| (node.key, node.encoding == Encoding::Leaf)).collect()
        };
        let are_same = (0..self.nodes.len()).all(|depth| cells(self, depth) == cells(other, depth));
        expect_that(are_same, "cells", "those of the tree that has the leaves")
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;

    /// A tree, and what is told of its levels.
    struct Told {
        draft: Draft,
        levels: Vec<LevelInfo>,
    }

    impl Told {
        /// Looks it through as a whole.
        fn check(&self, sources: u64) -> Result<(), String> {
            let mut checked = Checked::default();
            checked.add(&self.draft)?;
            checked.end(&self.levels, sources)
        }
    }

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
    fn told() -> Told {
        let mut children = [None; 8];
        (children[0], children[5]) = (Some(0), Some(1));
        let leaf = |octant: u8| node(NodeKey::ROOT.child(octant), Encoding::Leaf, [None; 8]);
        let nodes = vec![vec![node(NodeKey::ROOT, Encoding::Grid, children)], vec![leaf(0), leaf(5)]];
        let leaves = LevelInfo { depth: 1, leaf_nodes: 2, leaf_particles: 8, ..LevelInfo::default() };
        let levels = vec![LevelInfo { grid_nodes: 1, ..LevelInfo::default() }, leaves];
        let positions = nodes.iter().map(|level| level.iter().map(|_| None).collect()).collect();
        Told { draft: Draft { nodes, positions }, levels }
    }

    #[test]
    fn forged_trees_are_told() {
        assert_eq!(told().check(8), Ok(()));
        let forgeries: [(&str, fn(&mut Told)); 11] = [
            ("roots: found 0", |told| {
                told.draft.nodes[0].clear();
                told.draft.positions[0].clear();
            }),
            ("positions of a depth: found 1", |told| told.draft.nodes[0].clear()),
            ("depths with positions: found 1", |told| told.draft.positions.truncate(1)),
            ("child of a node: found number 2", |told| told.draft.nodes[0][0].children[7] = Some(2)),
            ("child of a node: found number 1", |told| told.draft.nodes[0][0].children[7] = Some(1)),
            ("child of a node: found something else", |told| told.draft.nodes[0][0].children[5] = None),
            ("depth of a node: found 0", |told| told.draft.nodes[1][0].key = NodeKey::ROOT),
            ("particles of a node: found 18446744073709551615", |told| told.draft.nodes[1][0].particles = u64::MAX),
            ("points of a node: found 5", |told| told.draft.nodes[1][0].points = 5),
            ("leaves of a level: found 1", |told| told.levels[1].leaf_nodes = 1),
            ("particles of nodes: found 508", |told| told.draft.nodes[0][0].particles = 500),
        ];
        for (what, forge) in forgeries {
            let mut forged = told();
            forge(&mut forged);
            let found = forged.check(8).unwrap_err();
            assert!(found.starts_with(what), "{what}: {found}");
        }
    }

    /// Leaves one by one, and the root when it is theirs.
    #[test]
    fn trees_that_come_bit_by_bit_are_told_as_whole_ones_are() {
        let Told { draft: Draft { nodes, .. }, levels } = told();
        let [root, leaves] = [&nodes[0][0], &nodes[1][1]];
        let some = |root: Option<&TreeNode<()>>, leaf: Option<&TreeNode<()>>| {
            let nodes: Vec<Vec<TreeNode<()>>> = [root, leaf].map(|node| node.cloned().into_iter().collect()).into();
            let positions = nodes.iter().map(|level| level.iter().map(|_| None).collect()).collect();
            Draft { nodes, positions }
        };
        let mut checked = Checked::default();
        assert_eq!(checked.add(&some(None, Some(leaves))), Ok(()));
        assert!(checked.end(&levels, 8).is_err());
        assert_eq!(checked.add(&some(Some(root), Some(leaves))), Ok(()));
        assert_eq!((checked.end(&levels, 8), checked.nodes().collect::<Vec<_>>()), (Ok(()), vec![1, 2]));
        // A parent before its second child.
        let mut checked = Checked::default();
        assert_eq!(checked.add(&some(None, Some(leaves))), Ok(()));
        assert!(checked.add(&some(Some(root), None)).unwrap_err().starts_with("child of a node: found number 1"));
    }

    #[test]
    fn trees_of_other_cells_are_told() {
        let draft = || told().draft;
        assert_eq!(draft().check_cells(&draft()), Ok(()));
        let forgeries: [(&str, fn(&mut Draft)); 4] = [
            ("cells", |draft| draft.nodes[1][1].encoding = Encoding::Grid),
            ("cells", |draft| draft.nodes[1][1].key = NodeKey::ROOT.child(6)),
            ("cells", |draft| drop(draft.nodes[1].pop())),
            ("depths: found 2, expected 1", |draft| drop(draft.nodes.pop())),
        ];
        for (told, forge) in forgeries {
            let mut other = draft();
            forge(&mut other);
            assert!(draft().check_cells(&other).unwrap_err().starts_with(told), "{told}");
        }
    }
}
