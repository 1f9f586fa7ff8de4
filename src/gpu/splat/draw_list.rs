//! What a picture draws: nodes, and their particles in blocks.
//!
//! The CPU's work grows with the nodes in the picture (and one block for each [`BLOCK`] particles), not with particles.

use super::layout::{BLOCK, Block, Node};
use super::resources::ALIGNMENT;
use crate::gpu::arena::Arena;
use crate::gpu::view::SplatView;
use std::ops::Range;

/// Blocks that follow each other and lie in one chunk.
pub struct BlockRange {
    /// The chunk.
    pub chunk: usize,
    /// Index of the first block.
    pub first: usize,
    /// Number of blocks.
    pub blocks: usize,
}

impl BlockRange {
    /// Where its blocks lie in the buffer of blocks: offset and length, bytes.
    pub fn bytes(&self) -> (u64, u64) {
        let bytes = |blocks: usize| (blocks * size_of::<Block>()) as u64;
        (bytes(self.first), bytes(self.blocks))
    }
}

/// Particles that are handled at a time.
#[derive(Default)]
pub struct DrawBatch {
    /// Their blocks.
    pub ranges: Vec<BlockRange>,
    /// Their number.
    pub particles: u32,
}

/// The nodes in a picture, and the blocks of each batch and chunk.
#[derive(Default)]
pub struct DrawList {
    /// The nodes.
    pub nodes: Vec<Node>,
    /// Blocks of a batch in a chunk follow each other and begin at a multiple of [`ALIGNMENT`] bytes.
    pub blocks: Vec<Block>,
    /// The batches, in order; one at least.
    pub batches: Vec<DrawBatch>,
}

impl DrawList {
    /// Lists the nodes of a view in batches of at most `capacity` particles.
    pub fn new(view: &SplatView, arena: &Arena, capacity: u32) -> DrawList {
        let mut list = DrawList::default();
        // Parts by chunk, so that a batch binds each chunk once.
        let mut parts: Vec<(usize, u32, u32)> = Vec::new();
        for item in view.items.iter() {
            let Some(node) = arena.node(item.node) else { continue };
            let table = item.table.and_then(|table| arena.table(table));
            let packed = (node.encoding as u32) < 2;
            if packed && table.is_none_or(|(_, length)| length == 0) {
                continue;
            }
            let (table, table_length) = table.unwrap_or_default();
            for part in &node.parts {
                parts.push((part.chunk, list.nodes.len() as u32, part.count));
                list.nodes.push(Node {
                    origin: view.view.to_camera(node.min).as_vec3().to_array(),
                    step: node.step as f32,
                    positions: part.positions,
                    codes: part.codes,
                    table,
                    table_length,
                    encoding: node.encoding as u32,
                    weight_scale: item.weight_scale,
                    unused: [0; 2],
                });
            }
        }
        parts.sort_by_key(|&(chunk, node, _)| (chunk, node));

        let (mut ranges, mut splats) = (Vec::new(), 0);
        for (chunk, node, count) in parts {
            let mut first = 0;
            while first < count {
                if splats == capacity {
                    list.batches.push(DrawBatch { ranges: std::mem::take(&mut ranges), particles: splats });
                    splats = 0;
                }
                let size = BLOCK.min(count - first).min(capacity - splats);
                match ranges.last_mut() {
                    Some(BlockRange { chunk: last, blocks, .. }) if *last == chunk => *blocks += 1,
                    _ => {
                        let unit = ALIGNMENT as usize / size_of::<Block>();
                        let start = list.blocks.len().next_multiple_of(unit);
                        list.blocks.resize(start, Block { node: 0, first: 0, count: 0, splat: 0 });
                        ranges.push(BlockRange { chunk, first: start, blocks: 1 });
                    }
                }
                list.blocks.push(Block { node, first, count: size, splat: splats });
                first += size;
                splats += size;
            }
        }
        // One batch at least: it writes zeros where nothing is.
        if splats > 0 || list.batches.is_empty() {
            list.batches.push(DrawBatch { ranges, particles: splats });
        }
        list
    }

    /// For each block of a range the instances that stand for its particles: [`BLOCK`] numbers are kept for each block.
    pub fn instances(&self, range: &BlockRange) -> Vec<Range<u32>> {
        let blocks = &self.blocks[range.first..range.first + range.blocks];
        let firsts = (0..).step_by(BLOCK as usize);
        blocks.iter().zip(firsts).map(|(block, first)| first..first + block.count).collect()
    }
}
