//! `density-squared`: the emission model of F12 4.5, dense regions bright, coloured by velocity dispersion.

use crate::mode::{Conserved, Mode, SPLAT_SUMS};
use crate::model::Unit;

/// `P` is the integral of the squared density along the line of sight (F12 4.1) and `S` the attribute averaged with
/// it (F12 4.2). With the SPH estimate `rho^2(r) = sum_i m_i rho_i W(r - r_i, h_i)` (F12 3.2 for `A = rho^2`) a
/// particle's weight is `m rho`.
pub static MODE: Mode = Mode {
    name: "density-squared",
    help: "squared density along the line of sight (logarithmic brightness), coloured by the attribute averaged with it",
    settings: &[],
    technique: &SPLAT_SUMS,
    quantity: "squared density along the line of sight",
    unit: |mass, length| match mass.is_unknown() || length.is_unknown() {
        true => Unit::default(),
        false => Unit::new(format!("({mass})^2 / ({length})^5")),
    },
    weight: |columns| columns.mass.iter().zip(columns.density).map(|(m, rho)| m * rho).collect(),
    conserves: Conserved::MassDensity,
    // Measured: `docs/results.md`, hue of squared densities and of stars.
    hue_tolerance: 0.25,
    usual_attributes: &["velocity-dispersion", "temperature", "internal-energy", "speed"],
    weight_attributes: &[],
    transfer: ["density", "density-hue"],
};
