//! Bloom: bright light of what a camera shows spreads over its surroundings, by the processor's arithmetic ([`crate::color::bloom`]).
//!
//! A camera with a [`Glow`] shows its light so, over what [`show_light`] or [`composite_splats`] have shown, which is seen until the passes'
//! shaders are there:
//!
//! 1. `light`: what sums are in their colours, before it is cut to what a screen shows; light of a mode's passes is copied.
//! 2. `down`: what of it is bright goes to ever coarser levels.
//! 3. `up`: each level takes back what has spread on coarser ones.
//! 4. `spread`: the picture changes by what has spread, and is as dark as a screen then.

pub mod levels;

use super::composite::{CompositeBindings, CompositeUniform, composite_splats, prepare_composites};
use super::light::{LightCells, LightUniform, LightView, prepare_light, show_light};
use super::shaders;
use super::splat::SplatBuffers;
use super::splat::resources::{ALIGNMENT, slice};
use super::target::{Frame, ShowPipelines, show, written};
use super::timing::PassTimer;
use super::view::{Composite, SplatView};
use crate::color::Bloom;
use bevy::core_pipeline::core_3d::main_transparent_pass_3d;
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::camera::ExtractedCamera;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, Buffer, BufferDescriptor,
    BufferInitDescriptor, BufferUsages, CachedComputePipelineId, CachedRenderPipelineId, ComputePassDescriptor,
    ComputePipeline, ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::view::ViewTarget;
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bevy::shader::ShaderDefVal;
use levels::{LevelUniform, Levels};
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The name of its time.
pub const PASS: &str = "bloom";
/// Invocations of a workgroup, along each axis.
const GROUP: u32 = 8;
/// Bytes of a level.
const LEVEL_BYTES: u64 = size_of::<LevelUniform>() as u64;
/// Bytes of a pixel's light.
const LIGHT_BYTES: u64 = 16;

/// A camera with this shows how its light spreads (main world, extracted).
#[derive(Component, Clone, Copy, Debug, PartialEq, ExtractComponent)]
#[extract_component_sync_target((Self, GlowWork))]
pub struct Glow(pub Bloom);

/// Whether an adapter can hold what pictures of this size need.
pub fn has_room([width, height]: [u32; 2], device: &RenderDevice) -> bool {
    LIGHT_BYTES * u64::from(width) * u64::from(height) <= device.limits().max_storage_buffer_binding_size
}

/// Shader definitions of its passes.
pub fn defs() -> Vec<ShaderDefVal> {
    vec![ShaderDefVal::UInt("GROUP".into(), GROUP)]
}

/// Adds the passes of bloom.
pub struct BloomPlugin;

impl Plugin for BloomPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<Glow>::default());
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .add_systems(RenderStartup, init_bloom_pipelines)
            .add_systems(
                Render,
                prepare_glow.in_set(RenderSystems::PrepareBindGroups).after(prepare_light).after(prepare_composites),
            )
            .add_systems(
                Core3d,
                show_glow
                    .in_set(Core3dSystems::MainPass)
                    .after(show_light)
                    .after(composite_splats)
                    .before(main_transparent_pass_3d),
            );
    }
}

#[derive(Resource)]
struct BloomPipelines {
    sums: BindGroupLayoutDescriptor,
    levels: BindGroupLayoutDescriptor,
    light: CachedComputePipelineId,
    down: CachedComputePipelineId,
    up: CachedComputePipelineId,
    spread: CachedComputePipelineId,
    show: ShowPipelines,
}

