//! Prepares a view's splat passes: grids, the list of nodes and particle blocks, buffers, bind groups.
//!
//! The CPU's work grows with the nodes in the picture (and one block for each [`BLOCK`] particles), not with particles.
//! A picture whose camera, nodes and arena are what they were is not accumulated again.

use super::layout::{Block, Grids, Node, PLACE_BYTES, Pass, SPLAT_BYTES};
use super::pipeline::SplatPipelines;
use crate::gpu::arena::Arena;
use crate::gpu::view::{DrawItem, Footprint, SplatView};
use crate::view::View;
use bevy::prelude::*;
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindingResource, Buffer, BufferBinding, BufferDescriptor, BufferUsages, PipelineCache,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Particles that one workgroup projects.
const BLOCK: u32 = 1024;
/// Most splats that are sorted at a time.
const MAX_BATCH: u64 = 1 << 22;
/// Storage and uniform bindings may begin at multiples of this.
const ALIGNMENT: u64 = 256;

/// Buffers that all views share, since their passes run one after the other.
#[derive(Resource, Default)]
pub struct Scratch {
    splats: Option<Buffer>,
    places: Option<Buffer>,
    starts: Option<Buffer>,
}

/// The splats that are sorted at a time.
pub struct Batch {
    /// For each chunk: bindings and number of blocks.
    pub project: Vec<(BindGroup, u32)>,
}

/// What the passes of one view need; on the render world's camera.
#[derive(Component)]
pub struct SplatBuffers {
    /// The grids in use.
    pub grids: Grids,
    /// The pyramid: `P` and `P S` of every cell, the picture's pixels first.
    pub cells: Buffer,
    /// Splat counts, then first places, of the bins.
    pub starts: Buffer,
    /// The batches, in order.
    pub batches: Vec<Batch>,
    /// Bindings of `scan`.
    pub scan: BindGroup,
    /// Bindings of `accumulate`.
    pub accumulate: BindGroup,
    /// Bindings of `reconstruct`.
    pub reconstruct: BindGroup,
    /// Whether every frame accumulates.
    pub always: bool,
    /// Set once the cells hold the picture.
    pub accumulated: AtomicBool,
    uniform: Buffer,
    passes: Buffer,
    nodes: Buffer,
    blocks: Buffer,
    key: Key,
}

impl SplatBuffers {
    /// Offset of a pass's parameters: `add` for further batches, or the coarser level of a reconstruction.
    pub fn pass_offset(add: bool, level: u32) -> u32 {
        (if add { 1 } else { level + 1 }) * ALIGNMENT as u32
    }
}

#[derive(Clone, PartialEq)]
struct Key {
    view: View,
    footprint: Footprint,
    items: Arc<[DrawItem]>,
    generation: u64,
}

/// A buffer of at least `bytes`, kept from before if that is large enough.
fn at_least(
    existing: Option<Buffer>,
    bytes: u64,
    usage: BufferUsages,
    label: &'static str,
    device: &RenderDevice,
) -> Buffer {
    match existing {
        Some(buffer) if buffer.size() >= bytes => buffer,
        _ => device.create_buffer(&BufferDescriptor {
            label: Some(label),
            // Some room to grow, so that a moving camera does not allocate in every frame.
            size: (bytes + bytes / 4).next_multiple_of(ALIGNMENT),
            usage,
            mapped_at_creation: false,
        }),
    }
}

fn slice(buffer: &Buffer, offset: u64, size: u64) -> BindingResource<'_> {
    BindingResource::Buffer(BufferBinding { buffer, offset, size: NonZeroU64::new(size) })
}

/// The nodes in a picture, and the blocks of each batch and chunk.
#[derive(Default)]
struct DrawList {
    nodes: Vec<Node>,
    /// Blocks of a batch in a chunk follow each other and begin at a multiple of [`ALIGNMENT`] bytes.
    blocks: Vec<Block>,
    /// For each batch: its ranges of blocks (chunk, first block, blocks), and its splats.
    batches: Vec<(Vec<(usize, usize, usize)>, u32)>,
}

