//! The camera's way: where it goes, how smoothly, and the same way back.

use super::*;
use proptest::prelude::*;

const UP: DVec3 = DVec3::Y;

fn camera(eye: DVec3, target: DVec3) -> Camera {
    Camera { eye: eye.to_array(), target: target.to_array(), up: [0.0, 1.0, 0.0], fov: 45.0, ortho: None }
}

/// Knots a unit of time apart in uneven steps, each glided to.
fn knots(cameras: &[(Camera, f64, Move)]) -> Vec<Knot> {
    let (mut time, mut yaw) = (0.0, 0.0);
    let knot = |&(camera, after, motion): &(Camera, f64, Move)| {
        time += after;
        let pose = Pose::new(camera, UP, yaw);
        yaw = pose.yaw;
        Knot { arrive: time, leave: time, pose, motion, rest: false }
    };
    cameras.iter().map(knot).collect()
}

fn cameras() -> impl Strategy<Value = Vec<(Camera, f64, Move)>> {
    let one = (
        prop::array::uniform3(-5.0..5.0f64),
        -7.0..2.0f64,
        0.0..TAU,
        -1.5..1.5f64,
        0.2..3.0f64,
        prop_oneof![3 => Just(Move::Glide), 1 => Just(Move::Flight)],
    );
    prop::collection::vec(one, 2..6).prop_map(|all| {
        let build = |(target, ln_distance, azimuth, elevation, after, motion): ([f64; 3], f64, f64, f64, f64, Move)| {
            let direction =
                DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
            let target = DVec3::from(target);
            (camera(target + ln_distance.exp() * direction, target), after, motion)
        };
        all.into_iter().map(build).collect()
    })
}

/// How far two cameras are apart: of the point looked at and of the eye in units of the distance, and by angle.
fn apart(a: &Pose, b: &Pose) -> f64 {
    let scale = a.distance().min(b.distance());
    let eyes = DVec3::from(a.camera.eye).distance(DVec3::from(b.camera.eye));
    (a.focus().distance(b.focus()) + eyes) / scale + turn(a.orientation(UP), b.orientation(UP)).length()
}

proptest! {
    #[test]
    fn every_keyframe_is_passed_exactly(cameras in cameras()) {
        let knots = knots(&cameras);
        let path = Path::new(knots.clone(), UP, false);
        for knot in &knots {
            prop_assert_eq!(path.camera(knot.arrive), knot.pose.camera);
            // And approached: a moment before is a place near by.
            if knot.arrive > 0.0 {
                let near = apart(&path.pose(knot.arrive - 1e-9), &knot.pose);
                prop_assert!(near < 1e-4, "{near}");
            }
        }
    }

    /// The velocity just before a keyframe is the velocity just after it, and finite everywhere.
    #[test]
    fn velocity_is_continuous(cameras in cameras(), share in 0.0..1.0f64) {
        let knots = knots(&cameras);
        let path = Path::new(knots.clone(), UP, false);
        let e = 1e-8;
        let rates = |at: f64| {
            let (a, b) = (path.pose(at), path.pose(at + e));
            let d = a.distance();
            let turned = a.orientation(UP) * turn(a.orientation(UP), b.orientation(UP));
            (
                (b.focus() - a.focus()) / (e * d),
                (b.distance().ln() - d.ln()) / e,
                turned / e,
            )
        };
        let inner = knots[1..knots.len() - 1].iter().map(|knot| knot.arrive);
        for at in inner.chain([share * path.end()]) {
            let (before, after) = (rates(at - 1.5 * e), rates(at + 0.5 * e));
            let size = 1.0 + before.0.length() + before.1.abs() + before.2.length();
            let jump = (before.0 - after.0).length() + (before.1 - after.1).abs() + (before.2 - after.2).length();
            prop_assert!(jump.is_finite() && jump < 0.02 * size * size, "{jump} of {size} at {at}");
        }
    }

    #[test]
    fn the_way_back_is_the_same_way(cameras in cameras(), share in 0.0..1.0f64) {
        let there = knots(&cameras);
        let path = Path::new(there.clone(), UP, false);
        let end = path.end();
        let back: Vec<Knot> = (0..there.len()).rev().map(|i| {
            let [arrive, leave] = [end - there[i].leave, end - there[i].arrive];
            // The way to a knot was the way from it.
            let motion = there.get(i + 1).map_or(Move::Glide, |next| next.motion);
            Knot { arrive, leave, motion, ..there[i] }
        }).collect();
        let back = Path::new(back, UP, false);
        let time = share * end;
        let found = apart(&path.pose(time), &back.pose(end - time));
        prop_assert!(found < 1e-5, "{found}");
    }

    /// Keyframes that coincide, in place and in time, give cameras with finite numbers.
    #[test]
    fn coincident_keyframes_are_harmless(which in prop::collection::vec(0usize..2, 2..6), after in prop::collection::vec(prop_oneof![Just(0.0), Just(1.0)], 6), time in -1.0..8.0f64, flight in any::<bool>()) {
        let pool = [camera(DVec3::new(1.0, 0.0, 1.0), DVec3::ZERO), camera(DVec3::new(0.0, 5.0, 0.0), DVec3::ZERO)];
        // The second one looks straight down, along the direction that is up.
        let pool = [pool[0], Camera { up: [0.0, 0.0, -1.0], ..pool[1] }];
        let motion = if flight { Move::Flight } else { Move::Glide };
        let list: Vec<_> = which.iter().zip(&after).map(|(&i, &after)| (pool[i], after, motion)).collect();
        let camera = Path::new(knots(&list), UP, false).camera(time);
        let numbers = [camera.eye, camera.target, camera.up].concat();
        prop_assert!(numbers.iter().all(|x| x.is_finite()) && camera.view(64, 64).is_ok(), "{camera:?}");
    }
}

