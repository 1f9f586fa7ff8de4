//! Layouts and pipelines of the passes that draw surfaces.

use super::job::SurfaceView;
use super::layout::{SurfaceStep, SurfaceUniform};
use crate::cpu::surface::holes::Holes;
use crate::cpu::surface::look::Attribute;
use crate::gpu::shaders;
use crate::gpu::splat::SplatPipelines;
use crate::picture::adapter::AdapterSurface;
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
use std::collections::HashMap;
use std::num::NonZeroU64;

/// What rasterised triangles and points leave their numbers in.
pub const NUMBERS: TextureFormat = TextureFormat::R32Uint;
/// What they are sorted by.
pub const DEPTHS: TextureFormat = TextureFormat::Depth32Float;

/// A pass of compute shaders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Step {
    /// Small triangles and points of chunks.
    Cells,
    /// Triangles whose corners are listed.
    Fans,
    /// Triangles of any size that those have listed.
    Large,
    /// Rays through chunks.
    Rays,
    /// Colours.
    Resolve,
}

impl Step {
    /// All of them, in their order.
    pub const ALL: [Step; 5] = [Step::Cells, Step::Fans, Step::Large, Step::Rays, Step::Resolve];

    /// Its entry point.
    pub fn entry(self) -> &'static str {
        ["cells", "fans", "large", "rays", "resolve"][self as usize]
    }

    /// Its shader.
    pub fn shader(self) -> &'static str {
        match self {
            Step::Cells | Step::Fans | Step::Large => "surface/visible.wgsl",
            Step::Rays => "surface/rays.wgsl",
            Step::Resolve => "surface/resolve.wgsl",
        }
    }
}

/// What the rasteriser draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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

/// What pictures are made of: shaders are compiled without what a picture does not need, as some of it takes long to compile, and to run where
/// branches that are not taken cost as much as others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The field stands on a globe.
    pub globe: bool,
    /// A membrane may be over holes.
    pub filled: bool,
    /// A photo colours the field.
    pub photo: bool,
    /// Rims of holes are lines.
    pub rims: bool,
    /// The field has sides.
    pub walls: bool,
}

impl Variant {
    /// What a picture needs.
    pub fn of(job: &AdapterSurface) -> Variant {
        let globe = job.is_globe();
        Variant {
            globe,
            filled: matches!(job.holes, Holes::Filled(_)),
            photo: job.look.attribute == Attribute::Photo,
            rims: matches!(job.holes, Holes::Outlined(_)),
            walls: job.walls.is_some() && !globe,
        }
    }

    /// What of it finds out what is seen.
    pub fn seen(self) -> Variant {
        Variant { globe: self.globe, filled: self.filled, ..Variant::default() }
    }

    /// What of it a step needs.
    fn of_step(self, step: Step) -> Variant {
        if step == Step::Resolve { self } else { self.seen() }
    }

    /// What shaders are compiled with.
    pub fn defs(self) -> Vec<ShaderDefVal> {
        let all = [
            (self.globe, "GLOBE"),
            (self.filled, "FILLED"),
            (self.photo, "PHOTO"),
            (self.rims, "RIMS"),
            (self.walls, "WALLS"),
        ];
        all.into_iter().filter(|(is_needed, _)| *is_needed).map(|(_, name)| name.into()).collect()
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
    /// Those of compute passes that were wanted once.
    steps: HashMap<(Step, Variant), CachedComputePipelineId>,
    /// Those of the rasteriser.
    shapes: HashMap<(Shape, Variant), CachedRenderPipelineId>,
}

/// Compiled pipelines.
pub struct Ready<'a> {
    /// In the order of [`Step::ALL`].
    pub steps: [Option<&'a ComputePipeline>; 5],
    /// In the order of [`Shape::ALL`].
    pub shapes: [Option<&'a RenderPipeline>; 3],
}

/// Has pipelines compiled when the first picture needs them, and again after a lost device.
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
    let add = |pipelines: &mut SurfacePipelines| views.iter().for_each(|view| pipelines.add(view, &server, &cache));
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
            layout(ShaderStages::COMPUTE, "deepfield surface, colours", vec![read(), read(), write(), read(), write()]);
        let (steps, shapes) = (HashMap::new(), HashMap::new());
        SurfacePipelines { shared, visible, raster, resolve, steps, shapes }
    }

    /// Has those of a picture compiled that are not yet.
    fn add(&mut self, view: &SurfaceView, server: &AssetServer, cache: &PipelineCache) {
        let variant = Variant::of(&view.job);
        let is_raster = view.job.is_raster();
        let is_needed = |step: &Step| match step {
            Step::Resolve => view.is_colored,
            Step::Rays => view.job.casts_rays(),
            // Beside rays there are points.
            Step::Fans => !is_raster && !view.job.casts_rays(),
            Step::Cells | Step::Large => !is_raster,
        };
        let steps = Step::ALL.into_iter().filter(is_needed).map(|step| (step, variant.of_step(step)));
        let missing: Vec<(Step, Variant)> = steps.filter(|key| !self.steps.contains_key(key)).collect();
        for key in missing {
            let queued = self.queued_step(key, server, cache);
            self.steps.insert(key, queued);
        }
        let shapes = Shape::ALL.into_iter().filter(|_| is_raster).map(|shape| (shape, variant.seen()));
        let missing: Vec<(Shape, Variant)> = shapes.filter(|key| !self.shapes.contains_key(key)).collect();
        for key in missing {
            let queued = self.queued_shape(key, server, cache);
            self.shapes.insert(key, queued);
        }
    }

    fn queued_step(
        &self,
        (step, variant): (Step, Variant),
        server: &AssetServer,
        cache: &PipelineCache,
    ) -> CachedComputePipelineId {
        let own = if step == Step::Resolve { &self.resolve } else { &self.visible };
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some("deepfield surface".into()),
            layout: vec![self.shared.clone(), own.clone()],
            shader: shaders::load(server, step.shader()),
            shader_defs: variant.defs(),
            entry_point: Some(step.entry().into()),
            ..ComputePipelineDescriptor::default()
        })
    }

    fn queued_shape(
        &self,
        (shape, variant): (Shape, Variant),
        server: &AssetServer,
        cache: &PipelineCache,
    ) -> CachedRenderPipelineId {
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
                shader_defs: variant.defs(),
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
                shader_defs: variant.defs(),
                entry_point: Some("number".into()),
                targets: vec![Some(ColorTargetState { format: NUMBERS, blend: None, write_mask: ColorWrites::ALL })],
            }),
            ..default()
        })
    }

    /// What is compiled of those that a picture needs.
    pub fn ready<'a>(&self, variant: Variant, cache: &'a PipelineCache) -> Ready<'a> {
        let step = |step: Step| cache.get_compute_pipeline(*self.steps.get(&(step, variant.of_step(step)))?);
        let shape = |shape: Shape| cache.get_render_pipeline(*self.shapes.get(&(shape, variant.seen()))?);
        Ready { steps: Step::ALL.map(step), shapes: Shape::ALL.map(shape) }
    }
}
