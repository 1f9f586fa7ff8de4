//! What is laid over a finished picture: words at its foot that fade in and out, and pictures such as logos.

use super::display_list::{Anchor, DisplayList, Shape};
use super::{Paper, font, paint};
use crate::color::Image;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A picture to lay over another: a PNG file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// The file; from the folder of the file that names it where it is relative.
    pub path: PathBuf,
    /// Which corner or edge it stands at.
    #[serde(default)]
    pub anchor: Corner,
    /// Its height, as a share of the picture's.
    #[serde(default = "height", deserialize_with = "share")]
    pub height: f32,
    /// Its distance from the edges, as a share of the picture's height.
    #[serde(default = "margin", deserialize_with = "share")]
    pub margin: f32,
    /// 1 hides what is behind it, 0 is nothing.
    #[serde(default = "opacity", deserialize_with = "share")]
    pub opacity: f32,
}

fn height() -> f32 {
    0.1
}

fn margin() -> f32 {
    0.03
}

fn opacity() -> f32 {
    1.0
}

fn share<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    let value = f32::deserialize(deserializer)?;
    let message = || serde::de::Error::custom(format!("found {value}, expected a number from 0 to 1"));
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(message()) }
}

/// Where something stands in a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "the names say it")]
pub enum Corner {
    TopLeft,
    Top,
    TopRight,
    Left,
    Center,
    Right,
    BottomLeft,
    Bottom,
    #[default]
    BottomRight,
}

impl Corner {
    /// The share of the free room to the left and above.
    fn place(self) -> [f32; 2] {
        let at = self as usize;
        [0.5 * (at % 3) as f32, 0.5 * (at / 3) as f32]
    }
}

impl Picture {
    /// Where it stands in a picture of so many pixels, if it has itself so many: left, top, width, height.
    pub fn place(&self, [width, height]: [f32; 2], own: [f32; 2]) -> [f32; 4] {
        let tall = (self.height * height).round().max(1.0);
        let wide = (own[0] / (own[1] / tall)).round().max(1.0);
        let margin = self.margin * height;
        let free = [width - wide - 2.0 * margin, height - tall - 2.0 * margin];
        let place = self.anchor.place();
        let [left, top] = [0, 1].map(|k| (margin + free[k] * place[k]).round());
        [left, top, wide, tall]
    }
}

/// A line of words at the foot of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line<'a> {
    /// The words.
    pub text: &'a str,
    /// The middle of their lower edge, in a picture of the given size.
    pub at: [f32; 2],
    /// Pixels per em.
    pub em: f32,
}

/// The lines of a caption in a picture of `size`, about 720 pixels high: letters that would not fit are smaller.
pub fn lines(caption: &str, size: [f32; 2]) -> Vec<Line<'_>> {
    let lines: Vec<&str> = caption.trim().lines().collect();
    let count = lines.len();
    let placed = lines.into_iter().enumerate().map(|(i, text)| {
        let width = font::extent(text, SIZE)[0].max(1.0);
        let em = (SIZE * (0.94 * size[0] / width).min(1.0)).max(1.0);
        let above = (count - 1 - i) as f32 * LINE * SIZE;
        Line { text, at: [0.5 * size[0], size[1] * (1.0 - FOOT) - above], em }
    });
    placed.collect()
}

/// What is laid over one picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Overlay {
    /// Words at the foot; several lines are divided by line breaks.
    pub caption: String,
    /// How much of the words is seen, from 0 to 1.
    #[serde(deserialize_with = "share")]
    pub caption_opacity: f32,
    /// Pictures.
    pub images: Vec<Picture>,
}

/// A picture that cannot be laid over another.
#[derive(Debug, thiserror::Error)]
pub enum OverlayError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is no PNG picture that can be used.
    #[error("{}: {message}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and what was expected.
        message: String,
    },
}

/// Most pixels along a side of a picture that is laid over another.
const LARGEST: u32 = 8192;
/// Pixels per em of words in a picture of 720 pixels.
const SIZE: f32 = 24.0;
/// Height of a line, in ems.
const LINE: f32 = 1.35;
/// Distance of the lowest line from the lower edge, as a share of the height.
const FOOT: f32 = 0.06;

