//! `isosurface`: surfaces of equal density through the perspective grid (F12 5.6).

use super::{Conserved, Footprint, Mode, Setting, Technique, grid};

static SETTINGS: &[Setting] = &[
    grid::ISOVALUES,
    grid::ISO_OPACITIES,
    grid::ISO_COLORS,
    grid::LIGHTING,
    grid::AMBIENT,
    grid::SPECULAR,
    grid::SHININESS,
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
    name: "isosurface",
    help: "surfaces of equal density, lit from the eye; coloured by their density or by an attribute",
    settings: SETTINGS,
    technique: Technique::Grid(|painting| {
        grid::paint(painting, grid::Layers { volume: false, surfaces: &[(0.3, 0.22), (0.62, 0.4), (0.9, 1.0)] })
    }),
    quantity: "density",
    unit: grid::density_unit,
    weight: grid::masses,
    conserves: Conserved::Mass,
    usual_attributes: &[],
    weight_attributes: &[],
    footprint: |_| Footprint::Kernel,
    transfer: ["density", "density-hue"],
};
