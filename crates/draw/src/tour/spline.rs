//! Curves through keyframes with continuous velocity: cubic between two of them, with a velocity at each that never makes the
//! curve swing beyond them.

use glam::{DQuat, DVec3};
use std::ops::{Add, Mul, Sub};

/// What can be added and scaled.
pub trait Vector: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f64, Output = Self> {
    /// Its length.
    fn size(self) -> f64;
}

impl Vector for f64 {
    fn size(self) -> f64 {
        self.abs()
    }
}

impl Vector for DVec3 {
    fn size(self) -> f64 {
        self.length()
    }
}

/// The velocity at a keyframe that is left at `after` on average and reached at `before`, over intervals of these lengths: their
/// mean, in which the shorter interval weighs more (the parabola through the three keyframes), and at most twice the slower one (M. Steffen, 1990),
/// so that the curve stays between its keyframes.
pub fn velocity<V: Vector>(before: V, after: V, [first, second]: [f64; 2]) -> V {
    if first <= 0.0 || second <= 0.0 {
        return before * 0.0;
    }
    let mean = (before * second + after * first) * (1.0 / (first + second));
    let most = 2.0 * before.size().min(after.size());
    if mean.size() <= most || mean.size() == 0.0 { mean } else { mean * (most / mean.size()) }
}

/// [`velocity`] of a number: zero where the curve turns round.
pub fn velocity_of_number(before: f64, after: f64, intervals: [f64; 2]) -> f64 {
    if before * after <= 0.0 { 0.0 } else { velocity(before, after, intervals) }
}

/// The cubic from `a` to `b` with velocities `va` and `vb` over an interval of length `h`, at the share `u` of it. Counted from the
/// nearer end.
pub fn cubic<V: Vector>([a, b]: [V; 2], [va, vb]: [V; 2], h: f64, u: f64) -> V {
    if u > 0.5 {
        return cubic([b, a], [vb * -1.0, va * -1.0], h, 1.0 - u);
    }
    let (u2, u3) = (u * u, u * u * u);
    a + (b - a) * (3.0 * u2 - 2.0 * u3) + va * (h * (u3 - 2.0 * u2 + u)) + vb * (h * (u3 - u2))
}

/// The rotation vector (axis times angle, radians, angle up to pi) that leads from one orientation to another, in either's own
/// frame.
pub fn turn(from: DQuat, to: DQuat) -> DVec3 {
    let mut q = from.conjugate() * to;
    if q.w < 0.0 {
        q = -q;
    }
    let sine = q.xyz().length();
    // The angle over its sine tends to 2 for small turns.
    let scale = if sine < 1e-12 { 2.0 } else { 2.0 * sine.atan2(q.w) / sine };
    q.xyz() * scale
}

/// `from`, turned by a rotation vector in its own frame.
pub fn turned(from: DQuat, by: DVec3) -> DQuat {
    (from * DQuat::from_scaled_axis(by)).normalize()
}

/// The curve from orientation `a` to `b` with angular velocities `va` and `vb` (own frames, radians per second) over `h` seconds, at
/// the share `u`: a Bezier curve by repeated spherical interpolation (K. Shoemake, 1985), the same both ways.
pub fn orientation([a, b]: [DQuat; 2], [va, vb]: [DVec3; 2], h: f64, u: f64) -> DQuat {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    let after = turned(a, va * (h / 3.0));
    let before = turned(b, vb * (-h / 3.0));
    // The signs of neighbours agree, so that the curve is continuous in u and takes the short way.
    let after = if after.dot(a) < 0.0 { -after } else { after };
    let before = if before.dot(b) < 0.0 { -before } else { before };
    let mut row = [a, after, before, b];
    for level in (1..row.len()).rev() {
        for i in 0..level {
            row[i] = between(row[i], row[i + 1], u);
        }
    }
    row[0]
}

