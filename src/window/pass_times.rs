//! What the adapter's passes took last.

use crate::gpu::bloom;
use crate::gpu::timing::PassTimes;
use bevy::prelude::*;
use std::time::{Duration, Instant};

/// Passes whose times came together, within this time, are those of one picture.
const TOGETHER: Duration = Duration::from_secs(1);

/// The last time of each pass.
#[derive(Resource, Default)]
pub(super) struct LastPasses(Vec<LastPass>);

struct LastPass {
    name: &'static str,
    milliseconds: f64,
    /// When it was known.
    at: Instant,
}

/// The times of a picture's passes.
pub(super) struct PictureTimes {
    /// Milliseconds of each, by its name.
    pub passes: Vec<(&'static str, f64)>,
    /// When they were known.
    pub at: Instant,
}

impl PictureTimes {
    /// Milliseconds of all passes together.
    pub fn sum(&self) -> f64 {
        self.passes.iter().map(|(_, milliseconds)| milliseconds).sum()
    }
}

impl LastPasses {
    /// Whether a pass has ever run.
    pub fn has(&self, name: &str) -> bool {
        self.0.iter().any(|pass| pass.name == name)
    }

    /// Those of the last picture; `None` before the first one.
    pub fn of_picture(&self) -> Option<PictureTimes> {
        // Colours alone are composed, and light spreads, in every frame; passes of the mode before have not run for long.
        let is_of_picture = |pass: &&LastPass| pass.name != "composite" && pass.name != bloom::PASS;
        let at = self.0.iter().filter(is_of_picture).map(|pass| pass.at).max()?;
        let of_now = self.0.iter().filter(|pass| at.saturating_duration_since(pass.at) < TOGETHER);
        Some(PictureTimes { passes: of_now.map(|pass| (pass.name, pass.milliseconds)).collect(), at })
    }
}

/// Takes over the times that have come.
pub(super) fn follow_times(times: Option<Res<PassTimes>>, mut last: ResMut<LastPasses>) {
    let Some(times) = times else { return };
    let at = Instant::now();
    for (name, milliseconds) in times.take().into_iter().flat_map(|frame| frame.0) {
        let new = LastPass { name, milliseconds, at };
        match last.0.iter_mut().find(|pass| pass.name == name) {
            Some(pass) => *pass = new,
            None => last.0.push(new),
        }
    }
}
