//! The track of a particle or cluster from one step to the next: a cubic Hermite spline (F12 6.3.1, equation 6.1), bounds
//! on how far two tracks are apart, and a test of whether a track's steps are close enough to be joined by a spline at all.
//!
//! Tangents are velocities times the interval's length, `dtau dx/dtau`, so that intervals of any length are alike here; the
//! place within the interval is `u` in [0, 1]. Everything is linear in positions and tangents: the deviation of a
//! particle from its cluster is the spline of their differences ([`HermiteSpline::minus`]), whose norm the bounds hold.

use glam::DVec3;

/// A track over one interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HermiteSpline {
    /// Positions at the beginning and at the end, world units.
    pub positions: [DVec3; 2],
    /// Velocities there times the length of the interval, world units.
    pub tangents: [DVec3; 2],
}

/// The largest weight of a tangent in (6.1), at `u` = 1/3 and 2/3.
const TANGENT_WEIGHT: f64 = 4.0 / 27.0;

impl HermiteSpline {
    /// The position at `u` (6.1); exactly the stored ones at 0 and 1.
    #[inline]
    pub fn position(&self, u: f64) -> DVec3 {
        let ([r0, r1], [v0, v1]) = (self.positions, self.tangents);
        let (u2, u3) = (u * u, u * u * u);
        (2.0 * u3 - 3.0 * u2 + 1.0) * r0 + (u3 - 2.0 * u2 + u) * v0 + (3.0 * u2 - 2.0 * u3) * r1 + (u3 - u2) * v1
    }

    /// The derivative of the position by `u`; by the interval's length it is the velocity. Exactly the tangents at 0 and 1.
    pub fn derivative(&self, u: f64) -> DVec3 {
        let ([r0, r1], [v0, v1]) = (self.positions, self.tangents);
        let u2 = u * u;
        (6.0 * u - 6.0 * u2) * (r1 - r0) + (3.0 * u2 - 4.0 * u + 1.0) * v0 + (3.0 * u2 - 2.0 * u) * v1
    }

    /// The part of the same curve from one place to another, as a track over that part.
    pub fn part(&self, [from, to]: [f64; 2]) -> HermiteSpline {
        HermiteSpline {
            positions: [from, to].map(|u| self.position(u)),
            tangents: [from, to].map(|u| self.derivative(u) * (to - from)),
        }
    }

    /// The spline of the differences to another track over the same interval: how that one deviates from this one.
    #[inline]
    pub fn minus(&self, other: &HermiteSpline) -> HermiteSpline {
        let differences = |own: [DVec3; 2], other: [DVec3; 2]| [own[0] - other[0], own[1] - other[1]];
        HermiteSpline {
            positions: differences(self.positions, other.positions),
            tangents: differences(self.tangents, other.tangents),
        }
    }

    /// The control points of the same curve in Bézier's form.
    #[inline]
    pub fn control_points(&self) -> [DVec3; 4] {
        let ([r0, r1], [v0, v1]) = (self.positions, self.tangents);
        [r0, r0 + v0 / 3.0, r1 - v1 / 3.0, r1]
    }

    /// A bound on the norm of [`HermiteSpline::position`] over the interval from the weights of (6.1): the farther end, and
    /// 4/27 of the lengths of both tangents (6.2).
    #[inline]
    pub fn weight_bound(&self) -> f64 {
        let [r, v] = [self.positions, self.tangents].map(|pair| pair.map(DVec3::length));
        r[0].max(r[1]) + TANGENT_WEIGHT * (v[0] + v[1])
    }

    /// A bound on the norm of [`HermiteSpline::position`] over the interval: the curve lies within the hull of its control
    /// points, taken after it was halved `halvings` times. Each halving brings the bound closer and none lets it grow: for
    /// none, one, two and three it is at most 5, 2, 1.14 and 1.04 times the largest norm (5 for Chebyshev's polynomial). It
    /// may exceed [`HermiteSpline::weight_bound`], as for a track from 0 to 0 with one tangent.
    pub fn hull_bound(&self, halvings: u32) -> f64 {
        hull_bound(self.control_points(), halvings)
    }

    /// The bound that tracks are compared with: the smaller one of (6.2) and the hull halved twice.
    pub fn bound(&self) -> f64 {
        self.weight_bound().min(self.hull_bound(2))
    }

