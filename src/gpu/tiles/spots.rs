//! The particles of one view in slabs of depth that fit into memory: buffers, bind groups and the dispatches that fill them.

use super::constants::{INTERVALS, SCAN_GROUP};
use super::layout::{Portion, SPOT_BYTES, TileUniform, Tiling};
use super::pipelines::{Kind, Step, Steps};
use crate::gpu::splat::resources::{ALIGNMENT, at_least, size_of_all, slice, whole};
use crate::gpu::splat::{ParticleBatch, SplatBuffers};
use bevy::render::render_resource::{
    BindGroup, BindGroupEntry, BindGroupLayoutDescriptor, BindingResource, Buffer, BufferUsages, CommandEncoder,
    ComputePass, ComputePassDescriptor, ComputePipeline, PipelineCache,
};
use bevy::render::renderer::{RenderDevice, RenderQueue};

/// Particles that are listed at a time however little memory there is, and at most.
const SPOTS: [u64; 2] = [1 << 14, 1 << 22];

/// What differs between dispatches, and where each is in its buffer.
#[derive(Default)]
pub(super) struct Portions(Vec<u8>);

impl Portions {
    pub(super) fn push(&mut self, portion: Portion) -> u32 {
        let offset = self.0.len().next_multiple_of(ALIGNMENT as usize);
        self.0.resize(offset, 0);
        self.0.extend_from_slice(bytemuck::bytes_of(&portion));
        offset as u32
    }

    pub(super) fn length(&mut self, length: u32) -> u32 {
        self.push(Portion { length, ..Portion::default() })
    }

    fn of_batches(&mut self, batches: &[ParticleBatch], slab: u32, most: u32) -> Vec<u32> {
        let of =
            |batch: &ParticleBatch| self.push(Portion { slab, first_block: batch.first, most, ..Portion::default() });
        batches.iter().map(of).collect()
    }

    /// The buffer, from before where that is large enough.
    pub(super) fn buffer(mut self, before: Option<Buffer>, device: &RenderDevice, queue: &RenderQueue) -> Buffer {
        // The last binding must not reach behind the buffer's end.
        self.0.resize(self.0.len().next_multiple_of(ALIGNMENT as usize), 0);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let buffer = at_least(before, self.0.len() as u64, usage, "deepfield portions", device);
        queue.write_buffer(&buffer, 0, &self.0);
        buffer
    }
}

/// A list whose numbers become the sums of those before them.
#[derive(Clone, Copy)]
pub struct Scan {
    /// Its length.
    pub length: u32,
    /// The offset of its [`Portion`].
    pub portion: u32,
}

/// The words that the sum of a list needs in between.
pub fn scan_parts(length: u32) -> u64 {
    length.div_ceil(SCAN_GROUP).into()
}

/// Numbers become the sums of those before them.
pub fn scan(pass: &mut ComputePass<'_>, steps: &Steps<'_>, group: &BindGroup, list: Scan) {
    let groups = list.length.div_ceil(SCAN_GROUP);
    for (step, groups) in [(Step::SumList, groups), (Step::ScanParts, 1), (Step::SpreadList, groups)] {
        pass.set_pipeline(steps.get(step));
        pass.set_bind_group(0, group, &[list.portion]);
        pass.dispatch_workgroups(groups, 1, 1);
    }
}

/// One workgroup for each block of particles.
fn each_batch(
    pass: &mut ComputePass<'_>,
    pipeline: &ComputePipeline,
    particles: &SplatBuffers,
    group: &BindGroup,
    portions: &[u32],
) {
    pass.set_pipeline(pipeline);
    for (batch, &portion) in particles.particles.iter().zip(portions) {
        pass.set_bind_group(0, &batch.group, &[]);
        pass.set_bind_group(1, group, &[portion]);
        pass.dispatch_workgroups(batch.workgroups.0, batch.workgroups.1, 1);
    }
}

