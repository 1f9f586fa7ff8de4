//! Lines of equal value on a slice, from the value of each pixel and how it changes from there to its neighbours.

use super::{LIGHT, Slice, SlicePixel, is_bright, mix};
use crate::cpu::surface::look::Contours;
use rayon::prelude::*;

/// What lines are in a pixel: their colour, and how much of it they cover.
pub type Line = ([f32; 3], f32);

/// The lines of each pixel, in colours that are seen on the slice's.
pub fn lines(slice: &Slice, contours: &Contours) -> Vec<Line> {
    let [width, height] = slice.size;
    let value = |x: usize, y: usize| {
        let value = f64::from(slice.pixels[y * width + x].value);
        value.is_finite().then_some(value)
    };
    let line = |(at, pixel): (usize, &SlicePixel)| {
        let (x, y) = (at % width, at / width);
        let ink = if is_bright(pixel.color) { contours.color } else { LIGHT };
        let Some(here) = value(x, y) else { return (ink, 0.0) };
        let left = x.checked_sub(1).and_then(|x| value(x, y));
        let above = y.checked_sub(1).and_then(|y| value(x, y));
        let right = if x + 1 < width { value(x + 1, y) } else { None };
        let below = if y + 1 < height { value(x, y + 1) } else { None };
        let steep = slope(left, here, right).hypot(slope(above, here, below));
        let nearest = contours.nearest(here);
        (ink, contours.share(nearest, (nearest - here).abs() / steep, steep, 1.0))
    };
    slice.pixels.par_iter().enumerate().map(line).collect()
}

/// Draws lines over the colours.
pub fn draw(slice: &mut Slice, lines: &[Line]) {
    for (pixel, (ink, share)) in slice.pixels.iter_mut().zip(lines) {
        pixel.color = mix(pixel.color, *ink, *share);
    }
}

/// The change of a value from a pixel to the next, by those of its neighbours that there are.
fn slope(before: Option<f64>, here: f64, after: Option<f64>) -> f64 {
    match (before, after) {
        (Some(before), Some(after)) => 0.5 * (after - before),
        (Some(before), None) => here - before,
        (None, Some(after)) => after - here,
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Lines of the square of the distance from a point are circles: no pixel of a line is further from one than half a line and half a pixel, and
    /// every point of a circle has a pixel of its line.
    #[test]
    fn lines_of_a_paraboloid_are_circles() {
        let (size, middle) = ([220usize, 170], [104.3, 81.8]);
        let width = 1.5;
        let contours = Contours { interval: 900.0, base: 100.0, major: 0, width, color: [1.0, 0.0, 0.0], labels: None };
        let pixel = |at: usize| {
            let (x, y) = ((at % size[0]) as f64 + 0.5 - middle[0], (at / size[0]) as f64 + 0.5 - middle[1]);
            SlicePixel { color: [0.5; 3], alpha: 1.0, value: x.mul_add(x, y * y) as f32, ..SlicePixel::NOTHING }
        };
        let slice = Slice { size, pixels: (0..size[0] * size[1]).map(pixel).collect() };
        let found = lines(&slice, &contours);
        let radius = |number: usize| (900.0 * number as f64 + 100.0).sqrt();
        for (at, (_, share)) in found.iter().enumerate() {
            let (x, y) = ((at % size[0]) as f64 + 0.5 - middle[0], (at / size[0]) as f64 + 0.5 - middle[1]);
            let away = (0..40).map(|number| (x.hypot(y) - radius(number)).abs()).fold(f64::INFINITY, f64::min);
            assert!(*share < 0.05 || away <= 0.5 * width + 0.5, "{x} {y}: {share} at {away}");
            assert!(*share > 0.95 || away > 0.5 * width - 0.5, "{x} {y}: {share} at {away}");
        }
        for (number, step) in (0..12).flat_map(|number| (0..720).map(move |step| (number, step))) {
            let angle = TAU * f64::from(step) / 720.0;
            let [x, y] = [middle[0] + radius(number) * angle.cos(), middle[1] + radius(number) * angle.sin()];
            if (0.0..size[0] as f64).contains(&x) && (0.0..size[1] as f64).contains(&y) {
                let share = found[y as usize * size[0] + x as usize].1;
                assert!(share > 0.4, "circle {number} at {x} {y}: {share}");
            }
        }
        let mut drawn = slice.clone();
        draw(&mut drawn, &found);
        let of_lines =
            drawn.pixels.iter().zip(&found).filter(|(pixel, (_, share))| (pixel.color[0] > 0.51) != (*share > 0.02));
        assert_eq!(of_lines.count(), 0, "lines are drawn in their colour where they are");
    }

    /// Nothing is drawn where there is nothing, and along its rim as within.
    #[test]
    fn lines_end_at_holes() {
        let size = [40usize, 30];
        let is_hole = |x: usize, y: usize| (10..20).contains(&x) && (5..15).contains(&y);
        let pixel = |at: usize| match is_hole(at % size[0], at / size[0]) {
            true => SlicePixel::NOTHING,
            false => SlicePixel { alpha: 1.0, value: (at % size[0]) as f32, ..SlicePixel::NOTHING },
        };
        let slice = Slice { size, pixels: (0..size[0] * size[1]).map(pixel).collect() };
        let contours = Contours { interval: 5.0, base: 0.0, major: 0, width: 1.0, color: [0.0; 3], labels: None };
        for (at, (_, share)) in lines(&slice, &contours).into_iter().enumerate() {
            let (x, y) = (at % size[0], at / size[0]);
            let is_line = x % 5 == 0 && !is_hole(x, y);
            assert!(if is_line { share > 0.9 } else { share < 0.1 }, "{x} {y}: {share}");
        }
    }
}
