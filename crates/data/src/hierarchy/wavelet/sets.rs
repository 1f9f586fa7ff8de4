//! The sets of points a node may hold, in a node of unit size (WM03 section 4.2, figures 4 and 3b).
//!
//! A node is drawn as one *large* point, as its children's points, or as a *directed* set: two or three points, thin along a direction across
//! which values change. 2D has 4 directions and 3D 13, to the faces, edges and corners of a cube. As published, faces have two points
//! and the others three, as far apart as covers the node. Beyond the paper the points of a set may be shifted, closer together and,
//! in 2D, turned by 22.5 degrees or softer, each of which is part of the one byte that tells a node's set: an edge passes where it likes.
//!
//! Points of a set are Gaussians across the node, [`SIGMA`] of their distance wide or, of soft sets, more, normalised: of two points one
//! takes over from the other along a logistic curve. A point has the share `w_k / sum w` of the node's value at a place ([`Set::shares`]).

/// The width of a Gaussian as a share of the distance to the next: between 0.3, which covers without gaps, and none, which is an edge.
pub const SIGMA: f32 = 0.3;
/// The width in sets of three whose middle one is nowhere alone: the steps from one to the next flow together to one soft edge, which lies
/// where their heights put it.
const SOFT: f32 = 0.6;
/// Points of a directed set at most.
pub const MOST: usize = 3;
/// Sets of a direction that there are in any number of dimensions.
const VARIANTS: usize = 19;
/// More sets of a direction in 2D, where a byte has room for them.
const MORE: usize = 12;
/// The byte of a node without a directed set.
pub const NONE: u8 = 0;

/// The 13 directions of 3D: to faces, edges and corners of a cube, not yet of unit length.
const TO_CUBE: [[i8; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [-1, 1, 1],
];

/// Number of published directions: 4 of 2D, 13 of 3D.
pub const fn directions(d: usize) -> usize {
    if d == 2 { 4 } else { 13 }
}

/// Number of directions with those turned: 8 of 2D, 13 of 3D.
pub const fn turned_directions(d: usize) -> usize {
    if d == 2 { 8 } else { 13 }
}

/// Number of sets of a direction.
pub(super) const fn variants(d: usize) -> usize {
    if d == 2 { VARIANTS + MORE } else { VARIANTS }
}

/// Whether a direction is an axis: those to faces have two points where they are drawn as published.
const fn is_axis(d: usize, n: usize) -> bool {
    if d == 2 { n == 0 || n == 2 } else { n < 3 }
}

/// The published directions that are nearest to one: itself, or both neighbours of one that is turned.
pub(super) fn nearest(d: usize, n: usize) -> [usize; 2] {
    if d == 2 && n >= 4 { [n - 4, (n - 3) % 4] } else { [n, n] }
}

/// A direction across which values change, x first, of unit length. In 2D direction `n` has the angle `n` times 45 degrees, and those
/// from 4 on are turned by 22.5 degrees from there.
pub fn direction(d: usize, n: usize) -> [f32; 3] {
    if d == 2 {
        let angle = std::f64::consts::FRAC_PI_4 * ((n % 4) as f64 + if n < 4 { 0.0 } else { 0.5 });
        let clean = |v: f64| if v.abs() < 1e-12 { 0.0 } else { v as f32 };
        return [clean(libm::cos(angle)), clean(libm::sin(angle)), 0.0];
    }
    let way = TO_CUBE[n % 13].map(f64::from);
    let length = libm::sqrt(way.iter().map(|w| w * w).sum::<f64>());
    way.map(|w| (w / length) as f32)
}

/// A directed set in a node of unit size around the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Set {
    /// Across what values change, of unit length, x first; z is 0 in 2D.
    pub direction: [f32; 3],
    /// Number of points, 2 or 3.
    pub points: usize,
    /// Where the middle of the points is along the direction, in the node's extent.
    pub middle: f32,
    /// How far apart they are.
    pub apart: f32,
    /// How wide each is, of that.
    pub width: f32,
}

/// Of each variant of a direction: points, the place of their middle in half of what the node measures along the direction, their
/// distance in the node's extent, or, negative, in half of what it measures, and their width.
const SHAPES: [(usize, f32, f32, f32); VARIANTS + MORE - 1] = [
    (2, 0.0, 0.5, SIGMA),
    (2, 0.2, 0.5, SIGMA),
    (2, -0.2, 0.5, SIGMA),
    (2, 0.4, 0.5, SIGMA),
    (2, -0.4, 0.5, SIGMA),
    (2, 0.6, 0.5, SIGMA),
    (2, -0.6, 0.5, SIGMA),
    (2, 0.0, 0.2, SIGMA),
    (2, 0.2, 0.2, SIGMA),
    (2, -0.2, 0.2, SIGMA),
    (2, 0.4, 0.2, SIGMA),
    (2, -0.4, 0.2, SIGMA),
    (2, 0.6, 0.2, SIGMA),
    (2, -0.6, 0.2, SIGMA),
    (3, 0.0, -0.667, SIGMA),
    (3, 0.0, -0.333, SIGMA),
    (3, 0.3, -0.333, SIGMA),
    (3, -0.3, -0.333, SIGMA),
    (3, 0.0, 0.25, SOFT),
    (3, 0.35, 0.25, SOFT),
    (3, -0.35, 0.25, SOFT),
    (3, 0.35, 0.3, SOFT),
    (3, -0.35, 0.3, SOFT),
    (2, 0.1, 0.8, SIGMA),
    (2, -0.1, 0.8, SIGMA),
    (2, 0.0, 2.0, SIGMA),
    (2, 0.4, 1.0, SIGMA),
    (2, -0.4, 1.0, SIGMA),
    (2, 0.1, 0.35, SIGMA),
    (2, -0.1, 0.35, SIGMA),
];