impl DrawList {
    fn new(view: &SplatView, arena: &Arena, capacity: u32) -> DrawList {
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
                    list.batches.push((std::mem::take(&mut ranges), splats));
                    splats = 0;
                }
                let size = BLOCK.min(count - first).min(capacity - splats);
                match ranges.last_mut() {
                    Some((last, _, blocks)) if *last == chunk => *blocks += 1,
                    _ => {
                        let unit = ALIGNMENT as usize / size_of::<Block>();
                        let start = list.blocks.len().next_multiple_of(unit);
                        list.blocks.resize(start, Block { node: 0, first: 0, count: 0, splat: 0 });
                        ranges.push((chunk, start, 1));
                    }
                }
                list.blocks.push(Block { node, first, count: size, splat: splats });
                first += size;
                splats += size;
            }
        }
        // One batch at least: it writes zeros where nothing is.
        if splats > 0 || list.batches.is_empty() {
            list.batches.push((ranges, splats));
        }
        list
    }
}

/// Prepares every camera that draws particles.
pub fn prepare_splats(
    mut commands: Commands,
    mut cameras: Query<(Entity, &SplatView, Option<&mut SplatBuffers>)>,
    arena: Res<Arena>,
    mut scratch: ResMut<Scratch>,
    pipelines: Option<ResMut<SplatPipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let Some(mut pipelines) = pipelines else { return };
    for (entity, view, mut before) in &mut cameras {
        let key =
            Key { view: view.view, footprint: view.footprint, items: view.items.clone(), generation: arena.generation };
        if let Some(before) = &mut before
            && before.key.generation == key.generation
            && before.key.view == key.view
            && before.key.footprint == key.footprint
            && Arc::ptr_eq(&before.key.items, &key.items)
        {
            before.always = view.always;
            continue;
        }
        let buffers =
            build(key, view, before.as_deref(), &arena, &mut scratch, &mut pipelines, &cache, (&device, &queue));
        match before {
            Some(mut before) => *before = buffers,
            None => {
                commands.entity(entity).insert(buffers);
            }
        }
    }
}

