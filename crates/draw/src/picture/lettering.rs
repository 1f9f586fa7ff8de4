//! Where words and logos stand in pictures for two eyes and of all directions.
//!
//! A flat picture is one sheet, a pair of pictures two. In a panorama the sheet is a flat screen among its directions, 60
//! degrees high and 16:9, straight as the audience sees it: around the front, in a dome as low as its rim allows. For two eyes
//! it stands at the distance of zero parallax.

use crate::color::Image;
use crate::view::{Eye, Panorama, Projection, Stereo, StereoKind, Surround, View, ViewError};
use glam::DVec3;
use rayon::prelude::*;

/// A part of a picture that is written on as if it were a picture of its own.
pub(super) struct Sheet {
    /// The camera that sees the sheet, whose size is the view's.
    pub view: View,
    /// Left, top, width and height of the part, pixels.
    area: [u32; 4],
    /// The directions that the part shows, where it is not flat.
    panorama: Option<Panorama>,
}

/// The sheets of a picture of `width` by `height` pixels from the camera `view`.
///
/// # Errors
/// [`ViewError`] for projections and eyes that make no sense.
pub(super) fn sheets(
    view: &View,
    [width, height]: [u32; 2],
    surround: Surround,
    stereo: Option<Stereo>,
) -> Result<Vec<Sheet>, ViewError> {
    let Some(stereo) = stereo else { return Ok(vec![sheet(view, [0, 0, width, height], surround, None)?]) };
    let areas = stereo.eyes.areas([width, height]);
    let each = stereo.eyes.each().iter().zip(areas);
    each.map(|(eye, area)| sheet(view, area, surround, Some((&stereo, *eye)))).collect()
}

fn sheet(view: &View, area: [u32; 4], surround: Surround, eye: Option<(&Stereo, Eye)>) -> Result<Sheet, ViewError> {
    let Some(panorama) = Panorama::around(view, surround)? else {
        let view = match eye {
            Some((stereo, eye)) if stereo.kind == StereoKind::OffAxis => stereo.off_axis(view, eye)?,
            _ => *view,
        };
        return Ok(Sheet { view, area, panorama: None });
    };
    let (elevation, [wide, half]) = surround.screen();
    let (sin, cos) = elevation.sin_cos();
    let forward = cos * panorama.forward + sin * panorama.up;
    let up = cos * panorama.up - sin * panorama.forward;
    // As fine as the panorama.
    let tall = (2.0 * half / panorama.pixel_angle()).ceil().clamp(16.0, 16384.0);
    let [width, height] = [(tall * wide / half).ceil(), tall].map(|pixels| pixels as u32);
    let projection = Projection::Perspective { fov_y: 2.0 * half.atan() };
    let (offset, distance) = eye.map_or((DVec3::ZERO, 1.0), |(stereo, eye)| {
        (0.5 * eye.sign() * stereo.separation * panorama.right, stereo.zero_parallax)
    });
    let place = view.eye + offset;
    let seen = View::look_at(place, view.eye + distance * forward, up, projection, width, height)?;
    Ok(Sheet { view: View { cut: view.cut, images: view.images, ..seen }, area, panorama: Some(panorama) })
}

