//! The ends of what is brushed, for those who use no pointer: Space brushes the middle of a plot, arrow keys move its ends, Delete lets go.

use super::figure::{Brushing, Frame};
use crate::explore::Plot;
use crate::explore::plot::Part;
use crate::window::theme::{self, Asked, Handle, Ways};
use bevy_egui::egui::{Rect, Response, Sense, Ui, Vec2, WidgetInfo, WidgetType, vec2};

/// What is brushed first: from where to where along each axis, in shares of it.
const MIDDLE: [f32; 2] = [0.25, 0.75];
/// Two ends may not come closer than this share of their axis.
const NARROWEST: f64 = 0.005;
/// Width and height of an end that has the keyboard, logical pixels.
const END_PX: f32 = 10.0;

/// Which parts of a plot can be brushed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// Balls of a profile, which have but their radius for an end.
    Balls,
    /// Ranges of values to the right.
    Ranges,
    /// Rectangles: ranges of values upwards, too.
    Rectangles,
}

impl Parts {
    /// Those of a plot.
    pub fn of(plot: &Plot) -> Parts {
        match plot {
            Plot::Radial(_) => Parts::Balls,
            _ if plot.has_flat_parts() => Parts::Rectangles,
            _ => Parts::Ranges,
        }
    }

    /// The ends that one has.
    fn ends(self) -> &'static [End] {
        match self {
            Parts::Balls => &[End::Right],
            Parts::Ranges => &[End::Left, End::Right],
            Parts::Rectangles => &[End::Left, End::Right, End::Bottom, End::Top],
        }
    }
}

/// An end of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum End {
    Left,
    Right,
    Bottom,
    Top,
}

/// Lets the keyboard and screen readers brush in a plot, whose frame is `plot`: what they ask for.
pub fn by_keys(ui: &Ui, plot: &Response, frame: &Frame<'_>, parts: Parts, brushed: Option<&Part>) -> Option<Brushing> {
    let name = "Plot: drag, or press Space, to select";
    plot.widget_info(|| WidgetInfo::labeled(WidgetType::Button, ui.is_enabled(), name));
    let give_keyboard = |id| ui.memory_mut(|memory| memory.request_focus(id));
    let mut asked = None;
    if let Some(part) = brushed {
        // All of them can be reached, whatever is asked of one.
        for end in parts.ends() {
            asked = end.asked(ui, plot, frame, part).or(asked);
        }
    }
    // The keyboard stays in the plot where the end that had it goes.
    if asked == Some(Brushing::Clear) {
        give_keyboard(plot.id);
    }
    // A click without a pointer is of the keyboard.
    if !plot.clicked() || plot.interact_pointer_pos().is_some() {
        return asked;
    }
    if brushed.is_some() {
        return Some(Brushing::Clear);
    }
    if let Some(first) = parts.ends().first() {
        give_keyboard(plot.id.with(*first));
    }
    let [from, to] = MIDDLE.map(|share| frame.rect.lerp_inside(vec2(share, share)));
    Some(Brushing::To(frame.part(from, to, parts == Parts::Rectangles)))
}

impl End {
    /// What is asked of it where such a part is brushed.
    fn asked(self, ui: &Ui, plot: &Response, frame: &Frame<'_>, part: &Part) -> Option<Brushing> {
        let mut next = *part;
        let (axis, ends, ways) = match self {
            End::Left | End::Right => (frame.across, &mut next.across, Ways::Across),
            End::Bottom | End::Top => (frame.up, next.up.as_mut()?, Ways::Upwards),
        };
        let (own, other, side) = match self {
            End::Left | End::Bottom => (0, 1, "Lower"),
            End::Right | End::Top => (1, 0, "Upper"),
        };
        let (number, limit) = (ends[own], ends[other]);
        let place = frame.place(part);
        let at = match self {
            End::Left => place.left_center(),
            End::Right => place.right_center(),
            End::Bottom => place.center_bottom(),
            End::Top => place.center_top(),
        };
        let rect = Rect::from_center_size(at, Vec2::splat(END_PX));
        let response = ui.interact(rect, plot.id.with(self), Sense::focusable_noninteractive());
        let (name, words) = (format!("{side} end of what is selected: {}", axis.title), theme::brief(number));
        let range = if own == 0 { [axis.range[0], limit] } else { [limit, axis.range[1]] };
        let value = match (Handle { name: &name, place: &words, number, range, ways }).asked(ui, &response)? {
            Asked::Move((right, up)) => axis.value(axis.share(number) + f64::from(right + up)),
            Asked::Number(asked) => asked,
            Asked::Remove => return Some(Brushing::Clear),
        };
        // A part may reach beyond the axis, where it has no shares.
        ends[own] = match own {
            0 => value.min(axis.value(axis.share(limit) - NARROWEST)).min(limit),
            _ => value.max(axis.value(axis.share(limit) + NARROWEST)).max(limit),
        };
        (next != *part).then_some(Brushing::To(next))
    }
}