/// One invocation for each of the things that are counted in `work`.
pub fn each(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, groups: &[&BindGroup], work: &Buffer) {
    pass.set_pipeline(pipeline);
    (0..).zip(groups).for_each(|(index, group)| pass.set_bind_group(index, *group, &[]));
    pass.dispatch_workgroups_indirect(work, WORKGROUPS);
}

/// A number of things, of blocks of them to be sorted, and workgroups along x, y and z for one invocation each.
pub(super) const WORK_BYTES: u64 = 20;
/// Where the workgroups stand.
const WORKGROUPS: u64 = 8;

/// One invocation.
pub(super) fn one(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, group: &BindGroup, portion: u32) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group, &[portion]);
    pass.dispatch_workgroups(1, 1, 1);
}

/// Binds resources one after the other.
pub(super) fn bind(
    layout: &BindGroupLayoutDescriptor,
    resources: &[BindingResource<'_>],
    cache: &PipelineCache,
    device: &RenderDevice,
) -> BindGroup {
    let numbered = (0..).zip(resources);
    let entries: Vec<_> =
        numbered.map(|(binding, resource)| BindGroupEntry { binding, resource: resource.clone() }).collect();
    device.create_bind_group(&*layout.label, &cache.get_bind_group_layout(layout), &entries)
}

/// All of a buffer; of one with [`Portion`]s one, which moves.
pub(super) fn portion_of(portions: &Buffer) -> BindingResource<'_> {
    slice(portions, 0, size_of::<Portion>() as u64)
}

/// What the passes bind to sum a list.
pub fn bind_scan(
    portions: &Buffer,
    list: &Buffer,
    parts: &Buffer,
    cache: &PipelineCache,
    device: &RenderDevice,
) -> BindGroup {
    let resources = [portion_of(portions), list.as_entire_binding(), parts.as_entire_binding()];
    bind(&Kind::Scan.layout(), &resources, cache, device)
}

/// Buffers that are kept from view to view.
struct Buffers {
    uniform: Buffer,
    portions: Buffer,
    slabs: Buffer,
    intervals: Buffer,
    block_sums: Buffer,
    parts: Buffer,
    work: Buffer,
    spots: Buffer,
}

/// What the steps bind.
struct Groups {
    survey: BindGroup,
    blocks: BindGroup,
    divide: BindGroup,
    settle: BindGroup,
    scan_intervals: BindGroup,
    scan_blocks: BindGroup,
}

/// The dispatches of one slab: for each batch of particles, and for their number.
struct Slab {
    batches: Vec<u32>,
    settle: u32,
}

/// The particles of a view that are seen, slab by slab of depth.
pub struct SpotList {
    tiling: Tiling,
    buffers: Buffers,
    groups: Groups,
    most: u32,
    slabs: Vec<Slab>,
    /// What finds slabs on the adapter, where the particles are too many for one, or for what layers have room for.
    survey: Option<(Vec<u32>, u32)>,
    intervals: Scan,
    blocks: Scan,
}

/// How many particles may be listed at a time in so much memory, if a mode takes so many bytes for each beside the list.
pub fn listed_within(memory: u64, bytes: u64) -> u64 {
    // Buffers have room to grow, a quarter of their size; and a sixteenth is for lists of bins and of intervals.
    memory / 4 * 3 / (SPOT_BYTES + bytes)
}

/// How many slabs there may be of at most `most` of so many particles, and of at most `at_once` of all intervals of depth.
fn slab_count(candidates: u64, most: u32, [intervals, at_once]: [u32; 2]) -> u32 {
    let wide = intervals.div_ceil(at_once.max(1)).max(1);
    match candidates.div_ceil(most.into()) {
        0 | 1 => wide,
        // Two slabs that follow each other have more than there is room for, or the first is as wide as can be.
        full => 2 * full as u32 + wide,
    }
}

