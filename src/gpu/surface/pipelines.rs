//! Layouts and pipelines of the passes that draw surfaces.

use super::job::SurfaceView;
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
use bevy::shader::ShaderDefVal;
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
    /// Those of flat fields and of globes, once they are wanted.
    sets: [Option<Set>; 2],
}

/// The pipelines that draw fields that stand alike.
struct Set {
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

/// What shaders that draw flat fields, or globes, are compiled with.
pub fn defs(is_globe: bool) -> Vec<ShaderDefVal> {
    if is_globe { vec!["GLOBE".into()] } else { Vec::new() }
}

/// Has pipelines compiled when a flat field, or one on a globe, is shown for the first time, and again after a lost device.
pub fn queue_surface_pipelines(
    mut commands: Commands,
    views: Query<&SurfaceView>,
    known: Option<ResMut<SurfacePipelines>>,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    splats: Option<Res<SplatPipelines>>,
) {
    if !splats.is_some_and(|splats| splats.capabilities.compute) {
        return;
    }
    let wanted = [false, true].map(|is_globe| views.iter().any(|view| view.job.is_globe() == is_globe));
    let add = |pipelines: &mut SurfacePipelines| {
        for (is_globe, _) in [false, true].into_iter().zip(wanted).filter(|(_, is_wanted)| *is_wanted) {
            if pipelines.sets[usize::from(is_globe)].is_none() {
                pipelines.sets[usize::from(is_globe)] = Some(pipelines.queued(is_globe, &server, &cache));
            }
        }
    };
    match known {
        Some(mut known) => add(&mut known),
        None => {
            let mut pipelines = SurfacePipelines::new();
            add(&mut pipelines);
            commands.insert_resource(pipelines);
        }
    }
}

impl SurfacePipelines {
    /// The layouts.
    fn new() -> SurfacePipelines {
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
        let resolve =
            layout(ShaderStages::COMPUTE, "deepfield surface, colours", vec![read(), read(), write(), read()]);
        SurfacePipelines { shared, visible, raster, resolve, sets: [None, None] }
    }

    /// Has those of flat fields, or of globes, compiled.
    fn queued(&self, is_globe: bool, server: &AssetServer, cache: &PipelineCache) -> Set {
        let shader_defs = defs(is_globe);
        let steps = Step::ALL.map(|step| {
            let own = if step == Step::Resolve { &self.resolve } else { &self.visible };
            cache.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some("deepfield surface".into()),
                layout: vec![self.shared.clone(), own.clone()],
                shader: shaders::load(server, step.shader()),
                shader_defs: shader_defs.clone(),
                entry_point: Some(step.entry().into()),
                ..ComputePipelineDescriptor::default()
            })
        });
        let shapes = Shape::ALL.map(|shape| {
            let shader = shaders::load(server, "surface/raster.wgsl");
            let topology = match shape {
                Shape::Points => PrimitiveTopology::PointList,
                _ => PrimitiveTopology::TriangleList,
            };
            cache.queue_render_pipeline(RenderPipelineDescriptor {
                label: Some("deepfield surface".into()),
                layout: vec![self.shared.clone(), self.raster.clone()],
                vertex: VertexState {
                    shader: shader.clone(),
                    shader_defs: shader_defs.clone(),
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
                    shader_defs: shader_defs.clone(),
                    entry_point: Some("number".into()),
                    targets: vec![Some(ColorTargetState {
                        format: NUMBERS,
                        blend: None,
                        write_mask: ColorWrites::ALL,
                    })],
                }),
                ..default()
            })
        });
        Set { steps, shapes }
    }

    /// What is compiled of those that draw flat fields, or globes.
    pub fn ready<'a>(&self, is_globe: bool, cache: &'a PipelineCache) -> Option<Ready<'a>> {
        let set = self.sets[usize::from(is_globe)].as_ref()?;
        Some(Ready {
            steps: set.steps.map(|step| cache.get_compute_pipeline(step)),
            shapes: set.shapes.map(|shape| cache.get_render_pipeline(shape)),
        })
    }
}
