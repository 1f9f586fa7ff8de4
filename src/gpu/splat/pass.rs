//! Encodes the splat passes of one camera.

use super::prepare::{Bindings, SplatBuffers};
use super::{SplatPipelines, compute, raster};
use crate::gpu::timing::PassTimer;
use bevy::prelude::*;
use bevy::render::render_resource::PipelineCache;
use bevy::render::renderer::{RenderContext, ViewQuery};
use std::sync::atomic::Ordering;

/// Accumulates `P` and `P S` of the camera's particles, unless its mode has passes of its own.
pub fn accumulate_splats(
    view: ViewQuery<&SplatBuffers>,
    pipelines: Option<Res<SplatPipelines>>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let buffers = view.into_inner();
    if buffers.accumulated.load(Ordering::Relaxed) && !buffers.always {
        return;
    }
    let Some(pipelines) = pipelines else { return };
    let encoded = match (&buffers.bindings, &pipelines.compute, &pipelines.raster) {
        (Some(Bindings::Compute(bindings)), Some(pipelines), _) => {
            compute::encode(buffers, bindings, pipelines, &cache, &timer, &mut context)
        }
        (Some(Bindings::Raster(bindings)), _, Some(pipelines)) => {
            raster::encode(buffers, bindings, pipelines, &cache, &timer, &mut context)
        }
        _ => false,
    };
    if encoded {
        buffers.accumulated.store(true, Ordering::Relaxed);
    }
}
