//! What of paths, measured surfaces or volumes is in each pixel: fragments from front to back.

use crate::color::Colors;
use crate::color::colors::{to_encoded, to_linear};
use crate::color::composite::Image;
use crate::view::View;
use rayon::prelude::*;

/// Most pixels along the side of a tile of what is merged, so that tiles are worth sharing out.
const TILE: usize = 64;

/// A part of a path, a surface or a volume in a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathFragment {
    /// Distance from the plane of the eye, world units.
    pub depth: f32,
    /// Its light, linear, as if it were opaque.
    pub color: [f32; 3],
    /// Opacity.
    pub alpha: f32,
}

/// The fragments of a square of pixels.
#[derive(Clone, Debug, Default)]
pub struct TileFragments {
    /// The first fragment of each pixel, row by row, and one more at the end.
    pub starts: Vec<u32>,
    /// Fragments, those of a pixel from front to back.
    pub fragments: Vec<PathFragment>,
}

/// The fragments of a picture.
#[derive(Clone, Debug, Default)]
pub struct PathFragments {
    /// Pixels.
    pub size: [usize; 2],
    /// Pixels along a tile's side.
    pub side: usize,
    /// The tiles, row by row; a tile without fragments may be empty.
    pub tiles: Vec<TileFragments>,
    /// Whether none of them is a surface: they stand for what is seen through, which has no edge that a small splat could show.
    pub is_hazy: bool,
}

impl PathFragments {
    /// A view's picture without any.
    pub fn nothing(view: &View) -> PathFragments {
        PathFragments { is_hazy: true, ..PathFragments::everywhere([view.width as usize, view.height as usize], &[]) }
    }

    /// A picture with the same fragments in every pixel, from front to back.
    pub fn everywhere(size: [usize; 2], fragments: &[PathFragment]) -> PathFragments {
        let pixels = size[0] * size[1];
        let starts = (0..=pixels).map(|pixel| (pixel * fragments.len()) as u32).collect();
        let all = TileFragments { starts, fragments: fragments.repeat(pixels) };
        // One tile, as wide as the picture.
        PathFragments { size, side: size[0].max(size[1]), tiles: vec![all], is_hazy: false }
    }

    /// Those of a pixel, from front to back.
    #[inline]
    pub fn of(&self, x: usize, y: usize) -> &[PathFragment] {
        let across = self.size[0].div_ceil(self.side.max(1));
        let Some(tile) = self.tiles.get(y / self.side.max(1) * across + x / self.side.max(1)) else { return &[] };
        let [left, top] = [x / self.side * self.side, y / self.side * self.side];
        let width = self.side.min(self.size[0] - left);
        let pixel = (y - top) * width + (x - left);
        match tile.starts.get(pixel..pixel + 2) {
            Some(ends) => tile.fragments.get(ends[0] as usize..ends[1] as usize).unwrap_or(&[]),
            None => &[],
        }
    }

    /// Both: in each pixel the fragments of one and of the other, from front to back; of equal ones those of this one first. Pictures have the
    /// same size.
    #[must_use]
    pub fn merged(&self, other: &PathFragments) -> PathFragments {
        let ([width, height], side) = (self.size, self.side.clamp(1, TILE));
        let [across, down] = self.size.map(|pixels| pixels.div_ceil(side));
        let tile = |index: usize| {
            let (left, top) = (index % across * side, index / across * side);
            let mut tile = TileFragments { starts: vec![0], fragments: Vec::new() };
            for y in top..(top + side).min(height) {
                for x in left..(left + side).min(width) {
                    let (mut own, mut others) = (self.of(x, y), other.of(x, y));
                    while let ([first, rest @ ..], [next, ..]) = (own, others) {
                        if first.depth <= next.depth {
                            tile.fragments.push(*first);
                            own = rest;
                        } else {
                            tile.fragments.push(*next);
                            others = &others[1..];
                        }
                    }
                    tile.fragments.extend_from_slice(own);
                    tile.fragments.extend_from_slice(others);
                    tile.starts.push(tile.fragments.len() as u32);
                }
            }
            tile
        };
        let tiles = (0..across * down).into_par_iter().map(tile).collect();
        PathFragments { size: self.size, side, tiles, is_hazy: self.is_hazy && other.is_hazy }
    }

    /// Makes lengths so many times longer.
    pub fn scale_depths(&mut self, scale: f64) {
        if scale != 1.0 {
            let all = self.tiles.iter_mut().flat_map(|tile| &mut tile.fragments);
            all.for_each(|fragment| fragment.depth = (f64::from(fragment.depth) * scale) as f32);
        }
    }

    /// Their colours as far as what `hides` them lets them through: what is in front of each of them takes its share.
    pub fn colors_behind(&self, hides: &PathFragments) -> Colors {
        let [width, height] = self.size;
        let pixel = |index: usize| {
            let (x, y) = (index % width, index / width);
            let hides = hides.of(x, y);
            let mut sum = [0.0f32; 4];
            for fragment in self.of(x, y) {
                let share = (1.0 - sum[3]) * fragment.alpha * visible(hides, fragment.depth);
                for (sum, color) in sum.iter_mut().zip(fragment.color) {
                    *sum += share * color;
                }
                sum[3] += share;
            }
            sum
        };
        let rgba = (0..width * height).into_par_iter().map(pixel).collect();
        Colors { width: width as u32, height: height as u32, rgba }
    }

    /// The paths alone: each pixel's fragments over one another, before nothing.
    pub fn colors(&self) -> Colors {
        let [width, height] = self.size;
        let pixel = |index: usize| over(self.of(index % width, index / width));
        let rgba = (0..width * height).into_par_iter().map(pixel).collect();
        Colors { width: width as u32, height: height as u32, rgba }
    }
}

/// Fragments over one another: premultiplied light and opacity.
pub fn over(fragments: &[PathFragment]) -> [f32; 4] {
    let mut sum = [0.0f32; 4];
    for fragment in fragments {
        let share = (1.0 - sum[3]) * fragment.alpha;
        for (sum, color) in sum.iter_mut().zip(fragment.color) {
            *sum += share * color;
        }
        sum[3] += share;
    }
    sum
}

/// The share of what is at a depth that these fragments, from front to back, let through.
#[inline]
pub fn visible(fragments: &[PathFragment], depth: f32) -> f32 {
    let in_front = fragments.iter().take_while(|fragment| fragment.depth < depth);
    in_front.fold(1.0, |through, fragment| through * (1.0 - fragment.alpha))
}

/// Lays paths over a picture in light of the same size.
pub fn lay_over_colors(paths: &Colors, below: &mut Colors) {
    below.rgba.par_iter_mut().zip(&paths.rgba).for_each(|(below, over)| {
        for (below, over) in below.iter_mut().zip(over.iter().copied().zip([1.0 - over[3]; 4])) {
            *below = over.0 + over.1 * *below;
        }
    });
}

/// Lays paths over a finished picture of the same size, in linear light.
pub fn lay_over(paths: &Colors, image: &mut Image) {
    image.rgba.par_iter_mut().zip(&paths.rgba).for_each(|(below, &[r, g, b, alpha])| {
        if alpha <= 0.0 {
            return;
        }
        let under = f32::from(below[3]) / 255.0 * (1.0 - alpha);
        let whole = alpha + under;
        for (below, over) in below.iter_mut().zip([r, g, b]) {
            let light = (over + under * to_linear(f32::from(*below) / 255.0)) / whole.max(1e-6);
            *below = (255.0 * to_encoded(light.clamp(0.0, 1.0))).round() as u8;
        }
        below[3] = (255.0 * whole).round() as u8;
    });
}
