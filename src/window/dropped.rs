//! Files that are dropped on the window: tours, catalogues and data, each opened as what it is.

use super::objects::{Objects, may_be_catalogue};
use super::open::Openings;
use super::options::OpenRequest;
use super::scene::Scene;
use super::touring::{Asked, Player};
use crate::look::is_scene_file;
use crate::tour::TourFile;
use bevy::prelude::*;
use std::path::Path;

/// Whether a file is RON that reads as a tour.
fn is_tour(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "ron") && !is_scene_file(path) && TourFile::read(path).is_ok()
}

/// Starts to open files that are dropped on the window: in the place of what is open, or with it where the user wants that.
pub(super) fn open_dropped_files(
    mut dropped: MessageReader<FileDragAndDrop>,
    keys: Res<ButtonInput<KeyCode>>,
    scene: Option<Res<Scene>>,
    mut openings: ResMut<Openings>,
    mut objects: ResMut<Objects>,
    mut player: ResMut<Player>,
) {
    for event in dropped.read() {
        if let FileDragAndDrop::DroppedFile { path_buf, .. } = event {
            if is_tour(path_buf) {
                player.ask(Asked::Open(path_buf.clone()));
                continue;
            }
            let mut request = OpenRequest::of(path_buf);
            let adds = openings.adds_dropped || keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
            if let Some(scene) = scene.as_ref().filter(|_| adds && !is_scene_file(path_buf)) {
                request.members.splice(0..0, scene.members.iter().cloned());
            }
            match may_be_catalogue(path_buf) {
                true => objects.consider(path_buf.clone(), request),
                false => openings.start(request),
            }
        }
    }
}
