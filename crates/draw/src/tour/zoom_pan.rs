//! The shortest way between two views of a plane for somebody who watches it (van Wijk and Nuij, "Smooth and efficient zooming
//! and panning", 2003): far views zoom out, pan and zoom in again, and the picture moves equally fast all the way.
//!
//! With `u` the way along the line between the two points looked at and `w` the width in view, the paper measures a path by
//! `ds^2 = rho^2 du^2 / w^2 + dw^2 / (rho^2 w^2)`. In `x = rho^2 u` that is the hyperbolic half-plane's metric divided by `rho`, so the
//! shortest paths are arcs of circles about the axis `w = 0`: `x = c + R tanh(r)`, `w = R / cosh(r)`, with `r = r_0 + rho s`. The forms
//! below are these without differences of large numbers, so that nine decades of scale keep their digits.

/// The paper's trade of zooming against panning: what its subjects found the most natural.
pub const RHO: f64 = 1.42;

/// A path between two views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZoomPan {
    /// How far the points looked at are apart, world units.
    distance: f64,
    /// Widths in view at both ends, world units.
    widths: [f64; 2],
    /// The arc's parameter `r` at the beginning, seen from either end.
    begins: [f64; 2],
    /// The path's length `S`.
    length: f64,
}

impl ZoomPan {
    /// The path from a view of width `widths[0]` to one of width `widths[1]` whose middle is `distance` away; widths are
    /// positive.
    pub fn new(distance: f64, widths: [f64; 2]) -> ZoomPan {
        let x = RHO * RHO * distance;
        let [w0, w1] = widths;
        // The half-plane's distance of two points, as twice the inverse sine of half the chord.
        let chord = x.hypot(w1 - w0) / (2.0 * (w0 * w1).sqrt());
        let length = 2.0 * chord.asinh() / RHO;
        // sinh(r_0) = -c / w_0, where c = (x^2 + w_1^2 - w_0^2) / (2 x) is the circle's middle.
        let begin = |near: f64, far: f64| -(0.5 * (x / near + (far - near) / x * ((far + near) / near))).asinh();
        let begins = if length > 0.0 { [begin(w0, w1), begin(w1, w0)] } else { [0.0; 2] };
        ZoomPan { distance, widths, begins, length }
    }

    /// The path's length `S`: what to divide by a comfortable speed (about 1 per second) for a duration.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Where the view is at a share of the length, from 0 to 1: the share of the distance, and the width. Counted from the nearer
    /// end, so that both ends are met exactly and the way back is the same way.
    pub fn at(&self, share: f64) -> [f64; 2] {
        if self.length <= 0.0 {
            return [share.clamp(0.0, 1.0), self.widths[0]];
        }
        if share <= 0.5 {
            self.counted_from(0, share.max(0.0))
        } else {
            let [gone, width] = self.counted_from(1, (1.0 - share).max(0.0));
            [1.0 - gone, width]
        }
    }

    /// The same for the share that the view still has to go, which keeps its digits near the end.
    pub fn left(&self, share: f64) -> f64 {
        match share > 0.5 && self.length > 0.0 {
            true => self.counted_from(1, (1.0 - share).max(0.0))[0],
            false => 1.0 - self.at(share)[0],
        }
    }

