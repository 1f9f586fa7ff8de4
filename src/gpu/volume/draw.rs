//! Draws one picture: windows, slabs from front to back, batches of particles.

use super::constants::{BIN_GROUP, BRICK, SCAN_GROUP};
use super::cut::Cut;
use super::inputs::{ALL_BRICKS, ALL_PAIRS, Batch, CROWDED, Inputs, Pane, SORT_GROUPS, offset, strided};
use super::layout::Portion;
use super::programs::{Programs, Step, Variant};
use super::store::Store;
use super::timer::Timer;
use crate::color::Colors;
use crate::cpu::volume::{OpaqueDepths, Prepared, Scenery, VolumeOptions, VolumeReport, raycast};
use crate::gpu::device::GpuError;
use crate::gpu::readback::read_buffer;
use crate::view::View;
use bevy::platform::collections::HashMap;
use bevy::render::render_resource::{BindGroup, ComputePipeline};
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::{
    BufferDescriptor, BufferUsages, CommandEncoder, CommandEncoderDescriptor, ComputePass, ComputePassDescriptor,
};

/// Invocations of a workgroup over bricks.
const BRICK_GROUP: u32 = 64;
/// Invocations of a workgroup over pixels, along each axis.
const PIXEL_GROUP: u32 = 8;
/// Bytes in front of the times that are read back of a slab.
const FEEDBACK: u64 = 8;

/// How much may be used at once.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// Bytes of cells.
    pub memory: u64,
    /// Bytes of one buffer.
    pub limit: u64,
    /// Particles of a batch.
    pub batch: u64,
}

/// What is drawn, and with what.
pub struct Picture<'a> {
    /// Creates buffers.
    pub device: &'a RenderDevice,
    /// Takes commands.
    pub queue: &'a RenderQueue,
    /// The camera.
    pub view: &'a View,
    /// The particles and the grid.
    pub prepared: &'a Prepared,
    /// What is shown.
    pub scenery: &'a Scenery,
    /// How.
    pub options: &'a VolumeOptions,
    /// Whether subgroups have exactly eight lanes.
    pub vectors: bool,
}

/// Workgroups along x, y and z for `count` of them: one dimension holds at most 65535.
fn groups(count: u32) -> [u32; 3] {
    const ROW: u32 = 32768;
    if count <= ROW { [count, 1, 1] } else { [ROW, count.div_ceil(ROW), 1] }
}

/// A pass in which steps are taken.
struct Steps<'a> {
    pass: ComputePass<'a>,
    pipelines: &'a HashMap<Step, ComputePipeline>,
}

impl Steps<'_> {
    fn take(&mut self, step: Step, bindings: &BindGroup, offsets: &[u32], [x, y, z]: [u32; 3]) {
        self.set(step, bindings, offsets);
        self.pass.dispatch_workgroups(x, y, z);
    }

    fn take_as_told(&mut self, step: Step, bindings: &BindGroup, offsets: &[u32], told: &wgpu::Buffer, at: u64) {
        self.set(step, bindings, offsets);
        self.pass.dispatch_workgroups_indirect(told, at);
    }

    fn set(&mut self, step: Step, bindings: &BindGroup, offsets: &[u32]) {
        if let Some(pipeline) = self.pipelines.get(&step) {
            self.pass.set_pipeline(pipeline);
        }
        self.pass.set_bind_group(0, &**bindings, offsets);
    }
}

