//! Bookmarks: viewpoints on the number keys. Ctrl and a digit keeps the present one, the digit alone flies back to it.

use super::camera::{Flight, Navigation, Viewpoint};
use crate::look::Bookmark;
use crate::window::input::{PointerOwner, is_control};
use crate::window::picture::DataCamera;
use crate::window::preset::Preset;
use crate::window::scene::{Scene, Settings};
use crate::window::scene_io::{Bookmarks, camera_of, viewpoint_of};
use crate::window::state::notices::Notices;
use bevy::prelude::*;

/// The number keys, 0 first.
const DIGITS: [KeyCode; 10] = [
    KeyCode::Digit0,
    KeyCode::Digit1,
    KeyCode::Digit2,
    KeyCode::Digit3,
    KeyCode::Digit4,
    KeyCode::Digit5,
    KeyCode::Digit6,
    KeyCode::Digit7,
    KeyCode::Digit8,
    KeyCode::Digit9,
];

impl Bookmarks {
    /// The bookmark on a key.
    pub fn on(&self, key: u8) -> Option<&Bookmark> {
        self.0.iter().find(|bookmark| bookmark.key == key)
    }

    /// Puts a bookmark on its key, in the place of one that is there.
    pub fn keep(&mut self, bookmark: Bookmark) {
        self.0.retain(|other| other.key != bookmark.key);
        self.0.push(bookmark);
        self.0.sort_by_key(|bookmark| bookmark.key);
    }
}

/// A bookmark that a button of the panel asks for.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AskedBookmark(pub Option<BookmarkAction>);

/// What to do with the bookmark on a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BookmarkAction {
    /// Keep the present viewpoint there.
    Keep(u8),
    /// Fly to it.
    Visit(u8),
    /// Forget it.
    Forget(u8),
}

/// Carries out what the number keys and the panel ask for.
pub(super) fn run_bookmarks(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    owner: Res<PointerOwner>,
    preset: Res<Preset>,
    scene: Option<Res<Scene>>,
    mut settings: ResMut<Settings>,
    mut asked: ResMut<AskedBookmark>,
    mut bookmarks: ResMut<Bookmarks>,
    mut notices: ResMut<Notices>,
    camera: Single<(Entity, &Viewpoint, &mut Navigation), With<DataCamera>>,
) {
    let pressed = DIGITS.iter().position(|key| keys.just_pressed(*key)).filter(|_| owner.keyboard_is_free());
    let control = is_control(&keys);
    let on_key = |key: usize| if control { BookmarkAction::Keep(key as u8) } else { BookmarkAction::Visit(key as u8) };
    let asked = asked.bypass_change_detection().0.take();
    let Some(action) = asked.or(pressed.map(on_key)).filter(|_| scene.is_some()) else { return };
    let (entity, viewpoint, mut navigation) = camera.into_inner();
    match action {
        BookmarkAction::Keep(key) => {
            let name = bookmarks.on(key).map_or_else(String::new, |before| before.name.clone());
            bookmarks.keep(Bookmark { key, name, camera: camera_of(viewpoint, &settings.lens) });
            notices.info(format!("viewpoint kept on key {key}"));
        }
        BookmarkAction::Visit(key) => match bookmarks.on(key) {
            Some(bookmark) => {
                let (target, lens) = viewpoint_of(&bookmark.camera);
                if settings.lens != lens {
                    settings.lens = lens;
                }
                *navigation = Navigation::Orbit;
                let flight = Flight::to_viewpoint(*viewpoint, target, preset.camera.flight_secs);
                commands.entity(entity).insert(flight);
            }
            None => notices.info(format!("no viewpoint on key {key}: Ctrl+{key} keeps the present one there")),
        },
        BookmarkAction::Forget(key) => bookmarks.0.retain(|bookmark| bookmark.key != key),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::Camera;

    fn bookmark(key: u8, x: f64) -> Bookmark {
        let camera = Camera { eye: [x, 0.0, 1.0], target: [x, 0.0, 0.0], up: [0.0, 1.0, 0.0], fov: 40.0, ortho: None };
        Bookmark { key, name: String::new(), camera }
    }

    #[test]
    fn a_key_has_one_bookmark() {
        let mut bookmarks = Bookmarks::default();
        for (key, x) in [(7, 1.0), (2, 2.0), (7, 3.0)] {
            bookmarks.keep(bookmark(key, x));
        }
        assert_eq!(bookmarks.0.iter().map(|kept| kept.key).collect::<Vec<_>>(), [2, 7]);
        assert_eq!(bookmarks.on(7).unwrap().camera.eye[0], 3.0);
        assert_eq!(bookmarks.on(1), None);
    }
}
