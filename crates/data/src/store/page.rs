//! A page in memory: node records and the packed particles of each node.

mod parse;

use super::content::Content;
use super::layout::{StoredNode, particles_memory};
use crate::codec::coordinates::{CELL_BITS, GRID_POINT, LEAF_BITS, LEAF_POINT, unpack_grid, unpack_leaf};
use crate::codec::positions::leaf_rounding;
pub use crate::hierarchy::Encoding;
use crate::hierarchy::{NodeKey, RootCell};
use crate::model::portable::{Portable, portable};
use crate::model::{Bounds, Placement};
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;

/// Number of a page in its file; pages are numbered breadth-first from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PageId(pub u32);

/// A node of some page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeRef {
    /// The page.
    pub page: PageId,
    /// Index of the node in the page.
    pub node: u32,
}

impl Portable for PageId {
    fn put(&self, to: &mut Vec<u8>) {
        self.0.put(to);
    }

    fn take(from: &mut &[u8]) -> Option<PageId> {
        u32::take(from).map(PageId)
    }
}

portable!(NodeRef { page, node });

/// A cube that positions are told in as fractions of its edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Its corner of smallest coordinates, world units.
    pub min: DVec3,
    /// Its edge, world units.
    pub size: f64,
}

impl Frame {
    /// The cube as a box.
    pub fn bounds(self) -> Bounds {
        Bounds { min: self.min, max: self.min + DVec3::splat(self.size) }
    }

    /// World position of a decoded particle position (fractions of the edge, see [`NodeParticles::fraction`]).
    pub fn position(self, fraction: [f32; 3]) -> DVec3 {
        self.min + DVec3::from_array(fraction.map(f64::from)) * self.size
    }
}

/// One node of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Where the positions of its particles lie.
    pub frame: Frame,
    /// Seed of what is drawn at random of it: the same in every picture, and others for other nodes.
    pub seed: u32,
    /// Steps from the root.
    pub depth: u8,
    /// How its particles are held.
    pub encoding: Encoding,
    /// Index of its codebook in [`super::FamilyMetadata::codebooks`].
    pub codebook: u16,
    /// Number of particles that it holds (those to draw for it).
    pub particles: u32,
    /// How many of them are points: particles smaller than their positions are told.
    pub points: u32,
    /// Number of source particles that it stands for.
    pub source_particles: u64,
    /// Measured maximum distance between a source particle and the particle drawn for it, world units; infinite for
    /// relays.
    pub delta: f64,
    /// Edge of the cells in which its particles were merged, world units; 0 where none were.
    pub spacing: f64,
    /// Tight box around the source and the drawn positions of the node and everything below it.
    pub bounds: Bounds,
    /// Largest decoded or source smoothing length in the node and below: particles reach at most this far out of
    /// `bounds`.
    pub smoothing_length_max: f32,
    /// Sum of the source particles' masses, skipped ones included.
    pub mass: f64,
    /// Sum of the source particles' `m rho`.
    pub mass_density: f64,
    /// `mass` divided by the sum of the node's decoded masses: a factor near 1 that makes the node conserve mass
    /// exactly. Multiply it to weights `m`.
    pub mass_scale: f32,
    /// The same for weights `m rho`.
    pub mass_density_scale: f32,
    /// When it is there, in the data's unit of time: from the first to before the last.
    pub time: [f64; 2],
    /// Which of its page's child references are its own: [`Page::children`]. None for a leaf.
    pub children: Range<u32>,
}

/// The span of what does not change.
pub const ALWAYS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Bytes that a node takes in memory beside its particles, with the one reference to it that a tree has on average.
pub(super) const NODE_MEMORY: u64 =
    (size_of::<Node>() + size_of::<NodeKey>() + size_of::<NodeRef>() + size_of::<Bounds>() + size_of::<NodeKey>())
        as u64;

impl Node {
    /// A node of a file whose octree has this root, and which children of its page it has.
    fn of(stored: StoredNode, root: RootCell, children: Range<u32>) -> Node {
        let StoredNode { key, encoding, codebook, particles, points, source_particles, delta, bounds, .. } = stored;
        let StoredNode { smoothing_length_max, mass, mass_density, mass_scale, mass_density_scale, .. } = stored;
        let frame = Frame { min: key.min(root), size: key.size(root) };
        Node {
            frame,
            seed: key.seed(),
            depth: key.depth,
            encoding,
            codebook,
            particles,
            points,
            source_particles,
            delta,
            spacing: if encoding == Encoding::Leaf { 0.0 } else { frame.size / f64::from(1 << CELL_BITS) },
            bounds,
            smoothing_length_max,
            mass,
            mass_density,
            mass_scale,
            mass_density_scale,
            time: ALWAYS,
            children,
        }
    }

