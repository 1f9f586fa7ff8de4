//! Layouts and pipelines of the compute passes.

use crate::gpu::shaders;
use crate::gpu::splat::constants::kernel_defs;
use crate::gpu::splat::layout::{Pass, SplatUniform};
use crate::model::Kernel;
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

/// Tiles that one workgroup of the accumulate pass fills, where it is not one subgroup.
const TILES_PER_GROUP: u32 = 8;

/// Layouts and pipelines.
pub struct ComputePipelines {
    /// Bindings of `count` and `place`.
    pub project_layout: BindGroupLayoutDescriptor,
    /// Bindings of `scan`.
    pub scan_layout: BindGroupLayoutDescriptor,
    /// Bindings of `accumulate`.
    pub accumulate_layout: BindGroupLayoutDescriptor,
    /// Bindings of `finish` and `merge`.
    pub slices_layout: BindGroupLayoutDescriptor,
    /// Bindings of `reconstruct`.
    pub reconstruct_layout: BindGroupLayoutDescriptor,
    /// One workgroup a block.
    pub count: CachedComputePipelineId,
    /// One workgroup.
    pub scan: CachedComputePipelineId,
    /// One workgroup a block.
    pub place: CachedComputePipelineId,
    /// See [`ComputePipelines::accumulate`].
    accumulate: HashMap<(Kernel, bool), CachedComputePipelineId>,
    accumulate_shader: Handle<Shader>,
    /// Tiles that a workgroup of `accumulate` fills.
    pub tiles_per_group: u32,
    /// One invocation.
    pub finish: CachedComputePipelineId,
    /// One workgroup for eight tiles.
    pub merge: CachedComputePipelineId,
    /// One workgroup for 8 x 8 times [`crate::gpu::splat::layout::RECONSTRUCTED`] finer cells.
    pub reconstruct: CachedComputePipelineId,
}

impl ComputePipelines {
    /// The pipeline of `accumulate` for a kernel and a projection, if it has been asked for: one workgroup for
    /// `tiles_per_group` tiles.
    pub fn accumulate(&self, kernel: Kernel, oblique: bool) -> Option<CachedComputePipelineId> {
        self.accumulate.get(&(kernel, oblique)).copied()
    }

    /// Has the pipeline of `accumulate` compiled for a kernel and a projection.
    pub fn ask_for(&mut self, kernel: Kernel, oblique: bool, cache: &PipelineCache) {
        let subgroup = self.tiles_per_group == 1;
        self.accumulate.entry((kernel, oblique)).or_insert_with(|| {
            queue(
                cache,
                "deepfield accumulate",
                &self.accumulate_layout,
                &self.accumulate_shader,
                "main",
                accumulate_defs(kernel, oblique, subgroup),
            )
        });
    }
}

/// Shader definitions of the accumulate pass.
pub fn accumulate_defs(kernel: Kernel, oblique: bool, subgroup: bool) -> Vec<ShaderDefVal> {
    let mut defs = kernel_defs(kernel);
    defs.extend(slices_defs(subgroup));
    if oblique {
        defs.push("OBLIQUE".into());
    }
    if subgroup {
        defs.push("SUBGROUP".into());
    }
    defs
}

/// Shader definitions of the passes that follow the accumulate pass.
pub fn slices_defs(subgroup: bool) -> Vec<ShaderDefVal> {
    vec![ShaderDefVal::UInt("TILES_PER_GROUP".into(), tiles_per_group(subgroup))]
}

/// Tiles that a workgroup of the accumulate pass fills. A CPU driver runs a subgroup as one vector: there the lanes share
/// what they load.
fn tiles_per_group(subgroup: bool) -> u32 {
    if subgroup { 1 } else { TILES_PER_GROUP }
}

/// Creates layouts, and pipelines for all that every picture needs.
pub fn create(server: &AssetServer, cache: &PipelineCache, vector_subgroups: bool) -> ComputePipelines {
    let uniform = |bytes: usize| uniform_buffer_sized(false, NonZeroU64::new(bytes as u64));
    let pass = || uniform_buffer_sized(true, NonZeroU64::new(size_of::<Pass>() as u64));
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let view = || uniform(size_of::<SplatUniform>());
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
    let accumulate_layout = BindGroupLayoutDescriptor::new(
        "deepfield accumulate",
        &BindGroupLayoutEntries::sequential(
            compute,
            (view(), pass(), read(), read(), write(), write(), write(), write(), write()),
        ),
    );
    let slices_layout = BindGroupLayoutDescriptor::new(
        "deepfield slices",
        &BindGroupLayoutEntries::sequential(compute, (view(), read(), write(), read(), read(), write())),
    );
    let reconstruct_layout = BindGroupLayoutDescriptor::new(
        "deepfield reconstruct",
        &BindGroupLayoutEntries::sequential(compute, (view(), pass(), write())),
    );

    let project = shaders::load(server, "splat/project.wgsl");
    let scan = shaders::load(server, "splat/scan.wgsl");
    let slices = shaders::load(server, "splat/slices.wgsl");
    let reconstruct = shaders::load(server, "splat/reconstruct.wgsl");
    let tiles = slices_defs(vector_subgroups);
    ComputePipelines {
        count: queue(cache, "deepfield count", &project_layout, &project, "count", vec![]),
        scan: queue(cache, "deepfield scan", &scan_layout, &scan, "main", vec![]),
        place: queue(cache, "deepfield place", &project_layout, &project, "place", vec![]),
        accumulate: HashMap::default(),
        accumulate_shader: shaders::load(server, "splat/accumulate.wgsl"),
        finish: queue(cache, "deepfield finish", &slices_layout, &slices, "finish", tiles.clone()),
        merge: queue(cache, "deepfield merge", &slices_layout, &slices, "merge", tiles),
        reconstruct: queue(cache, "deepfield reconstruct", &reconstruct_layout, &reconstruct, "main", vec![]),
        tiles_per_group: tiles_per_group(vector_subgroups),
        project_layout,
        scan_layout,
        accumulate_layout,
        slices_layout,
        reconstruct_layout,
    }
}

fn queue(
    cache: &PipelineCache,
    label: &'static str,
    layout: &BindGroupLayoutDescriptor,
    shader: &Handle<Shader>,
    entry: &'static str,
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
