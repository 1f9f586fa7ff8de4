//! How a picture gets into a camera's target: what the passes share that show one. Their shaders import `deepfield::frame`.
//!
//! Works for any camera target. Where it holds linear colours (sRGB or float formats) encoded ones are decoded, so that what
//! reaches the screen is what the processor's pictures are.

use super::shaders;
use super::timing::PassTimer;
use super::view::Fading;
use crate::color::Image as Picture;
use bevy::asset::AssetServer;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::camera::ExtractedCamera;
use bevy::render::render_resource::binding_types::{storage_buffer_read_only_sized, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntry, BindGroupLayoutDescriptor, Buffer, BufferInitDescriptor, BufferUsages,
    CachedRenderPipelineId, ColorTargetState, ColorWrites, FragmentState, PipelineCache, RenderPassDescriptor,
    RenderPipelineDescriptor, ShaderStages, TextureFormat, VertexState,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};
use bevy::render::view::ViewTarget;
use bevy::shader::{Shader, ShaderDefVal};
use bytemuck::{Pod, Zeroable};
use std::num::NonZeroU64;
use std::sync::Arc;

/// WGSL `Frame`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    /// What the picture covers in the target, pixels.
    pub size: [u32; 2],
    /// Size of the picture before, pixels.
    pub before_size: [u32; 2],
    /// Where the picture begins in the target, pixels.
    pub origin: [f32; 2],
    /// How much of this picture is seen; the rest is of the one before.
    pub share: f32,
    /// Padding.
    pub unused: u32,
}

/// Shader definitions for a target that holds encoded colours, or linear ones.
pub(super) fn target_defs(encoded: bool) -> Vec<ShaderDefVal> {
    if encoded { vec![] } else { vec!["LINEAR_TARGET".into()] }
}

/// The picture before, kept from frame to frame, and where the picture lies in the target.
pub struct Frame {
    uniform: Buffer,
    before: Option<(Arc<Picture>, Buffer)>,
}

