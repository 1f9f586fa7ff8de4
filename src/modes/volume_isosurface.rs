//! `volume-isosurface`: a volume and surfaces in it, in one pass (F12 5.6, figure 5.1 c).

use super::{Conserved, Footprint, Mode, Setting, Technique, grid};

static SETTINGS: &[Setting] = &[
    grid::OPACITY,
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
    name: "volume-isosurface",
    help: "surfaces of equal density within a volume that emits and absorbs light",
    settings: SETTINGS,
    technique: Technique::Grid(|painting| {
        grid::paint(painting, grid::Layers { volume: true, surfaces: &[(0.55, 0.25), (0.9, 0.9)] })
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
