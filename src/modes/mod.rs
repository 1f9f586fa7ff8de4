//! What a user picks: one small file for each visualization mode. A mode says what is accumulated (`P` and `S`), how
//! far a particle reaches in the picture, which settings it has, and how the picture starts out; the same description
//! serves the command line, RON, the panel and the manual.
//!
//! A new mode is a file here and a line in [`MODES`].

pub mod around;
pub mod cartesian;
pub mod column_density;
pub mod cpu;
pub mod density_squared;
pub mod depiction;
pub mod economy;
pub mod governor;
#[cfg(feature = "viewer")]
pub mod gpu;
pub mod grid;
pub mod isosurface;
pub mod layered;
pub mod paint;
pub mod pilot;
pub mod points;
pub mod setting;
pub mod sorted_splats;
pub mod spheres;
pub mod volume;
pub mod volume_isosurface;

pub use depiction::{CodeTable, Coloring, Depiction, SourceColumns};
pub use economy::{Economy, Plan};
pub use paint::{Painted, Painter, Painting};
pub use setting::{Setting, SettingError, SettingKind, SettingValue, Settings};

use crate::model::Unit;

/// Every registered mode; the first is the default.
pub static MODES: [&Mode; 10] = [
    &column_density::MODE,
    &density_squared::MODE,
    &points::MODE,
    &volume::MODE,
    &isosurface::MODE,
    &volume_isosurface::MODE,
    &layered::MODE,
    &sorted_splats::MODE,
    &spheres::MODE,
    &cartesian::MODE,
];

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
    /// Its settings, then those that every mode of splats has.
    pub fn all_settings(&self) -> impl Iterator<Item = &'static Setting> + use<> {
        let common: &[&Setting] = if self.painter().is_some() { &[] } else { &economy::COMMON };
        self.settings.iter().copied().flatten().chain(common).copied()
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

/// The mode of that name.
pub fn find(name: &str) -> Option<&'static Mode> {
    MODES.iter().copied().find(|mode| mode.name == name)
}

/// The mode to begin with for data that has these fields: the one whose weight is made of fields that the data has
/// (`points` for magnitudes), else the first.
pub fn usual<'a>(fields: impl Iterator<Item = &'a str> + Clone) -> &'static Mode {
    let has = |wanted: &&str| fields.clone().any(|field| field == *wanted);
    let fits = |mode: &&Mode| !mode.weight_attributes.is_empty() && mode.weight_attributes.iter().all(has);
    MODES.iter().copied().find(|mode| fits(mode)).unwrap_or(MODES[0])
}

/// The names of all modes, for messages.
pub fn names() -> String {
    MODES.map(|mode| mode.name).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn catalogues_begin_as_points() {
        assert_eq!(usual(["speed", "magnitude"].into_iter()).name, "points");
        assert_eq!(usual(["speed", "temperature"].into_iter()).name, "column-density");
        assert_eq!(usual(std::iter::empty()).name, "column-density");
    }
    use crate::raster::transfer::TransferFunction;

    #[test]
    fn modes_have_names_of_their_own_and_settings_with_valid_defaults() {
        for (i, mode) in MODES.iter().enumerate() {
            assert!(MODES[..i].iter().all(|other| other.name != mode.name));
            assert!(std::ptr::eq(find(mode.name).unwrap(), *mode));
            for setting in mode.all_settings() {
                setting.check(&setting.default()).unwrap();
            }
        }
        assert!(find("no-such-mode").is_none());
    }

    #[test]
    fn every_mode_begins_with_a_transfer_function_that_exists() {
        for mode in MODES {
            let [plain, colored] = mode.transfer.map(|name| TransferFunction::preset(name).unwrap());
            assert!(plain.hue.is_none() && colored.hue.is_some(), "{}", mode.name);
        }
    }

    #[test]
    fn weights_are_those_of_the_paper() {
        let columns = Columns {
            mass: &[2.0, 3.0],
            density: &[5.0, 7.0],
            smoothing_length: &[1.0, 1.0],
            attributes: &[("magnitude", &[0.0, 5.0])],
        };
        assert_eq!((column_density::MODE.weight)(&columns), [2.0, 3.0]);
        assert_eq!((density_squared::MODE.weight)(&columns), [10.0, 21.0]);
        let flux = (points::MODE.weight)(&columns);
        assert!((flux[0] - 1.0).abs() < 1e-6 && (flux[1] - 0.01).abs() < 1e-8, "{flux:?}");
    }
}
