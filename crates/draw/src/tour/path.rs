//! The camera's way through the keyframes: a point looked at, a distance on a logarithmic scale and an orientation, each a curve
//! with continuous velocity.
//!
//! An orientation is a turn about the direction that is up (so that orbits go round and the horizon keeps level) and what remains, a
//! quaternion. Keyframes are passed without stopping unless they have a pause or ask for rest; flights
//! ([`ZoomPan`]) begin and end at rest.

use super::file::Move;
use super::spline::{cubic, orientation, turn, velocity, velocity_of_number};
use super::zoom_pan::ZoomPan;
use crate::look::Camera;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::TAU;

/// A camera as the path sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The camera itself.
    pub camera: Camera,
    /// The turn about the direction that is up, radians; counts full turns.
    pub yaw: f64,
    /// What remains of the orientation.
    rest: DQuat,
}

/// Nearer to the direction that is up than this cosine says, a turn about it means nothing.
const POLE: f64 = 0.985;

impl Pose {
    /// A camera that sees something, for the direction that is up; its turn is the one nearest to `yaw`.
    pub fn new(camera: Camera, up: DVec3, yaw: f64) -> Pose {
        let upright = DQuat::from_rotation_arc(DVec3::Y, up.normalize_or(DVec3::Y));
        let [eye, target, above] = [camera.eye, camera.target, camera.up].map(DVec3::from);
        let forward = (target - eye).normalize_or(DVec3::NEG_Z);
        let right = forward.cross(above).normalize_or(forward.any_orthonormal_vector());
        let whole = DQuat::from_mat3(&DMat3::from_cols(right, right.cross(forward), -forward));
        let local = upright.conjugate() * whole;
        let ahead = local * DVec3::NEG_Z;
        let own = if ahead.y.abs() < POLE { (-ahead.x).atan2(-ahead.z) } else { yaw };
        let yaw = own + TAU * ((yaw - own) / TAU).round();
        Pose { camera, yaw, rest: (DQuat::from_rotation_y(-yaw) * local).normalize() }
    }

    /// The same camera gone round what it looks at, to the right, by an angle in radians.
    pub fn orbited(&self, up: DVec3, angle: f64) -> Pose {
        let yaw = self.yaw + angle;
        let up = up.normalize_or(DVec3::Y);
        Pose { camera: self.camera_at(up, self.focus(), self.distance(), yaw, self.rest), yaw, rest: self.rest }
    }

    /// The same somewhere else.
    pub fn moved(&self, by: DVec3) -> Pose {
        let moved = |at: [f64; 3]| (DVec3::from(at) + by).to_array();
        let Camera { eye, target, .. } = self.camera;
        Pose { camera: Camera { eye: moved(eye), target: moved(target), ..self.camera }, ..*self }
    }

    /// The point looked at.
    pub fn focus(&self) -> DVec3 {
        DVec3::from(self.camera.target)
    }

    /// How far that is away.
    pub fn distance(&self) -> f64 {
        self.focus().distance(DVec3::from(self.camera.eye)).max(f64::MIN_POSITIVE)
    }

    /// The height of what is in view there, world units.
    pub fn width(&self) -> f64 {
        self.camera.ortho.unwrap_or(2.0 * self.distance() * (0.5 * self.camera.fov.to_radians()).tan())
    }

    /// The orientation: from right, up and backward to the world.
    pub fn orientation(&self, up: DVec3) -> DQuat {
        whole(up, self.yaw, self.rest)
    }

    fn camera_at(&self, up: DVec3, focus: DVec3, distance: f64, yaw: f64, rest: DQuat) -> Camera {
        let q = whole(up, yaw, rest);
        let eye = focus + distance * (q * DVec3::Z);
        Camera { eye: eye.to_array(), target: focus.to_array(), up: (q * DVec3::Y).to_array(), ..self.camera }
    }
}

fn whole(up: DVec3, yaw: f64, rest: DQuat) -> DQuat {
    DQuat::from_rotation_arc(DVec3::Y, up.normalize_or(DVec3::Y)) * DQuat::from_rotation_y(yaw) * rest
}

