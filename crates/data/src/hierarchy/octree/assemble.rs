//! Putting the pieces of all buckets together to the nodes of a tree, all at once or as buckets come.

use super::piece::Piece;
use super::{Encoding, LevelInfo, OctreeOptions, Purpose, is_relay};
use crate::hierarchy::cell::CELL_DEPTH;
use crate::hierarchy::{NodeKey, RootCell};
use crate::model::Bounds;
use crate::model::portable::portable;
use glam::DVec3;
use std::collections::VecDeque;

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

/// A family's tree while its pieces come. Nodes are handed out once no piece of theirs or of what lies below them can come any more; so
/// whoever has the pieces in about the order of their keys need not have them all at once.
#[derive(Debug)]
pub struct Assembly<Data> {
    levels_of: Purpose,
    root: RootCell,
    options: OctreeOptions,
    depths: Vec<Depth<Data>>,
}

impl<Data> Assembly<Data> {
    /// A tree without a piece.
    pub fn new(levels_of: Purpose, root: RootCell, options: OctreeOptions) -> Assembly<Data> {
        Assembly { levels_of, root, options, depths: Vec::new() }
    }

    /// Adds a piece of a node that has not been handed out.
    pub fn add(&mut self, piece: Piece<Data>) {
        while self.depths.len() <= usize::from(piece.key.depth) {
            self.depths.push(Depth::new(self.depths.len() as u8));
        }
        let cell = piece.key.order();
        let depth = &mut self.depths[usize::from(piece.key.depth)];
        depth.first = depth.first.min(cell);
        depth.pieces.push((cell, piece));
    }

    /// The nodes of each depth whose keys end at the `end` of that depth or before, in Morton order: those that follow the ones handed out
    /// before. Pieces that still come are of nodes that end behind it, and no end lies before that of a lesser depth. Indices of children count
    /// all nodes of their depth.
    pub fn complete(&mut self, end: impl Fn(u8) -> u64) -> Vec<Vec<TreeNode<Data>>> {
        let Assembly { levels_of, root, options, depths } = self;
        let mut nodes = Vec::with_capacity(depths.len());
        for depth in (0..depths.len()).rev() {
            let (own, below) = depths.split_at_mut(depth + 1);
            let children = below.first_mut().map(|below| &mut below.waiting);
            nodes.push(own[depth].complete(end(depth as u8), children, *levels_of, *root, options));
        }
        nodes.reverse();
        nodes
    }

    /// What each depth has, once all nodes have been handed out.
    pub fn levels(self) -> Vec<LevelInfo> {
        self.depths.into_iter().map(|depth| depth.level).collect()
    }
}

/// The nodes of a depth.
#[derive(Debug)]
struct Depth<Data> {
    /// What it has so far.
    level: LevelInfo,
    /// Pieces of nodes that have not been handed out, each with its node's [`NodeKey::order`], and the first of these.
    pieces: Vec<(u128, Piece<Data>)>,
    first: u128,
    /// Nodes whose parents have not been handed out, in their order.
    waiting: VecDeque<Child>,
    /// Nodes that have been handed out.
    count: usize,
}

impl<Data> Depth<Data> {
    fn new(depth: u8) -> Depth<Data> {
        let level = LevelInfo { depth, ..LevelInfo::default() };
        Depth { level, pieces: Vec::new(), first: u128::MAX, waiting: VecDeque::new(), count: 0 }
    }

    fn complete(
        &mut self,
        end: u64,
        mut children: Option<&mut VecDeque<Child>>,
        levels_of: Purpose,
        root: RootCell,
        options: &OctreeOptions,
    ) -> Vec<TreeNode<Data>> {
        let depth = self.level.depth;
        let mut nodes = Vec::new();
        if self.pieces.is_empty() || cell_end(self.first, depth) > end {
            return nodes;
        }
        self.pieces.sort_unstable_by_key(|(cell, piece)| (*cell, piece.first));
        let complete = self.pieces.partition_point(|(cell, _)| cell_end(*cell, depth) <= end);
        let rest = self.pieces.split_off(complete);
        self.first = rest.first().map_or(u128::MAX, |(cell, _)| *cell);
        let mut pieces = std::mem::replace(&mut self.pieces, rest).into_iter().peekable();
        while let Some((cell, first)) = pieces.next() {
            let mut all = vec![first];
            while let Some((_, more)) = pieces.next_if(|(other, _)| *other == cell) {
                all.push(more);
            }
            let mut draft = Draft::of(all, root);
            while let Some(child) = children.as_mut().and_then(|waiting| next_of(waiting, cell)) {
                draft.adopt(&child);
            }
            draft.settle(levels_of, options, &mut self.level);
            self.waiting.push_back(draft.child(self.count, cell));
            self.count += 1;
            nodes.push(draft.finish(root));
        }
        nodes
    }
}

/// The first of the nodes that wait for their parents, if its parent is this one.
fn next_of(waiting: &mut VecDeque<Child>, parent: u128) -> Option<Child> {
    let is_next = waiting.front().is_some_and(|child| child.cell >> 3 == parent);
    if is_next { waiting.pop_front() } else { None }
}

/// First key behind a cell, of which this is the [`NodeKey::order`], or behind the smallest one that it is a part of.
fn cell_end(cell: u128, depth: u8) -> u64 {
    let first_behind = match depth.checked_sub(CELL_DEPTH) {
        Some(below) => (cell >> (3 * below)) + 1,
        None => (cell + 1) << (3 * (CELL_DEPTH - depth)),
    };
    first_behind as u64
}

/// What a parent needs to know of a node.
#[derive(Debug)]
struct Child {
    /// Among the nodes of its depth.
    index: usize,
    /// [`NodeKey::order`].
    cell: u128,
    source_particles: u64,
    mass: f64,
    mass_density: f64,
    smoothing_length_max: f32,
    /// Root fractions.
    bounds: Bounds,
    draw_cost: u64,
}

/// A node that is being put together, with lengths in root fractions.
struct Draft<Data> {
    node: TreeNode<Data>,
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

    fn adopt(&mut self, child: &Child) {
        let node = &mut self.node;
        node.children[(child.cell & 7) as usize] = Some(child.index);
        node.source_particles += child.source_particles;
        node.mass += child.mass;
        node.mass_density += child.mass_density;
        node.smoothing_length_max = node.smoothing_length_max.max(child.smoothing_length_max);
        node.bounds = node.bounds.union(child.bounds);
        self.children_cost += child.draw_cost;
    }

    /// What its parent will know of it.
    fn child(&self, index: usize, cell: u128) -> Child {
        let &TreeNode { source_particles, mass, mass_density, smoothing_length_max, bounds, .. } = &self.node;
        let draw_cost = self.draw_cost;
        Child { index, cell, source_particles, mass, mass_density, smoothing_length_max, bounds, draw_cost }
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
