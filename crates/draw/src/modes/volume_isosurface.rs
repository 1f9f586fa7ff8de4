//! `volume-isosurface`: a volume and surfaces in it, in one pass (F12 5.6, figure 5.1 c).

use super::{grid, samples, shadowing, volume_fields};
use crate::mode::Mode;

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "volume-isosurface",
    help: "surfaces of equal density or of another field within a volume that emits and absorbs light",
    settings: &[
        &[&grid::OPACITY, &grid::FIELD, &volume_fields::SURFACE_FIELD],
        &[&volume_fields::FIELD_SUM, &volume_fields::FIELD_OPACITY],
        grid::SURFACES,
        grid::LIGHT,
        &[&grid::SURFACE_SMOOTHING],
        shadowing::BESIDE_EYE,
        &[&grid::VOLUME_LIGHTING],
        grid::GRID,
        grid::COMMON,
        samples::SAMPLES,
    ],
    technique: &grid::Marched(grid::Layers::BOTH),
    ..grid::MODE
};
