//! GPU memory for particles: storage buffers that nodes are sub-allocated from, and the attribute tables.
//!
//! Buffers (chunks) are as large as the adapter lets a shader bind, so there may be several. A node is cut into parts
//! of at most [`PART_BYTES`]; each part lies in one chunk. Uploads are limited per frame; a node that finds no room
//! within the byte budget is rejected, and the main world decides what to remove.

use super::clusters::{Candidates, GpuCluster};
use super::moving::{MovingParticle, Passage};
use super::scene::{
    CLUSTER_WORDS, MOVING_WORDS, NodeId, NodeState, ParticleScene, Payload, RAW_WORDS, RawParticle, SceneCommand,
    Table, TableEntry, TableId, Words,
};
use super::splat::layout::Encoding;
use crate::mode::sample::GROUP;
use bevy::prelude::*;
use bevy::render::render_resource::{Buffer, BufferDescriptor, BufferUsages};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use glam::DVec3;
use offset_allocator::{Allocation, Allocator};
use std::collections::HashMap;

/// Most bytes of particles in one part of a node.
const PART_BYTES: usize = 8 << 20;
/// Allocations are multiples of this many bytes.
const GRANULE: u64 = 16;
/// Numbers of chunks that are lent begin here.
const LENT: usize = 1 << 24;

/// Particles of one node in one chunk.
pub struct Part {
    /// Which chunk.
    pub chunk: usize,
    /// First word of positions or raw particles.
    pub positions: u32,
    /// First word of the codes.
    pub codes: u32,
    /// Number of particles.
    pub count: u32,
    /// Without one the chunk is a buffer that is lent.
    allocation: Option<Allocation>,
    bytes: u64,
}

/// A node on the GPU.
pub struct ResidentNode {
    /// Lowest corner, world units.
    pub min: DVec3,
    /// World units per step of a packed coordinate; 0 for raw particles.
    pub step: f64,
    /// How its particles are packed.
    pub encoding: Encoding,
    /// Where they lie.
    pub parts: Vec<Part>,
    /// When they are where, if they move.
    pub passage: Option<Passage>,
    /// How many of its clusters are looked at, if it holds some.
    pub candidates: Option<Candidates>,
}

struct Chunk {
    buffer: Buffer,
    allocator: Allocator,
}

/// The particles and tables on the GPU (render world).
#[derive(Resource, Default)]
pub struct Arena {
    chunks: Vec<Chunk>,
    chunk_bytes: u64,
    /// Buffers of others that nodes lie in, by the number of their chunk.
    lent: HashMap<usize, Buffer>,
    /// How many have been lent so far.
    lent_count: usize,
    nodes: HashMap<NodeId, ResidentNode>,
    tables: HashMap<TableId, Table>,
    table_ranges: HashMap<TableId, (u32, u32)>,
    table_buffer: Option<Buffer>,
    /// Counts changes, so that a picture knows whether it still holds.
    pub generation: u64,
}

impl Arena {
    /// A resident node.
    pub fn node(&self, id: NodeId) -> Option<&ResidentNode> {
        self.nodes.get(&id)
    }

    /// First entry and number of entries of a table.
    pub fn table(&self, id: TableId) -> Option<(u32, u32)> {
        self.table_ranges.get(&id).copied()
    }

    /// The buffer that holds all tables.
    pub fn table_buffer(&self) -> Option<&Buffer> {
        self.table_buffer.as_ref()
    }

    /// The buffer of a chunk; parts of resident nodes only name chunks that exist.
    pub fn chunk(&self, index: usize) -> &Buffer {
        if index < LENT { &self.chunks[index].buffer } else { &self.lent[&index] }
    }

    fn free(&mut self, id: NodeId) -> u64 {
        let Some(node) = self.nodes.remove(&id) else { return 0 };
        node.parts
            .into_iter()
            .map(|part| {
                match part.allocation {
                    Some(allocation) => self.chunks[part.chunk].allocator.free(allocation),
                    None => drop(self.lent.remove(&part.chunk)),
                }
                part.bytes
            })
            .sum()
    }

