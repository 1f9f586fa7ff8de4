//! Encodes the compute passes of one camera.

use super::{ComputeBindings, ComputePipelines};
use crate::gpu::splat::SplatBuffers;
use crate::gpu::splat::workgroups as groups;
use crate::gpu::timing::PassTimer;
use bevy::render::render_resource::{BindGroup, ComputePass, ComputePassDescriptor, ComputePipeline, PipelineCache};
use bevy::render::renderer::RenderContext;

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
    timer: &PassTimer,
    context: &mut RenderContext,
) -> bool {
    let get = |id| cache.get_compute_pipeline(id);
    let project = pipelines.project(buffers.grids.shape).map(|ids| ids.map(get));
    let (Some([Some(count), Some(place)]), Some(scan), Some(sums)) =
        (project, get(pipelines.scan), pipelines.sums.ready(&buffers.grids, cache))
    else {
        return false;
    };
    let encoder = context.command_encoder();
    for (index, batch) in bindings.batches.iter().enumerate() {
        let span = timer.begin("project", encoder);
        encoder.clear_buffer(&bindings.starts, 0, None);
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            for_blocks(&mut pass, count, batch);
            pass.set_pipeline(scan);
            pass.set_bind_group(0, &bindings.scan, &[]);
            pass.dispatch_workgroups(1, 1, 1);
            for_blocks(&mut pass, place, batch);
        }
        span.end(encoder);

        let span = timer.begin("accumulate", encoder);
        bindings.sums.accumulate(sums, &buffers.grids, index > 0, None, encoder);
        span.end(encoder);
    }
    let span = timer.begin("reconstruct", encoder);
    bindings.sums.reconstruct(sums, &buffers.grids, None, encoder);
    span.end(encoder);
    true
}
