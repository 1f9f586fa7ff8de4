//! A histogram with two ends to drag, or to move with arrow keys: how a range of values is chosen.

use crate::window::state::histogram::AxisHistogram;
use crate::window::theme::{self, Asked, Handle, Ways};
use bevy_egui::egui::{self, Align2, CursorIcon, Pos2, Rect, Response, Sense, Stroke, Ui, pos2, vec2};

/// The ends of a range may not come closer than this share of the axis.
const NARROWEST: f64 = 0.005;

/// Which part of the range is moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Grip {
    Low,
    High,
    Both,
}

impl Grip {
    /// The part of the range `ends` (positions along the axis) that a press at `position` takes hold of, where the
    /// axis is `width` pixels wide.
    fn at(position: f64, ends: [f64; 2], width: f64) -> Grip {
        let reach = 8.0 / width.max(1.0);
        let [low, high] = ends.map(|end| (position - end).abs());
        let inside = position > ends[0] && position < ends[1];
        if inside && low > reach && high > reach {
            Grip::Both
        } else if low < high || (low == high && position < ends[0]) {
            Grip::Low
        } else {
            Grip::High
        }
    }

    /// The range after a drag by `delta` along the axis.
    fn drag(self, ends: [f64; 2], delta: f64) -> [f64; 2] {
        let [low, high] = ends;
        match self {
            Grip::Low => [(low + delta).clamp(0.0, (high - NARROWEST).max(0.0)), high],
            Grip::High => [low, (high + delta).clamp((low + NARROWEST).min(1.0), 1.0)],
            Grip::Both => {
                let delta = delta.clamp(-low.max(0.0), (1.0 - high).max(0.0));
                [low + delta, high + delta]
            }
        }
    }
}

/// What the user did to a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RangeEdit {
    /// Chose a range.
    Set([f64; 2]),
    /// Asked for the automatic one.
    Automatic,
}

/// Draws the histogram, with the bins inside `range` in the colours that they stand for, and lets the user drag the
/// ends (or both, between them); a double-click asks for the automatic range.
pub fn range_editor(
    ui: &mut Ui,
    id: &str,
    histogram: &AxisHistogram,
    range: [f64; 2],
    color: impl Fn(f32) -> egui::Color32,
) -> Option<RangeEdit> {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 36.0), Sense::hover());
    let (name, id) = (id, ui.id().with(id));
    let response = ui.interact(rect, id, Sense::click_and_drag());
    let painter = ui.painter().with_clip_rect(rect.expand(8.0));
    painter.rect_filled(rect, 4.0, theme::WELL);
    let plot = rect.shrink2(vec2(6.0, 4.0));
    let ends = range.map(|value| histogram.position(value).clamp(0.0, 1.0));
    paint_bins(&painter, plot, histogram, ends, color);
    for end in ends {
        let grip = grip_rect(plot, end);
        painter.vline(grip.center().x, rect.y_range(), Stroke::new(1.5, theme::TEXT));
        painter.rect_filled(grip, 2.0, theme::TEXT);
    }
    let parts = [Grip::Both, Grip::Low, Grip::High];
    let asked = parts.map(|grip| by_keys(ui, &response, plot, (name, grip), histogram, range));
    let position = |at: Pos2| f64::from((at.x - plot.left()) / plot.width());
    if response.hovered() || response.dragged() {
        ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
    }
    if response.double_clicked() {
        return Some(RangeEdit::Automatic);
    }
    if response.drag_started()
        && let Some(start) = ui.input(|input| input.pointer.press_origin())
    {
        let grip = Grip::at(position(start), ends, f64::from(plot.width()));
        ui.data_mut(|data| data.insert_temp(id, grip));
    }
    if response.dragged()
        && let Some(grip) = ui.data(|data| data.get_temp::<Grip>(id))
    {
        let delta = f64::from(response.drag_delta().x / plot.width());
        if delta != 0.0 {
            return Some(RangeEdit::Set(grip.drag(ends, delta).map(|end| histogram.value(end))));
        }
    }
    asked.into_iter().flatten().next()
}