/// Spherical interpolation that keeps the signs as they are.
fn between(a: DQuat, b: DQuat, u: f64) -> DQuat {
    let angle = (a - b).length().atan2((a + b).length()) * 2.0;
    let sine = angle.sin();
    if sine.abs() < 1e-9 {
        let mixed = a * (1.0 - u) + b * u;
        return if mixed.length() > 1e-12 { mixed.normalize() } else { a };
    }
    (a * (((1.0 - u) * angle).sin() / sine) + b * ((u * angle).sin() / sine)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn orientation_of(axis: [f64; 3], angle: f64) -> DQuat {
        DQuat::from_axis_angle((DVec3::from(axis) + DVec3::splat(1e-3)).normalize(), angle)
    }

    fn apart(a: DQuat, b: DQuat) -> f64 {
        turn(a, b).length()
    }

    proptest! {
        #[test]
        fn a_cubic_has_the_ends_and_velocities_that_it_is_given(
            a in -9.0..9.0f64, b in -9.0..9.0f64, va in -5.0..5.0f64, vb in -5.0..5.0f64, h in 0.1..9.0f64, u in 0.0..1.0f64,
        ) {
            let at = |u| cubic([a, b], [va, vb], h, u);
            prop_assert!(at(0.0) == a && at(1.0) == b);
            let e = 1e-6;
            prop_assert!(((at(e) - a) / (e * h) - va).abs() < 1e-3 && ((b - at(1.0 - e)) / (e * h) - vb).abs() < 1e-3);
            prop_assert!((at(u) - cubic([b, a], [-vb, -va], h, 1.0 - u)).abs() < 1e-12 * (1.0 + h));
        }

        /// Numbers between two keyframes stay between them.
        #[test]
        fn a_number_never_swings_beyond_its_keyframes(
            values in prop::array::uniform4(-9.0..9.0f64), h in prop::array::uniform3(0.1..5.0f64), u in 0.0..1.0f64,
        ) {
            let slope = |i: usize| (values[i + 1] - values[i]) / h[i];
            let v = [velocity_of_number(slope(0), slope(1), [h[0], h[1]]), velocity_of_number(slope(1), slope(2), [h[1], h[2]])];
            let at = cubic([values[1], values[2]], v, h[1], u);
            prop_assert!(at >= values[1].min(values[2]) - 1e-9 && at <= values[1].max(values[2]) + 1e-9);
        }

        #[test]
        fn orientations_have_the_ends_and_angular_velocities_that_they_are_given(
            axes in prop::array::uniform2(prop::array::uniform3(-1.0..1.0f64)),
            angles in prop::array::uniform2(-3.0..3.0f64),
            va in prop::array::uniform3(-0.5..0.5f64),
            vb in prop::array::uniform3(-0.5..0.5f64),
            h in 0.2..4.0f64,
            u in 0.0..1.0f64,
        ) {
            let (a, b) = (orientation_of(axes[0], angles[0]), orientation_of(axes[1], angles[1]));
            let (va, vb) = (DVec3::from(va), DVec3::from(vb));
            let at = |u| orientation([a, b], [va, vb], h, u);
            prop_assert!(apart(at(0.0), a) < 1e-9 && apart(at(1.0), b) < 1e-9);
            let e = 1e-5;
            prop_assert!((turn(a, at(e)) / (e * h) - va).length() < 1e-2, "{} {va}", turn(a, at(e)) / (e * h));
            prop_assert!((turn(at(1.0 - e), b) / (e * h) - vb).length() < 1e-2);
            prop_assert!(apart(at(u), at((u + 1e-6).min(1.0))) < 1e-3, "jumps");
            prop_assert!((at(u).length() - 1.0).abs() < 1e-12);
            prop_assert!(apart(at(u), orientation([b, a], [-vb, -va], h, 1.0 - u)) < 1e-6);
        }
    }

    #[test]
    fn turns_lead_from_one_orientation_to_the_other() {
        let (a, b) = (orientation_of([1.0, 0.0, 0.0], 0.5), orientation_of([0.0, 1.0, 0.2], -2.0));
        assert!(apart(turned(a, turn(a, b)), b) < 1e-12);
        assert!(turn(a, a).length() < 1e-15);
    }
}
