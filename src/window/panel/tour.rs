//! The section about tours: what plays, the timeline with its keyframes, and the one that is edited.

use super::theme::{self, Handle, Ways};
use super::{Dock, PanelState, Section};
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
/// The latest time of a keyframe that is typed or moved, seconds.
const LATEST_SECS: f64 = 1e6;

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

/// The timeline: a click or drag above shows a time, keyframes below are chosen and dragged; arrow keys move both, Delete removes a keyframe.
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
    let now = player.state().map_or(0.0, |state| state.time);
    let words = seconds(now);
    let (name, range) = ("Time of the tour", [0.0, duration]);
    let by_keys = (Handle { name, place: &words, number: now, range, ways: Ways::Across }).asked(ui, &scrub);
    let by_keys = by_keys.and_then(|asked| moved(asked, now, duration));
    let dragged = scrub.interact_pointer_pos().filter(|_| scrub.dragged() || scrub.clicked());
    if let Some(time) = dragged.map(|at| time_at(at.x)).or(by_keys) {
        asked.push(Asked::Seek(time.clamp(0.0, duration)));
    }
    let middle = bar.bottom() + 0.5 * (rect.bottom() - bar.bottom());
    let plot = ui.id();
    let mark_of = |i: usize| plot.with(("mark", i));
    let stops = timeline.stops();
    for (i, stop) in stops.iter().enumerate() {
        let color = if *selected == Some(i) { theme::ACCENT } else { theme::LABEL };
        let stay = Rect::from_x_y_ranges(x(stop.arrive)..=x(stop.leave), (middle - 1.5)..=(middle + 1.5));
        painter.rect_filled(stay, 0.0, color.gamma_multiply(0.6));
        let at = pos2(x(stop.arrive), middle);
        let mark = Rect::from_center_size(at, egui::Vec2::splat(2.0 * MARK_PX + 2.0));
        theme::register(ui, &format!("tour:{i}"), mark);
        let response = ui.interact(mark, mark_of(i), Sense::click_and_drag());
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
        let words = seconds(stop.arrive);
        let before = i.checked_sub(1).map_or(0.0, |before| stops[before].leave);
        let after = stops.get(i + 1).map_or(LATEST_SECS, |next| next.arrive - (stop.leave - stop.arrive));
        let range = [before, after];
        let handle = Handle { name: &named, place: &words, number: stop.arrive, range, ways: Ways::Across };
        if let Some(by_keys) = handle.asked(ui, &response) {
            *selected = Some(i);
            match moved(by_keys, stop.arrive, duration) {
                Some(time) => asked.push(Asked::Retime(i, time)),
                None => {
                    asked.push(Asked::Remove(i));
                    // The one that comes to its place is next, and after the last one that before it.
                    let next = i.min(stops.len().saturating_sub(2));
                    *selected = Some(next);
                    ui.memory_mut(|memory| memory.request_focus(mark_of(next)));
                }
            }
        }
        response.on_hover_text(format!("{named}, at {words}"));
    }
    if let Some(state) = player.state() {
        painter.vline(x(state.time), rect.y_range(), Stroke::new(1.5, theme::TEXT));
    }
    ui.add_space(3.0);
}

/// Where what is asked by keys takes a time on a timeline that is so long; `None` where it is to go.
fn moved(asked: theme::Asked, time: f64, duration: f64) -> Option<f64> {
    match asked {
        theme::Asked::Move((right, _)) => Some(time + duration * f64::from(right)),
        theme::Asked::Number(asked) => Some(asked),
        theme::Asked::Remove => None,
    }
}

/// A time as it is told.
fn seconds(time: f64) -> String {
    format!("{time:.1} s")
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
        let drag = egui::DragValue::new(&mut at).range(0.0..=LATEST_SECS).speed(0.05).max_decimals(2).suffix(" s");
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::touring::tests::timeline;
    use bevy_egui::egui::accesskit::{Action, ActionData, ActionRequest, TreeId};
    use bevy_egui::egui::{Context, Event, Key, Modifiers, RawInput};

    #[test]
    fn keys_and_screen_readers_move_the_time_and_keyframes_and_remove_these() {
        // Keyframes at 0, 4 and 9 s; at the second, "halo", the tour stays for a second.
        let (player, timeline) = (Player::default(), timeline(false));
        let ctx = Context::default();
        ctx.enable_accesskit();
        let frame = |events: Vec<Event>| {
            let (mut asked, mut selected) = (Vec::new(), None);
            let mut output = ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                ui.set_max_width(300.0);
                strip(ui, &player, &timeline, &mut asked, &mut selected);
            });
            // Nobody draws them.
            output.textures_delta.clear();
            (asked, selected, output.platform_output.accesskit_update.unwrap().nodes)
        };
        let press = |key: Key| {
            let modifiers = Modifiers::NONE;
            let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
            let (asked, selected, _) = frame(vec![event]);
            // Arrow keys are a control's from the second frame on that it has the keyboard.
            frame(Vec::new());
            frame(Vec::new());
            (asked, selected)
        };
        let moves_to = |(asked, selected): (Vec<Asked>, Option<usize>), index: usize, time: f64| {
            let is = |to: f64| (to - time).abs() < 1e-5 && selected == Some(index);
            matches!(&asked[..], [Asked::Retime(moved, to)] if *moved == index && is(*to))
        };
        let nothing: (Vec<Asked>, Option<usize>) = (Vec::new(), None);
        assert_eq!(press(Key::Tab), nothing);
        let (asked, _) = press(Key::ArrowRight);
        assert!(matches!(asked[..], [Asked::Seek(time)] if (time - 0.09).abs() < 1e-5), "{asked:?}");
        assert_eq!(press(Key::Delete), nothing, "time does not go");
        press(Key::Tab);
        assert_eq!(press(Key::Tab), nothing);
        assert!(moves_to(press(Key::ArrowLeft), 1, 3.91));
        assert_eq!(press(Key::Space), (vec![Asked::Seek(4.0)], Some(1)));
        assert_eq!(press(Key::Delete), (vec![Asked::Remove(1)], Some(1)));
        assert!(moves_to(press(Key::ArrowRight), 1, 4.09), "the one in its place has the keyboard");
        assert_eq!(press(Key::Tab), nothing);
        assert!(moves_to(press(Key::ArrowRight), 2, 9.09), "beyond the end the tour grows");
        assert_eq!(press(Key::Delete), (vec![Asked::Remove(2)], Some(1)));
        assert!(moves_to(press(Key::ArrowRight), 1, 4.09), "that before it has the keyboard");

        let (_, _, nodes) = frame(Vec::new());
        let (target_node, node) = nodes.into_iter().find(|(_, node)| node.label() == Some("halo")).unwrap();
        assert_eq!((node.value(), node.numeric_value()), (Some("4.0 s"), Some(4.0)));
        for (time, expected) in [(6.0, 6.0), (100.0, 8.0)] {
            let (action, data) = (Action::SetValue, Some(ActionData::NumericValue(time)));
            let request = ActionRequest { action, target_tree: TreeId::ROOT, target_node, data };
            let (asked, selected, _) = frame(vec![Event::AccessKitActionRequest(request)]);
            assert!(moves_to((asked, selected), 1, expected), "within those beside it");
        }
    }
}
