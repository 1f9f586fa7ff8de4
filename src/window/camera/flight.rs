//! Flights: the camera glides to a place that was double-clicked, or home.

use super::{Anchor, Upright, Viewpoint};
use bevy::math::DVec3;
use bevy::prelude::*;
use bevy_panorbit_camera::PanOrbitCamera;

/// A flight under way; removed when it arrives. The direction of view is kept, the target moves on a straight line and
/// the distance changes geometrically, both eased.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Where it began.
    pub from: Viewpoint,
    /// Target at the end.
    pub target: DVec3,
    /// Distance from the target at the end, world units.
    pub distance_world: f64,
    /// The direction from the target to the eye at the end.
    pub back: DVec3,
    /// How long it takes, seconds.
    pub duration_secs: f64,
    /// Time since the start, seconds.
    pub elapsed_secs: f64,
}

impl Flight {
    /// A flight to `target`, ending `distance` away from it, looking in the same direction as now.
    pub fn to_place(from: Viewpoint, target: DVec3, distance: f64, duration_secs: f64) -> Flight {
        Flight { from, target, distance_world: distance, back: from.back(), duration_secs, elapsed_secs: 0.0 }
    }

    /// A flight to another viewpoint.
    pub fn to_viewpoint(from: Viewpoint, to: Viewpoint, duration_secs: f64) -> Flight {
        let (distance_world, back) = (to.distance(), to.back());
        Flight { from, target: to.target, distance_world, back, duration_secs, elapsed_secs: 0.0 }
    }

    /// Whether it has arrived.
    pub fn is_over(&self) -> bool {
        self.elapsed_secs >= self.duration_secs
    }

    /// The viewpoint at the present time, upright all the way.
    ///
    /// While the distance changes by a large factor, the target moves with the same geometric pace as the distance:
    /// the way that the target still has to go stays in proportion to the distance, so the place that was clicked
    /// never leaves the picture.
    pub fn viewpoint(&self, upright: Upright) -> Viewpoint {
        if self.is_over() {
            // The same to the last bit from wherever it came.
            let (yaw, pitch) = upright.angles(self.back);
            let (back, up) = upright.back_and_up(yaw, pitch);
            let eye = self.target + back * self.distance_world;
            return Viewpoint { eye, target: self.target, up, fov_y: self.from.fov_y };
        }
        let t = (self.elapsed_secs / self.duration_secs).clamp(0.0, 1.0);
        let eased = t * t * t * (t * (6.0 * t - 15.0) + 10.0);
        let ratio = self.distance_world / self.from.distance();
        let along = if (ratio - 1.0).abs() < 1e-3 { eased } else { (ratio.powf(eased) - 1.0) / (ratio - 1.0) };
        self.at(upright, eased, along)
    }

    /// The viewpoint `eased` of the way in angle and (geometric) distance, and `along` of the target's way.
    fn at(&self, upright: Upright, eased: f64, along: f64) -> Viewpoint {
        let start = self.from.distance();
        let distance = start * (self.distance_world / start).powf(eased);
        let target = self.from.target.lerp(self.target, along);
        let ((yaw, pitch), end) = (upright.angles(self.from.back()), upright.angles(self.back));
        let turn = (end.0 - yaw + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
        let (back, up) = upright.back_and_up(yaw + turn * eased, pitch + (end.1 - pitch) * eased);
        Viewpoint { eye: target + back * distance, target, up, fov_y: self.from.fov_y }
    }
}

/// Moves cameras that are on a flight, and hands them back to orbiting where they arrive.
pub(super) fn advance_flights(
    mut commands: Commands,
    time: Res<Time<Real>>,
    mut cameras: Query<(Entity, &mut Flight, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera)>,
) {
    for (camera, mut flight, mut viewpoint, mut anchor, mut orbit) in &mut cameras {
        flight.elapsed_secs += time.delta_secs_f64();
        *viewpoint = flight.viewpoint(anchor.upright);
        *anchor = anchor.adopt(&viewpoint, &mut orbit);
        if flight.is_over() {
            commands.entity(camera).remove::<Flight>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flight() -> Flight {
        let from = Viewpoint { eye: DVec3::new(0.0, 0.0, 1000.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.8 };
        Flight::to_place(from, DVec3::new(300.0, 100.0, -50.0), 2.0, 1.5)
    }

    #[test]
    fn it_starts_here_and_ends_there() {
        let mut flight = flight();
        let start = flight.viewpoint(Upright::Y);
        assert!(start.eye.distance(flight.from.eye) < 1e-9);
        flight.elapsed_secs = 1.5;
        let end = flight.viewpoint(Upright::Y);
        assert!(end.target.distance(flight.target) < 1e-9);
        assert!((end.distance() - 2.0).abs() < 1e-9);
        assert!((end.target - end.eye).normalize().distance(-DVec3::Z) < 1e-9, "the direction is kept");
    }

    #[test]
    fn the_place_stays_in_the_picture_all_the_way() {
        let mut flight = flight();
        for step in 0..=100 {
            flight.elapsed_secs = 0.015 * f64::from(step);
            let viewpoint = flight.viewpoint(Upright::Y);
            let view = viewpoint.view(1000, 1000).unwrap();
            let pixel = view.to_pixels(view.to_camera(flight.target)).unwrap();
            assert!(pixel.iter().all(|x| (0.0..1000.0).contains(x)), "step {step}: {pixel:?}");
        }
    }

    #[test]
    fn a_flight_of_no_duration_arrives_at_once() {
        let mut flight = flight();
        flight.duration_secs = 0.0;
        assert!(flight.is_over());
        assert!(flight.viewpoint(Upright::Y).target.distance(flight.target) < 1e-9);
    }
}
