//! What is open, and how the user wants to see it.

use super::camera::{Anchor, Flight, Viewpoint};
use super::facts::Facts;
use super::lens::Lens;
use super::messages::Messages;
use super::open::Opened;
use super::panel::Choices;
use super::picture::{DataCamera, Picture};
use super::preset::Preset;
use super::scene_io::{self, SceneParts};
use crate::annotate::Annotations;
use crate::color::transfer::{Range, TransferFunction};
use crate::explore::SelectionSet;
use crate::explore::data::source_path;
use crate::look::{Attribute, Member, shown_families};
use crate::mode::economy::{PRESENCE, THINNING};
use crate::mode::{Mode, SettingValue};
use crate::model::{Bounds, FamilyName, PeriodicBox};
use crate::modes;
use crate::store::{Metadata, PageFile};
use crate::view::CutSettings;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;
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

    fn change_mode(&mut self, mode: &'static Mode) {
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

/// Makes a file that has arrived the open one, with the camera around all of it.
pub(crate) fn adopt_opened(
    mut commands: Commands,
    mut opened: MessageReader<Opened>,
    scene: Option<Res<Scene>>,
    picture: Res<Picture>,
    mut settings: ResMut<Settings>,
    mut choices: ResMut<Choices>,
    mut messages: ResMut<Messages>,
    mut parts: SceneParts,
    camera: Single<(Entity, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera), With<DataCamera>>,
) {
    let Some(Opened { path, members, notes, file, frame, scene: opened }) = opened.read().last().cloned() else {
        return;
    };
    let metadata = file.metadata();
    let bounds = metadata.bounds();
    let (entity, mut viewpoint, mut anchor, mut orbit) = camera.into_inner();
    // Who follows a selection goes on doing so, and is led to where it is now.
    let follows = scene.is_some() && settings.selections.iter().any(|set| set.follow);
    match home(frame, viewpoint.fov_y, &picture) {
        Ok(_) if follows => {}
        Ok(home) => {
            *viewpoint = home;
            *anchor = Anchor::adopt(&home, &mut orbit);
            commands.entity(entity).remove::<Flight>();
        }
        Err(error) => messages.error(format!("{}: {error}", path.display())),
    }
    choices.attributes = attribute_names(metadata);
    if let Attribute::Named(name) = &settings.attribute
        && !choices.attributes.contains(name)
    {
        settings.attribute = Attribute::Automatic;
    }
    if !settings.mode_chosen {
        settings.change_mode(modes::usual(choices.attributes.iter().map(String::as_str)));
    }
    let (shown, missing) = shown_families(&file, &members);
    settings.families = shown;
    settings.transfer.range = Range::Auto;
    if let Some(hue) = &mut settings.transfer.hue {
        hue.range = Range::Auto;
    }
    settings.cut = CutSettings::default();
    let camera = (entity, &mut *viewpoint, &mut *anchor, &mut *orbit);
    let attributes = &choices.attributes;
    let opened = opened.as_deref();
    scene_io::apply(opened, attributes, &mut settings, camera, &mut parts, &mut commands, &mut messages);
    let facts = Facts::of(&file, &members);
    let told = |family: FamilyName| format!("{}: the data has no particles of family {family}", path.display());
    notes.into_iter().chain(missing.into_iter().map(told)).for_each(|note| messages.error(note));
    messages.info(match members.len() {
        1 => format!("opened {}", path.display()),
        more => format!("opened {} with {} more", path.display(), more - 1),
    });
    let generation = scene.map_or(0, |scene| scene.generation) + 1;
    let length_unit = metadata.length_unit.to_string();
    let (file, periodic) = (Arc::clone(&file), metadata.periodic_box());
    commands.insert_resource(Scene { path, members, file, bounds, frame, periodic, length_unit, facts, generation });
}

/// The attributes of all families, each once: first those that only some have, then the quantities that all have.
fn attribute_names(metadata: &Metadata) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let attributes = metadata.families.iter().flat_map(|family| &family.attributes);
    let quantities = metadata.families.iter().flat_map(|family| &family.quantities);
    for attribute in attributes.chain(quantities) {
        if !names.contains(&attribute.name) {
            names.push(attribute.name.clone());
        }
    }
    names
}

/// The viewpoint that shows the whole dataset in the picture.
pub fn home(bounds: Bounds, fov_y: f64, picture: &Picture) -> Result<Viewpoint, crate::view::camera::ViewError> {
    let size = picture.size();
    let mut viewpoint = Viewpoint::around(bounds, fov_y, size.x, size.y)?;
    // The sphere around a box is larger than what one sees of the box.
    viewpoint.eye = viewpoint.target + 0.82 * (viewpoint.eye - viewpoint.target);
    Ok(viewpoint)
}
