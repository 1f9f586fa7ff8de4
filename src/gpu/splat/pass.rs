//! Encodes the splat passes of one camera.

use super::layout::TILE;
use super::pipeline::SplatPipelines;
use super::prepare::SplatBuffers;
use bevy::prelude::*;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::{ComputePassDescriptor, PipelineCache};
use bevy::render::renderer::{RenderContext, ViewQuery};
use std::sync::atomic::Ordering;

/// Workgroups along x and y for `count` of them: one dimension holds at most 65535.
fn groups(count: u32) -> (u32, u32) {
    const ROW: u32 = 32768;
    if count <= ROW { (count, 1) } else { (ROW, count.div_ceil(ROW)) }
}

/// Accumulates `P` and `P S` of the camera's particles.
pub fn accumulate_splats(
    view: ViewQuery<&SplatBuffers>,
    pipelines: Option<Res<SplatPipelines>>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let buffers = view.into_inner();
    if buffers.accumulated.load(Ordering::Relaxed) && !buffers.always {
        return;
    }
    let Some(pipelines) = pipelines else { return };
    let uniform = &buffers.grids.uniform;
    let get = |id| cache.get_compute_pipeline(id);
    let (Some(project), Some(scan), Some(scatter), Some(accumulate), Some(reconstruct)) = (
        get(pipelines.project),
        get(pipelines.scan),
        get(pipelines.scatter),
        get(pipelines.accumulate[usize::from(uniform.perspective != 0)]),
        get(pipelines.reconstruct),
    ) else {
        return;
    };
    buffers.accumulated.store(true, Ordering::Relaxed);
    let diagnostics = context.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let encoder = context.command_encoder();
    let descriptor = ComputePassDescriptor::default();
    for (index, batch) in buffers.batches.iter().enumerate() {
        let span = diagnostics.time_span(encoder, "project");
        encoder.clear_buffer(&buffers.starts, 0, None);
        {
            let mut pass = encoder.begin_compute_pass(&descriptor);
            pass.set_pipeline(project);
            for (bindings, blocks) in &batch.project {
                pass.set_bind_group(0, bindings, &[]);
                let (x, y) = groups(*blocks);
                pass.dispatch_workgroups(x, y, 1);
            }
        }
        span.end(encoder);

        let span = diagnostics.time_span(encoder, "sort");
        {
            let mut pass = encoder.begin_compute_pass(&descriptor);
            pass.set_bind_group(0, &batch.sort, &[]);
            pass.set_pipeline(scan);
            pass.dispatch_workgroups(1, 1, 1);
            pass.set_pipeline(scatter);
            let (x, y) = groups(batch.splats.div_ceil(64));
            pass.dispatch_workgroups(x, y, 1);
        }
        span.end(encoder);

        let span = diagnostics.time_span(encoder, "accumulate");
        {
            let mut pass = encoder.begin_compute_pass(&descriptor);
            pass.set_pipeline(accumulate);
            let offset = if index == 0 { 0 } else { SplatBuffers::pass_offset(true, 0) };
            pass.set_bind_group(0, &buffers.accumulate, &[offset]);
            let (x, y) = groups(buffers.grids.tiles.div_ceil(pipelines.tiles_per_group));
            pass.dispatch_workgroups(x, y, 1);
        }
        span.end(encoder);
    }
    let span = diagnostics.time_span(encoder, "reconstruct");
    {
        let mut pass = encoder.begin_compute_pass(&descriptor);
        pass.set_pipeline(reconstruct);
        for level in (1..uniform.level_count).rev() {
            let finer = &uniform.levels[level as usize - 1];
            pass.set_bind_group(0, &buffers.reconstruct, &[SplatBuffers::pass_offset(false, level)]);
            pass.dispatch_workgroups(finer.width.div_ceil(4 * TILE), finer.height.div_ceil(4 * TILE), 1);
        }
    }
    span.end(encoder);
}
