//! Layouts and pipelines of the passes that list particles by tiles.

use super::layout::{Portion, TileUniform};
use crate::gpu::shaders;
use crate::gpu::splat::{SplatPipelines, particle_layout};
use bevy::asset::AssetServer;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntryBuilder, CachedComputePipelineId, ComputePipeline,
    ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::{Render, RenderStartup, RenderSystems};
use bevy::shader::ShaderDefVal;
use std::num::NonZeroU64;

/// One entry point of a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Counts the particles of each interval of depths, one workgroup a block.
    Survey,
    /// Counts the particles of each block, one workgroup a block.
    Count,
    /// Writes them, one workgroup a block.
    Gather,
    /// Finds slabs of depth, one invocation.
    Divide,
    /// Numbers of particles, one invocation.
    Settle,
    /// Numbers of pairs, one invocation.
    SettlePairs,
    /// Sums a list, one workgroup for 1024 numbers.
    SumList,
    /// Sums these sums, one workgroup.
    ScanParts,
    /// What is before each number of a list, one workgroup for 1024.
    SpreadList,
    /// Keys of depth, one invocation a particle.
    NumberSpots,
    /// Counts pairs, one invocation a particle.
    CountPairs,
    /// Writes pairs, one invocation a particle.
    WritePairs,
    /// Finds where bins begin, one invocation a pair.
    FindRanges,
    /// Counts digits, one workgroup for 1024 keys.
    Tally,
    /// Moves what is sorted, one workgroup for 1024 keys.
    MovePairs,
}

/// What a step binds; steps of the same kind share it, and their shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `gather.wgsl`, behind the particles' group.
    Gather,
    /// `plan.wgsl`.
    Plan,
    /// `scan.wgsl`.
    Scan,
    /// `pairs.wgsl`.
    Pairs,
    /// `sort.wgsl`.
    Sort,
}

impl Step {
    /// Every step, in the order of their numbers.
    pub const ALL: [Step; 15] = [
        Step::Survey,
        Step::Count,
        Step::Gather,
        Step::Divide,
        Step::Settle,
        Step::SettlePairs,
        Step::SumList,
        Step::ScanParts,
        Step::SpreadList,
        Step::NumberSpots,
        Step::CountPairs,
        Step::WritePairs,
        Step::FindRanges,
        Step::Tally,
        Step::MovePairs,
    ];

    /// Its kind and the name of its entry point.
    pub const fn entry(self) -> (Kind, &'static str) {
        match self {
            Step::Survey => (Kind::Gather, "survey"),
            Step::Count => (Kind::Gather, "count"),
            Step::Gather => (Kind::Gather, "gather"),
            Step::Divide => (Kind::Plan, "divide"),
            Step::Settle => (Kind::Plan, "settle"),
            Step::SettlePairs => (Kind::Plan, "settle_pairs"),
            Step::SumList => (Kind::Scan, "sum_list"),
            Step::ScanParts => (Kind::Scan, "scan_parts"),
            Step::SpreadList => (Kind::Scan, "spread_list"),
            Step::NumberSpots => (Kind::Pairs, "number_spots"),
            Step::CountPairs => (Kind::Pairs, "count_pairs"),
            Step::WritePairs => (Kind::Pairs, "write_pairs"),
            Step::FindRanges => (Kind::Pairs, "find_ranges"),
            Step::Tally => (Kind::Sort, "tally"),
            Step::MovePairs => (Kind::Sort, "move_pairs"),
        }
    }
}

impl Kind {
    /// Every kind.
    pub const ALL: [Kind; 5] = [Kind::Gather, Kind::Plan, Kind::Scan, Kind::Pairs, Kind::Sort];

    /// The path of its shader.
    pub const fn shader(self) -> &'static str {
        match self {
            Kind::Gather => "tiles/gather.wgsl",
            Kind::Plan => "tiles/plan.wgsl",
            Kind::Scan => "sort/scan.wgsl",
            Kind::Pairs => "tiles/pairs.wgsl",
            Kind::Sort => "volume/sort.wgsl",
        }
    }

    /// Its bindings, in the last group.
    pub fn layout(self) -> BindGroupLayoutDescriptor {
        let list = match self {
            Kind::Gather => vec![tile_view(), portion(), read(), write(), write()],
            Kind::Plan => vec![portion(), read(), write(), write()],
            Kind::Scan => vec![portion(), write(), write()],
            Kind::Pairs => vec![tile_view(), read(), read(), write(), write(), write(), write(), read()],
            Kind::Sort => vec![portion(), read(), read(), read(), write(), write(), write()],
        };
        layout(self.shader(), list)
    }
}