/// Where the grip of an end is.
fn grip_rect(plot: Rect, end: f64) -> Rect {
    let x = egui::lerp(plot.left()..=plot.right(), end as f32);
    Rect::from_center_size(pos2(x, plot.center().y), vec2(5.0, 16.0))
}

/// Lets the keyboard and screen readers reach a part of the range: what they ask of it. `whole` is the plot, and both ends.
fn by_keys(
    ui: &Ui,
    whole: &Response,
    plot: Rect,
    (name, grip): (&str, Grip),
    histogram: &AxisHistogram,
    range: [f64; 2],
) -> Option<RangeEdit> {
    let ends = range.map(|value| histogram.position(value).clamp(0.0, 1.0));
    let end = |end: f64| ui.interact(grip_rect(plot, end), whole.id.with(grip), Sense::focusable_noninteractive());
    let ([low, high], [least, most]) = (range, histogram.span);
    let (part, response, number, limits) = match grip {
        Grip::Both => ("range over its distribution", whole.clone(), low, histogram.span),
        Grip::Low => ("lower end over its distribution", end(ends[0]), low, [least, high]),
        Grip::High => ("upper end over its distribution", end(ends[1]), high, [low, most]),
    };
    let name = format!("{name}: {part}");
    let place = match grip {
        Grip::Both => format!("{} to {}", theme::brief(low), theme::brief(high)),
        Grip::Low | Grip::High => theme::brief(number),
    };
    let handle = Handle { name: &name, place: &place, number, range: limits, ways: Ways::Across };
    let delta = match handle.asked(ui, &response)? {
        Asked::Move((right, _)) => f64::from(right),
        Asked::Number(asked) => histogram.position(asked) - histogram.position(number),
        Asked::Remove => return Some(RangeEdit::Automatic),
    };
    Some(RangeEdit::Set(grip.drag(ends, delta).map(|end| histogram.value(end))))
}

/// The bins as bars whose height is logarithmic in the count, so that rare values show.
fn paint_bins(
    painter: &egui::Painter,
    plot: Rect,
    histogram: &AxisHistogram,
    ends: [f64; 2],
    color: impl Fn(f32) -> egui::Color32,
) {
    let top = histogram.counts.iter().fold(0.0f64, |top, &count| top.max(count)).ln_1p();
    if top <= 0.0 {
        painter.text(
            plot.center(),
            Align2::CENTER_CENTER,
            "no values",
            egui::FontId::proportional(theme::SMALL),
            theme::LABEL,
        );
        return;
    }
    let bins = histogram.counts.len();
    for (i, &count) in histogram.counts.iter().enumerate() {
        let height = (count.max(0.0).ln_1p() / top) as f32 * plot.height();
        if height <= 0.0 {
            continue;
        }
        let left = plot.left() + plot.width() * i as f32 / bins as f32;
        let right = plot.left() + plot.width() * (i + 1) as f32 / bins as f32;
        let middle = (i as f64 + 0.5) / bins as f64;
        let inside = (ends[0]..=ends[1]).contains(&middle);
        let t = (middle - ends[0]) / (ends[1] - ends[0]).max(1e-9);
        // Dark ends of a colour map would vanish in the well.
        let fill = if inside { lift(color(t as f32)) } else { theme::LINE };
        let bar = Rect::from_min_max(pos2(left, plot.bottom() - height), pos2(right, plot.bottom()));
        painter.rect_filled(bar, 0.0, fill);
    }
}

