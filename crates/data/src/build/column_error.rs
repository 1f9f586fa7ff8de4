//! How far pictures of column density are from the source's by the codes of leaves alone.
//!
//! Both pictures, of the whole box along z, are sums over leaves, and codes err independently from leaf to leaf as near as matters. So the
//! squares of the difference and of the picture are summed leaf by leaf, each as if it were alone. What leaves that lie behind one another
//! have in common adds to the picture alone, so that the error comes out too large, by 8 to 18 % on generated boxes. Of many leaves some are
//! chosen, more often those that a picture has more of, which scatters the error by a third or so.

mod window;

use crate::hierarchy::{NodeKey, RootCell};
use crate::model::{Bounds, Kernel};
use window::{COARSEST, Profile, Splat, Window};

/// Pixels along the longer side of the picture.
const PIXELS: usize = 1024;
/// Leaves that are drawn, some of them more than once.
const DRAWN: usize = 24;

/// A particle: its place as fractions of its leaf's cell, its mass and smoothing length, and what these decode to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub place: [f32; 3],
    pub own: [f32; 2],
    pub decoded: [f32; 2],
}

/// The picture that the error is told of.
#[derive(Debug)]
pub(super) struct Picture {
    root: RootCell,
    /// World position of its corner, and edge of a pixel.
    corner: [f64; 2],
    pixel: f64,
    profile: Profile,
}

impl Picture {
    /// Of particles in a box; `None` where that has no width.
    pub fn new(root: RootCell, bounds: Bounds, kernel: Kernel) -> Option<Picture> {
        let size = bounds.size();
        let pixel = size.x.max(size.y) / PIXELS as f64;
        let picture = Picture { root, corner: [bounds.min.x, bounds.min.y], pixel, profile: Profile::new(kernel) };
        (pixel > 0.0 && pixel.is_finite()).then_some(picture)
    }

    /// The leaves to draw, of which these are the cells and the masses, by number, each with the factor on its [`Picture::squares`].
    pub fn chosen(&self, leaves: impl Iterator<Item = (NodeKey, f64)>) -> Vec<(usize, f64)> {
        // The square of what a leaf puts into a pixel, times the pixels that it covers: `mass^2 / area`.
        let leaves: Vec<(f64, f64)> = leaves
            .map(|(key, mass)| {
                let area = (key.size(self.root) / self.pixel).max(1.0).powi(2);
                (mass * mass / area, area)
            })
            .collect();
        if leaves.len() <= DRAWN {
            return leaves.iter().map(|(weight, area)| weight * area).enumerate().collect();
        }
        let step = leaves.iter().map(|(weight, _)| weight).sum::<f64>() / DRAWN as f64;
        let mut end = 0.0;
        let times = leaves.iter().enumerate().map(|(leaf, (weight, area))| {
            let before = (end / step + 0.5).floor();
            end += weight;
            (leaf, ((end / step + 0.5).floor() - before) * area)
        });
        times.filter(|(_, factor)| *factor > 0.0).collect()
    }

    /// The sums over all pixels of the squares of the difference that codes make to the picture of a leaf, and of the picture itself, as if
    /// the leaf had a mass of 1; `mass` is what it has.
    pub fn squares(&self, key: NodeKey, mass: f64, particles: impl Iterator<Item = Pair>) -> [f64; 2] {
        let (size, min) = (key.size(self.root) / self.pixel, key.min(self.root));
        let corner = [(min.x - self.corner[0]) / self.pixel, (min.y - self.corner[1]) / self.pixel];
        let splat = |pair: Pair| Splat {
            place: [0, 1].map(|axis| (corner[axis] + f64::from(pair.place[axis]) * size) as f32),
            radii: [pair.own[1], pair.decoded[1]].map(|h| (f64::from(h) / self.pixel) as f32),
            masses: [pair.own[0], pair.decoded[0]].map(|m| (f64::from(m) / mass) as f32),
        };
        let splats: Vec<Splat> = particles.map(splat).collect();
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for splat in &splats {
            let reach = splat.reach();
            for axis in 0..2 {
                low[axis] = low[axis].min(splat.place[axis] - reach);
                high[axis] = high[axis].max(splat.place[axis] + reach);
            }
        }
        // Casts saturate: what lies outside the picture is cut off.
        let first = low.map(|low| (low as usize).min(PIXELS - 1) / COARSEST * COARSEST);
        let last = high.map(|high| (high as usize).min(PIXELS - 1) / COARSEST * COARSEST + COARSEST);
        let mut window = Window::new(first, [0, 1].map(|axis| last[axis].max(first[axis] + COARSEST) - first[axis]));
        window.draw(&splats, &self.profile);
        window.squares()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    const ROOT: RootCell = RootCell { min: DVec3::ZERO, size: 1.0 };

    fn picture() -> Picture {
        let bounds = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        Picture::new(ROOT, bounds, Kernel::CubicSpline).unwrap()
    }

    /// The same sums by all finest pixels of all particles.
    fn slow(pairs: &[Pair]) -> [f64; 2] {
        let mut pixels = vec![[0.0; 2]; PIXELS * PIXELS];
        for pair in pairs {
            for (k, [mass, h]) in [pair.own, pair.decoded].into_iter().enumerate() {
                let radius = f64::from(h) * PIXELS as f64;
                let at = [0, 1].map(|axis| f64::from(pair.place[axis]) * PIXELS as f64);
                let [columns, rows] = at.map(|at| (at - radius) as usize..((at + radius) as usize + 1).min(PIXELS));
                for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
                    let (x, y) = (column as f64 + 0.5 - at[0], row as f64 + 0.5 - at[1]);
                    let value =
                        f64::from(mass) * Kernel::CubicSpline.projected(x.hypot(y) / radius) / (radius * radius);
                    pixels[row * PIXELS + column][k] += value;
                }
            }
        }
        pixels.iter().fold([0.0; 2], |sum, [own, decoded]| [sum[0] + (decoded - own).powi(2), sum[1] + own * own])
    }

