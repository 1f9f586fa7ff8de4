//! The compute pipelines of volumes: which shader each step runs, and what it binds.

use super::column::ColumnUniform;
use super::field::layout::{FieldUniform, SlopeUniform};
use super::layout::{Portion, Turn, VolumeUniform};
use super::march::MarchUniform;
use crate::gpu::matter::LookupUniform;
use crate::gpu::shaders;
use crate::gpu::splat::constants::kernel_defs;
use crate::gpu::splat::particle_layout;
use crate::model::Kernel;
use bevy::asset::{AssetServer, Handle};
use bevy::platform::collections::HashMap;
use bevy::prelude::Resource;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, texture_3d, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroupLayoutDescriptor, BindGroupLayoutEntryBuilder, CachedComputePipelineId, ComputePipeline,
    ComputePipelineDescriptor, PipelineCache, ShaderStages, TextureSampleType,
};
use bevy::shader::{Shader, ShaderDefVal};
use std::num::NonZeroU64;

/// One entry point of a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Step {
    /// Loads particles, one workgroup a block.
    Project,
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
    /// How dense bricks of coarser grids may become, one invocation a brick.
    Bound,
    /// Which bricks may show something, one invocation a brick.
    Mark,
    /// Which bricks of the next coarser grid are needed, one invocation a brick.
    Need,
    /// Lists bricks to which wide particles add something, one invocation a brick.
    Choose,
    /// Says how many there are, one invocation.
    DispatchChosen,
    /// Adds the next coarser tier's field, one workgroup a brick.
    Interpolate,
    /// How much mass the field has at each value, one workgroup a brick.
    Measure,
    /// What rays may meet in each brick, one invocation a brick.
    FindReach,
    /// Rays, one invocation a pixel.
    CastRays,
    /// What is hidden, one workgroup a column of bricks.
    Occlude,
    /// The same for coarser bins, one workgroup.
    Pyramid,
    /// How dense a Cartesian grid is at most, one invocation a room.
    FindRooms,
    /// Rays through a Cartesian grid, one invocation a pixel.
    March,
    /// Lists bricks in which a field may show, one invocation a brick.
    PlanField,
    /// Fills them, one workgroup a brick.
    Fill,
    /// Takes over what cells show of a column, one workgroup a brick.
    ReadColumn,
    /// Takes over the surfaces of a window, one invocation a pixel.
    PlaceFaces,
    /// Finds which pixels are of one surface, one invocation a pixel.
    Join,
    /// Has surfaces' directions flow, one invocation a pixel.
    Flow,
    /// Lights surfaces by these, one invocation a pixel.
    Relight,
}

/// What a step binds; steps of the same kind share it, and their shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// `project.wgsl`.
    Project,
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
    /// `choose.wgsl`.
    Choose,
    /// `interpolate.wgsl`.
    Interpolate,
    /// `measure.wgsl`.
    Measure,
    /// `occlusion.wgsl`.
    Occlusion,
    /// `raycast.wgsl`.
    Raycast,
    /// `march.wgsl`.
    March,
    /// `field.wgsl`.
    Field,
    /// `column.wgsl`.
    Column,
    /// `smooth.wgsl`.
    Smooth,
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
    /// Whether cells are pixels, so that all rays go through cells' centres.
    pub centered: bool,
    /// Whether subgroups have exactly eight lanes: a processor's vectors.
    pub vectors: bool,
    /// Whether a sampled field fills the grid.
    pub field: bool,
    /// Whether the volume itself is lit.
    pub lit: bool,
    /// Whether it is of fields of particles' columns.
    pub columns: bool,
    /// Whether the light on surfaces is smoothed.
    pub smooth: bool,
    /// Whether it is kept what covers each pixel, in place of the surface that is smoothed.
    pub covering: bool,
}

impl Variant {
    /// Parts of a brick that workgroups gather on their own: `PARTS` in the shaders.
    pub fn parts(self) -> u32 {
        if self.vectors { 4 } else { 1 }
    }

    /// Whether a surface is kept for each pixel.
    pub const fn keeps_faces(self) -> bool {
        self.smooth || self.covering
    }

    /// Whether samples say which way surfaces face.
    pub fn has_slopes(self) -> bool {
        self.field && self.surfaces
    }

