//! What the attributes of an image or a volume are called, and what its pictures mean.

use super::opened::OpenField;
use crate::annotate::{Shown, Units};
use crate::color::transfer::TransferFunction;
use crate::cpu::volume::VolumeError;
use crate::mode::{Coloring, Depiction, FieldValues, LevelChoice, Mode, Output, Settings};
use crate::model::{Grid, Unit};
use crate::modes;
use crate::modes::samples::FieldLook;
use crate::modes::slice_overlay::{self, VECTORS};

/// The attribute that every field has: how steep what it shows is.
pub const GRADIENT: &str = "gradient";

/// The names of what can colour pictures of a grid: its channels, and how steep the first one is.
pub fn attributes_of(grid: &Grid) -> Vec<String> {
    let mut names: Vec<String> = grid.channels.iter().map(|channel| channel.name.clone()).collect();
    if !names.iter().any(|name| name == GRADIENT) {
        names.push(GRADIENT.into());
    }
    names
}

impl OpenField {
    /// The names of what can colour its pictures, as [`attributes_of`] its grid.
    pub fn attributes(&self) -> Vec<String> {
        attributes_of(self.grid())
    }

    /// The place of an attribute among these.
    ///
    /// # Errors
    /// The names that there are.
    pub fn attribute(&self, name: &str) -> Result<usize, String> {
        let names = self.attributes();
        let missing = || format!("attribute {name} is not in the data, expected one of {}", names.join(", "));
        names.iter().position(|own| own == name).ok_or_else(missing)
    }

    /// The name and the unit of an attribute.
    pub(super) fn about(&self, attribute: usize) -> (String, Unit) {
        let grid = self.grid();
        match grid.channels.get(attribute) {
            Some(channel) => (channel.name.clone(), channel.unit.clone()),
            None => {
                let (value, length) = (&grid.channels[0].unit, &grid.length_unit);
                let is_known = !value.is_unknown() && !length.is_unknown();
                (GRADIENT.into(), if is_known { Unit::new(format!("{value}/{length}")) } else { Unit::default() })
            }
        }
    }

    /// A mode of its pictures, coloured by an attribute where one is named.
    ///
    /// # Errors
    /// As [`OpenField::attribute`].
    pub fn depiction(
        &self,
        mode: &'static Mode,
        settings: Settings,
        attribute: Option<&str>,
        choice: LevelChoice,
    ) -> Result<Depiction, String> {
        let coloring = |name: &str| {
            let statistics = self.statistics_of(self.attribute(name)?);
            Ok::<_, String>(Coloring { name: name.into(), fallback: 0.0, least: statistics.range()[0] })
        };
        Ok(Depiction { mode, settings, attribute: attribute.map(coloring).transpose()?, choice })
    }

    /// Whether a mode looks through it. What marches through a volume takes particles, too; a plane through one is coloured as an image is.
    pub(super) fn is_looked_through(&self, mode: &Mode) -> bool {
        self.grid().dimensions == 3 && (mode.technique.output() != Output::Light || mode.takes_particles())
    }

    /// The transfer function that a depiction of it has where none is chosen.
    pub fn usual_transfer(&self, depiction: &Depiction) -> TransferFunction {
        let attribute = depiction.attribute.as_ref();
        if depiction.mode.technique.output() != Output::Light {
            let name = depiction.mode.transfer[usize::from(attribute.is_some())];
            return TransferFunction::preset(name).unwrap_or_default();
        }
        let hue = attribute.and_then(|coloring| Some(self.statistics_of(self.attribute(&coloring.name).ok()?)));
        let is_volume = self.is_looked_through(depiction.mode);
        let values = FieldValues { shown: self.statistics(), hue: hue.as_ref(), is_volume };
        FieldLook::usual_of(depiction.mode, &depiction.settings, &values)
    }

    /// What a legend calls the values of a depiction.
    pub fn units(&self, depiction: &Depiction) -> Units {
        let grid = self.grid();
        let (shown, length) = (&grid.channels[0], grid.length_unit.clone());
        let mode = depiction.mode;
        let value = match mode.technique.output() {
            Output::Light => (shown.name.clone(), shown.unit.clone()),
            _ => {
                let unit = match (shown.unit.is_unknown(), length.is_unknown()) {
                    (false, false) => Unit::new(format!("{} {length}", shown.unit)),
                    _ => Unit::default(),
                };
                (format!("{} of {}", mode.quantity, shown.name), unit)
            }
        };
        let index = depiction.attribute.as_ref().and_then(|coloring| self.attribute(&coloring.name).ok());
        let attribute = index.map(|index| self.about(index).1).unwrap_or_default();
        let vector =
            self.vector(&depiction.settings, mode).unwrap_or_default().first().map(|channel| self.about(*channel).1);
        let value = Shown::Named(value.0, value.1);
        Units { mass: Unit::default(), length, attribute, value, vector: vector.unwrap_or_default() }
    }

    /// The attributes that are components of the vector field which a mode draws over a slice with these settings; none where it draws none.
    ///
    /// # Errors
    /// The vector fields that there are, where it is not among them.
    pub(super) fn vector(&self, settings: &Settings, mode: &Mode) -> Result<Vec<usize>, VolumeError> {
        let draws = mode.own_settings().any(|own| own.name == VECTORS.name);
        if !draws || slice_overlay::of(settings).vectors.is_none() {
            return Ok(Vec::new());
        }
        let names = self.attributes();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        Ok(slice_overlay::channels(settings, &names)?.into_iter().flatten().collect())
    }

    /// The modes that draw it.
    pub fn modes(&self) -> Vec<&'static Mode> {
        modes::all().into_iter().filter(|mode| self.is_drawn_by(mode)).collect()
    }

    /// Whether a mode draws it: its samples, or its points where it has some.
    pub fn is_drawn_by(&self, mode: &Mode) -> bool {
        mode.takes_field(self.grid().dimensions, self.has_points())
    }
}
