//! Layouts and pipelines of the blended quads.

use crate::gpu::shaders;
use crate::gpu::splat::layout::{BLOCK, Pass, Shape, SplatUniform};
use bevy::asset::AssetServer;
use bevy::mesh::PrimitiveTopology;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{storage_buffer_read_only_sized, texture_2d, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntries, BlendComponent, BlendFactor, BlendOperation, BlendState,
    CachedRenderPipelineId, ColorTargetState, ColorWrites, FragmentState, PipelineCache, PrimitiveState,
    RenderPipelineDescriptor, ShaderStages, TextureFormat, TextureSampleType, VertexState,
};
use bevy::shader::{Shader, ShaderDefVal};
use std::num::NonZeroU64;

/// Layouts and pipelines.
pub struct RasterPipelines {
    /// Bindings of `blend`.
    pub blend_layout: BindGroupLayoutDescriptor,
    /// Bindings of `upsample`.
    pub upsample_layout: BindGroupLayoutDescriptor,
    blend_shader: Handle<Shader>,
    upsample_shader: Handle<Shader>,
    blend: HashMap<Shape, CachedRenderPipelineId>,
    upsample: Option<[CachedRenderPipelineId; 2]>,
}

/// Additive blending.
const ADD: BlendComponent =
    BlendComponent { src_factor: BlendFactor::One, dst_factor: BlendFactor::One, operation: BlendOperation::Add };

impl RasterPipelines {
    /// The pipeline of `blend` for what splats look like, if it has been asked for: a strip of four vertices for
    /// each particle.
    pub fn blend(&self, shape: Shape) -> Option<CachedRenderPipelineId> {
        self.blend.get(&shape).copied()
    }

    /// The pipelines of `upsample`, along x and along y, if they have been asked for: one triangle.
    pub fn upsample(&self) -> Option<[CachedRenderPipelineId; 2]> {
        self.upsample
    }

    /// Has the pipelines for what splats look like compiled.
    pub fn ask_for(&mut self, shape: Shape, cache: &PipelineCache) {
        let RasterPipelines { blend_layout, upsample_layout, blend_shader, upsample_shader, blend, upsample } = self;
        blend.entry(shape).or_insert_with(|| {
            let defs = blend_defs(shape);
            let target = Some(BlendState { color: ADD, alpha: ADD });
            queue(cache, "deepfield blend", blend_layout, blend_shader, "fragment", defs, target)
        });
        upsample.get_or_insert_with(|| {
            ["along_x", "along_y"]
                .map(|entry| queue(cache, "deepfield upsample", upsample_layout, upsample_shader, entry, vec![], None))
        });
    }
}

/// Shader definitions of the blend pass.
pub fn blend_defs(shape: Shape) -> Vec<ShaderDefVal> {
    let mut defs = shape.defs();
    defs.push(ShaderDefVal::UInt("BLOCK".into(), BLOCK));
    defs
}

/// Creates the layouts.
pub fn create(server: &AssetServer) -> RasterPipelines {
    let uniform = |bytes: usize| uniform_buffer_sized(false, NonZeroU64::new(bytes as u64));
    let read = || storage_buffer_read_only_sized(false, None);
    let texture = || texture_2d(TextureSampleType::Float { filterable: false });
    let blend_layout = BindGroupLayoutDescriptor::new(
        "deepfield blend",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::VERTEX_FRAGMENT,
            (uniform(size_of::<SplatUniform>()), read(), read(), read(), read(), read()),
        ),
    );
    let upsample_layout = BindGroupLayoutDescriptor::new(
        "deepfield upsample",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::FRAGMENT,
            (uniform(size_of::<SplatUniform>()), uniform(size_of::<Pass>()), texture(), texture()),
        ),
    );
    RasterPipelines {
        blend_layout,
        upsample_layout,
        blend_shader: shaders::load(server, "splat/blend.wgsl"),
        upsample_shader: shaders::load(server, "splat/upsample.wgsl"),
        blend: HashMap::default(),
        upsample: None,
    }
}

fn queue(
    cache: &PipelineCache,
    label: &'static str,
    layout: &BindGroupLayoutDescriptor,
    shader: &Handle<Shader>,
    entry: &'static str,
    shader_defs: Vec<ShaderDefVal>,
    blend: Option<BlendState>,
) -> CachedRenderPipelineId {
    let target = ColorTargetState { format: TextureFormat::Rg32Float, blend, write_mask: ColorWrites::ALL };
    cache.queue_render_pipeline(RenderPipelineDescriptor {
        label: Some(label.into()),
        layout: vec![layout.clone()],
        vertex: VertexState {
            shader: shader.clone(),
            shader_defs: shader_defs.clone(),
            entry_point: Some("vertex".into()),
            buffers: vec![],
        },
        primitive: PrimitiveState { topology: PrimitiveTopology::TriangleStrip, ..default() },
        fragment: Some(FragmentState {
            shader: shader.clone(),
            shader_defs,
            entry_point: Some(entry.into()),
            targets: vec![Some(target)],
        }),
        ..default()
    })
}
