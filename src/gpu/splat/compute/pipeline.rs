//! Layouts and pipelines of the compute passes.

use super::sums::SumPipelines;
use crate::gpu::shaders;
use crate::gpu::splat::layout::{Shape, SplatUniform};
use bevy::asset::AssetServer;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntries, CachedComputePipelineId, ComputePipelineDescriptor,
    PipelineCache, ShaderStages,
};
use bevy::shader::{Shader, ShaderDefVal};
use std::num::NonZeroU64;

/// Layouts and pipelines.
pub struct ComputePipelines {
    /// Bindings of `count` and `place`.
    pub project_layout: BindGroupLayoutDescriptor,
    /// Bindings of `scan`.
    pub scan_layout: BindGroupLayoutDescriptor,
    /// One workgroup.
    pub scan: CachedComputePipelineId,
    /// What follows.
    pub sums: SumPipelines,
    project_shader: Handle<Shader>,
    /// `count` and `place`, one workgroup a block each, without ellipsoids and with such.
    project: HashMap<bool, [CachedComputePipelineId; 2]>,
}

/// Shader definitions of the passes that project.
pub fn project_defs(ellipsoids: bool) -> Vec<ShaderDefVal> {
    ellipsoids.then(|| "ELLIPSOIDS".into()).into_iter().collect()
}

impl ComputePipelines {
    /// Has the pipelines for what splats look like compiled.
    pub fn ask_for(&mut self, shape: Shape, cache: &PipelineCache) {
        self.sums.ask_for(shape, cache);
        let of = |entry, label| {
            let defs = project_defs(shape.ellipsoids);
            queue(cache, label, &self.project_layout, (&self.project_shader, entry), defs)
        };
        self.project
            .entry(shape.ellipsoids)
            .or_insert_with(|| [of("count", "deepfield count"), of("place", "deepfield place")]);
    }

    /// Those of `count` and `place`, if they have been asked for.
    pub fn project(&self, shape: Shape) -> Option<[CachedComputePipelineId; 2]> {
        self.project.get(&shape.ellipsoids).copied()
    }
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
    let scan = shaders::load(server, "splat/scan.wgsl");
    ComputePipelines {
        scan: queue(cache, "deepfield scan", &scan_layout, (&scan, "main"), vec![]),
        project_shader: shaders::load(server, "splat/project.wgsl"),
        project: HashMap::default(),
        sums: SumPipelines::new(server, cache, vector_subgroups, None),
        project_layout,
        scan_layout,
    }
}

fn queue(
    cache: &PipelineCache,
    label: &'static str,
    layout: &BindGroupLayoutDescriptor,
    (shader, entry): (&Handle<Shader>, &'static str),
    shader_defs: Vec<ShaderDefVal>,
) -> CachedComputePipelineId {
    cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: Some(label.into()),
        layout: vec![layout.clone()],
        shader: shader.clone(),
        entry_point: Some(entry.into()),
        shader_defs,
        ..default()
    })
}