    /// A leaf around particles of its own, which are where the source has them. It has no mass yet.
    pub fn leaf(bounds: Bounds, particles: u32) -> Node {
        Node {
            frame: Frame { min: bounds.min, size: bounds.size().max_element() },
            seed: 0,
            depth: 0,
            encoding: Encoding::Leaf,
            codebook: 0,
            particles,
            points: 0,
            source_particles: particles.into(),
            delta: 0.0,
            spacing: 0.0,
            bounds,
            smoothing_length_max: 0.0,
            mass: 0.0,
            mass_density: 0.0,
            mass_scale: 1.0,
            mass_density_scale: 1.0,
            time: ALWAYS,
            children: 0..0,
        }
    }

    /// Whether the node has no children.
    pub fn is_leaf(&self) -> bool {
        self.encoding == Encoding::Leaf
    }

    /// When it is asked about where no time is named: when it begins, or 0 if it has been there always.
    pub fn start(&self) -> f64 {
        if self.time[0].is_finite() { self.time[0] } else { 0.0 }
    }
}

/// The packed positions of a node's particles, in Morton order (neighbours in space are neighbours in memory).
#[derive(Clone, Copy, Debug)]
pub enum Positions<'a> {
    /// Of a grid node.
    Grid(&'a [u32]),
    /// Of a leaf.
    Leaf(&'a [u64]),
}

/// The particles of one node.
#[derive(Clone, Copy, Debug)]
pub struct NodeParticles<'a> {
    /// Packed positions.
    pub positions: Positions<'a>,
    /// Codebook index of each particle; all are valid in the node's codebook.
    pub codes: &'a [u16],
}

impl<'a> NodeParticles<'a> {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.codes.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.codes.is_empty()
    }

    /// Position of particle `i` as fractions of the node's frame: [`Frame::position`] is its place.
    pub fn fraction(&self, i: usize) -> [f32; 3] {
        match self.positions {
            Positions::Grid(words) => unpack_grid(words[i]),
            Positions::Leaf(words) => unpack_leaf(words[i]),
        }
    }

    /// How far at most each coordinate of particle `i` of a leaf is from its source's, as a fraction of the frame's edge (up to
    /// rounding of doubles); 1 for merged particles.
    pub fn rounding(&self, i: usize) -> f64 {
        match self.positions {
            Positions::Grid(_) => 1.0,
            Positions::Leaf(words) => leaf_rounding(words[i]) / f64::from(1 << LEAF_BITS),
        }
    }

    /// Whether particle `i` is a point.
    pub fn is_point(&self, i: usize) -> bool {
        match self.positions {
            Positions::Grid(words) => words[i] & GRID_POINT != 0,
            Positions::Leaf(words) => words[i] & LEAF_POINT != 0,
        }
    }

    /// The positions as 32-bit words, ready for upload: one for each grid particle, two (low, high on little-endian machines)
    /// for each leaf particle.
    pub fn words(&self) -> &'a [u32] {
        match self.positions {
            Positions::Grid(words) => words,
            Positions::Leaf(words) => bytemuck::cast_slice(words),
        }
    }
}

/// A node for a page of a tree that is no page file: [`Page::new`].
#[derive(Clone, Debug)]
pub struct Branch {
    /// The node; which children it has is not looked at.
    pub node: Node,
    /// Its children, each with a box that holds all positions of it and below it.
    pub children: Vec<(NodeRef, Bounds)>,
    /// What it draws.
    pub content: Arc<dyn Content>,
}

/// A page, read and checked.
#[derive(Clone, Debug)]
pub struct Page {
    /// Its number.
    pub id: PageId,
    /// Index of its family in [`super::Metadata::families`].
    pub family: u32,
    /// Its nodes, parents before children.
    pub nodes: Vec<Node>,
    children: Vec<NodeRef>,
    child_bounds: Vec<Bounds>,
    /// Cells of the nodes and of their children in their octree.
    pub(super) cells: Vec<NodeKey>,
    pub(super) child_cells: Vec<NodeKey>,
    words: Vec<u64>,
    positions: Vec<Range<usize>>,
    codes: Vec<u16>,
    code_ranges: Vec<Range<usize>>,
    /// Bytes of each node's record and sections on the disk.
    sizes: Vec<u64>,
    /// What is not coded with the family's codebooks, a node each.
    contents: Vec<Option<Arc<dyn Content>>>,
}

