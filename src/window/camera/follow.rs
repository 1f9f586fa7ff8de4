//! FollowedSelection: eye and target move along with a place, such as a selection's centre of mass, while the mouse goes on turning, shifting
//! and zooming the camera relative to it.
//!
//! What moves a little at a time is followed at once, so that it stays where it is in the picture. A jump, as from one snapshot to
//! another, is glided over.

use super::{Anchor, Flight, Navigation, Viewpoint};
use crate::window::preset::Preset;
use bevy::math::DVec3;
use bevy::prelude::*;

/// A step of more than this share of the viewing distance is a jump.
const JUMP: f64 = 0.05;

/// What cameras follow.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct Follow {
    /// Where it is now; `None` where nothing is followed.
    pub goal: Option<DVec3>,
    /// Edge of the periodic box whose images look alike; the way to the nearest one is taken then.
    pub edge: Option<f64>,
    /// Whether the camera is to fly to it and look at it first.
    pub approach: bool,
    /// Where it was in the frame before.
    last: Option<DVec3>,
    /// A jump that is being glided over.
    glide: Option<Glide>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Glide {
    by: DVec3,
    elapsed_secs: f64,
}

impl Follow {
    /// Takes what is followed from where the camera is: it does not move for what came before.
    pub fn settle(&mut self) {
        self.last = None;
        self.glide = None;
    }

    /// By how much the camera moves in a frame of `seconds`, seen from `distance`; jumps take `duration` seconds.
    fn step(&mut self, seconds: f64, distance: f64, duration: f64) -> DVec3 {
        let Some(goal) = self.goal else {
            self.settle();
            return DVec3::ZERO;
        };
        let last = self.last.replace(goal).unwrap_or(goal);
        let way = self.nearest(goal - last);
        let mut moved = DVec3::ZERO;
        if way.length() > JUMP * distance {
            // What is left of a jump before is part of the way.
            let left = self.glide.map_or(DVec3::ZERO, |glide| glide.by * (1.0 - eased(glide.elapsed_secs / duration)));
            self.glide = Some(Glide { by: left + way, elapsed_secs: 0.0 });
        } else {
            moved += way;
        }
        if let Some(glide) = &mut self.glide {
            let before = eased(glide.elapsed_secs / duration);
            glide.elapsed_secs += seconds;
            let now = eased(glide.elapsed_secs / duration);
            moved += glide.by * (now - before);
            if now >= 1.0 {
                self.glide = None;
            }
        }
        moved
    }

    /// The way to the nearest image.
    fn nearest(&self, way: DVec3) -> DVec3 {
        self.edge.map_or(way, |edge| way - edge * (way / edge).round())
    }
}

/// Share of the way after the share `t` of the time; what is no time at all is over.
fn eased(t: f64) -> f64 {
    match t {
        t if t >= 1.0 || t.is_nan() => 1.0,
        t => t * t * t * (t * (6.0 * t - 15.0) + 10.0),
    }
}

