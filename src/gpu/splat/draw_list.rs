//! What a picture draws: nodes, and their particles in blocks.
//!
//! The CPU's work grows with the nodes in the picture, and one block of 16 bytes for each [`BLOCK`] particles that are drawn
//! of them: a hundred million particles cost about a millisecond (`blocks_are_cheap` prints it).

use super::layout::{BLOCK, Block, Encoding, Node};
use super::resources::ALIGNMENT;
use crate::gpu::arena::Arena;
use crate::gpu::view::DrawItem;
use crate::mode::sample::Sample;
use glam::DVec3;
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
    /// Candidates: no more are drawn.
    pub particles: u32,
    /// Places of candidates and blocks.
    pub places: u32,
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
    /// Whether some are clusters.
    pub ellipsoids: bool,
}

impl DrawList {
    /// Lists nodes seen from a place at a time in batches of at most `capacity` candidates.
    pub fn new(seen: (DVec3, f64), items: &[DrawItem], arena: &Arena, capacity: u32) -> DrawList {
        let (mut list, parts) = DrawList::parts(seen, items, arena, 1);
        list.batches = list.cut(&parts, capacity);
        list
    }

    /// The resident ones of some nodes, and their parts in the order of their chunks, so that a batch binds each chunk once. One of
    /// `stride` particles is a candidate.
    pub fn parts(
        (eye, time): (DVec3, f64),
        items: &[DrawItem],
        arena: &Arena,
        stride: u32,
    ) -> (DrawList, Vec<PartToDraw>) {
        let mut list = DrawList::default();
        let mut parts: Vec<PartToDraw> = Vec::new();
        for (index, item) in items.iter().enumerate() {
            let Some(node) = arena.node(item.node) else { continue };
            let table = item.table.and_then(|table| arena.table(table));
            let packed = (node.encoding as u32) < 2;
            if packed && table.is_none_or(|(_, length)| length == 0) {
                continue;
            }
            let (table, table_length) = table.unwrap_or_default();
            let sampled = packed || node.passage.is_some();
            let (edge, u) = node.passage.map_or((0.0, 0.0), |passage| (passage.edge as f32, passage.place(time)));
            let mut first = 0;
            for part in &node.parts {
                let sample = if sampled { item.sample.from(first) } else { Sample::ALL };
                first += part.count;
                let candidates = match &node.candidates {
                    Some(of_limits) => of_limits.within(item.limit).min(part.count),
                    None => sample.candidates(part.count),
                };
                let candidates = candidates.div_ceil(stride);
                list.ellipsoids |= node.encoding == Encoding::Clusters;
                parts.push(PartToDraw { chunk: part.chunk, node: list.nodes.len() as u32, item: index, candidates });
                let (eye_steps, eye_rest) =
                    Node::eye(eye - item.offset, node.min, if packed { node.step } else { 0.0 });
                list.nodes.push(Node {
                    eye_steps,
                    eye_rest,
                    step: node.step as f32,
                    positions: part.positions,
                    codes: part.codes,
                    table,
                    table_length,
                    encoding: node.encoding as u32,
                    weight_scale: item.weight_scale,
                    count: part.count,
                    seed: if node.encoding == Encoding::Clusters { item.limit.into() } else { sample.seed },
                    scale: if sample.is_all() { 0.0 } else { sample.scale },
                    ranks: if sample.is_all() { 0 } else { sample.ranks },
                    even: sample.even.into(),
                    growth: sample.growth,
                    edge,
                    corner: (-node.min).as_vec3().to_array(),
                    u,
                });
            }
        }
        parts.sort_by_key(|part| (part.chunk, part.node));
        (list, parts)
    }

