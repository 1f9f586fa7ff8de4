//! Tours in the window: played, made from views and flights, and edited.
//!
//! The [`Clock`] says what time it is on the tour, [`Timeline::state`](crate::tour::Timeline::state) what is shown then; [`player`] puts that into the camera and the
//! settings, [`draft`] makes keyframes of what the user shows, [`look`] translates between both. [`ranges`] looks ahead, so that colours
//! have the ranges of a recording, and [`before`] draws what pictures blend from.

pub mod before;
pub mod clock;
pub mod draft;
pub mod look;
pub mod player;
pub mod ranges;

pub use before::Before;
pub use clock::Clock;
pub use player::{Asked, Player};
pub use ranges::Ranges;

use super::camera::CameraPlugin;
use crate::look::LookPatch;
use bevy::prelude::*;

/// What plays and edits tours. Its systems that change the camera and settings run where the window runs its own: [`player::play_tour`].
pub struct TouringPlugin {
    /// A tour to begin with.
    pub open: Option<std::path::PathBuf>,
    /// Its exposure and bloom, over what it says.
    pub light: LookPatch,
}

impl Plugin for TouringPlugin {
    fn build(&self, app: &mut App) {
        debug_assert!(app.is_plugin_added::<CameraPlugin>());
        let mut player = Player::default();
        if let Some(path) = &self.open {
            player.begin_with(path.clone(), self.light.clone());
        }
        app.insert_resource(player).init_resource::<ranges::Ranges>().init_resource::<Before>();
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use crate::look::Camera;
    use crate::model::Bounds;
    use crate::tour::{Keyframe, Surroundings, Timeline, TourFile};
    use bevy::math::DVec3;

    /// What a tour of tests is shown with.
    pub fn surroundings() -> Surroundings {
        let framed = Bounds { min: DVec3::ZERO, max: DVec3::splat(50.0) };
        Surroundings {
            file: "test".into(),
            text: String::new(),
            folder: "".into(),
            framed,
            aspect: 1.5,
            times: None,
            data: None,
        }
    }

    /// Three keyframes; at the second, a presenter is waited for.
    pub fn tour(repeats: bool) -> TourFile {
        let camera = |x: f64, z: f64| {
            Some(Camera { eye: [x, 30.0, z], target: [25.0; 3], up: [0.0, 1.0, 0.0], fov: 40.0, ortho: None })
        };
        let keyframe = |at, x, z| Keyframe { at: Some(at), camera: camera(x, z), ..Keyframe::default() };
        let mut tour = TourFile::new(vec![
            keyframe(0.0, 25.0, 140.0),
            Keyframe { hold: true, pause: 1.0, label: Some("halo".into()), ..keyframe(4.0, 90.0, 60.0) },
            keyframe(9.0, 27.0, 45.0),
        ]);
        tour.repeats = repeats;
        tour
    }

    pub fn timeline(repeats: bool) -> Timeline {
        Timeline::new(&tour(repeats), &surroundings()).unwrap()
    }
}
