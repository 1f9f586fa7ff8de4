//! A picture of depths, as places and normals: what each pixel shows, and coarser pictures for what is seen from further away.

use crate::view::{Projection, View};
use glam::DVec3;

/// Pictures, each with half of the pixels along a side of the one before.
const LEVELS: usize = 5;

/// The depths of a view's picture. Places and directions are in camera space: right, up, depth.
pub(super) struct DepthPicture {
    /// The view.
    pub(super) view: View,
    middle: [f64; 2],
    focal: f64,
    is_perspective: bool,
    /// Level `k` has cells of `2^k` pixels along a side.
    levels: Vec<Level>,
}

/// What changes evenly from pixel to pixel of a plane: inverse depths in perspective, else depths; NaN where there is nothing. So the mean
/// of cells of a plane is the plane's own, and differences are its slopes.
struct Level {
    width: usize,
    height: usize,
    even: Vec<f64>,
}

impl Level {
    /// NaN outside, too.
    fn at(&self, x: isize, y: isize) -> f64 {
        let is_inside = (0..self.width as isize).contains(&x) && (0..self.height as isize).contains(&y);
        if is_inside { self.even[y as usize * self.width + x as usize] } else { f64::NAN }
    }

    /// The means of four cells each; NaN where one of them is.
    fn halved(&self) -> Level {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mean = |index: usize| {
            let [x, y] = [2 * (index % width), 2 * (index / width)].map(|at| at as isize);
            0.25 * (self.at(x, y) + self.at(x + 1, y) + self.at(x, y + 1) + self.at(x + 1, y + 1))
        };
        Level { width, height, even: (0..width * height).map(mean).collect() }
    }
}

impl DepthPicture {
    /// Of a picture of a view, row by row; `None` where there are not as many depths as pixels. What has no finite depth in front of the eye
    /// shows nothing.
    pub(super) fn new(view: &View, depths: &[f32]) -> Option<DepthPicture> {
        let (width, height) = (view.width as usize, view.height as usize);
        if depths.len() != width * height {
            return None;
        }
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let even = |depth: &f32| match f64::from(*depth) {
            depth if !depth.is_finite() => f64::NAN,
            depth if !is_perspective => depth,
            depth if depth > 0.0 => 1.0 / depth,
            _ => f64::NAN,
        };
        let mut levels = vec![Level { width, height, even: depths.iter().map(even).collect() }];
        while let Some(finest) = levels.last().filter(|_| levels.len() < LEVELS) {
            let coarser = finest.halved();
            levels.push(coarser);
        }
        let (middle, focal) = (view.middle(), view.focal_pixels());
        Some(DepthPicture { view: *view, middle, focal, is_perspective, levels })
    }

    /// Pixels along both sides.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.levels[0].width, self.levels[0].height]
    }

    /// Pixels of a length of 1 at a depth.
    pub(super) fn pixels_at(&self, depth: f64) -> f64 {
        if self.is_perspective { self.focal / depth } else { self.focal }
    }

    /// What is at pixel coordinates with such a value.
    fn place(&self, [x, y]: [f64; 2], even: f64) -> DVec3 {
        let (right, up) = ((x - self.middle[0]) / self.focal, (self.middle[1] - y) / self.focal);
        match self.is_perspective {
            true => DVec3::new(right, up, 1.0) / even,
            false => DVec3::new(right, up, even),
        }
    }

    /// What a pixel shows.
    pub(super) fn shown(&self, [x, y]: [usize; 2]) -> Option<DVec3> {
        let even = self.levels[0].at(x as isize, y as isize);
        (!even.is_nan()).then(|| self.place([x, y].map(|at| at as f64 + 0.5), even))
    }

    /// What is shown around a pixel, from the coarsest level up to `level` that knows it.
    pub(super) fn shown_around(&self, [x, y]: [isize; 2], level: usize) -> Option<DVec3> {
        (0..=level.min(LEVELS - 1)).rev().find_map(|level| {
            let cell = [x >> level, y >> level];
            let even = self.levels[level].at(cell[0], cell[1]);
            let side = (1 << level) as f64;
            (!even.is_nan()).then(|| self.place(cell.map(|at| (at as f64 + 0.5) * side), even))
        })
    }

    /// The direction from a place to the eye, a unit vector.
    pub(super) fn toward_eye(&self, place: DVec3) -> DVec3 {
        if self.is_perspective { -place.normalize_or_zero() } else { DVec3::NEG_Z }
    }

    /// Where a place goes in the picture when it moves in a direction: a unit vector, to the right and down. `None` along a line of sight.
    pub(super) fn across(&self, place: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let sight = if self.is_perspective { place / place.z } else { DVec3::Z };
        let [x, y] = [direction.x - sight.x * direction.z, sight.y * direction.z - direction.y];
        let length = x.hypot(y);
        (length > 0.0).then(|| [x / length, y / length])
    }

    /// The normal of what a pixel shows, towards the eye. `None` where neighbours do not tell it.
    pub(super) fn normal(&self, [x, y]: [usize; 2]) -> Option<DVec3> {
        let [x, y] = [x as isize, y as isize];
        let even = self.levels[0].at(x, y);
        let slopes = [self.slope([x, y], [1, 0])?, self.slope([x, y], [0, 1])?];
        let [right, up] = [self.focal * slopes[0], -self.focal * slopes[1]];
        let normal = match self.is_perspective {
            // On a plane `n p = 1` inverse depths are `n p / depth`.
            true => {
                let place = [x, y].map(|at| at as f64 + 0.5);
                let sight = [(place[0] - self.middle[0]) / self.focal, (self.middle[1] - place[1]) / self.focal];
                -DVec3::new(right, up, even - right * sight[0] - up * sight[1])
            }
            false => DVec3::new(right, up, -1.0),
        };
        normal.try_normalize()
    }

    /// The slope along an axis on the side that is the same surface: on which the pixel after the next continues it best.
    fn slope(&self, [x, y]: [isize; 2], [dx, dy]: [isize; 2]) -> Option<f64> {
        let at = |steps: isize| self.levels[0].at(x + steps * dx, y + steps * dy);
        let middle = at(0);
        let (before, after) = (middle - at(-1), at(1) - middle);
        let bends = [-1, 1].map(|side| (at(2 * side) - 2.0 * at(side) + middle).abs());
        match (before.is_nan(), after.is_nan()) {
            (true, true) => None,
            (true, false) => Some(after),
            (false, true) => Some(before),
            (false, false) => {
                let is_known = !(bends[0].is_nan() || bends[1].is_nan());
                let [first, second] = if is_known { bends } else { [before.abs(), after.abs()] };
                Some(if first < second { before } else { after })
            }
        }
    }
}
