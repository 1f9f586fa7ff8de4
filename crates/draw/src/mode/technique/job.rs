//! What a technique is handed: what is to be drawn, and how.

use crate::color::transfer::TransferFunction;
use crate::cpu::over::Order;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::Lighting;
use crate::cpu::volume::{FieldRange, VolumeError, VolumeOptions};
use crate::cpu::{SplatOptions, Splats};
use crate::mode::{InView, Settings};
use crate::model::{Bounds, Kernel};
use crate::view::View;

/// What is to be drawn, and how.
pub struct Job<'a> {
    /// The camera.
    pub view: &'a View,
    /// The particles, their weights those of the mode.
    pub batches: &'a [Splats<'a>],
    /// The kernel that the smoothing lengths belong to, and what may be left out.
    pub options: SplatOptions,
    /// The mode's settings.
    pub settings: &'a Settings,
    /// What volumes emit and absorb; the mode's own where it is `None`.
    pub transfer: Option<&'a TransferFunction>,
    /// A box around the data.
    pub bounds: Bounds,
    /// The data's diameter, world units; 0 for sums, which have no use for it.
    pub diameter: f64,
    /// The data's largest density; 0 for sums.
    pub densest: f64,
    /// Factor on the particles' own densities: see [`crate::cpu::volume::particles::density_scale`].
    pub density_scale: f32,
    /// Mean mass of a source particle of the families that are drawn.
    pub mean_mass: f64,
    /// Paths that are drawn among it, by techniques that take them, and measured surfaces, by those that meet these.
    pub paths: Option<&'a PathFragments>,
    /// Angle of a pixel of the panorama that the picture is a face of, radians; `None` for a flat picture.
    pub around: Option<f64>,
    /// What all views of a picture that is put together of several show, by which one range is found for all; `None`: this one has its own.
    pub in_views: Option<&'a InView>,
    /// What lamps go with, and what else hides light, by techniques with opaque surfaces.
    pub lighting: Lighting<'a>,
    /// The order in which splats lie over each other, by techniques that draw them so.
    pub order: Order,
}

impl<'a> Job<'a> {
    /// What the picture depends on beside the particles.
    pub fn terms(&self) -> Terms<'a> {
        let Job { view, settings, transfer, diameter, densest, density_scale, mean_mass, .. } = *self;
        let attribute = self.batches.iter().any(|batch| batch.attribute().is_some());
        let kernel = self.options.kernel;
        Terms { view, settings, transfer, attribute, kernel, diameter, densest, density_scale, mean_mass }
    }
}

/// What a picture of light depends on beside its particles.
#[derive(Clone, Copy)]
pub struct Terms<'a> {
    /// The camera.
    pub view: &'a View,
    /// The mode's settings.
    pub settings: &'a Settings,
    /// What volumes emit and absorb; the mode's own where it is `None`.
    pub transfer: Option<&'a TransferFunction>,
    /// Whether particles have an attribute.
    pub attribute: bool,
    /// The kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// The data's diameter, world units.
    pub diameter: f64,
    /// The data's largest density.
    pub densest: f64,
    /// Factor on the particles' own densities: see [`crate::cpu::volume::particles::density_scale`].
    pub density_scale: f32,
    /// Mean mass of a source particle of the families that are drawn.
    pub mean_mass: f64,
}

/// Finds between which values the mass of a field lies that is sampled like this.
pub type FindRanges<'a> = dyn FnMut(&VolumeOptions) -> Result<FieldRange, VolumeError> + 'a;
