//! What `render --json` tells about a picture made of splats.

use super::CommandResult;
use super::render::Picture;
use super::statistics::{Shown, write_json};
use crate::mode::{Economy, Plan};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Statistics of a run, as `--json` writes them.
#[derive(Debug, Serialize)]
struct Statistics<'a> {
    #[serde(flatten)]
    shown: Shown<'a>,
    /// What was left out, and how that was decided.
    economy: &'a LeftOut,
    sum: f64,
    milliseconds: &'a BTreeMap<String, f64>,
}

/// What a picture left out of what was selected. Counts that the backend does not have are `null`.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct LeftOut {
    pub culling: bool,
    pub presence: f64,
    pub thinning: f64,
    /// The least `P` that a particle had to add to some pixel.
    pub faintest: f32,
    /// Particles for which others stand that count more.
    pub thinned: Option<u64>,
    /// Particles dropped by presence acceleration, with their light.
    pub faint: Option<u64>,
    /// Particles that no pixel sees.
    pub outside: Option<u64>,
    /// Splats that reach the picture.
    pub splats: Option<u64>,
    /// Splats over a pixel, where an overdraw picture was asked for: mean and maximum.
    pub overdraw: Option<(f64, u32)>,
}

impl LeftOut {
    pub fn new(economy: &Economy, plan: &Plan) -> LeftOut {
        LeftOut {
            culling: plan.culling,
            presence: economy.presence,
            thinning: economy.thinning,
            faintest: plan.faintest,
            ..LeftOut::default()
        }
    }
}

/// Writes the statistics to a file, or to standard output for `-`.
pub(super) fn write_statistics(path: &Path, picture: &Picture) -> CommandResult {
    let statistics = Statistics {
        shown: Shown {
            converged: picture.converged,
            error_px: picture.error_pixels,
            particles_drawn: picture.particles,
            nodes_drawn: picture.nodes,
            backend: picture.backend,
            adapter: &picture.adapter,
            mode: picture.mode.name,
            attribute: picture.attribute.as_deref(),
            width: picture.accumulation.width,
            height: picture.accumulation.height,
        },
        economy: &picture.economy,
        sum: picture.accumulation.sum(),
        milliseconds: &picture.milliseconds,
    };
    write_json(path, &statistics)
}
