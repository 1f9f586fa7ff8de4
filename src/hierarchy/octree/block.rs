//! Runs of merged particles between two depths of the build.

use super::sorted::{Columns, Sorted};
use std::ops::Range;

/// Merged particles that stand for a contiguous range of the sorted source particles, in Morton order. A node's
/// particles are a sequence of blocks, so that a large node is merged in parallel.
#[derive(Debug, Default)]
pub(super) struct Block {
    /// The source particles.
    pub sources: Range<usize>,
    /// Morton key of each merged particle's first source particle: it has the cell of the merged one at the depth of
    /// merging and above.
    pub keys: Vec<u64>,
    /// True (not quantised) positions, fractions of the root cell.
    pub units: Vec<[f64; 3]>,
    pub columns: Columns,
    /// Packed positions at the depth of merging.
    pub words: Vec<u32>,
    /// For each source particle, the index of the merged particle that stands for it.
    pub owners: Vec<u32>,
    /// Particles left out of the node by presence thinning; empty if there is none.
    pub skipped: Vec<bool>,
    /// Largest squared distance between a source particle and its decoded merged one, in root fractions.
    pub delta_squared: f64,
}

impl Block {
    /// Number of merged particles.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether particle `i` is left out of the node.
    pub fn is_skipped(&self, i: usize) -> bool {
        !self.skipped.is_empty() && self.skipped[i]
    }

    /// Number of particles left out.
    pub fn skipped_count(&self) -> usize {
        self.skipped.iter().filter(|&&skipped| skipped).count()
    }
}

/// What is merged: source particles of a leaf, or a block of a node below.
#[derive(Clone, Copy, Debug)]
pub(super) enum Piece<'a> {
    Sources(usize, usize),
    Block(&'a Block),
}

impl<'a> Piece<'a> {
    /// The source particles that the piece stands for.
    pub fn sources(&self) -> Range<usize> {
        match self {
            Piece::Sources(start, end) => *start..*end,
            Piece::Block(block) => block.sources.clone(),
        }
    }

    /// Number of particles to merge.
    pub fn len(&self) -> usize {
        match self {
            Piece::Sources(start, end) => end - start,
            Piece::Block(block) => block.len(),
        }
    }

    /// The columns of the particles to merge.
    pub fn view(&self, sorted: &'a Sorted) -> View<'a> {
        match self {
            Piece::Sources(start, end) => View::new(&sorted.keys, &sorted.units, &sorted.columns, *start..*end),
            Piece::Block(block) => View::new(&block.keys, &block.units, &block.columns, 0..block.len()),
        }
    }
}

/// Borrowed columns.
pub(super) struct View<'a> {
    pub keys: &'a [u64],
    pub units: &'a [[f64; 3]],
    pub mass: &'a [f32],
    pub density: &'a [f32],
    pub smoothing_length: &'a [f32],
    pub attributes: Vec<&'a [f32]>,
}

impl<'a> View<'a> {
    fn new(keys: &'a [u64], units: &'a [[f64; 3]], columns: &'a Columns, range: Range<usize>) -> View<'a> {
        View {
            keys: &keys[range.clone()],
            units: &units[range.clone()],
            mass: &columns.mass[range.clone()],
            density: &columns.density[range.clone()],
            smoothing_length: &columns.smoothing_length[range.clone()],
            attributes: columns.attributes.iter().map(|column| &column[range.clone()]).collect(),
        }
    }
}