/// A colour, not darker than can be seen on the well.
fn lift(color: egui::Color32) -> egui::Color32 {
    let floor = |channel: u8, least: u8| channel.max(least);
    egui::Color32::from_rgb(floor(color.r(), 58), floor(color.g(), 60), floor(color.b(), 70))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy_egui::egui::accesskit::{Action, ActionData, ActionRequest, TreeId};
    use bevy_egui::egui::{Color32, Context, Event, Key, Modifiers, RawInput};

    #[test]
    fn the_nearest_end_is_taken_and_the_middle_moves_both() {
        let ends = [0.2, 0.8];
        assert_eq!(Grip::at(0.21, ends, 280.0), Grip::Low);
        assert_eq!(Grip::at(0.05, ends, 280.0), Grip::Low);
        assert_eq!(Grip::at(0.79, ends, 280.0), Grip::High);
        assert_eq!(Grip::at(0.95, ends, 280.0), Grip::High);
        assert_eq!(Grip::at(0.5, ends, 280.0), Grip::Both);
        assert_eq!(Grip::at(0.4, [0.4, 0.4], 280.0), Grip::High);
    }

    #[test]
    fn a_drag_keeps_the_ends_apart_and_on_the_axis() {
        assert_eq!(Grip::Low.drag([0.2, 0.8], -0.5), [0.0, 0.8]);
        assert_eq!(Grip::Low.drag([0.2, 0.8], 0.9), [0.8 - NARROWEST, 0.8]);
        assert_eq!(Grip::High.drag([0.2, 0.8], -0.9), [0.2, 0.2 + NARROWEST]);
        let [low, high] = Grip::Both.drag([0.2, 0.8], 0.5);
        assert!((low - 0.4).abs() < 1e-12 && (high - 1.0).abs() < 1e-12);
        // A range that is beyond the axis has no room to move in.
        assert_eq!(Grip::Low.drag([0.0, 0.0], 0.1), [0.0, 0.0]);
        assert_eq!(Grip::High.drag([1.0, 1.0], -0.1), [1.0, 1.0]);
    }

    #[test]
    fn ends_are_moved_by_keys_and_by_screen_readers() {
        let ctx = Context::default();
        ctx.enable_accesskit();
        let histogram = AxisHistogram { counts: vec![1.0; 8], span: [0.0, 100.0], log: false };
        let frame = |events: Vec<Event>| {
            let mut edit = None;
            let mut output = ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                ui.set_max_width(300.0);
                edit = range_editor(ui, "hue", &histogram, [20.0, 80.0], |_| Color32::WHITE);
            });
            // Nobody draws them.
            output.textures_delta.clear();
            (edit, output.platform_output.accesskit_update.unwrap().nodes)
        };
        let press = |key: Key| {
            let modifiers = Modifiers::NONE;
            let (edit, _) =
                frame(vec![Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers }]);
            // Arrow keys are a control's from the second frame on that it has the keyboard.
            frame(Vec::new());
            edit
        };
        let is = |edit: Option<RangeEdit>, low: f64, high: f64| match edit {
            Some(RangeEdit::Set(ends)) => (ends[0] - low).hypot(ends[1] - high) < 1e-4,
            Some(RangeEdit::Automatic) | None => false,
        };
        assert_eq!(press(Key::Tab), None);
        assert!(is(press(Key::ArrowRight), 21.0, 81.0), "both ends first");
        assert_eq!(press(Key::Tab), None);
        assert!(is(press(Key::ArrowLeft), 19.0, 80.0));
        assert_eq!(press(Key::Tab), None);
        assert!(is(press(Key::ArrowRight), 20.0, 81.0));
        assert_eq!(press(Key::Delete), Some(RangeEdit::Automatic));
        let (_, nodes) = frame(Vec::new());
        let upper = |node: &str| node == "hue: upper end over its distribution";
        let (target_node, node) = nodes.into_iter().find(|(_, node)| node.label().is_some_and(upper)).unwrap();
        assert_eq!((node.value(), node.numeric_value()), (Some("80"), Some(80.0)));
        let (action, data) = (Action::SetValue, Some(ActionData::NumericValue(55.0)));
        let request = ActionRequest { action, target_tree: TreeId::ROOT, target_node, data };
        assert!(is(frame(vec![Event::AccessKitActionRequest(request)]).0, 20.0, 55.0));
    }
}
