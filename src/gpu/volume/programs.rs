//! The compute pipelines of volumes: which shader each step runs, and what it binds.
//!
//! They live in a pipeline cache of their own, that is driven by hand: volumes are drawn outside of frames, on whatever
//! thread asks, with Bevy's application or without.

use super::layout::{Portion, Turn, VolumeUniform};
use crate::gpu::device::GpuError;
use crate::model::Kernel;
use bevy::asset::Handle;
use bevy::asset::uuid::Uuid;
use bevy::platform::collections::HashMap;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntryBuilder, CachedComputePipelineId,
    CachedPipelineState, ComputePipeline, ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::renderer::{RenderAdapter, RenderDevice};
use bevy::shader::{Shader, ShaderDefVal};
use std::marker::PhantomData;
use std::num::NonZeroU64;

/// One entry point of a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Step {
    /// Counts the particles of each bin, one invocation a particle.
    Count,
    /// Writes pairs of bin and particle, one invocation a particle.
    Pair,
    /// Sums bins, one workgroup for 1024.
    SumBins,
    /// Sums these sums, one workgroup.
    ScanParts,
    /// Places of bins, one workgroup for 1024.
    SpreadBins,
    /// Places of each workgroup's pairs, one workgroup.
    ScanPairs,
    /// Places of digits, one workgroup.
    ScanTable,
    /// Counts digits, one workgroup a block.
    Tally,
    /// Moves pairs, one workgroup a block.
    MovePairs,
    /// Lists bricks, one invocation a brick.
    Plan,
    /// Says how many there are, one invocation.
    DispatchBricks,
    /// Resamples, one workgroup a brick.
    Gather,
    /// What rays may meet in each brick, one invocation a brick.
    FindReach,
    /// Rays, one invocation a pixel.
    CastRays,
    /// What is hidden, one workgroup a column of bricks.
    Occlude,
    /// The same for coarser bins, one workgroup.
    Pyramid,
}

/// What a step binds; steps of the same kind share it, and their shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// `bin.wgsl`.
    Bin,
    /// `scan.wgsl`.
    Scan,
    /// `sort.wgsl`.
    Sort,
    /// `plan.wgsl`.
    Plan,
    /// `gather.wgsl`.
    Gather,
    /// `occlusion.wgsl`.
    Occlusion,
    /// `raycast.wgsl`.
    Raycast,
}

/// What is compiled into the shaders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The kernel.
    pub kernel: Kernel,
    /// Whether there is an attribute.
    pub attribute: bool,
    /// Whether there are surfaces.
    pub surfaces: bool,
    /// Whether subgroups have exactly eight lanes: a processor's vectors.
    pub vectors: bool,
}

impl Variant {
    /// Parts of a brick that workgroups gather on their own: `PARTS` in the shaders.
    pub fn parts(self) -> u32 {
        if self.vectors { 4 } else { 1 }
    }
}

impl Step {
    /// Every step.
    pub const ALL: [Step; 16] = [
        Step::Count,
        Step::Pair,
        Step::SumBins,
        Step::ScanParts,
        Step::SpreadBins,
        Step::ScanPairs,
        Step::ScanTable,
        Step::Tally,
        Step::MovePairs,
        Step::Plan,
        Step::DispatchBricks,
        Step::Gather,
        Step::FindReach,
        Step::CastRays,
        Step::Occlude,
        Step::Pyramid,
    ];

    /// The name of its entry point.
    pub const fn entry(self) -> &'static str {
        match self {
            Step::Count => "count",
            Step::Pair => "pair",
            Step::SumBins => "sum_bins",
            Step::ScanParts => "scan_parts",
            Step::SpreadBins => "spread_bins",
            Step::ScanPairs => "scan_pairs",
            Step::ScanTable => "scan_table",
            Step::Tally => "tally",
            Step::MovePairs => "move_pairs",
            Step::Plan => "plan",
            Step::DispatchBricks => "dispatch_bricks",
            Step::Gather => "gather",
            Step::FindReach => "find_reach",
            Step::CastRays => "cast_rays",
            Step::Occlude => "occlude",
            Step::Pyramid => "pyramid",
        }
    }

    /// What it binds.
    pub const fn kind(self) -> Kind {
        match self {
            Step::Count | Step::Pair => Kind::Bin,
            Step::SumBins | Step::ScanParts | Step::SpreadBins | Step::ScanPairs | Step::ScanTable => Kind::Scan,
            Step::Tally | Step::MovePairs => Kind::Sort,
            Step::Plan | Step::DispatchBricks => Kind::Plan,
            Step::Gather => Kind::Gather,
            Step::FindReach | Step::Occlude | Step::Pyramid => Kind::Occlusion,
            Step::CastRays => Kind::Raycast,
        }
    }
}

impl Kind {
    /// Every kind.
    pub const ALL: [Kind; 7] =
        [Kind::Bin, Kind::Scan, Kind::Sort, Kind::Plan, Kind::Gather, Kind::Occlusion, Kind::Raycast];

