//! What a visualization mode is: what is accumulated (`P` and `S`), how far a particle reaches in the picture, which
//! settings it has, and how the picture starts out. The same description serves the command line, RON, the panel and
//! the manual.

pub mod blend;
pub mod depiction;
pub mod field;
pub mod in_view;
pub mod levels;
pub mod lod_budget;
pub mod over;
pub mod paths;
pub mod sample;
pub mod setting;
pub mod technique;

pub use depiction::{CodeTable, Coloring, Depiction, SourceColumns};
pub use field::{FieldJob, FieldMarch, FieldPasses, FieldValues, ValueStatistics};
pub use in_view::InView;
pub use levels::{LevelChoice, Levels};
pub use lod_budget::{LodBudget, Plan};
pub use paths::{Focus, PathColor, PathSettings, PathShape, PathsOf, Span};
pub use setting::{Setting, SettingError, SettingKind, SettingValue, Settings};
pub use technique::{
    Adapter, FindRanges, Job, LightPasses, LightPicture, LightPlan, Needs, Output, OwnColors, Raw, SPLAT_SUMS,
    SplatSums, Technique, Terms,
};

use crate::cpu::paths::PathFragments;
use crate::cpu::volume::VolumeError;
use crate::model::Unit;
use crate::view::perspective_grid::GridError;

/// The description of a mode.
pub struct Mode {
    /// The name that the command line and RON use.
    pub name: &'static str,
    /// What it shows, a sentence.
    pub help: &'static str,
    /// Its settings, in groups that modes share.
    pub settings: &'static [&'static [&'static Setting]],
    /// How it is drawn.
    pub technique: &'static dyn Technique,
    /// What `P` is called in a legend.
    pub quantity: &'static str,
    /// The unit of `P`, from those of mass and length.
    pub unit: fn(mass: &Unit, length: &Unit) -> Unit,
    /// The weight `w` of each particle, whose line-of-sight integral is `P`.
    pub weight: fn(&Columns<'_>) -> Vec<f32>,
    /// Which of a node's exact sums its weights conserve.
    pub conserves: Conserved,
    /// Of the displacement on the screen that a picture may have, the share that it has at most where an attribute gives the hue. Merged
    /// particles have means of attributes weighted by mass: 1 for a mode that weighs with that, too, and less for one that weighs
    /// otherwise, whose hue is off where particles are merged. Of data without its `weight_attributes` it weighs with mass.
    pub hue_tolerance: f64,
    /// Names of attributes that colour the picture when the user names none: the first that the data has is used.
    /// Without any, the picture has no `S` and its colour follows `P`.
    pub usual_attributes: &'static [&'static str],
    /// Attributes that the weight itself uses; of data without them it is the mass.
    pub weight_attributes: &'static [&'static str],
    /// Name of the transfer function to begin with, in `assets/transfer/`: without colour channel, and with one.
    pub transfer: [&'static str; 2],
}

/// How far a particle reaches in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Footprint {
    /// As far as its smoothing length, with the data's kernel.
    Kernel,
    /// A disc of this radius in pixels at any distance.
    Pixels(f32),
}

/// A sum over source particles that a hierarchy keeps exactly for each node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conserved {
    /// `sum m`.
    Mass,
    /// `sum m rho`.
    MassDensity,
    /// Neither: the weight is of another kind.
    Neither,
}

/// Columns of particle quantities, of source particles or of a codebook's entries; all have the same length.
#[derive(Clone, Copy)]
pub struct Columns<'a> {
    /// Masses `m`.
    pub mass: &'a [f32],
    /// Densities `rho`.
    pub density: &'a [f32],
    /// Smoothing lengths `h`.
    pub smoothing_length: &'a [f32],
    /// Further attributes by name.
    pub attributes: &'a [(&'a str, &'a [f32])],
}

impl<'a> Columns<'a> {
    /// The column of that name: `mass`, `density`, `smoothing-length` or an attribute.
    pub fn named(&self, name: &str) -> Option<&'a [f32]> {
        match name {
            "mass" => Some(self.mass),
            "density" => Some(self.density),
            "smoothing-length" => Some(self.smoothing_length),
            _ => self.attributes.iter().find(|(attribute, _)| *attribute == name).map(|&(_, values)| values),
        }
    }
}

impl std::fmt::Debug for Mode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Mode").field(&self.name).finish()
    }
}

