//! Modes that draw colours straight from particles: what they are given, and what they give.

use super::Settings;
use crate::color::Colors;
use crate::color::transfer::TransferFunction;
use crate::cpu::Splats;
use crate::cpu::volume::{Caster, VolumeError, VolumeLevels, VolumeReport};
use crate::model::Kernel;
use crate::view::View;

/// Draws a mode's colours.
pub type Painter = fn(&Painting<'_>) -> Result<Painted, VolumeError>;

/// What is to be drawn, and how.
pub struct Painting<'a> {
    /// The camera.
    pub view: &'a View,
    /// The particles: weights are masses.
    pub batches: &'a [Splats<'a>],
    /// The kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// The mode's settings.
    pub settings: &'a Settings,
    /// What volumes emit and absorb; the mode's own where it is `None`.
    pub transfer: Option<&'a TransferFunction>,
    /// The data's diameter, world units.
    pub diameter: f64,
    /// The data's largest density.
    pub densest: f64,
    /// What draws modes of the perspective grid.
    pub caster: &'a dyn Caster,
}

/// A picture in colours.
#[derive(Clone, Debug)]
pub struct Painted {
    /// The colours.
    pub colors: Colors,
    /// What drawing took.
    pub report: VolumeReport,
    /// The ranges that were used.
    pub levels: VolumeLevels,
    /// The isosurfaces' densities.
    pub isovalues: Vec<f64>,
}
