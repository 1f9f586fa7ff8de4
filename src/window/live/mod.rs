//! Particles that another system hands over, instead of the open file's: a simulation that runs (F12 5.8, direct particle
//! visualization). Nothing is built for them; each picture takes the state that is there when it is begun.
//!
//! The open file says what there is to be seen: families, attributes, units and the box of the first view. [`orbits`] is an
//! example of such a system, and `deepfield view --simulate` runs it. A simulation on the graphics adapter hands over its buffer
//! ([`LiveParticles::show_buffer`]): what it writes is drawn where it is.

pub(super) mod copies;
pub mod orbits;

use crate::model::Dataset;
use crate::view::Extent;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy::render::render_resource::Buffer;
use std::sync::Arc;

/// Particles in the graphics adapter's memory.
#[derive(Clone, Debug)]
pub struct LiveBuffer {
    /// A storage buffer of the window's own device: [`crate::gpu::RawParticle`]s from its beginning, with the weights, attributes and
    /// densities of the mode that is shown.
    pub buffer: Buffer,
    /// How many particles.
    pub count: u32,
    /// Where their positions are measured from, world units.
    pub origin: DVec3,
    /// The box that holds their places, and their longest smoothing length.
    pub extent: Extent,
}

/// What is drawn instead of the open file.
#[derive(Clone, Debug)]
pub(super) enum LiveSource {
    /// Particles in main memory.
    Dataset(Arc<Dataset>),
    /// Particles in the adapter's.
    Buffer(LiveBuffer),
}

/// What is drawn instead of the open file's particles, where there is something.
#[derive(Resource, Clone, Debug, Default)]
pub struct LiveParticles {
    source: Option<LiveSource>,
    state: u64,
}

impl LiveParticles {
    /// Shows these from the next picture on. A system that calls this every frame has every frame's state shown for which
    /// there is time.
    pub fn show(&mut self, particles: Arc<Dataset>) {
        self.set(Some(LiveSource::Dataset(particles)));
    }

    /// Shows what a buffer holds, without a trip through main memory. A system that has the buffer written calls this again after each
    /// time, also where nothing else has changed. Only an adapter can draw it.
    pub fn show_buffer(&mut self, buffer: LiveBuffer) {
        self.set(Some(LiveSource::Buffer(buffer)));
    }

    /// Shows the open file again.
    pub fn clear(&mut self) {
        self.set(None);
    }

    fn set(&mut self, source: Option<LiveSource>) {
        self.source = source;
        self.state += 1;
    }

    /// Whether anything is shown instead of the open file.
    pub fn is_shown(&self) -> bool {
        self.source.is_some()
    }

    pub(super) fn source(&self) -> Option<&LiveSource> {
        self.source.as_ref()
    }

    /// The present state, where that is in main memory.
    pub fn particles(&self) -> Option<&Arc<Dataset>> {
        match &self.source {
            Some(LiveSource::Dataset(particles)) => Some(particles),
            Some(LiveSource::Buffer(_)) | None => None,
        }
    }

    /// Number of the present state: it counts up with every change.
    pub fn state(&self) -> u64 {
        self.state
    }
}

/// Whether live particles have come or gone since the last call.
pub(super) fn came_or_went(live: Res<LiveParticles>, mut before: Local<bool>) -> bool {
    std::mem::replace(&mut *before, live.is_shown()) != live.is_shown()
}
