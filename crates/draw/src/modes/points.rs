//! `points`: stars as small discs, as bright as they shine, in the colour of their colour index.

use crate::mode::{Conserved, Footprint, Mode, Setting, SettingKind, SplatSums};
use crate::model::Unit;

/// Radius of a star's disc.
pub static RADIUS: Setting = Setting {
    name: "radius",
    unit: "px",
    kind: SettingKind::Number { min: 0.5, max: 30.0, default: 2.5 },
    help: "radius of a star's disc on screen, at any distance",
};

/// `P` is the flux per pixel area, relative to a star of magnitude 0: weight `10^(-0.4 magnitude)` where the data has
/// magnitudes, the mass elsewhere.
pub static MODE: Mode = Mode {
    name: "points",
    help: "stars as discs of fixed size, as bright as their magnitude says, or their mass without one, coloured by their colour index",
    settings: &[&[&RADIUS]],
    technique: &SplatSums { footprint: |settings| Footprint::Pixels(settings.number(&RADIUS) as f32) },
    quantity: "flux",
    unit: |_, _| Unit::default(),
    weight: |columns| match columns.named("magnitude") {
        Some(magnitude) => magnitude.iter().map(|m| (-0.4 * m * std::f32::consts::LN_10).exp()).collect(),
        None => columns.mass.to_vec(),
    },
    conserves: Conserved::Neither,
    // Measured: `docs/results.md`, hue of squared densities and of stars.
    hue_tolerance: 0.25,
    usual_attributes: &["color-index", "temperature", "speed"],
    weight_attributes: &["magnitude"],
    transfer: ["density", "stars"],
};
