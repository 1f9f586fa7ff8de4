//! F6 takes the keyboard from pane to pane: the dock at the left, the one at the right, what lies between them, the picture.

use bevy_egui::egui::{Context, FocusDirection, Key, Rangef};

/// A step from one pane to the next, if one is taken in this frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Step {
    /// Where across the window the control is that the keyboard leaves.
    from: Option<f32>,
}

impl Step {
    /// Takes the keyboard from the control that has it, before anything is drawn; from the picture it goes to the first control.
    pub(super) fn begin(ctx: &Context) -> Step {
        if !ctx.input(|input| input.key_pressed(Key::F6)) {
            return Step::default();
        }
        let Some(focused) = ctx.memory(|memory| memory.focused()) else {
            ctx.memory_mut(|memory| memory.move_focus(FocusDirection::Next));
            return Step::default();
        };
        ctx.memory_mut(|memory| memory.surrender_focus(focused));
        Step { from: ctx.read_response(focused).map(|control| control.rect.center().x) }
    }

    /// A dock that is so wide has been drawn: from its controls the keyboard goes to the first one of what is drawn next, and where
    /// there is none the picture has it.
    pub(super) fn leave(self, ctx: &Context, dock: Rangef) {
        if self.from.is_some_and(|from| dock.contains(from)) {
            ctx.memory_mut(|memory| memory.move_focus(FocusDirection::Next));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy_egui::egui::{Event, Modifiers, RawInput, Rect, UiBuilder, pos2, vec2};

    /// The control that has the keyboard after each key, in a window with so many panes of two controls each.
    fn reached(panes: &[(&str, f32)], keys: &[Key]) -> Vec<Option<String>> {
        let ctx = Context::default();
        let frame = |key: Key| {
            let modifiers = Modifiers::NONE;
            let event = Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers };
            let mut reached = None;
            let input = RawInput { events: vec![event], ..RawInput::default() };
            let mut output = ctx.run_ui(input, |ui| {
                let step = Step::begin(ui.ctx());
                for &(name, left) in panes {
                    let room = Rect::from_min_size(pos2(left, 0.0), vec2(200.0, 400.0));
                    ui.scope_builder(UiBuilder::new().id_salt(name).max_rect(room), |ui| {
                        for text in [format!("{name} 1"), format!("{name} 2")] {
                            if ui.button(text.as_str()).has_focus() {
                                reached = Some(text);
                            }
                        }
                    });
                    if name != "between" {
                        step.leave(ui.ctx(), room.x_range());
                    }
                }
            });
            // Nobody draws them.
            output.textures_delta.clear();
            reached
        };
        keys.iter().map(|key| frame(*key)).collect()
    }

    #[test]
    fn f6_goes_from_pane_to_pane_and_back_to_the_picture() {
        let panes = [("left", 0.0), ("right", 400.0), ("between", 200.0)];
        let keys = [Key::F6, Key::Tab, Key::F6, Key::F6, Key::F6, Key::F6];
        let expected = [Some("left 1"), Some("left 2"), Some("right 1"), Some("between 1"), None, Some("left 1")];
        assert_eq!(reached(&panes, &keys), expected.map(|name| name.map(str::to_owned)));
        // Where nothing is between the docks, or only one is shown, the picture follows.
        let expected = [Some("left 1"), Some("right 1"), None].map(|name| name.map(str::to_owned));
        assert_eq!(reached(&panes[..2], &[Key::F6; 3]), expected);
        assert_eq!(reached(&panes[1..2], &[Key::F6; 2]), [Some("right 1".to_owned()), None]);
    }
}
