//! The last merging steps of buckets that were cut inside a cell of depth 8.
//!
//! Such a bucket is merged by itself only down to where merging cells end with it. What is left of it then is little: it lies
//! in one or a few merging cells. Here those rests are merged together, up to the root.

use super::block::{Block, Content};
use super::bucket::{Open, cell_of};
use super::merge::Merger;
use super::piece::{Piece, Words};
use super::sorted::Sorted;
use super::{Context, Purpose};
use crate::codec::coordinates::CELL_BITS;
use crate::codec::morton::MORTON_BITS;

/// Merges what buckets, in their order, left open; hands out the pieces.
///
/// # Errors
/// Those of `sink`.
pub fn join<E>(
    context: &Context,
    levels: Purpose,
    open: Vec<Open>,
    sink: &mut dyn FnMut(Piece<Words>) -> Result<(), E>,
) -> Result<(), E> {
    let cell = |open: &Open| open.block.keys[0] >> (3 * (MORTON_BITS - CELL_BITS));
    let mut rest = open.into_iter().peekable();
    while let Some(first) = rest.next() {
        let own = cell(&first);
        let mut group = vec![first];
        while let Some(next) = rest.next_if(|next| cell(next) == own) {
            group.push(next);
        }
        join_cell(context, levels, group, sink)?;
    }
    Ok(())
}

/// Merges what was left open inside one cell of depth 8.
fn join_cell<E>(
    context: &Context,
    levels: Purpose,
    mut group: Vec<Open>,
    sink: &mut dyn FnMut(Piece<Words>) -> Result<(), E>,
) -> Result<(), E> {
    let nothing = Sorted::default();
    let deepest = group.iter().map(|open| open.depth).max().unwrap_or(0);
    for depth in (0..deepest).rev() {
        let mut above: Vec<Open> = Vec::new();
        let mut waiting = group.into_iter().peekable();
        while let Some(open) = waiting.next() {
            if open.depth <= depth {
                above.push(open);
                continue;
            }
            // Neighbours of one cell may share a merging cell, so that they become one run.
            let mut run = open.block;
            let key = cell_of(run.keys[0], depth);
            let is_beside = |next: &Open| next.depth > depth && cell_of(next.block.keys[0], depth) == key;
            while let Some(next) = waiting.next_if(is_beside) {
                run.append(next.block);
            }
            let input = run.len() as u64;
            let block: Block = Merger::new(context, levels, key).merge(&[Content::Block(run)], &nothing);
            sink(Piece::merged(context, levels, key, &block, input, false, false))?;
            above.push(Open { depth, block });
        }
        group = above;
    }
    Ok(())
}