impl Picture<'_> {
    /// Draws.
    ///
    /// # Errors
    /// [`GpuError`]: a shader does not compile, the driver fails, or nothing fits.
    pub fn draw(
        &self,
        programs: &mut Programs,
        store: &mut Store,
        room: &Room,
    ) -> Result<(Colors, VolumeReport), GpuError> {
        let Prepared { grid, particles, .. } = self.prepared;
        let brick_grid = self.prepared.brick_grid();
        let pipelines = programs.get(self.variant())?;
        let cut = Cut::new(grid, particles.attribute, room.memory, room.limit)
            .ok_or_else(|| GpuError::NoRoom(format!("{} bytes for a buffer", room.limit)))?;
        let (panes, places, readers) = self.panes(&cut);
        let batch_count = particles.len().div_ceil(room.batch).max(1) as usize;
        let portion = |pane: &Pane, slab: usize, batch: usize| {
            let slab = &cut.slabs[slab];
            let first_layer = slab.slices.start / BRICK;
            let layers = slab.slices.end.div_ceil(BRICK) - first_layer;
            let rest = particles.len() - batch as u64 * room.batch;
            Portion {
                origin: pane.window.origin,
                first_pixel: pane.pixels[0],
                behind_pixel: pane.pixels[1],
                rows: self.view.width,
                brick_rows: cut.bricks_across,
                first_layer,
                layers,
                first_step: slab.steps.start,
                behind_step: slab.steps.end,
                candidates: rest.min(room.batch) as u32,
                opening: u32::from(batch == 0),
                nearest: brick_grid.depth[(first_layer * BRICK) as usize],
                farthest: brick_grid.depth[((first_layer + layers) * BRICK - 1) as usize],
            }
        };
        let largest = panes.iter().map(Pane::len).max().unwrap_or(0);
        let inputs =
            self.inputs(programs, store, room, &cut, cut.slabs.len() * batch_count, (largest, &places, &readers));
        let timer = Timer::new(self.device, self.queue, batch_count as u32 + 1);
        let scene = Slabs { picture: self, pipelines: &pipelines, cut: &cut, inputs: &inputs, timer: timer.as_ref() };

        let mut encoder = self.encoder();
        encoder.clear_buffer(&inputs.work.buffer, 0, None);
        encoder.clear_buffer(&inputs.dispatch.buffer, 0, None);
        self.queue.submit([encoder.finish()]);
        let mut report = VolumeReport { slabs: cut.slabs.len() * panes.len(), ..VolumeReport::default() };
        let (width, termination) = (self.view.width as usize, self.scenery.termination);
        let mut rgba = vec![[0.0; 4]; width * self.view.height as usize];
        let behind = raycast::depths_behind(grid);
        let mut depths = vec![f32::INFINITY; if self.options.occlusion { rgba.len() } else { 0 }];
        for pane in &panes {
            let slabs = (0..cut.slabs.len()).flat_map(|slab| (0..batch_count).map(move |batch| (slab, batch)));
            let portions: Vec<Portion> = slabs.map(|(slab, batch)| portion(pane, slab, batch)).collect();
            self.queue.write_buffer(&inputs.portions.buffer, 0, &strided(portions.iter().copied()));
            scene.begin();
            for (slab, portions) in portions.chunks(batch_count).enumerate() {
                let hidden = scene.slab(slab * batch_count, portions, pane, &mut report)?;
                report.hidden += u64::from(hidden);
                if hidden == cut.columns() {
                    break;
                }
            }
            let [pane_width, _] = pane.size();
            let rays = self.read(&inputs.rays.buffer, 0, 16 * pane.len())?;
            let rays: &[[f32; 4]] = bytemuck::cast_slice(&rays);
            let starts = (pane.pixels[0][1]..).map(|row| row as usize * width + pane.pixels[0][0] as usize);
            for (start, line) in starts.clone().zip(rays.chunks(pane_width as usize)) {
                rgba[start..start + line.len()].copy_from_slice(line);
            }
            if self.options.occlusion {
                let ends = self.read(&inputs.progress.buffer, 0, 4 * pane.len())?;
                let ends: &[f32] = bytemuck::cast_slice(&ends);
                for (start, line) in starts.zip(ends.chunks(pane_width as usize)) {
                    for (index, &end) in (start..).zip(line).filter(|(index, _)| rgba[*index][3] >= termination) {
                        depths[index] = behind.get(end as usize).copied().unwrap_or(f32::INFINITY);
                    }
                }
            }
        }
        if self.options.occlusion {
            let opaque = OpaqueDepths::new(self.view, depths, grid.cell, self.options.smallest);
            report.opaque = Some(Arc::new(opaque));
        }
        let number = |bytes: Vec<u8>| bytes.first_chunk::<4>().map_or(0, |bytes| u64::from(u32::from_le_bytes(*bytes)));
        report.pairs = number(self.read(&inputs.work.buffer, ALL_PAIRS, 4)?);
        report.bricks = number(self.read(&inputs.dispatch.buffer, ALL_BRICKS, 4)?);
        Ok((Colors { width: self.view.width, height: self.view.height, rgba }, report))
    }

    /// What is compiled into the shaders.
    pub fn variant(&self) -> Variant {
        Variant {
            kernel: self.options.kernel,
            attribute: self.prepared.particles.attribute,
            surfaces: !self.scenery.surfaces.is_empty(),
            vectors: self.vectors,
        }
    }

    fn encoder(&self) -> CommandEncoder {
        self.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("deepfield volume") })
    }

    fn read(&self, buffer: &bevy::render::render_resource::Buffer, at: u64, bytes: u64) -> Result<Vec<u8>, GpuError> {
        read_buffer(self.device, self.queue, buffer, at, bytes)
            .ok_or_else(|| GpuError::Failed("(reading a volume back)".into()))
    }
}

