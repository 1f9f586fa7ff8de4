//! `volume`: direct volume rendering through the perspective grid (F12 5.6).

use super::{Conserved, Footprint, Mode, Setting, Technique, grid};

static SETTINGS: &[Setting] = &[
    grid::OPACITY,
    grid::RESOLUTION,
    grid::LAMBDA,
    grid::SLAB_MEMORY,
    grid::NEAR,
    grid::FAR,
    grid::TERMINATION,
    grid::OCCLUSION,
    grid::SMALLEST_CELLS,
    grid::KERNEL,
];

/// Particles weigh their mass, so that their sum with the kernel is the density.
pub static MODE: Mode = Mode {
    name: "volume",
    help: "a volume that emits and absorbs light along each ray: dense gas bright and opaque; hue from an attribute",
    settings: SETTINGS,
    technique: Technique::Grid(|painting| grid::paint(painting, grid::Layers { volume: true, surfaces: &[] })),
    quantity: "density",
    unit: grid::density_unit,
    weight: grid::masses,
    conserves: Conserved::Mass,
    usual_attributes: &[],
    weight_attributes: &[],
    footprint: |_| Footprint::Kernel,
    transfer: ["density", "density-hue"],
};
