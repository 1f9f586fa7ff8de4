//! The finished picture: the raw accumulation through a transfer function.

use super::Accumulation;
use super::transfer::{Hue, Levels, Lut, TransferFunction};
use rayon::prelude::*;

/// A picture as RGBA8, gamma-encoded sRGB, row 0 at the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width * height` pixels.
    pub rgba: Vec<[u8; 4]>,
}

/// Colours of a picture, with the transfer function's ranges found from the picture where they are automatic.
pub fn composite(picture: &Accumulation, function: &TransferFunction) -> Image {
    composite_at(picture, function, &function.levels(picture))
}

/// Colours of a picture with given ranges, so that pictures of a sequence can share them.
pub fn composite_at(picture: &Accumulation, function: &TransferFunction, levels: &Levels) -> Image {
    let lut = function.bake_lut();
    let hue = function.hue.unwrap_or_default();
    let colored = function.hue.is_some() && picture.has_attribute();
    let pixel = |index: usize| {
        let brightness = function.scale.place(picture.p[index], levels.p);
        let along = match colored {
            true => picture.s(index).map_or(0.5, |s| hue_place(&hue, s, levels)),
            false => 0.5,
        };
        look_up(&lut, brightness, along)
    };
    Image {
        width: picture.width,
        height: picture.height,
        rgba: (0..picture.p.len()).into_par_iter().map(pixel).collect(),
    }
}

/// Euclidean distance in RGB, 255 being full intensity (F12 4.10.2).
pub fn color_distance(a: [u8; 4], b: [u8; 4]) -> f64 {
    let square = |k: usize| (f64::from(a[k]) - f64::from(b[k])).powi(2);
    (square(0) + square(1) + square(2)).sqrt()
}

/// Mean and largest [`color_distance`] of the pixels of two pictures of the same size.
pub fn color_error(a: &Image, b: &Image) -> (f64, f64) {
    let distances = a.rgba.iter().zip(&b.rgba).map(|(&a, &b)| color_distance(a, b));
    let (sum, largest) = distances.fold((0.0, 0.0_f64), |(sum, largest), d| (sum + d, largest.max(d)));
    (sum / a.rgba.len().max(1) as f64, largest)
}

/// Where `s` lies in the hue's range.
fn hue_place(hue: &Hue, s: f32, levels: &Levels) -> f32 {
    hue.scale.place(s, levels.s)
}

/// Reads the table at brightness and hue within [0, 1], with bilinear interpolation between texels, as a GPU's sampler
/// does at `(0.5 + x (size - 1)) / size`.
fn look_up(lut: &Lut, brightness: f32, hue: f32) -> [u8; 4] {
    let locate = |place: f32, size: u32| {
        let position = place * (size - 1) as f32;
        let index = (position as u32).min(size.saturating_sub(2));
        (index as usize, position - index as f32)
    };
    let ((x, u), (y, v)) = (locate(brightness, lut.width), locate(hue, lut.height));
    let texel = |dx: usize, dy: usize| {
        let y = (y + dy).min(lut.height as usize - 1);
        lut.rgba[y * lut.width as usize + x + dx].map(f32::from)
    };
    let corners = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
    std::array::from_fn(|k| {
        let [a, b, c, d] = corners.map(|corner| corner[k]);
        ((a + (b - a) * u) * (1.0 - v) + (c + (d - c) * u) * v).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::transfer::{Range, Scale};

    #[test]
    fn black_stays_black_and_hue_separates() {
        let function = TransferFunction {
            range: Range::Fixed(1.0, 100.0),
            hue: Some(Hue { scale: Scale::Linear, range: Range::Fixed(0.0, 1.0), ..Hue::default() }),
            ..TransferFunction::default()
        };
        let picture = Accumulation { width: 4, height: 1, p: vec![0.0, 0.5, 10.0, 10.0], ps: vec![0.0, 0.0, 2.0, 9.0] };
        let image = composite(&picture, &function);
        assert_eq!(image.rgba[0], [0, 0, 0, 255]);
        assert_eq!(image.rgba[1], [0, 0, 0, 255]);
        assert_ne!(image.rgba[2], image.rgba[3]);
    }

    #[test]
    fn twice_the_range_is_darker() {
        let picture = Accumulation { width: 2, height: 1, p: vec![1.0, 30.0], ps: vec![] };
        let with = |max| {
            let function = TransferFunction { range: Range::Fixed(0.1, max), ..TransferFunction::default() };
            composite(&picture, &function).rgba[1].map(u32::from).iter().sum::<u32>()
        };
        assert!(with(30.0) > with(60.0));
    }
}
