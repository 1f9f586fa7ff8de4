//! The settings of volumes, and the groups in which modes have them.

use crate::cpu::volume;
use crate::cpu::volume::particles::SMALLEST;
use crate::mode::{Setting, SettingKind};
use crate::model::Kernel;
use crate::modes::volume_fields;

/// Cells per pixel.
pub static RESOLUTION: Setting = Setting {
    name: "resolution",
    unit: "cells/px",
    kind: SettingKind::Number { min: 0.1, max: 2.0, default: 1.0 },
    help: "resolution of the grid: 1 is that of the picture; 0.5 costs an eighth of the cells",
};
/// How wide the cells of merged particles may be.
pub static DETAIL: Setting = Setting {
    name: "detail",
    unit: "cells",
    kind: SettingKind::Number { min: 0.0, max: 16.0, default: 1.0 },
    help: "merged particles stand for what lies within so many cells of the grid (F12 5.5.2), in files with levels for volumes; \
           smaller is finer, 0: source particles only",
};
/// Whether slices are as dense on the edges as in the middle.
pub static LAMBDA: Setting = Setting {
    name: "lambda",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "slices are so dense that rays at the picture's corners are sampled as finely as the middle one (F12 5.4)",
};
/// Memory for the cells of a slab.
pub static SLAB_MEMORY: Setting = Setting {
    name: "slab-memory",
    unit: "MiB",
    kind: SettingKind::Number { min: 1.0, max: 65_536.0, default: 256.0 },
    help: "memory for the part of the grid that is resampled at once; decides how thick slabs are, not what is seen",
};
/// Depth of the near plane.
pub static NEAR: Setting = Setting {
    name: "near",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "depth where the volume begins, in the data's length unit; 0: in front of the data",
};
/// Depth of the far plane.
pub static FAR: Setting = Setting {
    name: "far",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "depth where the volume ends, in the data's length unit; 0: behind the data",
};
/// Opacity at which rays end.
pub static TERMINATION: Setting = Setting {
    name: "termination",
    unit: "",
    kind: SettingKind::Number { min: 0.5, max: 1.0, default: 0.999 },
    help: "rays end when they are as opaque",
};
/// Whether hidden bricks are left out.
pub static OCCLUSION: Setting = Setting {
    name: "occlusion",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "what lies behind opaque pixels is left out; off only to measure what that saves",
};
/// Least size of particles.
pub static SMALLEST_CELLS: Setting = Setting {
    name: "smallest",
    unit: "cells",
    kind: SettingKind::Number { min: 0.0, max: 8.0, default: SMALLEST },
    help: "least smoothing length: smaller particles are enlarged to it, with their mass (F12 5.5); 0: none",
};
/// The data's own kernel, and those of [`Kernel::ALL`] by name.
const KERNELS: &[&str] = &{
    let mut names = ["data"; Kernel::ALL.len() + 1];
    let mut index = 0;
    while index < Kernel::ALL.len() {
        names[index + 1] = Kernel::ALL[index].name();
        index += 1;
    }
    names
};
/// The kernel.
pub static KERNEL: Setting = Setting {
    name: "kernel",
    unit: "",
    kind: SettingKind::Choice { options: KERNELS },
    help: "the kernel that densities are summed with: the data's own, or another",
};
/// Factor on the extinction.
pub static OPACITY: Setting = Setting {
    name: "opacity",
    unit: "",
    kind: SettingKind::Number { min: 0.001, max: 2000.0, default: 1.0 },
    help: "how opaque the volume is: 2 is twice as much matter",
};
/// Whose values a volume shows.
pub static FIELD: Setting = Setting {
    name: "field",
    unit: "",
    kind: SettingKind::Column { default: volume_fields::DENSITY },
    help: "what the volume shows of particles, and the transfer function's range is of: their density, or an attribute between them",
};
/// Densities of the surfaces.
pub static ISOVALUES: Setting = Setting {
    name: "isovalues",
    unit: "",
    kind: SettingKind::Numbers { min: -1e38, max: 1e38, most: volume::surface::MOST_SURFACES },
    help: "densities of the isosurfaces (values of another surface-field, of images and volumes), in the data's units; without any they are \
           chosen from the data",
};
/// Their opacities.
pub static ISO_OPACITIES: Setting = Setting {
    name: "iso-opacities",
    unit: "",
    kind: SettingKind::Numbers { min: 0.0, max: 1.0, most: volume::surface::MOST_SURFACES },
    help: "opacity of each isosurface; without any the densest is opaque and the others are not",
};
/// Their colours.
pub static ISO_COLORS: Setting = Setting {
    name: "iso-colors",
    unit: "",
    kind: SettingKind::Colors { most: volume::surface::MOST_SURFACES },
    help: "colour of each isosurface; without any the attribute's, or the colour map's at its density",
};
/// Whether surfaces are lit.
pub static LIGHTING: Setting = Setting {
    name: "lighting",
    unit: "",
    kind: SettingKind::Flag { default: true },
    help: "isosurfaces are lit by a lamp at the eye",
};
/// Smoothing of surfaces.
pub static SURFACE_SMOOTHING: Setting = Setting {
    name: "surface-smoothing",
    unit: "steps",
    kind: SettingKind::Number { min: 0.0, max: 200.0, default: 0.0 },
    help: "the light on the surface that adds most to a pixel follows the larger forms: directions flow to those around up to silhouettes (F12 5.11); not with shadows or ambient occlusion, nor of sampled volumes among other data",
};
/// Whether the volume itself is lit.
pub static VOLUME_LIGHTING: Setting = Setting {
    name: "volume-lighting",
    unit: "",
    kind: SettingKind::Flag { default: false },
    help: "the volume itself is lit by a lamp at the eye, by the gradients of its values (F12 5.6)",
};
/// Light from everywhere.
pub static AMBIENT: Setting = Setting {
    name: "ambient",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.12 },
    help: "share of a lit colour that is seen without light",
};
/// The highlight.
pub static SPECULAR: Setting = Setting {
    name: "specular",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.15 },
    help: "strength of the highlight where surfaces and gradients face the eye",
};
/// The highlight's exponent.
pub static SHININESS: Setting = Setting {
    name: "shininess",
    unit: "",
    kind: SettingKind::Number { min: 1.0, max: 500.0, default: 40.0 },
    help: "how narrow the highlight is",
};

/// Where a volume begins and ends, where rays end, and what is summed: every mode that draws a volume has these.
pub static COMMON: &[&Setting] = &[&NEAR, &FAR, &TERMINATION, &SMALLEST_CELLS, &KERNEL];
/// How the perspective grid is laid and held.
pub static GRID: &[&Setting] = &[&RESOLUTION, &DETAIL, &LAMBDA, &SLAB_MEMORY, &OCCLUSION];
/// The isosurfaces.
pub static SURFACES: &[&Setting] = &[&ISOVALUES, &ISO_OPACITIES, &ISO_COLORS];
/// The light on surfaces.
pub static LIGHT: &[&Setting] = &[&LIGHTING, &AMBIENT, &SPECULAR, &SHININESS];
/// The light in a volume without surfaces.
pub static LIGHT_OF_VOLUME: &[&Setting] = &[&VOLUME_LIGHTING, &AMBIENT, &SPECULAR, &SHININESS];
