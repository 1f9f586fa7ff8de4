//! From splats in the order of their bins to a picture: every tile's sums, those of crowded tiles in slices, and coarser levels
//! brought to finer ones. Of several layers of depth each has a picture of its own ([`crate::gpu::layered`]).

use crate::gpu::shaders;
use crate::gpu::splat::layout::{
    Grids, MAX_LEVELS, PATCH_BYTES, Pass, RECONSTRUCTED, SLICE_BYTES, Shape, SplatUniform,
};
use crate::gpu::splat::resources::{ALIGNMENT, at_least, size_of_all, slice};
use crate::gpu::splat::workgroups;
use bevy::asset::AssetServer;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::render_resource::binding_types::{
    storage_buffer_read_only_sized, storage_buffer_sized, uniform_buffer_sized,
};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntries, BindGroupLayoutDescriptor, BindGroupLayoutEntries, Buffer, BufferUsages,
    CachedComputePipelineId, CommandEncoder, ComputePass, ComputePassDescriptor, ComputePipeline,
    ComputePipelineDescriptor, PipelineCache, ShaderStages,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use bevy::shader::{Shader, ShaderDefVal};
use std::num::NonZeroU64;

/// Tiles that one workgroup of the accumulate pass fills, where it is not one subgroup.
const TILES_PER_GROUP: u32 = 8;
/// Invocations of a workgroup of `reconstruct`, along each axis.
const RECONSTRUCT_GROUP: u32 = 8;
/// Bytes for each tile: its first further slice and their number.
const TILE_SLICES_BYTES: u64 = 8;

/// Layouts and pipelines.
pub struct SumPipelines {
    accumulate_layout: BindGroupLayoutDescriptor,
    slices_layout: BindGroupLayoutDescriptor,
    reconstruct_layout: BindGroupLayoutDescriptor,
    /// What says which layers are summed, where there are several.
    layers_layout: Option<BindGroupLayoutDescriptor>,
    accumulate: HashMap<Shape, CachedComputePipelineId>,
    accumulate_shader: Handle<Shader>,
    vector_subgroups: bool,
    finish: CachedComputePipelineId,
    merge: CachedComputePipelineId,
    reconstruct: CachedComputePipelineId,
}

/// Compiled pipelines, for what splats of a picture look like.
#[derive(Clone, Copy)]
pub struct SumSteps<'a> {
    /// One workgroup for `tiles_per_group` tiles.
    accumulate: &'a ComputePipeline,
    tiles_per_group: u32,
    /// One invocation.
    finish: &'a ComputePipeline,
    /// One workgroup for eight tiles.
    merge: &'a ComputePipeline,
    /// One workgroup for 8 x 8 times [`RECONSTRUCTED`] finer cells.
    reconstruct: &'a ComputePipeline,
}

/// Shader definitions of the accumulate pass, of one picture or of several layers.
pub fn accumulate_defs(shape: Shape, subgroup: bool, layers: bool) -> Vec<ShaderDefVal> {
    let mut defs = shape.defs();
    defs.extend(slices_defs(subgroup));
    if layers {
        defs.push("LAYERS".into());
    }
    if subgroup {
        defs.push("SUBGROUP".into());
    }
    defs
}

/// Shader definitions of the passes that follow the accumulate pass.
pub fn slices_defs(subgroup: bool) -> Vec<ShaderDefVal> {
    vec![ShaderDefVal::UInt("TILES_PER_GROUP".into(), tiles_per_group(subgroup))]
}

/// Tiles that a workgroup of the accumulate pass fills. A CPU driver runs a subgroup as one vector: there the lanes share
/// what they load.
fn tiles_per_group(subgroup: bool) -> u32 {
    if subgroup { 1 } else { TILES_PER_GROUP }
}

