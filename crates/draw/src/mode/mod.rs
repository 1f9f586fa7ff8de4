//! What a visualization mode is: what is accumulated (`P` and `S`), how far a particle reaches in the picture, which
//! settings it has, and how the picture starts out. The same description serves the command line, RON, the panel and
//! the manual.

pub mod depiction;
pub mod economy;
mod named;
pub mod paint;
pub mod sample;
pub mod setting;

pub use depiction::{CodeTable, Coloring, Depiction, SourceColumns};
pub use economy::{Economy, Plan};
pub use paint::{Painted, Painter, Painting};
pub use setting::{Setting, SettingError, SettingKind, SettingValue, Settings};

use crate::model::Unit;

/// The description of a mode.
pub struct Mode {
    /// The name that the command line and RON use.
    pub name: &'static str,
    /// What it shows, a sentence.
    pub help: &'static str,
    /// Its settings, in groups that modes share.
    pub settings: &'static [&'static [&'static Setting]],
    /// How it is drawn.
    pub technique: Technique,
    /// What `P` is called in a legend.
    pub quantity: &'static str,
    /// The unit of `P`, from those of mass and length.
    pub unit: fn(mass: &Unit, length: &Unit) -> Unit,
    /// The weight `w` of each particle, whose line-of-sight integral is `P`.
    pub weight: fn(&Columns<'_>) -> Vec<f32>,
    /// Which of a node's exact sums its weights conserve.
    pub conserves: Conserved,
    /// Names of attributes that colour the picture when the user names none: the first that the data has is used.
    /// Without any, the picture has no `S` and its colour follows `P`.
    pub usual_attributes: &'static [&'static str],
    /// Attributes that the weight itself uses.
    pub weight_attributes: &'static [&'static str],
    /// Whether each particle's own density is drawn with, beside its weight.
    pub densities: bool,
    /// The shape of a particle in the picture.
    pub footprint: fn(&Settings) -> Footprint,
    /// Name of the transfer function to begin with, in `assets/transfer/`: without colour channel, and with one.
    pub transfer: [&'static str; 2],
}

/// How a mode is drawn. What draws asks for the technique and never for the mode.
#[derive(Clone, Copy)]
pub enum Technique {
    /// Splats are accumulated to `P` and `S`, in any order, and coloured by a transfer function; every backend can.
    Splats,
    /// Colours come from the particles straight, in their order along each line of sight; the processor draws them with
    /// this.
    Colors(Painter),
    /// The same through the perspective grid, which the processor or an adapter resamples and casts rays through:
    /// [`Painting::caster`].
    Grid(Painter),
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

    /// Its settings, then those of what a picture of splats may leave undrawn.
    pub fn all_settings(&self) -> impl Iterator<Item = &'static Setting> + use<> {
        let common: &[&'static Setting] = if self.painter().is_some() { &[] } else { &economy::COMMON };
        self.own_settings().chain(common.iter().copied())
    }

    /// What draws its colours, for modes that are not made of splats.
    pub fn painter(&self) -> Option<Painter> {
        match self.technique {
            Technique::Splats => None,
            Technique::Colors(painter) | Technique::Grid(painter) => Some(painter),
        }
    }

    /// Whether an adapter can draw its colours.
    pub fn is_cast(&self) -> bool {
        matches!(self.technique, Technique::Grid(_))
    }

    /// The attribute that colours the picture: `wanted` if named, else the first usual one among `available`.
    pub fn attribute<'a>(&self, wanted: Option<&'a str>, available: &[&str]) -> Option<&'a str> {
        wanted.or_else(|| self.usual_attributes.iter().copied().find(|usual| available.contains(usual)))
    }
}
