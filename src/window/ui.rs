//! Lays out the window: the docks at both sides, the picture between them, the overlays on top.

use super::camera::{Navigation, Viewpoint};
use super::files::{page, typed};
use super::input::PointerOwner;
use super::lens::view_of;
use super::looking::approach::DoubleClick;
use super::looking::drawing::{self, Looking};
use super::looking::marks::MarkLayer;
use super::looking::pointer::PicturePointer;
use super::overlay::{self, annotations, help};
use super::panel::PanelState;
use super::panes;
use super::picture::{DataCamera, Letterbox, Picture};
use super::playhead::Playhead;
use super::preset::Preset;
use super::scene::Scene;
use super::sheet;
use super::state::panels::Dock;
use super::state::tool::{Stroke, Tool};
use super::statistics::ActiveBackend;
use super::theme;
use super::time_dock;
use super::written::WrittenHeights;
use crate::annotate;
use crate::view::View;
use bevy::prelude::*;
use bevy_egui::{EguiContexts, egui};
use std::path::Path;

/// The least width that both docks leave to the picture, logical pixels.
const LEAST_PICTURE_PX: f32 = 320.0;

/// Where the panels' named controls are, logical pixels.
#[derive(Resource, Default)]
pub(super) struct Controls(pub theme::Controls);

/// The factor on text and controls for a window of so many physical pixels, where the system scales by `native` already: text
/// that is legible at 1080 rows is as large on a screen of 2160.
fn automatic_scale(height: f32, native: f32) -> f32 {
    let wanted = (height / 1080.0).clamp(1.0, 3.0);
    ((4.0 * wanted / native).round() / 4.0).max(1.0)
}