#[test]
fn nine_decades_keep_their_digits() {
    // From a world of 1e9 to a thing of size 1 in it, and an eye that is 1e-9 of the way from where it began.
    let target = DVec3::new(3e8, -2e8, 1e8);
    let list = [
        (camera(DVec3::new(0.0, 0.0, 1e9), DVec3::ZERO), 0.0, Move::Glide),
        (camera(target + DVec3::Z, target), 10.0, Move::Flight),
    ];
    let path = Path::new(knots(&list), UP, false);
    let mut before = path.pose(9.0);
    for step in 1..=1000 {
        let pose = path.pose(9.0 + 0.001 * f64::from(step));
        let off = pose.focus().distance(target) / pose.distance();
        assert!(off < 2.0 && pose.distance() <= before.distance(), "{off} {step}");
        before = pose;
    }
    assert_eq!(path.camera(10.0), list[1].0);
    let near = path.pose(10.0 - 1e-6);
    assert!(near.focus().distance(target) < 1e-6 * near.distance() && (near.distance() - 1.0).abs() < 1e-6);
}

#[test]
fn orbits_go_all_the_way_round_and_closed_ways_do_not_stop() {
    let start = Pose::new(camera(DVec3::new(0.0, 1.0, 4.0), DVec3::ZERO), UP, 0.0);
    let at = |time: f64, pose| Knot { arrive: time, leave: time, pose, motion: Move::Glide, rest: false };
    let third = |i: u32| at(f64::from(i), start.orbited(UP, f64::from(i) * TAU / 3.0));
    let closed = Path::new((0..4).map(third).collect(), UP, true);
    for step in 0..60 {
        let pose = closed.pose(0.05 * f64::from(step));
        assert!((pose.distance() - start.distance()).abs() < 1e-9);
        assert!((pose.yaw - 0.05 * f64::from(step) * TAU / 3.0).abs() < 1e-9, "{} at {step}", pose.yaw);
        assert!((pose.camera.eye[1] - 1.0).abs() < 1e-9, "the eye stays at its height");
    }
    let quarter = start.orbited(UP, 0.25 * TAU);
    assert!(quarter.camera.eye[0] > 3.9, "to the right: {:?}", quarter.camera.eye);
    // An open one begins and ends at rest.
    let open = Path::new((0..4).map(third).collect(), UP, false);
    assert!(open.pose(1e-4).yaw - open.pose(0.0).yaw < 1e-6);
}

#[test]
fn the_horizon_keeps_level() {
    let list = [
        (camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO), 0.0, Move::Glide),
        (camera(DVec3::new(3.0, 2.5, -1.0), DVec3::ZERO), 2.0, Move::Glide),
    ];
    let path = Path::new(knots(&list), UP, false);
    for step in 0..=20 {
        let camera = path.camera(0.1 * f64::from(step));
        let forward = DVec3::from(camera.target) - DVec3::from(camera.eye);
        assert!(forward.cross(DVec3::from(camera.up)).normalize().y.abs() < 1e-9);
    }
}
