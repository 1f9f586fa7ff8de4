//! By how much an output's light is multiplied at each of its points.

use super::Area;
use crate::color::Image;
use crate::view::{Panorama, Surround};

/// A grid of shares of light, rows from the top; its points lie in the middles of equal parts of the output.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// Points in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` shares of light, from 0 to 1.
    pub light: Vec<f32>,
}

impl Mask {
    /// A grey picture's values to the power `gamma`; of a coloured one, the mean of its channels.
    pub fn of(image: &Image, gamma: f64) -> Mask {
        let share = |&[r, g, b, _]: &[u8; 4]| {
            let mean = (f32::from(r) + f32::from(g) + f32::from(b)) / 765.0;
            mean.powf(gamma as f32)
        };
        Mask { width: image.width, height: image.height, light: image.rgba.iter().map(share).collect() }
    }

    /// No light beyond a dome's rim, in an output of `size` pixels that shows a part of it; `own` is multiplied with that.
    pub(super) fn of_dome(panorama: &Panorama, part: Area, size: [u32; 2], own: Option<&Mask>) -> Mask {
        let [width, height] = size.map(|side| side.clamp(1, 8192));
        let Surround::Dome { .. } = panorama.surround else { return Mask { width: 1, height: 1, light: vec![1.0] } };
        let mut light = Vec::with_capacity(width as usize * height as usize);
        let pixel = ((part.2 - part.0) / f64::from(width)).max((part.3 - part.1) / f64::from(height));
        for y in 0..height {
            for x in 0..width {
                let at = [(f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height)];
                let [column, row] = part.at(at);
                let inside = 0.5 - (column - 0.5).hypot(row - 0.5);
                let edge = (inside / pixel + 0.5).clamp(0.0, 1.0) as f32;
                light.push(edge * own.map_or(1.0, |own| own.at(at)));
            }
        }
        Mask { width, height, light }
    }

    /// The share of light at a point (shares of width and height), between the grid's points.
    pub fn at(&self, at: [f64; 2]) -> f32 {
        let sides = [self.width, self.height];
        let place = [0, 1].map(|k| (at[k] * f64::from(sides[k]) - 0.5).clamp(0.0, f64::from(sides[k] - 1)));
        let corner = place.map(|x| x as u32);
        let [u, v] = [0, 1].map(|k| (place[k] - f64::from(corner[k])) as f32);
        let point = |dx: u32, dy: u32| {
            let (x, y) = ((corner[0] + dx).min(self.width - 1), (corner[1] + dy).min(self.height - 1));
            self.light[(y * self.width + x) as usize]
        };
        (1.0 - v) * ((1.0 - u) * point(0, 0) + u * point(1, 0)) + v * ((1.0 - u) * point(0, 1) + u * point(1, 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn light_is_the_value_to_its_power_and_ends_at_the_rim() {
        let image = Image { width: 2, height: 1, rgba: vec![[128; 4], [255; 4]] };
        let mask = Mask::of(&image, 2.2);
        assert!((mask.light[0] - (128f32 / 255.0).powf(2.2)).abs() < 1e-6 && mask.light[1] == 1.0);
        assert!((mask.at([0.5, 0.5]) - 0.5 * (mask.light[0] + 1.0)).abs() < 1e-6);

        let surround = Surround::Dome { aperture: 180.0, tilt: 0.0 };
        let panorama = Panorama { right: DVec3::X, up: DVec3::Y, forward: DVec3::Z, surround, width: 1, height: 1 };
        let dome = Mask::of_dome(&panorama, Area(0.0, 0.0, 0.5, 0.5), [100, 100], Some(&mask));
        let lit: f32 = Mask::of_dome(&panorama, Area(0.0, 0.0, 0.5, 0.5), [100, 100], None).light.iter().sum();
        assert!((lit / 1e4 - std::f32::consts::FRAC_PI_4).abs() < 2e-3, "a quarter of a disc: {lit}");
        assert_eq!((dome.light[0], dome.light[99 * 100 + 99]), (0.0, 1.0));
    }
}
