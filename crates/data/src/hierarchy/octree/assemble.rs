//! Putting the pieces of all buckets together to the nodes of a tree.

use super::piece::Piece;
use super::{Encoding, LevelInfo, OctreeOptions, Purpose, is_relay};
use crate::hierarchy::{NodeKey, RootCell};
use crate::model::Bounds;
use crate::model::portable::portable;
use glam::DVec3;

/// A node of a finished tree. [`crate::store::Node`] shares most fields and is a type of its own on purpose: that one is what a
/// reader knows of a node (children by page, particles elsewhere in the page), this one is what a build has of it before there
/// are pages (children by index, and wherever the build has put its particles).
#[derive(Clone, Debug)]
pub struct TreeNode<Data> {
    /// Its cell.
    pub key: NodeKey,
    /// How its particles are held.
    pub encoding: Encoding,
    /// Number of particles that it holds.
    pub particles: u64,
    /// How many of them are points.
    pub points: u64,
    /// Number of source particles that it stands for.
    pub source_particles: u64,
    /// Largest distance that a source particle can have from the particle drawn for it, world units; infinite for relays.
    pub delta: f64,
    /// Box around the source and drawn positions in the subtree, world units.
    pub bounds: Bounds,
    /// Largest source smoothing length in the subtree.
    pub smoothing_length_max: f32,
    /// Mass of the source particles.
    pub mass: f64,
    /// Their `sum m rho`.
    pub mass_density: f64,
    /// Indices of the children in the next depth's nodes.
    pub children: [Option<usize>; 8],
    /// Its particles, in order; none for a relay.
    pub data: Vec<Data>,
}

portable!(TreeNode<Data> where Data {
    key,
    encoding,
    particles,
    points,
    source_particles,
    delta,
    bounds,
    smoothing_length_max,
    mass,
    mass_density,
    children,
    data,
});

/// A family's nodes.
#[derive(Clone, Debug)]
pub struct Tree<Data> {
    /// The nodes of each depth, in Morton order.
    pub nodes: Vec<Vec<TreeNode<Data>>>,
    /// One for each depth; `bytes` are left to whoever stores the nodes.
    pub levels: Vec<LevelInfo>,
}

/// Puts the pieces of a family's tree together, in whatever order they come; `None` if there is none.
pub fn assemble<Data>(
    pieces: Vec<Piece<Data>>,
    levels_of: Purpose,
    root: RootCell,
    options: &OctreeOptions,
) -> Option<Tree<Data>> {
    let deepest = pieces.iter().map(|piece| piece.key.depth).max()?;
    let mut by_depth: Vec<Vec<(u128, Piece<Data>)>> = (0..=deepest).map(|_| Vec::new()).collect();
    for piece in pieces {
        by_depth[usize::from(piece.key.depth)].push((piece.key.order(), piece));
    }
    let (mut nodes, mut levels) = (Vec::new(), Vec::new());
    let mut below: Vec<Draft<Data>> = Vec::new();
    for (depth, mut pieces) in by_depth.into_iter().enumerate().rev() {
        pieces.sort_unstable_by_key(|(cell, piece)| (*cell, piece.first));
        let mut level = LevelInfo { depth: depth as u8, ..LevelInfo::default() };
        let mut own: Vec<Draft<Data>> = Vec::new();
        let mut children = below.iter().enumerate().peekable();
        let mut pieces = pieces.into_iter().peekable();
        while let Some((cell, first)) = pieces.next() {
            let mut all = vec![first];
            while let Some((_, more)) = pieces.next_if(|(other, _)| *other == cell) {
                all.push(more);
            }
            let mut draft = Draft::of(all, root);
            while let Some((index, child)) = children.next_if(|(_, child)| child.cell >> 3 == cell) {
                draft.adopt(index, child);
            }
            draft.settle(levels_of, options, &mut level);
            draft.cell = cell;
            own.push(draft);
        }
        levels.push(level);
        nodes.push(below.into_iter().map(|draft| draft.finish(root)).collect::<Vec<_>>());
        below = own;
    }
    nodes.push(below.into_iter().map(|draft| draft.finish(root)).collect());
    // The list that came before the deepest level is empty.
    nodes.remove(0);
    nodes.reverse();
    levels.reverse();
    Some(Tree { nodes, levels })
}