impl Sheet {
    /// Lets `write` write on the sheet, and lays it over its part of the picture.
    ///
    /// # Errors
    /// Those of `write`.
    pub fn lay<E>(&self, image: &mut Image, write: impl Fn(&mut Image) -> Result<(), E>) -> Result<(), E> {
        let [left, top, width, height] = self.area;
        if [left, top] == [0, 0] && [width, height] == [image.width, image.height] && self.panorama.is_none() {
            return write(image);
        }
        if left + width > image.width || top + height > image.height {
            return Ok(());
        }
        let Some(panorama) = &self.panorama else {
            let row = |y: u32| {
                let start = ((top + y) * image.width + left) as usize;
                start..start + width as usize
            };
            let rgba = (0..height).flat_map(|y| image.rgba[row(y)].iter().copied()).collect();
            let mut part = Image { width, height, rgba };
            write(&mut part)?;
            let rows: Vec<_> = (0..height).map(row).collect();
            for (row, written) in rows.into_iter().zip(part.rgba.chunks(width.max(1) as usize)) {
                image.rgba[row].copy_from_slice(written);
            }
            return Ok(());
        };
        // What it hides is how different it looks on black and on white.
        let mut papers = [0u8, 255].map(|grey| {
            let rgba = vec![[grey, grey, grey, 255]; self.view.width as usize * self.view.height as usize];
            Image { width: self.view.width, height: self.view.height, rgba }
        });
        for paper in &mut papers {
            write(paper)?;
        }
        let middle = [self.view.width, self.view.height].map(|pixels| 0.5 * f64::from(pixels));
        let focal = self.view.focal_pixels();
        let stride = image.width as usize;
        let rows = image.rgba[top as usize * stride..(top + height) as usize * stride].par_chunks_mut(stride);
        rows.enumerate().for_each(|(y, row)| {
            for (x, pixel) in row[left as usize..(left + width) as usize].iter_mut().enumerate() {
                let Some(direction) = panorama.direction([x as f64 + 0.5, y as f64 + 0.5]) else { continue };
                let depth = direction.dot(self.view.forward);
                if depth <= 1e-3 {
                    continue;
                }
                let across = [direction.dot(self.view.right), -direction.dot(self.view.up)];
                let at = [0, 1].map(|k| middle[k] + focal * across[k] / depth - 0.5);
                let [Some(black), Some(white)] = [0, 1].map(|k| bilinear(&papers[k], at)) else { continue };
                for k in 0..3 {
                    let through = ((white[k] - black[k]) / 255.0).clamp(0.0, 1.0);
                    pixel[k] = (black[k] + through * f64::from(pixel[k])).round().clamp(0.0, 255.0) as u8;
                }
                let through = (0..3).map(|k| (white[k] - black[k]) / 255.0).sum::<f64>() / 3.0;
                let alpha = 255.0 - (255.0 - f64::from(pixel[3])) * through.clamp(0.0, 1.0);
                pixel[3] = alpha.round() as u8;
            }
        });
        Ok(())
    }
}

