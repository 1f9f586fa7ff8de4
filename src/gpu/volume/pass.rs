//! Encodes the slabs that a frame draws.

use super::bindings::{ALL_BRICKS, CHOSEN_GROUPS, CROWDED, EFFORT, Filling, SORT_GROUPS, offset};
use super::constants::{ALL_PAIRS, ALL_RAISED, BIN_GROUP, HEADER, SCAN_GROUP};
use super::march;
use super::prepare::VolumeWork;
use super::programs::{Step, VolumePipelines};
use super::view::Shows;
use super::work::{Batch, FieldRun, SlabWork, Work};
use crate::gpu::answer::Answer;
use crate::gpu::timing::PassTimer;
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy::render::render_resource::{
    BindGroup, Buffer, CommandEncoder, ComputePass, ComputePassDescriptor, ComputePipeline, PipelineCache,
};
use bevy::render::renderer::{RenderContext, ViewQuery};
use std::sync::atomic::Ordering;

/// Invocations of a workgroup over bricks.
const BRICK_GROUP: u32 = 64;
/// Invocations of a workgroup over pixels, along each axis.
const PIXEL_GROUP: u32 = 8;

/// Workgroups along x, y and z for `count` of them: one dimension holds at most 65535.
fn groups(count: u32) -> [u32; 3] {
    let (x, y) = crate::gpu::splat::workgroups(count);
    [x, y, 1]
}

/// A pass in which steps are taken.
struct Steps<'a> {
    pass: ComputePass<'a>,
    pipelines: &'a HashMap<Step, &'a ComputePipeline>,
}

impl Steps<'_> {
    fn take(&mut self, step: Step, bindings: &BindGroup, offsets: &[u32], [x, y, z]: [u32; 3]) {
        self.set(step, bindings, offsets);
        self.pass.dispatch_workgroups(x, y, z);
    }

    fn take_as_told(&mut self, step: Step, bindings: &BindGroup, offsets: &[u32], told: &Buffer, at: u64) {
        self.set(step, bindings, offsets);
        self.pass.dispatch_workgroups_indirect(told, at);
    }

    fn set(&mut self, step: Step, bindings: &BindGroup, offsets: &[u32]) {
        if let Some(pipeline) = self.pipelines.get(&step) {
            self.pass.set_pipeline(pipeline);
        }
        self.pass.set_bind_group(0, bindings, offsets);
    }
}

/// Draws the slabs that the frame has time for.
pub fn draw_volumes(
    view: ViewQuery<&VolumeWork>,
    pipelines: Option<Res<VolumePipelines>>,
    (cache, timer): (Res<PipelineCache>, Res<PassTimer>),
    mut context: RenderContext,
) {
    let work = view.into_inner();
    let Some(pipelines) = pipelines else { return };
    for (work, planned) in work.planned() {
        let Some(pipelines) = pipelines.get(work.variant, &cache) else { continue };
        let encoder = context.command_encoder();
        for slab in &work.slabs[planned.clone()] {
            if slab.opens {
                begin_pane(work, encoder);
            }
            // Of a grid that is held there is none.
            let fills = !slab.columns.is_empty() || !slab.runs.is_empty();
            let span = fills.then(|| timer.begin("resample", encoder));
            for (index, run) in slab.runs.iter().enumerate() {
                encoder.clear_buffer(&work.buffers.items.buffer, 0, Some(4 * u64::from(HEADER)));
                let pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                let mut steps = Steps { pass, pipelines: &pipelines };
                fill(work, &mut steps, run, offset(slab.first_portion + 1 + index));
            }
            let mut portion = slab.first_portion;
            for (batches, filling) in slab.columns.iter().zip(&work.groups.filling) {
                for (index, batch) in batches.iter().enumerate() {
                    encoder.clear_buffer(&work.buffers.bins.buffer, 0, Some(work.buffers.bins.bytes));
                    encoder.clear_buffer(&work.buffers.items.buffer, 0, Some(4 * u64::from(HEADER)));
                    let pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                    let mut steps = Steps { pass, pipelines: &pipelines };
                    resample((work, filling), &mut steps, slab, batch, offset(portion));
                    portion += 1;
                    if index + 1 == batches.len() {
                        interpolate((work, filling), &mut steps, slab);
                        let bricks = groups(work.cut.finest().columns() * slab.layers);
                        for read in &filling.reads {
                            steps.take(Step::ReadColumn, read, &[offset(slab.first_portion)], bricks);
                        }
                    }
                }
            }
            if let Some(span) = span {
                span.end(encoder);
            }
            let span = timer.begin("cast", encoder);
            finish_slab(work, encoder, &pipelines, slab);
            span.end(encoder);
            if slab.closes {
                end_pane(work, encoder, slab);
                let is_whole = slab.pane + 1 == work.panes.len();
                if let Some(sides) = work.groups.smooth.as_ref().filter(|_| is_whole && work.variant.smooth) {
                    let span = timer.begin("smooth", encoder);
                    smooth((work, sides), encoder, &pipelines, slab);
                    span.end(encoder);
                }
            }
        }
        work.done.store(planned.end, Ordering::Relaxed);
    }
}

