//! The pipelines of the techniques that the adapter can carry out.

use super::compute::{self, ComputePipelines};
use super::raster::{self, RasterPipelines};
use crate::gpu::capabilities::{Capabilities, Withheld};
use bevy::asset::AssetServer;
use bevy::prelude::*;
use bevy::render::render_resource::{CachedPipelineState, PipelineCache};
use bevy::render::renderer::{RenderAdapter, RenderAdapterInfo, RenderDevice};
use bevy::shader::ShaderCacheError;

/// Layouts and pipelines.
#[derive(Resource)]
pub struct SplatPipelines {
    /// What the adapter can do.
    pub capabilities: Capabilities,
    /// Compute passes, where it can.
    pub compute: Option<ComputePipelines>,
    /// Blended quads, where it can.
    pub raster: Option<RasterPipelines>,
}

/// The first compile error among all pipelines, if any failed. A shader that is still being read is no error: Bevy tries
/// again.
pub fn pipeline_error(cache: &PipelineCache) -> Option<String> {
    use ShaderCacheError::{ShaderImportNotYetAvailable, ShaderNotLoaded};
    cache.pipelines().find_map(|pipeline| match &pipeline.state {
        CachedPipelineState::Err(ShaderNotLoaded(_) | ShaderImportNotYetAvailable) => None,
        CachedPipelineState::Err(error) => Some(error.to_string()),
        _ => None,
    })
}

/// Creates the pipelines at start-up, and again after a lost device.
pub fn init_splat_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    adapter: Res<RenderAdapter>,
    info: Res<RenderAdapterInfo>,
    withheld: Option<Res<Withheld>>,
) {
    let withheld = withheld.map_or_else(Withheld::default, |withheld| *withheld);
    let capabilities = Capabilities::of(&device, &adapter, &info, withheld);
    let compute =
        capabilities.compute.then(|| compute::pipeline::create(&server, &cache, capabilities.vector_subgroups));
    let raster = capabilities.raster.then(|| raster::pipeline::create(&server));
    commands.insert_resource(SplatPipelines { capabilities, compute, raster });
}
