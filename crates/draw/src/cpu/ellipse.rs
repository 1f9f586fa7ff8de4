//! Ellipses in the picture: what an ellipsoidal splat looks like along parallel lines of sight, or from far away.
//!
//! Held row by row: at the height `y` the ellipse is the interval around `x = center + shear (y - center)` whose half width is
//! `half[0] sqrt(1 - ((y - center) / half[1])^2)`. Every positive definite form has this shape, and both half widths are
//! positive however thin it is.

use glam::DVec3;

/// An ellipse in the picture. Lengths in pixels, `(0, 0)` the picture's top left corner.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse {
    /// Centre.
    pub center: [f64; 2],
    /// By how much the middle of a row lies further to the right than that of the row above it, pixels a pixel.
    pub shear: f64,
    /// Half the width of the row through the centre, and half the height of the whole.
    pub half: [f64; 2],
}

impl Ellipse {
    /// The ellipse `{M t : |t| <= 1}` around a centre, from the two rows of `M`, pixels. None when it is not finite or has no area.
    pub fn of(center: [f64; 2], across: DVec3, down: DVec3) -> Option<Ellipse> {
        let height = down.length();
        // The area over pi by the cross product: exact for slivers too, where the form's determinant would be lost.
        let ellipse = Ellipse {
            center,
            shear: across.dot(down) / (height * height),
            half: [across.cross(down).length() / height, height],
        };
        let finite = [center[0], center[1], ellipse.shear].iter().all(|value| value.is_finite());
        (finite && ellipse.half.iter().all(|half| *half > 0.0 && half.is_finite())).then_some(ellipse)
    }

    /// Half the width and half the height of the box around it.
    pub fn extent(&self) -> [f64; 2] {
        let lean = self.shear * self.half[1];
        [(self.half[0] * self.half[0] + lean * lean).sqrt(), self.half[1]]
    }

    /// Half of the short axis and of the long one.
    pub fn radii(&self) -> [f64; 2] {
        let [width, height] = self.extent();
        let (xx, yy, xy) = (width * width, height * height, self.shear * height * height);
        let difference = 0.5 * (xx - yy);
        let long = (0.5 * (xx + yy) + (difference * difference + xy * xy).sqrt()).sqrt();
        [self.area() / long, long]
    }

    /// Its area over pi: the product of the two half axes.
    pub fn area(&self) -> f64 {
        self.half[0] * self.half[1]
    }

    /// The smallest interval of x that holds its part between two heights; empty (first above last) where there is none.
    pub fn between(&self, [top, bottom]: [f64; 2]) -> [f64; 2] {
        let clip = |y: f64| (y - self.center[1]).clamp(-self.half[1], self.half[1]);
        let [from, to] = [clip(top), clip(bottom)];
        if from >= to {
            return [f64::INFINITY, f64::NEG_INFINITY];
        }
        // The boundary's x is largest at the height `shear half[1]^2 / extent`, and falls on both sides of it.
        let [width, height] = self.extent();
        let side = |sign: f64| {
            let peak = sign * self.shear * height * height / width;
            let y = peak.clamp(from, to);
            let chord = (1.0 - (y / height).powi(2)).max(0.0).sqrt();
            self.center[0] + self.shear * y + sign * self.half[0] * chord
        };
        [side(-1.0), side(1.0)]
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    proptest! {
        #[test]
        fn ellipses_hold_the_points_of_their_boundary(
            turn in 0.0..TAU, ratio in 0.001..1.0f64, size in 0.01..100.0f64, strip in prop::array::uniform2(-1.2..1.2f64),
        ) {
            let (sin, cos) = turn.sin_cos();
            let (across, down) = (DVec3::new(cos, -sin * ratio, 0.0), DVec3::new(sin, cos * ratio, 0.0));
            let ellipse = Ellipse::of([3.0, -2.0], size * across, size * down).unwrap();
            let [short, long] = ellipse.radii();
            prop_assert!((short / (ratio * size) - 1.0).abs() < 1e-9 && (long / size - 1.0).abs() < 1e-9);
            let height = ellipse.extent()[1];
            let mut strip = strip.map(|y| -2.0 + y * height);
            strip.sort_by(f64::total_cmp);
            let [left, right] = ellipse.between(strip);
            let mut found = [f64::INFINITY, f64::NEG_INFINITY];
            for k in 0..20_000 {
                let (t, u) = (f64::from(k) * TAU / 20_000.0).sin_cos();
                let (x, y) = (3.0 + size * (across.x * u + across.y * t), -2.0 + size * (down.x * u + down.y * t));
                let square = ((x - 3.0 - ellipse.shear * (y + 2.0)) / ellipse.half[0]).powi(2)
                    + ((y + 2.0) / ellipse.half[1]).powi(2);
                prop_assert!((square - 1.0).abs() < 1e-6, "{square}");
                if strip[0] <= y && y <= strip[1] {
                    found = [found[0].min(x), found[1].max(x)];
                }
            }
            prop_assert!(left <= found[0] + 1e-9 * size && right >= found[1] - 1e-9 * size);
            // No further than the boundary's points nearby, those beyond the strip too where it is narrower than their distance.
            let slack = 0.01 * size + (strip[1] - strip[0]) * ellipse.shear.abs();
            let wide = strip[1] - strip[0] > 0.05 * height;
            prop_assert!(!wide || found[0] > found[1] || left >= found[0] - slack && right <= found[1] + slack);
        }
    }
}
