//! Splats of layers in the order of their bins, and the pyramids that they are summed in: buffers, bind groups and dispatches.

use super::{BLEND_GROUP, LAYER_BINDINGS};
use crate::gpu::splat::compute::sums::{Layers, SumScratch, Summed, Sums};
use crate::gpu::splat::layout::{Grids, PLACE_BYTES, SPLAT_BYTES};
use crate::gpu::splat::resources::{ALIGNMENT, at_least, size_of_all, slice, whole};
use crate::gpu::tiles::layout::Portion;
use crate::gpu::tiles::pipelines::Steps;
use crate::gpu::tiles::spots::{self, Scan, bind_scan, scan_parts};
use crate::gpu::tiles::{Binding, SpotList};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntry, BindingResource, Buffer, BufferUsages, CommandEncoder, ComputePass,
    ComputePassDescriptor, ComputePipeline,
};
use bytemuck::{Pod, Zeroable};

/// Most bytes of a slab's bins, and of the pyramids that are summed at once, where one layer takes less. Each has a sixth of the
/// memory, the particles have half; the rest is for lists of slabs and room to grow.
const BYTES_AT_ONCE: u64 = 64 << 20;

/// WGSL `LayerGroup`: layers of a slab that are summed at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct LayerGroup {
    /// Which slab.
    pub slab: u32,
    /// Number of slabs.
    pub slabs: u32,
    /// The first layer, from the slab's first.
    pub first: u32,
    /// The most layers that there may be.
    pub layers: u32,
    /// Where the dispatches begin whose workgroups along z are the layers.
    pub dispatch: u32,
    /// Number of these dispatches.
    pub dispatches: u32,
    /// Padding.
    pub unused: [u32; 2],
}

/// Layers whose bins a slab has room for.
pub fn layers_of_slab(layers: u32, grids: &Grids, memory: u64) -> u32 {
    at_once(layers, u64::from(grids.uniform.bin_count) * 4, memory)
}

/// Layers whose pyramids are summed at once.
fn layers_of_group(layers: u32, grids: &Grids, memory: u64) -> u32 {
    at_once(layers, u64::from(grids.cells) * 8, memory)
}

fn at_once(layers: u32, bytes: u64, memory: u64) -> u32 {
    (BYTES_AT_ONCE.min(memory / 6) / bytes.max(1)).clamp(1, layers.max(1).into()) as u32
}

/// Particles that may be listed at a time.
pub fn listed_within(memory: u64, grids: &Grids) -> u64 {
    spots::listed_within(memory / 2, SPLAT_BYTES + PLACE_BYTES + grids.slice_bytes())
}

/// Buffers that are kept from view to view.
struct Buffers {
    splats: Buffer,
    places: Buffer,
    starts: Buffer,
    parts: Buffer,
    cells: Buffer,
    portions: Buffer,
    dispatches: Buffer,
}

/// Some layers of a slab.
#[derive(Clone, Copy)]
struct Group {
    /// Its [`LayerGroup`]'s offset.
    offset: u32,
    /// Its first dispatch.
    dispatch: u32,
}

/// What the passes bind, and the buffers in which layers are summed.
pub struct LayerSums {
    buffers: Buffers,
    scratch: SumScratch,
    /// What follows the projection.
    pub sums: Sums,
    project: BindGroup,
    scan: BindGroup,
    layers: BindGroup,
    bins: Scan,
    plan: BindGroup,
    /// For each slab its groups of layers.
    groups: Vec<Vec<Group>>,
}

