//! The lists of one view: buffers, bind groups and the dispatches that fill them.

use super::constants::{INTERVALS, MOST_BINS, SCAN_GROUP, THREADS, turns};
use super::layout::{Portion, SPOT_BYTES, TileUniform, Tiling};
use super::pipelines::{Kind, Step, Steps, TilePipelines, arrange_layout, walk_layout};
use crate::gpu::splat::resources::{ALIGNMENT, at_least, slice};
use crate::gpu::splat::{ParticleBatch, SplatBuffers, workgroups};
use crate::gpu::volume::constants::{DIGIT_BITS, DIGITS, SORT_BLOCK};
use bevy::render::diagnostic::RecordDiagnostics;
use bevy::render::render_resource::{
    BindGroup, BindGroupEntry, BindGroupLayoutDescriptor, BindingResource, Buffer, BufferUsages, ComputePass,
    ComputePassDescriptor, ComputePipeline, PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};

/// Most particles that are sorted at a time.
const MOST_SPOTS: u64 = 1 << 22;

/// Buffers that are kept from view to view.
struct Buffers {
    uniform: Buffer,
    portions: Buffer,
    slabs: Buffer,
    intervals: Buffer,
    block_sums: Buffer,
    pair_sums: Buffer,
    table: Buffer,
    parts: Buffer,
    /// Numbers of particles, and of pairs.
    work: [Buffer; 2],
    spots: Buffer,
    arranged: Buffer,
    reaches: Buffer,
    /// Of particles, then of pairs; sorted from one to the other.
    keys: [Buffer; 2],
    ranks: [Buffer; 2],
    ranges: Buffer,
    progress: Buffer,
}

/// What the steps bind.
struct Groups {
    survey: BindGroup,
    blocks: BindGroup,
    divide: BindGroup,
    settle: BindGroup,
    settle_pairs: BindGroup,
    scan_intervals: BindGroup,
    scan_blocks: BindGroup,
    scan_pairs: BindGroup,
    scan_table: BindGroup,
    spots: BindGroup,
    pairs: BindGroup,
    /// For each of the buffers that what is sorted may be in, as in those that follow.
    ranges: [BindGroup; 2],
    sort_spots: [BindGroup; 2],
    sort_pairs: [BindGroup; 2],
    arrange: [BindGroup; 2],
    walk: [BindGroup; 2],
}

/// A list that is summed.
#[derive(Clone, Copy)]
struct Scan {
    length: u32,
    portion: u32,
}

/// The dispatches of one slab: for each batch of particles, and for their number.
struct Slab {
    batches: Vec<u32>,
    settle: u32,
}

/// The particles of a view, slab by slab of depth, and their pairs with the picture's tiles.
pub struct TileList {
    tiling: Tiling,
    buffers: Buffers,
    groups: Groups,
    /// Most particles of a slab.
    most: u32,
    slabs: Vec<Slab>,
    survey: Vec<u32>,
    divide: u32,
    settle_pairs: u32,
    digits: Vec<u32>,
    intervals: Scan,
    blocks: Scan,
    pairs: Scan,
    table: Scan,
    turns: u32,
}

/// What a mode does with each slab's particles.
pub struct Drawing<'a> {
    /// Brings them into order, one invocation a particle.
    pub arrange: &'a ComputePipeline,
    /// What that binds behind the list's own group.
    pub arrange_group: Option<&'a BindGroup>,
    /// Walks over the tiles' particles, one workgroup a tile.
    pub walk: &'a ComputePipeline,
    /// What that binds behind the list's own group.
    pub walk_group: &'a BindGroup,
    /// The name of the walk's times.
    pub name: &'static str,
}

/// What differs between dispatches, and where each is in its buffer.
#[derive(Default)]
struct Portions(Vec<u8>);

impl Portions {
    fn push(&mut self, portion: Portion) -> u32 {
        let offset = self.0.len().next_multiple_of(ALIGNMENT as usize);
        self.0.resize(offset, 0);
        self.0.extend_from_slice(bytemuck::bytes_of(&portion));
        offset as u32
    }