/// Moves the cameras along.
pub(super) fn follow_selection(
    mut commands: Commands,
    time: Res<Time<Real>>,
    preset: Res<Preset>,
    mut follow: ResMut<Follow>,
    mut cameras: Query<(Entity, &mut Viewpoint, &mut Anchor, &mut Navigation, Option<&mut Flight>)>,
) {
    let follow = follow.bypass_change_detection();
    for (camera, mut viewpoint, mut anchor, mut navigation, flight) in &mut cameras {
        let duration = preset.camera.flight_secs;
        if let Some(goal) = follow.goal.filter(|_| follow.approach) {
            follow.approach = false;
            follow.settle();
            follow.last = Some(goal);
            *navigation = Navigation::Orbit;
            let target = viewpoint.target + follow.nearest(goal - viewpoint.target);
            commands.entity(camera).insert(Flight::to_place(*viewpoint, target, viewpoint.distance(), duration));
            continue;
        }
        let moved = follow.step(time.delta_secs_f64(), viewpoint.distance(), duration);
        if moved == DVec3::ZERO {
            continue;
        }
        viewpoint.eye += moved;
        viewpoint.target += moved;
        anchor.origin += moved;
        if let Some(mut flight) = flight {
            flight.from.eye += moved;
            flight.from.target += moved;
            flight.target += moved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::orbit::{follow_orbit, move_anchor};
    use super::super::{Upright, flight::advance_flights};
    use super::*;
    use bevy_panorbit_camera::PanOrbitCamera;

    const FRAME_SECS: f64 = 1.0 / 60.0;

    fn following_app() -> (App, Entity) {
        let mut app = App::new();
        app.init_resource::<Time<Real>>()
            .insert_resource(Preset::default())
            .init_resource::<Follow>()
            .add_systems(Update, (follow_selection, advance_flights, follow_orbit, move_anchor).chain());
        let target = DVec3::new(10.0, 20.0, 30.0);
        let (back, up) = Upright::Y.back_and_up(0.6, 0.3);
        let start = Viewpoint { eye: target + back * 5.0, target, up, fov_y: 0.8 };
        let mut orbit = PanOrbitCamera::default();
        let anchor = Anchor::default().adopt(&start, &mut orbit);
        let camera = app.world_mut().spawn((start, anchor, Navigation::Orbit, orbit)).id();
        (app, camera)
    }

    fn go_on(app: &mut App, goal: Option<DVec3>) {
        app.world_mut().resource_mut::<Follow>().goal = goal;
        app.world_mut().resource_mut::<Time<Real>>().advance_by(std::time::Duration::from_secs_f64(FRAME_SECS));
        app.update();
    }

    fn seen(app: &App, camera: Entity) -> Viewpoint {
        *app.world().get::<Viewpoint>(camera).unwrap()
    }

    fn pixel(viewpoint: Viewpoint, place: DVec3) -> [f64; 2] {
        let view = viewpoint.view(1280, 720).unwrap();
        view.to_pixels(view.to_camera(place)).unwrap()
    }

    #[test]
    fn what_moves_stays_where_it_is_in_the_picture_while_the_user_turns_and_zooms() {
        let (mut app, camera) = following_app();
        // Beside the middle of the picture: following does not centre what is there already.
        let place = |frame: u32| {
            let t = f64::from(frame) * FRAME_SECS;
            DVec3::new(10.3, 20.2, 30.0) + DVec3::new(4.0 * t, (2.0 * t).sin(), -3.0 * t)
        };
        go_on(&mut app, Some(place(0)));
        let first = pixel(seen(&app, camera), place(0));
        for frame in 1..300 {
            go_on(&mut app, Some(place(frame)));
            let now = pixel(seen(&app, camera), place(frame));
            assert!((0..2).all(|axis| (now[axis] - first[axis]).abs() < 1.0), "frame {frame}: {now:?} for {first:?}");
        }
        // The user turns and zooms meanwhile; both stay, and are relative to what is followed.
        let before = seen(&app, camera);
        for frame in 300..400 {
            let mut orbit = app.world_mut().get_mut::<PanOrbitCamera>(camera).unwrap();
            orbit.yaw = orbit.yaw.map(|yaw| yaw + 0.01);
            orbit.radius = orbit.radius.map(|radius| radius * 0.99);
            go_on(&mut app, Some(place(frame)));
        }
        let after = seen(&app, camera);
        let moved = place(399) - place(299);
        assert!((after.target - before.target).distance(moved) < 1e-5, "{after:?}");
        assert!((Upright::Y.angles(after.back()).0 - Upright::Y.angles(before.back()).0 - 1.0).abs() < 1e-4);
        assert!((after.distance() / before.distance() / 0.99f64.powi(100) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn jumps_are_glided_over_and_end_where_they_should() {
        let (mut app, camera) = following_app();
        let (a, b, c) = (DVec3::new(10.0, 20.0, 30.0), DVec3::new(19.0, 20.0, 30.0), DVec3::new(19.0, 11.0, 30.0));
        go_on(&mut app, Some(a));
        let start = seen(&app, camera);
        let mut last = start;
        let mut frames = |app: &mut App, goal: DVec3, count: u32| {
            for _ in 0..count {
                go_on(app, Some(goal));
                let now = seen(app, camera);
                assert!(now.target.distance(last.target) < 1.0, "a jump of {}", now.target.distance(last.target));
                assert!((now.eye - now.target).distance(start.eye - start.target) < 1e-6);
                last = now;
            }
            last
        };
        // Another jump in the middle of the first.
        frames(&mut app, b, 20);
        let end = frames(&mut app, c, 400);
        assert!(end.target.distance(c) < 1e-9, "{end:?}");
        // Across the face of a periodic box that is drawn wrapped, the short way.
        app.world_mut().resource_mut::<Follow>().edge = Some(20.0);
        let end = frames(&mut app, DVec3::new(1.0, 11.0, 30.0), 400);
        assert!(end.target.distance(DVec3::new(21.0, 11.0, 30.0)) < 1e-9, "{end:?}");
        // Nothing is followed: nothing moves, and what is followed next is taken from there.
        go_on(&mut app, None);
        go_on(&mut app, Some(DVec3::ZERO));
        assert_eq!(seen(&app, camera).target, end.target);
    }

    #[test]
    fn it_is_flown_to_first_where_that_is_asked_for() {
        let (mut app, camera) = following_app();
        app.world_mut().resource_mut::<Follow>().approach = true;
        let goal = |frame: u32| DVec3::new(40.0 + 0.01 * f64::from(frame), -5.0, 0.0);
        for frame in 0..400 {
            go_on(&mut app, Some(goal(frame)));
        }
        let end = seen(&app, camera);
        assert!(end.target.distance(goal(399)) < 1e-4, "{end:?}");
        assert!((end.distance() - 5.0).abs() < 1e-3);
        assert!(app.world().get::<Flight>(camera).is_none());
    }
}
