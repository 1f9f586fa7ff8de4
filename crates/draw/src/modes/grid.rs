//! What the modes of the perspective grid (F12 chapter 5) share: their settings, and how these become a picture.

mod look;
mod marched;
mod settings;

pub use look::{Look, check_densities, color_at, light, options, surfaces, volume_light};
pub use marched::Marched;
pub use settings::{
    AMBIENT, COMMON, DETAIL, FAR, FIELD, GRID, ISO_COLORS, ISO_OPACITIES, ISOVALUES, KERNEL, LAMBDA, LIGHT,
    LIGHT_OF_VOLUME, LIGHTING, NEAR, OCCLUSION, OPACITY, RESOLUTION, SHININESS, SLAB_MEMORY, SMALLEST_CELLS, SPECULAR,
    SURFACE_SMOOTHING, SURFACES, TERMINATION, VOLUME_LIGHTING,
};

use crate::mode::{Columns, Conserved, Mode};
use crate::model::Unit;

/// What all modes of volumes share; each has its own name, help, settings and technique. Particles weigh their mass, so that their
/// sum with the kernel is the density.
pub const MODE: Mode = Mode {
    name: "",
    help: "",
    settings: &[],
    technique: &Marched(Layers::VOLUME),
    quantity: "density",
    unit: density_unit,
    weight: masses,
    conserves: Conserved::Mass,
    hue_tolerance: 1.0,
    usual_attributes: &[],
    weight_attributes: &[],
    transfer: ["volume", "volume-hue"],
};

/// What is drawn of a volume.
#[derive(Clone, Copy, Debug)]
pub struct Layers {
    /// The volume itself.
    pub volume: bool,
    /// Isosurfaces: places in the logarithmic range of densities where they are unless set, and their opacities.
    pub surfaces: &'static [(f32, f32)],
}

impl Layers {
    /// The volume alone.
    pub const VOLUME: Layers = Layers { volume: true, surfaces: &[] };
    /// Surfaces alone.
    pub const SURFACES: Layers = Layers { volume: false, surfaces: &[(0.3, 0.22), (0.62, 0.4), (0.9, 1.0)] };
    /// Surfaces in the volume.
    pub const BOTH: Layers = Layers { volume: true, surfaces: &[(0.55, 0.25), (0.9, 0.9)] };
}

/// The unit of densities.
pub fn density_unit(mass: &Unit, length: &Unit) -> Unit {
    match mass.is_unknown() || length.is_unknown() {
        true => Unit::default(),
        false => Unit::new(format!("{mass} / ({length})^3")),
    }
}

/// Masses: what densities are sums of.
pub fn masses(columns: &Columns<'_>) -> Vec<f32> {
    columns.mass.to_vec()
}