    fn length(&mut self, length: u32) -> u32 {
        self.push(Portion { length, ..Portion::default() })
    }

    fn of_batches(&mut self, batches: &[ParticleBatch], slab: u32, most: u32) -> Vec<u32> {
        let of = |batch: &ParticleBatch| self.push(Portion { length: 0, slab, first_block: batch.first, most });
        batches.iter().map(of).collect()
    }
}

impl TileList {
    /// Lists the particles of a camera. Buffers are taken over from the list before.
    pub fn new(
        tiling: Tiling,
        particles: &SplatBuffers,
        before: Option<&TileList>,
        pipelines: &TilePipelines,
        cache: &PipelineCache,
        (device, queue): (&RenderDevice, &RenderQueue),
    ) -> TileList {
        let batches = &particles.particles;
        let particles: u64 = batches.iter().map(|batch| u64::from(batch.particles)).sum();
        let candidates = particles * u64::from(tiling.most_parts);
        let limits = device.limits();
        // Buffers have room to grow, a quarter of their size.
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) * 4 / 5;
        let most = candidates.clamp(1, MOST_SPOTS.min(limit / SPOT_BYTES).max(1)) as u32;
        let most_pairs = MOST_BINS * u64::from(most);
        let slab_count = match candidates.div_ceil(u64::from(most)) {
            0 | 1 => 1,
            // Two slabs that follow each other have more than there is room for.
            full => 2 * full as u32 + 1,
        };
        let block_count = batches.last().map_or(0, |last| last.first + last.blocks);
        let sort_blocks = most_pairs.div_ceil(u64::from(SORT_BLOCK)) as u32;
        let [block_list, pair_list, table_list] = [block_count + 1, most.div_ceil(THREADS) + 1, DIGITS * sort_blocks];

        let mut portions = Portions::default();
        let [intervals, blocks, pairs, table] = [INTERVALS + 1, block_list, pair_list, table_list]
            .map(|length| Scan { length, portion: portions.length(length) });
        let digits = (0..u32::BITS / DIGIT_BITS).map(|digit| portions.length(digit)).collect();
        let divide = portions.push(Portion { length: slab_count, most, ..Portion::default() });
        let survey = portions.of_batches(batches, 0, most);
        let slabs = (0..slab_count)
            .map(|slab| Slab {
                batches: portions.of_batches(batches, slab, most),
                settle: portions.push(Portion { length: block_count, slab, first_block: 0, most }),
            })
            .collect();
        // Behind the workgroups stands the sum of all.
        let settle_pairs = portions.length(pair_list - 1);

        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let moving = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let kept = |of: fn(&Buffers) -> &Buffer| before.map(|before| of(&before.buffers).clone());
        let take =
            |of: fn(&Buffers) -> &Buffer, words: u64, label| at_least(kept(of), 4 * words, storage, label, device);
        let uniform_bytes = size_of::<TileUniform>() as u64;
        let parts = [INTERVALS + 1, block_list, pair_list, table_list].into_iter().max().unwrap_or(1);
        let spot_words = u64::from(most) * SPOT_BYTES / 4;
        // The last binding must not reach behind the buffer's end.
        portions.0.resize(portions.0.len().next_multiple_of(ALIGNMENT as usize), 0);
        let buffers = Buffers {
            uniform: at_least(kept(|b| &b.uniform), uniform_bytes, moving, "deepfield tiles", device),
            portions: at_least(kept(|b| &b.portions), portions.0.len() as u64, moving, "deepfield portions", device),
            slabs: take(|b| &b.slabs, 4 * u64::from(slab_count), "deepfield slabs"),
            intervals: take(|b| &b.intervals, u64::from(INTERVALS) + 1, "deepfield intervals of depth"),
            block_sums: take(|b| &b.block_sums, block_list.into(), "deepfield sums of blocks"),
            pair_sums: take(|b| &b.pair_sums, pair_list.into(), "deepfield sums of pairs"),
            table: take(|b| &b.table, table_list.into(), "deepfield digits"),
            parts: take(|b| &b.parts, parts.div_ceil(SCAN_GROUP).into(), "deepfield parts of sums"),
            work: [
                take(|b| &b.work[0], 2, "deepfield number of particles"),
                take(|b| &b.work[1], 2, "deepfield number of pairs"),
            ],
            spots: take(|b| &b.spots, spot_words, "deepfield spots"),
            arranged: take(|b| &b.arranged, spot_words, "deepfield spots in order"),
            reaches: take(|b| &b.reaches, 2 * u64::from(most), "deepfield reaches"),
            keys: [
                take(|b| &b.keys[0], most_pairs, "deepfield keys"),
                take(|b| &b.keys[1], most_pairs, "deepfield keys"),
            ],
            ranks: [
                take(|b| &b.ranks[0], most_pairs, "deepfield ranks"),
                take(|b| &b.ranks[1], most_pairs, "deepfield ranks"),
            ],
            ranges: take(|b| &b.ranges, 2 * u64::from(tiling.bins), "deepfield bins"),
            progress: take(|b| &b.progress, tiling.tiles.map(u64::from).iter().product(), "deepfield progress"),
        };
        queue.write_buffer(&buffers.uniform, 0, bytemuck::bytes_of(&tiling.uniform));
        queue.write_buffer(&buffers.portions, 0, &portions.0);
        // All particles are one slab; where that is too many, slabs are found on the adapter.
        queue.write_buffer(&buffers.slabs, 0, bytemuck::bytes_of(&[0, INTERVALS, 0, 0]));