/// Forgets what an earlier window has left.
fn begin_pane(work: &Work, encoder: &mut CommandEncoder) {
    let buffers = &work.buffers;
    let all = [&buffers.rays, &buffers.progress, &buffers.densest, &buffers.hidden];
    for held in all.into_iter().chain(&buffers.columns) {
        encoder.clear_buffer(&held.buffer, 0, Some(held.bytes));
    }
    if work.job.cartesian().is_some() {
        // Parts of bricks that nothing reaches are not written, but read.
        encoder.clear_buffer(&buffers.field.buffer, 0, Some(buffers.field.bytes));
    }
    if work.done.load(Ordering::Relaxed) == 0 {
        encoder.clear_buffer(&buffers.work.buffer, 0, None);
        encoder.clear_buffer(&buffers.dispatch.buffer, 0, None);
        encoder.clear_buffer(&buffers.masses.buffer, 0, None);
    }
    // Somebody sees something before anything has been drawn.
    encoder.copy_buffer_to_buffer(&work.one.buffer, 0, &buffers.visible.buffer, 0, 4);
}

/// Fills layers of a slab from a level of a field.
fn fill(work: &Work, steps: &mut Steps<'_>, run: &FieldRun, at: u32) {
    let bound = &work.groups;
    let (Some(level), Some(filling)) = (bound.field.get(&run.level), bound.filling.first()) else { return };
    steps.take(Step::PlanField, level, &[at], groups(run.bricks.div_ceil(BRICK_GROUP)));
    steps.take(Step::DispatchBricks, &filling.plan, &[at], [1, 1, 1]);
    steps.take_as_told(Step::Fill, level, &[at], &work.buffers.dispatch.buffer, 0);
}

/// Adds a batch of particles to a slab's cells.
fn resample((work, filling): (&Work, &Filling), steps: &mut Steps<'_>, slab: &SlabWork, batch: &Batch, at: u32) {
    let (bound, buffers) = (&work.groups, &work.buffers);
    let [of_bins, of_pairs, of_digits] = &bound.scans;
    let once = [1, 1, 1];
    for loaded in &batch.loaded {
        steps.pass.set_bind_group(1, &bound.project, &[]);
        let (x, y) = loaded.workgroups;
        steps.take(Step::Project, &loaded.particles, &[], [x, y, 1]);
    }
    let particles = groups(batch.candidates.div_ceil(BIN_GROUP));
    steps.take(Step::Count, &bound.bin, &[at], particles);
    steps.take(Step::ScanPairs, of_pairs, &[at], once);
    steps.take(Step::Pair, &bound.bin, &[at], particles);
    let bins = [(work.bin_count + 1).div_ceil(SCAN_GROUP), 1, 1];
    steps.take(Step::SumBins, of_bins, &[at], bins);
    steps.take(Step::ScanParts, of_bins, &[at], once);
    steps.take(Step::SpreadBins, of_bins, &[at], bins);
    for digit in 0..work.digits as usize {
        let sort = &bound.sorts[digit % 2];
        steps.take_as_told(Step::Tally, sort, &[offset(digit)], &buffers.work.buffer, SORT_GROUPS);
        steps.take(Step::ScanTable, of_digits, &[at], once);
        steps.take_as_told(Step::MovePairs, sort, &[offset(digit)], &buffers.work.buffer, SORT_GROUPS);
    }
    let bricks: u32 = slab.bricks.iter().sum();
    steps.take(Step::Plan, &filling.plan, &[at], groups(bricks.div_ceil(BRICK_GROUP)));
    steps.take(Step::DispatchBricks, &filling.plan, &[at], once);
    for turn in 0..batch.turns as usize {
        let told = if turn == 0 { 0 } else { CROWDED };
        steps.take_as_told(Step::Gather, &filling.gather, &[at, offset(turn)], &buffers.dispatch.buffer, told);
    }
}

