//! The dock at the foot of the window that has a run open: where it stands among its steps, and what lets it play.

use super::playhead::Playhead;
use super::preset::{Along, Over, PlayingPreset, Repeat};
use super::theme::{self, Asked, Handle, Ways};
use bevy_egui::egui::{self, Align2, FontId, Sense, Stroke, StrokeKind, Ui, pos2, vec2};

/// Height of the dock, logical pixels.
pub const HEIGHT_PX: f32 = 40.0;

/// Height of the line of time.
const LINE_PX: f32 = 24.0;

/// Width of the time that is written at its end; of comoving data, whose times are two numbers.
const TIME_PX: [f32; 2] = [64.0, 120.0];

/// Width of what is said of steps behind it, and of the dock's part from there on where there is room for it.
const STEPS_PX: [f32; 2] = [86.0, 300.0];

/// Draws the dock, and does what is asked of it; `before` is how the run is played.
pub fn show(ui: &mut Ui, playhead: &mut Playhead, before: PlayingPreset) {
    let mut how = before;
    ui.horizontal_centered(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        if theme::button(ui, "time:first", "|<", true, "The first step (Shift+comma)") {
            playhead.go_to_end(false);
        }
        if theme::button(ui, "time:back", "<", true, "A step back (comma)") {
            playhead.step(-1);
        }
        let (text, help) = if playhead.is_playing() {
            ("Stand", "Stands (T)")
        } else {
            ("Play", "Plays the run (T); [ and ] change the speed")
        };
        if theme::button(ui, "time:play", text, true, help) {
            playhead.toggle();
        }
        if theme::button(ui, "time:on", ">", true, "A step on (full stop)") {
            playhead.step(1);
        }
        if theme::button(ui, "time:last", ">|", true, "The last step (Shift+full stop)") {
            playhead.go_to_end(true);
        }
        if playhead.has_tracks() {
            let mut holds = playhead.holds();
            let toggle = ui.checkbox(&mut holds, "Steps");
            theme::register(ui, "time:steps", toggle.rect);
            if toggle.on_hover_text("Shows the stored steps alone, and nothing that moves between them").changed() {
                playhead.hold(holds);
            }
        }
        let more = ui.menu_button("...", |ui| options(ui, &mut how)).response;
        theme::call(&more, "How the run is played");
        theme::register(ui, "time:more", more.rect);
        more.on_hover_text("How the run is played");
        ui.add_space(8.0);
        let says_steps = ui.available_width() > STEPS_PX[1];
        let words = TIME_PX[usize::from(playhead.times().redshifts.is_some())];
        line(ui, playhead, how.marks, words + if says_steps { STEPS_PX[0] } else { 0.0 });
        let (step, last) = (playhead.shown(), playhead.times().times.len().saturating_sub(1));
        let speed = match playhead.speed() {
            1.0 => String::new(),
            faster if faster > 1.0 => format!("   {faster} x"),
            slower => format!("   1/{} x", 1.0 / slower),
        };
        let help =
            "The time of the data, as the snapshots' headers count it; of comoving data redshift and scale factor";
        ui.label(playhead.times().words(playhead.time())).on_hover_text(help);
        if says_steps {
            ui.add_space(6.0);
            ui.label(egui::RichText::new(format!("step {step} of {last}{speed}")).color(theme::LABEL));
        }
    });
    if how != before {
        playhead.play_as(how);
    }
}

/// How the run is played.
fn options(ui: &mut Ui, how: &mut PlayingPreset) {
    let choice = |ui: &mut Ui, name: &str, text: &str, is_chosen: bool| {
        let label = ui.selectable_label(is_chosen, text);
        theme::register(ui, name, label.rect);
        label.clicked()
    };
    for (name, text, repeat) in [
        ("time:once", "Stand at the end", Repeat::Once),
        ("time:again", "Begin again at the end", Repeat::Again),
        ("time:to-and-fro", "Go to and fro", Repeat::ToAndFro),
    ] {
        if choice(ui, name, text, how.repeat == repeat) {
            how.repeat = repeat;
        }
    }
    ui.separator();
    for (name, text, along) in [
        ("time:by-time", "Time goes evenly", Along::Time),
        ("time:by-steps", "Each step takes the same time", Along::Steps),
    ] {
        if choice(ui, name, text, how.pace == along) {
            (how.pace, how.marks) = (along, along);
        }
    }
    ui.separator();
    for (name, text, over) in [
        ("time:of-run", "Colours for the whole run", Over::Run),
        ("time:of-now", "Colours for each picture", Over::Now),
    ] {
        if choice(ui, name, text, how.range == over) {
            how.range = over;
        }
    }
}

