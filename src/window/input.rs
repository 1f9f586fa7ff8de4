//! Who gets the mouse and the keyboard, and the table of keys that both the input systems and the help page use.

use super::state::tool::Tool;
use bevy::prelude::*;

/// Whether the mouse belongs to the picture or to the panel, and whether a text field holds the keyboard. Written once
/// a frame by the panel, read by everything that moves the camera.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct PointerOwner {
    over_picture: bool,
    dragging_picture: bool,
    keyboard_is_free: bool,
    /// A tool draws over the picture: the mouse is not the camera's meanwhile.
    pub tool_draws: bool,
    /// Nobody has them.
    is_locked: bool,
}

impl Default for PointerOwner {
    fn default() -> Self {
        Self {
            over_picture: true,
            dragging_picture: false,
            keyboard_is_free: true,
            tool_draws: false,
            is_locked: false,
        }
    }
}

impl PointerOwner {
    /// Neither mouse nor keyboard belong to anybody, now and later: the window is an audience's.
    pub fn nobody() -> PointerOwner {
        PointerOwner { is_locked: true, ..PointerOwner::default() }
    }

    /// Whether the window is an audience's.
    pub fn is_locked(&self) -> bool {
        self.is_locked
    }

    /// Whether mouse input is meant for the picture. A drag that began there stays there until the button is up.
    pub fn is_picture(&self) -> bool {
        (self.over_picture || self.dragging_picture) && !self.tool_draws && !self.is_locked
    }

    /// Whether keys are meant for the camera and the shortcuts.
    pub fn keyboard_is_free(&self) -> bool {
        self.keyboard_is_free && !self.is_locked
    }

    /// The state after a frame: where the pointer is, which buttons are down, and whether a text field has the
    /// keyboard. `panel_drag`: a control of the panel is being dragged.
    pub fn update(&mut self, over_picture: bool, any_button: bool, panel_drag: bool, text_focus: bool) {
        if !any_button {
            self.dragging_picture = false;
        } else if self.over_picture && over_picture && !panel_drag {
            self.dragging_picture = true;
        }
        self.over_picture = over_picture && !panel_drag && (!any_button || self.dragging_picture);
        self.keyboard_is_free = !text_focus;
    }
}

/// Whether Ctrl belongs to the keys of this frame: held, or let go within it, as in a slow frame a whole chord may be.
pub fn is_control(keys: &ButtonInput<KeyCode>) -> bool {
    belongs(keys, [KeyCode::ControlLeft, KeyCode::ControlRight])
}

/// The same of Shift.
pub fn is_shift(keys: &ButtonInput<KeyCode>) -> bool {
    belongs(keys, [KeyCode::ShiftLeft, KeyCode::ShiftRight])
}

fn belongs(keys: &ButtonInput<KeyCode>, pair: [KeyCode; 2]) -> bool {
    keys.any_pressed(pair) || keys.any_just_released(pair)
}

/// What a key or gesture does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Shows or hides the panels.
    TogglePanel,
    /// Shows or hides those at the left.
    ToggleLeft,
    /// Shows or hides those at the right.
    ToggleRight,
    /// Shows or hides the help page.
    ToggleHelp,
    /// Fills the screen, or does not any more.
    ToggleFullscreen,
    /// Saves the window as a PNG.
    Screenshot,
    /// Switches between orbiting and flying.
    ToggleFly,
    /// Flies back to the whole dataset.
    Home,
    /// Plays the run, or stands.
    PlayRun,
    /// Goes a step of the run back; with Shift to the first one.
    StepBack,
    /// Goes a step of the run on; with Shift to the last one.
    StepOn,
    /// Plays the run half as fast.
    PlaySlower,
    /// Plays the run twice as fast.
    PlayFaster,
    /// Leaves the help page, then a brush, then a tool, then flying, then the full screen, then the program.
    Leave,
}

/// The keys of the actions that happen at the press of a key.
pub const KEYS: [(KeyCode, Action); 16] = [
    (KeyCode::Tab, Action::TogglePanel),
    (KeyCode::F2, Action::ToggleLeft),
    (KeyCode::F3, Action::ToggleRight),
    (KeyCode::F1, Action::ToggleHelp),
    (KeyCode::F11, Action::ToggleFullscreen),
    (KeyCode::F12, Action::Screenshot),
    (KeyCode::KeyP, Action::Screenshot),
    (KeyCode::KeyF, Action::ToggleFly),
    (KeyCode::Home, Action::Home),
    (KeyCode::KeyH, Action::Home),
    (KeyCode::KeyT, Action::PlayRun),
    (KeyCode::Comma, Action::StepBack),
    (KeyCode::Period, Action::StepOn),
    (KeyCode::BracketLeft, Action::PlaySlower),
    (KeyCode::BracketRight, Action::PlayFaster),
    (KeyCode::Escape, Action::Leave),
];

/// The keys of the tools.
pub const TOOL_KEYS: [(KeyCode, Tool); 6] = [
    (KeyCode::KeyI, Tool::Inspect),
    (KeyCode::KeyM, Tool::Measure),
    (KeyCode::KeyR, Tool::Sphere),
    (KeyCode::KeyB, Tool::Cube),
    (KeyCode::KeyL, Tool::Lasso),
    (KeyCode::KeyG, Tool::Profile),
];

