//! What is open, and how the user wants to see it.

use super::camera::{Anchor, Flight, Viewpoint};
use super::facts::Facts;
use super::messages::Messages;
use super::open::Opened;
use super::panel::Choices;
use super::picture::{DataCamera, Picture};
use super::preset::Preset;
use crate::model::Bounds;
use crate::store::{Metadata, PageFile};
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;
use std::path::PathBuf;
use std::sync::Arc;

/// The open dataset.
#[derive(Resource)]
pub struct Scene {
    /// What the user named.
    pub path: PathBuf,
    /// Its page file.
    pub file: Arc<PageFile>,
    /// The box around all families, world units.
    pub bounds: Bounds,
    /// Unit of positions.
    pub length_unit: String,
    /// What the panel says about it.
    pub facts: Facts,
    /// Counts up with every file that is opened; what belongs to another generation is stale.
    pub generation: u32,
}

/// How the user wants to see the data: everything that the panel edits.
#[derive(Resource, Clone, Debug, PartialEq)]
pub struct Settings {
    /// The mode's name.
    pub mode: String,
    /// The attribute that gives the hue.
    pub attribute: Option<String>,
    /// The colour map's name.
    pub color_map: String,
    /// The range of `P` from dark to bright; automatic where it is `None`.
    pub brightness: Option<[f64; 2]>,
    /// The range of `S` over the hues; automatic where it is `None`.
    pub hue: Option<[f64; 2]>,
    /// The screen-space error `tau`, pixels.
    pub error_px: f64,
    /// Whether each family is drawn, in the order of the file's families.
    pub families: Vec<bool>,
}

impl Settings {
    /// The settings before anything is open.
    pub fn new(preset: &Preset, mode: Option<&str>) -> Settings {
        Settings {
            mode: mode.unwrap_or("density-squared").to_owned(),
            attribute: None,
            color_map: "inferno".to_owned(),
            brightness: None,
            hue: None,
            error_px: preset.drawing.error_px,
            families: Vec::new(),
        }
    }
}

/// Makes a file that has arrived the open one, with the camera around all of it.
pub(super) fn adopt_opened(
    mut commands: Commands,
    mut opened: MessageReader<Opened>,
    scene: Option<Res<Scene>>,
    picture: Res<Picture>,
    mut settings: ResMut<Settings>,
    mut choices: ResMut<Choices>,
    mut messages: ResMut<Messages>,
    camera: Single<(Entity, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera), With<DataCamera>>,
) {
    let Some(Opened { path, file }) = opened.read().last().cloned() else { return };
    let metadata = file.metadata();
    let bounds = metadata.bounds();
    let (entity, mut viewpoint, mut anchor, mut orbit) = camera.into_inner();
    match home(bounds, viewpoint.fov_y, &picture) {
        Ok(home) => {
            *viewpoint = home;
            *anchor = Anchor::adopt(&home, &mut orbit);
            commands.entity(entity).remove::<Flight>();
        }
        Err(error) => messages.error(format!("{}: {error}", path.display())),
    }
    choices.attributes = attribute_names(metadata);
    if settings.attribute.as_ref().is_some_and(|name| !choices.attributes.contains(name)) {
        settings.attribute = None;
    }
    settings.families = vec![true; metadata.families.len()];
    settings.brightness = None;
    settings.hue = None;
    let facts = Facts::of(metadata);
    messages.info(format!("opened {}", path.display()));
    let generation = scene.map_or(0, |scene| scene.generation) + 1;
    let length_unit = metadata.length_unit.to_string();
    commands.insert_resource(Scene { path, file: Arc::clone(&file), bounds, length_unit, facts, generation });
}

/// The attributes of all families, each once, in the order in which they come.
fn attribute_names(metadata: &Metadata) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for attribute in metadata.families.iter().flat_map(|family| &family.attributes) {
        if !names.contains(&attribute.name) {
            names.push(attribute.name.clone());
        }
    }
    names
}

/// The viewpoint that shows the whole dataset in the picture.
pub fn home(bounds: Bounds, fov_y: f64, picture: &Picture) -> Result<Viewpoint, crate::view::camera::ViewError> {
    let size = picture.size();
    Viewpoint::around(bounds, fov_y, size.x, size.y)
}
