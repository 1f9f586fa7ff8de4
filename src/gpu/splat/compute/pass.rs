//! Encodes the compute passes of one camera.

use super::{ComputeBindings, ComputePipelines};
use crate::gpu::splat::SplatBuffers;
use crate::gpu::splat::layout::RECONSTRUCTED;
use crate::gpu::splat::workgroups as groups;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::{BindGroup, ComputePass, ComputePassDescriptor, ComputePipeline, PipelineCache};
use bevy::render::renderer::RenderContext;

/// Invocations of a workgroup of `reconstruct`, along each axis.
const RECONSTRUCT_GROUP: u32 = 8;

/// One workgroup for each block of particles.
fn for_blocks(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, batch: &[(BindGroup, u32)]) {
    pass.set_pipeline(pipeline);
    for (bindings, blocks) in batch {
        pass.set_bind_group(0, bindings, &[]);
        let (x, y) = groups(*blocks);
        pass.dispatch_workgroups(x, y, 1);
    }
}

/// Accumulates `P` and `P S` of a camera's particles; false as long as a pipeline is not compiled.
pub fn encode(
    buffers: &SplatBuffers,
    bindings: &ComputeBindings,
    pipelines: &ComputePipelines,
    cache: &PipelineCache,
    context: &mut RenderContext,
) -> bool {
    let uniform = &buffers.grids.uniform;
    let get = |id| cache.get_compute_pipeline(id);
    let (Some(count), Some(scan), Some(place), Some(accumulate), Some(finish), Some(merge), Some(reconstruct)) = (
        get(pipelines.count),
        get(pipelines.scan),
        get(pipelines.place),
        pipelines.accumulate(buffers.grids.kernel, buffers.grids.oblique).and_then(get),
        get(pipelines.finish),
        get(pipelines.merge),
        get(pipelines.reconstruct),
    ) else {
        return false;
    };
    let diagnostics = context.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let encoder = context.command_encoder();
    let descriptor = ComputePassDescriptor::default();
    for (index, batch) in bindings.batches.iter().enumerate() {
        let span = diagnostics.time_span(encoder, "project");
        encoder.clear_buffer(&bindings.starts, 0, None);
        encoder.clear_buffer(&bindings.slice_count, 0, None);
        {
            let mut pass = encoder.begin_compute_pass(&descriptor);
            for_blocks(&mut pass, count, batch);
            pass.set_pipeline(scan);
            pass.set_bind_group(0, &bindings.scan, &[]);
            pass.dispatch_workgroups(1, 1, 1);
            for_blocks(&mut pass, place, batch);
        }
        span.end(encoder);

        let span = diagnostics.time_span(encoder, "accumulate");
        {
            let mut pass = encoder.begin_compute_pass(&descriptor);
            pass.set_pipeline(accumulate);
            pass.set_bind_group(0, &bindings.accumulate, &[ComputeBindings::sum(index > 0, false)]);
            let (x, y) = groups(buffers.grids.tiles.div_ceil(pipelines.tiles_per_group));
            pass.dispatch_workgroups(x, y, 1);
            pass.set_pipeline(finish);
            pass.set_bind_group(0, &bindings.slices, &[]);
            pass.dispatch_workgroups(1, 1, 1);
        }
        {
            // A pass of its own: the same buffer held the dispatch's size as storage.
            let mut pass = encoder.begin_compute_pass(&descriptor);
            pass.set_pipeline(accumulate);
            pass.set_bind_group(0, &bindings.accumulate, &[ComputeBindings::sum(false, true)]);
            pass.dispatch_workgroups_indirect(&bindings.dispatch, 0);
            pass.set_pipeline(merge);
            pass.set_bind_group(0, &bindings.slices, &[]);
            let (x, y) = groups(buffers.grids.tiles.div_ceil(8));
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
            pass.set_bind_group(0, &bindings.reconstruct, &[ComputeBindings::reconstruction(level)]);
            let [x, y] = RECONSTRUCTED.map(|cells| cells * RECONSTRUCT_GROUP);
            pass.dispatch_workgroups(finer.width.div_ceil(x), finer.height.div_ceil(y), 1);
        }
    }
    span.end(encoder);
    true
}