impl Mode {
    /// Its settings.
    pub fn own_settings(&self) -> impl Iterator<Item = &'static Setting> + Clone + use<> {
        self.settings.iter().copied().flatten().copied()
    }

    /// Its settings, then those of what a picture of sums may leave undrawn, or of the levels alone that another picture is drawn from.
    pub fn all_settings(&self) -> impl Iterator<Item = &'static Setting> + use<> {
        let common: &[&'static Setting] = match self.technique.output() {
            Output::Sums => &lod_budget::COMMON,
            _ if self.technique.takes_clusters() => &levels::OF_ANY,
            _ if self.takes_fields() => &levels::OF_FIELDS,
            _ => &[],
        };
        self.own_settings().chain(common.iter().copied())
    }

    /// Whether its pictures are colours straight from the particles, not values that a transfer function colours.
    pub fn is_light(&self) -> bool {
        self.technique.output() == Output::Light
    }

    /// Whether it draws pathlines alone, and no particles.
    pub fn is_of_paths(&self) -> bool {
        !self.technique.needs(&Settings::default()).particles
    }

    /// Whether it draws particles.
    pub fn takes_particles(&self) -> bool {
        self.technique.takes_particles()
    }

    /// Whether it draws measured heights.
    pub fn takes_surfaces(&self) -> bool {
        self.technique.takes_surfaces()
    }

    /// Whether it draws images or volumes.
    pub fn takes_fields(&self) -> bool {
        !self.technique.field_dimensions().is_empty()
    }

    /// Whether it draws fields of so many dimensions: images, of 2, or volumes, of 3.
    pub fn takes_fields_of(&self, dimensions: usize) -> bool {
        self.technique.field_dimensions().contains(&dimensions)
    }

    /// Whether it draws a field of so many dimensions, of which there are points or samples alone.
    pub fn takes_field(&self, dimensions: usize, has_points: bool) -> bool {
        self.takes_fields_of(dimensions) || has_points && self.technique.takes_points()
    }

    /// Draws an image or a volume on the processor.
    ///
    /// # Errors
    /// [`VolumeError::Setting`] with modes that fit, where this one does not draw the data; else as [`Technique::draw_field`].
    pub fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        self.takes(job)?;
        self.technique.draw_field(job)
    }

    /// What an adapter's passes draw of an image or a volume; `None` where the processor draws it.
    ///
    /// # Errors
    /// As [`Mode::draw_field`].
    pub fn field_passes(&self, job: &FieldJob<'_>) -> Result<Option<FieldPasses>, VolumeError> {
        self.takes(job)?;
        self.technique.field_passes(job)
    }

    /// What an image or a volume shows in each pixel, in parts from front to back that something else is drawn among.
    ///
    /// # Errors
    /// As [`Mode::draw_field`], but none where nothing is in view.
    pub fn field_parts(&self, job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
        self.takes(job)?;
        match self.technique.field_parts(job) {
            Err(VolumeError::Grid(GridError::NothingInView)) => Ok(PathFragments::nothing(job.view)),
            parts => parts,
        }
    }

    /// Whether it draws fields of so many dimensions among other data.
    pub fn takes_field_among(&self, dimensions: usize) -> bool {
        self.takes_fields_of(dimensions) && self.technique.has_field_parts()
    }

    /// Refuses fields that it does not draw.
    fn takes(&self, job: &FieldJob<'_>) -> Result<(), VolumeError> {
        let is_volume = job.values.is_volume;
        let takes = self.takes_field(if is_volume { 3 } else { 2 }, job.points.is_some());
        let (found, expected) = match (takes, is_volume) {
            (true, _) => return Ok(()),
            (false, true) => ("one of images", "volume, slice or another one of volumes: the data is one"),
            (false, false) => ("one of volumes", "image: the data is one"),
        };
        Err(VolumeError::Setting { field: "mode", found: found.into(), expected: expected.into() })
    }

    /// Draws it on the processor.
    ///
    /// # Errors
    /// [`VolumeError::OnlyAdapter`] for a mode that only an adapter draws; else as [`Technique::draw`].
    pub fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        match self.technique.on_processor() {
            true => self.technique.draw(job),
            false => Err(VolumeError::OnlyAdapter(self.name)),
        }
    }

    /// The attribute that colours the picture: `wanted` if named, else the first usual one among `available`.
    pub fn attribute<'a>(&self, wanted: Option<&'a str>, available: &[&str]) -> Option<&'a str> {
        wanted.or_else(|| self.usual_attributes.iter().copied().find(|usual| available.contains(usual)))
    }
}