impl SumPipelines {
    /// Creates layouts, and pipelines for all that every picture needs. With a layout for what says which layers are summed, the
    /// passes sum layers.
    pub fn new(
        server: &AssetServer,
        cache: &PipelineCache,
        vector_subgroups: bool,
        layers_layout: Option<BindGroupLayoutDescriptor>,
    ) -> SumPipelines {
        let pass = || uniform_buffer_sized(true, NonZeroU64::new(size_of::<Pass>() as u64));
        let read = || storage_buffer_read_only_sized(false, None);
        let write = || storage_buffer_sized(false, None);
        let view = || uniform_buffer_sized(false, NonZeroU64::new(size_of::<SplatUniform>() as u64));
        let compute = ShaderStages::COMPUTE;
        let accumulate_layout = BindGroupLayoutDescriptor::new(
            "deepfield accumulate",
            &BindGroupLayoutEntries::sequential(
                compute,
                (view(), pass(), read(), read(), write(), write(), write(), write(), write()),
            ),
        );
        let slices_layout = BindGroupLayoutDescriptor::new(
            "deepfield slices",
            &BindGroupLayoutEntries::sequential(compute, (view(), read(), write(), read(), read(), write())),
        );
        let reconstruct_layout = BindGroupLayoutDescriptor::new(
            "deepfield reconstruct",
            &BindGroupLayoutEntries::sequential(compute, (view(), pass(), write())),
        );
        let slices = shaders::load(server, "splat/slices.wgsl");
        let of_slices = |entry| {
            let defs = slices_defs(vector_subgroups);
            queue(cache, vec![slices_layout.clone()], &slices, entry, defs)
        };
        let reconstruct = shaders::load(server, "splat/reconstruct.wgsl");
        SumPipelines {
            accumulate: HashMap::default(),
            accumulate_shader: shaders::load(server, "splat/accumulate.wgsl"),
            vector_subgroups,
            finish: of_slices("finish"),
            merge: of_slices("merge"),
            reconstruct: queue(cache, vec![reconstruct_layout.clone()], &reconstruct, "main", vec![]),
            accumulate_layout,
            slices_layout,
            reconstruct_layout,
            layers_layout,
        }
    }

    /// Has the pipeline of `accumulate` compiled for what splats look like.
    pub fn ask_for(&mut self, shape: Shape, cache: &PipelineCache) {
        let layouts = || [self.accumulate_layout.clone()].into_iter().chain(self.layers_layout.clone()).collect();
        self.accumulate.entry(shape).or_insert_with(|| {
            let defs = accumulate_defs(shape, self.vector_subgroups, self.layers_layout.is_some());
            queue(cache, layouts(), &self.accumulate_shader, "main", defs)
        });
    }

    /// The pipelines for what grids are of, once they are compiled.
    pub fn ready<'a>(&self, grids: &Grids, cache: &'a PipelineCache) -> Option<SumSteps<'a>> {
        let get = |id| cache.get_compute_pipeline(id);
        Some(SumSteps {
            accumulate: get(*self.accumulate.get(&grids.shape)?)?,
            tiles_per_group: tiles_per_group(self.vector_subgroups),
            finish: get(self.finish)?,
            merge: get(self.merge)?,
            reconstruct: get(self.reconstruct)?,
        })
    }
}

fn queue(
    cache: &PipelineCache,
    layout: Vec<BindGroupLayoutDescriptor>,
    shader: &Handle<Shader>,
    entry: &'static str,
    shader_defs: Vec<ShaderDefVal>,
) -> CachedComputePipelineId {
    cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: layout.first().map(|layout| layout.label.clone()),
        layout,
        shader: shader.clone(),
        entry_point: Some(entry.into()),
        shader_defs,
        ..default()
    })
}

/// Buffers that are kept from picture to picture.
#[derive(Clone, Default)]
pub struct SumScratch {
    slices: Option<Buffer>,
    tile_slices: Option<Buffer>,
    slice_count: Option<Buffer>,
    dispatch: Option<Buffer>,
    patches: Option<Buffer>,
    passes: Option<Buffer>,
}

impl SumScratch {
    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let SumScratch { slices, tile_slices, slice_count, dispatch, patches, passes } = self;
        size_of_all([slices, tile_slices, slice_count, dispatch, patches, passes].into_iter().flatten())
    }
}

/// What is summed.
pub struct Summed<'a> {
    /// The view's [`SplatUniform`].
    pub view: &'a Buffer,
    /// Its grids.
    pub grids: &'a Grids,
    /// Splats in the order of their bins, of layer after layer.
    pub splats: &'a Buffer,
    /// The most that there are.
    pub most: u64,
    /// The first splat of each bin of each layer, and the number of all.
    pub starts: &'a Buffer,
    /// The pyramids' cells: as many as [`Grids::cells`] for each layer that is summed at once.
    pub cells: &'a Buffer,
    /// How many layers are summed at once.
    pub layers: u32,
}