    /// Room for `bytes` in some chunk, a new one if the budget allows.
    fn allocate(&mut self, bytes: u64, budget: u64, device: &RenderDevice) -> Option<(usize, Allocation)> {
        let granules = u32::try_from(bytes.div_ceil(GRANULE)).ok()?;
        for (index, chunk) in self.chunks.iter_mut().enumerate() {
            if let Some(allocation) = chunk.allocator.allocate(granules) {
                return Some((index, allocation));
            }
        }
        let used = self.chunks.len() as u64 * self.chunk_bytes;
        let size = self.chunk_bytes.min(budget.saturating_sub(used)) / GRANULE * GRANULE;
        if size < bytes {
            return None;
        }
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some("deepfield particles"),
            size,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut allocator = Allocator::new(u32::try_from(size / GRANULE).ok()?);
        let allocation = allocator.allocate(granules)?;
        self.chunks.push(Chunk { buffer, allocator });
        Some((self.chunks.len() - 1, allocation))
    }

    /// Uploads a node; returns its bytes, or `None` (and nothing kept) when there is no room.
    fn insert(
        &mut self,
        id: NodeId,
        (min, size): (DVec3, f64),
        payload: &Payload,
        budget: u64,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<u64> {
        let (made, clusters): (Vec<MovingParticle>, Vec<GpuCluster>);
        let (mut passage, mut candidates) = (None, None);
        let (encoding, words, codes, stride) = match payload.words() {
            Words::Lent(buffer, count) => return self.adopt(id, min, buffer, count, device),
            Words::Grid(words, codes) => (Encoding::Grid, words, codes, 1),
            Words::Leaf(words, codes) => (Encoding::Leaf, words, codes, 2),
            Words::World(words) => (Encoding::World, words, &[][..], RAW_WORDS),
            Words::Camera(words) => (Encoding::Camera, words, &[][..], RAW_WORDS),
            Words::Moving(node) => {
                let (all, when) = node.particles(min).unzip();
                made = all.unwrap_or_default();
                passage = when;
                (Encoding::Moving, bytemuck::cast_slice(&made), &[][..], MOVING_WORDS)
            }
            Words::Ellipsoids(words) => (Encoding::Clusters, words, &[][..], CLUSTER_WORDS),
            Words::Clusters(node) => {
                let (all, of_limits) = node.clusters(min).unzip();
                clusters = all.unwrap_or_default();
                candidates = of_limits;
                (Encoding::Clusters, bytemuck::cast_slice(&clusters), &[][..], CLUSTER_WORDS)
            }
        };
        let step = match encoding {
            Encoding::Grid => size / 1024.0,
            Encoding::Leaf => size / f64::from(1 << 21),
            Encoding::World | Encoding::Camera | Encoding::Moving | Encoding::Clusters => 0.0,
        };
        let coded = !codes.is_empty();
        // Whole groups of particles, so that samples know them by their numbers in the part; two codes share a word.
        let group = GROUP as usize;
        let per_part = (PART_BYTES.min(self.chunk_bytes as usize / 2) / (4 * stride + 2) / group * group).max(group);
        let count = match encoding {
            // As many as there are for any limit, in one part.
            Encoding::Clusters => words.len() / stride,
            _ => payload.len().min(words.len() / stride),
        };
        let parts = Vec::with_capacity(count.div_ceil(per_part));
        let mut node = ResidentNode { min, step, encoding, parts, passage, candidates };
        let mut total = 0;
        let mut first = 0;
        while first < count {
            let last = count.min(first + per_part);
            let positions: &[u8] = bytemuck::cast_slice(&words[first * stride..last * stride]);
            let code_bytes = if coded { ((last - first) * 2).next_multiple_of(4) } else { 0 };
            let bytes = (positions.len() + code_bytes) as u64;
            let Some((chunk, allocation)) = self.allocate(bytes, budget, device) else {
                self.nodes.insert(id, node);
                self.free(id);
                return None;
            };
            let offset = u64::from(allocation.offset) * GRANULE;
            let buffer = &self.chunks[chunk].buffer;
            queue.write_buffer(buffer, offset, positions);
            if coded {
                let codes = &codes[first..last];
                let at = offset + positions.len() as u64;
                // Buffers are written in multiples of four bytes.
                let even = codes.len() & !1;
                queue.write_buffer(buffer, at, bytemuck::cast_slice(&codes[..even]));
                if let Some(&code) = codes.get(even) {
                    queue.write_buffer(buffer, at + 2 * even as u64, bytemuck::bytes_of(&[code, 0]));
                }
            }
            let positions_word = (offset / 4) as u32;
            node.parts.push(Part {
                chunk,
                positions: positions_word,
                codes: positions_word + (positions.len() / 4) as u32,
                count: (last - first) as u32,
                allocation: Some(allocation),
                bytes,
            });
            total += bytes;
            first = last;
        }
        self.nodes.insert(id, node);
        Some(total)
    }

    /// Takes a node of a buffer of somebody else's; `None` where shaders cannot read as much of it.
    fn adopt(&mut self, id: NodeId, min: DVec3, buffer: &Buffer, count: u32, device: &RenderDevice) -> Option<u64> {
        let limits = device.limits();
        let largest = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let needed = u64::from(count) * size_of::<RawParticle>() as u64;
        if needed > buffer.size() || buffer.size() > largest || !buffer.usage().contains(BufferUsages::STORAGE) {
            return None;
        }
        let chunk = LENT + self.lent_count;
        self.lent_count += 1;
        self.lent.insert(chunk, buffer.clone());
        let part = Part { chunk, positions: 0, codes: 0, count, allocation: None, bytes: 0 };
        let parts = vec![part];
        let node = ResidentNode { min, step: 0.0, encoding: Encoding::World, parts, passage: None, candidates: None };
        self.nodes.insert(id, node);
        Some(0)
    }

    fn rebuild_tables(&mut self, device: &RenderDevice, queue: &RenderQueue) {
        let mut ids: Vec<_> = self.tables.keys().copied().collect();
        ids.sort_unstable();
        let mut entries: Vec<TableEntry> = Vec::new();
        self.table_ranges.clear();
        for id in ids {
            let table = &self.tables[&id];
            self.table_ranges.insert(id, (entries.len() as u32, table.entries.len() as u32));
            entries.extend_from_slice(&table.entries);
            // Four densities in the place of an entry.
            entries.extend(table.densities.chunks(4).map(|four| {
                let at = |i: usize| four.get(i).copied().unwrap_or(0.0);
                TableEntry { smoothing_length: at(0), weight: at(1), attribute: at(2), importance: at(3) }
            }));
        }
        let bytes: &[u8] = bytemuck::cast_slice(&entries);
        if self.table_buffer.as_ref().is_none_or(|buffer| buffer.size() < bytes.len() as u64) {
            self.table_buffer = Some(device.create_buffer(&BufferDescriptor {
                label: Some("deepfield attribute tables"),
                size: (bytes.len() as u64).next_power_of_two().max(256),
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }));
        }
        if let Some(buffer) = &self.table_buffer
            && !bytes.is_empty()
        {
            queue.write_buffer(buffer, 0, bytes);
        }
    }
}

/// Carries out what the main world queued, within the frame's upload budget.
pub fn update_arena(
    scene: Res<ParticleScene>,
    mut arena: ResMut<Arena>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    if arena.chunk_bytes == 0 {
        let limits = device.limits();
        arena.chunk_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) / GRANULE * GRANULE;
    }
    let (budget, upload_limit) = {
        let state = scene.lock();
        (state.budget_bytes, state.upload_bytes_per_frame)
    };
    let mut uploaded = 0;
    let mut tables_changed = arena.table_buffer.is_none();
    loop {
        // One command at a time, so that the main world never waits for an upload.
        let mut state = scene.lock();
        if uploaded >= upload_limit && matches!(state.queue.front(), Some(SceneCommand::Insert(_))) {
            break;
        }
        let Some(command) = state.queue.pop_front() else { break };
        drop(state);
        match command {
            SceneCommand::Insert(node) => {
                let cell = (node.min, node.size);
                let bytes = arena.insert(node.id, cell, &node.payload, budget, &device, &queue);
                let mut state = scene.lock();
                // It may have been removed meanwhile; then the removal is queued behind.
                if let Some(entry) = state.nodes.get_mut(&node.id) {
                    *entry = if bytes.is_some() { NodeState::Resident } else { NodeState::Rejected };
                }
                state.resident_bytes += bytes.unwrap_or(0);
                uploaded += bytes.unwrap_or(0);
                arena.generation += 1;
            }
            SceneCommand::Remove(id) => {
                let bytes = arena.free(id);
                let mut state = scene.lock();
                state.resident_bytes = state.resident_bytes.saturating_sub(bytes);
                arena.generation += 1;
            }
            SceneCommand::InsertTable(id, table) => {
                arena.tables.insert(id, table);
                tables_changed = true;
            }
            SceneCommand::RemoveTable(id) => {
                arena.tables.remove(&id);
                tables_changed = true;
            }
        }
    }
    if tables_changed {
        arena.rebuild_tables(&device, &queue);
        arena.generation += 1;
    }
}