impl SpotList {
    /// Lists the particles of a camera, about `at_a_time` at a time. Buffers are taken over from the list before.
    pub fn new(
        tiling: Tiling,
        at_a_time: u64,
        particles: &SplatBuffers,
        before: Option<&SpotList>,
        cache: &PipelineCache,
        (device, queue): (&RenderDevice, &RenderQueue),
    ) -> SpotList {
        let batches = &particles.particles;
        let particles: u64 = batches.iter().map(|batch| u64::from(batch.particles)).sum();
        let candidates = particles * u64::from(tiling.most_parts);
        let limits = device.limits();
        // Buffers have room to grow, a quarter of their size.
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) * 4 / 5;
        let [least, greatest] = SPOTS;
        let most = candidates.clamp(1, at_a_time.clamp(least, greatest).min(limit / SPOT_BYTES).max(1)) as u32;
        // Each layer is an interval of its own.
        let (depths, at_once) = match tiling.layers_at_once {
            Some(at_once) => (tiling.uniform.layers, at_once),
            None => (INTERVALS, INTERVALS),
        };
        let slab_count = slab_count(candidates, most, [depths, at_once]);
        let block_count = batches.last().map_or(0, |last| last.first + last.blocks);

        let mut portions = Portions::default();
        let [intervals, blocks] =
            [INTERVALS + 1, block_count + 1].map(|length| Scan { length, portion: portions.length(length) });
        let survey = (candidates > u64::from(most)).then(|| {
            let divide = Portion { length: slab_count, most, intervals: depths, at_once, ..Portion::default() };
            (portions.of_batches(batches, 0, most), portions.push(divide))
        });
        let slabs = (0..slab_count)
            .map(|slab| Slab {
                batches: portions.of_batches(batches, slab, most),
                settle: portions.push(Portion { length: block_count, slab, most, ..Portion::default() }),
            })
            .collect();

        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let moving = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let kept = |of: fn(&Buffers) -> &Buffer| before.map(|before| of(&before.buffers).clone());
        let take =
            |of: fn(&Buffers) -> &Buffer, words: u64, label| at_least(kept(of), 4 * words, storage, label, device);
        let uniform_bytes = size_of::<TileUniform>() as u64;
        let parts = scan_parts(intervals.length.max(blocks.length));
        let buffers = Buffers {
            uniform: at_least(kept(|b| &b.uniform), uniform_bytes, moving, "deepfield tiles", device),
            portions: portions.buffer(kept(|b| &b.portions), device, queue),
            slabs: take(|b| &b.slabs, 4 * u64::from(slab_count), "deepfield slabs"),
            intervals: take(|b| &b.intervals, intervals.length.into(), "deepfield intervals of depth"),
            block_sums: take(|b| &b.block_sums, blocks.length.into(), "deepfield sums of blocks"),
            parts: take(|b| &b.parts, parts, "deepfield parts of sums"),
            work: at_least(
                kept(|b| &b.work),
                WORK_BYTES,
                storage | BufferUsages::INDIRECT,
                "deepfield number of particles",
                device,
            ),
            spots: take(|b| &b.spots, u64::from(most) * SPOT_BYTES / 4, "deepfield spots"),
        };
        queue.write_buffer(&buffers.uniform, 0, bytemuck::bytes_of(&tiling.uniform));
        if survey.is_none() {
            let at = |slab: u32| (slab * at_once).min(depths);
            let slabs: Vec<[u32; 4]> = (0..slab_count).map(|slab| [at(slab), at(slab + 1), 0, 0]).collect();
            queue.write_buffer(&buffers.slabs, 0, bytemuck::cast_slice(&slabs));
        }
        let groups = buffers.bind(cache, device);
        SpotList { tiling, buffers, groups, most, slabs, survey, intervals, blocks }
    }

    /// The tiles.
    pub fn tiling(&self) -> &Tiling {
        &self.tiling
    }

    /// The view's uniform.
    pub fn uniform(&self) -> &Buffer {
        &self.buffers.uniform
    }

    /// How many slabs there are.
    pub fn slabs(&self) -> usize {
        self.slabs.len()
    }

    /// For each slab its first interval of depths and the one behind its last, and how many of their particles belong to slabs
    /// before.
    pub fn slab_table(&self) -> &Buffer {
        &self.buffers.slabs
    }

    /// Number of the slab's particles, for [`each`] of them.
    pub fn work(&self) -> &Buffer {
        &self.buffers.work
    }

    /// The slab's particles.
    pub fn spots(&self) -> &Buffer {
        &self.buffers.spots
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let Buffers { uniform, portions, slabs, intervals, block_sums, parts, work, spots } = &self.buffers;
        size_of_all([uniform, portions, slabs, intervals, block_sums, parts, work, spots])
    }

    /// Most particles of a slab.
    pub fn most(&self) -> u32 {
        self.most
    }

    /// Finds slabs, where that takes a look at the particles.
    pub fn divide(&self, particles: &SplatBuffers, steps: &Steps<'_>, encoder: &mut CommandEncoder) {
        let Some((survey, divide)) = &self.survey else { return };
        encoder.clear_buffer(&self.buffers.intervals, 0, None);
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        each_batch(&mut pass, steps.get(Step::Survey), particles, &self.groups.survey, survey);
        scan(&mut pass, steps, &self.groups.scan_intervals, self.intervals);
        one(&mut pass, steps.get(Step::Divide), &self.groups.divide, *divide);
    }

    /// Lists a slab's particles.
    pub fn gather(&self, slab: usize, particles: &SplatBuffers, steps: &Steps<'_>, encoder: &mut CommandEncoder) {
        let slab = &self.slabs[slab];
        encoder.clear_buffer(&self.buffers.block_sums, 0, None);
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        each_batch(&mut pass, steps.get(Step::Count), particles, &self.groups.blocks, &slab.batches);
        scan(&mut pass, steps, &self.groups.scan_blocks, self.blocks);
        one(&mut pass, steps.get(Step::Settle), &self.groups.settle, slab.settle);
        each_batch(&mut pass, steps.get(Step::Gather), particles, &self.groups.blocks, &slab.batches);
    }
}