    /// The share of the distance gone, and the width, at a share of the length from the end `end`.
    fn counted_from(&self, end: usize, share: f64) -> [f64; 2] {
        let (width, r0) = (self.widths[end], self.begins[end]);
        let s = RHO * self.length * share;
        // cosh(r_0 + s) / cosh(r_0) = e^s / (1 + e^(-2 r_0)) + e^-s / (1 + e^(2 r_0)), a sum of positive terms.
        let growth = s.exp() / (1.0 + (-2.0 * r0).exp()) + (-s).exp() / (1.0 + (2.0 * r0).exp());
        let gone = match self.distance > 0.0 {
            true => width * s.sinh() / (RHO * RHO * self.distance * r0.cosh() * growth),
            false => 0.0,
        };
        [if gone.is_finite() { gone.clamp(0.0, 1.0) } else { 0.0 }, width / growth]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn far_views_are_seen_from_afar_and_near_ones_are_not() {
        let far = ZoomPan::new(1000.0, [1.0, 1.0]);
        let [half, width] = far.at(0.5);
        assert!((half - 0.5).abs() < 1e-12 && width > 500.0, "{half} {width}");
        let near = ZoomPan::new(0.01, [1.0, 1.0]);
        assert!(near.at(0.5)[1] < 1.001);
        // Nothing to do, and nothing to pan.
        assert_eq!((ZoomPan::new(0.0, [2.0, 2.0]).length(), ZoomPan::new(0.0, [2.0, 2.0]).at(0.3)[1]), (0.0, 2.0));
        let zoom = ZoomPan::new(0.0, [1.0, 1e9]);
        assert!((zoom.at(0.5)[1] / 1e9f64.sqrt() - 1.0).abs() < 1e-9);
        assert!((zoom.length() - 1e9f64.ln() / RHO).abs() < 1e-9);
    }

    proptest! {
        /// The picture moves equally fast all the way, over nine decades of widths and distances.
        #[test]
        fn the_perceived_velocity_is_constant(
            ln_distance in -10.0..10.0f64, ln_first in -10.0..10.0f64, ln_second in -10.0..10.0f64, share in 0.001..0.998f64,
        ) {
            let (distance, widths) = (ln_distance.exp(), [ln_first.exp(), ln_second.exp()]);
            let path = ZoomPan::new(distance, widths);
            prop_assume!(path.length() > 1e-3);
            let step = 1e-3 * (1.0 - share).min(share);
            let [before, after] = [share - step, share + step].map(|share| path.at(share));
            // Differences of what is gone near the start and of what is left near the end.
            let du = distance * match share > 0.5 {
                true => path.left(share - step) - path.left(share + step),
                false => after[0] - before[0],
            };
            let (dw, w) = (after[1] - before[1], path.at(share)[1]);
            let speed = (RHO * du / w).hypot(dw / (RHO * w)) / (2.0 * step * path.length());
            prop_assert!((speed - 1.0).abs() < 1e-3, "{speed}");
        }

        /// Both ends are met, the way back is the same way, and nothing is lost on the way.
        #[test]
        fn ends_are_met_and_the_way_back_is_the_same(
            ln_distance in -20.0..20.0f64, ln_first in -20.0..20.0f64, ln_second in -20.0..20.0f64, share in 0.0..1.0f64,
        ) {
            let (distance, widths) = (ln_distance.exp(), [ln_first.exp(), ln_second.exp()]);
            let path = ZoomPan::new(distance, widths);
            let back = ZoomPan::new(distance, [widths[1], widths[0]]);
            let ([first, start], [last, end]) = (path.at(0.0), path.at(1.0));
            prop_assert!(first == 0.0 && last == 1.0);
            prop_assert!((start / widths[0] - 1.0).abs() < 1e-15 && (end / widths[1] - 1.0).abs() < 1e-15);
            let ([there, width], [home, same]) = (path.at(share), back.at(1.0 - share));
            prop_assert!((there + home - 1.0).abs() < 1e-9 && (width / same - 1.0).abs() < 1e-9);
            prop_assert!(width >= widths[0].min(widths[1]) * (1.0 - 1e-12) && (0.0..=1.0).contains(&there));
            // Counted from either end, the middle is the same place.
            let (low, high) = (path.at(0.5), path.at(0.5 + 1e-15));
            let apart = RHO * distance * (low[0] - high[0]).abs() / low[1];
            prop_assert!(apart < 1e-7 && (low[1] / high[1] - 1.0).abs() < 1e-7, "{apart}");
        }
    }
}
