//! The flight to what is double-clicked: a particle, or a place on a surface.

use super::seen::{InSight, Seen};
use crate::window::camera::{Anchor, Flight, Navigation, Viewpoint};
use crate::window::input::PointerOwner;
use crate::window::pick::NO_PLACES;
use crate::window::picture::{DataCamera, Picture};
use crate::window::preset::Preset;
use crate::window::state::notices::Notices;
use crate::window::statistics::ActiveBackend;
use bevy::prelude::*;

/// Where a double-click happened in this frame, in window coordinates; the panel's layout writes it.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct DoubleClick(pub Option<Vec2>);

/// Flies to what was double-clicked.
pub(super) fn approach(
    mut commands: Commands,
    mut click: ResMut<DoubleClick>,
    owner: Res<PointerOwner>,
    in_sight: InSight,
    picture: Res<Picture>,
    (backend, preset): (Res<ActiveBackend>, Res<Preset>),
    mut notices: ResMut<Notices>,
    camera: Single<(Entity, &Viewpoint, &mut Navigation), (With<DataCamera>, With<Anchor>)>,
) {
    let Some(at) = click.bypass_change_detection().0.take() else { return };
    if !owner.is_picture() {
        return;
    }
    if *backend == ActiveBackend::Surround {
        notices.info(NO_PLACES);
        return;
    }
    let (place, smoothing_length) = match in_sight.at(picture.pixel(at).as_dvec2().to_array()) {
        None => return,
        Some(Seen::Particle(picked)) => (picked.position, picked.smoothing_length),
        Some(Seen::Surface(place)) => (place, 0.0),
        Some(Seen::Nothing) => {
            notices.info("nothing under the cursor to fly to");
            return;
        }
    };
    let (entity, viewpoint, mut navigation) = camera.into_inner();
    *navigation = Navigation::Orbit;
    let distance = approach_distance(viewpoint.eye.distance(place), smoothing_length);
    let flight = Flight::to_place(*viewpoint, place, distance, preset.camera.flight_secs);
    commands.entity(entity).insert(flight);
}

/// How close a flight goes: to a fifth of the present distance, but not into the kernel of what was picked.
fn approach_distance(now: f64, smoothing_length: f64) -> f64 {
    (0.2 * now).max(3.0 * smoothing_length).min(now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_comes_closer_but_not_into_the_kernel() {
        assert_eq!(approach_distance(100.0, 0.1), 20.0);
        assert_eq!(approach_distance(100.0, 20.0), 60.0);
        assert_eq!(approach_distance(100.0, 500.0), 100.0);
    }
}