/// Reads a PNG picture as RGBA.
///
/// # Errors
/// [`OverlayError`] with the file named.
pub fn read_png(path: &Path) -> Result<Image, OverlayError> {
    let file = std::fs::File::open(path).map_err(|source| OverlayError::Io { path: path.to_owned(), source })?;
    let fail = |message: String| OverlayError::Decode { path: path.to_owned(), message };
    decode_png(std::io::BufReader::new(file)).map_err(fail)
}

/// A PNG picture as RGBA, of up to 8192 pixels a side.
///
/// # Errors
/// What is wrong with it, and what was expected.
pub fn decode_png(source: impl std::io::BufRead + std::io::Seek) -> Result<Image, String> {
    let mut decoder = png::Decoder::new(source);
    decoder.set_transformations(png::Transformations::normalize_to_color8() | png::Transformations::ALPHA);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let (width, height) = (reader.info().width, reader.info().height);
    if width > LARGEST || height > LARGEST {
        return Err(format!("{width}x{height} pixels, expected up to {LARGEST}x{LARGEST}"));
    }
    let bytes = reader.output_buffer_size().ok_or("its size is out of range")?;
    let mut data = vec![0; bytes];
    let info = reader.next_frame(&mut data).map_err(|error| error.to_string())?;
    data.truncate(info.buffer_size());
    let rgba: Vec<[u8; 4]> = match info.color_type {
        png::ColorType::Rgba => data.as_chunks::<4>().0.to_vec(),
        png::ColorType::GrayscaleAlpha => {
            data.as_chunks::<2>().0.iter().map(|&[grey, a]| [grey, grey, grey, a]).collect()
        }
        other => return Err(format!("colours are {other:?}, expected RGB or grey")),
    };
    if rgba.len() != width as usize * height as usize {
        return Err("pixels are missing".into());
    }
    Ok(Image { width, height, rgba })
}

impl Overlay {
    /// Whether nothing is laid over.
    pub fn is_empty(&self) -> bool {
        (self.caption.trim().is_empty() || self.caption_opacity <= 0.0) && self.images.is_empty()
    }

    /// Lays everything over a picture; paths are read from `folder` where they are relative.
    ///
    /// # Errors
    /// [`OverlayError`] for pictures that cannot be read.
    pub fn paint(&self, image: &mut Image, folder: &Path) -> Result<(), OverlayError> {
        for picture in &self.images {
            lay_over(image, &read_png(&folder.join(&picture.path))?, picture);
        }
        if self.caption_opacity > 0.0 {
            self.write(image);
        }
        Ok(())
    }

    fn write(&self, image: &mut Image) {
        let scale = (image.height as f32 / 720.0).max(0.25);
        let size = [image.width, image.height].map(|side| side as f32 / scale);
        let mut list = DisplayList::new(size);
        for Line { text, at, em } in lines(&self.caption, size) {
            let color = [0xf2, 0xf4, 0xf7, 0xff];
            list.shapes.push(Shape::Text { at, anchor: Anchor::BOTTOM, text: text.to_owned(), size: em, color });
        }
        // The halo of letters does not fade, so faded words are mixed as a whole.
        let mut written = image.clone();
        paint(&mut written, &list, scale, Paper::Dark);
        mix_into(image, &written, self.caption_opacity);
    }
}

/// Mixes `other` into a picture of the same size, in display space: all of it for 1.
pub fn mix_into(image: &mut Image, other: &Image, share: f32) {
    let share = share.clamp(0.0, 1.0);
    for (pixel, other) in image.rgba.iter_mut().zip(&other.rgba) {
        if pixel != other {
            *pixel = std::array::from_fn(|k| {
                let (a, b) = (f32::from(pixel[k]), f32::from(other[k]));
                (a + (b - a) * share).round() as u8
            });
        }
    }
}

