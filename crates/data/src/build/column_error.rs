//! How far pictures of column density are from the source's by the codes of leaves alone.
//!
//! Both pictures, of the whole box along z, are sums over leaves, and codes err independently from leaf to leaf as near as matters. So the
//! squares of the difference and of the picture are summed leaf by leaf, each as if it were alone. What leaves that lie behind one another
//! have in common adds to the picture alone, so that the error comes out too large, by 8 to 18 % on generated boxes. Of many leaves some are
//! chosen, more often those that a picture has more of, which scatters the error by a third or so.

use crate::hierarchy::{NodeKey, RootCell};
use crate::model::{Bounds, Kernel};

/// Pixels along the longer side of the picture.
const PIXELS: usize = 1024;
/// Resolutions that kernels are drawn with, each half of that before it; windows are multiples of the coarsest one's pixels.
const LEVELS: usize = 8;
const COARSEST: usize = 1 << (LEVELS - 1);
/// The coarsest resolution is taken at which a kernel's radius still has at least half of so many pixels.
const RADIUS: f32 = 6.0;
/// Narrower kernels are drawn as if they had this radius, pixels: the grid cannot tell them apart.
const LEAST_RADIUS: f32 = 1.5;
/// Steps of the square of the distance in the kernel's table.
const STEPS: usize = 512;
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
    /// The projected kernel over equal steps of the square of the distance, with a radius of 1; its end is 0.
    kernel: Vec<f32>,
}

impl Picture {
    /// Of particles in a box; `None` where that has no width.
    pub fn new(root: RootCell, bounds: Bounds, kernel: Kernel) -> Option<Picture> {
        let size = bounds.size();
        let pixel = size.x.max(size.y) / PIXELS as f64;
        let value = |step: usize| kernel.projected((step as f64 / STEPS as f64).sqrt()) as f32;
        // Beyond the end there is nothing, and a step that interpolates it needs that twice.
        let kernel = (0..STEPS).map(value).chain([0.0; 2]).collect();
        let picture = Picture { root, corner: [bounds.min.x, bounds.min.y], pixel, kernel };
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
    pub fn squares(&self, key: NodeKey, mass: f64, particles: impl Iterator<Item = Pair> + Clone) -> [f64; 2] {
        let (size, min) = (key.size(self.root) / self.pixel, key.min(self.root));
        let corner = [(min.x - self.corner[0]) / self.pixel, (min.y - self.corner[1]) / self.pixel];
        let place = |pair: &Pair| [0, 1].map(|axis| (corner[axis] + f64::from(pair.place[axis]) * size) as f32);
        let radii = |pair: &Pair| [pair.own[1], pair.decoded[1]].map(|h| (f64::from(h) / self.pixel) as f32);
        let reach = |pair: &Pair| radii(pair).into_iter().fold(LEAST_RADIUS, f32::max);
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for pair in particles.clone() {
            let (place, reach) = (place(&pair), reach(&pair));
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis] - reach);
                high[axis] = high[axis].max(place[axis] + reach);
            }
        }
        // Casts saturate: what lies outside the picture is cut off.
        let first = low.map(|low| (low as usize).min(PIXELS - 1) / COARSEST * COARSEST);
        let last = high.map(|high| (high as usize).min(PIXELS - 1) / COARSEST * COARSEST + COARSEST);
        let mut window =
            Window::new([last[0].max(first[0] + COARSEST) - first[0], last[1].max(first[1] + COARSEST) - first[1]]);
        for pair in particles {
            let place = place(&pair);
            let masses = [pair.own[0], pair.decoded[0]].map(|m| (f64::from(m) / mass) as f32);
            window.draw([place[0] - first[0] as f32, place[1] - first[1] as f32], radii(&pair), masses, &self.kernel);
        }
        window.squares()
    }
}

/// A part of the picture at all resolutions: what the source has, and what codes add to it.
struct Window {
    size: [usize; 2],
    levels: Vec<Vec<[f32; 2]>>,
}

impl Window {
    fn new(size: [usize; 2]) -> Window {
        let level = |level: usize| vec![[0.0; 2]; (size[0] >> level) * (size[1] >> level)];
        Window { size, levels: (0..LEVELS).map(level).collect() }
    }

    /// Adds a particle with this radius and mass, and the difference to it with the others.
    fn draw(&mut self, place: [f32; 2], radii: [f32; 2], masses: [f32; 2], kernel: &[f32]) {
        let (mut level, mut scale) = (0, 1.0);
        while radii[0] * scale >= RADIUS && level + 1 < LEVELS {
            (level, scale) = (level + 1, 0.5 * scale);
        }
        let radii = radii.map(|radius| (radius * scale).max(LEAST_RADIUS));
        let steps = radii.map(|radius| STEPS as f32 / (radius * radius));
        // Mass over area, of the finest pixels.
        let heights = [0, 1].map(|k| masses[k] * scale * scale / (radii[k] * radii[k]));
        let place = place.map(|x| x * scale);
        let reach = radii[0].max(radii[1]);
        let [columns, rows] = self.size.map(|size| size >> level);
        // Casts saturate here, too.
        let range = |x: f32, size: usize| (x - reach) as usize..((x + reach) as usize).min(size - 1) + 1;
        let value = |k: usize, square: f32| {
            let at = (square * steps[k]).min(STEPS as f32);
            let step = at as usize;
            let share = at - step as f32;
            heights[k] * (kernel[step] + share * (kernel[step + 1] - kernel[step]))
        };
        for row in range(place[1], rows) {
            let up = (row as f32 + 0.5 - place[1]).powi(2);
            for column in range(place[0], columns) {
                let square = up + (column as f32 + 0.5 - place[0]).powi(2);
                let [own, decoded] = [0, 1].map(|k| value(k, square));
                let pixel = &mut self.levels[level][row * columns + column];
                *pixel = [pixel[0] + (decoded - own), pixel[1] + own];
            }
        }
    }

    /// The sums of squares of the difference and of the picture over the finest pixels.
    fn squares(mut self) -> [f64; 2] {
        for level in (1..LEVELS).rev() {
            let (finer, coarser) = self.levels.split_at_mut(level);
            let (Some(fine), Some(coarse)) = (finer.last_mut(), coarser.first()) else { continue };
            let (width, half) = (self.size[0] >> (level - 1), self.size[0] >> level);
            for (row, pixels) in fine.chunks_exact_mut(width).enumerate() {
                let above = &coarse[row / 2 * half..][..half];
                for (column, pixel) in pixels.iter_mut().enumerate() {
                    let more = above[column / 2];
                    *pixel = [pixel[0] + more[0], pixel[1] + more[1]];
                }
            }
        }
        self.levels[0].iter().fold([0.0; 2], |sum, pixel| [0, 1].map(|k| sum[k] + f64::from(pixel[k]).powi(2)))
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

    /// The same sums by all pixels of all particles.
    fn slow(pairs: &[Pair]) -> [f64; 2] {
        let mut pixels = vec![[0.0; 2]; PIXELS * PIXELS];
        for pair in pairs {
            for (k, [mass, h]) in [pair.own, pair.decoded].into_iter().enumerate() {
                let radius = f64::from(h) * PIXELS as f64;
                let at = |axis: usize| f64::from(pair.place[axis]) * PIXELS as f64;
                for (i, pixel) in pixels.iter_mut().enumerate() {
                    let (x, y) = ((i % PIXELS) as f64 + 0.5 - at(0), (i / PIXELS) as f64 + 0.5 - at(1));
                    let value =
                        f64::from(mass) * Kernel::CubicSpline.projected(x.hypot(y) / radius) / (radius * radius);
                    pixel[k] += value;
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
