//! Particles that another system hands over, instead of the open file's: a simulation that runs (F12 5.8, direct particle
//! visualization). Nothing is built for them; each picture takes the state that is there when it is begun.
//!
//! The open file says what there is to be seen: families, attributes, units and the box of the first view. [`orbits`] is an
//! example of such a system, and `deepfield view --simulate` runs it.

pub mod orbits;

use crate::model::Dataset;
use bevy::prelude::*;
use std::sync::Arc;

/// What is drawn instead of the open file's particles, where there is something.
#[derive(Resource, Clone, Debug, Default)]
pub struct LiveParticles {
    particles: Option<Arc<Dataset>>,
    state: u64,
}

impl LiveParticles {
    /// Shows these from the next picture on. A system that calls this every frame has every frame's state shown for which
    /// there is time.
    pub fn show(&mut self, particles: Arc<Dataset>) {
        self.particles = Some(particles);
        self.state += 1;
    }

    /// Shows the open file again.
    pub fn clear(&mut self) {
        self.particles = None;
        self.state += 1;
    }

    /// The present state.
    pub fn particles(&self) -> Option<&Arc<Dataset>> {
        self.particles.as_ref()
    }

    /// Number of the present state: it counts up with every change.
    pub fn state(&self) -> u64 {
        self.state
    }
}

/// Whether live particles have come or gone since the last call.
pub(super) fn came_or_went(live: Res<LiveParticles>, mut before: Local<bool>) -> bool {
    let now = live.particles.is_some();
    std::mem::replace(&mut *before, now) != now
}
