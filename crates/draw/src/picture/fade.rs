//! A picture that blends into another, as one sees them: in gamma-encoded values.

use crate::color::Image;
use rayon::prelude::*;

/// `after` over `before`, as much of it as `share` says (0: nothing, 1: all), as large as the larger of both; the other one is
/// smoothed where it is stretched.
pub fn faded(before: &Image, after: &Image, share: f32) -> Image {
    let pixels = |image: &Image| u64::from(image.width) * u64::from(image.height);
    let larger = if pixels(before) > pixels(after) { before } else { after };
    let (width, height) = (larger.width, larger.height);
    let share = share.clamp(0.0, 1.0);
    let mut rgba = vec![[0, 0, 0, 255]; width as usize * height as usize];
    rgba.par_chunks_mut(width.max(1) as usize).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let [a, b] = [before, after].map(|image| at(image, [x, y], [width, height]));
            *pixel = std::array::from_fn(|k| (a[k] + (b[k] - a[k]) * share).round() as u8);
        }
    });
    Image { width, height, rgba }
}

/// What a picture shows at a pixel of another size.
fn at(image: &Image, pixel: [usize; 2], size: [u32; 2]) -> [f32; 4] {
    let value = |x: usize, y: usize| image.rgba[y * image.width as usize + x].map(f32::from);
    if [image.width, image.height] == size {
        return value(pixel[0], pixel[1]);
    }
    let locate = |at: usize, sides: u32, own: u32| {
        let place = (at as f32 + 0.5) * own as f32 / sides as f32 - 0.5;
        let place = place.clamp(0.0, own.saturating_sub(1) as f32);
        let low = place as usize;
        (low, (low + 1).min(own.saturating_sub(1) as usize), place - low as f32)
    };
    let ((left, right, u), (above, below, v)) =
        (locate(pixel[0], size[0], image.width), locate(pixel[1], size[1], image.height));
    let corners = [value(left, above), value(right, above), value(left, below), value(right, below)];
    std::array::from_fn(|k| {
        let [a, b, c, d] = corners.map(|corner| corner[k]);
        (a + (b - a) * u) * (1.0 - v) + (c + (d - c) * u) * v
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::annotate::overlay::mix_into;

    /// A picture in which every pixel differs from its neighbours.
    fn picture(width: u32, height: u32, seed: u32) -> Image {
        let value = |i: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(seed) >> 24) as u8;
        let rgba = (0..width * height).map(|i| [value(3 * i), value(3 * i + 1), value(3 * i + 2), 255]);
        Image { width, height, rgba: rgba.collect() }
    }

    #[test]
    fn in_its_middle_it_is_the_mean_and_always_what_a_recording_has() {
        let [before, after] = [1, 77].map(|seed| picture(31, 17, seed));
        let middle = faded(&before, &after, 0.5);
        for ((a, b), mixed) in before.rgba.iter().zip(&after.rgba).zip(&middle.rgba) {
            let mean = |k: usize| (f32::from(a[k]) + f32::from(b[k])) / 2.0;
            assert!((0..3).all(|k| (f32::from(mixed[k]) - mean(k)).abs() <= 0.5), "{a:?} {b:?} {mixed:?}");
        }
        for share in [0.0, 0.123, 0.5, 0.9, 1.0] {
            let mut recorded = before.clone();
            mix_into(&mut recorded, &after, share);
            assert!(faded(&before, &after, share) == recorded, "{share}");
        }
    }

    #[test]
    fn a_smaller_picture_is_stretched() {
        // A ramp stays one, and edges have the values of the outer pixels.
        let ramp = |width: u32| {
            let value = |x: u32| ((x as f32 + 0.5) / width as f32 * 200.0).round() as u8;
            Image { width, height: 2, rgba: (0..2 * width).map(|i| [value(i % width), 0, 0, 255]).collect() }
        };
        let (small, large) = (ramp(20), ramp(80));
        for (before, after) in [(&small, &large), (&large, &small)] {
            let mixed = faded(before, after, 0.5);
            assert_eq!((mixed.width, mixed.height), (80, 2));
            let inner = (2..78).map(|x| mixed.rgba[x][0].abs_diff(large.rgba[x][0])).max();
            assert!(inner <= Some(1), "{inner:?}");
        }
        assert_eq!(faded(&picture(1, 1, 3), &picture(1, 1, 3), 0.3), picture(1, 1, 3));
    }
}
