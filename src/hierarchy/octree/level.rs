//! Building the nodes of one depth from those of the depth below.

use super::block::{Block, Piece};
use super::merge::{Merger, is_point};
use super::sorted::Sorted;
use super::topology::{Shape, boundary_depth};
use super::{Encoding, LevelInfo, OctreeOptions, TreeNode, thin};
use crate::codec::coordinates::CELL_BITS;
use crate::codec::coordinates::{self, GRID_BITS, LEAF_BITS};
use crate::codec::{AttributeMerge, Codebook, Quantities};
use crate::hierarchy::{NodeKey, RootCell};
use crate::model::Bounds;
use glam::DVec3;
use rayon::prelude::*;

/// Particles merged by one task; tasks end at cell boundaries.
const TASK: usize = 1 << 15;

/// What all nodes of a family share.
pub(super) struct Context<'a> {
    pub sorted: &'a Sorted,
    pub root: RootCell,
    pub options: &'a OctreeOptions,
    pub rules: &'a [AttributeMerge],
}

/// A node, with the merged particles that its parent needs.
pub(super) struct Work {
    pub node: TreeNode,
    pub blocks: Vec<Block>,
    /// Particles drawn for the node: its own, or for a relay those of its children.
    draw_cost: u64,
    /// Positions in root fractions.
    tight: Bounds,
    /// Particles of the children before merging.
    input: u64,
}

impl Work {
    /// Frees what only the parent and the codebook needed.
    pub fn finish(self) -> TreeNode {
        self.node
    }
}

/// Builds the nodes of one depth; `below` holds those of the next.
pub(super) fn build(context: &Context, shapes: &[Shape], below: &[Work]) -> Vec<Work> {
    shapes
        .par_iter()
        .map(|shape| if shape.is_leaf() { leaf(context, shape) } else { inner(context, shape, below) })
        .collect()
}

fn leaf(context: &Context, shape: &Shape) -> Work {
    let sorted = context.sorted;
    let columns = &sorted.columns;
    let (mut mass, mut mass_density, mut h_max, mut delta, mut points) = (0.0, 0.0, 0.0_f32, 0.0_f64, 0);
    let mut tight = sorted.bounds(shape.sources.clone());
    let cells = f64::from(shape.key.depth).exp2();
    let quantum = shape.key.size(context.root) / f64::from(1 << LEAF_BITS);
    for i in shape.sources.clone() {
        let m = f64::from(columns.mass[i]);
        mass += m;
        mass_density += m * f64::from(columns.density[i]);
        h_max = h_max.max(columns.smoothing_length[i]);
        points += u32::from(f64::from(columns.smoothing_length[i]) <= quantum);
        let bins = leaf_bins(sorted.units[i], shape.key, cells);
        let decoded = DVec3::from_array(decode_leaf(bins, shape.key, cells));
        delta = delta.max(decoded.distance_squared(DVec3::from_array(sorted.units[i])));
        tight = tight.with(decoded);
    }
    let count = shape.sources.len();
    Work {
        node: TreeNode {
            key: shape.key,
            encoding: Encoding::Leaf,
            codebook: 0,
            particles: count as u32,
            points,
            delta: outward(delta, context.root),
            bounds: world(tight, context.root),
            smoothing_length_max: h_max,
            mass,
            mass_density,
            mass_scale: 1.0,
            mass_density_scale: 1.0,
            children: [None; 8],
            words: Vec::new(),
            codes: Vec::new(),
            sources: shape.sources.clone(),
        },
        blocks: Vec::new(),
        draw_cost: count as u64,
        tight,
        input: 0,
    }
}

