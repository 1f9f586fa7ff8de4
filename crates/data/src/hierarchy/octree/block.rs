//! Runs of particles between two depths of the build.

use super::sorted::{Columns, Sorted};
use crate::model::portable::portable;
use std::ops::Range;

/// Merged particles that stand for the source particles of a run of whole cells, in Morton order of their cells.
#[derive(Debug, Default)]
pub(super) struct Block {
    /// Morton key of each merged particle's first source particle ([`Sorted::keys_at`]): it has the cell of the merged one at the
    /// depth of merging and above.
    pub keys: Vec<u64>,
    /// True (not quantised) positions, fractions of the root cell.
    pub units: Vec<[f64; 3]>,
    /// The box around the source particles of each, fractions of the root cell.
    pub boxes: Vec<Box3>,
    pub columns: Columns,
    /// Packed positions at the depth of merging.
    pub words: Vec<u32>,
    /// Largest squared distance that a source particle can have from its decoded merged one, in root fractions.
    pub delta_squared: f64,
}

portable!(Block { keys, units, boxes, columns, words, delta_squared });

/// A box: smallest and largest coordinates.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Box3 {
    pub low: [f64; 3],
    pub high: [f64; 3],
}

portable!(Box3 { low, high });

impl Box3 {
    /// A single place.
    #[inline]
    pub fn of(unit: [f64; 3]) -> Box3 {
        Box3 { low: unit, high: unit }
    }

    #[inline]
    pub fn union(self, other: Box3) -> Box3 {
        Box3 {
            low: std::array::from_fn(|axis| self.low[axis].min(other.low[axis])),
            high: std::array::from_fn(|axis| self.high[axis].max(other.high[axis])),
        }
    }

    /// Squared distance of the farthest corner from `place`.
    #[inline]
    pub fn reach_squared(&self, place: [f64; 3]) -> f64 {
        (0..3).map(|axis| (place[axis] - self.low[axis]).max(self.high[axis] - place[axis]).powi(2)).sum()
    }
}

impl Block {
    /// Number of merged particles.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Adds the particles of the run of cells that comes next.
    pub fn append(&mut self, next: Block) {
        self.keys.extend(next.keys);
        self.units.extend(next.units);
        self.boxes.extend(next.boxes);
        self.words.extend(next.words);
        self.columns.iter_mut().zip(next.columns.iter()).for_each(|(own, next)| own.extend(next));
        self.delta_squared = self.delta_squared.max(next.delta_squared);
    }
}

/// What is merged: source particles of a leaf, or what was merged a depth below.
#[derive(Debug)]
pub(super) enum Content {
    Sources(Range<usize>),
    Block(Block),
}

impl Content {
    /// Number of particles to merge.
    pub fn len(&self) -> usize {
        match self {
            Content::Sources(range) => range.len(),
            Content::Block(block) => block.len(),
        }
    }

    /// The columns of the particles to merge at a depth; `sorted` are the source particles.
    pub fn view<'a>(&'a self, sorted: &'a Sorted, depth: u8) -> View<'a> {
        match self {
            Content::Sources(range) => {
                View::of(sorted.keys_at(depth), &sorted.units, None, &sorted.columns, range.clone())
            }
            Content::Block(block) => {
                View::of(&block.keys, &block.units, Some(&block.boxes), &block.columns, 0..block.len())
            }
        }
    }
}

/// Borrowed columns.
pub(super) struct View<'a> {
    pub keys: &'a [u64],
    pub units: &'a [[f64; 3]],
    boxes: Option<&'a [Box3]>,
    pub mass: &'a [f32],
    pub density: &'a [f32],
    pub smoothing_length: &'a [f32],
    pub attributes: Vec<&'a [f32]>,
}

impl<'a> View<'a> {
    fn of(
        keys: &'a [u64],
        units: &'a [[f64; 3]],
        boxes: Option<&'a [Box3]>,
        columns: &'a Columns,
        range: Range<usize>,
    ) -> View<'a> {
        View {
            keys: &keys[range.clone()],
            units: &units[range.clone()],
            boxes: boxes.map(|boxes| &boxes[range.clone()]),
            mass: &columns.mass[range.clone()],
            density: &columns.density[range.clone()],
            smoothing_length: &columns.smoothing_length[range.clone()],
            attributes: columns.attributes.iter().map(|column| &column[range.clone()]).collect(),
        }
    }

    /// The box around the source particles of particle `i`.
    #[inline]
    pub fn box_of(&self, i: usize) -> Box3 {
        self.boxes.map_or_else(|| Box3::of(self.units[i]), |boxes| boxes[i])
    }
}
