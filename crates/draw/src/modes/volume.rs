//! `volume`: direct volume rendering through the perspective grid (F12 5.6).

use super::{grid, samples, volume_fields};
use crate::mode::Mode;

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "volume",
    help: "a volume that emits and absorbs light along each ray: dense gas bright and opaque, or another field; hue from an attribute",
    settings: &[
        &[&grid::OPACITY, &grid::FIELD, &volume_fields::FIELD_SUM, &volume_fields::FIELD_OPACITY],
        grid::LIGHT_OF_VOLUME,
        grid::GRID,
        grid::COMMON,
        samples::SAMPLES,
    ],
    technique: &grid::Marched(grid::Layers::VOLUME),
    ..grid::MODE
};
