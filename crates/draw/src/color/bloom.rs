//! Bloom: a part of very bright light spreads over its surroundings, as in an eye or a lens. Stars that a screen shows as equal spots of white differ
//! by their glow.
//!
//! Light is taken to ever coarser levels, each with half the pixels along an axis, and back again. Back, a pixel is interpolated between its
//! four nearest coarse ones; on the way there each pixel gives its light to the same four by the same weights. So no light is lost or made,
//! whatever the size and at every edge, an even picture stays even, and a glow's centre of mass is where its light came from.

use super::Colors;
use super::composite::Image;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// How bright light spreads.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bloom {
    /// Share of bright light that spreads, from 0 (off) to 1.
    pub strength: f64,
    /// Light that stays where it is, linear; 1 is the brightest that a screen shows.
    pub threshold: f64,
    /// How far light spreads, as a share of the picture's height.
    pub radius: f64,
}

impl Default for Bloom {
    fn default() -> Bloom {
        Bloom { strength: 0.0, threshold: 0.5, radius: 0.1 }
    }
}

/// Values of [`Bloom::strength`].
pub const STRENGTHS: RangeInclusive<f64> = 0.0..=1.0;
/// Values of [`Bloom::threshold`].
pub const THRESHOLDS: RangeInclusive<f64> = 0.0..=16.0;
/// Values of [`Bloom::radius`].
pub const RADII: RangeInclusive<f64> = 0.001..=1.0;

/// A part of a picture within which light spreads, such as one eye's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Left, top, width and height, pixels.
    pub area: [u32; 4],
    /// Whether its left and right edges are one.
    pub wraps: bool,
    /// Whether only the disc in its middle is seen, as of a dome.
    pub is_round: bool,
}

impl Part {
    /// All of a flat picture.
    pub fn whole(width: u32, height: u32) -> Part {
        Part { area: [0, 0, width, height], wraps: false, is_round: false }
    }
}

impl Bloom {
    /// Whether nothing spreads.
    pub fn is_off(&self) -> bool {
        self.strength <= 0.0
    }

    /// Its values bit by bit, which are compared whatever they are.
    pub fn bits(&self) -> [u64; 3] {
        [self.strength, self.threshold, self.radius].map(f64::to_bits)
    }

    /// A value out of its range, if there is one: its field, what was found and what is expected.
    pub fn mistake(&self) -> Option<(&'static str, String, String)> {
        let all = [
            ("strength", self.strength, STRENGTHS),
            ("threshold", self.threshold, THRESHOLDS),
            ("radius", self.radius, RADII),
        ];
        let (field, found, range) = all.into_iter().find(|(_, value, range)| !range.contains(value))?;
        Some((field, found.to_string(), format!("a number from {} to {}", range.start(), range.end())))
    }

    /// Between two of them, at a share of the way.
    #[must_use]
    pub fn mixed(self, other: Bloom, share: f64) -> Bloom {
        let between = |a: f64, b: f64| a + (b - a) * share;
        Bloom {
            strength: between(self.strength, other.strength),
            threshold: between(self.threshold, other.threshold),
            radius: between(self.radius, other.radius),
        }
    }

    /// The levels that the light of a part of this width and height, pixels, goes through.
    pub fn pyramid(&self, size: [usize; 2], wraps: bool) -> Pyramid {
        Pyramid::new(size, wraps, self.radius * size[1] as f64)
    }

    /// Spreads the light of a flat picture.
    pub fn spread(&self, light: &mut Colors) {
        self.spread_in(light, &Part::whole(light.width, light.height));
    }

