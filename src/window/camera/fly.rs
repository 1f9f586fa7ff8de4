//! Flying: keys move the eye, the mouse turns it, and the speed follows the distance to the data.

use super::{Anchor, DataDistance, Navigation, Viewpoint};
use crate::model::Bounds;
use crate::window::input::PointerOwner;
use crate::window::preset::Preset;
use bevy::input::mouse::AccumulatedMouseMotion;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;

/// How fast a flying eye moves; the velocity follows the keys within a few tenths of a second.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Fly {
    /// Present velocity, in units of the cruising speed, in camera axes (right, up, forward).
    pub velocity: DVec3,
}

/// Time in which the velocity covers 63 % of the way to what the keys ask for, seconds.
const RESPONSE_SECS: f64 = 0.12;
/// How long the frame in which it begins to move lasts at most, seconds.
const FIRST_SECS: f64 = 1.0 / 60.0;
/// Factor on the speed while Shift is held.
const FAST: f64 = 4.0;
/// Factor on the speed while Ctrl is held.
const SLOW: f64 = 0.2;

/// Cruising speed in world units a second, `distance` away from the data: `share` of that distance each second. So one
/// approaches exponentially, never runs into the data, and the pace on screen feels alike from a galaxy to a planet.
pub fn fly_speed(distance: f64, share: f64) -> f64 {
    distance.max(0.0) * share
}

/// Distance from the eye to the nearest of some boxes, world units. Inside a box, where the distance to it is zero,
/// a quarter of its diagonal counts: data of that extent is around. `None` without a box.
pub fn distance_to_boxes(eye: DVec3, boxes: impl IntoIterator<Item = Bounds>) -> Option<f64> {
    boxes
        .into_iter()
        .filter(|bounds| !bounds.is_empty())
        .map(|bounds| {
            let outside = eye.distance(eye.clamp(bounds.min, bounds.max));
            outside.max(0.25 * bounds.size().length())
        })
        .min_by(f64::total_cmp)
}

/// The direction that the keys ask for, in camera axes (right, up, forward); length at most 1.
fn wanted_direction(keys: &ButtonInput<KeyCode>) -> DVec3 {
    let axis = |plus: KeyCode, minus: KeyCode| f64::from(keys.pressed(plus)) - f64::from(keys.pressed(minus));
    DVec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyW, KeyCode::KeyS),
    )
    .clamp_length_max(1.0)
}

