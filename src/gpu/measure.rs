//! What a picture of splats is made of: its cells in fewer pixels, read back without waiting, for ranges of colours and histograms.
//!
//! A camera with [`Measure`] has every picture measured that it accumulates, but for those that come while one is being read.

use super::answer::Answer;
use super::news::News;
use super::shaders;
use super::splat::resources::at_least;
use super::splat::{SplatBuffers, accumulate_splats, prepare_splats};
use super::timing::PassTimer;
use super::view::{DrawItem, Footprint, SplatView};
use crate::color::Accumulation;
use crate::view::View;
use bevy::core_pipeline::core_3d::main_transparent_pass_3d;
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, Buffer, BufferUsages,
    CachedComputePipelineId, ComputePassDescriptor, ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery};
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bytemuck::{Pod, Zeroable};
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::Poll;

/// Longest side of what is read back, pixels.
const SIDE: u32 = 320;
/// Invocations of a workgroup, along each axis.
const GROUP: u32 = 8;

/// Has a camera's pictures measured (main world, extracted).
#[derive(Component, Clone, Copy, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, Measurement))]
pub struct Measure;

/// A picture that has been measured.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Its camera and pixels.
    pub view: View,
    /// What it was drawn of; another list, though equal, is another picture.
    pub items: Arc<[DrawItem]>,
    /// `P` and `P S` in fewer pixels.
    pub cells: Accumulation,
}

/// The last picture that has been measured.
pub type MeasuredPicture = News<Option<Arc<Measured>>>;

/// WGSL `Reduction`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Reduction {
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Width and height of what is made of it.
    pub reduced: [u32; 2],
    /// Cells from a row of the picture to the next.
    pub stride: u32,
    /// Pixels along each side that one pixel stands for.
    pub side: u32,
    /// 1: one of them is taken as it is.
    pub one: u32,
    /// Padding.
    pub unused: u32,
}

impl Reduction {
    fn new(view: &View, footprint: Footprint, stride: u32) -> Reduction {
        let size = [view.width, view.height];
        let side = view.width.max(view.height).div_ceil(SIDE).max(1);
        let one = u32::from(matches!(footprint, Footprint::Pixels { .. }));
        Reduction { size, reduced: size.map(|pixels| pixels.div_ceil(side)), stride, side, one, unused: 0 }
    }
}

/// Adds the pass that measures.
pub struct MeasurePlugin;

impl Plugin for MeasurePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<Measure>::default());
        let measured = app.world_mut().get_resource_or_init::<MeasuredPicture>().clone();
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .insert_resource(measured)
            .add_systems(RenderStartup, init_measure_pipeline)
            .add_systems(
                Render,
                (
                    prepare_measurements.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats),
                    ask_for_cells.in_set(RenderSystems::Cleanup),
                ),
            )
            .add_systems(
                Core3d,
                measure_splats
                    .in_set(Core3dSystems::MainPass)
                    .after(accumulate_splats)
                    .before(main_transparent_pass_3d),
            );
    }
}

/// The pass that measures.
#[derive(Resource)]
pub struct MeasurePipeline {
    layout: BindGroupLayoutDescriptor,
    pipeline: CachedComputePipelineId,
}

/// Creates the pipeline at start-up, and again after a lost device.
fn init_measure_pipeline(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    cameras: Query<Entity, With<Measurement>>,
) {
    cameras.iter().for_each(|camera| {
        commands.entity(camera).remove::<Measurement>();
    });
    let layout = BindGroupLayoutDescriptor::new(
        "deepfield measure",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                uniform_buffer_sized(false, NonZeroU64::new(size_of::<Reduction>() as u64)),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_sized(false, None),
            ),
        ),
    );
    let pipeline = cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: Some("deepfield measure".into()),
        layout: vec![layout.clone()],
        shader: shaders::load(&server, "measure/reduce.wgsl"),
        entry_point: Some("reduce".into()),
        ..ComputePipelineDescriptor::default()
    });
    commands.insert_resource(MeasurePipeline { layout, pipeline });
}

/// The measurement of a camera's picture (render world).
#[derive(Component)]
pub struct Measurement {
    view: View,
    items: Arc<[DrawItem]>,
    reduction: Reduction,
    group: BindGroup,
    uniform: Buffer,
    reduced: Buffer,
    answer: Answer,
}