/// A node that is being put together, with lengths in root fractions.
struct Draft<Data> {
    node: TreeNode<Data>,
    /// [`NodeKey::order`].
    cell: u128,
    whole: bool,
    input: u64,
    merged: u64,
    /// Box around what it draws itself.
    own: Bounds,
    children_cost: u64,
    draw_cost: u64,
}

impl<Data> Draft<Data> {
    fn of(pieces: Vec<Piece<Data>>, root: RootCell) -> Draft<Data> {
        let first = &pieces[0];
        let mut draft = Draft {
            node: TreeNode {
                key: first.key,
                encoding: first.encoding,
                particles: 0,
                points: 0,
                source_particles: 0,
                delta: 0.0,
                bounds: Bounds::EMPTY,
                smoothing_length_max: 0.0,
                mass: 0.0,
                mass_density: 0.0,
                children: [None; 8],
                data: Vec::with_capacity(pieces.len()),
            },
            cell: 0,
            whole: first.whole,
            input: 0,
            merged: 0,
            own: Bounds::EMPTY,
            children_cost: 0,
            draw_cost: 0,
        };
        let node = &mut draft.node;
        for piece in pieces {
            node.particles += piece.particles;
            node.points += piece.points;
            node.source_particles += piece.sources;
            node.delta = node.delta.max(outward(piece.delta, root));
            node.smoothing_length_max = node.smoothing_length_max.max(piece.smoothing_length_max);
            node.mass += piece.mass;
            node.mass_density += piece.mass_density;
            draft.input += piece.input;
            draft.merged += piece.merged;
            draft.own = draft.own.union(piece.bounds);
            node.data.push(piece.data);
        }
        draft
    }

    fn adopt(&mut self, index: usize, child: &Draft<Data>) {
        let node = &mut self.node;
        node.children[(child.cell & 7) as usize] = Some(index);
        node.source_particles += child.node.source_particles;
        node.mass += child.node.mass;
        node.mass_density += child.node.mass_density;
        node.smoothing_length_max = node.smoothing_length_max.max(child.node.smoothing_length_max);
        node.bounds = node.bounds.union(child.node.bounds);
        self.children_cost += child.draw_cost;
    }

    /// Decides whether it is a relay and counts it.
    fn settle(&mut self, levels_of: Purpose, options: &OctreeOptions, level: &mut LevelInfo) {
        let node = &mut self.node;
        let too_many = u32::try_from(node.particles).is_err();
        if node.encoding == Encoding::Grid
            && !self.whole
            && (is_relay(levels_of, node.key.depth, self.merged, self.children_cost, options) || too_many)
        {
            node.encoding = Encoding::Relay;
            (node.particles, node.points) = (0, 0);
        }
        level.input += self.input;
        // Where pieces were forged, leaves may be among those of another node.
        match node.encoding {
            Encoding::Leaf => {
                level.leaf_nodes += 1;
                level.leaf_particles += node.particles;
            }
            Encoding::Grid => {
                level.grid_nodes += 1;
                level.merged += self.input.saturating_sub(self.merged);
                level.skipped += self.merged - node.particles;
                level.points += node.points;
                level.sprites += node.particles - node.points;
            }
            Encoding::Relay => {
                level.relay_nodes += 1;
                level.merged += self.input.saturating_sub(self.merged);
                level.relayed += self.merged;
            }
            // Made of an octree that is whole.
            Encoding::Clusters | Encoding::LeafClusters => {}
        }
        if node.encoding == Encoding::Relay {
            node.delta = f64::INFINITY;
            node.data = Vec::new();
            self.draw_cost = self.children_cost;
        } else {
            node.bounds = node.bounds.union(self.own);
            self.draw_cost = self.merged;
        }
    }

    fn finish(self, root: RootCell) -> TreeNode<Data> {
        TreeNode { bounds: world(self.node.bounds, root), ..self.node }
    }
}

/// A distance in root fractions in world units, rounded up by what rounding to places and to doubles can have moved positions.
fn outward(distance: f64, root: RootCell) -> f64 {
    let largest = root.min.abs().max_element() + root.size;
    distance * root.size * (1.0 + 1e-12) + root.size * 2.0_f64.powi(-42) + largest * 2.0_f64.powi(-50)
}

fn world(tight: Bounds, root: RootCell) -> Bounds {
    let place = |p: DVec3| root.min + p * root.size;
    Bounds { min: place(tight.min), max: place(tight.max) }
}
