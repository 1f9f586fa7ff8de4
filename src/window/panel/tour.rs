//! The section about tours: what plays, the timeline with its keyframes, and the one that is edited.

use super::{Dock, PanelState, Section, theme};
use crate::annotate::number;
use crate::tour::Timeline;
use crate::window::touring::{Asked, Player};
use bevy_egui::egui::{self, CursorIcon, Rect, RichText, Sense, Stroke, TextEdit, Ui, pos2, vec2};

/// The section.
pub static SECTION: Section =
    Section { name: "tour", title: "Tour", dock: Dock::Right, applies: |state| state.scene.is_some(), show };

/// Height of the timeline: the upper part is the clock's, the lower the keyframes'. Logical pixels.
const HEIGHT_PX: f32 = 34.0;
/// Half the width of a keyframe's mark, logical pixels.
const MARK_PX: f32 = 5.0;

fn show(ui: &mut Ui, state: &mut PanelState<'_, '_>) {
    let player = &*state.player;
    let mut asked: Vec<Asked> = Vec::new();
    let mut selected = player.selected;
    if let (Some(tour), Some(timeline)) = (player.tour(), player.timeline()) {
        let name = player.path().and_then(|path| path.file_name()).map(|name| name.to_string_lossy().into_owned());
        let title =
            if tour.title.is_empty() { name.unwrap_or_else(|| "A new tour".into()) } else { tour.title.clone() };
        let mark = if player.is_edited() { " *" } else { "" };
        ui.add(egui::Label::new(RichText::new(format!("{title}{mark}")).color(theme::TEXT)).truncate());
        transport(ui, player, timeline, &mut asked);
        strip(ui, player, timeline, &mut asked, &mut selected);
        if let Some(index) = selected.filter(|index| *index < tour.keyframes.len()) {
            keyframe(ui, player, timeline, index, &mut asked);
        }
    } else {
        let text =
            "Keep views as keyframes (K), or record a flight, and a tour leads through them. Or drop a tour file here.";
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)).wrap());
    }
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        let help = "Makes a keyframe of what is shown: of this moment where the tour is shown, else after its end (K)";
        if theme::button(ui, "tour:keep", "Keyframe", true, help) {
            asked.push(Asked::Keep);
        }
        let (text, help) = match player.is_recording() {
            true => ("Stop recording", "Ends the recording of your flight"),
            false => ("Record", "Makes keyframes of your flight until you press it again"),
        };
        if theme::button(ui, "tour:record", text, true, help) {
            asked.push(Asked::Record);
        }
        if player.tour().is_some() {
            if theme::button(ui, "tour:save", "Save", true, "Saves the tour beside the data, or where it came from") {
                asked.push(Asked::Save);
            }
            if theme::button(ui, "tour:close", "\u{d7}", true, "Closes the tour") {
                asked.push(Asked::Close);
            }
        }
    });
    if state.player.selected != selected {
        state.player.selected = selected;
    }
    asked.into_iter().for_each(|asked| state.player.ask(asked));
}

/// The buttons of a presenter, and what time it is.
fn transport(ui: &mut Ui, player: &Player, timeline: &Timeline, asked: &mut Vec<Asked>) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        let runs = player.clock().is_running() && player.state().is_some();
        if theme::button(ui, "tour:back", "|<", true, "Back to the last named keyframe (Left)") {
            asked.push(Asked::Back);
        }
        let (text, help) = match (runs, player.clock().waiting()) {
            (true, _) => ("Pause", "Stands where it is (Space)"),
            (false, Some(_)) => ("Go on", "The tour waits here for you (Space)"),
            (false, None) => ("Play", "Plays the tour (Space)"),
        };
        if theme::button(ui, "tour:play", text, true, help) {
            asked.push(Asked::Toggle);
        }
        if theme::button(ui, "tour:next", ">|", true, "On to the next named keyframe (Right)") {
            asked.push(Asked::Next);
        }
        let time = player.state().map_or_else(|| "away".to_owned(), |state| format!("{:.1}", state.time));
        let text = format!("{time} of {:.1} s", timeline.duration());
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)));
    });
}

