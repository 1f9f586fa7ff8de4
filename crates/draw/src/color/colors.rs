//! A picture as light: linear, premultiplied with opacity, and how it is encoded for a screen.

use super::composite::{Background, Image};
use rayon::prelude::*;

/// Light from gamma-encoded sRGB.
pub fn to_linear(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Gamma-encoded sRGB from light.
pub fn to_encoded(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.max(0.0).powf(1.0 / 2.4) - 0.055 }
}

/// Colours of a picture: linear light, premultiplied with their opacity, row 0 at the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Colors {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Red, green, blue and opacity of each pixel.
    pub rgba: Vec<[f32; 4]>,
}

impl Colors {
    /// The light of a finished picture.
    pub fn of_image(image: &Image) -> Colors {
        let light = |&[r, g, b, a]: &[u8; 4]| {
            let alpha = f32::from(a) / 255.0;
            let [r, g, b] = [r, g, b].map(|byte| alpha * to_linear(f32::from(byte) / 255.0));
            [r, g, b, alpha]
        };
        Colors { width: image.width, height: image.height, rgba: image.rgba.par_iter().map(light).collect() }
    }

    /// Darkens what is brighter than a screen to the brightest that has its hue.
    pub fn fit_screen(&mut self) {
        self.rgba.par_iter_mut().for_each(|pixel| {
            let most = pixel[0].max(pixel[1]).max(pixel[2]);
            if most > 1.0 {
                pixel[..3].iter_mut().for_each(|light| *light /= most);
            }
        });
    }

    /// The picture before a background, gamma-encoded.
    pub fn image_on(&self, background: Background) -> Image {
        let byte = |share: f32| (255.0 * share.clamp(0.0, 1.0)).round() as u8;
        if let Background::Color(color) = background {
            let behind = color.rgb().map(to_linear);
            let pixel = |&[r, g, b, a]: &[f32; 4]| {
                let light = [r, g, b];
                let [r, g, b] = [0, 1, 2].map(|k| byte(to_encoded((light[k] + (1.0 - a) * behind[k]).clamp(0.0, 1.0))));
                [r, g, b, 255]
            };
            return Image { width: self.width, height: self.height, rgba: self.rgba.par_iter().map(pixel).collect() };
        }
        if background == Background::Black {
            return self.image();
        }
        let pixel = |&[r, g, b, a]: &[f32; 4]| {
            let [r, g, b] = [r, g, b].map(|light| byte(to_encoded((light / a.max(1e-6)).clamp(0.0, 1.0))));
            [r, g, b, byte(a)]
        };
        Image { width: self.width, height: self.height, rgba: self.rgba.par_iter().map(pixel).collect() }
    }

    /// The picture before black, gamma-encoded.
    pub fn image(&self) -> Image {
        let byte = |light: f32| (255.0 * to_encoded(light.clamp(0.0, 1.0))).round() as u8;
        let rgba = self.rgba.par_iter().map(|&[r, g, b, _]| [byte(r), byte(g), byte(b), 255]).collect();
        Image { width: self.width, height: self.height, rgba }
    }
}