/// Creates the pipelines at start-up, and again after a lost device.
fn init_bloom_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    cameras: Query<Entity, With<GlowWork>>,
) {
    cameras.iter().for_each(|camera| {
        commands.entity(camera).remove::<GlowWork>();
    });
    let level = || uniform_buffer_sized(true, NonZeroU64::new(LEVEL_BYTES));
    let composite = || uniform_buffer_sized(false, NonZeroU64::new(size_of::<CompositeUniform>() as u64));
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let sums = BindGroupLayoutDescriptor::new(
        "deepfield bloom of sums",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (level(), write(), composite(), read(), read(), read()),
        ),
    );
    let levels = BindGroupLayoutDescriptor::new(
        "deepfield bloom",
        &BindGroupLayoutEntries::sequential(ShaderStages::COMPUTE, (level(), write(), read(), read(), write())),
    );
    let pipeline = |layout: &BindGroupLayoutDescriptor, path: &str, entry: &'static str| {
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some("deepfield bloom".into()),
            layout: vec![layout.clone()],
            shader: shaders::load(&server, path),
            shader_defs: defs(),
            entry_point: Some(entry.into()),
            ..ComputePipelineDescriptor::default()
        })
    };
    let light = pipeline(&sums, "bloom/light.wgsl", "light");
    let [down, up, spread] = ["down", "up", "spread"].map(|entry| pipeline(&levels, "bloom/spread.wgsl", entry));
    let show = ShowPipelines::new(&server, "composite/light.wgsl", size_of::<LightUniform>(), 1);
    commands.insert_resource(BloomPipelines { sums, levels, light, down, up, spread, show });
}

/// What the light of one camera goes through (render world).
#[derive(Component)]
pub struct GlowWork {
    held: Held,
    source: Source,
    levels: BindGroup,
    shown: BindGroup,
    pipeline: CachedRenderPipelineId,
    frame: Frame,
    uniform: Buffer,
    /// Set once what is shown glows.
    pub is_shown: AtomicBool,
}

/// Where light comes from.
enum Source {
    /// The light of a mode's passes.
    Light(Buffer),
    /// Sums and their colours.
    Sums(BindGroup),
}

/// What stays while pictures have the same size.
#[derive(Clone)]
struct Held {
    size: [u32; 2],
    bloom: Bloom,
    steps: Arc<[LevelUniform]>,
    uniforms: Buffer,
    givers: Buffer,
    takers: Buffer,
    planes: Buffer,
    lit: Buffer,
}

impl Held {
    fn new(size: [u32; 2], bloom: Bloom, device: &RenderDevice) -> Held {
        let levels = Levels::new(size, &bloom);
        let mut uniforms = vec![0; levels.uniforms.len() * ALIGNMENT as usize];
        for (level, bytes) in levels.uniforms.iter().zip(uniforms.chunks_exact_mut(ALIGNMENT as usize)) {
            bytes[..size_of::<LevelUniform>()].copy_from_slice(bytemuck::bytes_of(level));
        }
        let label = Some("deepfield bloom");
        let made = |contents: &[u8], usage: BufferUsages| {
            device.create_buffer_with_data(&BufferInitDescriptor { label, contents, usage })
        };
        let empty = |pixels: u64, more: BufferUsages| {
            let usage = BufferUsages::STORAGE | more;
            device.create_buffer(&BufferDescriptor {
                label,
                size: LIGHT_BYTES * pixels,
                usage,
                mapped_at_creation: false,
            })
        };
        Held {
            size,
            bloom,
            uniforms: made(&uniforms, BufferUsages::UNIFORM),
            givers: made(bytemuck::cast_slice(&levels.givers), BufferUsages::STORAGE),
            takers: made(bytemuck::cast_slice(&levels.takers), BufferUsages::STORAGE),
            planes: empty(u64::from(levels.pixels), BufferUsages::empty()),
            lit: empty(u64::from(size[0]) * u64::from(size[1]), BufferUsages::COPY_DST),
            steps: levels.uniforms.into(),
        }
    }
}

