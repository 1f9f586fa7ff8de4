//! The mode on a graphics adapter: a component on the camera that shows it, a system that moves its ripples in every frame, and
//! two compute passes in place of deepfield's splat passes. Its colours are composed by deepfield's own pass.

use crate::{MODE, RIPPLES, SPEED};
use bevy::core_pipeline::core_3d::{main_opaque_pass_3d, main_transparent_pass_3d};
use bevy::core_pipeline::{Core3d, Core3dSystems};
use bevy::prelude::*;
use bevy::render::extract_component::ExtractComponent;
use bevy::render::render_resource::binding_types::{storage_buffer_sized, uniform_buffer_sized};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, BufferInitDescriptor, BufferUsages,
    CachedComputePipelineId, ComputePassDescriptor, ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::renderer::{RenderContext, RenderDevice, ViewQuery};
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems};
use bevy::window::RequestRedraw;
use bytemuck::{Pod, Zeroable};
use deepfield::gpu::ModePlugin;
use deepfield::gpu::composite::composite_splats;
use deepfield::gpu::shaders::{self, ShaderFile, Variant};
use deepfield::gpu::splat::constants::kernel_defs;
use deepfield::gpu::splat::{SplatBuffers, accumulate_splats, particle_layout, prepare_splats};
use deepfield::gpu::timing::PassTimer;
use deepfield::model::Kernel;
use std::collections::HashMap;
use std::num::NonZeroU64;
use std::sync::atomic::Ordering;

/// The mode's shader.
pub const SHADER: ShaderFile = ShaderFile {
    name: "brightest/brightest.wgsl",
    text: include_str!("brightest.wgsl"),
    file: concat!(env!("CARGO_MANIFEST_DIR"), "/src/brightest.wgsl"),
    variants: || {
        let variant =
            |kernel| Variant { path: "", defs: kernel_defs(kernel), subgroup: false, entries: vec!["find", "color"] };
        Kernel::ALL.map(variant).into()
    },
};

/// Adds the mode to an application.
pub fn plugin(app: &mut App) {
    shaders::add(app, SHADER);
    app.add_plugins(ModePlugin {
        mode: &MODE,
        component: |settings| Brightest {
            ripples: settings.number(&RIPPLES) as f32,
            speed_hz: settings.number(&SPEED) as f32,
            phase: 0.0,
        },
    })
    .add_systems(Update, run_ripples);
    let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
    render_app
        .add_systems(RenderStartup, init_pipelines)
        .add_systems(Render, prepare.in_set(RenderSystems::PrepareBindGroups).after(prepare_splats))
        .add_systems(
            Core3d,
            find_brightest
                .in_set(Core3dSystems::MainPass)
                .after(main_opaque_pass_3d)
                .after(accumulate_splats)
                .before(composite_splats)
                .before(main_transparent_pass_3d),
        );
}

/// On every camera that shows the mode, in both worlds.
#[derive(Component, Clone, Debug, PartialEq, ExtractComponent)]
pub struct Brightest {
    /// Ripples for each doubling of depth.
    pub ripples: f32,
    /// How many run past in a second.
    pub speed_hz: f32,
    /// How many have run past.
    pub phase: f32,
}

/// Moves the ripples, and asks for the next frame. Without a window there is no time that passes.
fn run_ripples(
    mut cameras: Query<&mut Brightest>,
    windows: Query<&Window>,
    time: Res<Time>,
    mut frames: MessageWriter<RequestRedraw>,
) {
    if windows.is_empty() {
        return;
    }
    for mut brightest in &mut cameras {
        let phase = (f64::from(brightest.speed_hz) * time.elapsed_secs_f64()).fract() as f32;
        if brightest.ripples > 0.0 {
            brightest.phase = phase;
            frames.write(RequestRedraw);
        }
    }
}

/// WGSL `Brightest`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Uniform {
    stride: u32,
    ripples: f32,
    phase: f32,
    unused: u32,
}