impl Set {
    /// The direction and the variant that a byte tells; `None` for [`NONE`] and bytes that tell no set.
    fn told(d: usize, code: u8) -> Option<(usize, usize)> {
        let at = usize::from(code).checked_sub(1)?;
        let directions = turned_directions(d);
        let (n, variant) = match at.checked_sub(directions * VARIANTS) {
            None => (at / VARIANTS, at % VARIANTS),
            Some(at) if d == 2 => (at / MORE, VARIANTS + at % MORE),
            Some(_) => return None,
        };
        (n < directions).then_some((n, variant))
    }

    /// The byte of a variant of a direction.
    pub(super) const fn code(d: usize, n: usize, variant: usize) -> u8 {
        let at = if variant < VARIANTS {
            n * VARIANTS + variant
        } else {
            turned_directions(d) * VARIANTS + n * MORE + variant - VARIANTS
        };
        (1 + at) as u8
    }

    /// The set of a byte; `None` for [`NONE`] and bytes that tell no set.
    pub fn of(d: usize, code: u8) -> Option<Set> {
        let (n, variant) = Set::told(d, code)?;
        let direction = direction(d, n);
        let half = 0.5 * direction.iter().map(|v| v.abs()).sum::<f32>();
        // The first is the published one.
        let (points, middle, apart, width) = match variant.checked_sub(1) {
            None if is_axis(d, n) => (2, 0.0, 0.5, SIGMA),
            None => (3, 0.0, -2.0 / 3.0, SIGMA),
            Some(shape) => SHAPES[shape],
        };
        let apart = if apart < 0.0 { -apart * half } else { apart };
        Some(Set { direction, points, middle: middle * half, apart, width })
    }

    /// The number of points of a byte's set, sooner than [`Set::of`] tells it; `None` where there is no set.
    pub fn points_of(d: usize, code: u8) -> Option<usize> {
        let (n, variant) = Set::told(d, code)?;
        Some(match variant.checked_sub(1) {
            None if is_axis(d, n) => 2,
            None => 3,
            Some(shape) => SHAPES[shape].0,
        })
    }

    /// The byte of the published set of a direction.
    pub const fn published(direction: usize) -> u8 {
        // In 3D the same.
        Set::code(2, direction, 0)
    }

    /// The direction that a byte's set has, turned ones included; `None` where there is no set.
    pub fn direction_of(d: usize, code: u8) -> Option<usize> {
        Set::told(d, code).map(|(n, _)| n)
    }

    /// Where a place is along the direction.
    pub fn along(&self, place: [f32; 3]) -> f32 {
        (0..3).map(|k| self.direction[k] * place[k]).sum()
    }

    /// The share of each point at a distance along the direction; they sum to 1.
    #[inline]
    pub fn shares_along(&self, t: f32) -> [f32; MOST] {
        // With s = (t - middle) / apart and points at k - (K - 1) / 2, weights exp(-(s - k)^2 / 2 sigma^2) without their common factor.
        let s = (t - self.middle) / self.apart;
        let logistic = |x: f32| 1.0 / (1.0 + (-x.clamp(-40.0, 40.0)).exp());
        let steep = 1.0 / (self.width * self.width);
        if self.points == 2 {
            let last = logistic(s * steep);
            return [1.0 - last, last, 0.0];
        }
        // Ratios to the middle one: exp((-s - 1/2) / sigma^2) and exp((s - 1/2) / sigma^2).
        let (low, high) = ((-s - 0.5) * steep, (s - 0.5) * steep);
        let most = low.max(high).max(0.0);
        let weights = [(low - most).exp(), (-most).exp(), (high - most).exp()];
        let sum = weights.iter().sum::<f32>();
        weights.map(|w| w / sum)
    }

    /// The share of each point at a place in the node's extent from its middle.
    pub fn shares(&self, place: [f32; 3]) -> [f32; MOST] {
        self.shares_along(self.along(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_byte_tells_one_set() {
        for d in [2, 3] {
            let mut all = Vec::new();
            for n in 0..turned_directions(d) {
                for variant in 0..variants(d) {
                    let code = Set::code(d, n, variant);
                    assert_eq!((Set::told(d, code), Set::direction_of(d, code)), (Some((n, variant)), Some(n)));
                    all.push(code);
                }
            }
            assert!((0..directions(d)).all(|n| Set::published(n) == Set::code(d, n, 0)));
            all.sort_unstable();
            // From 1 on without gaps, and nothing beyond.
            assert!(all.iter().enumerate().all(|(at, code)| usize::from(*code) == at + 1));
            for code in 0..=u8::MAX {
                let set = Set::of(d, code);
                assert_eq!((set.is_some(), Set::points_of(d, code)), (all.contains(&code), set.map(|set| set.points)));
            }
            // Those along an axis span half of the node's extent on each side, all others more.
            for n in 0..turned_directions(d) {
                let reach = 0.5 * direction(d, n).iter().map(|v| v.abs()).sum::<f32>();
                assert_eq!(is_axis(d, n), reach < 0.501);
            }
        }
    }

    #[test]
    fn turned_directions_lie_between_the_nearest() {
        for d in [2, 3] {
            for n in 0..turned_directions(d) {
                let along = |m: usize| {
                    let (a, b) = (direction(d, n), direction(d, m));
                    (0..3).map(|k| a[k] * b[k]).sum::<f32>().abs()
                };
                let [one, other] = nearest(d, n).map(along);
                assert!((one - other).abs() < 1e-6 && (0..directions(d)).all(|m| along(m) < one + 1e-6));
            }
        }
    }
}
