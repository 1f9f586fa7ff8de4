//! A page in memory: node records and the packed particles of each node.

use super::clusters::NodeClusters;
use super::content::Content;
use super::error::Damage;
use super::layout::{
    NODE_RECORD_LEN, NodeRecord, PAGE_HEADER_LEN, PAGE_MAGIC, SECTION_ALIGNMENT, StoredNode, particles_memory, u32_at,
};
use super::metadata::{AttributeMerge, Metadata};
use super::page_table::PageTable;
use crate::codec::clusters::PackedClusters;
use crate::codec::coordinates::{CELL_BITS, GRID_POINT, LEAF_BITS, LEAF_POINT, unpack_grid, unpack_leaf};
use crate::codec::positions::{decode_grid, decode_leaf, leaf_rounding};
pub use crate::hierarchy::Encoding;
use crate::hierarchy::cell::MAX_DEPTH;
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
    /// Index of its family in [`Metadata::families`].
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

    /// Reads and checks the bytes of a page, whose checksum has been found right; `table` tells the
    /// number of nodes of it and of its children's pages. Frames are where `placement` puts them, all else is as the file says.
    pub(super) fn parse(
        id: PageId,
        bytes: &[u8],
        metadata: &Metadata,
        table: &PageTable,
        placement: &Placement,
    ) -> Result<Page, Damage> {
        let here = || format!("page {}", id.0);
        let entry = table.get(id.0 as usize).ok_or_else(|| Damage::new(here(), "to exist"))?;
        let header_matches = bytes.len() >= PAGE_HEADER_LEN
            && bytes[..4] == PAGE_MAGIC
            && [4, 8, 12, 16].map(|at| u32_at(bytes, at)) == [id.0, entry.family, entry.nodes, entry.len]
            && bytes[20..PAGE_HEADER_LEN].iter().all(|&byte| byte == 0);
        if !header_matches {
            return Err(Damage::new(here(), "a page header that agrees with the page table"));
        }
        let Some(family) = metadata.families.get(entry.family as usize) else {
            return Err(Damage::new(here(), format!("a family below {}", metadata.families.len())));
        };
        let records_end = (entry.nodes as usize)
            .checked_mul(NODE_RECORD_LEN)
            .and_then(|len| len.checked_add(PAGE_HEADER_LEN))
            .filter(|&end| end <= bytes.len())
            .ok_or_else(|| Damage::new(here(), "room for its node records"))?;

        let root = family.root.placed(placement);
        // A particle takes at least a byte of the page, for its code, and at most ten in memory.
        let memory = entry.memory as usize;
        if memory / 10 > bytes.len() {
            return Err(Damage::new(here(), "room for the particles that the page table tells"));
        }
        let mut page = Page {
            id,
            family: entry.family,
            nodes: Vec::with_capacity(entry.nodes as usize),
            children: Vec::new(),
            child_bounds: Vec::new(),
            cells: Vec::with_capacity(entry.nodes as usize),
            child_cells: Vec::new(),
            words: Vec::with_capacity(memory / 8 + entry.nodes as usize),
            positions: Vec::with_capacity(entry.nodes as usize),
            codes: Vec::with_capacity(memory / 6),
            code_ranges: Vec::with_capacity(entry.nodes as usize),
            sizes: Vec::with_capacity(entry.nodes as usize),
            contents: Vec::new(),
        };
        let rules: Arc<[AttributeMerge]> = family.attributes.iter().map(|attribute| attribute.merge).collect();
        // Sections follow the records in order, each aligned, without gaps but the alignment's zeros.
        let mut at = records_end;
        for (i, record) in bytes[PAGE_HEADER_LEN..records_end].chunks_exact(NODE_RECORD_LEN).enumerate() {
            let here = || format!("page {}, node {i}", id.0);
            let Ok(record) = record.try_into() else { continue };
            let NodeRecord { node, positions, codes } = NodeRecord::decode(record, here)?;
            let count = node.particles as usize;
            let start = at;
            // A code takes at least a byte, so that the page's length bounds what its particles take in memory.
            let packing = metadata.bits.of(node.encoding == Encoding::Leaf);
            let packed = packing.packed_len(count).filter(|&len| len <= bytes.len());
            let (Some(packed), true) = (packed, node.points <= node.particles && positions as usize == at) else {
                let expected = "positions after the section before, room for its codes, and at most as many points";
                return Err(Damage::new(here(), expected));
            };
            let first_word = page.words.len();
            let held = match node.encoding {
                Encoding::Leaf => count,
                Encoding::Grid | Encoding::Relay => count.div_ceil(2),
                Encoding::Clusters | Encoding::LeafClusters => 0,
            };
            page.words.resize(first_word + held, 0);
            let mut clusters = None;
            let words = &mut page.words[first_word..];
            let from = bytes.get(positions as usize..).unwrap_or_default();
            let points = node.points as usize;
            let len = match node.encoding {
                Encoding::Leaf => decode_leaf(from, points, words),
                // An odd number of grid words leaves half of the last 64-bit word over.
                Encoding::Grid | Encoding::Relay => {
                    decode_grid(from, points, &mut bytemuck::cast_slice_mut(words)[..count])
                }
                Encoding::Clusters | Encoding::LeafClusters => match &family.clusters {
                    None => Err("no clusters, of which the footer tells nothing"),
                    Some(tree) => {
                        PackedClusters::decode(from, count, tree.shape_bits, tree.is_published).map(|(packed, len)| {
                            clusters = Some((packed, tree));
                            len
                        })
                    }
                },
            }
            .map_err(|expected| Damage::new(here(), expected))?;
            section(bytes, &mut at, positions, len)
                .ok_or_else(|| Damage::new(here(), "positions inside the page, after the section before"))?;
            let codes_end = section(bytes, &mut at, codes, packed)
                .ok_or_else(|| Damage::new(here(), "codes inside the page, after its positions"))?;
            let first_code = page.codes.len();
            packing.unpack(&bytes[codes as usize..codes_end], count, &mut page.codes);
            page.sizes.push((NODE_RECORD_LEN + at - start) as u64);
            check_node(&node, (entry.family, family), &page.codes[first_code..], (id, i as u32), table)
                .map_err(|expected| Damage::new(here(), expected))?;
            let content: Option<Arc<dyn Content>> = match clusters {
                None => None,
                Some((packed, tree)) => {
                    let codes = page.codes.split_off(first_code);
                    let frame = Frame { min: node.key.min(root), size: node.key.size(root) };
                    let about = (&tree.book, Arc::clone(&rules), metadata.kernel);
                    let own = NodeClusters::new(frame, packed, codes, about, placement)
                        .map_err(|expected| Damage::new(here(), expected))?;
                    Some(Arc::new(own))
                }
            };
            page.contents.push(content);
            page.positions.push(first_word..page.words.len());
            page.code_ranges.push(first_code..page.codes.len());
            let first_child = page.children.len() as u32;
            for (octant, child) in (0..).zip(node.children) {
                let Some(child) = child else { continue };
                let cell = match node.encoding {
                    Encoding::LeafClusters => node.key,
                    _ => node.key.child(octant),
                };
                page.children.push(child);
                page.child_bounds.push(around(cell.bounds(root)));
                page.child_cells.push(cell);
            }
            page.cells.push(node.key);
            page.nodes.push(Node::of(node, root, first_child..page.children.len() as u32));
        }
        if at != bytes.len() {
            return Err(Damage::new(here(), "an end right after the last section"));
        }
        let memory = |node: &Node| particles_memory(node.encoding, node.particles);
        if page.nodes.iter().map(memory).sum::<u64>() != u64::from(entry.memory) {
            return Err(Damage::new(here(), "particles that take the memory that the page table tells"));
        }
        check_family_links(&page).map_err(|(i, expected)| Damage::new(format!("page {}, node {i}", id.0), expected))?;
        Ok(page)
    }
}