#[cfg(test)]
mod tests {
    use super::super::figure::{Shown, show};
    use super::*;
    use crate::annotate::{Chart, ChartAxis, Marks};
    use bevy_egui::egui::accesskit::{Action, ActionData, ActionRequest, NodeId, TreeId};
    use bevy_egui::egui::{Context, Event, Key, Modifiers, RawInput};

    const ACROSS: ChartAxis = ChartAxis { title: "density", range: [1.0, 1e4], logarithmic: true };
    const UP: ChartAxis = ChartAxis { title: "mass", range: [0.0, 8.0], logarithmic: false };
    const POINTS: [f64; 2] = [2.0, 4.0];

    /// A plot with what is brushed in it.
    struct Brushed {
        ctx: Context,
        marks: Marks<'static>,
        part: Option<Part>,
    }

    impl Brushed {
        fn new(marks: Marks<'static>) -> Brushed {
            let ctx = Context::default();
            ctx.enable_accesskit();
            Brushed { ctx, marks, part: None }
        }

        /// Draws it once; the nodes of screen readers with their names and values.
        fn frame(&mut self, events: Vec<Event>) -> Vec<(NodeId, String, String)> {
            let parts = Some(match self.marks {
                Marks::Line { .. } => Parts::Balls,
                Marks::Bars { .. } => Parts::Ranges,
                Marks::Cells { .. } | Marks::Points { .. } => Parts::Rectangles,
            });
            let shown = Shown { revision: 1, part: self.part, parts, height: 180.0 };
            let chart = Chart { title: "a.df", note: "", across: ACROSS, up: UP, marks: self.marks };
            let mut asked = None;
            let mut output = self.ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                ui.set_max_width(300.0);
                asked = show(ui, &chart, &shown);
            });
            // Nobody draws them.
            output.textures_delta.clear();
            match asked {
                Some(Brushing::To(part)) => self.part = Some(part),
                Some(Brushing::Clear) => self.part = None,
                None => {}
            }
            let said = |text: Option<&str>| text.unwrap_or_default().to_owned();
            let nodes = output.platform_output.accesskit_update.unwrap().nodes;
            nodes.into_iter().map(|(id, node)| (id, said(node.label()), said(node.value()))).collect()
        }

        /// What is brushed after a key, in shares of the axes.
        fn press(&mut self, key: Key, modifiers: Modifiers) -> Option<(Vec<f64>, Vec<f64>)> {
            let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
            // Arrow keys are a control's from the second frame on that it has the keyboard.
            for events in [vec![Event::ModifiersChanged(modifiers), event], Vec::new(), Vec::new()] {
                self.frame(events);
            }
            let part = self.part?;
            let shares = |axis: ChartAxis<'_>, ends: [f64; 2]| ends.map(|end| axis.share(end)).to_vec();
            Some((shares(ACROSS, part.across), part.up.map_or_else(Vec::new, |up| shares(UP, up))))
        }
    }

    fn is(found: Option<(Vec<f64>, Vec<f64>)>, across: &[f64], up: &[f64]) -> bool {
        let near = |found: &[f64], expected: &[f64]| {
            found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4)
        };
        found.is_some_and(|found| near(&found.0, across) && near(&found.1, up))
    }

    #[test]
    fn a_rectangle_is_brushed_and_its_sides_are_moved_by_keys() {
        let mut plot = Brushed::new(Marks::Points { x: &POINTS, y: &POINTS });
        assert_eq!(plot.press(Key::Tab, Modifiers::NONE), None);
        assert!(is(plot.press(Key::Space, Modifiers::NONE), &[0.25, 0.75], &[0.25, 0.75]));
        assert!(is(plot.press(Key::ArrowRight, Modifiers::NONE), &[0.26, 0.75], &[0.25, 0.75]), "the lower end first");
        plot.press(Key::Tab, Modifiers::NONE);
        assert!(is(plot.press(Key::ArrowLeft, Modifiers::SHIFT), &[0.26, 0.749], &[0.25, 0.75]));
        plot.press(Key::Tab, Modifiers::NONE);
        assert!(is(plot.press(Key::ArrowDown, Modifiers::NONE), &[0.26, 0.749], &[0.24, 0.75]));
        plot.press(Key::Tab, Modifiers::NONE);
        assert!(is(plot.press(Key::ArrowUp, Modifiers::NONE), &[0.26, 0.749], &[0.24, 0.76]));
        assert_eq!(plot.press(Key::Delete, Modifiers::NONE), None);
        assert!(is(plot.press(Key::Space, Modifiers::NONE), &[0.25, 0.75], &[0.25, 0.75]), "the plot has the keyboard");
        plot.press(Key::Tab, Modifiers::SHIFT);
        assert_eq!(plot.press(Key::Space, Modifiers::NONE), None, "a press of the plot lets go, too");
    }

    #[test]
    fn a_ball_has_one_end() {
        let mut plot = Brushed::new(Marks::Line { points: &[[2.0, 1.0]], spreads: &[] });
        plot.press(Key::Tab, Modifiers::NONE);
        plot.press(Key::Space, Modifiers::NONE);
        // As a plot tells what is brushed in a profile.
        plot.part = plot.part.map(|part| Part { across: [0.0, part.across[1]], ..part });
        assert!(is(plot.press(Key::ArrowRight, Modifiers::NONE), &[0.0, 0.76], &[]));
        assert_eq!(plot.part.map(|part| part.across[0]), Some(0.0));
    }

    #[test]
    fn a_screen_reader_sets_an_end_within_the_other_and_the_axis() {
        let mut plot = Brushed::new(Marks::Bars { edges: &[1.0, 100.0, 1e4], values: &POINTS });
        plot.part = Some(Part { across: [10.0, 1000.0], up: None });
        for (asked, expected) in [(500.0, 500.0), (1e9, 1e4), (1.0, 10.0 * 1e4_f64.powf(NARROWEST))] {
            let nodes = plot.frame(Vec::new());
            let upper = nodes.iter().find(|(_, name, _)| name == "Upper end of what is selected: density");
            let (target_node, _, value) = upper.unwrap();
            assert_eq!(*value, theme::brief(plot.part.unwrap().across[1]));
            let (action, data) = (Action::SetValue, Some(ActionData::NumericValue(asked)));
            let request = ActionRequest { action, target_tree: TreeId::ROOT, target_node: *target_node, data };
            plot.frame(vec![Event::AccessKitActionRequest(request)]);
            let [low, high] = plot.part.unwrap().across;
            assert!(low == 10.0 && (high / expected - 1.0).abs() < 1e-9, "{asked}: {low} {high}");
        }
        // Where the axis ends before it, an end can still be taken to the other, and not beyond.
        plot.part = Some(Part { across: [1e5, 1e6], up: None });
        let nodes = plot.frame(Vec::new());
        let (target_node, ..) = nodes.iter().find(|(_, name, _)| name.starts_with("Upper end")).unwrap();
        let (action, data) = (Action::Decrement, None);
        let request = ActionRequest { action, target_tree: TreeId::ROOT, target_node: *target_node, data };
        plot.frame(vec![Event::AccessKitActionRequest(request)]);
        assert_eq!(plot.part, Some(Part { across: [1e5, 1e5], up: None }));
    }
}