/// The layout of group 1, and for each kernel the pipelines of `find` and `color`.
#[derive(Resource)]
struct Pipelines {
    layout: BindGroupLayoutDescriptor,
    of_kernel: HashMap<Kernel, [CachedComputePipelineId; 2]>,
}

fn init_pipelines(mut commands: Commands, server: Res<AssetServer>, cache: Res<PipelineCache>) {
    let uniform = uniform_buffer_sized(false, NonZeroU64::new(size_of::<Uniform>() as u64));
    let entries =
        BindGroupLayoutEntries::sequential(ShaderStages::COMPUTE, (uniform, storage_buffer_sized(false, None)));
    let layout = BindGroupLayoutDescriptor::new("brightest", &entries);
    let shader = shaders::load(&server, SHADER.name);
    let pipelines = |kernel| {
        let of_entry = |entry: &'static str| {
            cache.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some("brightest".into()),
                layout: vec![particle_layout(), layout.clone()],
                shader: shader.clone(),
                shader_defs: kernel_defs(kernel),
                entry_point: Some(entry.into()),
                ..default()
            })
        };
        (kernel, ["find", "color"].map(of_entry))
    };
    let of_kernel = Kernel::ALL.into_iter().map(pipelines).collect();
    commands.insert_resource(Pipelines { layout, of_kernel });
}

/// Group 1 of a camera, and what it was made of.
#[derive(Component)]
struct Bindings {
    group: BindGroup,
    of: Brightest,
}

fn prepare(
    mut commands: Commands,
    cameras: Query<(Entity, &Brightest, Ref<SplatBuffers>, Option<&Bindings>)>,
    pipelines: Option<Res<Pipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let Some(pipelines) = pipelines else { return };
    for (entity, brightest, buffers, before) in &cameras {
        if before.is_some_and(|before| before.of == *brightest) && !buffers.is_changed() {
            continue;
        }
        // The ripples have moved, so the picture is another one.
        buffers.accumulated.store(false, Ordering::Relaxed);
        let Brightest { ripples, phase, .. } = *brightest;
        let uniform = Uniform { stride: buffers.stride, ripples, phase, unused: 0 };
        let uniform = device.create_buffer_with_data(&BufferInitDescriptor {
            label: Some("brightest"),
            contents: bytemuck::bytes_of(&uniform),
            usage: BufferUsages::UNIFORM,
        });
        let entries =
            BindGroupEntries::sequential((uniform.as_entire_binding(), buffers.shared.cells.as_entire_binding()));
        let group = device.create_bind_group("brightest", &cache.get_bind_group_layout(&pipelines.layout), &entries);
        commands.entity(entity).insert(Bindings { group, of: brightest.clone() });
    }
}

/// Fills the cells of the picture: `P` the largest value, `P S` that times the attribute of the particle that has it.
fn find_brightest(
    view: ViewQuery<(&SplatBuffers, &Bindings, &Brightest)>,
    pipelines: Option<Res<Pipelines>>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let (buffers, bindings, _) = view.into_inner();
    if buffers.accumulated.load(Ordering::Relaxed) && !buffers.always {
        return;
    }
    let ids = pipelines.as_ref().and_then(|pipelines| pipelines.of_kernel.get(&buffers.grids.shape.kernel));
    let Some([Some(find), Some(color)]) = ids.map(|ids| ids.map(|id| cache.get_compute_pipeline(id))) else { return };
    let encoder = context.command_encoder();
    let span = timer.begin("brightest", encoder);
    encoder.clear_buffer(&buffers.shared.cells, 0, None);
    for pipeline in [find, color] {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, &bindings.group, &[]);
        for batch in &buffers.particles {
            pass.set_bind_group(0, &batch.group, &[]);
            pass.dispatch_workgroups(batch.workgroups.0, batch.workgroups.1, 1);
        }
    }
    span.end(encoder);
    buffers.accumulated.store(true, Ordering::Relaxed);
}