/// Advances over a section of `len` bytes that must start at `offset`, the aligned place `at`; returns its end. The
/// zeros that align the next section belong to it.
fn section(bytes: &[u8], at: &mut usize, offset: u32, len: usize) -> Option<usize> {
    let end = at.checked_add(len)?;
    let aligned = end.checked_next_multiple_of(SECTION_ALIGNMENT)?;
    let in_place = offset as usize == *at && aligned <= bytes.len();
    if !in_place || bytes[end..aligned].iter().any(|&byte| byte != 0) {
        return None;
    }
    *at = aligned;
    Some(end)
}

/// Checks what a node says against its file; the error is what was expected.
fn check_node(
    node: &StoredNode,
    (number, family): (u32, &super::FamilyMetadata),
    codes: &[u16],
    own: (PageId, u32),
    table: &PageTable,
) -> Result<(), String> {
    if !node.key.is_valid() {
        return Err(format!("a depth of at most {MAX_DEPTH} and a cell inside the root"));
    }
    if node.points > node.particles || u64::from(node.particles) > node.source_particles {
        return Err("at most as many points as particles, and particles as source particles".into());
    }
    let entries = match &family.clusters {
        Some(clusters) if node.encoding.is_clusters() => clusters.book.values.len(),
        _ => family.codebooks.get(usize::from(node.codebook)).map_or(0, |book| book.len()),
    };
    if let Some(code) = codes.iter().find(|&&code| usize::from(code) >= entries) {
        return Err(format!("codes below {entries}, found {code}"));
    }
    let finite = [node.mass, node.mass_density].iter().all(|v| v.is_finite())
        && [node.smoothing_length_max, node.mass_scale, node.mass_density_scale].iter().all(|v| v.is_finite())
        && node.bounds.min.is_finite()
        && node.bounds.max.is_finite();
    if !finite || node.bounds.is_empty() || node.smoothing_length_max < 0.0 {
        return Err("finite bounds, masses and scales".into());
    }
    let childless = node.children.iter().all(Option::is_none);
    let consistent = match node.encoding {
        Encoding::Leaf => {
            childless
                && u64::from(node.particles) == node.source_particles
                && (0.0..f64::INFINITY).contains(&node.delta)
        }
        Encoding::Grid => !childless && node.particles > 0 && (0.0..f64::INFINITY).contains(&node.delta),
        Encoding::Clusters | Encoding::LeafClusters => {
            let only_first = node.children[0].is_some() && node.children[1..].iter().all(Option::is_none);
            !childless
                && node.particles > 0
                && node.points == 0
                && (0.0..f64::INFINITY).contains(&node.delta)
                && (only_first || node.encoding == Encoding::Clusters)
        }
        Encoding::Relay => !childless && node.particles == 0 && node.delta == f64::INFINITY && own.1 != u32::MAX,
    };
    if !consistent {
        return Err("children, particles and delta that suit its encoding".into());
    }
    for child in node.children.iter().flatten() {
        // Children come after their parent, so that no walk down the tree can go round in a circle.
        let entry = table.get(child.page.0 as usize);
        let exists = entry.is_some_and(|entry| child.node < entry.nodes && entry.family == number);
        if !exists || (child.page, child.node) <= own {
            return Err(format!("a later node of this family as a child, found {child:?}"));
        }
    }
    Ok(())
}

/// Children in the same page must have the cells that their parents give them.
fn check_family_links(page: &Page) -> Result<(), (usize, String)> {
    for i in 0..page.nodes.len() {
        for (child, cell) in page.children(i).iter().zip(page.child_cells(i)) {
            if child.page == page.id && page.cells[child.node as usize] != *cell {
                return Err((i, format!("node {} to be in the octant that it is the child of", child.node)));
            }
        }
    }
    Ok(())
}

/// A box a hair larger: particles lie in their cells up to rounding.
fn around(bounds: Bounds) -> Bounds {
    let hair = 1e-9 * (bounds.max - bounds.min) + 1e-14 * bounds.min.abs().max(bounds.max.abs());
    Bounds { min: bounds.min - hair, max: bounds.max + hair }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_small() {
        assert!(size_of::<Node>() <= 192, "{} bytes", size_of::<Node>());
    }
}
