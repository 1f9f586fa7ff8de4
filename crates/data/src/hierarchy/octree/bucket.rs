//! Building everything of the tree that one bucket of particles can build by itself: its leaves, and its part of every node
//! above them, bottom-up.

use super::block::{Block, Content};
use super::leaf::leaf;
use super::merge::Merger;
use super::piece::{Piece, Words};
use super::plan::{Plan, cell_keys};
use super::sorted::{Columns, DEEP, Place, Sorted};
use super::{Context, Purpose, is_relay};
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::NodeKey;
use crate::hierarchy::cell::{CELL_DEPTH, MAX_DEPTH};
use crate::model::portable::{expect, expect_that, expect_within, portable};
use std::ops::Range;

/// What a bucket that was cut inside a cell of depth 8 leaves to [`super::joint`].
#[derive(Debug)]
pub struct Open {
    /// Depth at which the block was merged.
    pub(super) depth: u8,
    pub(super) block: Block,
}

portable!(Open { depth, block });

impl Open {
    /// The first of its keys.
    pub fn key(&self) -> u64 {
        self.block.keys[0]
    }

    /// Depth at which it was merged: what is joined with it are nodes of lesser ones.
    pub fn depth(&self) -> u8 {
        self.depth
    }

    /// Whether it is what a bucket of a plan leaves open, of particles with so many attributes; else what was found and expected.
    pub fn check(&self, plan: &Plan, bucket: usize, attributes: usize) -> Result<(), String> {
        let Open { depth, block } = self;
        let closed = u64::from(plan.closed_depth(bucket));
        expect_within("depth", (*depth).into(), closed.max(1)..=closed)?;
        expect_within("particles", block.len() as u64, 1..=u32::MAX.into())?;
        let keys = plan.keys(bucket);
        expect_that(block.keys.iter().all(|key| keys.contains(key)), "keys", "those of a bucket")?;
        expect("attributes", block.columns.attributes.len(), attributes)?;
        let columns = block.columns.iter().map(Vec::len);
        let others = [block.units.len(), block.boxes.len(), block.words.len()];
        others.into_iter().chain(columns).try_for_each(|found| expect("column", found, block.len()))
    }
}

/// A cell's particles, merged at its depth.
struct Visited {
    content: Content,
    /// Particles drawn for it: its own, or for a relay those of its children.
    draw_cost: u64,
}

/// The particles of one bucket, in order.
pub struct Bucket<'a> {
    context: &'a Context<'a>,
    plan: &'a Plan,
    number: usize,
    sorted: Sorted,
}

impl<'a> Bucket<'a> {
    /// Sorts the particles of bucket `number` of a plan, which come in any order.
    pub fn new(
        context: &'a Context<'a>,
        plan: &'a Plan,
        number: usize,
        places: Vec<Place>,
        columns: Columns,
    ) -> Bucket<'a> {
        Bucket { context, plan, number, sorted: Sorted::new(places, columns) }
    }

    /// Builds levels and hands out their pieces, children before parents; leaves with those for splats only.
    ///
    /// # Errors
    /// Those of `sink`.
    pub fn build<E>(
        &self,
        levels: Purpose,
        sink: &mut dyn FnMut(Piece<Words>) -> Result<(), E>,
    ) -> Result<Option<Open>, E> {
        let Bucket { context, plan, number, sorted } = self;
        if sorted.keys.is_empty() {
            return Ok(None);
        }
        let depth = plan.closed_depth(*number);
        let mut builder = Builder { context, levels, plan, own: plan.keys(*number), sorted, sink };
        let top = builder.visit(cell_of(sorted.keys[0], depth), 0..sorted.keys.len())?;
        Ok(match top.content {
            Content::Block(block) if depth > 0 => Some(Open { depth, block }),
            _ => None,
        })
    }
}

struct Builder<'a, E> {
    context: &'a Context<'a>,
    levels: Purpose,
    plan: &'a Plan,
    /// The bucket's keys.
    own: Range<u64>,
    sorted: &'a Sorted,
    sink: &'a mut dyn FnMut(Piece<Words>) -> Result<(), E>,
}

