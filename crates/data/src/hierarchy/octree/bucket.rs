//! Building everything of the tree that one bucket of particles can build by itself: its leaves, and its part of every node
//! above them, bottom-up.

use super::block::{Block, Content};
use super::leaf::leaf;
use super::merge::Merger;
use super::piece::{Piece, Words};
use super::plan::{Plan, cell_keys};
use super::sorted::{Columns, Place, Sorted};
use super::{Context, Purpose, is_relay};
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::NodeKey;
use crate::hierarchy::cell::MAX_DEPTH;
use std::ops::Range;

/// What a bucket that was cut inside a cell of depth 8 leaves to [`super::joint`].
#[derive(Debug)]
pub struct Open {
    /// Depth at which the block was merged.
    pub(super) depth: u8,
    pub(super) block: Block,
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
        let top = builder.visit(depth, 0..sorted.keys.len())?;
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
    /// Builds the cell of this depth that holds the (not empty) range of particles.
    fn visit(&mut self, depth: u8, range: Range<usize>) -> Result<Visited, E> {
        let (context, sorted) = (self.context, self.sorted);
        let size = cell_keys(depth);
        let first = sorted.keys[range.start] & !(size - 1);
        let key = cell_of(first, depth);
        let is_small = range.len() <= context.options.leaf_capacity.max(1) || depth == MAX_DEPTH;
        if is_small && !self.plan.is_cut(depth, first) {
            if self.levels == Purpose::Splats {
                (self.sink)(leaf(context, sorted, key, range.clone()))?;
            }
            return Ok(Visited { draw_cost: range.len() as u64, content: Content::Sources(range) });
        }
        let mut contents = Vec::with_capacity(8);
        let mut children_cost = 0;
        let mut from = range.start;
        while from < range.end {
            let end = (sorted.keys[from] & !(size / 8 - 1)) + size / 8;
            let to = from + sorted.keys[from..range.end].partition_point(|&key| key < end);
            let child = self.visit(depth + 1, from..to)?;
            children_cost += child.draw_cost;
            contents.push(child.content);
            from = to;
        }
        let merger = Merger::new(context, self.levels, key);
        let block = merger.merge(&contents, sorted);
        let input = contents.iter().map(|content| content.len() as u64).sum();
        drop(contents);
        let whole = self.own.start <= first && first + size <= self.own.end;
        let merged = block.len() as u64;
        let is_relay = whole && is_relay(self.levels, depth, merged, children_cost, context.options);
        (self.sink)(Piece::merged(context, self.levels, key, &block, input, whole, is_relay))?;
        Ok(Visited { content: Content::Block(block), draw_cost: if is_relay { children_cost } else { merged } })
    }
}

/// The cell of a depth that a key lies in.
pub(super) fn cell_of(key: u64, depth: u8) -> NodeKey {
    let [x, y, z] = morton::decode(key >> (3 * (MORTON_BITS - u32::from(depth))));
    NodeKey { depth, x, y, z }
}