/// Draws everything of the window that is not data.
pub(super) fn draw_window(
    mut contexts: EguiContexts,
    mut styled: Local<bool>,
    mut panel: PanelState,
    mut controls: ResMut<Controls>,
    mut picture: ResMut<Picture>,
    mut owner: ResMut<PointerOwner>,
    camera: Single<(&Viewpoint, &Navigation), With<DataCamera>>,
    mut clicked: ResMut<DoubleClick>,
    mut pointer: ResMut<PicturePointer>,
    (mut layer, stroke): (ResMut<MarkLayer>, Res<Stroke>),
    (mut written, mut pictures): (ResMut<WrittenHeights>, ResMut<overlay::tour::TourPictures>),
    (preset, mut playhead): (Res<Preset>, Option<ResMut<Playhead>>),
    (backend, letterbox): (Res<ActiveBackend>, Res<Letterbox>),
) -> Result {
    let ctx = contexts.ctx_mut()?.clone();
    if !*styled {
        theme::apply(&ctx);
        *styled = true;
    }
    let had_keyboard = !owner.keyboard_is_free();
    let step = if owner.is_locked() { panes::Step::default() } else { panes::Step::begin(&ctx) };
    // Where no control has the keyboard, Tab belongs to the panels' visibility, not to egui's focus.
    if !had_keyboard && ctx.input(|input| input.key_pressed(egui::Key::Tab)) {
        ctx.memory_mut(|memory| memory.move_focus(egui::FocusDirection::None));
    }
    let shown = *panel.shown;
    let window = ctx.viewport_rect();
    let native = ctx.native_pixels_per_point().unwrap_or(1.0);
    let scale = match preset.panel.scale {
        0.0 => automatic_scale(window.height() * ctx.pixels_per_point(), native),
        scale => scale,
    };
    // Another scale holds from the next frame on.
    let is_scaled = (ctx.zoom_factor() - scale).abs() <= 1e-3;
    if !is_scaled {
        ctx.set_zoom_factor(scale);
    }
    let builder = egui::UiBuilder::new().layer_id(egui::LayerId::background()).max_rect(window);
    let mut root = egui::Ui::new(ctx.clone(), "window".into(), builder);
    let mut rect = window;
    let mut docks = Vec::new();
    for dock in [Dock::Left, Dock::Right].into_iter().filter(|dock| shown.dock(*dock) && !owner.is_locked()) {
        // A narrow window has no room for both.
        if dock == Dock::Right && rect.width() - preset.panel.right_width < LEAST_PICTURE_PX && rect != window {
            continue;
        }
        let (side, width) = match dock {
            Dock::Left => (egui::Panel::left("left"), preset.panel.width.min(0.5 * window.width())),
            Dock::Right => (egui::Panel::right("right"), preset.panel.right_width.min(0.3 * window.width())),
        };
        side.resizable(false)
            .exact_size(width)
            .show_separator_line(false)
            .frame(theme::panel_frame())
            .show(&mut root, |ui| panel.show(ui, dock));
        match dock {
            Dock::Left => rect.min.x += width,
            Dock::Right => rect.max.x -= width,
        }
        let room = match dock {
            Dock::Left => window.with_max_x(rect.min.x),
            Dock::Right => window.with_min_x(rect.max.x),
        };
        step.leave(&ctx, room.x_range());
        docks.push(room);
    }
    if let Some(playhead) = playhead.as_mut().filter(|_| shown.panel && !owner.is_locked()) {
        egui::Panel::bottom("time")
            .resizable(false)
            .exact_size(time_dock::HEIGHT_PX)
            .show_separator_line(false)
            .frame(theme::panel_frame())
            .show(&mut root, |ui| time_dock::show(ui, playhead, preset.playing));
        docks.push(rect.with_min_y(rect.max.y - time_dock::HEIGHT_PX));
        rect.max.y -= time_dock::HEIGHT_PX;
    }
    theme::dim(&ctx, &docks, preset.panel.brightness);
    picture.rect = Rect::from_corners(Vec2::new(rect.min.x, rect.min.y), Vec2::new(rect.max.x, rect.max.y));
    picture.scale = ctx.pixels_per_point();
    picture.is_placed |= is_scaled;
    let painter = root.painter().with_clip_rect(rect);
    let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
    let periodic = panel.scene.as_ref().and_then(|scene| scene.periodic);
    // What belongs to places is written into panoramas, and cannot be drawn over them.
    let is_flat = *backend != ActiveBackend::Surround;
    let view = view_of(camera.0, &panel.settings, periodic, picture.size(), None).ok().filter(|_| is_flat);
    let tint = layer.tint();
    let marked = match &view {
        Some(view) => layer.textures(&ctx, view),
        None => &[],
    };
    let tint = if marked.is_empty() { egui::Color32::WHITE } else { tint };
    let Rect { min, max } = letterbox.within(picture.rect, picture.scale);
    let place = egui::Rect::from_min_max(egui::pos2(min.x, min.y), egui::pos2(max.x, max.y));
    painter.image(picture.texture, place, whole, tint);
    if let Some(view) = &view {
        sheet::paint(&painter, rect, written.textures(&ctx, view));
    }
    let mut on_divider = false;
    if is_flat {
        sheet::paint(&painter, rect, panel.paths.textures(&ctx));
        on_divider = overlay::comparison::draw(&mut root, rect, panel.comparison.bypass_change_detection());
    }
    sheet::paint(&painter, rect, marked);
    if let (Some(view), Some(scene)) = (view, &panel.scene) {
        let time = playhead.as_ref().map_or_else(String::new, |playhead| playhead.times().words(playhead.time()));
        draw_annotations(&painter, rect, (&panel, scene, &time), &picture, (&view, camera.0));
        let (fields, is_about_heights) = (scene.fields(&panel.settings), scene.is_about_heights(panel.settings.mode));
        let places = Looking::of(&panel.looking, &stroke);
        places.draw(&painter, rect, (&picture, view), (&fields, is_about_heights), &scene.length_unit);
    }
    if *camera.1 == Navigation::Fly && panel.scene.is_some() {
        overlay::draw_hint(&painter, rect, "flying      W A S D  Q E      drag to look      F to orbit");
    }
    if let Some(state) = panel.player.state().cloned().filter(|_| is_flat) {
        let folder = panel.player.path().and_then(Path::parent).map(Path::to_owned).unwrap_or_default();
        let mut tell = |why: String| panel.notices.error(why);
        overlay::tour::draw(&painter, rect, &state, &folder, &mut pictures, &mut tell);
    }
    let is_page_shown = panel.is_idle() && !owner.is_locked();
    if panel.files.is_page_shown != is_page_shown {
        panel.files.is_page_shown = is_page_shown;
    }
    if is_page_shown {
        page::show(&mut root, rect, &mut panel.files);
    }
    // An audience reads no notices.
    if !owner.is_locked() {
        overlay::draw_notices(&painter, rect, &panel.notices);
        typed::show(&ctx, rect, &mut panel.files);
        theme::ring(&ctx);
    }
    if panel.shown.help {
        help::draw(&ctx, rect);
    }
    controls.0 = theme::take_controls(&ctx);
    let at = ctx.pointer_latest_pos();
    let over_picture = !owner.is_locked()
        && !on_divider
        && !is_page_shown
        && at.is_some_and(|at| {
            rect.contains(at) && ctx.layer_id_at(at).is_none_or(|layer| layer.order == egui::Order::Background)
        });
    let left = ctx.input(|input| {
        let pointer = &input.pointer;
        [pointer.primary_down(), pointer.primary_pressed(), pointer.primary_clicked()]
    });
    pointer.update(at.map(|at| Vec2::new(at.x, at.y)), over_picture, left);
    let tool = *panel.looking.tool;
    if let Some(cursor) = drawing::cursor(tool).filter(|_| over_picture && is_flat) {
        ctx.set_cursor_icon(cursor);
    }
    // A click without a tool reads the path under it.
    let read = at.filter(|_| pointer.clicked && tool == Tool::default() && panel.paths.is_wanted());
    if let (Some(at), Some(view)) = (read, view) {
        panel.paths.pick(view, picture.pixel(Vec2::new(at.x, at.y)).as_dvec2().to_array());
    }
    let double_click = ctx.input(|input| input.pointer.button_double_clicked(egui::PointerButton::Primary));
    if double_click && over_picture {
        clicked.0 = ctx.pointer_latest_pos().map(|at| Vec2::new(at.x, at.y));
    }
    let any_button = ctx.input(|input| input.pointer.any_down());
    owner.tool_draws = tool.takes_drags() && pointer.held && is_flat;
    let has_keyboard = ctx.egui_wants_keyboard_input() || egui::Popup::is_any_open(&ctx) || panel.files.typed.is_some();
    owner.update(over_picture, any_button, ctx.dragged_id().is_some(), has_keyboard);
    Ok(())
}

/// Draws what is written over the picture.
fn draw_annotations(
    painter: &egui::Painter,
    rect: egui::Rect,
    (state, scene, time): (&PanelState<'_, '_>, &Scene, &str),
    picture: &Picture,
    (view, viewpoint): (&View, &Viewpoint),
) {
    let legend = state.look.as_ref().and_then(|look| look.told(scene));
    let subject = annotate::Subject {
        view,
        scale: picture.scale,
        target: viewpoint.target,
        bounds: scene.frame,
        length_unit: &scene.length_unit,
        time,
        legend: legend.as_ref(),
        labels: &state.looking.objects.labels,
    };
    annotations::paint(painter, rect, &annotate::layout(&state.settings.annotations, &subject));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_as_large_on_a_screen_with_twice_the_pixels() {
        for (height, native, scale) in
            [(720.0, 1.0, 1.0), (1080.0, 1.0, 1.0), (2160.0, 1.0, 2.0), (2160.0, 2.0, 1.0), (1440.0, 1.0, 1.25)]
        {
            assert_eq!(automatic_scale(height, native), scale, "{height} at {native}");
        }
    }
}