        let groups = buffers.bind(cache, device);
        TileList {
            turns: turns(pipelines.is_software, most, tiling.uniform.level_count),
            tiling,
            groups,
            buffers,
            most,
            slabs,
            survey,
            divide,
            settle_pairs,
            digits,
            intervals,
            blocks,
            pairs,
            table,
        }
    }

    /// The tiles.
    pub fn tiling(&self) -> &Tiling {
        &self.tiling
    }

    /// The view's uniform.
    pub fn uniform(&self) -> &Buffer {
        &self.buffers.uniform
    }

    /// The binding of a [`Portion`], which moves.
    pub fn portions(&self) -> BindingResource<'_> {
        self.buffers.resource(&self.buffers.portions)
    }

    /// The offset of the portion with this number in place of a length, below eight.
    pub fn numbered(&self, number: usize) -> u32 {
        self.digits[number]
    }

    /// Draws all slabs, front to back, and times it as the passes "list" and that of the drawing.
    pub fn draw(
        &self,
        particles: &SplatBuffers,
        steps: &Steps<'_>,
        drawing: &Drawing<'_>,
        context: &mut RenderContext,
    ) {
        let diagnostics = context.diagnostic_recorder();
        let diagnostics = diagnostics.as_deref();
        let encoder = context.command_encoder();
        let (buffers, groups) = (&self.buffers, &self.groups);
        let depth_digits = self.tiling.key_bits.div_ceil(DIGIT_BITS) as usize;
        let bin_digits = self.bin_digits();
        if self.slabs.len() > 1 {
            let span = diagnostics.time_span(encoder, "list");
            encoder.clear_buffer(&buffers.intervals, 0, None);
            {
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                each_batch(&mut pass, steps.get(Step::Survey), particles, &groups.survey, &self.survey);
                scan(&mut pass, steps, &groups.scan_intervals, self.intervals);
                one(&mut pass, steps.get(Step::Divide), &groups.divide, self.divide);
            }
            span.end(encoder);
        }
        for slab in &self.slabs {
            let encoder = context.command_encoder();
            let span = diagnostics.time_span(encoder, "list");
            for buffer in [&buffers.block_sums, &buffers.pair_sums, &buffers.ranges, &buffers.progress] {
                encoder.clear_buffer(buffer, 0, None);
            }
            {
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                each_batch(&mut pass, steps.get(Step::Count), particles, &groups.blocks, &slab.batches);
                scan(&mut pass, steps, &groups.scan_blocks, self.blocks);
                one(&mut pass, steps.get(Step::Settle), &groups.settle, slab.settle);
                each_batch(&mut pass, steps.get(Step::Gather), particles, &groups.blocks, &slab.batches);
                let spots = u64::from(self.most);
                each(&mut pass, steps.get(Step::NumberSpots), &[&groups.spots], spots);
                self.sort(&mut pass, steps, &groups.sort_spots, depth_digits, spots);
                let arrange_groups: Vec<&BindGroup> =
                    [&groups.arrange[depth_digits % 2]].into_iter().chain(drawing.arrange_group).collect();
                each(&mut pass, drawing.arrange, &arrange_groups, spots);
                each(&mut pass, steps.get(Step::CountPairs), &[&groups.pairs], spots);
                scan(&mut pass, steps, &groups.scan_pairs, self.pairs);
                one(&mut pass, steps.get(Step::SettlePairs), &groups.settle_pairs, self.settle_pairs);
                each(&mut pass, steps.get(Step::WritePairs), &[&groups.pairs], spots);
                let pairs = MOST_BINS * spots;
                self.sort(&mut pass, steps, &groups.sort_pairs, bin_digits, pairs);
                each(&mut pass, steps.get(Step::FindRanges), &[&groups.ranges[bin_digits % 2]], pairs);
            }
            span.end(encoder);
            self.walk(drawing.walk, drawing.walk_group, drawing.name, self.turns, context);
        }
    }

    /// One workgroup for each tile, behind all slabs.
    pub fn draw_tiles(
        &self,
        pipeline: &ComputePipeline,
        group: &BindGroup,
        name: &'static str,
        context: &mut RenderContext,
    ) {
        self.walk(pipeline, group, name, 1, context);
    }

    fn walk(
        &self,
        pipeline: &ComputePipeline,
        group: &BindGroup,
        name: &'static str,
        turns: u32,
        context: &mut RenderContext,
    ) {
        let diagnostics = context.diagnostic_recorder();
        let diagnostics = diagnostics.as_deref();
        let encoder = context.command_encoder();
        let span = diagnostics.time_span(encoder, name);
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &self.groups.walk[self.bin_digits() % 2], &[]);
            pass.set_bind_group(1, group, &[]);
            let [x, y] = self.tiling.tiles;
            for _ in 0..turns {
                pass.dispatch_workgroups(x, y, 1);
            }
        }
        span.end(encoder);
    }

    /// Digits that pairs are sorted by.
    fn bin_digits(&self) -> usize {
        (u32::BITS - self.tiling.bins.saturating_sub(1).leading_zeros()).div_ceil(DIGIT_BITS) as usize
    }

    /// Sorts by so many digits; what is sorted is then in the first or the second buffers, as the number is even or odd.
    fn sort(&self, pass: &mut ComputePass<'_>, steps: &Steps<'_>, groups: &[BindGroup; 2], digits: usize, most: u64) {
        let blocks = workgroups(most.div_ceil(u64::from(SORT_BLOCK)) as u32);
        for (digit, &portion) in self.digits.iter().enumerate().take(digits) {
            let run = |step, pass: &mut ComputePass<'_>| {
                pass.set_pipeline(steps.get(step));
                pass.set_bind_group(0, &groups[digit % 2], &[portion]);
                pass.dispatch_workgroups(blocks.0, blocks.1, 1);
            };
            run(Step::Tally, pass);
            scan(pass, steps, &self.groups.scan_table, self.table);
            run(Step::MovePairs, pass);
        }
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

