//! Buffers and bind groups of the compute passes of one view.

use super::pipeline::ComputePipelines;
use crate::gpu::arena::Arena;
use crate::gpu::splat::draw_list::{DrawBatch, DrawList};
use crate::gpu::splat::layout::{Grids, MAX_LEVELS, PATCH_BYTES, PLACE_BYTES, Pass, SPLAT_BYTES};
use crate::gpu::splat::prepare::Shared;
use crate::gpu::splat::resources::{ALIGNMENT, at_least, slice};
use bevy::prelude::*;
use bevy::render::render_resource::{BindGroup, BindGroupEntries, Buffer, BufferUsages, PipelineCache};
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// Most splats that are sorted at a time; `PLACE_BITS` in project.wgsl.
pub const MAX_BATCH: u64 = 1 << 22;

/// Bytes for each tile: its first further slice and their number.
const TILE_SLICES_BYTES: u64 = 8;

/// Buffers that all views share, since their passes run one after the other.
#[derive(Resource, Default)]
pub struct Scratch {
    splats: Option<Buffer>,
    places: Option<Buffer>,
    slices: Option<Buffer>,
    tile_slices: Option<Buffer>,
    slice_count: Option<Buffer>,
    dispatch: Option<Buffer>,
    patches: Option<Buffer>,
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
    /// Bindings of `finish` and `merge`.
    pub slices: BindGroup,
    /// Bindings of `reconstruct`.
    pub reconstruct: BindGroup,
    /// Splat counts, then first places, of the bins; behind the last bin the number of splats.
    pub starts: Buffer,
    /// Number of further slices of crowded tiles.
    pub slice_count: Buffer,
    /// Workgroups that sum them.
    pub dispatch: Buffer,
    passes: Buffer,
}

impl ComputeBindings {
    /// Offset of the parameters of `accumulate`: whether it adds, and whether it sums further slices.
    pub fn sum(add: bool, further: bool) -> u32 {
        (u32::from(add) + 2 * u32::from(further)) * ALIGNMENT as u32
    }

    /// Offset of the parameters of `reconstruct` for a coarser level.
    pub fn reconstruction(level: u32) -> u32 {
        (level + 4) * ALIGNMENT as u32
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
            let bytes = u64::from(ComputeBindings::reconstruction(MAX_LEVELS as u32));
            let buffer = at_least(None, bytes, usage, "deepfield splat passes", device);
            let write = |offset: u32, pass: Pass| {
                queue.write_buffer(&buffer, offset.into(), bytemuck::bytes_of(&pass));
            };
            for (add, further) in [(false, false), (true, false), (false, true)] {
                let pass = Pass { add: add.into(), further: further.into(), ..Pass::default() };
                write(ComputeBindings::sum(add, further), pass);
            }
            for level in 0..MAX_LEVELS as u32 {
                write(ComputeBindings::reconstruction(level), Pass { level, ..Pass::default() });
            }
            buffer
        },
        |before| before.passes.clone(),
    );
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
    let most_slices = grids.most_slices(most);
    let slices = scratch_buffer(|s| &mut s.slices, most_slices * 8, storage, "deepfield slices");
    let patches = scratch_buffer(|s| &mut s.patches, most_slices * PATCH_BYTES, storage, "deepfield patches");
    let tile_slices = scratch_buffer(
        |s| &mut s.tile_slices,
        u64::from(grids.tiles) * TILE_SLICES_BYTES,
        storage,
        "deepfield slices of tiles",
    );
    let slice_count = scratch_buffer(|s| &mut s.slice_count, 4, storage, "deepfield number of slices");
    let indirect = storage | BufferUsages::INDIRECT;
    let dispatch = scratch_buffer(|s| &mut s.dispatch, 12, indirect, "deepfield dispatch of slices");
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
    // As long as there are tiles: `merge` asks for it.
    let tiles = || slice(&tile_slices, 0, u64::from(grids.tiles) * TILE_SLICES_BYTES);
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
                slices.as_entire_binding(),
                tiles(),
                slice_count.as_entire_binding(),
                patches.as_entire_binding(),
            )),
        ),
        slices: device.create_bind_group(
            "deepfield slices",
            &cache.get_bind_group_layout(&pipelines.slices_layout),
            &BindGroupEntries::sequential((
                view(),
                slice_count.as_entire_binding(),
                dispatch.as_entire_binding(),
                tiles(),
                patches.as_entire_binding(),
                shared.cells.as_entire_binding(),
            )),
        ),
        reconstruct: device.create_bind_group(
            "deepfield reconstruct",
            &cache.get_bind_group_layout(&pipelines.reconstruct_layout),
            &BindGroupEntries::sequential((view(), slice(&passes, 0, pass_size), shared.cells.as_entire_binding())),
        ),
        starts,
        slice_count,
        dispatch,
        passes,
    }
}