/// A picture's colour at a point, pixel centres at whole numbers; `None` outside.
fn bilinear(image: &Image, at: [f64; 2]) -> Option<[f64; 3]> {
    let most = [image.width, image.height].map(|side| f64::from(side) - 1.0);
    if !(0..2).all(|k| (0.0..=most[k]).contains(&at[k])) {
        return None;
    }
    let corner = [0, 1].map(|k| at[k].floor().min((most[k] - 1.0).max(0.0)));
    let [u, v] = [0, 1].map(|k| at[k] - corner[k]);
    let pixel = |dx: u32, dy: u32| {
        let (x, y) = ((corner[0] as u32 + dx).min(image.width - 1), (corner[1] as u32 + dy).min(image.height - 1));
        image.rgba[(y * image.width + x) as usize]
    };
    let corners = [pixel(0, 0), pixel(1, 0), pixel(0, 1), pixel(1, 1)];
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    Some(std::array::from_fn(|k| {
        corners.iter().zip(weights).map(|(corner, weight)| weight * f64::from(corner[k])).sum()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Eyes;
    use std::convert::Infallible;

    const BACK: [u8; 4] = [10, 20, 30, 255];

    fn front(width: u32, height: u32) -> View {
        let projection = Projection::Perspective { fov_y: 1.0 };
        View::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, projection, width, height).unwrap()
    }

    fn plain(width: u32, height: u32) -> Image {
        Image { width, height, rgba: vec![BACK; (width * height) as usize] }
    }

    /// A square at the sheet's foot, half transparent.
    fn square(image: &mut Image) -> Result<(), Infallible> {
        let (width, height) = (image.width, image.height);
        let side = height / 5;
        for y in height - 2 * side..height - side {
            for x in (width - side) / 2..(width + side) / 2 {
                let pixel = &mut image.rgba[(y * width + x) as usize];
                pixel[0] = (200 + u32::from(pixel[0])).div_ceil(2) as u8;
                pixel[1] /= 2;
                pixel[2] /= 2;
            }
        }
        Ok(())
    }

    fn middle_of_what_changed(image: &Image, area: [u32; 4]) -> [f64; 3] {
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for y in area[1]..area[1] + area[3] {
            for x in area[0]..area[0] + area[2] {
                if image.rgba[(y * image.width + x) as usize] != BACK {
                    sum = [sum[0] + f64::from(x) + 0.5, sum[1] + f64::from(y) + 0.5];
                    count += 1.0;
                }
            }
        }
        [sum[0] / count, sum[1] / count, count]
    }

    /// In every projection the square is where the sheet's camera has it, as large as its solid angle says, and mixed as the
    /// writer mixed it.
    #[test]
    fn what_is_written_is_seen_where_the_sheet_stands() {
        for surround in [
            Surround::Dome { aperture: 180.0, tilt: 0.0 },
            Surround::Dome { aperture: 180.0, tilt: 90.0 },
            Surround::Dome { aperture: 230.0, tilt: 30.0 },
            Surround::Equirectangular,
            Surround::Cube { layout: Default::default() },
        ] {
            let view = front(600, 600);
            let panorama = Panorama::around(&view, surround).unwrap().unwrap();
            let size = [panorama.width, panorama.height];
            let mut image = plain(size[0], size[1]);
            for sheet in sheets(&view, size, surround, None).unwrap() {
                sheet.lay(&mut image, square).unwrap();
                let [x, y, count] = middle_of_what_changed(&image, [0, 0, size[0], size[1]]);
                let across = |y: f64| {
                    sheet.view.at_depth([0.5 * f64::from(sheet.view.width), y * f64::from(sheet.view.height)], 1.0)
                };
                let expected = panorama.pixel(across(0.7)).unwrap();
                assert!(
                    (x - expected[0]).abs() < 1.5 && (y - expected[1]).abs() < 1.5,
                    "{surround:?}: {x} {y} {expected:?}"
                );
                let side = 2.0 * surround.screen().1[1] / 5.0;
                let solid = side * side / across(0.7).length().powi(3);
                let pixels = solid / panorama.solid_angle(expected);
                assert!((count / pixels - 1.0).abs() < 0.05, "{surround:?}: {count} {pixels}");
                let pixel = image.rgba[y as usize * size[0] as usize + x as usize];
                assert!(
                    pixel[0].abs_diff(105) <= 1 && pixel[1].abs_diff(10) <= 1 && pixel[2].abs_diff(15) <= 1,
                    "{pixel:?}"
                );
            }
        }
    }

    /// A flat pair has everything twice; in a panorama for two eyes the sheet is nearer than infinity.
    #[test]
    fn each_eye_has_its_own() {
        let stereo = |kind, eyes| Some(Stereo { kind, separation: 0.2, zero_parallax: 2.0, eyes });
        let view = front(200, 100);
        let mut image = plain(200, 200);
        let pair = sheets(&view, [200, 200], Surround::Flat, stereo(StereoKind::OffAxis, Eyes::OverUnder)).unwrap();
        assert_eq!(pair.len(), 2);
        pair.iter().for_each(|sheet| sheet.lay(&mut image, square).unwrap());
        let [upper, lower] = [0, 100].map(|top| middle_of_what_changed(&image, [0, top, 200, 100]));
        assert_eq!((upper[0], upper[1] + 100.0, upper[2]), (lower[0], lower[1], lower[2]));

        let dome = Surround::Dome { aperture: 180.0, tilt: 90.0 };
        let view = front(600, 600);
        let round = stereo(StereoKind::Omnidirectional, Eyes::SideBySide);
        let mut image = plain(1200, 600);
        for sheet in sheets(&view, [1200, 600], dome, round).unwrap() {
            sheet.lay(&mut image, square).unwrap();
        }
        let [left, right] =
            [0, 600].map(|left| middle_of_what_changed(&image, [left, 0, 600, 600])[0] - f64::from(left));
        // The angle at which the eyes' lines of sight cross, in pixels.
        let expected = 2.0 * (0.1f64 / 2.0).atan() / Panorama::around(&view, dome).unwrap().unwrap().pixel_angle();
        assert!((left - right - expected).abs() < 1.0, "{left} {right} {expected}");
    }
}
