//! `isosurface`: surfaces of equal density through the perspective grid (F12 5.6).

use super::{grid, samples, shadowing, volume_fields};
use crate::mode::Mode;

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "isosurface",
    help: "surfaces of equal density or of another field, lit from the eye; coloured by its value or by an attribute",
    settings: &[
        &[&volume_fields::SURFACE_FIELD, &volume_fields::FIELD_SUM],
        grid::SURFACES,
        grid::LIGHT,
        &[&grid::SURFACE_SMOOTHING],
        shadowing::BESIDE_EYE,
        grid::GRID,
        grid::COMMON,
        samples::SAMPLES,
    ],
    technique: &grid::Marched(grid::Layers::SURFACES),
    ..grid::MODE
};
