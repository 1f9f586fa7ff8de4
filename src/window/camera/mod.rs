//! The camera of the window: an eye in double precision, moved by orbiting, flying or a flight to a place.
//!
//! The orbit camera of `bevy_panorbit_camera` works in `f32`. It moves in normalised units around an [`Anchor`] in
//! world space, which follows the camera: whenever the camera has come much closer to its target, gone much farther
//! from it, or wandered off, the anchor is moved to the target and scaled by the distance. So the rounding of `f32` is
//! always small against the viewing distance, at any place in the data.
//!
//! A selection is followed by moving eye, target and anchor along with it ([`Follow`]).
//!
//! Each frame: input moves [`PanOrbitCamera`](bevy_panorbit_camera::PanOrbitCamera), [`Fly`] or [`Flight`]; from the
//! one that is active [`Viewpoint`] is derived; [`Viewpoint::view`] gives the [`View`] that selection and drawing use.

mod flight;
mod fly;
mod follow;
mod ground;
mod lens;
mod orbit;

pub use flight::Flight;
pub use fly::{Fly, distance_to_boxes, fly_speed};
pub use follow::Follow;
pub use ground::Ground;
pub use lens::Lens;
pub use orbit::Anchor;

use crate::model::Bounds;
use crate::view::camera::ViewError;
use crate::view::{Projection, View};
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_egui::EguiPostUpdateSet;
use bevy_panorbit_camera::{PanOrbitCameraPlugin, PanOrbitCameraSystemSet};

/// Where the user looks from, in world units. The single source of truth for the picture's [`View`].
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Position.
    pub eye: DVec3,
    /// What the camera turns around.
    pub target: DVec3,
    /// Unit vector that points up in the picture.
    pub up: DVec3,
    /// Vertical field of view, radians.
    pub fov_y: f64,
}

impl Viewpoint {
    /// The whole box, from a little above its front.
    pub fn around(bounds: Bounds, fov_y: f64, width: u32, height: u32) -> Result<Viewpoint, ViewError> {
        let view = View::around(bounds, fov_y, width, height)?;
        Ok(Viewpoint { eye: view.eye, target: bounds.center(), up: view.up, fov_y })
    }

    /// Distance from the eye to the target, world units.
    pub fn distance(&self) -> f64 {
        self.eye.distance(self.target)
    }

    /// The view onto a picture of that many pixels.
    pub fn view(&self, width: u32, height: u32) -> Result<View, ViewError> {
        let projection = Projection::Perspective { fov_y: self.fov_y };
        View::look_at(self.eye, self.target, self.up, projection, width, height)
    }

    /// The direction from the target to the eye.
    pub fn back(&self) -> DVec3 {
        (self.eye - self.target).normalize_or(DVec3::Z)
    }
}

/// Which axis of the world points up while one turns around something: that of particles, volumes and images is y, that of heights z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Upright {
    /// +Y.
    #[default]
    Y,
    /// +Z; what is in front then is at -Y.
    Z,
}

impl Upright {
    /// A vector of a frame whose +Y points up, in the world.
    pub fn world(self, local: DVec3) -> DVec3 {
        match self {
            Upright::Y => local,
            Upright::Z => DVec3::new(local.x, -local.z, local.y),
        }
    }

    /// A vector of the world in a frame whose +Y points up.
    pub fn local(self, world: DVec3) -> DVec3 {
        match self {
            Upright::Y => world,
            Upright::Z => DVec3::new(world.x, world.z, -world.y),
        }
    }

    /// Yaw and pitch of the direction from a target to an eye, radians: yaw around the axis that points up, from the front towards +X,
    /// pitch from the horizontal plane upwards.
    pub fn angles(self, back: DVec3) -> (f64, f64) {
        let back = self.local(back);
        (back.x.atan2(back.z), back.y.clamp(-1.0, 1.0).asin())
    }

