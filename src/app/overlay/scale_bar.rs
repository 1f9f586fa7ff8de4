//! The scale bar: a round length at the target's distance, drawn to scale.

use crate::app::number;
use crate::app::panel::theme;
use crate::view::View;
use bevy_egui::egui::{self, Align2, Color32, Stroke, pos2};
use glam::DVec3;

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
            crate::view::Projection::Perspective { .. } => view.focal_pixels() / depth,
            crate::view::Projection::Orthographic { .. } => view.focal_pixels(),
        };
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let limit = longest / scale;
        let power = 10f64.powf(limit.log10().floor());
        let length = [5.0, 2.0, 1.0].map(|factor| factor * power).into_iter().find(|length| *length <= limit)?;
        Some(ScaleBar { length, pixels: length * scale })
    }
}

/// Draws the scale bar into the lower left corner of the picture. `scale`: physical pixels per logical one.
pub fn draw(painter: &egui::Painter, rect: egui::Rect, bar: ScaleBar, unit: &str, scale: f32) {
    let width = bar.pixels as f32 / scale;
    let left = rect.left() + 20.0;
    let y = rect.bottom() - 22.0;
    for (stroke, shift) in
        [(Stroke::new(4.0, Color32::from_black_alpha(150)), 0.0), (Stroke::new(1.5, theme::TEXT), 0.0)]
    {
        painter.hline(left..=left + width, y + shift, stroke);
        painter.vline(left, y - 4.0..=y + 4.0, stroke);
        painter.vline(left + width, y - 4.0..=y + 4.0, stroke);
    }
    let text = format!("{} {unit}", number::quantity(bar.length));
    theme::halo_text(painter, pos2(left + 0.5 * width, y - 7.0), Align2::CENTER_BOTTOM, text.trim(), 13.0, theme::TEXT);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Projection;

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
