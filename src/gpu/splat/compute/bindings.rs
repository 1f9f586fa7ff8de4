//! Buffers and bind groups of the compute passes of one view.

use super::pipeline::ComputePipelines;
use crate::gpu::arena::Arena;
use crate::gpu::splat::draw_list::DrawList;
use crate::gpu::splat::layout::{Grids, MAX_LEVELS, PLACE_BYTES, Pass, SPLAT_BYTES};
use crate::gpu::splat::prepare::Shared;
use crate::gpu::splat::resources::{ALIGNMENT, at_least, slice};
use bevy::prelude::*;
use bevy::render::render_resource::{BindGroup, BindGroupEntries, Buffer, BufferUsages, PipelineCache};
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// Most splats that are sorted at a time.
pub const MAX_BATCH: u64 = 1 << 22;

/// Buffers that all views share, since their passes run one after the other.
#[derive(Resource, Default)]
pub struct Scratch {
    splats: Option<Buffer>,
    places: Option<Buffer>,
    starts: Option<Buffer>,
}

/// What the passes of one view bind.
pub struct ComputeBindings {
    /// For each batch, and each chunk of it: bindings of `count` and `place`, and the number of blocks.
    pub batches: Vec<Vec<(BindGroup, u32)>>,
    /// Bindings of `scan`.
    pub scan: BindGroup,
    /// Bindings of `accumulate`.
    pub accumulate: BindGroup,
    /// Bindings of `reconstruct`.
    pub reconstruct: BindGroup,
    /// Splat counts, then first places, of the bins; behind the last bin the number of splats.
    pub starts: Buffer,
    passes: Buffer,
}

impl ComputeBindings {
    /// Offset of a pass's parameters: `add` for further batches, or the coarser level of a reconstruction.
    pub fn pass_offset(add: bool, level: u32) -> u32 {
        (if add { 1 } else { level + 1 }) * ALIGNMENT as u32
    }
}

/// Binds what the passes of a view need.
pub fn bind(
    shared: &Shared,
    grids: &Grids,
    list: &DrawList,
    before: Option<&ComputeBindings>,
    scratch: &mut Scratch,
    arena: &Arena,
    pipelines: &ComputePipelines,
    cache: &PipelineCache,
    (device, queue): (&RenderDevice, &RenderQueue),
) -> ComputeBindings {
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let passes = before.map_or_else(
        || {
            let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
            let count = MAX_LEVELS as u64 + 1;
            let buffer = at_least(None, count * ALIGNMENT, usage, "deepfield splat passes", device);
            for index in 0..count as u32 {
                let pass = Pass { add: u32::from(index == 1), level: index.saturating_sub(1), source: [0; 2] };
                queue.write_buffer(&buffer, u64::from(index) * ALIGNMENT, bytemuck::bytes_of(&pass));
            }
            buffer
        },
        |before| before.passes.clone(),
    );
    let most = list.batches.iter().map(|batch| u64::from(batch.particles)).max().unwrap_or(0).max(1);
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

    let view = || shared.uniform.as_entire_binding();
    let tables = arena.table_buffer().unwrap_or(&shared.nodes);
    let batches = list.batches.iter().map(|batch| {
        let groups = batch.ranges.iter().map(|range| {
            let (offset, bytes) = range.bytes();
            let group = device.create_bind_group(
                "deepfield project",
                &cache.get_bind_group_layout(&pipelines.project_layout),
                &BindGroupEntries::sequential((
                    view(),
                    shared.nodes.as_entire_binding(),
                    slice(&shared.blocks, offset, bytes),
                    arena.chunk(range.chunk).as_entire_binding(),
                    arena.chunk(range.chunk).as_entire_binding(),
                    tables.as_entire_binding(),
                    places.as_entire_binding(),
                    starts.as_entire_binding(),
                    splats.as_entire_binding(),
                )),
            );
            (group, range.blocks as u32)
        });
        groups.collect()
    });
    let pass_size = size_of::<Pass>() as u64;
    ComputeBindings {
        batches: batches.collect(),
        scan: device.create_bind_group(
            "deepfield scan",
            &cache.get_bind_group_layout(&pipelines.scan_layout),
            &BindGroupEntries::sequential((view(), starts.as_entire_binding())),
        ),
        accumulate: device.create_bind_group(
            "deepfield accumulate",
            &cache.get_bind_group_layout(&pipelines.accumulate_layout),
            &BindGroupEntries::sequential((
                view(),
                slice(&passes, 0, pass_size),
                splats.as_entire_binding(),
                starts.as_entire_binding(),
                shared.cells.as_entire_binding(),
            )),
        ),
        reconstruct: device.create_bind_group(
            "deepfield reconstruct",
            &cache.get_bind_group_layout(&pipelines.reconstruct_layout),
            &BindGroupEntries::sequential((view(), slice(&passes, 0, pass_size), shared.cells.as_entire_binding())),
        ),
        starts,
        passes,
    }
}
