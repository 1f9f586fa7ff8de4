//! How far the mouse has moved, for the cameras: by the cursor, not by the device.
//!
//! Devices that tell places rather than ways (of virtual machines, remote desktops, tablets) report a raw "motion" that is none, and what
//! the mouse did in a frame before its button went down belongs to no drag, however slow the frame.

use bevy::input::InputSystems;
use bevy::input::mouse::{AccumulatedMouseMotion, MouseMotion};
use bevy::prelude::*;

/// Replaces the device's motion by the cursor's before anything reads it.
pub(super) struct PointerMotionPlugin;

impl Plugin for PointerMotionPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(PreUpdate, follow_cursor.after(InputSystems));
    }
}

fn follow_cursor(
    mut last: Local<Option<Vec2>>,
    mut moves: MessageReader<CursorMoved>,
    mut left: MessageReader<CursorLeft>,
    buttons: Res<ButtonInput<MouseButton>>,
    mut device: ResMut<Messages<MouseMotion>>,
    mut accumulated: ResMut<AccumulatedMouseMotion>,
) {
    let mut delta = Vec2::ZERO;
    for moved in moves.read() {
        delta += last.map_or(Vec2::ZERO, |last| moved.position - last);
        *last = Some(moved.position);
    }
    // Where it comes back is no motion, but a drag goes on outside.
    if left.read().count() > 0 && buttons.get_pressed().len() == 0 {
        *last = None;
    }
    if buttons.get_just_pressed().len() > 0 {
        delta = Vec2::ZERO;
    }
    device.clear();
    accumulated.delta = delta;
    if delta != Vec2::ZERO {
        device.write(MouseMotion { delta });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An app whose mouse does what is sent to it.
    fn app() -> App {
        let mut app = App::new();
        app.add_message::<CursorMoved>()
            .add_message::<CursorLeft>()
            .add_message::<MouseMotion>()
            .init_resource::<ButtonInput<MouseButton>>()
            .init_resource::<AccumulatedMouseMotion>()
            .add_plugins(PointerMotionPlugin);
        app
    }

    fn after(app: &mut App, places: &[[f32; 2]]) -> Vec2 {
        for &[x, y] in places {
            let position = Vec2::new(x, y);
            app.world_mut().write_message(CursorMoved { window: Entity::PLACEHOLDER, position, delta: None });
            // What a device of places says.
            app.world_mut().write_message(MouseMotion { delta: position });
        }
        app.update();
        let motion: Vec<Vec2> =
            app.world_mut().resource_mut::<Messages<MouseMotion>>().drain().map(|motion| motion.delta).collect();
        let delta = app.world().resource::<AccumulatedMouseMotion>().delta;
        assert_eq!(motion.iter().sum::<Vec2>(), delta);
        delta
    }

    #[test]
    fn the_cursor_says_how_far_the_mouse_moved() {
        let mut app = app();
        assert_eq!(after(&mut app, &[[600.0, 300.0]]), Vec2::ZERO, "where it began is no motion");
        assert_eq!(after(&mut app, &[[610.0, 300.0], [615.0, 310.0]]), Vec2::new(15.0, 10.0));
        assert_eq!(after(&mut app, &[]), Vec2::ZERO);
        // Out of the window and in at another side.
        app.world_mut().write_message(CursorLeft { window: Entity::PLACEHOLDER });
        app.update();
        assert_eq!(after(&mut app, &[[10.0, 10.0]]), Vec2::ZERO);
    }

    #[test]
    fn what_came_before_the_button_is_no_drag() {
        let mut app = app();
        after(&mut app, &[[100.0, 100.0]]);
        app.world_mut().resource_mut::<ButtonInput<MouseButton>>().press(MouseButton::Left);
        assert_eq!(after(&mut app, &[[900.0, 500.0]]), Vec2::ZERO, "moved, pressed, in one slow frame");
        app.world_mut().resource_mut::<ButtonInput<MouseButton>>().clear();
        assert_eq!(after(&mut app, &[[905.0, 500.0]]), Vec2::new(5.0, 0.0));
        // A drag goes on beyond the edge of the window.
        app.world_mut().write_message(CursorLeft { window: Entity::PLACEHOLDER });
        assert_eq!(after(&mut app, &[[1300.0, 500.0]]), Vec2::new(395.0, 0.0));
    }
}