fn prepare_measurements(
    mut commands: Commands,
    cameras: Query<(Entity, Ref<SplatBuffers>, &SplatView, Option<&Measurement>), With<Measure>>,
    pipeline: Option<Res<MeasurePipeline>>,
    measured: Res<MeasuredPicture>,
    (cache, device, queue): (Res<PipelineCache>, Res<RenderDevice>, Res<RenderQueue>),
) {
    let Some(pipeline) = pipeline else { return };
    for (entity, buffers, view, known) in &cameras {
        if let Some(known) = known {
            match known.answer.take() {
                Poll::Ready(Some(bytes)) => {
                    let items = Arc::clone(&known.items);
                    let found = Measured { view: known.view, items, cells: known.cells(&bytes) };
                    *measured.lock() = Some(Arc::new(found));
                }
                // What cannot be read is measured again with the next picture.
                Poll::Ready(None) => {}
                Poll::Pending if known.answer.is_open() => {}
                // A picture that comes while one is being read is measured after it.
                Poll::Pending => continue,
            }
            let same = known.view == view.view && Arc::ptr_eq(&known.items, &view.items);
            if same && !buffers.is_changed() {
                continue;
            }
        }
        let reduction = Reduction::new(&view.view, view.footprint, buffers.stride);
        let [width, height] = reduction.reduced.map(u64::from);
        let bytes = 8 * width * height;
        let kept = |buffer: fn(&Measurement) -> &Buffer| known.map(|known| buffer(known).clone());
        let uniforms = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let size = size_of::<Reduction>() as u64;
        let uniform = at_least(kept(|known| &known.uniform), size, uniforms, "deepfield reduction", &device);
        queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&reduction));
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let reduced = at_least(kept(|known| &known.reduced), bytes, usage, "deepfield reduced picture", &device);
        let answer = Answer::new(bytes, "deepfield measured picture", &device);
        let group = device.create_bind_group(
            "deepfield measure",
            &cache.get_bind_group_layout(&pipeline.layout),
            &BindGroupEntries::sequential((
                uniform.as_entire_binding(),
                buffers.shared.cells.as_entire_binding(),
                reduced.as_entire_binding(),
            )),
        );
        commands.entity(entity).insert(Measurement {
            view: view.view,
            items: Arc::clone(&view.items),
            reduction,
            group,
            uniform,
            reduced,
            answer,
        });
    }
}

/// Reduces a picture that is complete.
pub fn measure_splats(
    view: ViewQuery<(&SplatBuffers, &Measurement)>,
    pipeline: Option<Res<MeasurePipeline>>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let (buffers, measurement) = view.into_inner();
    if !measurement.answer.is_open() || !buffers.accumulated.load(Ordering::Relaxed) {
        return;
    }
    let Some(pipeline) = pipeline.and_then(|pipeline| cache.get_compute_pipeline(pipeline.pipeline)) else { return };
    let encoder = context.command_encoder();
    let span = timer.begin("measure", encoder);
    {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &measurement.group, &[]);
        let [x, y] = measurement.reduction.reduced.map(|pixels| pixels.div_ceil(GROUP));
        pass.dispatch_workgroups(x, y, 1);
    }
    let answer = measurement.answer.buffer();
    encoder.copy_buffer_to_buffer(&measurement.reduced, 0, answer, 0, answer.size());
    span.end(encoder);
    measurement.answer.copied();
}

/// Asks for what has been copied.
fn ask_for_cells(cameras: Query<&Measurement>) {
    cameras.iter().for_each(|measurement| measurement.answer.ask());
}

impl Measurement {
    /// The cells that have been read.
    fn cells(&self, bytes: &[u8]) -> Accumulation {
        let [width, height] = self.reduction.reduced;
        let mut cells = Accumulation::new(width, height, true);
        let (words, _) = bytes.as_chunks::<8>();
        for (word, (p, ps)) in words.iter().zip(cells.p.iter_mut().zip(&mut cells.ps)) {
            let [a, b, c, d, e, f, g, h] = *word;
            (*p, *ps) = (f32::from_le_bytes([a, b, c, d]), f32::from_le_bytes([e, f, g, h]));
        }
        cells
    }
}
