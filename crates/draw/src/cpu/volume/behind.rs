//! What lies behind a picture (F12 5.7.2): for each pixel the depth at which it has become opaque, and a pyramid of the largest of
//! them, so that a few look-ups tell whether a node of the hierarchy is hidden. F12 asks after every slab whether pixels are opaque
//! already; depths say the same for all slabs at once, and outlive the picture, so that what is hidden needs no reading either.
//!
//! The picture may show less than there is while pages come in, or with fewer pixels. So what it hides is an estimate until a
//! picture of what was chosen with it hides the same; then nothing that could show is left out.

use crate::view::{Extent, Occluder, Projection, View};
use glam::DVec3;

/// How much further particles reach than their smoothing lengths at most: wide ones are interpolated from coarser grids
/// ([`super::coarse`]), through two cells of which 8 make a smoothing length, on every level.
const SPREAD: f64 = 1.5;

/// The depths at which a picture's pixels have become opaque.
#[derive(Clone, Debug, PartialEq)]
pub struct OpaqueDepths {
    view: View,
    /// Pixels around an extent that may show it, since samples are read around each pixel and small particles are enlarged.
    around: i64,
    /// What small particles are enlarged to, pixels.
    smallest: f64,
    /// Level 0 is the picture, each further one halves it, rounded up.
    levels: Vec<Level>,
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    depths: Vec<f32>,
}

impl OpaqueDepths {
    /// The depths of a picture of `view`, row by row (missing ones count as infinite), drawn with cells so many pixels wide and with
    /// particles that reach over `smallest` cells at least.
    pub fn new(view: &View, mut depths: Vec<f32>, cell: f64, smallest: f64) -> OpaqueDepths {
        let (width, height) = (view.width as usize, view.height as usize);
        depths.resize(width * height, f32::INFINITY);
        let mut levels = vec![Level { width, height, depths }];
        while let Some(fine) = levels.last().filter(|level| level.width > 1 || level.height > 1) {
            let (width, height) = (fine.width.div_ceil(2), fine.height.div_ceil(2));
            let at = |x: usize, y: usize| {
                let inside = x < fine.width && y < fine.height;
                if inside { fine.depths[y * fine.width + x] } else { f32::NEG_INFINITY }
            };
            let largest =
                |x: usize, y: usize| (0..4).map(|k| at(2 * x + k % 2, 2 * y + k / 2)).fold(f32::MIN, f32::max);
            let depths = (0..width * height).map(|index| largest(index % width, index / width)).collect();
            levels.push(Level { width, height, depths });
        }
        let around = 2 + ((2.0 + smallest) * cell).ceil() as i64;
        OpaqueDepths { view: *view, around, smallest: smallest * cell, levels }
    }

    /// What both hide, of two pictures of the same size.
    pub fn and(&self, other: &OpaqueDepths) -> Option<OpaqueDepths> {
        if self.view != other.view {
            return None;
        }
        let both = |(a, b): (&Level, &Level)| Level {
            width: a.width,
            height: a.height,
            depths: a.depths.iter().zip(&b.depths).map(|(&a, &b)| a.max(b)).collect(),
        };
        // The largest of largest ones is the largest of all.
        let levels = self.levels.iter().zip(&other.levels).map(both).collect();
        let (around, smallest) = (self.around.max(other.around), self.smallest.max(other.smallest));
        Some(OpaqueDepths { view: self.view, around, smallest, levels })
    }

    /// The view whose picture it is.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Whether no pixel is opaque.
    pub fn is_clear(&self) -> bool {
        self.levels[0].depths.iter().all(|depth| depth.is_infinite())
    }

    /// The largest depth of pixels of columns `x[0]..=x[1]` and rows `y[0]..=y[1]`, as far as they are in the picture, or more; `None`
    /// if none is. It is looked up where these are four by four or fewer.
    fn largest(&self, x: [i64; 2], y: [i64; 2]) -> Option<f32> {
        let size = [self.levels[0].width as i64, self.levels[0].height as i64];
        let clip = |[from, to]: [i64; 2], size: i64| [from.max(0), to.min(size - 1)];
        let ([left, right], [top, bottom]) = (clip(x, size[0]), clip(y, size[1]));
        if left > right || top > bottom {
            return None;
        }
        let fits = |shift: &usize| (right >> shift) - (left >> shift) < 4 && (bottom >> shift) - (top >> shift) < 4;
        let shift = (0..self.levels.len()).find(fits)?;
        let level = &self.levels[shift];
        let columns = (left >> shift) as usize..=(right >> shift) as usize;
        let rows = (top >> shift) as usize..=(bottom >> shift) as usize;
        rows.flat_map(|y| columns.clone().map(move |x| level.depths[y * level.width + x])).reduce(f32::max)
    }
}

