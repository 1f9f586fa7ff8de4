//! A vector field on a slice as streaks: white noise, averaged along the field's lines (line integral convolution, Cabral and Leedom 1993).
//!
//! The noise of a pixel follows from its place alone, and what a pixel shows from the noise and the field: pictures are the same for any number of
//! threads, and from one time to the next.

use super::{Slice, mix};
use crate::model::mixing::{GOLDEN, mix_bits};
use rayon::prelude::*;
use std::f64::consts::PI;

/// How far a step along a line goes, pixels.
const STEP: f32 = 1.0;
/// Standard deviations of what was averaged that lie between the darkest streaks and the brightest.
const CONTRAST: f64 = 4.0;
/// What the darkest streaks leave of a colour, and how much of light the brightest add, linear light.
const DARKEST: f32 = 0.35;
const BRIGHTEST: f32 = 0.25;
/// Below this length a mean of directions is none.
const LEAST: f32 = 1e-3;

/// Streaks the colours of a slice; the averages reach over so many pixels.
pub fn streak(slice: &mut Slice, length: f64) {
    let shares = stretched(&averages(slice, length));
    for (pixel, share) in slice.pixels.iter_mut().zip(shares) {
        let Some(share) = share else { continue };
        // From -1 to 1; 0 leaves a colour as it is.
        let off = 2.0 * share - 1.0;
        pixel.color = match off > 0.0 {
            true => mix(pixel.color, [1.0; 3], BRIGHTEST * off),
            false => pixel.color.map(|light| light * (1.0 + (1.0 - DARKEST) * off)),
        };
    }
}

/// The noise at a pixel, even within [0, 1).
fn noise(x: usize, y: usize) -> f32 {
    let bits = mix_bits((x as u64 | (y as u64) << 32).wrapping_add(1).wrapping_mul(GOLDEN));
    (bits >> 40) as f32 / (1u32 << 24) as f32
}

/// The means of noise along the line of the field through each pixel's middle, weighted by a cosine bell (Hann's window) of that length in pixels;
/// `None` where the field has no direction.
pub fn averages(slice: &Slice, length: f64) -> Vec<Option<f32>> {
    let steps = (0.5 * length / f64::from(STEP)).floor().max(1.0) as usize;
    let weight = |step: usize| (0.5 + 0.5 * (PI * step as f64 / (steps + 1) as f64).cos()) as f32;
    let weights: Vec<f32> = (0..=steps).map(weight).collect();
    let width = slice.size[0];
    let average = |at: usize| {
        slice.pixels[at].has_direction().then(|| {
            let (x, y) = (at % width, at / width);
            let (mut sum, mut all) = (weights[0] * noise(x, y), weights[0]);
            for sign in [STEP, -STEP] {
                let mut place = [x as f32 + 0.5, y as f32 + 0.5];
                for weight in &weights[1..] {
                    let Some(next) = step(slice, place, sign) else { break };
                    place = next;
                    sum += weight * noise(place[0] as usize, place[1] as usize);
                    all += weight;
                }
            }
            sum / all
        })
    };
    (0..slice.pixels.len()).into_par_iter().map(average).collect()
}

/// A step along the field by the midpoint rule; `None` where it leaves the picture, or comes to where there is no direction.
fn step(slice: &Slice, [x, y]: [f32; 2], length: f32) -> Option<[f32; 2]> {
    let [right, down] = direction(slice, [x, y])?;
    let [right, down] = direction(slice, [x + 0.5 * length * right, y + 0.5 * length * down])?;
    let next = [x + length * right, y + length * down];
    pixel(slice, next).map(|_| next)
}

/// The pixel that holds a place of the picture.
fn pixel(slice: &Slice, [x, y]: [f32; 2]) -> Option<[usize; 2]> {
    let is_in = x >= 0.0 && y >= 0.0 && x < slice.size[0] as f32 && y < slice.size[1] as f32;
    is_in.then_some([x as usize, y as usize])
}

/// The direction at a place of the picture, of length 1: bilinear between the middles of pixels that have one, of which the place's own is one.
fn direction(slice: &Slice, place: [f32; 2]) -> Option<[f32; 2]> {
    let [width, height] = slice.size;
    let [x, y] = pixel(slice, place)?;
    if !slice.pixels[y * width + x].has_direction() {
        return None;
    }
    let axis = |at: f32, side: usize| {
        let at = (at - 0.5).clamp(0.0, (side - 1) as f32);
        let first = at as usize;
        [(first, 1.0 - at.fract()), ((first + 1).min(side - 1), at.fract())]
    };
    let columns = axis(place[0], width);
    let (mut right, mut down) = (0.0, 0.0);
    for (row, vertical) in axis(place[1], height) {
        for (column, horizontal) in columns {
            // Where there is none it is 0.
            let along = slice.pixels[row * width + column].along;
            right += vertical * horizontal * along[0];
            down += vertical * horizontal * along[1];
        }
    }
    let length = right.hypot(down);
    (length > LEAST).then(|| [right / length, down / length])
}