/// Adds to each tier what the next coarser one holds, coarsest first, where something may show: choose.wgsl says which passes
/// find that.
fn interpolate((work, filling): (&Work, &Filling), steps: &mut Steps<'_>, slab: &SlabWork) {
    let buffers = &work.buffers;
    let at = offset(slab.first_portion);
    let tiers = slab.bricks.len();
    if tiers == 1 {
        return;
    }
    let filled = |tier: usize| groups(slab.bricks[tier].div_ceil(BRICK_GROUP));
    let read = |tier: usize| groups((work.cut.tiers[tier].bricks_held() as u32).div_ceil(BRICK_GROUP));
    for tier in (0..tiers).rev() {
        let at = [at, offset(tier)];
        if tier > 0 && slab.bricks[tier] > 0 {
            steps.take(Step::Bound, &filling.choose, &at, filled(tier));
        }
        if tier == 0 || (tier == 1 && tiers > 2) {
            steps.take(Step::Mark, &filling.choose, &at, filled(0));
        }
        // Nothing is added to the coarsest tier.
        if tier + 1 == tiers {
            continue;
        }
        if tier == 1 {
            steps.take(Step::Need, &filling.choose, &at, read(0));
        }
        steps.take(Step::Choose, &filling.choose, &at, read(tier));
        steps.take(Step::DispatchChosen, &filling.choose, &at, [1, 1, 1]);
        steps.take_as_told(Step::Interpolate, &filling.interpolate, &at, &buffers.dispatch.buffer, CHOSEN_GROUPS);
    }
}

/// Measures a slab that has been resampled; or casts rays through it, and finds what they hide; or, with the last slab of a Cartesian
/// grid, through all of it.
fn finish_slab(
    work: &Work,
    encoder: &mut CommandEncoder,
    pipelines: &HashMap<Step, &ComputePipeline>,
    slab: &SlabWork,
) {
    let at = offset(slab.first_portion);
    let columns = work.cut.finest().columns();
    let occlusion = work.job.options.occlusion && work.job.is_cast();
    if occlusion {
        encoder.clear_buffer(&work.buffers.visible.buffer, 0, Some(4));
    }
    encoder.clear_buffer(&work.buffers.reach.buffer, 0, Some(work.buffers.reach.bytes));
    let pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
    let mut steps = Steps { pass, pipelines };
    if let Some(measure) = &work.groups.measure {
        steps.take(Step::Measure, measure, &[at], groups(columns * slab.layers));
    }
    if let Some([hides, rays]) = &work.groups.rays {
        steps.take(Step::FindReach, hides, &[at], groups((columns * slab.layers).div_ceil(BRICK_GROUP)));
        let [x, y] = work.panes[slab.pane].size().map(|pixels| pixels.div_ceil(PIXEL_GROUP));
        if let Some(slopes) = &work.groups.slopes {
            steps.pass.set_bind_group(1, slopes, &[]);
        }
        steps.take(Step::CastRays, rays, &[at], [x, y, 1]);
        if let Some([place, _]) = work.groups.smooth.as_ref().filter(|_| slab.closes) {
            steps.take(Step::PlaceFaces, place, &[at], [x, y, 1]);
        }
        if occlusion {
            steps.take(Step::Occlude, hides, &[at], groups(columns));
            steps.take(Step::Pyramid, hides, &[at], [1, 1, 1]);
        }
    }
    if let (Some([march, matter]), Some(picture), true) = (&work.groups.march, work.job.cartesian(), slab.closes) {
        steps.pass.set_bind_group(1, matter, &[]);
        let rooms: u32 = march::rooms(picture).iter().product();
        steps.take(Step::FindRooms, march, &[], groups(rooms.div_ceil(BRICK_GROUP)));
        let [x, y] = [picture.view.width, picture.view.height].map(|pixels| pixels.div_ceil(PIXEL_GROUP));
        steps.take(Step::March, march, &[], [x, y, 1]);
    }
}