    /// Particles that a brick gathers in one turn, `TURN` in the shaders: a software driver ends an invocation's loops after 65535
    /// rounds in all. With vectors a particle takes a round for each part that it reaches, one in eight for each that it may reach,
    /// and one in eight where it is looked for; without, a round.
    pub fn turn(self) -> u32 {
        if self.vectors { 1 << 13 } else { 1 << 15 }
    }
}

impl Step {
    /// Every step.
    pub const ALL: [Step; 33] = [
        Step::Project,
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
        Step::Bound,
        Step::Mark,
        Step::Need,
        Step::Choose,
        Step::DispatchChosen,
        Step::Interpolate,
        Step::Measure,
        Step::FindReach,
        Step::CastRays,
        Step::Occlude,
        Step::Pyramid,
        Step::FindRooms,
        Step::March,
        Step::PlanField,
        Step::Fill,
        Step::ReadColumn,
        Step::PlaceFaces,
        Step::Join,
        Step::Flow,
        Step::Relight,
    ];

    /// The name of its entry point.
    pub const fn entry(self) -> &'static str {
        match self {
            Step::Project => "project",
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
            Step::Bound => "bound",
            Step::Mark => "mark",
            Step::Need => "need",
            Step::Choose => "choose",
            Step::DispatchChosen => "dispatch_chosen",
            Step::Interpolate => "interpolate",
            Step::Measure => "measure",
            Step::FindReach => "find_reach",
            Step::CastRays => "cast_rays",
            Step::Occlude => "occlude",
            Step::Pyramid => "pyramid",
            Step::FindRooms => "find_rooms",
            Step::March => "march",
            Step::PlanField => "plan_field",
            Step::Fill => "fill",
            Step::ReadColumn => "read_column",
            Step::PlaceFaces => "place_faces",
            Step::Join => "join",
            Step::Flow => "flow",
            Step::Relight => "relight",
        }
    }

    /// Whether pictures of a variant take it.
    pub const fn is_of(self, variant: Variant) -> bool {
        match self {
            Step::PlanField | Step::Fill => variant.field,
            Step::ReadColumn => variant.columns,
            Step::PlaceFaces => variant.keeps_faces(),
            Step::Join | Step::Flow | Step::Relight => variant.smooth,
            Step::DispatchBricks | Step::FindReach | Step::CastRays | Step::Occlude | Step::Pyramid => true,
            _ => !variant.field,
        }
    }

    /// What it binds.
    pub const fn kind(self) -> Kind {
        match self {
            Step::Project => Kind::Project,
            Step::Count | Step::Pair => Kind::Bin,
            Step::SumBins | Step::ScanParts | Step::SpreadBins | Step::ScanPairs | Step::ScanTable => Kind::Scan,
            Step::Tally | Step::MovePairs => Kind::Sort,
            Step::Plan | Step::DispatchBricks => Kind::Plan,
            Step::Gather => Kind::Gather,
            Step::Bound | Step::Mark | Step::Need | Step::Choose | Step::DispatchChosen => Kind::Choose,
            Step::Interpolate => Kind::Interpolate,
            Step::Measure => Kind::Measure,
            Step::FindReach | Step::Occlude | Step::Pyramid => Kind::Occlusion,
            Step::CastRays => Kind::Raycast,
            Step::FindRooms | Step::March => Kind::March,
            Step::PlanField | Step::Fill => Kind::Field,
            Step::ReadColumn => Kind::Column,
            Step::PlaceFaces | Step::Join | Step::Flow | Step::Relight => Kind::Smooth,
        }
    }
}

impl Kind {
    /// Every kind.
    pub const ALL: [Kind; 15] = [
        Kind::Project,
        Kind::Bin,
        Kind::Scan,
        Kind::Sort,
        Kind::Plan,
        Kind::Gather,
        Kind::Choose,
        Kind::Interpolate,
        Kind::Measure,
        Kind::Occlusion,
        Kind::Raycast,
        Kind::March,
        Kind::Field,
        Kind::Column,
        Kind::Smooth,
    ];