    /// Spreads light within a part of a picture; nothing where that is not in the picture.
    pub fn spread_in(&self, light: &mut Colors, part: &Part) {
        let [left, top, width, height] = part.area.map(|pixels| pixels as usize);
        let stride = light.width as usize;
        if self.is_off() || width == 0 || height == 0 || left + width > stride || top + height > light.height as usize {
            return;
        }
        let rows = |y: usize| (top + y) * stride + left..(top + y) * stride + left + width;
        let own = *self;
        let values = (0..height).into_par_iter();
        let values = values.flat_map_iter(|y| light.rgba[rows(y)].iter().map(move |&pixel| own.bright(pixel)));
        let bright = Plane { width, values: values.collect() };
        let glow = glow(&bright, &self.pyramid([width, height], part.wraps));
        let strength = self.strength as f32;
        let lit = light.rgba[top * stride..(top + height) * stride].par_chunks_mut(stride);
        lit.enumerate().for_each(|(y, row)| {
            let row = &mut row[left..left + width];
            let at = y * width..(y + 1) * width;
            let changes = bright.values[at.clone()].iter().zip(&glow.values[at]);
            for (x, (pixel, (from, to))) in row.iter_mut().zip(changes).enumerate() {
                if part.is_round && !is_in_disc([x, y], [width, height]) {
                    continue;
                }
                for k in 0..3 {
                    pixel[k] += strength * (to[k] - from[k]);
                }
                // Before a transparent background glow is seen as far as it shines.
                pixel[3] = pixel[3].max(pixel[0].max(pixel[1]).max(pixel[2]).min(1.0));
            }
        });
    }

    /// Light of a flat picture on a screen, before black.
    pub fn image(&self, light: &Colors) -> Image {
        if self.is_off() {
            return light.image();
        }
        let mut light = light.clone();
        self.spread(&mut light);
        light.fit_screen();
        light.image()
    }

    /// Spreads the light of a finished flat picture, of which nothing is brighter than the screen.
    pub fn spread_image(&self, image: &mut Image) {
        if self.is_off() {
            return;
        }
        *image = self.image(&Colors::of_image(image));
    }

    /// What of a pixel's light spreads where all of what is bright does.
    fn bright(&self, [r, g, b, _]: [f32; 4]) -> [f32; 3] {
        // One that is no number would be everywhere.
        let [r, g, b] = [r, g, b].map(|light| if light.is_finite() { light } else { 0.0 });
        let most = r.max(g).max(b);
        let share = if most > 0.0 { ((most - self.threshold as f32) / most).max(0.0) } else { 0.0 };
        [r, g, b].map(|light| share * light)
    }
}

/// Whether a pixel's middle lies in the disc in the middle of a part.
fn is_in_disc(at: [usize; 2], size: [usize; 2]) -> bool {
    let away = [0, 1].map(|k| at[k] as f64 + 0.5 - 0.5 * size[k] as f64);
    away[0].hypot(away[1]) <= 0.5 * size[0].min(size[1]) as f64
}

/// Light, row after row.
struct Plane {
    width: usize,
    values: Vec<[f32; 3]>,
}

impl Plane {
    /// The light of pixels in some rows and columns, each by its weight.
    fn sum(&self, rows: &[(usize, f32)], columns: &[(usize, f32)]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for &(y, part) in rows {
            for &(x, weight) in columns {
                let value = self.values[y * self.width + x];
                (0..3).for_each(|k| sum[k] += part * weight * value[k]);
            }
        }
        sum
    }
}

/// How the pixels along an axis give light to coarser ones, and take it back.
pub struct Axis {
    /// For each pixel the coarse ones around it, and their weights.
    pub around: Vec<[(usize, f32); 2]>,
    /// For each coarse pixel those around it, four at most, with weights times their sizes.
    pub from: Vec<Vec<(usize, f32)>>,
    /// How many of the picture's pixels each coarse one stands for.
    pub sizes: Vec<f32>,
}

impl Axis {
    /// From pixels of these sizes to half as many.
    fn halved(sizes: &[f32], wraps: bool) -> Axis {
        let coarse = sizes.len().div_ceil(2);
        let mut axis =
            Axis { around: Vec::with_capacity(sizes.len()), from: vec![Vec::new(); coarse], sizes: vec![0.0; coarse] };
        for (x, size) in sizes.iter().enumerate() {
            // The middle of a pixel is a quarter of a coarse one from the middle of its own.
            let right = x.div_ceil(2);
            let share = if x.is_multiple_of(2) { 0.75 } else { 0.25 };
            let (first, last) = (if wraps { coarse - 1 } else { 0 }, if wraps { 0 } else { coarse - 1 });
            let left = right.checked_sub(1).unwrap_or(first);
            let right = if right < coarse { right } else { last };
            let around = [(left, 1.0 - share), (right, share)];
            for (index, weight) in around {
                axis.from[index].push((x, weight * size));
                axis.sizes[index] += weight * size;
            }
            axis.around.push(around);
        }
        axis
    }
}

