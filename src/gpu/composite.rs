//! The second pass of F12 4.9: accumulated `P` and `S` become colours through the baked transfer function.

use super::matter::map_to_place;
use super::splat::{SplatBuffers, accumulate_splats};
use super::target::{Frame, ShowPipelines, show, written};
use super::timing::PassTimer;
use super::view::{Composite, SplatView};
use crate::color::transfer::Lut;
use bevy::core_pipeline::core_3d::main_transparent_pass_3d;
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::camera::ExtractedCamera;
use bevy::render::extract_component::ExtractComponentPlugin;
use bevy::render::render_resource::{BindGroup, Buffer, BufferUsages, CachedRenderPipelineId, PipelineCache};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::ViewTarget;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// WGSL `Composite`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CompositeUniform {
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
    /// Cells from a row of the picture to the next.
    pub stride: u32,
    /// How much of the picture is seen over the one before it.
    pub share: f32,
    /// The upper end of `P`'s range.
    pub high: f32,
    /// Padding.
    pub unused: u32,
}

/// Adds the composite pass.
pub struct CompositePlugin;

impl Plugin for CompositePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<Composite>::default());
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .add_systems(RenderStartup, init_composite_pipelines)
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

/// The pass that shows colours of sums, for each format of targets.
#[derive(Resource)]
pub(super) struct CompositePipelines(ShowPipelines);

fn init_composite_pipelines(mut commands: Commands, server: Res<AssetServer>) {
    let pipelines = ShowPipelines::new(&server, "composite/composite.wgsl", size_of::<CompositeUniform>(), 3);
    commands.insert_resource(CompositePipelines(pipelines));
}

/// The composite pass of one camera.
#[derive(Component)]
pub struct CompositeBindings {
    group: BindGroup,
    pipeline: CachedRenderPipelineId,
    frame: Frame,
    uniform: Buffer,
    lut: (Arc<Lut>, Buffer),
}

/// Prepares every camera that shows colours of sums.
pub(super) fn prepare_composites(
    mut commands: Commands,
    cameras: Query<(Entity, &ExtractedCamera, &ViewTarget, &Composite, &SplatBuffers, Option<&CompositeBindings>)>,
    pipelines: Option<ResMut<CompositePipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let Some(mut pipelines) = pipelines else { return };
    for (entity, camera, target, composite, buffers, known) in &cameras {
        let (p_map, p_log) = map_to_place(composite.p_scale, composite.levels.p);
        let (s_map, s_log) = map_to_place(composite.s_scale, composite.levels.s);
        let uniform = CompositeUniform {
            lut_size: [composite.lut.width, composite.lut.height],
            p_map,
            s_map,
            p_log,
            s_log: if composite.attribute { s_log } else { 2 },
            stride: buffers.stride,
            share: composite.last.filter(|_| buffers.shared.last.is_some()).unwrap_or(1.0),
            high: composite.levels.p[1] as f32,
            unused: 0,
        };
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let bytes = bytemuck::bytes_of(&uniform);
        let uniform = written(known.map(|known| &known.uniform), bytes, usage, &device, &queue);
        let lut = match known.map(|known| &known.lut) {
            Some(known) if known.0 == composite.lut => known.clone(),
            _ => {
                let texels = bytemuck::cast_slice(&composite.lut.rgba);
                (Arc::clone(&composite.lut), written(None, texels, BufferUsages::STORAGE, &device, &queue))
            }
        };
        let frame = Frame::new(known.map(|known| &known.frame), camera, composite.before.as_ref(), &device, &queue);
        let group = frame.group(&pipelines.0.layout, &coloring(&uniform, &lut.1, buffers), &cache, &device);
        let pipeline = pipelines.0.variant(target.main_texture_format(), &cache);
        commands.entity(entity).insert(CompositeBindings { group, pipeline, frame, uniform, lut });
    }
}

impl CompositeBindings {
    /// What passes bind that import `deepfield::colored`.
    pub(super) fn coloring<'a>(&'a self, buffers: &'a SplatBuffers) -> [&'a Buffer; 4] {
        coloring(&self.uniform, &self.lut.1, buffers)
    }
}

/// The same of a uniform and a table.
fn coloring<'a>(uniform: &'a Buffer, lut: &'a Buffer, buffers: &'a SplatBuffers) -> [&'a Buffer; 4] {
    // Nothing is read of the last one where all of the picture is seen.
    let last = buffers.shared.last.as_ref().unwrap_or(&buffers.shared.cells);
    [uniform, &buffers.shared.cells, lut, last]
}

/// Draws the colours of an accumulated picture into the camera's target.
pub fn composite_splats(
    view: ViewQuery<(&ViewTarget, &ExtractedCamera, &CompositeBindings, &Composite, &SplatView)>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let (target, camera, bindings, _, _) = view.into_inner();
    show(bindings.pipeline, &bindings.group, (target, camera), (&cache, &timer), &mut context);
}
