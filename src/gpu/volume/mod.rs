//! Volumes and isosurfaces through the perspective grid (F12 chapter 5) by compute passes: step for step what
//! [`crate::cpu::volume`] does, which is what its pictures are held against.
//!
//! [`VolumeRenderer`] is a [`RayCaster`]: it gets particles in camera space and the grid around them, and gives colours back. It
//! draws outside of frames, on the thread that asks; [`cut`] says how the grid fits into the adapter's memory. For
//! each slab, from front to back, and each batch of particles ([`draw`]):
//!
//! 1. `count`, `pair`: particles are binned, each to eight bins at most of one of several levels.
//! 2. `tally`, `move_pairs`: pairs of bin and particle are sorted by bins; equal ones keep their order, so that
//!    nothing depends on which workgroup is first.
//! 3. `gather`: each brick of 8 x 8 x 8 cells sums up its own particles, in registers.
//!
//! Then, for each slab:
//!
//! 4. `cast_rays`: all rays go through it; what they have gathered is carried to the next one.
//! 5. `occlude`, `pyramid`: columns of bricks behind opaque pixels are left out from now on, and when there are no others
//!    the picture is complete.

pub mod constants;
pub mod cut;
pub mod layout;
pub mod programs;

mod draw;
mod inputs;
mod store;
mod timer;

use super::capabilities::Capabilities;
use super::device::{DeviceOptions, GpuError, open};
use super::shaders::check::texts;
use crate::color::Colors;
use crate::cpu::volume::{Prepared, RayCaster, Scenery, VolumeError, VolumeOptions, VolumeReport};
use crate::view::View;
use bevy::render::renderer::{RenderAdapter, RenderDevice, RenderQueue};
use bevy::tasks::block_on;
use draw::{Picture, Room};
use programs::Programs;
use std::sync::{Mutex, PoisonError};
use store::Store;
use wgpu::{Error, ErrorFilter};

/// Least room that is tried.
const LEAST_MEMORY: u64 = 1 << 22;
/// Most particles that are binned at once.
const MOST_BATCH: u64 = 1 << 20;

/// Draws volumes with an adapter.
pub struct VolumeRenderer {
    device: RenderDevice,
    queue: RenderQueue,
    adapter: String,
    vectors: bool,
    state: Mutex<State>,
}

/// What is kept from picture to picture.
struct State {
    programs: Programs,
    store: Store,
}

impl std::fmt::Debug for VolumeRenderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("VolumeRenderer").field(&self.adapter).finish()
    }
}

impl VolumeRenderer {
    /// Opens the adapter that the environment asks for, or the fastest one.
    ///
    /// # Errors
    /// [`GpuError`]: no adapter, or one without compute shaders.
    pub fn open(options: &DeviceOptions) -> Result<VolumeRenderer, GpuError> {
        let gpu = open(options)?;
        if !gpu.capabilities.compute {
            let missing = "compute shaders with eight storage buffers";
            return Err(GpuError::Unsupported { adapter: gpu.adapter, backend: "compute", missing });
        }
        Ok(VolumeRenderer::new(gpu.device, gpu.queue, &gpu.handle, gpu.adapter, &gpu.capabilities, &texts(&[])))
    }

    /// Draws with an open adapter, which must have the capability `compute`, and these shaders: their paths and texts.
    pub fn new(
        device: RenderDevice,
        queue: RenderQueue,
        handle: &RenderAdapter,
        adapter: String,
        capabilities: &Capabilities,
        shaders: &[(&'static str, String)],
    ) -> VolumeRenderer {
        let state = Mutex::new(State { programs: Programs::new(&device, handle, shaders), store: Store::default() });
        VolumeRenderer { device, queue, adapter, vectors: capabilities.vector_subgroups, state }
    }

    /// Draws, with less memory at a time where there is too little.
    fn draw(
        &self,
        view: &View,
        prepared: &Prepared,
        scenery: &Scenery,
        options: &VolumeOptions,
    ) -> Result<(Colors, VolumeReport), GpuError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { programs, store } = &mut *state;
        let limits = self.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let mut room = Room {
            // A larger slab than the grid is none.
            memory: options.memory.min(limit),
            limit,
            batch: MOST_BATCH.min(limit / (4 * layout::MOST_BINS)),
        };
        loop {
            let (device, queue, vectors) = (&self.device, &self.queue, self.vectors);
            let picture = Picture { device, queue, view, prepared, scenery, options, vectors };
            match self.watched(|| picture.draw(programs, store, &room)) {
                Err(GpuError::NoRoom(_)) if room.memory > LEAST_MEMORY => {
                    store.clear();
                    room.memory /= 2;
                    room.batch = (room.batch / 2).max(1 << 14);
                }
                result => return result,
            }
        }
    }

    /// Does something, and takes the driver's errors for its result.
    fn watched<T>(&self, work: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        let device = self.device.wgpu_device();
        let others = [ErrorFilter::Validation, ErrorFilter::Internal].map(|filter| device.push_error_scope(filter));
        let memory = device.push_error_scope(ErrorFilter::OutOfMemory);
        let result = work();
        let full = block_on(memory.pop());
        // The last one is on top.
        let [validation, internal] = others;
        let failed = [block_on(internal.pop()), block_on(validation.pop())];
        if full.is_some() {
            return Err(GpuError::NoRoom(self.adapter.clone()));
        }
        match failed.into_iter().flatten().next() {
            Some(Error::Validation { description, .. } | Error::Internal { description, .. }) => {
                Err(GpuError::Failed(format!("a volume on {}: {description}", self.adapter)))
            }
            Some(error) => Err(GpuError::Failed(format!("a volume on {}: {error}", self.adapter))),
            None => result,
        }
    }
}

impl RayCaster for VolumeRenderer {
    fn cast(
        &self,
        view: &View,
        prepared: &Prepared,
        scenery: &Scenery,
        options: &VolumeOptions,
        report: &mut VolumeReport,
    ) -> Result<Colors, VolumeError> {
        let drawn = self.draw(view, prepared, scenery, options);
        let (colors, work) = drawn.map_err(|error| VolumeError::Device(error.to_string()))?;
        report.slabs = work.slabs;
        report.pairs = work.pairs;
        report.bricks = work.bricks;
        report.hidden = work.hidden;
        report.opaque = work.opaque;
        report.resampling += work.resampling;
        report.rendering = work.rendering;
        Ok(colors)
    }

    fn name(&self) -> [&str; 2] {
        ["compute", &self.adapter]
    }

    fn rest(&self) -> bool {
        // Whoever draws now still needs it.
        let state = self.state.try_lock();
        state.map(|mut state| state.store.clear()).is_ok()
    }
}