    /// The path of its shader.
    pub const fn shader(self) -> &'static str {
        match self {
            Kind::Bin => "volume/bin.wgsl",
            Kind::Scan => "volume/scan.wgsl",
            Kind::Sort => "volume/sort.wgsl",
            Kind::Plan => "volume/plan.wgsl",
            Kind::Gather => "volume/gather.wgsl",
            Kind::Occlusion => "volume/occlusion.wgsl",
            Kind::Raycast => "volume/raycast.wgsl",
        }
    }

    /// Shader definitions of a variant.
    pub fn defs(self, variant: Variant) -> Vec<ShaderDefVal> {
        let mut defs = Vec::new();
        if matches!(self, Kind::Plan | Kind::Gather | Kind::Occlusion | Kind::Raycast) {
            defs.push(ShaderDefVal::UInt("PARTS".into(), variant.parts()));
        }
        if self == Kind::Gather && variant.vectors {
            defs.push("SUBGROUP".into());
        }
        if self == Kind::Gather && variant.kernel == Kernel::Poly6 {
            defs.push("POLY6".into());
        }
        if matches!(self, Kind::Gather | Kind::Raycast) && variant.attribute {
            defs.push("ATTRIBUTE".into());
        }
        if self == Kind::Raycast && variant.surfaces {
            defs.push("SURFACES".into());
        }
        defs
    }

    /// Its bindings.
    fn layout(self) -> BindGroupLayoutDescriptor {
        let uniform = |bytes: usize, moves| uniform_buffer_sized(moves, NonZeroU64::new(bytes as u64));
        let view = || uniform(size_of::<VolumeUniform>(), false);
        let portion = || uniform(size_of::<Portion>(), true);
        let turn = || uniform(size_of::<Turn>(), true);
        let read = || storage_buffer_read_only_sized(false, None);
        let write = || storage_buffer_sized(false, None);
        let list = match self {
            Kind::Bin => vec![view(), portion(), read(), read(), write(), write(), write(), write()],
            Kind::Scan => vec![view(), portion(), write(), write(), write()],
            Kind::Sort => vec![turn(), read(), read(), read(), write(), write(), write()],
            Kind::Plan => vec![view(), portion(), read(), read(), write(), write(), write()],
            Kind::Gather => {
                let mut list = vec![view(), portion(), turn()];
                list.extend((0..6).map(|_| read()));
                list.extend([write(), write()]);
                list
            }
            Kind::Occlusion => vec![view(), portion(), read(), write(), read(), read(), write(), write()],
            Kind::Raycast => {
                let mut list = vec![view(), portion()];
                list.extend((0..5).map(|_| read()));
                list.extend([write(), write(), read()]);
                list
            }
        };
        let entry =
            |(index, builder): (usize, BindGroupLayoutEntryBuilder)| builder.build(index as u32, ShaderStages::COMPUTE);
        let entries: Vec<_> = list.into_iter().enumerate().map(entry).collect();
        BindGroupLayoutDescriptor::new(self.shader(), &entries)
    }
}

/// Compiled steps.
pub struct Programs {
    cache: PipelineCache,
    shaders: HashMap<&'static str, Handle<Shader>>,
    known: HashMap<(Step, Vec<ShaderDefVal>), CachedComputePipelineId>,
}

impl Programs {
    /// Nothing compiled yet of these shaders, which are paths and texts.
    pub fn new(device: &RenderDevice, adapter: &RenderAdapter, shaders: &[(&'static str, String)]) -> Programs {
        let mut cache = PipelineCache::new(device.clone(), adapter.clone(), true);
        let mut take = |(index, (path, text)): (usize, &(&'static str, String))| {
            let handle = Handle::Uuid(Uuid::from_u128(index as u128 + 1), PhantomData);
            cache.set_shader(handle.id(), Shader::from_wgsl(text.clone(), *path));
            (*path, handle)
        };
        let shaders = shaders.iter().enumerate().map(&mut take).collect();
        Programs { cache, shaders, known: HashMap::default() }
    }

    /// The bindings of a kind.
    pub fn layout(&self, kind: Kind) -> BindGroupLayout {
        self.cache.get_bind_group_layout(&kind.layout())
    }

    /// The pipelines of a variant, compiled when needed.
    ///
    /// # Errors
    /// [`GpuError::Shader`].
    pub fn get(&mut self, variant: Variant) -> Result<HashMap<Step, ComputePipeline>, GpuError> {
        for step in Step::ALL {
            let Programs { cache, shaders, known } = self;
            let defs = step.kind().defs(variant);
            known.entry((step, defs.clone())).or_insert_with(|| {
                // Every kind's shader is embedded; a test composes them all.
                let shader = shaders.get(step.kind().shader()).cloned().unwrap_or_default();
                cache.queue_compute_pipeline(ComputePipelineDescriptor {
                    label: Some(step.entry().into()),
                    layout: vec![step.kind().layout()],
                    shader,
                    entry_point: Some(step.entry().into()),
                    shader_defs: defs,
                    ..ComputePipelineDescriptor::default()
                })
            });
        }
        self.cache.process_queue();
        let ready = |step: Step| {
            let unknown = || GpuError::Shader(step.entry().into());
            let id = *self.known.get(&(step, step.kind().defs(variant))).ok_or_else(unknown)?;
            match (self.cache.get_compute_pipeline(id), self.cache.get_compute_pipeline_state(id)) {
                (Some(pipeline), _) => Ok((step, pipeline.clone())),
                (None, CachedPipelineState::Err(error)) => Err(GpuError::Shader(format!("{}: {error}", step.entry()))),
                (None, _) => Err(unknown()),
            }
        };
        Step::ALL.into_iter().map(ready).collect()
    }
}
