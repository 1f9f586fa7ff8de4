//! What is open in place of particles: an image, a volume, measured heights, or these among other things.

use crate::annotate::Units;
use crate::color::transfer::TransferFunction;
use crate::mode::{Depiction, LevelChoice, Mode, Settings};
use crate::model::Dataset;
use crate::modes;
use crate::picture::field::{FieldSession, OpenField};
use crate::picture::mixed::{OpenMixed, Samples};
use crate::picture::surface::{FieldInScene, OpenSurface, SurfaceSession};
use crate::picture::{AnySession, PictureError, Reporter, SessionOptions};
use std::sync::Arc;

/// Samples on a grid, and what is drawn with them.
#[derive(Clone)]
pub enum Sampled {
    /// An image or a volume.
    Field(Arc<OpenField>),
    /// Measured heights.
    Heights(Arc<OpenSurface>),
    /// Several kinds of data, or several of one that is no particles.
    Mixed(Arc<OpenMixed>),
}

impl Sampled {
    /// What draws pictures of it.
    pub fn drawer(&self, reporter: Arc<dyn Reporter>) -> AnySession {
        match self {
            Sampled::Field(opened) => AnySession::Field(Box::new(FieldSession::of(Arc::clone(opened), reporter))),
            Sampled::Heights(opened) => {
                let options = SessionOptions::default();
                AnySession::Surface(Box::new(SurfaceSession::of(Arc::clone(opened), options, reporter)))
            }
            Sampled::Mixed(opened) => AnySession::Mixed(Box::new(opened.session(&reporter))),
        }
    }

    /// Whether a mode's pictures are about its samples: of particles among others they are not.
    pub fn is_told_by(&self, mode: &Mode) -> bool {
        match self {
            Sampled::Field(_) | Sampled::Heights(_) => true,
            Sampled::Mixed(opened) => opened.told_by(mode).is_some(),
        }
    }

    /// What pictures in a mode are about: of several that which the mode draws, else the first.
    fn told_by(&self, mode: Option<&Mode>) -> Samples {
        match self {
            Sampled::Field(opened) => Samples::Field(Arc::clone(opened)),
            Sampled::Heights(opened) => Samples::Heights(Arc::clone(opened)),
            Sampled::Mixed(opened) => {
                mode.and_then(|mode| opened.told_by(mode)).unwrap_or_else(|| opened.first().clone())
            }
        }
    }

    /// The heights whose height is z in the window's world.
    pub fn ground(&self) -> Option<&Arc<OpenSurface>> {
        match self {
            Sampled::Field(_) => None,
            Sampled::Heights(opened) => Some(opened),
            Sampled::Mixed(opened) => opened.asked(),
        }
    }

    /// The heights that pictures in a mode are about.
    pub fn heights_of(&self, mode: &Mode) -> Option<Arc<OpenSurface>> {
        match self.told_by(Some(mode)) {
            Samples::Heights(opened) => Some(opened),
            Samples::Field(_) => None,
        }
    }

    /// Its heights where settings place them.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn fields(&self, settings: &Settings) -> Result<Vec<FieldInScene>, PictureError> {
        match self {
            Sampled::Field(_) => Ok(Vec::new()),
            Sampled::Heights(opened) => Ok(vec![FieldInScene::alone(opened, settings)?]),
            Sampled::Mixed(opened) => opened.in_scene(settings),
        }
    }

    /// Whether z is up.
    pub fn has_z_up(&self) -> bool {
        match self {
            Sampled::Field(_) => false,
            Sampled::Heights(_) => true,
            Sampled::Mixed(opened) => opened.begins_with_heights(),
        }
    }

    /// What it is of several kinds.
    pub fn mixed(&self) -> Option<&Arc<OpenMixed>> {
        match self {
            Sampled::Field(_) | Sampled::Heights(_) => None,
            Sampled::Mixed(opened) => Some(opened),
        }
    }

    /// Those of what is said of all datasets that is said of particles.
    pub fn of_particles<T: Clone>(&self, all: &[T]) -> Vec<T> {
        self.mixed().map_or_else(|| all.to_vec(), |opened| opened.of_particles(all))
    }

    /// Whether a mode draws it.
    pub fn is_drawn_by(&self, mode: &Mode) -> bool {
        match self {
            Sampled::Field(opened) => opened.is_drawn_by(mode),
            Sampled::Heights(opened) => opened.is_drawn_by(mode),
            Sampled::Mixed(opened) => opened.is_drawn_by(mode),
        }
    }

    /// The mode that it is shown in where none is chosen.
    pub fn usual_mode(&self) -> &'static Mode {
        match self {
            Sampled::Field(opened) => modes::of_fields(opened.grid().dimensions),
            Sampled::Heights(_) => &modes::surface::MODE,
            Sampled::Mixed(opened) => opened.usual_mode(),
        }
    }

    /// The names of what can colour its pictures in a mode.
    pub fn attributes(&self, mode: Option<&Mode>) -> Vec<String> {
        match self.told_by(mode) {
            Samples::Field(opened) => opened.attributes(),
            Samples::Heights(opened) => opened.attributes(),
        }
    }

    /// A mode of its pictures, coloured by an attribute where one is named.
    ///
    /// # Errors
    /// The names of the attributes that there are.
    pub fn depiction(
        &self,
        mode: &'static Mode,
        settings: Settings,
        attribute: Option<&str>,
        choice: LevelChoice,
    ) -> Result<Depiction, String> {
        match self.told_by(Some(mode)) {
            Samples::Field(opened) => opened.depiction(mode, settings, attribute, choice),
            Samples::Heights(opened) => opened.depiction(mode, settings, attribute, choice),
        }
    }

    /// The transfer function that a depiction of it has where none is chosen.
    pub fn usual_transfer(&self, depiction: &Depiction) -> TransferFunction {
        match self.told_by(Some(depiction.mode)) {
            Samples::Field(opened) => opened.usual_transfer(depiction),
            Samples::Heights(opened) => opened.usual_transfer(depiction),
        }
    }

    /// A transfer function as a depiction of it has it.
    pub fn shown_transfer(&self, depiction: &Depiction, transfer: &TransferFunction) -> TransferFunction {
        match self.told_by(Some(depiction.mode)) {
            Samples::Heights(opened) => opened.shown_transfer(depiction, transfer),
            _ => transfer.clone(),
        }
    }

    /// What a legend calls the values of a depiction.
    pub fn units(&self, depiction: &Depiction) -> Units {
        match self.told_by(Some(depiction.mode)) {
            Samples::Field(opened) => opened.units(depiction),
            Samples::Heights(opened) => opened.units(depiction),
        }
    }

    /// A few of its samples as particles.
    pub fn sketch(&self, most: usize) -> Dataset {
        match self.told_by(None) {
            Samples::Field(opened) => opened.sketch(most),
            Samples::Heights(opened) => opened.sketch(most),
        }
    }
}
