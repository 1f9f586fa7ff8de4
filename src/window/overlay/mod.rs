//! What is drawn over the picture: legend, scale bar, axes and names, notices, the help page.

pub mod annotations;
pub mod comparison;
pub mod help;
pub mod tour;

use super::state::notices::{Notices, Severity};
use super::theme;
use bevy_egui::egui::{self, Align2, Color32, FontId, Stroke, StrokeKind, pos2, vec2};

/// How long a message stays over the picture, seconds: good news, and errors.
const SHOWN_SECS: [f64; 2] = [4.0, 12.0];

/// Draws the latest notices at the top of the picture; they fade after a while.
pub fn draw_notices(painter: &egui::Painter, picture: egui::Rect, notices: &Notices) {
    let mut top = picture.top() + 14.0;
    for notice in notices.all().rev().take(3) {
        let shown = SHOWN_SECS[usize::from(notice.severity == Severity::Error)];
        let left = shown - notices.age_secs(notice);
        if left <= 0.0 {
            continue;
        }
        let opacity = (left as f32).min(1.0);
        let (text, mark) = match notice.severity {
            Severity::Info => (theme::TEXT, theme::ACCENT),
            Severity::Error => (theme::TEXT, theme::BAD),
        };
        let width = (picture.width() - 80.0).clamp(100.0, 620.0);
        let galley = painter.layout(notice.text.clone(), FontId::proportional(theme::BODY), text, width);
        let size = galley.size() + vec2(28.0, 14.0);
        let card = egui::Rect::from_min_size(pos2(picture.center().x - 0.5 * size.x, top), size);
        painter.rect_filled(card, 6.0, theme::PANEL.gamma_multiply(0.94 * opacity));
        painter.rect_stroke(card, 6.0, Stroke::new(1.0, theme::LINE.gamma_multiply(opacity)), StrokeKind::Inside);
        let stripe = egui::Rect::from_min_max(card.min + vec2(8.0, 7.0), pos2(card.left() + 11.0, card.bottom() - 7.0));
        painter.rect_filled(stripe, 1.5, mark.gamma_multiply(opacity));
        let at = card.min + vec2(18.0, 7.0);
        painter.galley_with_override_text_color(at, galley, text.gamma_multiply(opacity));
        top = card.bottom() + 6.0;
    }
}

/// Draws how navigation works at the moment, at the bottom of the picture.
pub fn draw_hint(painter: &egui::Painter, picture: egui::Rect, text: &str) {
    let at = pos2(picture.center().x, picture.bottom() - 14.0);
    theme::halo_text(painter, at, Align2::CENTER_BOTTOM, text, 12.0, Color32::from_white_alpha(200));
}