impl<E> Builder<'_, E> {
    /// Builds the node that holds the (not empty) range of particles.
    fn visit(&mut self, key: NodeKey, range: Range<usize>) -> Result<Visited, E> {
        let (context, sorted) = (self.context, self.sorted);
        let depth = key.cell().depth;
        let size = cell_keys(depth);
        let first = sorted.keys[range.start] & !(size - 1);
        let capacity = context.options.leaf_capacity.max(1);
        let is_small = range.len() <= capacity || key.depth == MAX_DEPTH;
        if is_small && !self.plan.is_cut(depth, first) {
            if self.levels == Purpose::Splats {
                (self.sink)(leaf(context, sorted, key, range.clone()))?;
            }
            return Ok(Visited { draw_cost: range.len() as u64, content: Content::Sources(range) });
        }
        let mut contents = Vec::with_capacity(8);
        let (mut input, mut children_cost) = (0, 0);
        if depth < CELL_DEPTH {
            let mut from = range.start;
            while from < range.end {
                let child = sorted.keys[from] / (size / 8);
                let end = (child + 1) * (size / 8);
                let to = from + sorted.keys[from..range.end].partition_point(|&key| key < end);
                let child = self.visit(key.child((child & 7) as u8), from..to)?;
                input += child.content.len() as u64;
                children_cost += child.draw_cost;
                contents.push(child.content);
                from = to;
            }
        } else {
            let step = part_len(range.len(), capacity, MAX_DEPTH - key.depth);
            for (octant, from) in (0..).zip(range.clone().step_by(step)) {
                let child = self.visit(key.child(octant), from..range.end.min(from + step))?;
                input += child.content.len() as u64;
                children_cost += child.draw_cost;
            }
            // Parts may have merging cells in common, so they are merged as one, from the particles.
            contents.push(Content::Sources(range));
        }
        let merger = Merger::new(context, self.levels, key);
        let mut block = merger.merge(&contents, sorted);
        drop(contents);
        let whole = self.own.start <= first && first + size <= self.own.end;
        let merged = block.len() as u64;
        let is_relay = whole && is_relay(self.levels, key.depth, merged, children_cost, context.options);
        (self.sink)(Piece::merged(context, self.levels, key, &block, input, whole, is_relay))?;
        if depth == DEEP {
            block.keys.iter_mut().for_each(|key| *key = first | *key >> (3 * DEEP));
        }
        Ok(Visited { content: Content::Block(block), draw_cost: if is_relay { children_cost } else { merged } })
    }
}

/// Particles of each of the at most 8 parts that a node with `len` particles has `below` depths above the last: as few parts as leave
/// leaves of at most `capacity` at their ends, and of about the same size.
fn part_len(len: usize, capacity: usize, below: u8) -> usize {
    let mut room = capacity;
    for _ in 1..below {
        if room.saturating_mul(8) >= len {
            break;
        }
        room = room.saturating_mul(8);
    }
    len.div_ceil(len.div_ceil(room).clamp(1, 8))
}

/// The cell of a depth that a key lies in.
pub(super) fn cell_of(key: u64, depth: u8) -> NodeKey {
    let [x, y, z] = morton::decode(key >> (3 * (MORTON_BITS - u32::from(depth))));
    NodeKey { depth, x, y, z }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Largest leaf, and depths below, of what a node with so many particles is parted into.
    fn parted(len: usize, capacity: usize, below: u8) -> (usize, u8) {
        if len <= capacity || below == 0 {
            return (len, 0);
        }
        let step = part_len(len, capacity, below);
        assert!(step < len && len.div_ceil(step) <= 8, "{step} of {len}");
        let (largest, depths) = parted(step, capacity, below - 1);
        (largest, depths + 1)
    }

    proptest! {
        #[test]
        fn parts_are_few_and_small(len in 1..u32::MAX as usize, capacity in 1..100_000_usize, below in 1..12_u8) {
            let (largest, depths) = parted(len, capacity, below);
            let all = capacity.saturating_mul(1 << (3 * u32::from(below)));
            prop_assert!(largest <= capacity || len > all, "{} after {} of {} depths", largest, depths, below);
            // None of the depths could be spared.
            prop_assert!(depths == 0 || len > capacity.saturating_mul(1 << (3 * (u32::from(depths) - 1))));
        }
    }
}
