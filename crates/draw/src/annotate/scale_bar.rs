//! The scale bar: a round length at the target's distance, drawn to scale.

use super::display_list::{Anchor, Area, DisplayList, Rgba};
use super::{Subject, TEXT, number};
use crate::view::{Projection, View};
use glam::DVec3;

/// The longest that the bar may be, logical pixels.
const LONGEST: f64 = 170.0;
/// Behind the bar.
const BACK: Rgba = [0, 0, 0, 150];

/// A scale bar: a round length and how many pixels it covers at the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleBar {
    /// Length in world units: 1, 2 or 5 times a power of ten.
    pub length: f64,
    /// Its length in picture pixels.
    pub pixels: f64,
}

impl ScaleBar {
    /// The longest round length that covers at most `longest` pixels at the depth of `target`; `None` where the target
    /// is not ahead of the eye.
    pub fn at(view: &View, target: DVec3, longest: f64) -> Option<ScaleBar> {
        let depth = view.to_camera(target).z;
        let scale = match view.projection {
            Projection::Perspective { .. } => view.focal_pixels() / depth,
            Projection::Orthographic { .. } => view.focal_pixels(),
        };
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let length = number::round_below(longest / scale)?;
        Some(ScaleBar { length, pixels: length * scale })
    }
}

/// Adds the scale bar in the lower left corner; none where the target is not ahead of the eye.
pub fn layout(list: &mut DisplayList, subject: &Subject<'_>) {
    let [picture_width, picture_height] = list.size;
    let longest = LONGEST.min(0.4 * f64::from(picture_width)) * f64::from(subject.scale);
    let Some(bar) = ScaleBar::at(subject.view, subject.target, longest) else { return };
    let (left, y) = (20.0, picture_height - 22.0);
    let right = left + bar.pixels as f32 / subject.scale;
    for (width, color) in [(4.0, BACK), (1.5, TEXT)] {
        list.line([left, y], [right, y], width, color);
        list.line([left, y - 4.0], [left, y + 4.0], width, color);
        list.line([right, y - 4.0], [right, y + 4.0], width, color);
    }
    let text = format!("{} {}", number::quantity(bar.length), super::legend::tidy(subject.length_unit.to_owned()));
    list.text([0.5 * (left + right), y - 7.0], Anchor::BOTTOM, text.trim(), 13.0, TEXT);
    list.keep_free(Area { min: [left, y - 8.0], max: [right, y + 8.0] }.grown(4.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_length_is_round_and_to_scale() {
        for distance in [1e-6, 0.3, 7.0, 1234.0, 9.9e8] {
            let projection = Projection::Perspective { fov_y: 0.8 };
            let view = View::look_at(DVec3::Z * distance, DVec3::ZERO, DVec3::Y, projection, 1280, 720).unwrap();
            let bar = ScaleBar::at(&view, DVec3::ZERO, 160.0).unwrap();
            assert!((64.0..=160.0 + 1e-9).contains(&bar.pixels), "{bar:?}");
            let mantissa = bar.length / 10f64.powi((bar.length * 1.0000001).log10().floor() as i32);
            assert!([1.0, 2.0, 5.0].iter().any(|round| (mantissa - round).abs() < 1e-6), "{mantissa}");
            let start = view.to_pixels(view.to_camera(DVec3::ZERO)).unwrap()[0];
            let end = view.to_pixels(view.to_camera(DVec3::X * bar.length)).unwrap()[0];
            assert!((end - start - bar.pixels).abs() < 1e-6);
        }
    }

    #[test]
    fn a_target_behind_the_eye_has_no_scale() {
        let projection = Projection::Perspective { fov_y: 0.8 };
        let view = View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, projection, 1280, 720).unwrap();
        assert_eq!(ScaleBar::at(&view, DVec3::Z * 2.0, 160.0), None);
    }
}
