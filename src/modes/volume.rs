//! `volume`: direct volume rendering through the perspective grid (F12 5.6).

use super::{Conserved, Footprint, Mode, Technique, grid};

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "volume",
    help: "a volume that emits and absorbs light along each ray: dense gas bright and opaque; hue from an attribute",
    settings: &[&[&grid::OPACITY], grid::GRID, grid::COMMON],
    technique: Technique::Grid(|painting| grid::paint(painting, grid::Layers::VOLUME)),
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
