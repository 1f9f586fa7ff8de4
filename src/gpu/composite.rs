//! The second pass of F12 4.9: accumulated `P` and `S` become colours through the baked transfer function.
//!
//! Works for any camera target. Where the target holds linear colours (sRGB or float formats) the encoded colours of
//! the table are decoded, so that what reaches the screen is what the CPU's composite gives.

use super::shaders;
use super::splat::{SplatBuffers, accumulate_splats};
use super::view::{Composite, SplatView};
use crate::color::transfer::Scale;
use bevy::core_pipeline::core_3d::main_transparent_pass_3d;
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::camera::ExtractedCamera;
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::extract_component::ExtractComponentPlugin;
use bevy::render::render_resource::binding_types::{storage_buffer_read_only_sized, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, Buffer, BufferInitDescriptor,
    BufferUsages, CachedRenderPipelineId, ColorTargetState, ColorWrites, FragmentState, PipelineCache,
    RenderPassDescriptor, RenderPipelineDescriptor, ShaderStages, TextureFormat, VertexState,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::ViewTarget;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bevy::shader::{Shader, ShaderDefVal};
use bytemuck::{Pod, Zeroable};
use std::num::NonZeroU64;
use std::sync::Arc;

/// WGSL `Composite`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CompositeUniform {
    /// Picture size, pixels.
    pub size: [u32; 2],
    /// Table size, texels.
    pub lut_size: [u32; 2],
    /// Factor and offset from `P`, or its base-2 logarithm, to its place in the table.
    pub p_map: [f32; 2],
    /// The same for `S`.
    pub s_map: [f32; 2],
    /// 1: logarithmic.
    pub p_log: u32,
    /// 1: logarithmic; 2: every place is the middle.
    pub s_log: u32,
    /// Where the picture begins in the target, pixels.
    pub origin: [f32; 2],
    /// Cells from a row of the picture to the next.
    pub stride: u32,
    /// How much of this picture is seen; the rest is of the one before.
    pub share: f32,
    /// Size of the picture before, pixels.
    pub before_size: [u32; 2],
}

/// Shader definitions for a target that holds encoded colours, or linear ones.
pub(super) fn composite_defs(encoded: bool) -> Vec<ShaderDefVal> {
    if encoded { vec![] } else { vec!["LINEAR_TARGET".into()] }
}

/// Factor and offset that place a value (or its base-2 logarithm) between the ends of a range.
fn map(scale: Scale, [min, max]: [f64; 2]) -> ([f32; 2], u32) {
    let (min, max, log) = match scale {
        Scale::Log => (min.log2(), max.log2(), 1),
        Scale::Linear => (min, max, 0),
    };
    let factor = 1.0 / (max - min);
    ([factor as f32, (-min * factor) as f32], log)
}

/// Adds the composite pass.
pub struct CompositePlugin;

impl Plugin for CompositePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<Composite>::default());
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .add_systems(RenderStartup, init_composite_pipeline)
            .add_systems(
                Render,
                prepare_composites.in_set(RenderSystems::PrepareBindGroups).after(super::splat::prepare_splats),
            )
            .add_systems(
                Core3d,
                composite_splats
                    .in_set(Core3dSystems::MainPass)
                    .after(accumulate_splats)
                    .before(main_transparent_pass_3d),
            );
    }
}

#[derive(Resource)]
struct CompositePipeline {
    layout: BindGroupLayoutDescriptor,
    shader: Handle<Shader>,
    variants: HashMap<TextureFormat, CachedRenderPipelineId>,
}

fn init_composite_pipeline(mut commands: Commands, server: Res<AssetServer>) {
    let layout = BindGroupLayoutDescriptor::new(
        "deepfield composite",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::FRAGMENT,
            (
                uniform_buffer_sized(false, NonZeroU64::new(size_of::<CompositeUniform>() as u64)),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
            ),
        ),
    );
    let shader = shaders::load(&server, "composite/composite.wgsl");
    commands.insert_resource(CompositePipeline { layout, shader, variants: HashMap::default() });
}

/// The composite pass of one camera.
#[derive(Component)]
pub struct CompositeBindings {
    group: BindGroup,
    pipeline: CachedRenderPipelineId,
    uniform: Buffer,
    lut: Buffer,
    fading: Option<Buffer>,
    settings: Composite,
}