    proptest! {
        #![proptest_config(crate::cases::cases(6))]

        /// Resolutions that suit each kernel and a table make the error of all pixels and the exact kernel.
        #[test]
        fn the_error_is_that_of_all_pixels(
            particles in prop::collection::vec(((0.1..0.9_f32, 0.1..0.9_f32), -8.0..-3.0_f32, 0.8..1.25_f32, 0.9..1.1_f32), 1..5),
        ) {
            let pair = |&((x, y), octave, wider, heavier): &((f32, f32), f32, f32, f32)| Pair {
                place: [x, y, 0.5],
                own: [0.2, octave.exp2()],
                decoded: [0.2 * heavier, wider * octave.exp2()],
            };
            let pairs: Vec<Pair> = particles.iter().map(pair).collect();
            let (found, expected) = (picture().squares(NodeKey::ROOT, 1.0, pairs.iter().copied()), slow(&pairs));
            prop_assert!((found[1] / expected[1] - 1.0).abs() < 0.01, "{:?} {:?}", found, expected);
            prop_assert!((found[0] - expected[0]).abs() < 0.05 * expected[0] + 1e-6 * expected[1], "{:?} {:?}", found, expected);
        }
    }

    #[test]
    fn what_decodes_to_itself_has_no_error_wherever_it_lies() {
        let pair = |x: f32, h: f32| Pair { place: [x, x, 0.0], own: [1.0, h], decoded: [1.0, h] };
        let pairs = [pair(0.0, 1e-9), pair(0.999, 0.3), pair(0.5, 1e30), pair(0.2, f32::MIN_POSITIVE)];
        for key in [NodeKey::ROOT, NodeKey { depth: 3, x: 7, y: 0, z: 1 }] {
            let [difference, picture] = picture().squares(key, 4.0, pairs.iter().copied());
            assert!(difference == 0.0 && picture > 0.0 && picture.is_finite(), "{difference} {picture}");
        }
    }

    #[test]
    fn leaves_are_chosen_by_their_part_of_the_picture() {
        let leaf = |i: u32| (NodeKey { depth: 5, x: i % 32, y: i / 32, z: 0 }, f64::from(1 + i % 7));
        let few = picture().chosen((0..9).map(leaf));
        assert!(few.len() == 9 && few[3].1 == 16.0);
        let many = picture().chosen((0..900).map(leaf));
        assert!(many.len() <= DRAWN && many.len() > DRAWN / 2);
        // All squares together, by those that were chosen: the same for each of them is what the factors stand for.
        let area = 32.0 * 32.0;
        let times: f64 = many.iter().map(|(_, factor)| factor / area).sum();
        assert!((times - DRAWN as f64).abs() <= 1.0, "{times}");
        assert!(picture().chosen(std::iter::empty()).is_empty());
    }

    #[test]
    fn a_box_without_width_has_no_picture() {
        assert!(Picture::new(ROOT, Bounds { min: DVec3::ZERO, max: DVec3::Z }, Kernel::Poly6).is_none());
    }
}