impl Frame {
    /// What a camera's picture, of which `before` takes a share, needs; buffers are taken over from the frame before.
    pub fn new(
        known: Option<&Frame>,
        camera: &ExtractedCamera,
        before: Option<&Fading>,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Frame {
        let origin = camera.viewport.as_ref().map_or(UVec2::ZERO, |viewport| viewport.physical_position);
        let uniform = FrameUniform {
            size: camera.physical_viewport_size.unwrap_or(UVec2::ONE).to_array(),
            before_size: before.map_or([0; 2], |fading| [fading.image.width, fading.image.height]),
            origin: origin.as_vec2().to_array(),
            share: before.map_or(1.0, |fading| fading.share),
            unused: 0,
        };
        // Bound as the picture before where there is none; nothing is read of it then.
        let usage = BufferUsages::UNIFORM | BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let uniform = written(known.map(|known| &known.uniform), bytemuck::bytes_of(&uniform), usage, device, queue);
        let before = before.map(|fading| match known.and_then(|known| known.before.as_ref()) {
            Some((image, buffer)) if Arc::ptr_eq(image, &fading.image) => (Arc::clone(image), buffer.clone()),
            _ => {
                let bytes = bytemuck::cast_slice(&fading.image.rgba);
                (Arc::clone(&fading.image), written(None, bytes, BufferUsages::STORAGE, device, queue))
            }
        });
        Frame { uniform, before }
    }

    /// A group of this frame in bindings 0 and 1, and of what else a pass binds behind them.
    pub fn group(
        &self,
        layout: &BindGroupLayoutDescriptor,
        others: &[&Buffer],
        cache: &PipelineCache,
        device: &RenderDevice,
    ) -> BindGroup {
        let before = self.before.as_ref().map_or(&self.uniform, |(_, buffer)| buffer);
        let buffers = [&self.uniform, before].into_iter().chain(others.iter().copied());
        let numbered = (0..).zip(buffers);
        let entries: Vec<_> = numbered
            .map(|(binding, buffer)| BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        device.create_bind_group("deepfield composite", &cache.get_bind_group_layout(layout), &entries)
    }
}

/// A buffer with these bytes: the known one, which must be as long, or a new one.
pub fn written(
    known: Option<&Buffer>,
    bytes: &[u8],
    usage: BufferUsages,
    device: &RenderDevice,
    queue: &RenderQueue,
) -> Buffer {
    match known {
        Some(buffer) => {
            queue.write_buffer(buffer, 0, bytes);
            buffer.clone()
        }
        None => device.create_buffer_with_data(&BufferInitDescriptor {
            label: Some("deepfield composite"),
            contents: bytes,
            usage,
        }),
    }
}

/// The pipelines of a shader that shows pictures, one for each format of targets.
pub struct ShowPipelines {
    /// What it binds.
    pub layout: BindGroupLayoutDescriptor,
    shader: Handle<Shader>,
    variants: HashMap<TextureFormat, CachedRenderPipelineId>,
}

impl ShowPipelines {
    /// A shader by its path, which binds a uniform of so many bytes and so many buffers behind those of [`Frame`].
    pub fn new(server: &AssetServer, path: &'static str, uniform: usize, buffers: usize) -> ShowPipelines {
        let sized = |bytes: usize| uniform_buffer_sized(false, NonZeroU64::new(bytes as u64));
        let read = || storage_buffer_read_only_sized(false, None);
        let mut builders = vec![sized(size_of::<FrameUniform>()), read(), sized(uniform)];
        builders.extend((0..buffers).map(|_| read()));
        let entries: Vec<_> =
            (0..).zip(builders).map(|(index, builder)| builder.build(index, ShaderStages::FRAGMENT)).collect();
        let layout = BindGroupLayoutDescriptor::new("deepfield composite", &entries);
        ShowPipelines { layout, shader: shaders::load(server, path), variants: HashMap::default() }
    }

    /// The pipeline for a format of targets.
    pub fn variant(&mut self, format: TextureFormat, cache: &PipelineCache) -> CachedRenderPipelineId {
        let ShowPipelines { layout, shader, variants } = self;
        *variants.entry(format).or_insert_with(|| {
            // Eight-bit formats that are not sRGB hold encoded colours, all others linear ones.
            let encoded = matches!(format, TextureFormat::Rgba8Unorm | TextureFormat::Bgra8Unorm);
            let shader_defs = target_defs(encoded);
            cache.queue_render_pipeline(RenderPipelineDescriptor {
                label: Some("deepfield composite".into()),
                layout: vec![layout.clone()],
                vertex: VertexState {
                    shader: shader.clone(),
                    shader_defs: shader_defs.clone(),
                    entry_point: Some("vertex".into()),
                    buffers: vec![],
                },
                fragment: Some(FragmentState {
                    shader: shader.clone(),
                    shader_defs,
                    entry_point: Some("fragment".into()),
                    targets: vec![Some(ColorTargetState { format, blend: None, write_mask: ColorWrites::ALL })],
                }),
                ..default()
            })
        })
    }
}

/// Draws a picture into all that a camera has of its target; timed as the pass "composite".
pub fn show(
    pipeline: CachedRenderPipelineId,
    group: &BindGroup,
    (target, camera): (&ViewTarget, &ExtractedCamera),
    (cache, timer): (&PipelineCache, &PassTimer),
    context: &mut RenderContext,
) {
    let Some(pipeline) = cache.get_render_pipeline(pipeline) else { return };
    let attachment = target.get_unsampled_color_attachment();
    let encoder = context.command_encoder();
    let span = timer.begin("composite", encoder);
    {
        let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("deepfield composite"),
            color_attachments: &[Some(attachment)],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        if let Some(viewport) = &camera.viewport {
            let (position, size) = (viewport.physical_position.as_vec2(), viewport.physical_size.as_vec2());
            pass.set_viewport(position.x, position.y, size.x, size.y, 0.0, 1.0);
        }
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
    }
    span.end(encoder);
}