fn inner(context: &Context, shape: &Shape, below: &[Work]) -> Work {
    let children: Vec<&Work> = shape.children.iter().flatten().map(|&child| &below[child]).collect();
    let pieces: Vec<Piece> = children.iter().flat_map(|child| pieces_of(child)).collect();
    let merger = Merger { key: shape.key, root: context.root, fusion: context.options.fusion, rules: context.rules };
    let tasks = tasks(&pieces, &context.sorted.keys, shape.key.depth);
    let mut blocks: Vec<Block> = tasks.par_iter().map(|task| merger.merge(task, context.sorted)).collect();
    let input = pieces.iter().map(|piece| piece.len() as u64).sum();
    let children_cost: u64 = children.iter().map(|child| child.draw_cost).sum();
    let merged: u64 = blocks.iter().map(|block| block.len() as u64).sum();

    let is_relay = shape.key.depth > 0 && merged as f64 > context.options.relay_fraction * children_cost as f64;
    if !is_relay {
        thin::thin(&mut blocks, context.options.thinning_budget);
    }
    let mut words = Vec::new();
    let mut tight = children.iter().fold(Bounds::EMPTY, |bounds, child| bounds.union(child.tight));
    let mut delta = 0.0_f64;
    if !is_relay {
        words.reserve_exact(blocks.iter().map(|block| block.len() - block.skipped_count()).sum());
        for block in &blocks {
            words.extend((0..block.len()).filter(|&i| !block.is_skipped(i)).map(|i| block.words[i]));
            delta = delta.max(block.delta_squared);
        }
        let extremes = drawn_bounds(&words, shape.key);
        tight = tight.union(extremes);
    }
    Work {
        node: TreeNode {
            key: shape.key,
            encoding: if is_relay { Encoding::Relay } else { Encoding::Grid },
            codebook: 0,
            particles: words.len() as u32,
            points: words.iter().filter(|&&word| is_point(word)).count() as u32,
            delta: if is_relay { f64::INFINITY } else { outward(delta, context.root) },
            bounds: world(tight, context.root),
            smoothing_length_max: children.iter().fold(0.0, |max, child| max.max(child.node.smoothing_length_max)),
            mass: children.iter().map(|child| child.node.mass).sum(),
            mass_density: children.iter().map(|child| child.node.mass_density).sum(),
            mass_scale: 1.0,
            mass_density_scale: 1.0,
            children: shape.children,
            words,
            codes: Vec::new(),
            sources: shape.sources.clone(),
        },
        draw_cost: if is_relay { children_cost } else { merged },
        blocks,
        tight,
        input,
    }
}

fn pieces_of(child: &Work) -> Vec<Piece<'_>> {
    if child.node.encoding == Encoding::Leaf {
        vec![Piece::Sources(child.node.sources.start, child.node.sources.end)]
    } else {
        child.blocks.iter().map(Piece::Block).collect()
    }
}

/// Groups pieces into tasks. The parent, one depth up, merges cells of depth `depth - 1 + 8`, and a block must not cut
/// through one of those.
fn tasks<'a, 'b>(pieces: &'a [Piece<'b>], keys: &[u64], depth: u8) -> Vec<&'a [Piece<'b>]> {
    let finest = (u32::from(depth) + CELL_BITS).saturating_sub(1).max(CELL_BITS);
    let mut tasks = Vec::new();
    let (mut first, mut len) = (0, 0);
    for (i, piece) in pieces.iter().enumerate() {
        len += piece.len();
        let end = piece.sources().end;
        let may_end = i + 1 == pieces.len() || boundary_depth(keys[end - 1], keys[end]) <= finest;
        if may_end && (len >= TASK || i + 1 == pieces.len()) {
            tasks.push(&pieces[first..=i]);
            (first, len) = (i + 1, 0);
        }
    }
    tasks
}

/// The box around decoded grid words, in root fractions.
fn drawn_bounds(words: &[u32], key: NodeKey) -> Bounds {
    let mask = (1 << GRID_BITS) - 1;
    let (mut low, mut high) = ([mask; 3], [0; 3]);
    for &word in words {
        for axis in 0..3 {
            let bin = word >> (GRID_BITS * axis as u32) & mask;
            low[axis] = low[axis].min(bin);
            high[axis] = high[axis].max(bin);
        }
    }
    let bins = (f64::from(key.depth) + f64::from(GRID_BITS)).exp2();
    let cell = [key.x, key.y, key.z];
    let place = |bin: [u32; 3]| {
        DVec3::from_array(std::array::from_fn(|axis| {
            (f64::from(cell[axis]) * f64::from(1 << GRID_BITS) + f64::from(bin[axis]) + 0.5) / bins
        }))
    };
    Bounds { min: place(low), max: place(high) }
}

