//! The finished picture: the raw accumulation through a transfer function.

use super::Accumulation;
use super::bloom::Bloom;
use super::colormap::HexColor;
use super::colors::{Colors, to_linear};
use super::transfer::{Hue, Levels, Lut, TransferFunction};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

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

impl Image {
    /// A black picture.
    pub fn black(width: u32, height: u32) -> Image {
        Image { width, height, rgba: vec![[0, 0, 0, 255]; width as usize * height as usize] }
    }
}

/// Colours of a picture, with the transfer function's ranges found from the picture where they are automatic.
pub fn composite(picture: &Accumulation, function: &TransferFunction) -> Image {
    composite_at(picture, function, &function.levels(picture))
}

/// Colours of a picture with given ranges, so that pictures of a sequence can share them.
pub fn composite_at(picture: &Accumulation, function: &TransferFunction, levels: &Levels) -> Image {
    with_lut(picture, function, levels, &function.bake_lut())
}

/// Colours of a picture by a baked table.
fn with_lut(picture: &Accumulation, function: &TransferFunction, levels: &Levels, lut: &Lut) -> Image {
    let rgba = each_pixel(picture, function, levels, |_, [brightness, hue]| look_up(lut, brightness, hue));
    Image { width: picture.width, height: picture.height, rgba }
}

/// What `make` makes of each pixel's index, and of its places of brightness and hue.
fn each_pixel<T: Send>(
    picture: &Accumulation,
    function: &TransferFunction,
    levels: &Levels,
    make: impl Fn(usize, [f32; 2]) -> T + Sync,
) -> Vec<T> {
    let hue = function.hue.clone().unwrap_or_default();
    let colored = function.hue.is_some() && picture.has_attribute();
    let pixel = |index: usize| {
        let brightness = function.scale.place(picture.p[index], levels.p);
        let along = match colored {
            true => picture.s(index).map_or(0.5, |s| hue_place(&hue, s, levels)),
            false => 0.5,
        };
        make(index, [brightness, along])
    };
    (0..picture.p.len()).into_par_iter().map(pixel).collect()
}

/// How many times brighter than the brightest of a screen light counts at most.
pub const MOST_LIGHT: f32 = 16.0;

/// The light of a picture with given ranges, before a background or black. What lies above its range has the range's last colour and is
/// as many times brighter as it is larger, up to 16 times.
pub fn light(picture: &Accumulation, function: &TransferFunction, levels: &Levels, behind: Background) -> Colors {
    let lut = match behind {
        Background::Black => function.bake_lut(),
        Background::Transparent | Background::Color(_) => function.bake_transparent(),
    };
    let high = levels.p[1] as f32;
    let rgba = each_pixel(picture, function, levels, |index, [brightness, hue]| {
        let [r, g, b, a] = values(&lut, brightness, hue).map(|value| value / 255.0);
        let p = picture.p[index];
        // What is no number is no brighter than its colour.
        let over = if high > 0.0 && p > high { (p / high).min(MOST_LIGHT) } else { 1.0 };
        let [r, g, b] = [r, g, b].map(|encoded| over * a * to_linear(encoded));
        [r, g, b, a]
    });
    Colors { width: picture.width, height: picture.height, rgba }
}

/// Colours of a flat picture with given ranges before black, whose bright light spreads.
pub fn composite_glowing(picture: &Accumulation, function: &TransferFunction, levels: &Levels, bloom: &Bloom) -> Image {
    if bloom.is_off() {
        return composite_at(picture, function, levels);
    }
    bloom.image(&light(picture, function, levels, Background::Black))
}

/// What is behind a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Background {
    /// The dark.
    #[default]
    Black,
    /// Whatever the picture is laid over later: it has an alpha channel.
    Transparent,
    /// A colour.
    Color(HexColor),
}

impl TryFrom<String> for Background {
    type Error = String;

    fn try_from(text: String) -> Result<Background, String> {
        match text.as_str() {
            "black" => Ok(Background::Black),
            "transparent" => Ok(Background::Transparent),
            _ => HexColor::try_from(text)
                .map(Background::Color)
                .map_err(|error| format!("{error}, black or transparent")),
        }
    }
}

impl std::str::FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> Result<Background, String> {
        Background::try_from(text.to_owned())
    }
}

impl From<Background> for String {
    fn from(background: Background) -> String {
        match background {
            Background::Black => "black".into(),
            Background::Transparent => "transparent".into(),
            Background::Color(color) => color.into(),
        }
    }
}

/// Colours of a picture with given ranges before a background.
pub fn composite_on(picture: &Accumulation, function: &TransferFunction, levels: &Levels, behind: Background) -> Image {
    match behind {
        Background::Black => composite_at(picture, function, levels),
        Background::Transparent => with_lut(picture, function, levels, &function.bake_transparent()),
        Background::Color(color) => {
            let mut image = with_lut(picture, function, levels, &function.bake_transparent());
            image.rgba.par_iter_mut().for_each(|pixel| {
                let alpha = f32::from(pixel[3]) / 255.0;
                let over = |k: usize| f32::from(pixel[k]) * alpha + f32::from(color.0[k]) * (1.0 - alpha);
                let [r, g, b] = [0, 1, 2].map(|k| over(k).round() as u8);
                *pixel = [r, g, b, 255];
            });
            image
        }
    }
}