/// Averages from 0 to 1, their mean in the middle: what was averaged has next to no contrast.
fn stretched(averages: &[Option<f32>]) -> Vec<Option<f32>> {
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for value in averages.iter().flatten().map(|value| f64::from(*value)) {
        count += 1.0;
        sum += value;
        squares += value * value;
    }
    let mean = sum / count;
    let deviation = (squares / count - mean * mean).max(0.0).sqrt();
    let stretch = |value: f32| {
        let off = (f64::from(value) - mean) / (CONTRAST * deviation);
        // Of a single pixel there is no deviation.
        if off.is_finite() { (0.5 + off).clamp(0.0, 1.0) as f32 } else { 0.5 }
    };
    averages.iter().map(|value| value.map(stretch)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::SlicePixel;
    use super::*;

    const SIZE: [usize; 2] = [160, 140];

    fn slice(along: impl Fn(f32, f32) -> [f32; 2]) -> Slice {
        let pixel = |at: usize| {
            let [x, y] = [(at % SIZE[0]) as f32 + 0.5, (at / SIZE[0]) as f32 + 0.5];
            SlicePixel { alpha: 1.0, color: [0.2; 3], speed: 1.0, along: along(x, y), ..SlicePixel::NOTHING }
        };
        Slice { size: SIZE, pixels: (0..SIZE[0] * SIZE[1]).map(pixel).collect() }
    }

    /// Autocorrelation of averages at a distance of pixels.
    fn correlation(averages: &[Option<f32>], [right, down]: [usize; 2]) -> f64 {
        let value = |x: usize, y: usize| f64::from(averages[y * SIZE[0] + x].expect("an average"));
        let places = || (0..SIZE[1] - down).flat_map(|y| (0..SIZE[0] - right).map(move |x| (x, y)));
        let count = places().count() as f64;
        let mean = places().map(|(x, y)| value(x, y)).sum::<f64>() / count;
        let of = |right: usize, down: usize| {
            places().map(|(x, y)| (value(x, y) - mean) * (value(x + right, y + down) - mean)).sum::<f64>() / count
        };
        of(right, down) / of(0, 0)
    }

    /// Streaks of an even field go on along it, and have nothing to do with those beside them, whatever its direction.
    #[test]
    fn streaks_are_correlated_along_the_field_and_not_across_it() {
        let diagonal = std::f32::consts::FRAC_1_SQRT_2;
        let cases =
            [([1.0, 0.0], [5, 0], [0, 3]), ([0.0, -1.0], [0, 5], [3, 0]), ([diagonal, diagonal], [4, 4], [4, 0])];
        for (field, along, across) in cases {
            let averages = averages(&slice(|_, _| field), 24.0);
            let [along, across] = [along, across].map(|away| correlation(&averages, away));
            assert!(along > 0.5 && across.abs() < 0.2, "{field:?}: {along} {across}");
        }
    }

    /// The same bits from any number of threads; streaks of a turning field end nowhere but where it does; colours change about what they were.
    #[test]
    fn streaks_are_the_same_for_any_number_of_threads() {
        let field = slice(|x, y| {
            let [x, y] = [x - 80.0, y - 70.0];
            let radius = x.hypot(y);
            if radius > 60.0 { [0.0; 2] } else { [-y / radius, x / radius] }
        });
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut drawn = field.clone();
            pool.install(|| streak(&mut drawn, 30.0));
            drawn
        };
        let (one, three) = (by(1), by(3));
        let (mut brighter, mut darker) = (0, 0);
        for ((one, three), before) in one.pixels.iter().zip(&three.pixels).zip(&field.pixels) {
            assert_eq!(one.color.map(f32::to_bits), three.color.map(f32::to_bits));
            assert!(before.has_direction() || one.color == before.color, "nothing is drawn where there is no field");
            brighter += usize::from(one.color[0] > before.color[0]);
            darker += usize::from(one.color[0] < before.color[0]);
        }
        let most = brighter.max(darker) as f64;
        assert!(brighter.min(darker) as f64 > 0.8 * most && most > 4000.0, "{brighter} {darker}");
    }
}
