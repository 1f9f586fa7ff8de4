//! Orbiting: the glue between the `f32` orbit camera and the `f64` viewpoint.

use super::{Navigation, Upright, Viewpoint};
use crate::window::input::PointerOwner;
use crate::window::preset::Preset;
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;

/// The frame that the orbit camera moves in: world = origin + unit * orbit coordinates, turned so that their +Y points up.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// World position of the orbit camera's origin.
    pub origin: DVec3,
    /// World length of one of its units.
    pub unit: f64,
    /// What points up in the world.
    pub upright: Upright,
}

impl Default for Anchor {
    fn default() -> Anchor {
        Anchor { origin: DVec3::ZERO, unit: 1.0, upright: Upright::default() }
    }
}

/// The anchor moves when the orbit radius leaves `1 / RADIUS_RANGE ..= RADIUS_RANGE` or the focus goes farther than
/// that from the origin: positions are then good to 16 * 2^-24, a millionth of the distance, and the step at the end of a
/// glide (the orbit camera snaps at a thousandth of a unit) stays below half a percent.
const RADIUS_RANGE: f32 = 4.0;

impl Anchor {
    /// World position of a point in orbit coordinates.
    pub fn world(&self, point: Vec3) -> DVec3 {
        self.origin + self.unit * self.upright.world(point.as_dvec3())
    }

    /// Orbit coordinates of a world position.
    pub fn local(&self, world: DVec3) -> Vec3 {
        (self.upright.local(world - self.origin) / self.unit).as_vec3()
    }

    /// Puts the orbit camera exactly where `viewpoint` is, with an anchor at its target; its motion stops.
    pub fn adopt(&self, viewpoint: &Viewpoint, orbit: &mut PanOrbitCamera) -> Anchor {
        let (yaw, pitch) = self.upright.angles(viewpoint.back());
        orbit.focus = Vec3::ZERO;
        orbit.target_focus = Vec3::ZERO;
        orbit.radius = Some(1.0);
        orbit.target_radius = 1.0;
        orbit.yaw = Some(yaw as f32);
        orbit.target_yaw = yaw as f32;
        orbit.pitch = Some(pitch as f32);
        orbit.target_pitch = pitch as f32;
        orbit.zoom_lower_limit = 1.0e-3;
        orbit.zoom_upper_limit = Some(1.0e3);
        orbit.initialized = true;
        orbit.force_update = true;
        Anchor { origin: viewpoint.target, unit: viewpoint.distance(), ..*self }
    }

    /// The viewpoint that the orbit camera stands for.
    fn viewpoint(&self, orbit: &PanOrbitCamera, fov_y: f64) -> Option<Viewpoint> {
        let (yaw, pitch, radius) = (orbit.yaw?, orbit.pitch?, orbit.radius?);
        let (back, up) = self.upright.back_and_up(f64::from(yaw), f64::from(pitch));
        let target = self.world(orbit.focus);
        Some(Viewpoint { eye: target + back * (self.unit * f64::from(radius)), target, up, fov_y })
    }

    /// The anchor moved to the orbit camera's focus and scaled by its radius, with the camera's numbers (and those it
    /// is gliding to) changed so that nothing moves in the world. `None` while the present anchor serves.
    fn moved(&self, orbit: &mut PanOrbitCamera) -> Option<Anchor> {
        let radius = orbit.radius?;
        let near = (1.0 / RADIUS_RANGE..=RADIUS_RANGE).contains(&radius) && orbit.focus.length() <= RADIUS_RANGE;
        if near || radius <= 0.0 || !radius.is_finite() {
            return None;
        }
        let focus = orbit.focus;
        orbit.focus = Vec3::ZERO;
        orbit.target_focus = (orbit.target_focus - focus) / radius;
        orbit.target_radius /= radius;
        orbit.radius = Some(1.0);
        Some(Anchor { origin: self.world(focus), unit: self.unit * f64::from(radius), ..*self })
    }
}

/// Gives the mouse to the orbit camera only while it navigates and the pointer is over the picture.
pub(super) fn switch_orbit_input(
    owner: Res<PointerOwner>,
    preset: Res<Preset>,
    mut cameras: Query<(&Navigation, Has<super::Flight>, &mut PanOrbitCamera)>,
) {
    for (navigation, in_flight, mut orbit) in &mut cameras {
        orbit.enabled = *navigation == Navigation::Orbit && !in_flight && owner.is_picture();
        let camera = &preset.camera;
        orbit.orbit_sensitivity = camera.orbit_sensitivity;
        orbit.pan_sensitivity = camera.orbit_sensitivity;
        orbit.zoom_sensitivity = camera.orbit_sensitivity;
        orbit.orbit_smoothness = camera.smoothness;
        orbit.pan_smoothness = 0.2 * camera.smoothness;
        orbit.zoom_smoothness = camera.smoothness;
    }
}

impl Viewpoint {
    /// Whether this differs from another viewpoint by no more than the orbit camera's `f32` does: angles are good to 1.2e-7. Where the
    /// orbit camera has not moved, a viewpoint that was opened or flown to stays exactly what it was.
    fn is_rounding_of(&self, other: &Viewpoint) -> bool {
        let reach = 4e-7 * other.distance();
        self.eye.distance(other.eye) <= reach
            && self.target.distance(other.target) <= reach
            && self.fov_y == other.fov_y
    }
}