impl Page {
    /// A page of nodes that bring their own content, parents before children.
    pub fn new(id: PageId, family: u32, branches: impl IntoIterator<Item = Branch>) -> Page {
        let mut page = Page {
            id,
            family,
            nodes: Vec::new(),
            children: Vec::new(),
            child_bounds: Vec::new(),
            cells: Vec::new(),
            child_cells: Vec::new(),
            words: Vec::new(),
            positions: Vec::new(),
            codes: Vec::new(),
            code_ranges: Vec::new(),
            sizes: Vec::new(),
            contents: Vec::new(),
        };
        for Branch { node, children, content } in branches {
            let first = page.children.len() as u32;
            for (child, bounds) in children {
                page.children.push(child);
                page.child_bounds.push(bounds);
            }
            page.nodes.push(Node { children: first..page.children.len() as u32, ..node });
            page.positions.push(0..0);
            page.code_ranges.push(0..0);
            page.sizes.push(0);
            page.contents.push(Some(content));
        }
        page
    }

    /// What a node draws, where that is not coded with the family's codebooks: then [`Page::particles`] is empty. `None` for
    /// coded particles, and where there is no such node.
    pub fn content(&self, node: usize) -> Option<&dyn Content> {
        self.contents.get(node)?.as_deref()
    }

    /// The particles of node `node` of this page. Panics if there is no such node.
    pub fn particles(&self, node: usize) -> NodeParticles<'_> {
        let words = &self.words[self.positions[node].clone()];
        let count = self.code_ranges[node].len();
        NodeParticles {
            positions: match self.nodes[node].encoding {
                Encoding::Leaf => Positions::Leaf(words),
                // An odd number of grid words leaves half of the last 64-bit word over.
                _ => Positions::Grid(&bytemuck::cast_slice(words)[..count]),
            },
            codes: &self.codes[self.code_ranges[node].clone()],
        }
    }

    /// The nodes that refine a node. Panics if there is no such node.
    pub fn children(&self, node: usize) -> &[NodeRef] {
        &self.children[self.child_range(node)]
    }

    /// For each child of a node a box that holds all positions of it and below it. Panics if there is no such node.
    pub fn child_bounds(&self, node: usize) -> &[Bounds] {
        &self.child_bounds[self.child_range(node)]
    }

    /// The cells of a node's children. Panics if there is no such node.
    pub(super) fn child_cells(&self, node: usize) -> &[NodeKey] {
        &self.child_cells[self.child_range(node)]
    }

    fn child_range(&self, node: usize) -> Range<usize> {
        let Range { start, end } = self.nodes[node].children;
        start as usize..end as usize
    }

    /// Bytes that the record and the sections of node `node` take on the disk, alignment included. Panics if there is no such node.
    pub fn node_bytes(&self, node: usize) -> u64 {
        self.sizes[node]
    }

    /// Bytes of memory that the page holds: [`super::PageFile::page_memory`].
    pub fn memory(&self) -> u64 {
        let coded = |node: &Node| particles_memory(node.encoding, node.particles);
        // Clusters are told by the page table, too; what a run's nodes hold is not coded.
        let coded = match self.cells.is_empty() {
            true => 0,
            false => self.nodes.iter().map(coded).sum::<u64>(),
        };
        let particles = coded + self.contents.iter().flatten().map(|content| content.memory()).sum::<u64>();
        particles + self.nodes.len() as u64 * NODE_MEMORY
    }

    /// Gives the page, its family and its nodes' children the numbers that they have in a scene of several files, and puts it where
    /// its file lies there.
    pub(super) fn relocate(&mut self, first_page: u32, first_family: u32, placement: &Placement) {
        let moved = |page: PageId| PageId(page.0 + first_page);
        self.id = moved(self.id);
        self.family += first_family;
        self.children.iter_mut().for_each(|child| child.page = moved(child.page));
        if placement.is_here() {
            return;
        }
        for node in &mut self.nodes {
            node.delta *= placement.scale;
            node.bounds = placement.bounds(node.bounds);
            node.smoothing_length_max = (f64::from(node.smoothing_length_max) * placement.scale) as f32;
            node.mass *= placement.mass;
            node.mass_density *= placement.mass * placement.density();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_small() {
        assert!(size_of::<Node>() <= 192, "{} bytes", size_of::<Node>());
    }
}