/// What the passes bind.
pub struct Sums {
    accumulate: BindGroup,
    slices: BindGroup,
    reconstruct: BindGroup,
    slice_count: Buffer,
    dispatch: Buffer,
}

/// Which layers are summed.
#[derive(Clone, Copy)]
pub struct Layers<'a> {
    /// What says which.
    pub group: &'a BindGroup,
    /// Where it does.
    pub offset: u32,
    /// Workgroups along x, y and z of dispatches.
    pub dispatches: &'a Buffer,
    /// The first of those of [`SumPipelines::workgroups`].
    pub first: u32,
}

impl Layers<'_> {
    /// Dispatches the pass with this number.
    pub fn dispatch(&self, number: u32, pass: &mut ComputePass<'_>) {
        pass.dispatch_workgroups_indirect(self.dispatches, u64::from(self.first + number) * DISPATCH_BYTES);
    }
}

/// Bytes of a dispatch's workgroups.
const DISPATCH_BYTES: u64 = 12;

/// Offset of the parameters of `accumulate`: whether it adds, and whether it sums further slices.
fn sum(add: bool, further: bool) -> u32 {
    (u32::from(add) + 2 * u32::from(further)) * ALIGNMENT as u32
}

/// Offset of the parameters of `reconstruct` for a coarser level.
fn reconstruction(level: u32) -> u32 {
    (level + 4) * ALIGNMENT as u32
}

/// The parameters of all passes.
fn passes(device: &RenderDevice, queue: &RenderQueue) -> Buffer {
    let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
    let buffer = at_least(None, reconstruction(MAX_LEVELS as u32).into(), usage, "deepfield splat passes", device);
    let write = |offset: u32, pass: Pass| queue.write_buffer(&buffer, offset.into(), bytemuck::bytes_of(&pass));
    for (add, further) in [(false, false), (true, false), (false, true)] {
        write(sum(add, further), Pass { add: add.into(), further: further.into(), ..Pass::default() });
    }
    for level in 0..MAX_LEVELS as u32 {
        write(reconstruction(level), Pass { level, ..Pass::default() });
    }
    buffer
}

impl Sums {
    /// Binds what the passes need.
    pub fn new(
        of: &Summed<'_>,
        scratch: &mut SumScratch,
        pipelines: &SumPipelines,
        cache: &PipelineCache,
        (device, queue): (&RenderDevice, &RenderQueue),
    ) -> Sums {
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let take = |slot: &mut Option<Buffer>, bytes, usage, label| {
            let buffer = at_least(slot.take(), bytes, usage, label, device);
            slot.insert(buffer).clone()
        };
        let passes = scratch.passes.get_or_insert_with(|| passes(device, queue)).clone();
        let most_slices = of.grids.most_slices(of.most);
        let slices = take(&mut scratch.slices, most_slices * SLICE_BYTES, storage, "deepfield slices");
        let patches = take(&mut scratch.patches, most_slices * PATCH_BYTES, storage, "deepfield patches");
        let tile_slices_bytes = u64::from(of.grids.tiles) * u64::from(of.layers) * TILE_SLICES_BYTES;
        let tile_slices = take(&mut scratch.tile_slices, tile_slices_bytes, storage, "deepfield slices of tiles");
        let slice_count = take(&mut scratch.slice_count, 4, storage, "deepfield number of slices");
        let indirect = storage | BufferUsages::INDIRECT;
        let dispatch = take(&mut scratch.dispatch, 12, indirect, "deepfield dispatch of slices");

        let view = || of.view.as_entire_binding();
        let pass_size = size_of::<Pass>() as u64;
        // As long as there are tiles: `merge` asks for it.
        let tiles = || slice(&tile_slices, 0, tile_slices_bytes);
        let layout = |layout| cache.get_bind_group_layout(layout);
        Sums {
            accumulate: device.create_bind_group(
                "deepfield accumulate",
                &layout(&pipelines.accumulate_layout),
                &BindGroupEntries::sequential((
                    view(),
                    slice(&passes, 0, pass_size),
                    of.splats.as_entire_binding(),
                    of.starts.as_entire_binding(),
                    of.cells.as_entire_binding(),
                    slices.as_entire_binding(),
                    tiles(),
                    slice_count.as_entire_binding(),
                    patches.as_entire_binding(),
                )),
            ),
            slices: device.create_bind_group(
                "deepfield slices",
                &layout(&pipelines.slices_layout),
                &BindGroupEntries::sequential((
                    view(),
                    slice_count.as_entire_binding(),
                    dispatch.as_entire_binding(),
                    tiles(),
                    patches.as_entire_binding(),
                    of.cells.as_entire_binding(),
                )),
            ),
            reconstruct: device.create_bind_group(
                "deepfield reconstruct",
                &layout(&pipelines.reconstruct_layout),
                &BindGroupEntries::sequential((view(), slice(&passes, 0, pass_size), of.cells.as_entire_binding())),
            ),
            slice_count,
            dispatch,
        }
    }