    /// Cuts parts, in the order of their chunks, into blocks and batches: one at least, that draws nothing.
    pub fn cut<'a>(&mut self, parts: impl IntoIterator<Item = &'a PartToDraw>, capacity: u32) -> Vec<DrawBatch> {
        let mut batches = Vec::new();
        let (mut ranges, mut particles, mut places) = (Vec::new(), 0, 0);
        for &PartToDraw { chunk, node, candidates, .. } in parts {
            let mut first = 0;
            while first < candidates {
                if particles == capacity {
                    batches.push(DrawBatch { ranges: std::mem::take(&mut ranges), particles, places });
                    (particles, places) = (0, 0);
                }
                let count = BLOCK.min(candidates - first).min(capacity - particles);
                match ranges.last_mut() {
                    Some(BlockRange { chunk: last, blocks, .. }) if *last == chunk => *blocks += 1,
                    _ => {
                        let unit = ALIGNMENT as usize / size_of::<Block>();
                        let start = self.blocks.len().next_multiple_of(unit);
                        self.blocks.resize(start, Block { node: 0, first: 0, count: 0, place: 0 });
                        ranges.push(BlockRange { chunk, first: start, blocks: 1 });
                    }
                }
                self.blocks.push(Block { node, first, count, place: places });
                first += count;
                particles += count;
                places += count + 1;
            }
        }
        // One batch at least: it writes zeros where nothing is.
        if particles > 0 || batches.is_empty() {
            batches.push(DrawBatch { ranges, particles, places });
        }
        batches
    }

    /// The instances that stand for a range's particles: [`BLOCK`] numbers are kept for each block. Full blocks that follow
    /// each other are one run.
    pub fn instances(&self, range: &BlockRange) -> Vec<Range<u32>> {
        let blocks = &self.blocks[range.first..range.first + range.blocks];
        let mut runs: Vec<Range<u32>> = Vec::new();
        for (block, first) in blocks.iter().zip((0..).step_by(BLOCK as usize)) {
            match runs.last_mut() {
                Some(run) if run.end == first => run.end += block.count,
                _ => runs.push(first..first + block.count),
            }
        }
        runs
    }
}

/// A part of a node, and how many of its particles are looked at.
pub struct PartToDraw {
    /// The chunk that it lies in.
    chunk: usize,
    /// Its entry in the list of nodes.
    node: u32,
    /// Which of the items it belongs to.
    pub item: usize,
    /// Particles that are looked at.
    candidates: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_hold_every_candidate_once() {
        let parts: Vec<PartToDraw> = [(0, 5000), (0, 1), (2, 1024)]
            .iter()
            .zip(0..)
            .map(|(&(chunk, candidates), node)| PartToDraw { chunk, node, item: 0, candidates })
            .collect();
        for capacity in [u32::MAX, 1000, 3000] {
            let mut list = DrawList::default();
            list.batches = list.cut(&parts, capacity);
            let mut seen = vec![0; 3];
            for batch in &list.batches {
                let (mut particles, mut place) = (0, 0);
                for range in &batch.ranges {
                    for block in &list.blocks[range.first..range.first + range.blocks] {
                        assert_eq!(
                            (block.first, block.place, parts[block.node as usize].chunk),
                            (seen[block.node as usize], place, range.chunk)
                        );
                        seen[block.node as usize] += block.count;
                        particles += block.count;
                        place += block.count + 1;
                    }
                    let instances: u32 = list.instances(range).iter().map(|run| run.end - run.start).sum();
                    let blocks = &list.blocks[range.first..range.first + range.blocks];
                    assert_eq!(instances, blocks.iter().map(|block| block.count).sum::<u32>());
                }
                assert_eq!((batch.particles, batch.places), (particles, place));
                assert!(particles <= capacity);
            }
            assert_eq!(seen, [5000, 1, 1024]);
        }
    }

    #[test]
    fn blocks_are_cheap() {
        // A hundred million particles in nodes of 8000.
        let parts: Vec<PartToDraw> =
            (0..12_500).map(|node| PartToDraw { chunk: 0, node, item: 0, candidates: 8000 }).collect();
        let start = std::time::Instant::now();
        let mut list = DrawList::default();
        list.batches = list.cut(&parts, 1 << 22);
        println!("{} blocks in {:?}", list.blocks.len(), start.elapsed());
        assert_eq!(list.blocks.iter().map(|block| u64::from(block.count)).sum::<u64>(), 100_000_000);
    }
}
