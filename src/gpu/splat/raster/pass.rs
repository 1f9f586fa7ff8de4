//! Encodes the passes of the blended quads of one camera.

use super::bindings::Target;
use super::{RasterBindings, RasterPipelines};
use crate::gpu::splat::SplatBuffers;
use crate::gpu::timing::PassTimer;
use bevy::render::render_resource::{
    BindGroup, CommandEncoder, Extent3d, LoadOp, Operations, Origin3d, PipelineCache, RenderPassColorAttachment,
    RenderPassDescriptor, RenderPipeline, StoreOp, TexelCopyBufferInfo, TexelCopyBufferLayout, TexelCopyTextureInfo,
    TextureAspect,
};
use bevy::render::renderer::RenderContext;
use wgpu::{Color, RenderPass};

/// Accumulates `P` and `P S` of a camera's particles; false as long as a pipeline is not compiled.
pub fn encode(
    buffers: &SplatBuffers,
    bindings: &RasterBindings,
    pipelines: &RasterPipelines,
    cache: &PipelineCache,
    timer: &PassTimer,
    context: &mut RenderContext,
) -> bool {
    let uniform = &buffers.grids.uniform;
    let get = |id| cache.get_render_pipeline(id);
    let blend = pipelines.blend(buffers.grids.shape).and_then(get);
    let upsample = pipelines.upsample().map(|ids| ids.map(get));
    let (Some(blend), Some([Some(along_x), Some(along_y)])) = (blend, upsample) else { return false };
    let encoder = context.command_encoder();

    let span = timer.begin("accumulate", encoder);
    {
        let mut pass = begin(encoder, &bindings.atlas, "deepfield blend");
        pass.set_pipeline(blend);
        for (group, blocks) in &bindings.chunks {
            pass.set_bind_group(0, &**group, &[]);
            for instances in blocks {
                pass.draw(0..4, instances.clone());
            }
        }
    }
    span.end(encoder);

    let span = timer.begin("reconstruct", encoder);
    for (target, [from_coarser, from_rows]) in bindings.levels.iter().zip(&bindings.upsample).rev() {
        fill(encoder, &target.along_x, along_x, from_coarser);
        fill(encoder, &target.along_y, along_y, from_rows);
    }
    // A picture with one level is complete in the atlas.
    let [width, height] = uniform.size;
    encoder.copy_texture_to_buffer(
        TexelCopyTextureInfo {
            texture: &bindings.levels.first().map_or(&bindings.atlas, |level| &level.along_y).texture,
            mip_level: 0,
            origin: Origin3d::ZERO,
            aspect: TextureAspect::All,
        },
        TexelCopyBufferInfo {
            buffer: &buffers.shared.cells,
            layout: TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(buffers.stride * 8),
                rows_per_image: Some(height),
            },
        },
        Extent3d { width, height, depth_or_array_layers: 1 },
    );
    span.end(encoder);
    true
}

/// Begins a pass on a cleared target.
fn begin<'a>(encoder: &'a mut CommandEncoder, target: &'a Target, label: &'static str) -> RenderPass<'a> {
    let attachment = RenderPassColorAttachment {
        view: &target.view,
        depth_slice: None,
        resolve_target: None,
        ops: Operations { load: LoadOp::Clear(Color::TRANSPARENT), store: StoreOp::Store },
    };
    encoder.begin_render_pass(&RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[Some(attachment)],
        depth_stencil_attachment: None,
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}

/// Draws every cell of a target.
fn fill(encoder: &mut CommandEncoder, target: &Target, pipeline: &RenderPipeline, group: &BindGroup) {
    let mut pass = begin(encoder, target, "deepfield upsample");
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &**group, &[]);
    pass.draw(0..3, 0..1);
}
