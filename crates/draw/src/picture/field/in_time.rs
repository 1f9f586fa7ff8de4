//! Pictures of a field within a time: with as many pixels as that leaves time for.

use crate::color::Colors;
use crate::cpu::volume::VolumeError;
use crate::mode::{LightPicture, Raw};
use crate::picture::frame_budget::FrameBudget;
use crate::view::View;
use std::time::Instant;

/// Fewest pixels of a picture's longer side.
const LEAST: u32 = 24;

/// What pictures took, and how many pixels the next may have.
#[derive(Clone, Copy, Debug, Default)]
pub struct InTime(Option<FrameBudget>);

/// What a picture costs, but for a factor: its pixels to the power of 1.25, since rays go further where there are more of them.
fn work((width, height): (u32, u32)) -> f64 {
    (f64::from(width) * f64::from(height)).powf(1.25)
}

impl InTime {
    /// Whether nothing is known yet.
    pub fn is_new(&self) -> bool {
        self.0.is_none()
    }

    /// The size of the next picture, at most `full`, where it may take `budget` milliseconds; small where nothing is known yet.
    pub fn size(&self, (width, height): (u32, u32), budget: f64) -> (u32, u32) {
        let longest = f64::from(width.max(height));
        let least = (f64::from(LEAST) / longest).min(1.0);
        let fits = self.0.and_then(|before| before.fits(budget));
        let share = fits.map_or(least, |fits| (fits / work((width, height))).powf(0.4).clamp(least, 1.0));
        let side = |side: u32| ((f64::from(side) * share).round() as u32).max(1);
        (side(width), side(height))
    }

    /// Takes in how long a picture took.
    pub fn drew(&mut self, size: (u32, u32), milliseconds: f64) {
        self.0.get_or_insert_default().drew(work(size), milliseconds);
    }
}

/// Has `draw` draw a view of light with as many pixels as there is time for, enlarged to its size; what pictures take is learned from those
/// before, or else from a few that are not shown. Sums are drawn as they are.
///
/// # Errors
/// Those of `draw`.
pub fn within(
    view: &View,
    budget: f64,
    in_time: &mut InTime,
    mut draw: impl FnMut(&View) -> Result<Raw, VolumeError>,
) -> Result<Raw, VolumeError> {
    let full = (view.width, view.height);
    let tries = if in_time.is_new() { 3 } else { 0 };
    let mut attempt = |budget: f64| {
        let size = in_time.size(full, budget);
        let start = Instant::now();
        let drawn = draw(&view.resized(size.0, size.1))?;
        in_time.drew(size, 1e3 * start.elapsed().as_secs_f64());
        Ok::<Raw, VolumeError>(drawn)
    };
    for number in 0..tries {
        attempt(budget * f64::from(number) / f64::from(tries))?;
    }
    match attempt(budget)? {
        Raw::Light(light) => Ok(Raw::Light(LightPicture { colors: enlarged(&light.colors, full), ..light })),
        Raw::Sums(..) => draw(view),
    }
}

/// A picture brought to another size: bilinear between its pixels.
pub fn enlarged(colors: &Colors, (width, height): (u32, u32)) -> Colors {
    if (colors.width, colors.height) == (width, height) {
        return colors.clone();
    }
    let place = |at: u32, to: u32, from: u32| {
        let place = ((f64::from(at) + 0.5) * f64::from(from) / f64::from(to) - 0.5).clamp(0.0, f64::from(from - 1));
        (place as usize, (place as usize + 1).min(from as usize - 1), place.fract() as f32)
    };
    let mut rgba = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        let (y0, y1, v) = place(y, height, colors.height);
        for x in 0..width {
            let (x0, x1, u) = place(x, width, colors.width);
            let at = |x: usize, y: usize| colors.rgba[y * colors.width as usize + x];
            let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
            rgba.push(std::array::from_fn(|k| {
                let (top, low) = (a[k] + u * (b[k] - a[k]), c[k] + u * (d[k] - c[k]));
                top + v * (low - top)
            }));
        }
    }
    Colors { width, height, rgba }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_come_to_the_budget() {
        let mut in_time = InTime::default();
        let took = |size: (u32, u32)| 3e-5 * work(size);
        for _ in 0..30 {
            let size = in_time.size((1200, 800), 40.0);
            in_time.drew(size, took(size));
        }
        let size = in_time.size((1200, 800), 40.0);
        assert!(took(size) < 40.0 && took(size) > 28.0, "{size:?} takes {}", took(size));
        assert_eq!(in_time.size((1200, 800), 1e9), (1200, 800));
        // Pictures that take twice as long make the next ones smaller.
        in_time.drew(size, 2.0 * took(size));
        in_time.drew(size, 2.0 * took(size));
        assert!(took(in_time.size((1200, 800), 40.0)) < 20.0);
    }

    #[test]
    fn what_is_even_stays_even() {
        let colors = Colors { width: 3, height: 2, rgba: (0..6).map(|i| [(i % 3) as f32, 0.5, 0.0, 1.0]).collect() };
        let large = enlarged(&colors, (9, 8));
        assert!(large.rgba.iter().all(|pixel| pixel[1] == 0.5 && pixel[3] == 1.0));
        assert!((large.rgba[4][0] - 1.0).abs() < 1e-6 && large.rgba[0][0] == 0.0 && large.rgba[8][0] == 2.0);
    }
}
