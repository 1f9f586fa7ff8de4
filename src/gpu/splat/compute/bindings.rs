//! Buffers and bind groups of the compute passes of one view.

use super::pipeline::ComputePipelines;
use super::sums::{SumScratch, Summed, Sums};
use crate::gpu::arena::Arena;
use crate::gpu::splat::draw_list::{DrawBatch, DrawList};
use crate::gpu::splat::layout::{Grids, PLACE_BYTES, SPLAT_BYTES};
use crate::gpu::splat::prepare::Shared;
use crate::gpu::splat::resources::{at_least, slice};
use bevy::prelude::*;
use bevy::render::render_resource::{BindGroup, BindGroupEntries, Buffer, BufferUsages, PipelineCache};
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// Most splats that are sorted at a time; `PLACE_BITS` in project.wgsl.
pub const MAX_BATCH: u64 = 1 << 22;

/// Buffers that all views share, since their passes run one after the other.
#[derive(Resource, Default)]
pub struct Scratch {
    splats: Option<Buffer>,
    places: Option<Buffer>,
    starts: Option<Buffer>,
    sums: SumScratch,
}

/// What the passes of one view bind.
pub struct ComputeBindings {
    /// For each batch, and each chunk of it: bindings of `count` and `place`, and the number of blocks.
    pub batches: Vec<Vec<(BindGroup, u32)>>,
    /// Bindings of `scan`.
    pub scan: BindGroup,
    /// Splat counts, then first places, of the bins; behind the last bin the number of splats.
    pub starts: Buffer,
    /// What follows.
    pub sums: Sums,
}

/// Binds what the passes of a view need.
pub fn bind(
    shared: &Shared,
    grids: &Grids,
    list: &DrawList,
    scratch: &mut Scratch,
    arena: &Arena,
    pipelines: &ComputePipelines,
    cache: &PipelineCache,
    (device, queue): (&RenderDevice, &RenderQueue),
) -> ComputeBindings {
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    let most_of = |number: fn(&DrawBatch) -> u32| list.batches.iter().map(number).max().unwrap_or(0).max(1);
    let most = u64::from(most_of(|batch| batch.particles));
    let most_places = u64::from(most_of(|batch| batch.places));
    let mut scratch_buffer = |slot: fn(&mut Scratch) -> &mut Option<Buffer>, bytes, usage, label| {
        let slot = slot(scratch);
        let buffer = at_least(slot.take(), bytes, usage, label, device);
        *slot = Some(buffer.clone());
        buffer
    };
    let splats = scratch_buffer(|s| &mut s.splats, most * SPLAT_BYTES, storage, "deepfield splats");
    let places = scratch_buffer(|s| &mut s.places, most_places * PLACE_BYTES, storage, "deepfield splat places");
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
    let summed = Summed {
        view: &shared.uniform,
        grids,
        splats: &splats,
        most,
        starts: &starts,
        cells: &shared.cells,
        layers: 1,
    };
    let batches = batches.collect();
    let sums = Sums::new(&summed, &mut scratch.sums, &pipelines.sums, cache, (device, queue));
    ComputeBindings {
        batches,
        scan: device.create_bind_group(
            "deepfield scan",
            &cache.get_bind_group_layout(&pipelines.scan_layout),
            &BindGroupEntries::sequential((view(), starts.as_entire_binding())),
        ),
        starts,
        sums,
    }
}