/// A keyframe of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// When it is reached, seconds.
    pub arrive: f64,
    /// When it is left.
    pub leave: f64,
    /// Where the camera stands.
    pub pose: Pose,
    /// How the camera comes here.
    pub motion: Move,
    /// Whether it comes to rest here in any case.
    pub rest: bool,
}

/// Velocities at a knot, per second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Speed {
    focus: DVec3,
    ln_distance: f64,
    yaw: f64,
    fov: f64,
    ln_ortho: f64,
    turn: DVec3,
}

/// The camera's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    up: DVec3,
    knots: Vec<Knot>,
    speeds: Vec<Speed>,
}

/// Share of a flight's time in which it gathers speed, and in which it loses it.
const RAMP: f64 = 0.3;

/// The share of a flight's way at a share of its time: its speed rises evenly, stays, and falls.
fn flown(u: f64) -> f64 {
    let top = 1.0 / (1.0 - RAMP);
    match u {
        u if u < RAMP => 0.5 * top * u * u / RAMP,
        u if u <= 1.0 - RAMP => top * (u - 0.5 * RAMP),
        u => 1.0 - 0.5 * top * (1.0 - u) * (1.0 - u) / RAMP,
    }
}

impl Path {
    /// The way through knots in the order of their times; one or more. A closed way goes on at its beginning without a stop where
    /// the last knot is the first one again.
    pub fn new(knots: Vec<Knot>, up: DVec3, closed: bool) -> Path {
        let speeds = (0..knots.len()).map(|index| speed(&knots, index, closed)).collect();
        Path { up, knots, speeds }
    }

    /// When it ends, seconds.
    pub fn end(&self) -> f64 {
        self.knots.last().map_or(0.0, |knot| knot.leave)
    }

    /// The number of the last knot that is reached at a time; the first one before it.
    pub fn index(&self, time: f64) -> usize {
        self.knots.partition_point(|knot| knot.arrive <= time).saturating_sub(1)
    }

    /// The camera at a time: the keyframe's own while it stays there.
    pub fn camera(&self, time: f64) -> Camera {
        self.pose(time).camera
    }

    /// The camera at a time, with its turn.
    pub fn pose(&self, time: f64) -> Pose {
        let index = self.index(time);
        let from = &self.knots[index];
        let Some(to) = self.knots.get(index + 1) else { return from.pose };
        let h = to.arrive - from.leave;
        // A NaN stays where it is.
        if !(time > from.leave && h > 0.0) || to.motion == Move::Cut {
            return from.pose;
        }
        let u = (time - from.leave) / h;
        let (a, b) = (&from.pose, &to.pose);
        match to.motion {
            Move::Flight => self.flight(a, b, flown(u)),
            _ => self.glide(a, b, [&self.speeds[index], &self.speeds[index + 1]], h, u),
        }
    }

    fn glide(&self, a: &Pose, b: &Pose, [va, vb]: [&Speed; 2], h: f64, u: f64) -> Pose {
        let number = |values, speeds| cubic::<f64>(values, speeds, h, u);
        let ln_distance = [a.distance().ln(), b.distance().ln()];
        let ln_distance = number(ln_distance, [va.ln_distance, vb.ln_distance]);
        let yaw = number([a.yaw, b.yaw], [va.yaw, vb.yaw]);
        let focus = cubic([a.focus(), b.focus()], [va.focus, vb.focus], h, u);
        let rest = orientation([a.rest, b.rest], [va.turn, vb.turn], h, u);
        let camera = Camera {
            fov: number([a.camera.fov, b.camera.fov], [va.fov, vb.fov]),
            ortho: match (a.camera.ortho, b.camera.ortho) {
                (Some(first), Some(last)) => Some(number([first.ln(), last.ln()], [va.ln_ortho, vb.ln_ortho]).exp()),
                (kind, _) => kind,
            },
            ..a.camera_at(self.up, focus, ln_distance.exp(), yaw, rest)
        };
        Pose { camera, yaw, rest }
    }

