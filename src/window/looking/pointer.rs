//! What the mouse does over the picture, told once a frame by the window's layout.

use bevy::prelude::*;

/// The left button and the pointer over the picture, in window coordinates (logical pixels).
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct PicturePointer {
    /// Where the pointer is, if it is in the window.
    pub at: Option<Vec2>,
    /// Whether it is over the picture, and over nothing that lies above it.
    pub over: bool,
    /// The button went down over the picture.
    pub pressed: bool,
    /// The button is held since it went down over the picture.
    pub held: bool,
    /// The button went up after having been held.
    pub released: bool,
    /// It went up without having moved: a click.
    pub clicked: bool,
}

impl PicturePointer {
    /// The state after a frame: where the pointer is, and what its button and egui's idea of a click say.
    pub fn update(&mut self, at: Option<Vec2>, over: bool, [down, was_pressed, clicked]: [bool; 3]) {
        let was_held = self.held;
        self.at = at;
        self.over = over;
        self.pressed = over && was_pressed;
        self.held = down && (was_held || self.pressed);
        self.released = was_held && !down;
        // A press and its release may come within one frame.
        self.clicked = clicked && over && (was_held || self.pressed || !down);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_press_elsewhere_is_never_held_here() {
        let mut pointer = PicturePointer::default();
        pointer.update(Some(Vec2::ONE), false, [true, true, false]);
        pointer.update(Some(Vec2::ONE), true, [true, false, false]);
        assert!(!pointer.held && !pointer.pressed);
        pointer.update(Some(Vec2::ONE), true, [false, false, false]);
        assert!(!pointer.released && !pointer.clicked);
    }

    #[test]
    fn a_stroke_goes_on_beyond_the_picture_and_ends_once() {
        let mut pointer = PicturePointer::default();
        pointer.update(Some(Vec2::ONE), true, [true, true, false]);
        assert!(pointer.pressed && pointer.held);
        pointer.update(Some(Vec2::ZERO), false, [true, false, false]);
        assert!(pointer.held && !pointer.pressed);
        pointer.update(Some(Vec2::ZERO), false, [false, false, false]);
        assert!(pointer.released && !pointer.held && !pointer.clicked);
        pointer.update(Some(Vec2::ZERO), false, [false, false, false]);
        assert!(!pointer.released);
    }
}