    /// The unit vector from target to eye for a yaw and pitch as in [`Upright::angles`], and the up vector that belongs
    /// to it (well defined at the poles too).
    fn back_and_up(self, yaw: f64, pitch: f64) -> (DVec3, DVec3) {
        let (sin_yaw, cos_yaw) = yaw.sin_cos();
        let (sin_pitch, cos_pitch) = pitch.sin_cos();
        let back = DVec3::new(cos_pitch * sin_yaw, sin_pitch, cos_pitch * cos_yaw);
        let up = DVec3::new(-sin_pitch * sin_yaw, cos_pitch, -sin_pitch * cos_yaw);
        (self.world(back), self.world(up))
    }
}

/// What moves the camera.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Navigation {
    /// The mouse turns, shifts and zooms around the target.
    #[default]
    Orbit,
    /// Keys move, the mouse looks around.
    Fly,
    /// A tour moves.
    Tour,
}

/// When the camera moves within a frame; all of it runs in `PostUpdate`.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum CameraSystems {
    /// Flying, flights and the orbit camera's switches, before the orbit camera moves.
    Steer,
    /// [`Viewpoint`] is derived; afterwards it holds for the frame.
    Settle,
}

/// Distance from the eye to the nearest data, world units; streaming writes it, flying reads it. `None` before
/// anything is loaded: then the distance to the target counts.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct DataDistance(pub Option<f64>);

/// Orbiting, flying and flights.
pub struct CameraPlugin;

impl Plugin for CameraPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(PanOrbitCameraPlugin)
            .init_resource::<DataDistance>()
            .init_resource::<Follow>()
            .init_resource::<Ground>()
            .configure_sets(
                PostUpdate,
                (
                    CameraSystems::Steer.after(EguiPostUpdateSet::ProcessOutput).before(PanOrbitCameraSystemSet),
                    CameraSystems::Settle.after(PanOrbitCameraSystemSet),
                ),
            )
            .add_systems(
                PostUpdate,
                (
                    (fly::steer_fly, follow::follow_selection, flight::advance_flights, orbit::switch_orbit_input)
                        .chain()
                        .in_set(CameraSystems::Steer),
                    (orbit::follow_orbit, ground::stay_above, orbit::move_anchor).chain().in_set(CameraSystems::Settle),
                ),
            );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_and_directions_are_inverse() {
        for upright in [Upright::Y, Upright::Z] {
            inverse(upright);
        }
    }

    fn inverse(upright: Upright) {
        for yaw in [-3.0, -1.2, 0.0, 0.7, 2.9] {
            for pitch in [-1.5, -0.4, 0.0, 0.9, 1.5] {
                let (back, up) = upright.back_and_up(yaw, pitch);
                let target = DVec3::new(3.0e5, -2.0, 7.0);
                let viewpoint = Viewpoint { eye: target + back * 12.0, target, up, fov_y: 0.8 };
                let (found_yaw, found_pitch) = upright.angles(viewpoint.back());
                assert!((found_yaw - yaw).abs() < 1e-9 && (found_pitch - pitch).abs() < 1e-8, "{yaw} {pitch}");
                assert!(back.dot(up).abs() < 1e-12 && (up.length() - 1.0).abs() < 1e-12);
                let view = viewpoint.view(640, 480).unwrap();
                assert!(view.up.abs_diff_eq(up, 1e-9), "up is kept at steep pitches");
            }
        }
    }

    #[test]
    fn straight_down_is_a_valid_view() {
        for upright in [Upright::Y, Upright::Z] {
            let (back, up) = upright.back_and_up(0.3, std::f64::consts::FRAC_PI_2);
            assert!(Viewpoint { eye: back, target: DVec3::ZERO, up, fov_y: 0.8 }.view(8, 8).is_ok());
        }
        assert!(Upright::Z.back_and_up(0.0, 0.0).0.abs_diff_eq(DVec3::NEG_Y, 1e-15), "in front of heights is -y");
    }
}