fn prepare_glow(
    mut commands: Commands,
    cameras: Query<(
        Entity,
        (&ExtractedCamera, &ViewTarget),
        &Glow,
        Option<(&LightView, &LightCells)>,
        Option<(&SplatView, &SplatBuffers, &Composite, &CompositeBindings)>,
        Option<&GlowWork>,
    )>,
    pipelines: Option<ResMut<BloomPipelines>>,
    (cache, device, queue): (Res<PipelineCache>, Res<RenderDevice>, Res<RenderQueue>),
) {
    let Some(mut pipelines) = pipelines else { return };
    for (entity, (camera, target), &Glow(bloom), light, sums, known) in &cameras {
        let wanted = match (light, sums) {
            (Some((light, cells)), _) => Some((cells.size, &light.before)),
            (None, Some((splats, _, composite, _))) => {
                Some(([splats.view.width, splats.view.height], &composite.before))
            }
            (None, None) => None,
        };
        let wanted = wanted.filter(|(size, _)| !bloom.is_off() && !size.contains(&0) && has_room(*size, &device));
        let Some((size, before)) = wanted else {
            commands.entity(entity).remove::<GlowWork>();
            continue;
        };
        let held = match known.map(|known| &known.held) {
            Some(held) if held.size == size && held.bloom == bloom => held.clone(),
            _ => Held::new(size, bloom, &device),
        };
        let level = slice(&held.uniforms, 0, LEVEL_BYTES);
        let levels = device.create_bind_group(
            "deepfield bloom",
            &cache.get_bind_group_layout(&pipelines.levels),
            &BindGroupEntries::sequential((
                level.clone(),
                held.lit.as_entire_binding(),
                held.givers.as_entire_binding(),
                held.takers.as_entire_binding(),
                held.planes.as_entire_binding(),
            )),
        );
        let source = match (light, sums) {
            (Some((_, cells)), _) => Source::Light(cells.buffer.clone()),
            (None, Some((_, buffers, _, bindings))) => {
                let [uniform, cells, lut, last] = bindings.coloring(buffers).map(|buffer| buffer.as_entire_binding());
                Source::Sums(device.create_bind_group(
                    "deepfield bloom of sums",
                    &cache.get_bind_group_layout(&pipelines.sums),
                    &BindGroupEntries::sequential((level, held.lit.as_entire_binding(), uniform, cells, lut, last)),
                ))
            }
            (None, None) => continue,
        };
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = LightUniform { size };
        let bytes = bytemuck::bytes_of(&uniform);
        let uniform = written(known.map(|known| &known.uniform), bytes, usage, &device, &queue);
        let frame = Frame::new(known.map(|known| &known.frame), camera, before.as_ref(), &device, &queue);
        let shown = frame.group(&pipelines.show.layout, &[&uniform, &held.lit], &cache, &device);
        let pipeline = pipelines.show.variant(target.main_texture_format(), &cache);
        let is_shown = AtomicBool::new(known.is_some_and(|known| known.is_shown.load(Ordering::Relaxed)));
        commands.entity(entity).insert(GlowWork { held, source, levels, shown, pipeline, frame, uniform, is_shown });
    }
}

/// Spreads the light of a camera's picture and draws it into the camera's target.
fn show_glow(
    view: ViewQuery<(&ViewTarget, &ExtractedCamera, &GlowWork)>,
    pipelines: Option<Res<BloomPipelines>>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let (target, camera, work) = view.into_inner();
    let Some(pipelines) = pipelines else { return };
    let BloomPipelines { light, down, up, spread, .. } = *pipelines;
    let found = [light, down, up, spread].map(|pipeline| cache.get_compute_pipeline(pipeline));
    let [Some(light), Some(down), Some(up), Some(spread)] = found else { return };
    if cache.get_render_pipeline(work.pipeline).is_none() {
        return;
    }
    let Held { size, steps, lit, .. } = &work.held;
    let encoder = context.command_encoder();
    let span = timer.begin(PASS, encoder);
    if let Source::Light(cells) = &work.source {
        encoder.copy_buffer_to_buffer(cells, 0, lit, 0, lit.size());
    }
    {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        let mut step = |pipeline: &ComputePipeline, group: &BindGroup, level: usize, size: [u32; 2]| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[level as u32 * ALIGNMENT as u32]);
            let [x, y] = size.map(|pixels| pixels.div_ceil(GROUP));
            pass.dispatch_workgroups(x, y, 1);
        };
        if let Source::Sums(group) = &work.source {
            step(light, group, 0, *size);
        }
        for (index, level) in steps.iter().enumerate() {
            step(down, &work.levels, index, level.coarse);
        }
        for (index, level) in steps.iter().enumerate().skip(1).rev() {
            step(up, &work.levels, index, level.fine);
        }
        step(spread, &work.levels, 0, *size);
    }
    span.end(encoder);
    show(work.pipeline, &work.shown, (target, camera), (&cache, &timer), &mut context);
    work.is_shown.store(true, Ordering::Relaxed);
}
