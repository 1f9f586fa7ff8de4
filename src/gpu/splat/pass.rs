//! Encodes the splat passes of one camera.

use super::layout::RECONSTRUCTED;
use super::pipeline::SplatPipelines;
use super::prepare::{Batch, SplatBuffers};
use bevy::prelude::*;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::{ComputePass, ComputePassDescriptor, ComputePipeline, PipelineCache};
use bevy::render::renderer::{RenderContext, ViewQuery};
use std::sync::atomic::Ordering;

/// Workgroups along x and y for `count` of them: one dimension holds at most 65535.
fn groups(count: u32) -> (u32, u32) {
    const ROW: u32 = 32768;
    if count <= ROW { (count, 1) } else { (ROW, count.div_ceil(ROW)) }
}

/// Invocations of a workgroup of `reconstruct`, along each axis.
const RECONSTRUCT_GROUP: u32 = 8;

/// One workgroup for each block of particles.
fn for_blocks(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, batch: &Batch) {
    pass.set_pipeline(pipeline);
    for (bindings, blocks) in &batch.project {
        pass.set_bind_group(0, bindings, &[]);
        let (x, y) = groups(*blocks);
        pass.dispatch_workgroups(x, y, 1);
    }
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
    let (Some(count), Some(scan), Some(place), Some(accumulate), Some(reconstruct)) = (
        get(pipelines.count),
        get(pipelines.scan),
        get(pipelines.place),
        pipelines.accumulate(buffers.grids.kernel, uniform.perspective != 0).and_then(get),
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
            for_blocks(&mut pass, count, batch);
            pass.set_pipeline(scan);
            pass.set_bind_group(0, &buffers.scan, &[]);
            pass.dispatch_workgroups(1, 1, 1);
            for_blocks(&mut pass, place, batch);
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
            let [x, y] = RECONSTRUCTED.map(|cells| cells * RECONSTRUCT_GROUP);
            pass.dispatch_workgroups(finer.width.div_ceil(x), finer.height.div_ceil(y), 1);
        }
    }
    span.end(encoder);
}