/// The levels that light goes through, each with half the pixels along an axis.
pub struct Pyramid {
    /// How each level's pixels across and along take light from the level before, which is the picture for the first.
    pub axes: Vec<[Axis; 2]>,
    /// The share of light that spreads on each level: equal ones, so that it falls off about as the distance's square.
    pub shares: Vec<f32>,
}

impl Pyramid {
    /// Levels for light that spreads by up to `radius` pixels.
    fn new(size: [usize; 2], wraps: bool, radius: f64) -> Pyramid {
        // The last level has a part of its share, so that a glow grows evenly with its radius.
        let depth = radius.log2().max(1.0);
        let levels = depth.ceil() as usize;
        let shares = (0..levels).map(|level| (depth - level as f64).min(1.0) / depth).map(|share| share as f32);
        let mut sizes = size.map(|pixels| vec![1.0f32; pixels]);
        let axes = (0..levels).map(|_| {
            let halved = [Axis::halved(&sizes[0], wraps), Axis::halved(&sizes[1], false)];
            sizes = halved.each_ref().map(|axis| axis.sizes.clone());
            halved
        });
        Pyramid { axes: axes.collect(), shares: shares.collect() }
    }
}

/// Light at half the resolution.
fn down(fine: &Plane, [across, along]: &[Axis; 2]) -> Plane {
    let rows = along.from.par_iter().zip(&along.sizes).map(|(rows, height)| {
        let columns = across.from.iter().zip(&across.sizes);
        let row = columns.map(|(columns, width)| fine.sum(rows, columns).map(|light| light / (width * height)));
        row.collect::<Vec<_>>()
    });
    Plane { width: across.sizes.len(), values: rows.collect::<Vec<_>>().concat() }
}

/// Light at twice the resolution.
fn up(coarse: &Plane, [across, along]: &[Axis; 2]) -> Plane {
    let rows = along.around.par_iter();
    let rows = rows.map(|rows| across.around.iter().map(|columns| coarse.sum(rows, columns)).collect::<Vec<_>>());
    Plane { width: across.around.len(), values: rows.collect::<Vec<_>>().concat() }
}