    fn flight(&self, a: &Pose, b: &Pose, share: f64) -> Pose {
        let way = ZoomPan::new(a.focus().distance(b.focus()), [a.width(), b.width()]);
        let [gone, width] = way.at(share);
        // Counted from the nearer end, where the scale may be small.
        let across = b.focus() - a.focus();
        let focus = if gone <= 0.5 { a.focus() + across * gone } else { b.focus() - across * way.left(share) };
        let fov = a.camera.fov + (b.camera.fov - a.camera.fov) * share;
        let (ortho, distance) = match a.camera.ortho {
            Some(_) => (Some(width), (a.distance().ln() * (1.0 - share) + b.distance().ln() * share).exp()),
            None => (None, width / (2.0 * (0.5 * fov.to_radians()).tan())),
        };
        let yaw = a.yaw + (b.yaw - a.yaw) * share;
        let rest = orientation([a.rest, b.rest], [turn(a.rest, b.rest); 2], 1.0, share);
        let camera = Camera { fov, ortho, ..a.camera_at(self.up, focus, distance, yaw, rest) };
        Pose { camera, yaw, rest }
    }
}

/// The velocities at a knot: none where the camera rests.
fn speed(knots: &[Knot], index: usize, closed: bool) -> Speed {
    let last = knots.len() - 1;
    let knot = &knots[index];
    let is_seam = closed && last > 1 && (index == 0 || index == last) && meets(&knots[last], &knots[0]);
    let (before, here, after) = match index {
        _ if is_seam => (&knots[last - 1], &knots[last], &knots[1]),
        0 => return Speed::default(),
        _ if index == last => return Speed::default(),
        _ => (&knots[index - 1], knot, &knots[index + 1]),
    };
    let rests = |knot: &Knot| knot.rest || knot.leave > knot.arrive;
    let is_moving = here.motion == Move::Glide && after.motion == Move::Glide;
    if !is_moving || rests(knot) || is_seam && (rests(&knots[0]) || rests(&knots[last])) {
        return Speed::default();
    }
    // At the seam of a closed way the knot before lies in the round before, and turns are counted from there.
    let next = if is_seam { &knots[0] } else { here };
    let h = [here.arrive - before.leave, after.arrive - next.leave];
    if !(h[0] > 0.0 && h[1] > 0.0) {
        return Speed::default();
    }
    let number = |value: fn(&Pose) -> f64| {
        let slope = |from: &Knot, to: &Knot, h: f64| (value(&to.pose) - value(&from.pose)) / h;
        velocity_of_number(slope(before, here, h[0]), slope(next, after, h[1]), h)
    };
    let moved = |from: &Knot, to: &Knot, h: f64| (to.pose.focus() - from.pose.focus()) / h;
    let turned = |from: &Knot, to: &Knot, h: f64| turn(from.pose.rest, to.pose.rest) / h;
    Speed {
        focus: velocity(moved(before, here, h[0]), moved(next, after, h[1]), h),
        ln_distance: number(|pose| pose.distance().ln()),
        yaw: number(|pose| pose.yaw),
        fov: number(|pose| pose.camera.fov),
        ln_ortho: number(|pose| pose.camera.ortho.map_or(0.0, f64::ln)),
        turn: velocity(turned(before, here, h[0]), turned(next, after, h[1]), h),
    }
}

/// Whether two knots are the same place, full turns aside.
fn meets(a: &Knot, b: &Knot) -> bool {
    let near = |a: [f64; 3], b: [f64; 3], scale: f64| DVec3::from(a).distance(DVec3::from(b)) <= 1e-6 * scale;
    let (first, second, scale) = (&a.pose.camera, &b.pose.camera, a.pose.distance());
    near(first.eye, second.eye, scale)
        && near(first.target, second.target, scale)
        && turn(whole(DVec3::Y, a.pose.yaw, a.pose.rest), whole(DVec3::Y, b.pose.yaw, b.pose.rest)).length() < 1e-6
}

#[cfg(test)]
mod tests;
