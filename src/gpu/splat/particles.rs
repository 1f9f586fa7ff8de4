//! The particles of a picture, as passes of other crates bind them: group 0 of shaders that import `deepfield::particle`.

use super::draw_list::DrawList;
use super::layout::SplatUniform;
use super::prepare::Shared;
use super::resources::slice;
use crate::gpu::arena::Arena;
use bevy::render::render_resource::binding_types::{storage_buffer_read_only_sized, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, PipelineCache, ShaderStages,
};
use bevy::render::renderer::RenderDevice;
use std::num::NonZeroU64;

/// Blocks of particles that lie in one buffer.
pub struct ParticleBatch {
    /// Group 0.
    pub group: BindGroup,
    /// Workgroups along x and y: one for each block, which `deepfield::particle::block_of` finds.
    pub workgroups: (u32, u32),
    /// Number of its first block: batches follow each other, with some numbers left out in between.
    pub first: u32,
    /// Number of blocks.
    pub blocks: u32,
    /// The most particles that are drawn of it.
    pub particles: u32,
}

/// The layout of group 0 for compute passes.
pub fn particle_layout() -> BindGroupLayoutDescriptor {
    let view = uniform_buffer_sized(false, NonZeroU64::new(size_of::<SplatUniform>() as u64));
    let read = || storage_buffer_read_only_sized(false, None);
    let entries = (view, read(), read(), read(), read(), read());
    BindGroupLayoutDescriptor::new(
        "deepfield particles",
        &BindGroupLayoutEntries::sequential(ShaderStages::COMPUTE, entries),
    )
}

/// Workgroups along x and y for `count` of them: one dimension holds at most 65535.
pub fn workgroups(count: u32) -> (u32, u32) {
    const ROW: u32 = 32768;
    if count <= ROW { (count, 1) } else { (ROW, count.div_ceil(ROW)) }
}

/// Binds all particles of a picture.
pub(super) fn batches(
    shared: &Shared,
    list: &DrawList,
    arena: &Arena,
    cache: &PipelineCache,
    device: &RenderDevice,
) -> Vec<ParticleBatch> {
    let layout = cache.get_bind_group_layout(&particle_layout());
    let tables = arena.table_buffer().unwrap_or(&shared.nodes);
    let ranges = list.batches.iter().flat_map(|batch| &batch.ranges);
    let batch = ranges.map(|range| {
        let (offset, bytes) = range.bytes();
        let entries = BindGroupEntries::sequential((
            shared.uniform.as_entire_binding(),
            shared.nodes.as_entire_binding(),
            slice(&shared.blocks, offset, bytes),
            arena.chunk(range.chunk).as_entire_binding(),
            arena.chunk(range.chunk).as_entire_binding(),
            tables.as_entire_binding(),
        ));
        let group = device.create_bind_group("deepfield particles", &layout, &entries);
        let blocks = &list.blocks[range.first..range.first + range.blocks];
        ParticleBatch {
            group,
            workgroups: workgroups(range.blocks as u32),
            first: range.first as u32,
            blocks: range.blocks as u32,
            particles: blocks.iter().map(|block| block.count).sum(),
        }
    });
    batch.collect()
}