impl Occluder for OpaqueDepths {
    /// Beside the picture counts as hidden too.
    fn hides(&self, extent: &Extent) -> bool {
        let view = &self.view;
        let nearest = view.nearest_depth(extent);
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let enlarged = self.smallest / view.focal_pixels() * if is_perspective { nearest.max(0.0) } else { 1.0 };
        let nearest = nearest - enlarged.max(SPREAD * extent.margin);
        if is_perspective && nearest <= 0.0 {
            return false;
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let reach = DVec3::splat(SPREAD * extent.margin);
        let (min, max) = (extent.bounds.min - reach, extent.bounds.max + reach);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] };
            let Some(pixel) = view.to_pixels(view.to_camera(DVec3::new(pick(0), pick(1), pick(2)))) else {
                return false;
            };
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis]);
                high[axis] = high[axis].max(pixel[axis]);
            }
        }
        // The casts saturate.
        let span = |axis: usize| {
            [
                (low[axis].floor() as i64).saturating_sub(self.around),
                (high[axis].ceil() as i64).saturating_add(self.around),
            ]
        };
        self.largest(span(0), span(1)).is_none_or(|depth| nearest > f64::from(depth))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Bounds;
    use proptest::prelude::*;

    fn view(width: u32, height: u32) -> View {
        let projection = Projection::Perspective { fov_y: 0.8 };
        View::look_at(DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO, DVec3::Y, projection, width, height).unwrap()
    }

    proptest! {
        /// Whatever is hidden lies behind every pixel that any point of it falls on.
        #[test]
        fn hides_only_what_is_behind_opaque_pixels(
            width in 1u32..50, height in 1u32..50,
            seed in prop::collection::vec(prop_oneof![5.0f32..12.0, Just(f32::INFINITY)], 2500),
            min in prop::array::uniform3(-4.0..4.0f64), size in 0.01..1.0f64, margin in 0.0..0.3f64,
            points in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 20),
        ) {
            let view = view(width, height);
            let depths: Vec<f32> = seed[..(width * height) as usize].to_vec();
            let opaque = OpaqueDepths::new(&view, depths.clone(), 1.0, 0.0);
            let min = DVec3::from(min);
            let extent = Extent { bounds: Bounds { min, max: min + size }, margin };
            if opaque.hides(&extent) {
                for point in points {
                    let place = min - margin + (size + 2.0 * margin) * DVec3::from(point);
                    let camera = view.to_camera(place);
                    let [x, y] = view.to_pixels(camera).unwrap();
                    if x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height) {
                        let depth = depths[(y as u32 * width + x as u32) as usize];
                        prop_assert!(camera.z > f64::from(depth) - margin - 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn extents_are_hidden_behind_what_has_been_drawn() {
        let view = view(128, 128);
        let half = (0..128 * 128).map(|i| if i % 128 < 64 { 10.0 } else { f32::INFINITY }).collect();
        let opaque = OpaqueDepths::new(&view, half, 1.0, 2.0);
        assert!(!opaque.is_clear() && OpaqueDepths::new(&view, Vec::new(), 1.0, 2.0).is_clear());
        let at = |x: f64, z: f64| Extent {
            bounds: Bounds { min: DVec3::new(x, -0.2, z), max: DVec3::new(x + 0.4, 0.2, z + 0.4) },
            margin: 0.1,
        };
        assert!(opaque.hides(&at(-2.0, -2.0)));
        assert!(!opaque.hides(&at(-2.0, 0.5)), "in front of what is opaque");
        assert!(!opaque.hides(&at(1.0, -2.0)), "behind clear pixels");
        assert!(!opaque.hides(&at(-0.2, -2.0)), "behind both");
        assert!(opaque.hides(&at(-90.0, -2.0)), "beside the picture");
        let other_half = (0..128 * 128).map(|i| if i % 128 >= 32 { 9.0 } else { f32::INFINITY }).collect();
        let both = opaque.and(&OpaqueDepths::new(&view, other_half, 1.0, 2.0)).unwrap();
        assert!(both.hides(&at(-1.6, -2.0)) && !both.hides(&at(-3.0, -2.0)) && !both.hides(&at(1.0, -2.0)));
        assert!(both.and(&OpaqueDepths::new(&self::view(32, 32), Vec::new(), 1.0, 2.0)).is_none());
    }
}