/// Colours of a picture with given ranges over another one of the same size: as before a background of each pixel's colour. Of what is seen through
/// something, `through` has the share of each pixel.
pub fn composite_over(
    picture: &Accumulation,
    function: &TransferFunction,
    levels: &Levels,
    behind: &Image,
    through: Option<&[f32]>,
) -> Image {
    let mut image = with_lut(picture, function, levels, &function.bake_transparent());
    image.rgba.par_iter_mut().zip(&behind.rgba).enumerate().for_each(|(index, (pixel, behind))| {
        let share = through.and_then(|through| through.get(index)).copied().unwrap_or(1.0);
        let (alpha, under) = (share * f32::from(pixel[3]) / 255.0, f32::from(behind[3]) / 255.0);
        let left = under * (1.0 - alpha);
        let whole = alpha + left;
        let over = |k: usize| (f32::from(pixel[k]) * alpha + f32::from(behind[k]) * left) / whole.max(1e-6);
        let [r, g, b] = [0, 1, 2].map(|k| over(k).round() as u8);
        *pixel = [r, g, b, (255.0 * whole).round() as u8];
    });
    image
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

/// Four times the difference of two pictures of the same size, channel by channel (HE03 figure 10).
pub fn enlarged_difference(a: &Image, b: &Image) -> Image {
    let pixel = |(a, b): (&[u8; 4], &[u8; 4])| {
        let channel = |k: usize| (4 * u16::from(a[k].abs_diff(b[k]))).min(255) as u8;
        [channel(0), channel(1), channel(2), 255]
    };
    Image { rgba: a.rgba.iter().zip(&b.rgba).map(pixel).collect(), ..a.clone() }
}

/// Where `s` lies in the hue's range.
fn hue_place(hue: &Hue, s: f32, levels: &Levels) -> f32 {
    hue.scale.place(s, levels.s)
}

/// Reads the table as bytes.
fn look_up(lut: &Lut, brightness: f32, hue: f32) -> [u8; 4] {
    values(lut, brightness, hue).map(|value| value.round() as u8)
}

/// Reads the table at brightness and hue within [0, 1], with bilinear interpolation between texels, as a GPU's sampler
/// does at `(0.5 + x (size - 1)) / size`.
fn values(lut: &Lut, brightness: f32, hue: f32) -> [f32; 4] {
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
        (a + (b - a) * u) * (1.0 - v) + (c + (d - c) * u) * v
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::transfer::{Curve, Range, Scale};

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
    fn a_transparent_picture_before_black_is_the_picture() {
        let p: Vec<f32> = (0..64).map(|i| 1.2f32.powi(i)).collect();
        let picture = Accumulation { width: 64, height: 1, ps: p.iter().map(|p| p * 0.4).collect(), p };
        for name in ["density", "density-hue"] {
            let function = TransferFunction::preset(name).unwrap();
            let levels = function.levels(&picture);
            let image = composite_on(&picture, &function, &levels, Background::Transparent);
            assert_eq!(image.rgba[0][3], 0, "nothing is transparent");
            let black = composite_on(&picture, &function, &levels, Background::Color(HexColor([0; 3])));
            let (_, most) = color_error(&black, &composite_at(&picture, &function, &levels));
            assert!(most < 8.0, "{most}");
            let white = composite_on(&picture, &function, &levels, Background::Color(HexColor([255; 3])));
            assert_eq!(white.rgba[0], [255; 4]);
        }
    }

    #[test]
    fn without_bright_light_a_glowing_picture_is_the_picture() {
        let p: Vec<f32> = (0..4096).map(|i| 1.002f32.powi(i)).collect();
        let picture = Accumulation { width: 64, height: 64, ps: p.iter().map(|p| p * 0.4).collect(), p };
        let function = TransferFunction::preset("density-hue").unwrap();
        let levels = function.levels(&picture);
        let plain = composite_at(&picture, &function, &levels);
        assert_eq!(composite_glowing(&picture, &function, &levels, &Bloom::default()), plain);
        let bloom = Bloom { strength: 1.0, threshold: 16.0, radius: 0.2 };
        let (_, most) = color_error(&composite_glowing(&picture, &function, &levels, &bloom), &plain);
        assert!(most < 2.0, "{most}");
        // What lies above the range shines that much brighter.
        let levels = Levels { p: [levels.p[0], levels.p[1] / 8.0], ..levels };
        let light = light(&picture, &function, &levels, Background::Black);
        let peak = |light: &[f32; 4]| light[..3].iter().copied().fold(0.0, f32::max);
        let ratio = f64::from(picture.p[4095]) / levels.p[1];
        let at_range = light.rgba.iter().map(peak).fold(0.0, f32::max) / ratio.min(16.0) as f32;
        assert!(ratio > 7.0 && at_range > 0.05 && at_range <= 1.001, "{ratio} {at_range}");
    }

    #[test]
    fn opacity_over_brightness_darkens_before_black() {
        let picture = Accumulation { width: 2, height: 1, p: vec![1.0, 30.0], ps: vec![] };
        let function = TransferFunction { range: Range::Fixed(0.1, 100.0), ..TransferFunction::default() };
        let half = TransferFunction { opacity: Some(Curve::constant(0.5)), ..function.clone() };
        let [full, half] = [function, half].map(|function| composite(&picture, &function).rgba[1]);
        assert!((0..3).all(|k| u8::abs_diff(full[k] / 2, half[k]) <= 1) && half[3] == 255, "{full:?} {half:?}");
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
