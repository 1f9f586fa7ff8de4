//! Two pictures over the window's own, with a divider that can be dragged, or moved with arrow keys, between them.

use super::theme::{self, Asked, Handle, Ways};
use crate::annotate::number;
use crate::window::comparison::{Comparison, Found};
use crate::window::sheet;
use bevy_egui::egui::{Align2, Color32, CursorIcon, Id, Rect, Sense, Stroke, Ui, pos2, vec2};

/// How far from the divider it can be taken hold of, logical pixels.
const REACH_PX: f32 = 5.0;
/// Its knob.
const KNOB: [f32; 2] = [9.0, 34.0];
/// Where the divider may be.
const PLACES: [f32; 2] = [0.02, 0.98];

/// Draws the pictures of a comparison, where there are some, and follows the divider; whether the pointer is on that, and not on the picture.
pub fn draw(ui: &mut Ui, picture: Rect, comparison: &mut Comparison) -> bool {
    let (divider, names) = (comparison.divider, comparison.compared.ways.map(|way| way.name));
    let shows_difference = comparison.shows_difference;
    let Some(Found { splats, color_error }) = comparison.found() else { return false };
    let ctx = ui.ctx().clone();
    let Some([left, right, difference]) = comparison.sheets(&ctx) else { return false };
    let painter = ui.painter().with_clip_rect(picture);
    let top = picture.top() + 12.0;
    let says = |at: f32, anchor: Align2, text: String| {
        theme::halo_text(&painter, pos2(at, top), anchor, &text, 13.0, Color32::from_white_alpha(230));
    };
    if shows_difference {
        sheet::paint(&painter, picture, difference.tiles());
        let text = format!("{} less {}, times 4: {color_error:.2} of 255", names[0], names[1]);
        says(picture.center().x, Align2::CENTER_TOP, text);
        return false;
    }
    let at = picture.left() + divider * picture.width();
    for (tiles, part) in [(left, picture.with_max_x(at)), (right, picture.with_min_x(at))] {
        sheet::paint(&painter.with_clip_rect(part), picture, tiles.tiles());
    }
    let line = Stroke::new(1.5, Color32::from_white_alpha(190));
    painter.line_segment([pos2(at, picture.top()), pos2(at, picture.bottom())], line);
    let knob = Rect::from_center_size(pos2(at, picture.center().y), vec2(KNOB[0], KNOB[1]));
    painter.rect_filled(knob, 4.0, theme::TEXT);
    let [few, many] = splats.map(number::count);
    says(at - 12.0, Align2::RIGHT_TOP, format!("{}, {few}", names[0]));
    says(at + 12.0, Align2::LEFT_TOP, format!("{}, {many}", names[1]));
    let handle = Rect::from_x_y_ranges(at - REACH_PX..=at + REACH_PX, picture.y_range());
    theme::register(ui, "divider", knob);
    let response = ui.interact(handle, Id::new("divider"), Sense::drag());
    let (words, number) = (format!("{:.0} %", 100.0 * divider), f64::from(divider));
    let (name, range) = ("Divider between the two hierarchies", PLACES.map(f64::from));
    let moved = match (Handle { name, place: &words, number, range, ways: Ways::Across }).asked(ui, &response) {
        Some(Asked::Move((right, _))) => Some(divider + right),
        Some(Asked::Number(asked)) => Some(asked as f32),
        Some(Asked::Remove) | None => None,
    };
    if response.hovered() || response.dragged() {
        ctx.set_cursor_icon(CursorIcon::ResizeHorizontal);
    }
    let dragged = response.interact_pointer_pos().filter(|_| response.dragged());
    if let Some(place) = dragged.map(|at| (at.x - picture.left()) / picture.width()).or(moved) {
        comparison.divider = place.clamp(PLACES[0], PLACES[1]);
    }
    // Not by what has been hovered over: a press may come in the same frame as the pointer.
    response.dragged() || ctx.pointer_latest_pos().is_some_and(|at| handle.contains(at))
}