fn build(
    key: Key,
    view: &SplatView,
    before: Option<&SplatBuffers>,
    arena: &Arena,
    scratch: &mut Scratch,
    pipelines: &mut SplatPipelines,
    cache: &PipelineCache,
    (device, queue): (&RenderDevice, &RenderQueue),
) -> SplatBuffers {
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let uniforms = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
    let grids = Grids::new(&view.view, view.footprint);
    pipelines.ask_for(grids.kernel, grids.uniform.perspective != 0, cache);
    let limit = device.limits().max_storage_buffer_binding_size;
    let capacity = MAX_BATCH.min(limit / (SPLAT_BYTES + SPLAT_BYTES / 4)).max(1) as u32;
    let list = DrawList::new(view, arena, capacity);
    let most = list.batches.iter().map(|&(_, splats)| splats).max().unwrap_or(0).max(1);

    let kept = |buffer: fn(&SplatBuffers) -> &Buffer| before.map(|before| buffer(before).clone());
    let uniform =
        at_least(kept(|b| &b.uniform), size_of_val(&grids.uniform) as u64, uniforms, "deepfield splat view", device);
    queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&grids.uniform));
    let passes = kept(|b| &b.passes).unwrap_or_else(|| {
        let count = super::layout::MAX_LEVELS as u64 + 1;
        let buffer = at_least(None, count * ALIGNMENT, uniforms, "deepfield splat passes", device);
        for index in 0..count as u32 {
            let pass = Pass { add: u32::from(index == 1), level: index.saturating_sub(1), unused: [0; 2] };
            queue.write_buffer(&buffer, u64::from(index) * ALIGNMENT, bytemuck::bytes_of(&pass));
        }
        buffer
    });
    let node_bytes: &[u8] = bytemuck::cast_slice(&list.nodes);
    let nodes = at_least(kept(|b| &b.nodes), node_bytes.len().max(64) as u64, storage, "deepfield drawn nodes", device);
    queue.write_buffer(&nodes, 0, node_bytes);
    let block_bytes: &[u8] = bytemuck::cast_slice(&list.blocks);
    let blocks =
        at_least(kept(|b| &b.blocks), block_bytes.len().max(16) as u64, storage, "deepfield drawn blocks", device);
    queue.write_buffer(&blocks, 0, block_bytes);
    let cells = at_least(
        kept(|b| &b.cells),
        u64::from(grids.cells) * 8,
        storage | BufferUsages::COPY_SRC,
        "deepfield picture",
        device,
    );

    let most = u64::from(most);
    let mut scratch_buffer = |slot: fn(&mut Scratch) -> &mut Option<Buffer>, bytes, usage, label| {
        let slot = slot(scratch);
        let buffer = at_least(slot.take(), bytes, usage, label, device);
        *slot = Some(buffer.clone());
        buffer
    };
    let splats = scratch_buffer(|s| &mut s.splats, most * SPLAT_BYTES, storage, "deepfield splats");
    let places = scratch_buffer(|s| &mut s.places, most * PLACE_BYTES, storage, "deepfield splat places");
    let starts_bytes = u64::from(grids.uniform.bin_count + 1) * 4;
    let starts =
        scratch_buffer(|s| &mut s.starts, starts_bytes, storage | BufferUsages::COPY_SRC, "deepfield splat bins");

    let view_binding = || uniform.as_entire_binding();
    let tables = arena.table_buffer().unwrap_or(&nodes);
    let batches = list
        .batches
        .iter()
        .map(|(ranges, _)| Batch {
            project: ranges
                .iter()
                .map(|&(chunk, first, count)| {
                    let bytes = |blocks: usize| (blocks * size_of::<Block>()) as u64;
                    let group = device.create_bind_group(
                        "deepfield project",
                        &cache.get_bind_group_layout(&pipelines.project_layout),
                        &BindGroupEntries::sequential((
                            view_binding(),
                            nodes.as_entire_binding(),
                            slice(&blocks, bytes(first), bytes(count)),
                            arena.chunk(chunk).as_entire_binding(),
                            tables.as_entire_binding(),
                            places.as_entire_binding(),
                            starts.as_entire_binding(),
                            splats.as_entire_binding(),
                        )),
                    );
                    (group, count as u32)
                })
                .collect(),
        })
        .collect();
    let scan = device.create_bind_group(
        "deepfield scan",
        &cache.get_bind_group_layout(&pipelines.scan_layout),
        &BindGroupEntries::sequential((view_binding(), starts.as_entire_binding())),
    );
    let pass_size = size_of::<Pass>() as u64;
    let accumulate = device.create_bind_group(
        "deepfield accumulate",
        &cache.get_bind_group_layout(&pipelines.accumulate_layout),
        &BindGroupEntries::sequential((
            view_binding(),
            slice(&passes, 0, pass_size),
            splats.as_entire_binding(),
            starts.as_entire_binding(),
            cells.as_entire_binding(),
        )),
    );
    let reconstruct = device.create_bind_group(
        "deepfield reconstruct",
        &cache.get_bind_group_layout(&pipelines.reconstruct_layout),
        &BindGroupEntries::sequential((view_binding(), slice(&passes, 0, pass_size), cells.as_entire_binding())),
    );
    SplatBuffers {
        grids,
        cells,
        starts,
        batches,
        scan,
        accumulate,
        reconstruct,
        always: view.always,
        accumulated: AtomicBool::new(false),
        uniform,
        passes,
        nodes,
        blocks,
        key,
    }
}