/// Derives the viewpoint from the orbit camera while that one navigates.
pub(super) fn follow_orbit(
    mut cameras: Query<(&Navigation, Has<super::Flight>, &PanOrbitCamera, &Anchor, &mut Viewpoint)>,
) {
    for (navigation, in_flight, orbit, anchor, mut viewpoint) in &mut cameras {
        if *navigation != Navigation::Orbit || in_flight {
            continue;
        }
        if let Some(moved) = anchor.viewpoint(orbit, viewpoint.fov_y)
            && !moved.is_rounding_of(&viewpoint)
        {
            *viewpoint = moved;
        }
    }
}

/// Moves the anchor after the camera where `f32` would become coarse.
pub(super) fn move_anchor(mut cameras: Query<(&mut PanOrbitCamera, &mut Anchor)>) {
    for (mut orbit, mut anchor) in &mut cameras {
        if let Some(moved) = anchor.moved(orbit.bypass_change_detection()) {
            *anchor = moved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn viewpoint() -> Viewpoint {
        let target = DVec3::new(51_234.567_891, -3.25, 8.0e4);
        let (back, up) = Upright::Y.back_and_up(0.4, 0.3);
        Viewpoint { eye: target + back * 1.0e3, target, up, fov_y: 0.8 }
    }

    #[test]
    fn adopting_a_viewpoint_gives_it_back() {
        let mut orbit = PanOrbitCamera::default();
        let anchor = Anchor::default().adopt(&viewpoint(), &mut orbit);
        let back = anchor.viewpoint(&orbit, 0.8).unwrap();
        assert!(back.eye.distance(viewpoint().eye) < 1e-6 * viewpoint().distance());
        assert_eq!(back.target, viewpoint().target);
        assert!(back.is_rounding_of(&viewpoint()), "what is adopted stays as it was");
        orbit.yaw = Some(0.4 + 1e-6);
        assert!(!anchor.viewpoint(&orbit, 0.8).unwrap().is_rounding_of(&viewpoint()), "a motion is a motion");
    }

    #[test]
    fn zooming_a_billion_times_closer_keeps_the_view_sharp() {
        let mut orbit = PanOrbitCamera::default();
        let start = viewpoint();
        let mut anchor = Anchor::default().adopt(&start, &mut orbit);
        let mut moves = 0;
        for _ in 0..90 {
            let radius = orbit.radius.unwrap();
            orbit.radius = Some(radius * 0.8);
            orbit.target_radius = radius * 0.8;
            let before = anchor.viewpoint(&orbit, 0.8).unwrap();
            if let Some(moved) = anchor.moved(&mut orbit) {
                anchor = moved;
                moves += 1;
                let after = anchor.viewpoint(&orbit, 0.8).unwrap();
                assert!(before.eye.distance(after.eye) <= 1e-6 * before.distance());
            }
        }
        let end = anchor.viewpoint(&orbit, 0.8).unwrap();
        assert!(moves >= 6 && end.distance() < 1e-5);
        // A drag of a thousandth of the radius still moves the focus by that much, not by an ulp of the world.
        orbit.focus += Vec3::X * 1e-3 * orbit.radius.unwrap();
        let shifted = anchor.viewpoint(&orbit, 0.8).unwrap();
        let expected = 1e-3 * end.distance();
        assert!((shifted.target.distance(end.target) / expected - 1.0).abs() < 0.05);
    }

    #[test]
    fn a_billionth_of_the_box_away_a_particle_moves_by_what_the_mouse_says() {
        // A box of edge 50 and a particle in it; one looks at it from 5e-8 away.
        let particle = DVec3::new(29.163_67, 35.002_42, 27.363_99);
        let (back, up) = Upright::Y.back_and_up(0.7, -0.4);
        let start = Viewpoint { eye: particle + back * 50.0, target: particle, up, fov_y: 0.8 };
        let mut orbit = PanOrbitCamera::default();
        let mut anchor = Anchor::default().adopt(&start, &mut orbit);
        while anchor.viewpoint(&orbit, 0.8).unwrap().distance() > 5e-8 {
            orbit.radius = orbit.radius.map(|radius| radius * 0.9);
            anchor = anchor.moved(&mut orbit).unwrap_or(anchor);
        }
        let pixel = |viewpoint: Viewpoint| {
            let view = viewpoint.view(1280, 720).unwrap();
            view.to_pixels(view.to_camera(particle)).unwrap()
        };
        let (fov_y, step) = (0.8, 0.3);
        let view = anchor.viewpoint(&orbit, fov_y).unwrap().view(1280, 720).unwrap();
        let right = view.right.as_vec3() * (step / view.focal_pixels()) as f32;
        let mut last = pixel(anchor.viewpoint(&orbit, fov_y).unwrap());
        for frame in 0..400 {
            // Panned, as a drag does it: by a share of the radius.
            orbit.focus += right * orbit.radius.unwrap();
            anchor = anchor.moved(&mut orbit).unwrap_or(anchor);
            let now = pixel(anchor.viewpoint(&orbit, fov_y).unwrap());
            let moved = [last[0] - now[0], last[1] - now[1]];
            assert!((moved[0] - step).abs() < 0.02 && moved[1].abs() < 0.02, "frame {frame}: {moved:?}");
            last = now;
        }
    }
}