    /// The path of its shader.
    pub const fn shader(self) -> &'static str {
        match self {
            Kind::Project => "volume/project.wgsl",
            Kind::Bin => "volume/bin.wgsl",
            Kind::Scan => "volume/scan.wgsl",
            Kind::Sort => "volume/sort.wgsl",
            Kind::Plan => "volume/plan.wgsl",
            Kind::Gather => "volume/gather.wgsl",
            Kind::Choose => "volume/choose.wgsl",
            Kind::Interpolate => "volume/interpolate.wgsl",
            Kind::Measure => "volume/measure.wgsl",
            Kind::Occlusion => "volume/occlusion.wgsl",
            Kind::Raycast => "volume/raycast.wgsl",
            Kind::March => "volume/march.wgsl",
            Kind::Field => "volume/field.wgsl",
            Kind::Column => "volume/column.wgsl",
            Kind::Smooth => "volume/smooth.wgsl",
        }
    }

    /// Whether it uses subgroups where [`Variant::vectors`] says that they are vectors.
    pub const fn has_subgroups(self) -> bool {
        matches!(self, Kind::Bin | Kind::Gather | Kind::Interpolate)
    }

    /// Shader definitions of a variant.
    pub fn defs(self, variant: Variant) -> Vec<ShaderDefVal> {
        let mut defs = Vec::new();
        let is_one_of = |kinds: &[Kind]| kinds.contains(&self);
        let with_cells =
            is_one_of(&[Kind::Gather, Kind::Interpolate, Kind::Measure, Kind::Raycast, Kind::March, Kind::Field]);
        if with_cells || is_one_of(&[Kind::Plan, Kind::Choose, Kind::Occlusion, Kind::Column]) {
            defs.push(ShaderDefVal::UInt("PARTS".into(), variant.parts()));
        }
        if is_one_of(&[Kind::Plan, Kind::Gather]) {
            defs.push(ShaderDefVal::UInt("TURN".into(), variant.turn()));
        }
        if self.has_subgroups() && variant.vectors {
            defs.push("SUBGROUP".into());
        }
        if self == Kind::Gather {
            defs.extend(kernel_defs(variant.kernel));
        }
        if with_cells && variant.attribute {
            defs.push("ATTRIBUTE".into());
        }
        if is_one_of(&[Kind::Raycast, Kind::March]) && variant.surfaces {
            defs.push("SURFACES".into());
        }
        if self == Kind::Choose && variant.centered && !variant.surfaces && !variant.lit {
            defs.push("ALONE".into());
        }
        if self == Kind::Raycast && variant.centered {
            defs.push("CENTERED".into());
        }
        if self == Kind::Raycast && variant.field {
            defs.push("EVEN".into());
        }
        if self == Kind::Raycast && variant.lit {
            defs.push("LIT".into());
        }
        if self == Kind::Raycast && variant.columns {
            defs.push("COLUMNS".into());
        }
        if self == Kind::Raycast && variant.keeps_faces() {
            defs.push("FACES".into());
        }
        if self == Kind::Raycast && variant.covering {
            defs.push("COVERING".into());
        }
        defs
    }

    /// Its bindings; those of [`Kind::Project`] are group 1, behind the particles. [`Kind::March`] has [`matter_layout`] too, and
    /// [`Kind::Raycast`] [`slope_layout`] for surfaces of a sampled field.
    pub fn layout(self) -> BindGroupLayoutDescriptor {
        let uniform = |bytes: usize, moves| uniform_buffer_sized(moves, NonZeroU64::new(bytes as u64));
        let view = || uniform(size_of::<VolumeUniform>(), false);
        let portion = || uniform(size_of::<Portion>(), true);
        let turn = || uniform(size_of::<Turn>(), true);
        let read = || storage_buffer_read_only_sized(false, None);
        let write = || storage_buffer_sized(false, None);
        let list = match self {
            Kind::Project => vec![view(), write(), write(), read()],
            Kind::Bin => {
                let mut list = vec![view(), portion(), read(), read()];
                list.extend((0..6).map(|_| write()));
                list
            }
            Kind::Scan => vec![view(), portion(), write(), write(), write()],
            Kind::Sort => vec![turn(), read(), read(), read(), write(), write(), write()],
            Kind::Plan => vec![view(), portion(), read(), read(), write(), write(), write()],
            Kind::Gather => {
                let mut list = vec![view(), portion(), turn()];
                list.extend((0..6).map(|_| read()));
                list.extend([write(), write()]);
                list
            }
            Kind::Choose => vec![view(), portion(), turn(), read(), read(), write(), write(), write(), write()],
            Kind::Interpolate => vec![view(), portion(), turn(), read(), write(), write()],
            Kind::Measure => vec![view(), portion(), read(), read(), read(), write()],
            Kind::Occlusion => vec![view(), portion(), read(), write(), read(), read(), write(), write()],
            Kind::March => {
                vec![view(), uniform(size_of::<MarchUniform>(), false), read(), read(), write(), write()]
            }
            Kind::Raycast => {
                let mut list = vec![view(), portion()];
                list.extend((0..5).map(|_| read()));
                list.extend([write(), write(), read()]);
                list
            }
            Kind::Column => {
                let column = uniform(size_of::<ColumnUniform>(), false);
                vec![view(), portion(), column, read(), read(), write(), write()]
            }
            Kind::Smooth => {
                let mut list = vec![view(), portion(), read()];
                list.extend((0..5).map(|_| write()));
                list
            }
            Kind::Field => {
                let mut list = vec![view(), portion(), uniform(size_of::<FieldUniform>(), false)];
                list.extend([read(), read(), read(), write(), write(), write()]);
                list.extend((0..2).map(|_| texture_3d(TextureSampleType::Uint)));
                list
            }
        };
        let entry =
            |(index, builder): (usize, BindGroupLayoutEntryBuilder)| builder.build(index as u32, ShaderStages::COMPUTE);
        let entries: Vec<_> = list.into_iter().enumerate().map(entry).collect();
        BindGroupLayoutDescriptor::new(self.shader(), &entries)
    }
}

