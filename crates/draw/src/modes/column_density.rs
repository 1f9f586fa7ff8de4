//! `column-density`: the mass along each line of sight per area.

use crate::mode::{Conserved, Mode, SPLAT_SUMS};
use crate::model::Unit;

/// `P` is the integral of the density along the line of sight: weight `m`.
pub static MODE: Mode = Mode {
    name: "column-density",
    help: "mass along the line of sight per area, in the data's units; coloured by an attribute if one is named",
    settings: &[],
    technique: &SPLAT_SUMS,
    quantity: "column density",
    unit: |mass, length| match mass.is_unknown() || length.is_unknown() {
        true => Unit::default(),
        false => Unit::new(format!("{mass} / ({length})^2")),
    },
    weight: |columns| columns.mass.to_vec(),
    conserves: Conserved::Mass,
    hue_tolerance: 1.0,
    usual_attributes: &[],
    weight_attributes: &[],
    transfer: ["density", "density-hue"],
};