/// The timeline: a click or drag above shows a time, keyframes below are chosen and dragged.
fn strip(ui: &mut Ui, player: &Player, timeline: &Timeline, asked: &mut Vec<Asked>, selected: &mut Option<usize>) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), HEIGHT_PX), Sense::hover());
    theme::register(ui, "tour:timeline", rect);
    let bar = Rect::from_min_max(rect.min, pos2(rect.right(), rect.top() + 0.45 * HEIGHT_PX));
    let range = (rect.left() + MARK_PX)..=(rect.right() - MARK_PX);
    let duration = timeline.duration().max(1e-9);
    let width = f64::from(range.end() - range.start());
    let x = |time: f64| range.start() + (width * (time / duration).clamp(0.0, 1.0)) as f32;
    let time_at = |x: f32| duration * f64::from(x - range.start()) / width;
    let painter = ui.painter().clone();
    painter.rect_filled(rect, 3.0, theme::WELL);
    let scrub = ui.interact(bar, ui.id().with("scrub"), Sense::click_and_drag());
    theme::call(&scrub, "Time of the tour");
    if let Some(at) = scrub.interact_pointer_pos().filter(|_| scrub.dragged() || scrub.clicked()) {
        asked.push(Asked::Seek(time_at(at.x).clamp(0.0, duration)));
    }
    let middle = bar.bottom() + 0.5 * (rect.bottom() - bar.bottom());
    for (i, stop) in timeline.stops().iter().enumerate() {
        let color = if *selected == Some(i) { theme::ACCENT } else { theme::LABEL };
        let stay = Rect::from_x_y_ranges(x(stop.arrive)..=x(stop.leave), (middle - 1.5)..=(middle + 1.5));
        painter.rect_filled(stay, 0.0, color.gamma_multiply(0.6));
        let at = pos2(x(stop.arrive), middle);
        let mark = Rect::from_center_size(at, egui::Vec2::splat(2.0 * MARK_PX + 2.0));
        theme::register(ui, &format!("tour:{i}"), mark);
        let response = ui.interact(mark, ui.id().with(("mark", i)), Sense::click_and_drag());
        let corners =
            [vec2(0.0, -MARK_PX), vec2(MARK_PX, 0.0), vec2(0.0, MARK_PX), vec2(-MARK_PX, 0.0)].map(|side| at + side);
        let hot = if response.hovered() || response.dragged() { theme::TEXT } else { color };
        painter.add(egui::Shape::convex_polygon(corners.to_vec(), hot, Stroke::NONE));
        if stop.hold {
            painter.vline(at.x, bar.bottom()..=rect.bottom(), Stroke::new(1.0, theme::ACCENT));
        }
        if response.hovered() {
            ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
        }
        if response.clicked() {
            *selected = Some(i);
            asked.push(Asked::Seek(stop.arrive));
        }
        if response.dragged()
            && let Some(pointer) = response.interact_pointer_pos()
        {
            *selected = Some(i);
            // Beyond the right end the tour grows.
            asked.push(Asked::Retime(i, time_at(pointer.x)));
        }
        let named = stop.label.as_deref().map_or_else(|| format!("keyframe {}", i + 1), str::to_owned);
        theme::call(&response, &named);
        response.on_hover_text(format!("{named}, at {:.1} s", stop.arrive));
    }
    if let Some(state) = player.state() {
        painter.vline(x(state.time), rect.y_range(), Stroke::new(1.5, theme::TEXT));
    }
    ui.add_space(3.0);
}

/// The keyframe that is edited.
fn keyframe(ui: &mut Ui, player: &Player, timeline: &Timeline, index: usize, asked: &mut Vec<Asked>) {
    let Some((keyframe, stop)) =
        player.tour().and_then(|tour| Some((tour.keyframes.get(index)?, timeline.stops().get(index)?)))
    else {
        return;
    };
    let mut at = stop.arrive;
    theme::row(ui, &format!("Keyframe {}", index + 1), |ui| {
        let drag = egui::DragValue::new(&mut at).range(0.0..=1e6).speed(0.05).max_decimals(2).suffix(" s");
        let response = ui.add(drag);
        theme::call(&response, &format!("Time of keyframe {}", index + 1));
        theme::register(ui, "tour:at", response.rect);
        if response.changed() {
            asked.push(Asked::Retime(index, at));
        }
    });
    for (name, hint, text, make) in [
        ("tour:label", "a name", keyframe.label.clone(), Asked::Label as fn(usize, String) -> Asked),
        ("tour:caption", "words at the foot", keyframe.caption.clone(), Asked::Caption),
    ] {
        let mut text = text.unwrap_or_default();
        let field = TextEdit::singleline(&mut text).desired_width(ui.available_width() - 12.0).hint_text(hint);
        let response = ui.add(field.char_limit(300));
        theme::call(&response, hint);
        theme::register(ui, name, response.rect);
        if response.changed() {
            asked.push(make(index, text));
        }
    }
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 5.0;
        if theme::button(ui, "tour:copy", "Copy", true, "Another keyframe that shows the same, after this one") {
            asked.push(Asked::Copy(index));
        }
        if theme::button(ui, "tour:remove", "Remove", true, "Removes the keyframe; the others stay as they are") {
            asked.push(Asked::Remove(index));
        }
        let way = timeline.stops().get(index + 1).map(|next| next.arrive - stop.leave);
        let text = way
            .map_or_else(String::new, |way| format!("{} s to the next", number::quantity((10.0 * way).round() / 10.0)));
        ui.add(egui::Label::new(RichText::new(text).size(12.0).color(theme::LABEL)));
    });
}