/// Smoothes the light on the surfaces of a picture that is put together.
fn smooth(
    (work, sides): (&Work, &[BindGroup; 2]),
    encoder: &mut CommandEncoder,
    pipelines: &HashMap<Step, &ComputePipeline>,
    slab: &SlabWork,
) {
    let [x, y] = [work.job.view.width, work.job.view.height].map(|pixels| pixels.div_ceil(PIXEL_GROUP));
    let at = offset(slab.first_portion);
    let pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
    let mut steps = Steps { pass, pipelines };
    steps.take(Step::Join, &sides[0], &[at], [x, y, 1]);
    // Directions are on the other side then, and come back with every other step.
    let count = work.job.options.smoothing as usize;
    for number in 0..count {
        steps.take(Step::Flow, &sides[1 - number % 2], &[at], [x, y, 1]);
    }
    steps.take(Step::Relight, &sides[1 - count % 2], &[at], [x, y, 1]);
}

/// Where a list of numbers has one of them, bytes.
fn word(number: u32) -> u64 {
    4 * u64::from(number)
}

/// Copies what a pane has come to where the picture is put together, and what is to be read back.
fn end_pane(work: &Work, encoder: &mut CommandEncoder, slab: &SlabWork) {
    let pane = &work.panes[slab.pane];
    let [width, height] = pane.size().map(u64::from);
    let [left, top] = pane.pixels[0].map(u64::from);
    let whole = u64::from(work.job.view.width);
    let buffers = &work.buffers;
    let mut put = |from: &Buffer, to: &Buffer, start: u64, bytes: u64| match width == whole {
        true => encoder.copy_buffer_to_buffer(from, 0, to, start + bytes * top * whole, bytes * width * height),
        false => {
            for row in 0..height {
                let at = start + bytes * ((top + row) * whole + left);
                encoder.copy_buffer_to_buffer(from, bytes * row * width, to, at, bytes * width);
            }
        }
    };
    if let Some(target) = work.target.as_ref().filter(|_| work.job.is_cast()) {
        put(&buffers.rays.buffer, target, 0, 16);
    }
    let Some(answer) = work.answer.as_ref().map(Answer::buffer) else { return };
    match work.job.shows {
        Shows::Light(_) | Shows::Columns(_) | Shows::Cartesian(_) | Shows::Field(_) => {
            if work.job.reads_ends() {
                put(&buffers.progress.buffer, answer, EFFORT, 4);
            }
            let numbers =
                [(&buffers.work, word(ALL_PAIRS)), (&buffers.dispatch, ALL_BRICKS), (&buffers.work, word(ALL_RAISED))];
            for ((held, at), place) in numbers.into_iter().zip((0..).step_by(4)) {
                encoder.copy_buffer_to_buffer(&held.buffer, at, answer, place, 4);
            }
        }
        Shows::Ranges => encoder.copy_buffer_to_buffer(&buffers.masses.buffer, 0, answer, 0, answer.size()),
    }
}
