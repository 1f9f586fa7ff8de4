//! What a technique hands back: passes for an adapter, or a picture, and what its colours mean.

use crate::color::splat_colors::{OwnColumn, SplatColors};
use crate::color::{Accumulation, Colors};
use crate::cpu::Counts;
use crate::cpu::cartesian::CartesianOptions;
use crate::cpu::layered::Assignment;
use crate::cpu::screen_spheres::{SphereOptions, SurfaceColors};
use crate::cpu::volume::attributes::ColumnMarch;
use crate::cpu::volume::{Classifier, Light, Scenery, VolumeError, VolumeLevels, VolumeOptions, VolumeReport};
use crate::mode::Mode;
use std::sync::Arc;

/// What colours mean that are of another quantity than the mode's.
#[derive(Clone, Debug, PartialEq)]
pub enum OwnColors {
    /// Values of a quantity, whose range is that of [`super::Technique::own_levels`].
    Axis {
        /// What it is called in a legend.
        title: &'static str,
        /// Whether its unit is that of lengths; else it has none.
        is_length: bool,
        /// Whether values are whole numbers.
        is_whole: bool,
        /// Whether values are placed logarithmically.
        log: bool,
        /// Colours at evenly spaced places, sRGB.
        colors: Vec<[u8; 4]>,
    },
    /// No values: no legend tells them.
    Names,
}

/// What an adapter's passes draw.
#[derive(Clone, Debug)]
pub struct LightPlan {
    /// By which passes, and with what.
    pub passes: LightPasses,
    /// The ranges of its colours.
    pub levels: VolumeLevels,
    /// The isosurfaces' densities.
    pub isovalues: Vec<f64>,
}

/// Passes of an adapter that draw light.
#[derive(Clone, Debug)]
pub enum LightPasses {
    /// Rays through the perspective grid.
    March(Scenery, VolumeOptions),
    /// The same of fields of columns.
    Columns(Box<ColumnMarch>),
    /// Rays through a Cartesian grid.
    Cartesian(Scenery, VolumeOptions, CartesianOptions),
    /// Splats in the order of their depth, each with its own density.
    Sorted {
        /// What densities and attributes emit and absorb.
        classifier: Classifier,
        /// Planes and least size.
        options: VolumeOptions,
        /// Rays end at this opacity.
        termination: f32,
        /// Factor on the particles' own densities.
        density_scale: f32,
    },
    /// Splats over each other, in the order of their distance from the eye.
    Over {
        /// What splats look like.
        colors: Arc<SplatColors>,
        /// By what their own columns are found.
        column: OwnColumn,
        /// Whether they have an attribute.
        attribute: bool,
    },
    /// Splats in layers of depth.
    Layered {
        /// What densities and attributes emit and absorb.
        classifier: Classifier,
        /// Planes and least size.
        options: VolumeOptions,
        /// Number of layers.
        layers: u32,
        /// Which layers a particle counts in.
        assignment: Assignment,
        /// Rays end at this opacity.
        termination: f32,
    },
    /// Spheres under one surface.
    Spheres {
        /// Their size, and which there are.
        options: SphereOptions,
        /// How the surface is lit; plain colours without.
        light: Option<Light>,
        /// Its colours.
        colors: SurfaceColors,
        /// Factor on the particles' own densities.
        density_scale: f32,
    },
}

impl LightPasses {
    /// What hides light, as a lamp sees it: planes are at depths from the eye. `None` where nothing does.
    pub fn casting(&self) -> Option<LightPasses> {
        match self {
            LightPasses::March(scenery, options) => {
                Some(LightPasses::March(scenery.casting()?, options.seen_from(false)))
            }
            LightPasses::Columns(march) => {
                let (scenery, options) = (march.scenery.casting()?, march.options.seen_from(false));
                Some(LightPasses::Columns(Box::new(ColumnMarch { scenery, options, ..ColumnMarch::clone(march) })))
            }
            LightPasses::Spheres { options, colors, density_scale, .. } => {
                let (colors, density_scale) = (colors.clone(), *density_scale);
                Some(LightPasses::Spheres { options: options.for_lamp(), light: None, colors, density_scale })
            }
            LightPasses::Cartesian(..)
            | LightPasses::Sorted { .. }
            | LightPasses::Over { .. }
            | LightPasses::Layered { .. } => None,
        }
    }
}

/// A picture before it is shown.
#[derive(Clone, Debug)]
pub enum Raw {
    /// `P` and `P S`, and what became of the particles.
    Sums(Accumulation, Counts),
    /// Colours.
    Light(LightPicture),
}

impl Raw {
    /// `P` and `P S`.
    ///
    /// # Errors
    /// [`VolumeError::Setting`] for colours.
    pub fn sums(self, mode: &Mode) -> Result<(Accumulation, Counts), VolumeError> {
        match self {
            Raw::Sums(accumulation, counts) => Ok((accumulation, counts)),
            Raw::Light(_) => Err(other_output(mode, "a mode that a transfer function colours")),
        }
    }

    /// Colours.
    ///
    /// # Errors
    /// [`VolumeError::Setting`] for sums.
    pub fn light(self, mode: &Mode) -> Result<LightPicture, VolumeError> {
        match self {
            Raw::Light(painted) => Ok(painted),
            Raw::Sums(..) => Err(other_output(mode, "a mode that draws colours straight from particles")),
        }
    }
}

fn other_output(mode: &Mode, expected: &str) -> VolumeError {
    VolumeError::Setting { field: "mode", found: mode.name.into(), expected: expected.into() }
}

/// A picture in colours.
#[derive(Clone, Debug)]
pub struct LightPicture {
    /// The colours.
    pub colors: Colors,
    /// What drawing took.
    pub report: VolumeReport,
    /// The ranges that were used.
    pub levels: VolumeLevels,
    /// The isosurfaces' densities.
    pub isovalues: Vec<f64>,
}

impl LightPicture {
    /// Colours that nothing is known of.
    pub fn of(colors: Colors) -> LightPicture {
        let levels = VolumeLevels { density: [0.0, 1.0], attribute: [0.0, 1.0], unit_length: 1.0 };
        LightPicture { colors, report: VolumeReport::default(), levels, isovalues: Vec::new() }
    }
}