/// What the slabs of a picture share.
struct Slabs<'a> {
    picture: &'a Picture<'a>,
    pipelines: &'a HashMap<Step, ComputePipeline>,
    cut: &'a Cut,
    inputs: &'a Inputs,
    timer: Option<&'a Timer>,
}

impl Slabs<'_> {
    /// Forgets what an earlier window has left.
    fn begin(&self) {
        let Inputs { rays, progress, densest, hidden, .. } = self.inputs;
        let mut encoder = self.picture.encoder();
        for held in [rays, progress, densest, hidden] {
            encoder.clear_buffer(&held.buffer, 0, Some(held.bytes));
        }
        self.picture.queue.submit([encoder.finish()]);
    }

    /// Draws one slab of a window, whose portions begin with number `first`; returns how many columns of bricks are hidden
    /// behind it.
    fn slab(
        &self,
        first: usize,
        portions: &[Portion],
        pane: &Pane,
        report: &mut VolumeReport,
    ) -> Result<u32, GpuError> {
        let start = Instant::now();
        let Slabs { picture, inputs, timer, .. } = *self;
        let mut encoder = picture.encoder();
        for (index, (portion, batch)) in portions.iter().zip(&inputs.batches).enumerate() {
            encoder.clear_buffer(&inputs.bins.buffer, 0, Some(inputs.bins.bytes));
            encoder.clear_buffer(&inputs.items.buffer, 0, Some(16));
            let mut steps = self.steps(&mut encoder, index);
            self.resample(&mut steps, batch, portion, offset(first + index));
        }
        encoder.clear_buffer(&inputs.visible.buffer, 0, Some(4));
        let mut steps = self.steps(&mut encoder, inputs.batches.len());
        if let Some(portion) = portions.first() {
            self.cast(&mut steps, pane, portion, offset(first));
        }
        drop(steps);
        let occlusion = picture.options.occlusion;
        if timer.is_none() && !occlusion {
            picture.queue.submit([encoder.finish()]);
            report.resampling += start.elapsed();
            return Ok(0);
        }
        let bytes = FEEDBACK + timer.map_or(0, Timer::bytes);
        let feedback = picture.device.create_buffer(&BufferDescriptor {
            label: Some("deepfield volume feedback"),
            size: bytes,
            usage: BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(&inputs.visible.buffer, 0, &feedback, 0, 4);
        if let Some(timer) = timer {
            timer.copy(&mut encoder, &feedback, FEEDBACK);
        }
        picture.queue.submit([encoder.finish()]);
        let bytes = picture.read(&feedback, 0, bytes)?;
        let (visible, times) = bytes.split_at(FEEDBACK as usize);
        match timer {
            Some(timer) => {
                let times: Vec<Duration> = timer.read(times).collect();
                report.resampling += times.iter().take(inputs.batches.len()).sum::<Duration>();
                report.rendering += times.iter().skip(inputs.batches.len()).sum::<Duration>();
            }
            None => report.resampling += start.elapsed(),
        }
        let visible = visible.first_chunk::<4>().map_or(0, |bytes| u32::from_le_bytes(*bytes));
        Ok(if occlusion { self.cut.columns().saturating_sub(visible) } else { 0 })
    }

    fn steps<'a>(&'a self, encoder: &'a mut CommandEncoder, pass: usize) -> Steps<'a> {
        let timestamp_writes = self.timer.map(|timer| timer.around(pass as u32));
        let descriptor = ComputePassDescriptor { label: Some("deepfield volume"), timestamp_writes };
        Steps { pass: encoder.begin_compute_pass(&descriptor), pipelines: self.pipelines }
    }

    /// Adds a batch of particles to a slab's cells.
    fn resample(&self, steps: &mut Steps<'_>, batch: &Batch, portion: &Portion, at: u32) {
        let Inputs { scans: [of_bins, of_pairs, of_digits], sorts, plan, work, dispatch, .. } = self.inputs;
        let once = [1, 1, 1];
        let particles = groups(batch.particles.div_ceil(BIN_GROUP));
        steps.take(Step::Count, &batch.bin, &[at], particles);
        steps.take(Step::ScanPairs, of_pairs, &[at], once);
        steps.take(Step::Pair, &batch.bin, &[at], particles);
        let bins = [(self.inputs.uniform.bin_count + 1).div_ceil(SCAN_GROUP), 1, 1];
        steps.take(Step::SumBins, of_bins, &[at], bins);
        steps.take(Step::ScanParts, of_bins, &[at], once);
        steps.take(Step::SpreadBins, of_bins, &[at], bins);
        for digit in 0..self.inputs.digits as usize {
            let sort = &sorts[digit % 2];
            steps.take_as_told(Step::Tally, sort, &[offset(digit)], &work.buffer, SORT_GROUPS);
            steps.take(Step::ScanTable, of_digits, &[at], once);
            steps.take_as_told(Step::MovePairs, sort, &[offset(digit)], &work.buffer, SORT_GROUPS);
        }
        let bricks = self.cut.columns() * portion.layers;
        steps.take(Step::Plan, plan, &[at], groups(bricks.div_ceil(BRICK_GROUP)));
        steps.take(Step::DispatchBricks, plan, &[at], once);
        for turn in 0..self.inputs.turns as usize {
            let told = if turn == 0 { 0 } else { CROWDED };
            steps.take_as_told(Step::Gather, &batch.gather, &[at, offset(turn)], &dispatch.buffer, told);
        }
    }

    /// Casts rays through a slab, and finds what they hide.
    fn cast(&self, steps: &mut Steps<'_>, pane: &Pane, portion: &Portion, at: u32) {
        let Inputs { occlusion, raycast, .. } = self.inputs;
        let columns = self.cut.columns();
        steps.take(Step::FindReach, occlusion, &[at], groups((columns * portion.layers).div_ceil(BRICK_GROUP)));
        let [x, y] = pane.size().map(|pixels| pixels.div_ceil(PIXEL_GROUP));
        steps.take(Step::CastRays, raycast, &[at], [x, y, 1]);
        if self.picture.options.occlusion {
            steps.take(Step::Occlude, occlusion, &[at], groups(columns));
            steps.take(Step::Pyramid, occlusion, &[at], [1, 1, 1]);
        }
    }
}