/// Lays a picture over another, each pixel the mean of what it covers.
fn lay_over(image: &mut Image, picture: &Image, how: &Picture) {
    let sides = |image: &Image| [image.width, image.height].map(|side| side as f32);
    let [left, top, wide, tall] = how.place(sides(image), sides(picture));
    let scale = picture.height as f32 / tall;
    let corner = [left as i64, top as i64];
    for y in 0..tall as i64 {
        for x in 0..wide as i64 {
            let (column, row) = (corner[0] + x, corner[1] + y);
            if !(0..i64::from(image.width)).contains(&column) || !(0..i64::from(image.height)).contains(&row) {
                continue;
            }
            let [r, g, b, a] = mean(picture, [x as f32 * scale, y as f32 * scale], scale);
            let pixel = &mut image.rgba[(row * i64::from(image.width) + column) as usize];
            let cover = a * how.opacity;
            for (channel, above) in pixel.iter_mut().zip([r, g, b]) {
                *channel = (above * how.opacity + f32::from(*channel) * (1.0 - cover)).round().clamp(0.0, 255.0) as u8;
            }
            pixel[3] = (255.0 * cover + f32::from(pixel[3]) * (1.0 - cover)).round().min(255.0) as u8;
        }
    }
}

/// The mean over a square, colours premultiplied: 0 to 255, alpha 0 to 1.
fn mean(picture: &Image, [left, top]: [f32; 2], side: f32) -> [f32; 4] {
    let range = |start: f32, most: u32| {
        let first = (start as u32).min(most - 1);
        first..((start + side).ceil() as u32).clamp(first + 1, most)
    };
    let (mut sum, mut weight) = ([0.0f32; 4], 0.0f32);
    for y in range(top, picture.height) {
        for x in range(left, picture.width) {
            let overlap =
                |at: u32, start: f32| ((at as f32 + 1.0).min(start + side) - (at as f32).max(start)).max(1e-6);
            let share = overlap(x, left) * overlap(y, top);
            let [r, g, b, a] = picture.rgba[(y * picture.width + x) as usize].map(f32::from);
            let alpha = a / 255.0 * share;
            for (sum, value) in sum.iter_mut().zip([r * alpha, g * alpha, b * alpha, alpha]) {
                *sum += value;
            }
            weight += share;
        }
    }
    sum.map(|value| value / weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::output::write_png;

    fn plain(width: u32, height: u32, color: [u8; 4]) -> Image {
        Image { width, height, rgba: vec![color; (width * height) as usize] }
    }

    #[test]
    fn logos_stand_where_they_are_put_and_words_at_the_foot() {
        let folder = tempfile::tempdir().unwrap();
        write_png(&folder.path().join("logo.png"), &plain(40, 20, [255, 0, 0, 128])).unwrap();
        let picture =
            Picture { path: "logo.png".into(), anchor: Corner::TopLeft, height: 0.2, margin: 0.1, opacity: 1.0 };
        let mut image = plain(200, 100, [0, 0, 0, 255]);
        let overlay = Overlay { caption: "Words\nat the foot".into(), caption_opacity: 1.0, images: vec![picture] };
        overlay.paint(&mut image, folder.path()).unwrap();
        let at = |x: u32, y: u32| image.rgba[(y * 200 + x) as usize];
        assert_eq!(
            (at(9, 15), at(10, 10), at(49, 29), at(50, 15)),
            ([0, 0, 0, 255], [128, 0, 0, 255], [128, 0, 0, 255], [0, 0, 0, 255])
        );
        let lit = |rows: std::ops::Range<u32>| {
            rows.flat_map(|y| (0..200).map(move |x| (x, y))).filter(|&(x, y)| at(x, y)[1] > 100).count()
        };
        assert!(lit(80..98) > 10 && lit(30..80) == 0, "{} {}", lit(80..98), lit(30..80));
        let gone = Overlay { caption_opacity: 0.0, ..overlay.clone() };
        let mut same = plain(200, 100, [0, 0, 0, 255]);
        gone.paint(&mut same, folder.path()).unwrap();
        assert!(
            same.rgba[85 * 200..].iter().all(|pixel| pixel[1] == 0)
                && !gone.is_empty()
                && Overlay::default().is_empty()
        );
    }

    #[test]
    fn what_is_no_picture_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.png"), b"no picture").unwrap();
        for name in ["a.png", "b.png"] {
            let message = read_png(&folder.path().join(name)).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
    }
}
