//! `isosurface`: surfaces of equal density through the perspective grid (F12 5.6).

use super::{Conserved, Footprint, Mode, Technique, grid};

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "isosurface",
    help: "surfaces of equal density, lit from the eye; coloured by their density or by an attribute",
    settings: &[grid::SURFACES, grid::LIGHT, grid::GRID, grid::COMMON],
    technique: Technique::Grid(|painting| grid::paint(painting, grid::Layers::SURFACES)),
    quantity: "density",
    unit: grid::density_unit,
    weight: grid::masses,
    conserves: Conserved::Mass,
    usual_attributes: &[],
    weight_attributes: &[],
    densities: false,
    footprint: |_| Footprint::Kernel,
    transfer: ["density", "density-hue"],
};