impl Buffers {
    fn bind(&self, cache: &PipelineCache, device: &RenderDevice) -> Groups {
        let portion = || portion_of(&self.portions);
        let gather = |sums| {
            let resources = [whole(&self.uniform), portion(), whole(&self.slabs), whole(sums), whole(&self.spots)];
            bind(&Kind::Gather.layout(), &resources, cache, device)
        };
        let plan = |sums| {
            let resources = [portion(), whole(sums), whole(&self.slabs), whole(&self.work)];
            bind(&Kind::Plan.layout(), &resources, cache, device)
        };
        let scan = |list| bind_scan(&self.portions, list, &self.parts, cache, device);
        Groups {
            survey: gather(&self.intervals),
            blocks: gather(&self.block_sums),
            divide: plan(&self.intervals),
            settle: plan(&self.block_sums),
            scan_intervals: scan(&self.intervals),
            scan_blocks: scan(&self.block_sums),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slabs of intervals as plan.wgsl's `divide` makes them.
    fn divided(counts: &[u32], most: u32, at_once: u32) -> u32 {
        let (mut slabs, mut first) = (0, 0);
        while first < counts.len() {
            let mut end = first;
            let mut held = 0;
            while end < counts.len() && end - first < at_once as usize && held + counts[end] <= most {
                held += counts[end];
                end += 1;
            }
            if end > first {
                slabs += 1;
                first = end;
            } else {
                slabs += counts[first].div_ceil(most);
                first += 1;
            }
        }
        slabs
    }

    #[test]
    fn there_are_slabs_enough() {
        let mut state = 1u32;
        let mut random = move |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % below
        };
        for _ in 0..2000 {
            let layers = 1 + random(60);
            let most = 1 + random(50);
            let widest = 1 + random(120);
            let counts: Vec<u32> = (0..layers).map(|_| random(widest)).collect();
            let at_once = 1 + random(layers);
            let needed = divided(&counts, most, at_once);
            let room = slab_count(counts.iter().map(|&count| u64::from(count)).sum(), most, [layers, at_once]);
            assert!(needed <= room, "{counts:?}: {needed} slabs of {most}, {at_once} layers at once; room for {room}");
        }
    }
}
