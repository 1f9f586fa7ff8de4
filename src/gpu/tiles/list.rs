//! The particles of each slab by the tiles that they reach: buffers, bind groups and the dispatches that fill them.

use super::constants::{MOST_BINS, THREADS, turns};
use super::layout::SPOT_BYTES;
use super::pipelines::{Kind, Step, Steps, TilePipelines, arrange_layout, walk_layout};
use super::spots::{Portions, Scan, SpotList, WORK_BYTES, bind, bind_scan, each, one, portion_of, scan, scan_parts};
use crate::gpu::splat::resources::{at_least, size_of_all, whole};
use crate::gpu::splat::{SplatBuffers, workgroups};
use crate::gpu::timing::PassTimer;
use crate::gpu::volume::constants::{DIGIT_BITS, DIGITS, SORT_BLOCK};
use bevy::render::render_resource::{
    BindGroup, BindingResource, Buffer, BufferUsages, ComputePass, ComputePassDescriptor, ComputePipeline,
    PipelineCache,
};
use bevy::render::renderer::{RenderContext, RenderDevice, RenderQueue};

/// Buffers that are kept from view to view.
struct Buffers {
    portions: Buffer,
    pair_sums: Buffer,
    table: Buffer,
    parts: Buffer,
    pair_work: Buffer,
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
    settle_pairs: BindGroup,
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

/// The particles of a [`SpotList`], and their pairs with the picture's tiles.
pub struct TileList {
    buffers: Buffers,
    groups: Groups,
    settle_pairs: u32,
    digits: Vec<u32>,
    pairs: Scan,
    table: Scan,
    turns: u32,
    /// Tiles along x and y.
    tiles: [u32; 2],
    /// Digits that particles are sorted by, and pairs.
    sorted_digits: [usize; 2],
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
    /// Measures it, and the list.
    pub timer: &'a PassTimer,
}

impl TileList {
    /// Bytes for each particle: in order, where it reaches, and its pairs, twice each; and for each block of pairs a table of digits.
    pub const SPOT_BYTES: u64 = SPOT_BYTES + 8 + MOST_BINS * (16 + 4 * DIGITS as u64 / SORT_BLOCK as u64);

    /// Lists particles by tiles. Buffers are taken over from the list before.
    pub fn new(
        spots: &SpotList,
        before: Option<&TileList>,
        pipelines: &TilePipelines,
        cache: &PipelineCache,
        (device, queue): (&RenderDevice, &RenderQueue),
    ) -> TileList {
        let (tiling, most) = (spots.tiling(), spots.most());
        let most_pairs = MOST_BINS * u64::from(most);
        let sort_blocks = most_pairs.div_ceil(u64::from(SORT_BLOCK)) as u32;
        let [pair_list, table_list] = [most.div_ceil(THREADS) + 1, DIGITS * sort_blocks];

        let mut portions = Portions::default();
        let [pairs, table] = [pair_list, table_list].map(|length| Scan { length, portion: portions.length(length) });
        let digits = (0..u32::BITS / DIGIT_BITS).map(|digit| portions.length(digit)).collect();
        // Behind the workgroups stands the sum of all.
        let settle_pairs = portions.length(pair_list - 1);

        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let kept = |of: fn(&Buffers) -> &Buffer| before.map(|before| of(&before.buffers).clone());
        let take =
            |of: fn(&Buffers) -> &Buffer, words: u64, label| at_least(kept(of), 4 * words, storage, label, device);
        let buffers = Buffers {
            portions: portions.buffer(kept(|b| &b.portions), device, queue),
            pair_sums: take(|b| &b.pair_sums, pair_list.into(), "deepfield sums of pairs"),
            table: take(|b| &b.table, table_list.into(), "deepfield digits"),
            parts: take(|b| &b.parts, scan_parts(pair_list.max(table_list)), "deepfield parts of sums"),
            pair_work: at_least(
                kept(|b| &b.pair_work),
                WORK_BYTES,
                storage | BufferUsages::INDIRECT,
                "deepfield number of pairs",
                device,
            ),
            arranged: take(|b| &b.arranged, u64::from(most) * SPOT_BYTES / 4, "deepfield spots in order"),
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
        let groups = buffers.bind(spots, cache, device);
        let bin_bits = u32::BITS - tiling.bins.saturating_sub(1).leading_zeros();
        TileList {
            turns: turns(pipelines.is_software, most, tiling.uniform.level_count),
            tiles: tiling.tiles,
            sorted_digits: [tiling.key_bits, bin_bits].map(|bits| bits.div_ceil(DIGIT_BITS) as usize),
            groups,
            buffers,
            settle_pairs,
            digits,
            pairs,
            table,
        }
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let b = &self.buffers;
        let lists = [&b.portions, &b.pair_sums, &b.table, &b.parts, &b.pair_work, &b.arranged, &b.reaches];
        size_of_all(lists.into_iter().chain([&b.ranges, &b.progress]).chain(&b.keys).chain(&b.ranks))
    }

    /// The binding of a [`super::layout::Portion`], which moves.
    pub fn portions(&self) -> BindingResource<'_> {
        portion_of(&self.buffers.portions)
    }

