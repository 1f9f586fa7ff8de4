//! Counts the splats over each pixel of a camera's picture, in place of the picture: what the processor counts ([`crate::cpu::overdraw`]),
//! of the particles in the adapter's arena.
//!
//! A compute pass writes the numbers' differences, four for each splat; whoever reads them back sums them up.

use super::layout::SplatUniform;
use super::particles::particle_layout;
use super::pass::accumulate_splats;
use super::prepare::{SplatBuffers, prepare_splats};
use super::resources::at_least;
use crate::cpu::overdraw::Differences;
use crate::gpu::shaders;
use bevy::core_pipeline::core_3d::main_transparent_pass_3d;
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::{ExtractComponent, ExtractComponentPlugin};
use bevy::render::render_resource::binding_types::storage_buffer_sized;
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, Buffer, BufferUsages,
    CachedComputePipelineId, ComputePassDescriptor, ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::renderer::{RenderContext, RenderDevice, ViewQuery};
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bevy::shader::Shader;
use std::sync::atomic::{AtomicBool, Ordering};

/// Has the splats of a camera's picture counted; they are not drawn meanwhile (main world, extracted).
#[derive(Component, Clone, Copy, Debug, ExtractComponent)]
#[extract_component_sync_target((Self, OverdrawBuffers))]
pub struct CountOverdraw;

/// The differences of a camera's numbers (render world).
#[derive(Component)]
pub struct OverdrawBuffers {
    /// One `i32` for each of [`Differences`], row by row.
    pub differences: Buffer,
    /// The picture's width and height, pixels.
    pub size: [u32; 2],
    /// Set once all splats are counted.
    pub counted: AtomicBool,
    group: BindGroup,
}

impl OverdrawBuffers {
    /// Bytes of the differences.
    pub fn bytes(&self) -> u64 {
        bytes_of(self.size)
    }
}

fn bytes_of([width, height]: [u32; 2]) -> u64 {
    (Differences::count(width, height) * size_of::<i32>()) as u64
}

/// Adds the pass that counts.
pub struct OverdrawPlugin;

impl Plugin for OverdrawPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(ExtractComponentPlugin::<CountOverdraw>::default());
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .add_systems(RenderStartup, init_pipeline)
            .add_systems(Render, prepare_overdraw.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats))
            .add_systems(
                Core3d,
                count_overdraw
                    .in_set(Core3dSystems::MainPass)
                    .after(accumulate_splats)
                    .before(main_transparent_pass_3d),
            );
    }
}

/// The pipeline, compiled when first a camera's splats are counted.
#[derive(Resource)]
struct OverdrawPipeline {
    layout: BindGroupLayoutDescriptor,
    shader: Handle<Shader>,
    pipeline: Option<CachedComputePipelineId>,
}

/// Loads the shader at start-up, and again after a lost device.
fn init_pipeline(mut commands: Commands, server: Res<AssetServer>) {
    let entries = BindGroupLayoutEntries::single(ShaderStages::COMPUTE, storage_buffer_sized(false, None));
    commands.insert_resource(OverdrawPipeline {
        layout: BindGroupLayoutDescriptor::new("deepfield overdraw", &entries),
        shader: shaders::load(&server, "splat/overdraw.wgsl"),
        pipeline: None,
    });
}

fn prepare_overdraw(
    mut commands: Commands,
    cameras: Query<(Entity, Ref<SplatBuffers>, Option<&OverdrawBuffers>), With<CountOverdraw>>,
    pipeline: Option<ResMut<OverdrawPipeline>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let Some(mut pipeline) = pipeline else { return };
    for (entity, buffers, known) in &cameras {
        if known.is_some() && !buffers.is_changed() {
            continue;
        }
        if pipeline.pipeline.is_none() {
            pipeline.pipeline = Some(cache.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some("deepfield overdraw".into()),
                layout: vec![particle_layout(), pipeline.layout.clone()],
                shader: pipeline.shader.clone(),
                entry_point: Some("count".into()),
                ..default()
            }));
        }
        let SplatUniform { size, .. } = buffers.grids.uniform;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let before = known.map(|known| known.differences.clone());
        let differences = at_least(before, bytes_of(size), usage, "deepfield overdraw", &device);
        let group = device.create_bind_group(
            "deepfield overdraw",
            &cache.get_bind_group_layout(&pipeline.layout),
            &BindGroupEntries::single(differences.as_entire_binding()),
        );
        commands.entity(entity).insert(OverdrawBuffers { differences, size, counted: AtomicBool::new(false), group });
    }
}

/// Counts the splats of a camera's picture.
fn count_overdraw(
    view: ViewQuery<(&SplatBuffers, &OverdrawBuffers)>,
    pipeline: Option<Res<OverdrawPipeline>>,
    cache: Res<PipelineCache>,
    mut context: RenderContext,
) {
    let (buffers, overdraw) = view.into_inner();
    if overdraw.counted.load(Ordering::Relaxed) {
        return;
    }
    let compiled = pipeline.and_then(|pipeline| pipeline.pipeline).and_then(|id| cache.get_compute_pipeline(id));
    let Some(pipeline) = compiled else { return };
    let encoder = context.command_encoder();
    encoder.clear_buffer(&overdraw.differences, 0, None);
    let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
    pass.set_pipeline(pipeline);
    pass.set_bind_group(1, &overdraw.group, &[]);
    for batch in &buffers.particles {
        pass.set_bind_group(0, &batch.group, &[]);
        let (x, y) = batch.workgroups;
        pass.dispatch_workgroups(x, y, 1);
    }
    overdraw.counted.store(true, Ordering::Relaxed);
}
