//! Handles of plots for those who use no pointer: Tab reaches them, arrow keys move them, and a screen reader says where they
//! are and moves them.

use bevy_egui::egui::accesskit::{Action, ActionData};
use bevy_egui::egui::{EventFilter, Key, Response, Ui, WidgetInfo};

/// How far an arrow key moves a handle, as a share of the plot.
const STEP: f32 = 0.01;
/// The same with Shift, which makes a drag on a number finer by as much.
const FINE_STEP: f32 = 0.1 * STEP;

/// Which ways a handle moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ways {
    /// To the left and right.
    Across,
    /// Up and down.
    Upwards,
    /// Both.
    Both,
}

/// What keys or a screen reader ask of a handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Asked {
    /// To move so far to the right and upwards, in shares of the plot.
    Move((f32, f32)),
    /// To have this number.
    Number(f64),
    /// To go.
    Remove,
}

/// What is said of a handle.
pub struct Handle<'a> {
    /// What it is called.
    pub name: &'a str,
    /// Where it is, in words.
    pub place: &'a str,
    /// Its number; where it moves both ways, that of its height.
    pub number: f64,
    /// The least and the most that the number may be.
    pub range: [f64; 2],
    /// How it moves.
    pub ways: Ways,
}

impl Handle<'_> {
    /// Makes a handle of what is there, which the keyboard may be given to; what is asked of it.
    pub fn asked(&self, ui: &Ui, response: &Response) -> Option<Asked> {
        response.widget_info(|| WidgetInfo::slider(ui.is_enabled(), self.number, self.name));
        let [least, most] = self.range;
        ui.ctx().accesskit_node_builder(response.id, |node| {
            node.set_value(self.place);
            node.set_min_numeric_value(least);
            node.set_max_numeric_value(most);
            for action in [Action::SetValue, Action::Increment, Action::Decrement] {
                node.add_action(action);
            }
        });
        let has_keyboard = response.has_focus();
        let (right, up) = if has_keyboard { self.arrows(ui, response) } else { (0.0, 0.0) };
        ui.input(|input| {
            let mut number = None;
            for request in input.accesskit_action_requests(response.id, Action::SetValue) {
                if let Some(ActionData::NumericValue(asked)) = request.data {
                    // What is no number is the least.
                    number = Some(asked.max(least).min(most));
                }
            }
            let requests = |action| input.num_accesskit_action_requests(response.id, action) as f32;
            let steps = STEP * (requests(Action::Increment) - requests(Action::Decrement));
            let by = match self.ways {
                Ways::Across => (right + steps, up),
                Ways::Upwards | Ways::Both => (right, up + steps),
            };
            if has_keyboard && (input.key_pressed(Key::Delete) || input.key_pressed(Key::Backspace)) {
                Some(Asked::Remove)
            } else if let Some(number) = number {
                Some(Asked::Number(number))
            } else {
                (by != (0.0, 0.0)).then_some(Asked::Move(by))
            }
        })
    }

    /// How far arrow keys move it. Those that do not go on to the next control, as with sliders.
    fn arrows(&self, ui: &Ui, response: &Response) -> (f32, f32) {
        let [across, upwards] = [Ways::Across, Ways::Upwards].map(|way| [way, Ways::Both].contains(&self.ways));
        let filter = EventFilter { horizontal_arrows: across, vertical_arrows: upwards, ..EventFilter::default() };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
        ui.input(|input| {
            let step = if input.modifiers.shift { FINE_STEP } else { STEP };
            let moved = |takes: bool, [less, more]: [Key; 2]| {
                if takes { step * (input.num_presses(more) as f32 - input.num_presses(less) as f32) } else { 0.0 }
            };
            (moved(across, [Key::ArrowLeft, Key::ArrowRight]), moved(upwards, [Key::ArrowDown, Key::ArrowUp]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy_egui::egui::accesskit::{ActionRequest, Role, TreeId};
    use bevy_egui::egui::{Context, Event, Id, Modifiers, RawInput, Rect, Sense, Vec2, pos2};

    #[test]
    fn a_screen_reader_and_arrow_keys_move_a_handle() {
        let ctx = Context::default();
        ctx.enable_accesskit();
        let draw = |mut events: Vec<Event>, modifiers: Modifiers| {
            let mut asked = None;
            events.insert(0, Event::ModifiersChanged(modifiers));
            let mut output = ctx.run_ui(RawInput { events, ..RawInput::default() }, |ui| {
                let rect = Rect::from_center_size(pos2(50.0, 50.0), Vec2::splat(10.0));
                let response = ui.interact(rect, Id::new("end"), Sense::focusable_noninteractive());
                let (number, range) = (2.0, [0.0, 9.0]);
                asked = Handle { name: "End", place: "2 km", number, range, ways: Ways::Across }.asked(ui, &response);
            });
            // Nobody draws them.
            output.textures_delta.clear();
            (asked, output.platform_output.accesskit_update.unwrap().nodes)
        };
        let (asked, nodes) = draw(Vec::new(), Modifiers::NONE);
        assert_eq!(asked, None);
        let (target_node, node) = nodes.into_iter().find(|(_, node)| node.label() == Some("End")).unwrap();
        assert_eq!((node.role(), node.value(), node.numeric_value()), (Role::Slider, Some("2 km"), Some(2.0)));
        assert_eq!((node.min_numeric_value(), node.max_numeric_value()), (Some(0.0), Some(9.0)));
        assert!(
            [Action::Focus, Action::SetValue, Action::Increment].iter().all(|action| node.supports_action(*action))
        );
        let request = |action, data| {
            let request = ActionRequest { action, target_tree: TreeId::ROOT, target_node, data };
            draw(vec![Event::AccessKitActionRequest(request)], Modifiers::NONE).0
        };
        let press = |key, modifiers| {
            let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
            draw(vec![event], modifiers).0
        };
        assert_eq!(request(Action::Increment, None), Some(Asked::Move((STEP, 0.0))));
        assert_eq!(request(Action::Decrement, None), Some(Asked::Move((-STEP, 0.0))));
        for (asked, number) in [(7.0, 7.0), (99.0, 9.0), (f64::NAN, 0.0)] {
            let asked = request(Action::SetValue, Some(ActionData::NumericValue(asked)));
            assert_eq!(asked, Some(Asked::Number(number)));
        }
        // Keys are for what has the keyboard.
        assert_eq!([Key::ArrowLeft, Key::Delete].map(|key| press(key, Modifiers::NONE)), [None, None]);
        assert_eq!(request(Action::Focus, None), None);
        draw(Vec::new(), Modifiers::NONE);
        assert_eq!(press(Key::ArrowLeft, Modifiers::NONE), Some(Asked::Move((-STEP, 0.0))));
        assert_eq!(press(Key::ArrowRight, Modifiers::SHIFT), Some(Asked::Move((FINE_STEP, 0.0))));
        assert_eq!(press(Key::ArrowUp, Modifiers::NONE), None, "it does not move upwards");
        assert_eq!(press(Key::Delete, Modifiers::NONE), Some(Asked::Remove));
    }
}
