//! What is open, and how the user wants to see it.

use super::camera::{Lens, Viewpoint};
use super::facts::Facts;
use super::picture::Picture;
use super::preset::Preset;
use crate::annotate::Annotations;
use crate::color::transfer::TransferFunction;
use crate::explore::SelectionSet;
use crate::explore::data::source_path;
use crate::look::{Attribute, Member};
use crate::mode::economy::{PRESENCE, THINNING};
use crate::mode::{Mode, SettingValue};
use crate::model::{Bounds, PeriodicBox};
use crate::modes;
use crate::store::PageFile;
use crate::view::CutSettings;
use bevy::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// The open dataset.
#[derive(Resource)]
pub struct Scene {
    /// What the user named.
    pub path: PathBuf,
    /// The datasets: that, and those shown with it.
    pub members: Vec<Member>,
    /// Its page file, or theirs as one.
    pub file: Arc<PageFile>,
    /// The box around all families, world units.
    pub bounds: Bounds,
    /// The box that the first picture shows: without far outliers.
    pub frame: Bounds,
    /// The periodic box that the particles fill, where they do.
    pub periodic: Option<PeriodicBox>,
    /// Unit of positions.
    pub length_unit: String,
    /// What the panel says about it.
    pub facts: Facts,
    /// Counts up with every file that is opened; what belongs to another generation is stale.
    pub generation: u32,
}

impl Scene {
    /// The source, where it is still there: what the user named, unless that is a page file itself. None where there are several.
    pub fn source(&self) -> Option<PathBuf> {
        if !self.file.is_as_its_source() {
            return None;
        }
        if self.path != self.file.path() { Some(self.path.clone()) } else { source_path(&self.file) }
    }
}

/// How the user wants to see the data: everything that the panel edits.
#[derive(Resource, Clone)]
pub struct Settings {
    /// The mode.
    pub mode: &'static Mode,
    /// Whether the user chose the mode; else each file begins with its usual one.
    pub mode_chosen: bool,
    /// Its settings.
    pub mode_settings: crate::mode::Settings,
    /// The attribute that gives the hue.
    pub attribute: Attribute,
    /// Colour maps and ranges.
    pub transfer: TransferFunction,
    /// What is written into the picture.
    pub annotations: Annotations,
    /// The screen-space error `tau`, pixels.
    pub error_px: f64,
    /// Whether each family is drawn, in the order of the file's families.
    pub families: Vec<bool>,
    /// Projection and field of view.
    pub lens: Lens,
    /// What is left out of the data and faded.
    pub cut: CutSettings,
    /// Coloured selections.
    pub selections: Vec<SelectionSet>,
    /// Whether the transfer function belongs to the mode that has just been set, and is not to be chosen anew for it: where
    /// settings come back from the history or from a scene. Not a setting itself.
    pub keep_transfer: bool,
}

impl PartialEq for Settings {
    fn eq(&self, other: &Settings) -> bool {
        std::ptr::eq(self.mode, other.mode)
            && self.mode_settings == other.mode_settings
            && self.attribute == other.attribute
            && self.transfer == other.transfer
            && self.annotations == other.annotations
            && self.error_px == other.error_px
            && self.families == other.families
            && self.lens == other.lens
            && self.cut == other.cut
            && self.selections == other.selections
    }
}

impl Settings {
    /// The settings before anything is open; the first mode where `mode` names none.
    pub fn new(preset: &Preset, mode: Option<&str>) -> Settings {
        Settings {
            mode: mode.and_then(modes::find).unwrap_or(modes::first()),
            mode_chosen: mode.is_some(),
            mode_settings: economy_of(preset),
            attribute: Attribute::Automatic,
            transfer: TransferFunction::default(),
            annotations: Annotations::default(),
            error_px: preset.drawing.error_px,
            families: Vec::new(),
            lens: Lens { fov_deg: preset.camera.field_of_view_deg, parallel: false },
            cut: CutSettings::default(),
            selections: Vec::new(),
            keep_transfer: false,
        }
    }

    /// Changes the mode as the user wants it; its settings begin with their defaults.
    pub fn choose_mode(&mut self, mode: &'static Mode) {
        self.mode_chosen = true;
        self.change_mode(mode);
    }

    pub(super) fn change_mode(&mut self, mode: &'static Mode) {
        if !std::ptr::eq(self.mode, mode) {
            self.mode = mode;
            self.mode_settings = self.mode_settings.common();
        }
    }
}

/// The settings of every mode that a preset sets.
pub(crate) fn economy_of(preset: &Preset) -> crate::mode::Settings {
    let mut settings = crate::mode::Settings::default();
    let drawing = &preset.drawing;
    for (setting, value) in [(&PRESENCE, drawing.presence), (&THINNING, drawing.thinning)] {
        settings.set(setting, SettingValue::Number(value));
    }
    settings
}

/// The viewpoint that shows the whole dataset in the picture.
pub fn home(bounds: Bounds, fov_y: f64, picture: &Picture) -> Result<Viewpoint, crate::view::camera::ViewError> {
    let size = picture.size();
    let mut viewpoint = Viewpoint::around(bounds, fov_y, size.x, size.y)?;
    // The sphere around a box is larger than what one sees of the box.
    viewpoint.eye = viewpoint.target + 0.82 * (viewpoint.eye - viewpoint.target);
    Ok(viewpoint)
}