fn prepare_composites(
    mut commands: Commands,
    cameras: Query<(
        Entity,
        &ExtractedCamera,
        &ViewTarget,
        &Composite,
        &SplatView,
        &SplatBuffers,
        Option<&CompositeBindings>,
    )>,
    pipeline: Option<ResMut<CompositePipeline>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let Some(mut pipeline) = pipeline else { return };
    for (entity, camera, target, composite, view, buffers, before) in &cameras {
        let format = target.main_texture_format();
        let id = pipeline.variant(format, &cache);
        let (p_map, p_log) = map(composite.p_scale, composite.levels.p);
        let (s_map, s_log) = map(composite.s_scale, composite.levels.s);
        let origin = camera.viewport.as_ref().map_or(UVec2::ZERO, |viewport| viewport.physical_position);
        let uniform = CompositeUniform {
            size: [view.view.width, view.view.height],
            lut_size: [composite.lut.width, composite.lut.height],
            p_map,
            s_map,
            p_log,
            s_log: if composite.attribute { s_log } else { 2 },
            origin: origin.as_vec2().to_array(),
            stride: buffers.stride,
            share: composite.before.as_ref().map_or(1.0, |fading| fading.share),
            before_size: composite.before.as_ref().map_or([0; 2], |fading| [fading.image.width, fading.image.height]),
        };
        let create = |bytes: &[u8], usage, label| {
            let descriptor = BufferInitDescriptor { label: Some(label), contents: bytes, usage };
            device.create_buffer_with_data(&descriptor)
        };
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform_buffer = match before {
            Some(before) => {
                queue.write_buffer(&before.uniform, 0, bytemuck::bytes_of(&uniform));
                before.uniform.clone()
            }
            None => create(bytemuck::bytes_of(&uniform), usage, "deepfield composite"),
        };
        let lut = match before {
            Some(before) if before.settings.lut == composite.lut => before.lut.clone(),
            _ => create(bytemuck::cast_slice(&composite.lut.rgba), BufferUsages::STORAGE, "deepfield colours"),
        };
        let fading = composite.before.as_ref().map(|fading| {
            let known = before.and_then(|before| before.fading.clone().zip(before.settings.before.as_ref()));
            match known {
                Some((buffer, known)) if Arc::ptr_eq(&known.image, &fading.image) => buffer,
                _ => {
                    create(bytemuck::cast_slice(&fading.image.rgba), BufferUsages::STORAGE, "deepfield picture before")
                }
            }
        });
        let group = device.create_bind_group(
            "deepfield composite",
            &cache.get_bind_group_layout(&pipeline.layout),
            &BindGroupEntries::sequential((
                uniform_buffer.as_entire_binding(),
                buffers.shared.cells.as_entire_binding(),
                lut.as_entire_binding(),
                // Where there is no picture before, nothing is read of it.
                fading.as_ref().unwrap_or(&lut).as_entire_binding(),
            )),
        );
        commands.entity(entity).insert(CompositeBindings {
            group,
            pipeline: id,
            uniform: uniform_buffer,
            lut,
            fading,
            settings: composite.clone(),
        });
    }
}

impl CompositePipeline {
    fn variant(&mut self, format: TextureFormat, cache: &PipelineCache) -> CachedRenderPipelineId {
        let CompositePipeline { layout, shader, variants } = self;
        *variants.entry(format).or_insert_with(|| {
            // Eight-bit formats that are not sRGB hold encoded colours, all others linear ones.
            let encoded = matches!(format, TextureFormat::Rgba8Unorm | TextureFormat::Bgra8Unorm);
            let shader_defs = composite_defs(encoded);
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

/// Draws the colours of an accumulated picture into the camera's target.
pub fn composite_splats(
    view: ViewQuery<(&ViewTarget, &ExtractedCamera, &CompositeBindings, &Composite, &SplatView)>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let (target, camera, bindings, _, _) = view.into_inner();
    let Some(pipeline) = cache.get_render_pipeline(bindings.pipeline) else { return };
    let diagnostics = context.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let attachment = target.get_unsampled_color_attachment();
    let encoder = context.command_encoder();
    let span = diagnostics.time_span(encoder, "composite");
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
        pass.set_bind_group(0, &bindings.group, &[]);
        pass.draw(0..3, 0..1);
    }
    span.end(encoder);
}