    /// Sums the splats of every tile, to what is there (`add`) or in its place; of layers they themselves know.
    pub fn accumulate(
        &self,
        steps: SumSteps<'_>,
        grids: &Grids,
        add: bool,
        layers: Option<Layers<'_>>,
        encoder: &mut CommandEncoder,
    ) {
        encoder.clear_buffer(&self.slice_count, 0, None);
        let first = |pass: &mut ComputePass<'_>, further: bool| {
            pass.set_pipeline(steps.accumulate);
            pass.set_bind_group(0, &self.accumulate, &[sum(add && !further, further)]);
            if let Some(layers) = layers {
                pass.set_bind_group(1, layers.group, &[layers.offset]);
            }
        };
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            first(&mut pass, false);
            steps.run(ACCUMULATE, grids, layers, &mut pass);
            pass.set_pipeline(steps.finish);
            pass.set_bind_group(0, &self.slices, &[]);
            pass.dispatch_workgroups(1, 1, 1);
        }
        // A pass of its own: the same buffer held the dispatch's size as storage.
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        first(&mut pass, true);
        pass.dispatch_workgroups_indirect(&self.dispatch, 0);
        pass.set_pipeline(steps.merge);
        pass.set_bind_group(0, &self.slices, &[]);
        steps.run(MERGE, grids, layers, &mut pass);
    }

    /// Brings all levels to the finest.
    pub fn reconstruct(
        &self,
        steps: SumSteps<'_>,
        grids: &Grids,
        layers: Option<Layers<'_>>,
        encoder: &mut CommandEncoder,
    ) {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(steps.reconstruct);
        for level in (1..grids.uniform.level_count).rev() {
            pass.set_bind_group(0, &self.reconstruct, &[reconstruction(level)]);
            steps.run(RECONSTRUCT + level, grids, layers, &mut pass);
        }
    }
}

/// Numbers of passes; `RECONSTRUCT` and a level's number are that of the pass that brings it to the next finer one.
const ACCUMULATE: u32 = 0;
const MERGE: u32 = 1;
const RECONSTRUCT: u32 = 1;

impl SumPipelines {
    /// Workgroups along x and y of every pass; along z they are layers.
    pub fn workgroups(&self, grids: &Grids) -> Vec<(u32, u32)> {
        let tiles_per_group = tiles_per_group(self.vector_subgroups);
        (0..RECONSTRUCT + grids.uniform.level_count)
            .map(|number| workgroups_of(number, tiles_per_group, grids))
            .collect()
    }
}

fn workgroups_of(number: u32, tiles_per_group: u32, grids: &Grids) -> (u32, u32) {
    match number {
        ACCUMULATE => workgroups(grids.tiles.div_ceil(tiles_per_group)),
        MERGE => workgroups(grids.tiles.div_ceil(8)),
        _ => {
            let finer = &grids.uniform.levels[(number - RECONSTRUCT - 1) as usize];
            let [x, y] = RECONSTRUCTED.map(|cells| cells * RECONSTRUCT_GROUP);
            (finer.width.div_ceil(x), finer.height.div_ceil(y))
        }
    }
}

impl SumSteps<'_> {
    fn run(&self, number: u32, grids: &Grids, layers: Option<Layers<'_>>, pass: &mut ComputePass<'_>) {
        if let Some(layers) = layers {
            layers.dispatch(number, pass);
        } else {
            let (x, y) = workgroups_of(number, self.tiles_per_group, grids);
            pass.dispatch_workgroups(x, y, 1);
        }
    }
}
