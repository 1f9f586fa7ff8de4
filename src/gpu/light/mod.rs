//! Pictures of modes that draw light: passes of a mode fill a camera's [`LightCells`], and [`show_light`] shows them.

use super::splat::prepare_splats;
use super::target::{Frame, ShowPipelines, show, written};
use super::timing::PassTimer;
use super::view::Fading;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::camera::ExtractedCamera;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::{
    BindGroup, Buffer, BufferDescriptor, BufferUsages, CachedRenderPipelineId, PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::ViewTarget;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bytemuck::{Pod, Zeroable};

/// Light and opacity of each pixel that a camera's passes have drawn (render world, on the camera): linear, premultiplied, row
/// by row from the top, `vec4<f32>` each. Whoever inserts it orders itself before [`prepare_light`], whoever fills it before
/// [`show_light`].
#[derive(Component)]
pub struct LightCells {
    /// The pixels; a storage buffer that can be copied from.
    pub buffer: Buffer,
    /// Width and height, pixels: those of the target, or fewer, which are stretched.
    pub size: [u32; 2],
    /// Whether all of the picture is in it.
    pub complete: bool,
}

/// Cells of a picture of so many pixels, not complete yet; the buffer is that of the picture before where it is as large.
pub fn cells(before: Option<&LightCells>, size: [u32; 2], device: &RenderDevice) -> LightCells {
    let buffer = match before {
        Some(before) if before.size == size => before.buffer.clone(),
        _ => device.create_buffer(&BufferDescriptor {
            label: Some("deepfield light"),
            size: 16 * u64::from(size[0]) * u64::from(size[1]),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        }),
    };
    LightCells { buffer, size, complete: false }
}

/// A camera with this shows its [`LightCells`] in its target, and its particles are drawn by a mode's passes, not by the splat
/// passes (main world, extracted).
#[derive(Component, Clone, Debug, Default, PartialEq, ExtractComponent)]
#[extract_component_sync_target((Self, LightCells, LightBindings))]
pub struct LightView {
    /// The picture that this one takes the place of.
    pub before: Option<Fading>,
}

/// WGSL `LightPicture`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LightUniform {
    /// Width and height, pixels.
    pub size: [u32; 2],
}

/// Adds the pass that shows light.
pub struct LightPlugin;

impl Plugin for LightPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<LightView>::default());
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .add_systems(RenderStartup, init_light_pipelines)
            .add_systems(Render, prepare_light.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats))
            .add_systems(
                Core3d,
                show_light.in_set(Core3dSystems::MainPass).after(main_opaque_pass_3d).before(main_transparent_pass_3d),
            );
    }
}

/// The pass that shows light, for each format of targets.
#[derive(Resource)]
pub struct LightPipelines(ShowPipelines);

fn init_light_pipelines(mut commands: Commands, server: Res<AssetServer>) {
    let pipelines = ShowPipelines::new(&server, "composite/light.wgsl", size_of::<LightUniform>(), 1);
    commands.insert_resource(LightPipelines(pipelines));
}

/// What shows the light of one camera.
#[derive(Component)]
pub struct LightBindings {
    group: BindGroup,
    pipeline: CachedRenderPipelineId,
    frame: Frame,
    uniform: Buffer,
}

/// Prepares every camera that shows light.
pub fn prepare_light(
    mut commands: Commands,
    cameras: Query<(Entity, &ExtractedCamera, &ViewTarget, &LightView, &LightCells, Option<&LightBindings>)>,
    pipelines: Option<ResMut<LightPipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let Some(mut pipelines) = pipelines else { return };
    for (entity, camera, target, light, cells, known) in &cameras {
        let uniform = LightUniform { size: cells.size };
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let bytes = bytemuck::bytes_of(&uniform);
        let uniform = written(known.map(|known| &known.uniform), bytes, usage, &device, &queue);
        let frame = Frame::new(known.map(|known| &known.frame), camera, light.before.as_ref(), &device, &queue);
        let others = [&uniform, &cells.buffer];
        let group = frame.group(&pipelines.0.layout, &others, &cache, &device);
        let pipeline = pipelines.0.variant(target.main_texture_format(), &cache);
        commands.entity(entity).insert(LightBindings { group, pipeline, frame, uniform });
    }
}

/// Draws the light of a camera's passes into its target.
pub fn show_light(
    view: ViewQuery<(&ViewTarget, &ExtractedCamera, &LightBindings, &LightView, &LightCells)>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let (target, camera, bindings, _, _) = view.into_inner();
    show(bindings.pipeline, &bindings.group, (target, camera), (&cache, &timer), &mut context);
}