/// One invocation for each of `most` things.
fn each(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, groups: &[&BindGroup], most: u64) {
    pass.set_pipeline(pipeline);
    (0..).zip(groups).for_each(|(index, group)| pass.set_bind_group(index, *group, &[]));
    let (x, y) = workgroups(most.div_ceil(u64::from(THREADS)) as u32);
    pass.dispatch_workgroups(x, y, 1);
}

/// One invocation.
fn one(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, group: &BindGroup, portion: u32) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group, &[portion]);
    pass.dispatch_workgroups(1, 1, 1);
}

/// Numbers become the sums of those before them.
fn scan(pass: &mut ComputePass<'_>, steps: &Steps<'_>, group: &BindGroup, list: Scan) {
    let groups = list.length.div_ceil(SCAN_GROUP);
    for (step, groups) in [(Step::SumList, groups), (Step::ScanParts, 1), (Step::SpreadList, groups)] {
        pass.set_pipeline(steps.get(step));
        pass.set_bind_group(0, group, &[list.portion]);
        pass.dispatch_workgroups(groups, 1, 1);
    }
}

impl Buffers {
    fn bind(&self, cache: &PipelineCache, device: &RenderDevice) -> Groups {
        let Buffers { uniform, intervals, block_sums, pair_sums, slabs, table, parts, spots, arranged, .. } = self;
        let Buffers { work: [work, pair_work], keys, ranks, ranges, progress, reaches, .. } = self;
        let group = |layout: &BindGroupLayoutDescriptor, resources: &[BindingResource<'_>]| {
            let numbered = (0..).zip(resources);
            let entries: Vec<_> =
                numbered.map(|(binding, resource)| BindGroupEntry { binding, resource: resource.clone() }).collect();
            device.create_bind_group("deepfield tiles", &cache.get_bind_group_layout(layout), &entries)
        };
        let of = |kind: Kind, buffers: &[&Buffer]| {
            let resources: Vec<_> = buffers.iter().map(|buffer| self.resource(buffer)).collect();
            group(&kind.layout(), &resources)
        };
        let portions = &self.portions;
        let gather = |sums| of(Kind::Gather, &[uniform, portions, slabs, sums, spots]);
        let plan = |sums, work| of(Kind::Plan, &[portions, sums, slabs, work]);
        let scan = |list| of(Kind::Scan, &[portions, list, parts]);
        let pairs = |work, spots, order: usize| {
            of(Kind::Pairs, &[uniform, work, spots, pair_sums, &keys[order], &ranks[order], ranges, reaches])
        };
        let sort = |work: &Buffer| {
            [0, 1].map(|order: usize| {
                let other = 1 - order;
                let lists = [&keys[order], &ranks[order], &keys[other], &ranks[other]];
                of(Kind::Sort, &[portions, work, lists[0], lists[1], lists[2], lists[3], table])
            })
        };
        let arrange = |order: usize| {
            let buffers = [uniform, work, spots, &ranks[order], arranged, reaches];
            group(&arrange_layout(), &buffers.map(|buffer| self.resource(buffer)))
        };
        let walk = |order: usize| {
            let buffers = [uniform, &ranks[order], ranges, progress, arranged];
            group(&walk_layout(), &buffers.map(|buffer| self.resource(buffer)))
        };
        Groups {
            survey: gather(intervals),
            blocks: gather(block_sums),
            divide: plan(intervals, work),
            settle: plan(block_sums, work),
            settle_pairs: plan(pair_sums, pair_work),
            scan_intervals: scan(intervals),
            scan_blocks: scan(block_sums),
            scan_pairs: scan(pair_sums),
            scan_table: scan(table),
            spots: pairs(work, spots, 0),
            pairs: pairs(work, arranged, 0),
            ranges: [0, 1].map(|order| pairs(pair_work, arranged, order)),
            sort_spots: sort(work),
            sort_pairs: sort(pair_work),
            arrange: [0, 1].map(arrange),
            walk: [0, 1].map(walk),
        }
    }

    /// All of a buffer; of the portions one, which moves.
    fn resource<'a>(&self, buffer: &'a Buffer) -> BindingResource<'a> {
        match buffer.id() == self.portions.id() {
            true => slice(buffer, 0, size_of::<Portion>() as u64),
            false => buffer.as_entire_binding(),
        }
    }
}