impl LayerSums {
    /// Binds what a view's passes need; `caps` are those of the kernel. Buffers are taken over from those before.
    pub fn new(before: Option<&LayerSums>, caps: &Buffer, to: &Binding<'_, super::Layered>) -> LayerSums {
        let (device, queue) = to.gpu;
        let (grids, spots) = (&to.particles.grids, to.spots);
        let tiling = spots.tiling();
        let count = tiling.uniform.layers;
        let of_slab = tiling.layers_at_once.unwrap_or(count);
        let of_group = layers_of_group(of_slab, grids, to.memory);

        let mut portions = Vec::new();
        let mut push = |bytes: &[u8]| {
            let offset = portions.len();
            portions.extend_from_slice(bytes);
            portions.resize(portions.len().next_multiple_of(ALIGNMENT as usize), 0);
            offset as u32
        };
        let length = of_slab * grids.uniform.bin_count + 1;
        let bins = Scan { length, portion: push(bytemuck::bytes_of(&Portion { length, ..Portion::default() })) };
        let slabs = spots.slabs() as u32;
        // What sums, and what blends.
        let pixels = grids.uniform.size.map(|pixels| pixels.div_ceil(BLEND_GROUP));
        let passes = [to.pipelines.sums.workgroups(grids), vec![pixels.into()]].concat();
        let mut dispatches: Vec<[u32; 3]> = Vec::new();
        let mut group = |slab, first| {
            let [dispatch, count] = [dispatches.len() as u32, passes.len() as u32];
            dispatches.extend(passes.iter().map(|&(x, y)| [x, y, 0]));
            let group =
                LayerGroup { slab, slabs, first, layers: of_group, dispatch, dispatches: count, unused: [0; 2] };
            Group { offset: push(bytemuck::bytes_of(&group)), dispatch }
        };
        let groups_of = |slab| (0..of_slab).step_by(of_group as usize).map(|first| group(slab, first)).collect();
        let groups: Vec<Vec<Group>> = (0..slabs).map(groups_of).collect();

        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let kept = |of: fn(&Buffers) -> &Buffer| before.map(|before| of(&before.buffers).clone());
        let take = |of: fn(&Buffers) -> &Buffer, bytes, label| at_least(kept(of), bytes, storage, label, device);
        let most = u64::from(spots.most());
        let moving = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let buffers = Buffers {
            splats: take(|b| &b.splats, most * SPLAT_BYTES, "deepfield splats of layers"),
            places: take(|b| &b.places, most * PLACE_BYTES, "deepfield places in layers"),
            starts: take(|b| &b.starts, u64::from(length) * 4, "deepfield bins of layers"),
            parts: take(|b| &b.parts, scan_parts(length) * 4, "deepfield parts of sums"),
            cells: take(|b| &b.cells, u64::from(of_group) * u64::from(grids.cells) * 8, "deepfield layers"),
            portions: at_least(kept(|b| &b.portions), portions.len() as u64, moving, "deepfield layer groups", device),
            dispatches: at_least(
                kept(|b| &b.dispatches),
                size_of_val(dispatches.as_slice()) as u64,
                storage | BufferUsages::INDIRECT,
                "deepfield dispatches of layers",
                device,
            ),
        };
        queue.write_buffer(&buffers.portions, 0, &portions);
        queue.write_buffer(&buffers.dispatches, 0, bytemuck::cast_slice(&dispatches));

        let view = &to.particles.shared.uniform;
        let summed = Summed {
            view,
            grids,
            splats: &buffers.splats,
            most,
            starts: &buffers.starts,
            cells: &buffers.cells,
            layers: of_group,
        };
        let mut scratch = before.map(|before| before.scratch.clone()).unwrap_or_default();
        let sums = Sums::new(&summed, &mut scratch, &to.pipelines.sums, to.cache, to.gpu);
        let project = [
            view,
            spots.uniform(),
            spots.work(),
            spots.spots(),
            &buffers.places,
            &buffers.starts,
            &buffers.splats,
            caps,
        ];
        let project = to.group(&to.pipelines.project, &project.map(whole));
        let scan = bind_scan(&buffers.portions, &buffers.starts, &buffers.parts, to.cache, device);
        let layers = device.create_bind_group(
            "deepfield layers of a slab",
            &to.cache.get_bind_group_layout(&to.pipelines.layers),
            &LayerSums::bindings(&buffers.portions, spots),
        );
        let plan = to.group(&to.pipelines.plan_layout, &[whole(&buffers.dispatches)]);
        LayerSums { buffers, scratch, sums, project, scan, layers, bins, plan, groups }
    }

    /// What says which layers are summed.
    fn bindings<'a>(portions: &'a Buffer, spots: &'a SpotList) -> [BindGroupEntry<'a>; 2] {
        let resources = [slice(portions, 0, size_of::<LayerGroup>() as u64), spots.slab_table().as_entire_binding()];
        let [group, slabs] = resources;
        let [first, second] = LAYER_BINDINGS;
        [BindGroupEntry { binding: first, resource: group }, BindGroupEntry { binding: second, resource: slabs }]
    }

    /// The same for a pass that binds `others` in the same group.
    pub fn with<'a>(&'a self, others: [BindingResource<'a>; 2], to: &'a Binding<'_, super::Layered>) -> BindGroup {
        let own = (0..).zip(others).map(|(binding, resource)| BindGroupEntry { binding, resource });
        let entries: Vec<_> = own.chain(LayerSums::bindings(&self.buffers.portions, to.spots)).collect();
        let layout = to.cache.get_bind_group_layout(&to.pipelines.matter);
        to.gpu.0.create_bind_group("deepfield matter of layers", &layout, &entries)
    }

    /// Brings a slab's splats into the order of their bins, by the passes `count` and `place`.
    pub fn project(
        &self,
        slab: usize,
        spots: &SpotList,
        [count, place]: [&ComputePipeline; 2],
        steps: &Steps<'_>,
        encoder: &mut CommandEncoder,
    ) {
        let Some(group) = self.groups[slab].first() else { return };
        encoder.clear_buffer(&self.buffers.starts, 0, None);
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        let run = |pipeline, pass: &mut ComputePass<'_>| {
            pass.set_bind_group(1, &self.layers, &[group.offset]);
            spots::each(pass, pipeline, &[&self.project], spots.work());
        };
        run(count, &mut pass);
        spots::scan(&mut pass, steps, &self.scan, self.bins);
        run(place, &mut pass);
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let Buffers { splats, places, starts, parts, cells, portions, dispatches } = &self.buffers;
        size_of_all([splats, places, starts, parts, cells, portions, dispatches]) + self.scratch.bytes()
    }

    /// The pyramids.
    pub fn cells(&self) -> &Buffer {
        &self.buffers.cells
    }

    /// Finds how many layers each slab has.
    pub fn plan(&self, plan: &ComputePipeline, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(plan);
        pass.set_bind_group(0, &self.plan, &[]);
        for group in self.groups.iter().flatten() {
            pass.set_bind_group(1, &self.layers, &[group.offset]);
            pass.dispatch_workgroups(1, 1, 1);
        }
    }

    /// The groups of a slab's layers.
    pub fn groups(&self, slab: usize) -> impl Iterator<Item = Layers<'_>> {
        self.groups[slab].iter().map(|group| Layers {
            group: &self.layers,
            offset: group.offset,
            dispatches: &self.buffers.dispatches,
            first: group.dispatch,
        })
    }
}
