//! What a picture left out of what was selected for it, for its statistics.

use crate::mode::{LodBudget, Plan};
use serde::Serialize;

/// What a picture left out of what was selected. Counts that the backend does not have are `null`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct LeftOut {
    /// Whether particles that no pixel sees were dropped one by one.
    pub culling: bool,
    /// The `n` of presence acceleration.
    pub presence: f64,
    /// The budget of thinning, a colour error of 255.
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
    /// What was decided; nothing is counted yet.
    pub fn new(lod_budget: &LodBudget, plan: &Plan) -> LeftOut {
        LeftOut {
            culling: plan.culling,
            presence: lod_budget.presence,
            thinning: lod_budget.thinning,
            faintest: plan.faintest,
            ..LeftOut::default()
        }
    }
}