    /// The offset of the portion with this number in place of a length, below eight.
    pub fn numbered(&self, number: usize) -> u32 {
        self.digits[number]
    }

    /// Draws all slabs, front to back, and times it as the passes "list" and that of the drawing.
    pub fn draw(
        &self,
        spots: &SpotList,
        particles: &SplatBuffers,
        steps: &Steps<'_>,
        drawing: &Drawing<'_>,
        context: &mut RenderContext,
    ) {
        let (buffers, groups) = (&self.buffers, &self.groups);
        let [depth_digits, bin_digits] = self.sorted_digits;
        let most = u64::from(spots.most());
        let encoder = context.command_encoder();
        for slab in 0..spots.slabs() {
            let span = drawing.timer.begin("list", encoder);
            if slab == 0 {
                spots.divide(particles, steps, encoder);
            }
            for buffer in [&buffers.pair_sums, &buffers.ranges, &buffers.progress] {
                encoder.clear_buffer(buffer, 0, None);
            }
            spots.gather(slab, particles, steps, encoder);
            {
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                let work = spots.work();
                each(&mut pass, steps.get(Step::NumberSpots), &[&groups.spots], work);
                self.sort(&mut pass, steps, &groups.sort_spots, depth_digits, most);
                let arrange_groups: Vec<&BindGroup> =
                    [&groups.arrange[depth_digits % 2]].into_iter().chain(drawing.arrange_group).collect();
                each(&mut pass, drawing.arrange, &arrange_groups, work);
                each(&mut pass, steps.get(Step::CountPairs), &[&groups.pairs], work);
                scan(&mut pass, steps, &groups.scan_pairs, self.pairs);
                one(&mut pass, steps.get(Step::SettlePairs), &groups.settle_pairs, self.settle_pairs);
                each(&mut pass, steps.get(Step::WritePairs), &[&groups.pairs], work);
                self.sort(&mut pass, steps, &groups.sort_pairs, bin_digits, MOST_BINS * most);
                each(&mut pass, steps.get(Step::FindRanges), &[&groups.ranges[bin_digits % 2]], &buffers.pair_work);
            }
            span.end(encoder);
            let span = drawing.timer.begin(drawing.name, encoder);
            {
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                pass.set_pipeline(drawing.walk);
                pass.set_bind_group(0, &groups.walk[bin_digits % 2], &[]);
                pass.set_bind_group(1, drawing.walk_group, &[]);
                for _ in 0..self.turns {
                    pass.dispatch_workgroups(self.tiles[0], self.tiles[1], 1);
                }
            }
            span.end(encoder);
        }
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

impl Buffers {
    fn bind(&self, list: &SpotList, cache: &PipelineCache, device: &RenderDevice) -> Groups {
        let portion = || portion_of(&self.portions);
        let Buffers { pair_sums, table, arranged, pair_work, keys, ranks, ranges, progress, reaches, .. } = self;
        let (uniform, work, spots) = (list.uniform(), list.work(), list.spots());
        let group = |layout, resources: &[BindingResource<'_>]| bind(&layout, resources, cache, device);
        let pairs = |work, spots, order: usize| {
            let buffers = [uniform, work, spots, pair_sums, &keys[order], &ranks[order], ranges, reaches];
            group(Kind::Pairs.layout(), &buffers.map(whole))
        };
        let sort = |work: &Buffer| {
            [0, 1].map(|order: usize| {
                let other = 1 - order;
                let lists = [work, &keys[order], &ranks[order], &keys[other], &ranks[other], table].map(whole);
                group(Kind::Sort.layout(), &[&[portion()], &lists[..]].concat())
            })
        };
        let arrange = |order: usize| {
            group(arrange_layout(), &[uniform, work, spots, &ranks[order], arranged, reaches].map(whole))
        };
        let walk =
            |order: usize| group(walk_layout(), &[uniform, &ranks[order], ranges, progress, arranged].map(whole));
        Groups {
            settle_pairs: group(
                Kind::Plan.layout(),
                &[portion(), whole(pair_sums), whole(list.slab_table()), whole(pair_work)],
            ),
            scan_pairs: bind_scan(&self.portions, pair_sums, &self.parts, cache, device),
            scan_table: bind_scan(&self.portions, table, &self.parts, cache, device),
            spots: pairs(work, spots, 0),
            pairs: pairs(work, arranged, 0),
            ranges: [0, 1].map(|order| pairs(pair_work, arranged, order)),
            sort_spots: sort(work),
            sort_pairs: sort(pair_work),
            arrange: [0, 1].map(arrange),
            walk: [0, 1].map(walk),
        }
    }
}