/// Moves and turns the camera while it flies. The target stays ahead of the eye at the distance of the data, so that
/// switching back to orbiting turns around what is in the middle of the picture.
pub(super) fn steer_fly(
    time: Res<Time<Real>>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    owner: Res<PointerOwner>,
    preset: Res<Preset>,
    distance: Res<DataDistance>,
    mut cameras: Query<(&Navigation, &mut Fly, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera)>,
) {
    // A stalled frame must not throw the eye through the data.
    let seconds = time.delta_secs_f64().min(0.1);
    for (navigation, mut fly, mut viewpoint, mut anchor, mut orbit) in &mut cameras {
        if *navigation != Navigation::Fly {
            continue;
        }
        // Turn.
        let (mut yaw, mut pitch) = anchor.upright.angles(viewpoint.back());
        let look = owner.is_picture() && (buttons.pressed(MouseButton::Left) || buttons.pressed(MouseButton::Right));
        let turn = if look { motion.delta.as_dvec2() } else { bevy::math::DVec2::ZERO };
        let radians_per_pixel = preset.camera.look_sensitivity.to_radians();
        yaw -= turn.x * radians_per_pixel;
        pitch = (pitch + turn.y * radians_per_pixel).clamp(-1.56, 1.56);
        let (back, up) = anchor.upright.back_and_up(yaw, pitch);
        let forward = -back;
        // Move.
        let wanted = if owner.keyboard_is_free() { wanted_direction(&keys) } else { DVec3::ZERO };
        // A key that ends a pause asks for no motion during it.
        let seconds = if fly.velocity == DVec3::ZERO { seconds.min(FIRST_SECS) } else { seconds };
        let follow = 1.0 - (-seconds / RESPONSE_SECS).exp();
        let velocity = fly.velocity + (wanted - fly.velocity) * follow;
        fly.velocity = if wanted == DVec3::ZERO && velocity.length() < 1e-3 { DVec3::ZERO } else { velocity };
        if fly.velocity == DVec3::ZERO && turn == bevy::math::DVec2::ZERO {
            continue;
        }
        let ahead = distance.0.unwrap_or_else(|| viewpoint.distance());
        let pace = match () {
            () if keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]) => FAST,
            () if keys.any_pressed([KeyCode::ControlLeft, KeyCode::ControlRight]) => SLOW,
            () => 1.0,
        };
        let speed = pace * fly_speed(ahead, preset.camera.fly_speed);
        let right = forward.cross(up);
        let step = right * fly.velocity.x + up * fly.velocity.y + forward * fly.velocity.z;
        let eye = viewpoint.eye + step * (speed * seconds);
        // A target closer than an ulp of the eye's coordinates would give no direction.
        let reach = ahead.max(1e-12 * eye.abs().max_element()).max(f64::MIN_POSITIVE * 1e30);
        *viewpoint = Viewpoint { eye, target: eye + forward * reach, up, fov_y: viewpoint.fov_y };
        *anchor = anchor.adopt(&viewpoint, &mut orbit);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Upright;
    use super::*;

    #[test]
    fn speed_is_proportional_to_the_distance() {
        assert_eq!(fly_speed(100.0, 0.5), 50.0);
        assert_eq!(fly_speed(-1.0, 0.5), 0.0);
    }

    #[test]
    fn distance_is_to_the_nearest_box_and_never_zero_inside() {
        let unit = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        let far = Bounds { min: DVec3::splat(50.0), max: DVec3::splat(51.0) };
        assert_eq!(distance_to_boxes(DVec3::new(0.5, 0.5, 11.0), [far, unit]), Some(10.0));
        let inside = distance_to_boxes(DVec3::splat(0.5), [unit]).unwrap();
        assert!((inside - 0.25 * 3f64.sqrt()).abs() < 1e-12);
        assert_eq!(distance_to_boxes(DVec3::ZERO, []), None);
        assert_eq!(distance_to_boxes(DVec3::ZERO, [Bounds::EMPTY]), None);
    }

    #[test]
    fn opposite_keys_cancel_and_diagonals_are_not_faster() {
        let mut keys = ButtonInput::default();
        keys.press(KeyCode::KeyW);
        keys.press(KeyCode::KeyD);
        assert!((wanted_direction(&keys).length() - 1.0).abs() < 1e-12);
        keys.press(KeyCode::KeyA);
        assert_eq!(wanted_direction(&keys), DVec3::Z);
    }

    fn flying_app(distance: f64) -> (App, Entity) {
        let mut app = App::new();
        app.init_resource::<Time<Real>>()
            .init_resource::<ButtonInput<KeyCode>>()
            .init_resource::<ButtonInput<MouseButton>>()
            .init_resource::<AccumulatedMouseMotion>()
            .insert_resource(PointerOwner::default())
            .insert_resource(Preset::default())
            .insert_resource(DataDistance(Some(distance)))
            .add_systems(Update, steer_fly);
        let start = Viewpoint { eye: DVec3::Z * distance, target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.8 };
        let mut orbit = PanOrbitCamera::default();
        let anchor = Anchor::default().adopt(&start, &mut orbit);
        let camera = app.world_mut().spawn((Navigation::Fly, Fly::default(), start, anchor, orbit)).id();
        (app, camera)
    }

    fn fly_for_a_second(distance: f64) -> f64 {
        let (mut app, camera) = flying_app(distance);
        app.world_mut().resource_mut::<ButtonInput<KeyCode>>().press(KeyCode::KeyW);
        for _ in 0..61 {
            app.world_mut().resource_mut::<Time<Real>>().advance_by(std::time::Duration::from_secs_f64(1.0 / 60.0));
            app.update();
        }
        distance - app.world().get::<Viewpoint>(camera).unwrap().eye.z
    }

    #[test]
    fn flying_covers_a_share_of_the_distance_at_any_scale() {
        let near = fly_for_a_second(1.0);
        let far = fly_for_a_second(1.0e9) / 1.0e9;
        assert!((near - far).abs() < 1e-6, "{near} {far}");
        // 0.6 of the distance a second, less the time to get going.
        assert!((0.45..0.62).contains(&near), "{near}");
    }

    #[test]
    fn looking_turns_on_the_spot_and_keeps_the_orbit_camera_in_step() {
        let (mut app, camera) = flying_app(10.0);
        app.world_mut().resource_mut::<ButtonInput<MouseButton>>().press(MouseButton::Left);
        app.world_mut().resource_mut::<AccumulatedMouseMotion>().delta = Vec2::new(100.0, 0.0);
        app.update();
        let viewpoint = *app.world().get::<Viewpoint>(camera).unwrap();
        assert!(viewpoint.eye.distance(DVec3::Z * 10.0) < 1e-12);
        let turned = (viewpoint.target - viewpoint.eye).normalize().angle_between(-DVec3::Z).to_degrees();
        assert!((turned - 15.0).abs() < 1e-6, "100 px at 0.15 degrees each: {turned}");
        assert!(viewpoint.target.x > 0.0, "the mouse to the right looks to the right");
        let orbit = app.world().get::<PanOrbitCamera>(camera).unwrap();
        assert!((f64::from(orbit.yaw.unwrap()) - Upright::Y.angles(viewpoint.back()).0).abs() < 1e-6);
    }
}