/// The help page: sections of (what to press, what it does).
pub const HELP: [(&str, &[(&str, &str)]); 6] = [
    (
        "Orbit",
        &[
            ("Left drag", "turn around the target"),
            ("Right drag", "shift the target"),
            ("Wheel", "zoom"),
            ("Double-click", "fly to what is under the cursor"),
            ("H  or  Home", "back to the whole dataset"),
        ],
    ),
    (
        "Fly",
        &[
            ("F", "fly, or orbit again"),
            ("W A S D", "forward, left, back, right"),
            ("Q  E", "down, up"),
            ("Drag", "look around"),
            ("Shift  Ctrl", "faster, slower"),
        ],
    ),
    (
        "Look closer",
        &[
            ("I", "inspect: click a particle, or heights"),
            ("M", "measure between two clicks"),
            ("R  B  L", "draw a sphere, a box, a lasso"),
            ("G", "draw a profile over heights"),
            ("Ctrl+1  ...", "keep the view on that key"),
            ("1  ...", "fly back to it"),
        ],
    ),
    (
        "Tours and runs",
        &[
            ("T", "play the run, or stand"),
            (",  .", "a step back, on; with Shift to the ends"),
            ("[  ]", "slower, faster"),
            ("Space", "play the tour, stand, go on"),
            ("Left  Right", "to the keyframes with names"),
            ("K", "make a keyframe of the view"),
            ("Drag a mark", "move a keyframe in time"),
        ],
    ),
    (
        "Panels",
        &[
            ("Click a heading", "open or close a section"),
            ("Click a number", "type it; dragging changes it"),
            ("Click a dot", "back to the default"),
            ("Drag an end", "move one end of the range"),
            ("Drag between", "move both"),
            ("Double-click", "automatic range"),
            ("Arrows  Delete", "move, remove a handle that Tab has reached"),
            ("Drag in a plot", "select those particles; a click lets go"),
        ],
    ),
    (
        "Window",
        &[
            ("Tab", "show or hide the panels"),
            ("F2  F3", "those at the left, at the right"),
            ("F6", "to the next dock's controls; Tab goes on, Space presses"),
            ("Ctrl+O", "open a file; with Shift a folder"),
            ("Ctrl+Z  Ctrl+Y", "undo, redo settings"),
            ("Ctrl+S", "save the scene; with Shift under another name"),
            ("F11", "fill the screen"),
            ("F12  or  P", "save the window as a PNG"),
            ("F1", "this page"),
            ("Drop a file", "open it"),
            ("Esc", "leave help, a brush, a tool, flying, the full screen, the program"),
            ("Ctrl+Q", "end the program, or a show"),
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drag_from_the_picture_stays_with_the_picture() {
        let mut owner = PointerOwner::default();
        owner.update(true, false, false, false);
        owner.update(true, true, false, false);
        owner.update(false, true, false, false);
        assert!(owner.is_picture(), "over the panel now, but the drag began in the picture");
        owner.update(false, false, false, false);
        assert!(!owner.is_picture());
    }

    #[test]
    fn an_audience_moves_nothing() {
        let mut owner = PointerOwner::nobody();
        assert!(owner.is_locked() && !owner.is_picture() && !owner.keyboard_is_free());
        owner.update(true, true, false, false);
        assert!(owner.is_locked() && !owner.is_picture() && !owner.keyboard_is_free());
    }

    #[test]
    fn a_chord_within_one_frame_is_a_chord() {
        let mut keys = ButtonInput::<KeyCode>::default();
        keys.press(KeyCode::ControlLeft);
        keys.press(KeyCode::Digit3);
        keys.release(KeyCode::Digit3);
        keys.release(KeyCode::ControlLeft);
        assert!(keys.just_pressed(KeyCode::Digit3) && is_control(&keys));
        keys.clear();
        assert!(!is_control(&keys));
    }

    #[test]
    fn a_drag_from_the_panel_never_moves_the_camera() {
        let mut owner = PointerOwner::default();
        owner.update(false, false, false, false);
        owner.update(false, true, true, false);
        owner.update(true, true, true, false);
        assert!(!owner.is_picture());
        owner.update(true, false, false, false);
        assert!(owner.is_picture());
    }

    #[test]
    fn every_key_is_on_the_help_page() {
        let page: String = HELP.iter().flat_map(|(_, rows)| rows.iter()).map(|(keys, _)| format!(" {keys} ")).collect();
        for key in KEYS.map(|(key, _)| key).into_iter().chain(TOOL_KEYS.map(|(key, _)| key)) {
            let name = match key {
                KeyCode::Comma => ",".to_owned(),
                KeyCode::Period => ".".to_owned(),
                KeyCode::BracketLeft => "[".to_owned(),
                KeyCode::BracketRight => "]".to_owned(),
                key => format!("{key:?}").replace("Key", "").replace("Escape", "Esc"),
            };
            assert!(page.contains(&format!(" {name} ")), "{name} is missing in {page}");
        }
    }
}