/// Light that has spread.
fn glow(bright: &Plane, pyramid: &Pyramid) -> Plane {
    let mut planes: Vec<Plane> = Vec::with_capacity(pyramid.axes.len());
    for axes in &pyramid.axes {
        let coarser = down(planes.last().unwrap_or(bright), axes);
        planes.push(coarser);
    }
    // What is on coarser levels, at the resolution of the level.
    let mut spread: Option<Plane> = None;
    for ((mut own, axes), &share) in planes.into_iter().zip(&pyramid.axes).zip(&pyramid.shares).rev() {
        let below = spread.take();
        own.values.par_iter_mut().enumerate().for_each(|(index, value)| {
            let coarser = below.as_ref().map_or([0.0; 3], |below| below.values[index]);
            *value = std::array::from_fn(|k| share * value[k] + coarser[k]);
        });
        spread = Some(up(&own, axes));
    }
    // There is a level at least.
    spread.unwrap_or_else(|| Plane { width: bright.width, values: vec![[0.0; 3]; bright.values.len()] })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Bloom = Bloom { strength: 1.0, threshold: 0.0, radius: 0.25 };

    fn black(width: u32, height: u32) -> Colors {
        Colors { width, height, rgba: vec![[0.0, 0.0, 0.0, 1.0]; (width * height) as usize] }
    }

    fn sum(light: &Colors, k: usize) -> f64 {
        light.rgba.iter().map(|pixel| f64::from(pixel[k])).sum()
    }

    #[test]
    fn light_is_neither_lost_nor_made() {
        for (width, height) in [(64, 64), (61, 37), (1, 9), (50, 2)] {
            for wraps in [false, true] {
                let mut light = black(width, height);
                // Stars of many magnitudes everywhere, at edges and corners too.
                for (i, pixel) in light.rgba.iter_mut().enumerate() {
                    let star = if i.is_multiple_of(7) { 1.5f32.powi((i % 13) as i32 - 6) } else { 0.0 };
                    *pixel = [star, 0.5 * star, 0.25, 1.0];
                }
                let before = light.clone();
                let bloom = Bloom { strength: 0.6, threshold: 0.3, radius: 0.4 };
                bloom.spread_in(&mut light, &Part { wraps, ..Part::whole(width, height) });
                assert_ne!(light, before);
                for k in 0..3 {
                    let ratio = sum(&light, k) / sum(&before, k);
                    assert!((ratio - 1.0).abs() < 1e-4, "{width}x{height}, {wraps}, {k}: {ratio}");
                }
                // An even picture stays even up to its edges.
                let mut even = black(width, height);
                even.rgba.fill([0.7, 0.7, 0.7, 1.0]);
                ALL.spread_in(&mut even, &Part { wraps, ..Part::whole(width, height) });
                assert!(even.rgba.iter().all(|pixel| (pixel[0] - 0.7).abs() < 1e-5), "{width}x{height}, {wraps}");
            }
        }
    }

    #[test]
    fn a_star_glows_around_itself() {
        // In the middle of the coarsest pixels' corner everything is mirrored exactly.
        let side = 64;
        let mut light = black(side, side);
        for index in [31 * 64 + 31, 31 * 64 + 32, 32 * 64 + 31, 32 * 64 + 32] {
            light.rgba[index] = [4.0, 4.0, 4.0, 1.0];
        }
        ALL.spread(&mut light);
        let at = |x: u32, y: u32| light.rgba[(y * side + x) as usize][0];
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            for other in [at(side - 1 - x, y), at(x, side - 1 - y), at(y, x)] {
                assert!((at(x, y) - other).abs() <= 1e-5 * at(31, 31), "{x} {y}");
            }
        }
        assert!(at(33, 32) > at(36, 32) && at(36, 32) > at(40, 32) && at(40, 32) > 0.0);
        // Anywhere else the centre of mass is the star, whatever pixel it lies on.
        for (x, y) in [(97, 110), (98, 111), (100, 103)] {
            let mut light = black(200, 200);
            light.rgba[y * 200 + x] = [1.0; 4];
            Bloom { radius: 0.06, ..ALL }.spread(&mut light);
            let mass = sum(&light, 0);
            let center = |place: &dyn Fn(usize) -> usize| {
                let places = light.rgba.iter().enumerate();
                places.map(|(i, pixel)| f64::from(pixel[0]) * place(i) as f64).sum::<f64>() / mass
            };
            let found = [center(&|i| i % 200), center(&|i| i / 200)];
            assert!((found[0] - x as f64).abs() < 1e-3 && (found[1] - y as f64).abs() < 1e-3, "{found:?}");
        }
    }

    #[test]
    fn what_is_no_number_spreads_nowhere() {
        let mut light = black(20, 10);
        let broken = 45;
        light.rgba[broken] = [f32::NAN, f32::INFINITY, 0.0, 1.0];
        light.rgba[46] = [4.0, 4.0, 4.0, 1.0];
        ALL.spread(&mut light);
        let is_known = |pixel: &[f32; 4]| pixel.iter().all(|value| value.is_finite());
        assert!(light.rgba.iter().enumerate().all(|(index, pixel)| index == broken || is_known(pixel)));
        assert!(light.rgba[47][0] > 0.0);
    }

    #[test]
    fn parts_have_their_own_light_and_seams_have_none() {
        let mut light = black(64, 32);
        light.rgba[16 * 64] = [1.0; 4];
        let mut eyes = light.clone();
        let eye = Part { area: [0, 0, 32, 32], wraps: false, is_round: true };
        ALL.spread_in(&mut eyes, &eye);
        assert!(eyes.rgba.chunks(64).all(|row| row[32..].iter().all(|pixel| pixel[0] == 0.0)));
        // The first pixel of the middle row lies on the rim; corners of a dome stay black.
        assert!(eyes.rgba[16 * 64 + 4][0] > 0.0 && eyes.rgba[0][0] == 0.0);
        ALL.spread_in(&mut light, &Part { wraps: true, ..Part::whole(64, 32) });
        // The pixel across the seam is as near as the one beside it.
        let [beside, across] = [light.rgba[16 * 64 + 1][0], light.rgba[16 * 64 + 63][0]];
        assert!(across > 0.3 * beside, "{across} {beside}");
        let off = light.clone();
        Bloom::default().spread(&mut light);
        assert_eq!(light, off);
    }
}
