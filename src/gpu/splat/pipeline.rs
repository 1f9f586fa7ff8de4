//! The compute pipelines of the splat passes.

use super::layout::{Pass, RECONSTRUCTION_WINDOW, SplatUniform};
use crate::gpu::shaders;
use bevy::asset::AssetServer;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntries, CachedComputePipelineId, CachedPipelineState,
    ComputePipelineDescriptor, PipelineCache, ShaderStages, WgpuFeatures,
};
use bevy::render::renderer::{RenderAdapterInfo, RenderDevice};
use bevy::shader::{Shader, ShaderCacheError, ShaderDefVal};
use std::num::NonZeroU64;

/// Tiles that one workgroup of the accumulate pass fills, where it is not one subgroup.
const TILES_PER_GROUP: u32 = 8;

/// Layouts and pipelines.
#[derive(Resource)]
pub struct SplatPipelines {
    /// Bindings of `project`.
    pub project_layout: BindGroupLayoutDescriptor,
    /// Bindings of `scan` and `scatter`.
    pub sort_layout: BindGroupLayoutDescriptor,
    /// Bindings of `accumulate`.
    pub accumulate_layout: BindGroupLayoutDescriptor,
    /// Bindings of `reconstruct`.
    pub reconstruct_layout: BindGroupLayoutDescriptor,
    /// One workgroup a block.
    pub project: CachedComputePipelineId,
    /// One workgroup.
    pub scan: CachedComputePipelineId,
    /// One invocation a splat.
    pub scatter: CachedComputePipelineId,
    /// One workgroup for `tiles_per_group` tiles; orthographic and perspective.
    pub accumulate: [CachedComputePipelineId; 2],
    /// Tiles that a workgroup of `accumulate` fills.
    pub tiles_per_group: u32,
    /// One workgroup for 32 x 32 finer cells.
    pub reconstruct: CachedComputePipelineId,
}

impl SplatPipelines {
    /// Every pipeline.
    fn ids(&self) -> impl Iterator<Item = CachedComputePipelineId> {
        [self.project, self.scan, self.scatter, self.reconstruct].into_iter().chain(self.accumulate)
    }

    /// The first compile error among the pipelines, if any failed. A shader that is still being read is no error: Bevy
    /// tries again.
    pub fn error(&self, cache: &PipelineCache) -> Option<String> {
        use ShaderCacheError::{ShaderImportNotYetAvailable, ShaderNotLoaded};
        self.ids().find_map(|id| match cache.get_compute_pipeline_state(id) {
            CachedPipelineState::Err(ShaderNotLoaded(_) | ShaderImportNotYetAvailable) => None,
            CachedPipelineState::Err(error) => Some(error.to_string()),
            _ => None,
        })
    }

    /// Whether all are compiled.
    pub fn ready(&self, cache: &PipelineCache) -> bool {
        self.ids().all(|id| cache.get_compute_pipeline(id).is_some())
    }
}

/// Shader definitions of the accumulate pass.
pub fn accumulate_defs(perspective: bool, subgroup: bool) -> Vec<ShaderDefVal> {
    let tiles = if subgroup { 1 } else { TILES_PER_GROUP };
    let mut defs = vec![ShaderDefVal::UInt("TILES_PER_GROUP".into(), tiles)];
    if perspective {
        defs.push("PERSPECTIVE".into());
    }
    if subgroup {
        defs.push("SUBGROUP".into());
    }
    defs
}

/// Shader definitions of the reconstruct pass.
pub fn reconstruct_defs() -> Vec<ShaderDefVal> {
    vec![ShaderDefVal::UInt("WINDOW".into(), RECONSTRUCTION_WINDOW)]
}

/// Creates the pipelines at start-up, and again after a lost device.
pub fn init_splat_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    adapter: Res<RenderAdapterInfo>,
) {
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
            (view(), read(), read(), read(), read(), write(), write(), write()),
        ),
    );
    let sort_layout = BindGroupLayoutDescriptor::new(
        "deepfield sort",
        &BindGroupLayoutEntries::sequential(compute, (view(), write(), read(), write())),
    );
    let accumulate_layout = BindGroupLayoutDescriptor::new(
        "deepfield accumulate",
        &BindGroupLayoutEntries::sequential(compute, (view(), pass(), read(), read(), read(), write())),
    );
    let weights = uniform(RECONSTRUCTION_WINDOW as usize * 16);
    let reconstruct_layout = BindGroupLayoutDescriptor::new(
        "deepfield reconstruct",
        &BindGroupLayoutEntries::sequential(compute, (view(), pass(), weights, write())),
    );

    // A CPU driver runs a subgroup as one vector: there the lanes share what they load.
    let subgroup = device.features().contains(WgpuFeatures::SUBGROUP)
        && adapter.subgroup_min_size == 8
        && adapter.subgroup_max_size == 8;
    let queue = |label: &'static str,
                 layout: &BindGroupLayoutDescriptor,
                 shader: &Handle<Shader>,
                 entry: &'static str,
                 shader_defs: Vec<ShaderDefVal>| {
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(label.into()),
            layout: vec![layout.clone()],
            shader: shader.clone(),
            entry_point: Some(entry.into()),
            shader_defs,
            ..default()
        })
    };
    let project = shaders::load(&server, "splat/project.wgsl");
    let sort = shaders::load(&server, "splat/sort.wgsl");
    let accumulate = shaders::load(&server, "splat/accumulate.wgsl");
    let reconstruct = shaders::load(&server, "splat/reconstruct.wgsl");
    let pipelines = SplatPipelines {
        project: queue("deepfield project", &project_layout, &project, "main", vec![]),
        scan: queue("deepfield scan", &sort_layout, &sort, "scan", vec![]),
        scatter: queue("deepfield scatter", &sort_layout, &sort, "scatter", vec![]),
        accumulate: [false, true].map(|perspective| {
            let defs = accumulate_defs(perspective, subgroup);
            queue("deepfield accumulate", &accumulate_layout, &accumulate, "main", defs)
        }),
        reconstruct: queue("deepfield reconstruct", &reconstruct_layout, &reconstruct, "main", reconstruct_defs()),
        tiles_per_group: if subgroup { 1 } else { TILES_PER_GROUP },
        project_layout,
        sort_layout,
        accumulate_layout,
        reconstruct_layout,
    };
    commands.insert_resource(pipelines);
}