/// What shaders bind that import `deepfield::matter`.
pub fn matter_layout() -> BindGroupLayoutDescriptor {
    let lookup = uniform_buffer_sized(false, NonZeroU64::new(size_of::<LookupUniform>() as u64));
    let entries = [lookup, storage_buffer_read_only_sized(false, None)];
    let entries = [0, 1].map(|binding: usize| entries[binding].build(binding as u32, ShaderStages::COMPUTE));
    BindGroupLayoutDescriptor::new("deepfield volume matter", &entries)
}

/// What shaders bind that import `deepfield::field_slope`.
pub fn slope_layout() -> BindGroupLayoutDescriptor {
    let slopes = uniform_buffer_sized(false, NonZeroU64::new(size_of::<SlopeUniform>() as u64));
    let entries = [slopes, texture_3d(TextureSampleType::Uint)];
    let entries = [0, 1].map(|binding: usize| entries[binding].build(binding as u32, ShaderStages::COMPUTE));
    BindGroupLayoutDescriptor::new("deepfield volume slopes", &entries)
}

/// The pipelines of all variants that have been asked for.
#[derive(Resource)]
pub struct VolumePipelines {
    shaders: HashMap<Kind, Handle<Shader>>,
    known: HashMap<(Step, Vec<ShaderDefVal>), CachedComputePipelineId>,
    /// Whether subgroups have exactly eight lanes.
    pub vectors: bool,
}

impl VolumePipelines {
    /// Loads the shaders.
    pub fn new(server: &AssetServer, vectors: bool) -> VolumePipelines {
        let shaders = Kind::ALL.into_iter().map(|kind| (kind, shaders::load(server, kind.shader()))).collect();
        VolumePipelines { shaders, known: HashMap::default(), vectors }
    }

    /// Has the pipelines of a variant compiled.
    pub fn ask_for(&mut self, variant: Variant, cache: &PipelineCache) {
        let VolumePipelines { shaders, known, .. } = self;
        for step in Step::ALL.into_iter().filter(|step| step.is_of(variant)) {
            let kind = step.kind();
            let defs = kind.defs(variant);
            known.entry((step, defs.clone())).or_insert_with(|| {
                let mut layout = vec![kind.layout()];
                match kind {
                    Kind::Project => layout.insert(0, particle_layout()),
                    Kind::March => layout.push(matter_layout()),
                    Kind::Raycast if variant.has_slopes() => layout.push(slope_layout()),
                    _ => {}
                }
                cache.queue_compute_pipeline(ComputePipelineDescriptor {
                    label: Some(step.entry().into()),
                    layout,
                    // Every kind has its shader: see `new`.
                    shader: shaders.get(&kind).cloned().unwrap_or_default(),
                    entry_point: Some(step.entry().into()),
                    shader_defs: defs,
                    ..ComputePipelineDescriptor::default()
                })
            });
        }
    }

    /// The pipelines of a variant; `None` as long as one is not compiled.
    pub fn get<'a>(&self, variant: Variant, cache: &'a PipelineCache) -> Option<HashMap<Step, &'a ComputePipeline>> {
        let ready = |step: Step| {
            let id = *self.known.get(&(step, step.kind().defs(variant)))?;
            Some((step, cache.get_compute_pipeline(id)?))
        };
        Step::ALL.into_iter().filter(|step| step.is_of(variant)).map(ready).collect()
    }
}