/// A layout of compute passes with bindings one after the other.
pub fn layout(label: &'static str, list: Vec<BindGroupLayoutEntryBuilder>) -> BindGroupLayoutDescriptor {
    let numbered = (0..).zip(list);
    let entries: Vec<_> = numbered.map(|(index, builder)| builder.build(index, ShaderStages::COMPUTE)).collect();
    BindGroupLayoutDescriptor::new(label, &entries)
}

/// A uniform of so many bytes, which may move.
pub fn uniform(bytes: usize, moves: bool) -> BindGroupLayoutEntryBuilder {
    uniform_buffer_sized(moves, NonZeroU64::new(bytes as u64))
}

/// The view's uniform.
pub fn tile_view() -> BindGroupLayoutEntryBuilder {
    uniform(size_of::<TileUniform>(), false)
}

/// What differs between dispatches.
pub fn portion() -> BindGroupLayoutEntryBuilder {
    uniform(size_of::<Portion>(), true)
}

/// A buffer that is read.
pub fn read() -> BindGroupLayoutEntryBuilder {
    storage_buffer_read_only_sized(false, None)
}

/// A buffer that is written.
pub fn write() -> BindGroupLayoutEntryBuilder {
    storage_buffer_sized(false, None)
}

/// The bindings of passes that bring particles into their order: the view, the number of particles, the particles, their order,
/// what becomes of them, and the tiles that they reach.
pub fn arrange_layout() -> BindGroupLayoutDescriptor {
    layout("deepfield arrange", vec![tile_view(), read(), read(), read(), write(), write()])
}

/// The bindings of passes that walk over each tile's particles: those of `deepfield::tile_walk`, and the particles in order.
pub fn walk_layout() -> BindGroupLayoutDescriptor {
    layout("deepfield walk", vec![tile_view(), read(), read(), write(), read()])
}

/// Has a pipeline compiled.
pub fn queue(
    cache: &PipelineCache,
    server: &AssetServer,
    (shader, entry): (&'static str, &'static str),
    layout: Vec<BindGroupLayoutDescriptor>,
    shader_defs: Vec<ShaderDefVal>,
) -> CachedComputePipelineId {
    cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: Some(entry.into()),
        layout,
        shader: shaders::load(server, shader),
        shader_defs,
        entry_point: Some(entry.into()),
        ..default()
    })
}

/// The pipelines.
#[derive(Resource)]
pub struct TilePipelines {
    steps: [CachedComputePipelineId; Step::ALL.len()],
    /// Whether a processor is the adapter.
    pub is_software: bool,
}

/// Compiled pipelines.
#[derive(Clone, Copy)]
pub struct Steps<'a>([&'a ComputePipeline; Step::ALL.len()]);

impl<'a> Steps<'a> {
    /// That of a step.
    pub fn get(&self, step: Step) -> &'a ComputePipeline {
        self.0[step as usize]
    }
}

impl TilePipelines {
    /// The pipelines, once all are compiled.
    pub fn ready<'a>(&self, cache: &'a PipelineCache) -> Option<Steps<'a>> {
        let found: Option<Vec<_>> = self.steps.iter().map(|&id| cache.get_compute_pipeline(id)).collect();
        found?.try_into().ok().map(Steps)
    }
}

/// Has a mode's pipelines made by `init`, and those of the lists, when a camera has the mode's component: an application that
/// never draws it does not wait for them. After a lost device they are made anew.
pub fn init_when_used<Mode: Component, Pipelines: Resource, Marker>(
    render_app: &mut SubApp,
    init: impl IntoSystem<(), (), Marker> + 'static,
) {
    let is_used = |mode: Query<(), With<Mode>>, known: Option<Res<Pipelines>>, splats: Option<Res<SplatPipelines>>| {
        !mode.is_empty() && known.is_none() && splats.is_some_and(|splats| splats.capabilities.compute)
    };
    let forget = |mut commands: Commands| {
        commands.remove_resource::<Pipelines>();
        commands.remove_resource::<TilePipelines>();
    };
    render_app.add_systems(RenderStartup, forget).add_systems(
        Render,
        (init_tile_pipelines, IntoSystem::into_system(init)).chain().in_set(RenderSystems::Queue).run_if(is_used),
    );
}

/// Creates the pipelines of the lists.
fn init_tile_pipelines(
    mut commands: Commands,
    server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    splats: Res<SplatPipelines>,
) {
    let steps = Step::ALL.map(|step| {
        let (kind, entry) = step.entry();
        let mut layout = vec![kind.layout()];
        if kind == Kind::Gather {
            layout.insert(0, particle_layout());
        }
        queue(&cache, &server, (kind.shader(), entry), layout, vec![])
    });
    commands.insert_resource(TilePipelines { steps, is_software: splats.capabilities.is_software });
}