/// The bins of a leaf particle; `cells` is `2^depth`.
fn leaf_bins(unit: [f64; 3], key: NodeKey, cells: f64) -> [u32; 3] {
    let cell = [key.x, key.y, key.z];
    std::array::from_fn(|axis| coordinates::bin(unit[axis] * cells - f64::from(cell[axis]), LEAF_BITS))
}

fn decode_leaf(bins: [u32; 3], key: NodeKey, cells: f64) -> [f64; 3] {
    let cell = [key.x, key.y, key.z];
    std::array::from_fn(|axis| {
        (f64::from(cell[axis]) + (f64::from(bins[axis]) + 0.5) / f64::from(1 << LEAF_BITS)) / cells
    })
}

/// The packed positions of a leaf.
pub(super) fn leaf_words(sorted: &Sorted, root: RootCell, node: &TreeNode) -> Vec<u64> {
    let cells = f64::from(node.key.depth).exp2();
    let quantum = node.key.size(root) / f64::from(1 << LEAF_BITS);
    let word = |i: usize| {
        let point = f64::from(sorted.columns.smoothing_length[i]) <= quantum;
        coordinates::pack_leaf(leaf_bins(sorted.units[i], node.key, cells), point)
    };
    node.sources.clone().map(word).collect()
}

/// A measured distance in world units, rounded up by what rounding to doubles can have moved the positions.
fn outward(squared: f64, root: RootCell) -> f64 {
    let largest = root.min.abs().max_element() + root.size;
    squared.sqrt() * root.size * (1.0 + 1e-12) + largest * 2.0_f64.powi(-50)
}

fn world(tight: Bounds, root: RootCell) -> Bounds {
    let place = |p: DVec3| root.min + p * root.size;
    Bounds { min: place(tight.min), max: place(tight.max) }
}

/// The quantities of all blocks that grid nodes of this depth draw, in order.
pub(super) fn drawn_quantities(works: &[Work]) -> Vec<Quantities<'_>> {
    let grids = works.iter().filter(|work| work.node.encoding == Encoding::Grid);
    grids
        .flat_map(|work| &work.blocks)
        .map(|block| Quantities {
            mass: &block.columns.mass,
            density: &block.columns.density,
            smoothing_length: &block.columns.smoothing_length,
            attributes: block.columns.attributes.iter().map(Vec::as_slice).collect(),
            skipped: &block.skipped,
        })
        .collect()
}

/// Gives the grid nodes of this depth their codes, one column for each of their blocks.
pub(super) fn set_codes(works: &mut [Work], codes: Vec<Vec<u16>>, codebook: u16, book: &Codebook) {
    let mut codes = codes.into_iter();
    for work in works.iter_mut().filter(|work| work.node.encoding == Encoding::Grid) {
        let mut own = Vec::with_capacity(work.node.particles as usize);
        for (block, codes) in work.blocks.iter().zip(&mut codes) {
            own.extend(codes.into_iter().enumerate().filter(|(i, _)| !block.is_skipped(*i)).map(|(_, code)| code));
        }
        work.node.set_codes(own, codebook, book);
    }
}

/// Counts the nodes of one depth.
pub(super) fn count(depth: u8, works: &[Work]) -> LevelInfo {
    let mut level = LevelInfo { depth, ..LevelInfo::default() };
    for work in works {
        let after: u64 = work.blocks.iter().map(|block| block.len() as u64).sum();
        level.input += work.input;
        let points = u64::from(work.node.points);
        let particles = u64::from(work.node.particles);
        match work.node.encoding {
            Encoding::Leaf => {
                level.leaf_nodes += 1;
                level.leaf_particles += particles;
            }
            Encoding::Grid => {
                level.grid_nodes += 1;
                level.merged += work.input - after;
                level.skipped += after - particles;
                level.points += points;
                level.sprites += particles - points;
            }
            Encoding::Relay => {
                level.relay_nodes += 1;
                level.merged += work.input - after;
                level.relayed += after;
            }
        }
    }
    level
}