/// The line of time: a mark for each step, and the playhead, which is dragged or moved with arrow keys; beside it `words` are left for what is said.
fn line(ui: &mut Ui, playhead: &mut Playhead, marks: Along, words: f32) {
    let width = (ui.available_width() - words).max(40.0);
    let (rect, response) = ui.allocate_exact_size(vec2(width, LINE_PX), Sense::click_and_drag());
    let (now, number, range) = (playhead.times().words(playhead.time()), playhead.time(), playhead.ends());
    let asked = Handle { name: "Time of the run", place: &now, number, range, ways: Ways::Across }.asked(ui, &response);
    theme::register(ui, "time:line", rect);
    let times = &playhead.times().times;
    let inner = rect.shrink2(vec2(6.0, 0.0));
    let at = |time: f64| inner.left() + inner.width() * playhead.share(time, marks) as f32;
    let under = |x: f32| playhead.time_at(f64::from((x - inner.left()) / inner.width()), marks);
    let painter = ui.painter();
    let track = egui::Rect::from_center_size(inner.center(), vec2(inner.width(), 4.0));
    painter.rect_filled(track, 2.0, theme::WELL);
    painter.rect_filled(track.with_max_x(at(playhead.time())), 2.0, theme::ACCENT.gamma_multiply(0.5));
    // Marks that would touch each other say nothing.
    let gap = inner.width() / times.len().max(1) as f32;
    for (step, time) in times.iter().enumerate() {
        let is_damaged = playhead.damaged().contains(&step);
        if gap < 3.0 && !is_damaged && step != playhead.shown() {
            continue;
        }
        let (color, height) = match (is_damaged, step == playhead.shown()) {
            (true, _) => (theme::BAD, 12.0),
            (false, true) => (theme::TEXT, 12.0),
            (false, false) => (theme::LABEL, 7.0),
        };
        let [top, foot] = [-0.5, 0.5].map(|side| pos2(at(*time), inner.center().y + side * height));
        painter.line_segment([top, foot], Stroke::new(1.0, color));
    }
    let place = pos2(at(playhead.time()), inner.center().y);
    let color = if playhead.is_there() { theme::ACCENT } else { theme::LABEL };
    painter.circle(place, 5.0, color, Stroke::new(1.0, theme::PANEL));
    if response.hovered() {
        painter.rect_stroke(rect, 3.0, Stroke::new(1.0, theme::LINE), StrokeKind::Inside);
    }
    if let Some(pointer) = response.interact_pointer_pos().filter(|_| response.dragged() || response.clicked()) {
        let time = under(pointer.x);
        playhead.seek(time);
    } else if let Some(pointer) = response.hover_pos() {
        let text = playhead.times().words(under(pointer.x));
        painter.text(
            pos2(pointer.x, rect.top()),
            Align2::CENTER_BOTTOM,
            text,
            FontId::proportional(theme::SMALL),
            theme::TEXT,
        );
    }
    match asked {
        Some(Asked::Move((right, _))) => {
            let time = playhead.time_at(playhead.share(number, marks) + f64::from(right), marks);
            playhead.seek(time);
        }
        Some(Asked::Number(time)) => playhead.seek(time),
        Some(Asked::Remove) | None => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::playhead::tests::playhead;
    use bevy_egui::egui::accesskit::{Action, ActionData, ActionRequest, TreeId};
    use bevy_egui::egui::{Context, Event, Key, Modifiers, RawInput};

    #[test]
    fn keys_and_screen_readers_go_through_time() {
        let folder = tempfile::tempdir().unwrap();
        let mut playhead = playhead(folder.path());
        let ctx = Context::default();
        ctx.enable_accesskit();
        let mut frame = |events: Vec<Event>| {
            let mut output = ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                ui.set_max_width(600.0);
                line(ui, &mut playhead, Along::Time, TIME_PX[0]);
            });
            // Nobody draws them.
            output.textures_delta.clear();
            let nodes = output.platform_output.accesskit_update.unwrap().nodes;
            let (id, node) = nodes.into_iter().find(|(_, node)| node.label() == Some("Time of the run")).unwrap();
            (playhead.time(), id, node.value().map(str::to_owned))
        };
        let press = |key: Key| {
            vec![Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE }]
        };
        let (time, target_node, said) = frame(press(Key::Tab));
        assert_eq!((time, said.as_deref()), (0.0, Some("t = 0")));
        frame(Vec::new());
        assert!((frame(press(Key::ArrowRight)).0 - 0.04).abs() < 1e-6, "a hundredth of the run, which ends at 4");
        let (action, data) = (Action::SetValue, Some(ActionData::NumericValue(3.0)));
        let request = ActionRequest { action, target_tree: TreeId::ROOT, target_node, data };
        assert_eq!(frame(vec![Event::AccessKitActionRequest(request)]).0, 3.0);
        assert_eq!(frame(Vec::new()).2.as_deref(), Some("t = 3"));
    }
}
