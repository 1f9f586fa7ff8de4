//! Line integrals of sampled fields: what [`crate::cpu::field::xray`] draws on the processor.
//!
//! A camera with an [`IntegralView`] beside its [`SplatView`] has the integral of a field's values along each pixel's ray in its cells, in
//! place of what particles add up to. Rays read the level of the field whose samples lie as close as pixels where they pass it; each level
//! has a dispatch of its own.

pub mod layout;

use super::field_samples::HeldSamples;
use super::measure::measure_splats;
use super::news::News;
use super::shaders;
use super::splat::{SplatBuffers, accumulate_splats, prepare_splats};
use super::timing::PassTimer;
use super::view::SplatView;
use crate::cpu::field::Field;
use crate::view::View;
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::binding_types::{storage_buffer_sized, texture_3d, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, BufferId, BufferInitDescriptor,
    BufferUsages, CachedComputePipelineId, ComputePassDescriptor, ComputePipelineDescriptor, PipelineCache,
    ShaderStages, TextureSampleType,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use layout::{IntegralUniform, Sight};
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Invocations of a workgroup along each axis of the picture.
const GROUP: u32 = 8;

/// A camera with this draws line integrals of a field in place of its particles.
#[derive(Component, Clone, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, IntegralWork))]
pub struct IntegralView {
    /// The caller's name for the picture.
    pub number: u64,
    /// The samples; the first channel is drawn.
    pub field: Arc<Field>,
    /// Bytes of the adapter's memory that they may take.
    pub memory: u64,
}

/// What has been found out about a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct IntegralFindings {
    /// Its number.
    pub number: u64,
    /// By how many levels its samples are coarser than pixels ask for, since the adapter has no more memory.
    pub coarser: Option<usize>,
    /// Whether there was no room at all: then nothing is drawn.
    pub no_room: bool,
    /// Whether it has been drawn.
    pub is_drawn: bool,
}

/// What is known of line integrals.
pub type IntegralNews = News<IntegralFindings>;

/// Adds the pass that integrates.
pub struct IntegralPlugin;

impl Plugin for IntegralPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<IntegralView>::default());
        let news = app.world_mut().get_resource_or_init::<IntegralNews>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .insert_resource(news)
            .add_systems(RenderStartup, init_integral_pipeline)
            .add_systems(Render, prepare_integrals.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats))
            .add_systems(
                Core3d,
                integrate
                    .in_set(Core3dSystems::MainPass)
                    .after(main_opaque_pass_3d)
                    .after(accumulate_splats)
                    .before(measure_splats)
                    .before(main_transparent_pass_3d),
            );
    }
}

#[derive(Resource)]
struct IntegralPipeline {
    layout: BindGroupLayoutDescriptor,
    pipeline: CachedComputePipelineId,
}

/// Creates the pipeline at start-up, and again after a lost device.
fn init_integral_pipeline(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    cameras: Query<Entity, With<IntegralWork>>,
) {
    cameras.iter().for_each(|camera| {
        commands.entity(camera).remove::<IntegralWork>();
    });
    let layout = BindGroupLayoutDescriptor::new(
        "deepfield integrals",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                uniform_buffer_sized(false, NonZeroU64::new(size_of::<IntegralUniform>() as u64)),
                storage_buffer_sized(false, None),
                texture_3d(TextureSampleType::Uint),
            ),
        ),
    );
    let pipeline = cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: Some("deepfield integrals".into()),
        layout: vec![layout.clone()],
        shader: shaders::load(&server, "integrals/integrate.wgsl"),
        entry_point: Some("integrate".into()),
        ..ComputePipelineDescriptor::default()
    });
    commands.insert_resource(IntegralPipeline { layout, pipeline });
}

/// The integrals of a camera (render world).
#[derive(Component, Default)]
pub struct IntegralWork {
    samples: Option<HeldSamples>,
    /// What the groups are for.
    key: Option<(u64, View, BufferId)>,
    /// One for each level.
    groups: Vec<BindGroup>,
}

fn prepare_integrals(
    mut commands: Commands,
    mut cameras: Query<(Entity, &IntegralView, &SplatView, &SplatBuffers, Option<&mut IntegralWork>)>,
    pipeline: Option<Res<IntegralPipeline>>,
    news: Res<IntegralNews>,
    (cache, device, queue): (Res<PipelineCache>, Res<RenderDevice>, Res<RenderQueue>),
) {
    let Some(pipeline) = pipeline else { return };
    for (entity, wanted, shown, buffers, work) in &mut cameras {
        let Some(mut work) = work else {
            commands.entity(entity).insert(IntegralWork::default());
            continue;
        };
        let key = (wanted.number, shown.view, buffers.shared.cells.id());
        if work.key.replace(key) == Some(key) {
            continue;
        }
        buffers.accumulated.store(false, Ordering::Relaxed);
        let sight = Sight::new(&shown.view, &wanted.field);
        let levels = sight.levels().collect();
        let means = (&*device, &*queue);
        let finest = HeldSamples::load(&mut work.samples, (&wanted.field, None), &levels, wanted.memory, means);
        let number = wanted.number;
        let Some(finest) = finest else {
            work.groups.clear();
            *news.lock() = IntegralFindings { number, no_room: true, ..IntegralFindings::default() };
            continue;
        };
        let coarser = Some(finest.missing(&levels)).filter(|missing| *missing > 0);
        *news.lock() = IntegralFindings { number, coarser, ..IntegralFindings::default() };
        let ends = sight.levels();
        let drawn = finest.in_place_of(*ends.start())..=finest.in_place_of(*ends.end());
        let layout = cache.get_bind_group_layout(&pipeline.layout);
        let group = |level: usize| {
            let [samples, _] = work.samples.as_ref()?.of_level(level)?;
            let uniform = device.create_buffer_with_data(&BufferInitDescriptor {
                label: Some("deepfield integrals"),
                contents: bytemuck::bytes_of(&sight.uniform(level, &drawn)),
                usage: BufferUsages::UNIFORM,
            });
            let cells = buffers.shared.cells.as_entire_binding();
            let entries = BindGroupEntries::sequential((uniform.as_entire_binding(), cells, &samples));
            Some(device.create_bind_group("deepfield integrals", &layout, &entries))
        };
        let groups = drawn.clone().filter_map(group).collect();
        work.groups = groups;
    }
}

/// Draws the integrals of a camera's field.
fn integrate(
    view: ViewQuery<(&SplatBuffers, &SplatView, &IntegralWork)>,
    pipeline: Option<Res<IntegralPipeline>>,
    (cache, timer, news): (Res<PipelineCache>, Res<PassTimer>, Res<IntegralNews>),
    mut context: RenderContext,
) {
    let (buffers, shown, work) = view.into_inner();
    if work.key.is_none() || buffers.accumulated.load(Ordering::Relaxed) && !buffers.always {
        return;
    }
    let Some(pipeline) = pipeline.and_then(|pipeline| cache.get_compute_pipeline(pipeline.pipeline)) else { return };
    let encoder = context.command_encoder();
    let span = timer.begin("integrate", encoder);
    // Rays that miss the field leave nothing.
    encoder.clear_buffer(&buffers.shared.cells, 0, None);
    {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(pipeline);
        let [x, y] = [shown.view.width, shown.view.height].map(|pixels| pixels.div_ceil(GROUP));
        for group in &work.groups {
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(x, y, 1);
        }
    }
    span.end(encoder);
    buffers.accumulated.store(true, Ordering::Relaxed);
    let mut found = news.lock();
    found.is_drawn = !found.no_room && work.key.as_ref().is_some_and(|(number, ..)| found.number == *number);
}
