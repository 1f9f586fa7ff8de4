//! The particle that was clicked: what the page file knows of it, and its row in the source.

use super::prober::opened;
use crate::explore::Identified;
use crate::explore::identify::identify;
use crate::explore::particle::{ParticleRef, ParticleReport, describe};
use crate::window::scene::Scene;
use crate::window::state::answer::Answer;
use bevy::prelude::*;
use std::sync::Arc;

/// Sources up to which the row is looked for without being asked, bytes: reading them takes less than a second.
const SMALL_BYTES: u64 = 64 << 20;

/// All that is known of the particle that was clicked.
#[derive(Resource, Default)]
pub struct Inspector {
    /// Its values, read from the page file again.
    pub report: Answer<ParticleReport>,
    /// Its row in the source; `None` where none is within the rounding of its place.
    pub row: Answer<Option<Identified>>,
}

impl Inspector {
    /// Reads a particle from the page file.
    pub fn look(&mut self, scene: &Scene, particle: ParticleRef) {
        let file = Arc::clone(&scene.file);
        self.report = Answer::ask("inspect", move |_| describe(&file, particle));
        self.row = Answer::Nothing;
    }

    /// Looks for its row in the source: one pass over the positions of its family. Merged particles have none.
    pub fn ask_source(&mut self, scene: &Scene) {
        let Some(report) = self.report.here().filter(|report| report.merged.is_none()) else { return };
        let (file, source) = (Arc::clone(&scene.file), scene.source());
        let (family, position) = (report.family, report.position);
        // Coordinates of the world are rounded, too.
        let reach = report.rounding + 4.0 * f64::EPSILON * position.abs().max_element();
        self.row = Answer::ask("identify", move |work| {
            identify(opened(&file, source)?.as_ref(), family, position, reach, work)
        });
    }
}

/// Takes what has been found out, and asks a small source at once.
pub(super) fn receive_particle(mut inspector: ResMut<Inspector>, scene: Option<Res<Scene>>) {
    let inspector = inspector.bypass_change_detection();
    inspector.row.receive();
    let Some(scene) = scene else { return };
    let is_small = (1..=SMALL_BYTES).contains(&scene.file.metadata().provenance.bytes);
    if inspector.report.receive() && is_small && scene.source().is_some() {
        inspector.ask_source(&scene);
    }
}
