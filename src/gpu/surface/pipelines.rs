//! Layouts and pipelines of the passes that draw surfaces.

use super::layout::{SurfaceStep, SurfaceUniform};
use crate::gpu::shaders;
use crate::gpu::splat::SplatPipelines;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntryBuilder, CachedComputePipelineId, CachedRenderPipelineId,
    ColorTargetState, ColorWrites, CompareFunction, ComputePipeline, ComputePipelineDescriptor, DepthStencilState,
    FragmentState, PipelineCache, PrimitiveState, PrimitiveTopology, RenderPipeline, RenderPipelineDescriptor,
    ShaderStages, TextureFormat, VertexState,
};
use std::num::NonZeroU64;

/// What rasterised triangles and points leave their numbers in.
pub const NUMBERS: TextureFormat = TextureFormat::R32Uint;
/// What they are sorted by.
pub const DEPTHS: TextureFormat = TextureFormat::Depth32Float;

/// A pass of compute shaders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Small triangles and points of chunks.
    Cells,
    /// Triangles whose corners are listed.
    Fans,
    /// Triangles of any size that those have listed.
    Large,
    /// Colours.
    Resolve,
}

impl Step {
    /// All of them, in their order.
    pub const ALL: [Step; 4] = [Step::Cells, Step::Fans, Step::Large, Step::Resolve];

    /// Its entry point.
    pub fn entry(self) -> &'static str {
        ["cells", "fans", "large", "resolve"][self as usize]
    }

    /// Its shader.
    pub fn shader(self) -> &'static str {
        if self == Step::Resolve { "surface/resolve.wgsl" } else { "surface/visible.wgsl" }
    }
}

/// What the rasteriser draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Triangles of chunks.
    Cells,
    /// Triangles whose corners are listed.
    Fans,
    /// Samples as points.
    Points,
}

impl Shape {
    /// All of them, in their order.
    pub const ALL: [Shape; 3] = [Shape::Cells, Shape::Fans, Shape::Points];

    /// Its vertex shader.
    pub fn entry(self) -> &'static str {
        ["cell", "fan", "point"][self as usize]
    }
}

/// Layouts and pipelines (render world).
#[derive(Resource)]
pub struct SurfacePipelines {
    /// Who looks, samples, chunks and lists.
    pub shared: BindGroupLayoutDescriptor,
    /// What is seen, by compute passes.
    pub visible: BindGroupLayoutDescriptor,
    /// What the rasteriser draws at a time.
    pub raster: BindGroupLayoutDescriptor,
    /// Colours.
    pub resolve: BindGroupLayoutDescriptor,
    steps: [CachedComputePipelineId; 4],
    shapes: [CachedRenderPipelineId; 3],
}

/// Compiled pipelines.
pub struct Ready<'a> {
    /// In the order of [`Step::ALL`].
    pub steps: [Option<&'a ComputePipeline>; 4],
    /// In the order of [`Shape::ALL`].
    pub shapes: [Option<&'a RenderPipeline>; 3],
}

/// Has pipelines compiled when a surface is shown for the first time, and again after a lost device.
pub fn init_surface_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    splats: Option<Res<SplatPipelines>>,
) {
    if !splats.is_some_and(|splats| splats.capabilities.compute) {
        return;
    }
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let sized = |bytes: usize, moves: bool| uniform_buffer_sized(moves, NonZeroU64::new(bytes as u64));
    let step = || sized(size_of::<SurfaceStep>(), true);
    let layout = |stages: ShaderStages, label: &'static str, entries: Vec<_>| {
        let numbered =
            (0..).zip(entries).map(|(index, entry): (u32, BindGroupLayoutEntryBuilder)| entry.build(index, stages));
        BindGroupLayoutDescriptor::new(label, &numbered.collect::<Vec<_>>())
    };
    let everywhere = ShaderStages::COMPUTE | ShaderStages::VERTEX_FRAGMENT;
    let view = sized(size_of::<SurfaceUniform>(), false);
    let shared = layout(everywhere, "deepfield surface", vec![view, read(), read(), read()]);
    let seen = vec![step(), write(), write(), write(), write()];
    let visible = layout(ShaderStages::COMPUTE, "deepfield surface, what is seen", seen);
    let raster = layout(ShaderStages::VERTEX_FRAGMENT, "deepfield surface, rasterised", vec![step()]);
    let resolve = layout(ShaderStages::COMPUTE, "deepfield surface, colours", vec![read(), read(), write()]);
    let steps = Step::ALL.map(|step| {
        let own = if step == Step::Resolve { &resolve } else { &visible };
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some("deepfield surface".into()),
            layout: vec![shared.clone(), own.clone()],
            shader: shaders::load(&server, step.shader()),
            entry_point: Some(step.entry().into()),
            ..ComputePipelineDescriptor::default()
        })
    });
    let shapes = Shape::ALL.map(|shape| {
        let shader = shaders::load(&server, "surface/raster.wgsl");
        let topology = match shape {
            Shape::Points => PrimitiveTopology::PointList,
            _ => PrimitiveTopology::TriangleList,
        };
        cache.queue_render_pipeline(RenderPipelineDescriptor {
            label: Some("deepfield surface".into()),
            layout: vec![shared.clone(), raster.clone()],
            vertex: VertexState {
                shader: shader.clone(),
                shader_defs: Vec::new(),
                entry_point: Some(shape.entry().into()),
                buffers: Vec::new(),
            },
            primitive: PrimitiveState { topology, ..PrimitiveState::default() },
            depth_stencil: Some(DepthStencilState {
                format: DEPTHS,
                depth_write_enabled: Some(true),
                depth_compare: Some(CompareFunction::Greater),
                stencil: default(),
                bias: default(),
            }),
            fragment: Some(FragmentState {
                shader,
                shader_defs: Vec::new(),
                entry_point: Some("number".into()),
                targets: vec![Some(ColorTargetState { format: NUMBERS, blend: None, write_mask: ColorWrites::ALL })],
            }),
            ..default()
        })
    });
    commands.insert_resource(SurfacePipelines { shared, visible, raster, resolve, steps, shapes });
}

impl SurfacePipelines {
    /// What is compiled.
    pub fn ready<'a>(&self, cache: &'a PipelineCache) -> Ready<'a> {
        Ready {
            steps: self.steps.map(|step| cache.get_compute_pipeline(step)),
            shapes: self.shapes.map(|shape| cache.get_render_pipeline(shape)),
        }
    }
}
