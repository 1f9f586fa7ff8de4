//! Layouts and pipelines of the compute passes.

use super::sums::SumPipelines;
use crate::gpu::shaders;
use crate::gpu::splat::layout::SplatUniform;
use bevy::asset::AssetServer;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntries, CachedComputePipelineId, ComputePipelineDescriptor,
    PipelineCache, ShaderStages,
};
use bevy::shader::Shader;
use std::num::NonZeroU64;

/// Layouts and pipelines.
pub struct ComputePipelines {
    /// Bindings of `count` and `place`.
    pub project_layout: BindGroupLayoutDescriptor,
    /// Bindings of `scan`.
    pub scan_layout: BindGroupLayoutDescriptor,
    /// One workgroup a block.
    pub count: CachedComputePipelineId,
    /// One workgroup.
    pub scan: CachedComputePipelineId,
    /// One workgroup a block.
    pub place: CachedComputePipelineId,
    /// What follows.
    pub sums: SumPipelines,
}

/// Creates layouts, and pipelines for all that every picture needs.
pub fn create(server: &AssetServer, cache: &PipelineCache, vector_subgroups: bool) -> ComputePipelines {
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let view = || uniform_buffer_sized(false, NonZeroU64::new(size_of::<SplatUniform>() as u64));
    let compute = ShaderStages::COMPUTE;

    let project_layout = BindGroupLayoutDescriptor::new(
        "deepfield project",
        &BindGroupLayoutEntries::sequential(
            compute,
            (view(), read(), read(), read(), read(), read(), write(), write(), write()),
        ),
    );
    let scan_layout = BindGroupLayoutDescriptor::new(
        "deepfield scan",
        &BindGroupLayoutEntries::sequential(compute, (view(), write())),
    );
    let project = shaders::load(server, "splat/project.wgsl");
    let scan = shaders::load(server, "splat/scan.wgsl");
    ComputePipelines {
        count: queue(cache, "deepfield count", &project_layout, &project, "count"),
        scan: queue(cache, "deepfield scan", &scan_layout, &scan, "main"),
        place: queue(cache, "deepfield place", &project_layout, &project, "place"),
        sums: SumPipelines::new(server, cache, vector_subgroups, None),
        project_layout,
        scan_layout,
    }
}

fn queue(
    cache: &PipelineCache,
    label: &'static str,
    layout: &BindGroupLayoutDescriptor,
    shader: &Handle<Shader>,
    entry: &'static str,
) -> CachedComputePipelineId {
    cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: Some(label.into()),
        layout: vec![layout.clone()],
        shader: shader.clone(),
        entry_point: Some(entry.into()),
        ..default()
    })
}