    /// Whether [`HermiteSpline::bound`] is at most `error`, as soon as that is known.
    #[inline]
    pub fn is_within(&self, error: f64) -> bool {
        let square = error * error;
        let [begin, near_begin, near_end, end] = self.control_points().map(DVec3::length_squared);
        begin.max(end) <= square
            && (near_begin.max(near_end) <= square || self.weight_bound() <= error || self.hull_bound(2) <= error)
    }

    /// How badly the steps' velocities account for the displacement: `c = |dx - w| / mean |dtau v|` with `w` the mean of both
    /// tangents. Where it is large (above 0.15 to 0.25), the steps are too far apart for the orbit and a spline leads
    /// astray. 0 where `|dx - w|` is not above a quarter of `smoothing_length` (world units): particles at rest jitter.
    /// Infinite for what moved without having velocities.
    pub fn unresolved(&self, smoothing_length: f64) -> f64 {
        let ([r0, r1], [v0, v1]) = (self.positions, self.tangents);
        let miss = (r1 - r0 - 0.5 * (v0 + v1)).length();
        if miss > 0.25 * smoothing_length { miss / (0.5 * (v0.length() + v1.length())) } else { 0.0 }
    }
}

/// [`HermiteSpline::hull_bound`] of the curve with these control points.
fn hull_bound(points: [DVec3; 4], halvings: u32) -> f64 {
    let Some(halvings) = halvings.checked_sub(1) else {
        return points.iter().map(|point| point.length_squared()).fold(0.0, f64::max).sqrt();
    };
    // De Casteljau's construction at the middle.
    let [a, b, c, d] = points;
    let [ab, bc, cd] = [(a + b) / 2.0, (b + c) / 2.0, (c + d) / 2.0];
    let [abc, bcd] = [(ab + bc) / 2.0, (bc + cd) / 2.0];
    let middle = (abc + bcd) / 2.0;
    hull_bound([a, ab, abc, middle], halvings).max(hull_bound([middle, bcd, cd, d], halvings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::cases;
    use proptest::prelude::*;

    /// The largest norm at 1001 places.
    fn largest(track: &HermiteSpline) -> f64 {
        (0..=1000).map(|i| track.position(i as f64 / 1000.0).length()).fold(0.0, f64::max)
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from)
    }

    /// Tracks whose tangents are anything from negligible to much longer than the displacement.
    fn track() -> impl Strategy<Value = HermiteSpline> {
        let tangent = || (vector(), -3.0..2.0f64).prop_map(|(v, size)| v * 10f64.powf(size));
        (vector(), vector(), tangent(), tangent())
            .prop_map(|(r0, r1, v0, v1)| HermiteSpline { positions: [r0, r1], tangents: [v0, v1] })
    }

    proptest! {
        #![proptest_config(cases(256))]

        #[test]
        fn ends_are_exact(track in track()) {
            prop_assert_eq!([0.0, 1.0].map(|u| track.position(u)), track.positions);
            prop_assert_eq!([0.0, 1.0].map(|u| track.derivative(u)), track.tangents);
        }

        #[test]
        fn the_derivative_is_that_of_the_position(track in track(), u in 0.01..0.99f64) {
            let step = 1e-4;
            let slope = (track.position(u + step) - track.position(u - step)) / (2.0 * step);
            let size = track.tangents[0].length() + track.tangents[1].length() + 1.0;
            prop_assert!((slope - track.derivative(u)).length() < 1e-6 * size);
        }

        #[test]
        fn a_part_is_the_same_curve(track in track(), from in 0.0..0.5f64, to in 0.5..=1.0f64, u in 0.0..=1.0f64) {
            let apart = track.part([from, to]).position(u) - track.position(from + u * (to - from));
            prop_assert!(apart.length() < 1e-13 * (1.0 + track.weight_bound()));
        }

        #[test]
        fn differences_of_tracks_are_tracks_of_differences(a in track(), b in track(), u in 0.0..=1.0f64) {
            let apart = a.position(u) - b.position(u);
            prop_assert!((a.minus(&b).position(u) - apart).length() < 1e-12 * (1.0 + a.weight_bound() + b.weight_bound()));
        }

        #[test]
        fn bounds_hold_and_halving_brings_them_closer(track in track()) {
            let truth = largest(&track);
            let hulls = [0, 1, 2, 3].map(|halvings| track.hull_bound(halvings));
            let rounding = 1.0 + 1e-14;
            prop_assert!(hulls.windows(2).all(|pair| pair[1] <= pair[0] * rounding), "{hulls:?}");
            for bound in hulls.into_iter().chain([track.weight_bound(), track.bound()]) {
                prop_assert!(bound * rounding >= truth, "{bound} {truth}");
            }
            prop_assert!(track.bound() <= track.weight_bound() && track.bound() <= hulls[2]);
            // The largest control point of any cubic of norm 1, found by linear programming; sampling misses some of the truth.
            for (hull, factor) in hulls.into_iter().zip([5.0, 2.0, 1.1393, 1.0378]) {
                prop_assert!(hull <= factor * truth * 1.0001, "{hull} {truth}");
            }
        }

        #[test]
        fn what_moves_evenly_is_resolved(r in vector(), v in vector()) {
            let track = HermiteSpline { positions: [r, r + v], tangents: [v, v] };
            prop_assert_eq!(track.unresolved(1e-9), 0.0);
            prop_assert!((track.position(0.25) - (r + 0.25 * v)).length() < 1e-15);
        }
    }

    #[test]
    fn the_worst_case_of_hulls() {
        let track = HermiteSpline { positions: [DVec3::ZERO; 2], tangents: [DVec3::X, DVec3::ZERO] };
        assert!((largest(&track) - 4.0 / 27.0).abs() < 1e-6);
        assert_eq!(track.weight_bound(), 4.0 / 27.0);
        assert_eq!([0, 1, 2].map(|halvings| track.hull_bound(halvings)), [1.0 / 3.0, 1.0 / 6.0, 0.15625]);
        assert_eq!(track.bound(), 4.0 / 27.0);
    }

    #[test]
    fn the_hull_is_farthest_off_for_chebyshevs_polynomial() {
        let [a, b, c, d] = [-1.0, 5.0, -5.0, 1.0].map(|x| x * DVec3::Y);
        let track = HermiteSpline { positions: [a, d], tangents: [3.0 * (b - a), 3.0 * (d - c)] };
        assert!((largest(&track) - 1.0).abs() < 1e-5);
        assert_eq!([0, 1].map(|halvings| track.hull_bound(halvings)), [5.0, 2.0]);
    }

    #[test]
    fn the_weights_are_those_of_the_thesis() {
        let unit = |i: usize| {
            let [a, b, c, d] = std::array::from_fn(|j| if i == j { DVec3::X } else { DVec3::ZERO });
            HermiteSpline { positions: [a, c], tangents: [b, d] }
        };
        let u: f64 = 0.3;
        let expected = [
            2.0 * u.powi(3) - 3.0 * u.powi(2) + 1.0,
            u.powi(3) - 2.0 * u.powi(2) + u,
            -2.0 * u.powi(3) + 3.0 * u.powi(2),
            u.powi(3) - u.powi(2),
        ];
        for (i, weight) in expected.into_iter().enumerate() {
            assert!((unit(i).position(u).x - weight).abs() < 1e-15, "{i}");
        }
    }

    #[test]
    fn a_circle_is_followed_as_far_as_steps_are_close() {
        let circle = |steps: f64| {
            let dtau = std::f64::consts::TAU / steps;
            let at = |angle: f64| DVec3::new(angle.cos(), angle.sin(), 0.0);
            let toward = |angle: f64| DVec3::new(-angle.sin(), angle.cos(), 0.0) * dtau;
            HermiteSpline { positions: [at(0.0), at(dtau)], tangents: [toward(0.0), toward(dtau)] }
        };
        // The spline's error is at most `dtau^4 / 384` radii.
        for steps in [32.0, 16.0, 8.0] {
            let (track, dtau) = (circle(steps), std::f64::consts::TAU / steps);
            let angle = 0.5 * dtau;
            let error = (track.position(0.5) - DVec3::new(angle.cos(), angle.sin(), 0.0)).length();
            assert!(error < 1.05 * dtau.powi(4) / 384.0, "{steps}: {error}");
        }
        // c is |2 sin(x) / x - 2 cos(x)| / 2 for half the angle x of a step.
        let c = [16.0, 8.0, 4.0, 3.0, 2.0].map(|steps| circle(steps).unresolved(1e-3));
        assert!(c.is_sorted() && c[1] < 0.15 && c[2] < 0.25 && c[3] > 0.25, "{c:?}");
        // Jitter is not counted; nor is anything divided where nothing moves.
        assert_eq!(circle(2.0).unresolved(100.0), 0.0);
        let still = HermiteSpline { positions: [DVec3::X; 2], tangents: [DVec3::ZERO; 2] };
        assert_eq!(still.unresolved(0.0), 0.0);
        assert_eq!(HermiteSpline { positions: [DVec3::X, DVec3::Y], ..still }.unresolved(0.1), f64::INFINITY);
    }
}
