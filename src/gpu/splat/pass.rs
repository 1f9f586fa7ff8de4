//! Encodes the splat passes of one camera.

use super::prepare::{Bindings, SplatBuffers};
use super::{SplatPipelines, compute, raster};
use crate::gpu::mode_view::ModeView;
use bevy::prelude::*;
use bevy::render::render_resource::PipelineCache;
use bevy::render::renderer::{RenderContext, ViewQuery};
use std::sync::atomic::Ordering;

/// Accumulates `P` and `P S` of the camera's particles, unless its mode has passes of its own.
pub fn accumulate_splats(
    view: ViewQuery<(&SplatBuffers, Option<&ModeView>)>,
    pipelines: Option<Res<SplatPipelines>>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let (buffers, mode) = view.into_inner();
    if mode.is_some_and(ModeView::has_passes) {
        return;
    }
    if buffers.accumulated.load(Ordering::Relaxed) && !buffers.always {
        return;
    }
    let Some(pipelines) = pipelines else { return };
    let encoded = match (&buffers.bindings, &pipelines.compute, &pipelines.raster) {
        (Bindings::Compute(bindings), Some(pipelines), _) => {
            compute::encode(buffers, bindings, pipelines, &cache, &mut context)
        }
        (Bindings::Raster(bindings), _, Some(pipelines)) => {
            raster::encode(buffers, bindings, pipelines, &cache, &mut context)
        }
        _ => false,
    };
    if encoded {
        buffers.accumulated.store(true, Ordering::Relaxed);
    }
}
