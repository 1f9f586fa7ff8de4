//! Carries out the keys of [`KEYS`].

use super::camera::{Anchor, DataDistance, Flight, Fly, Navigation, Viewpoint};
use super::input::{Action, KEYS, PointerOwner, is_control};
use super::looking::tool::Tool;
use super::messages::Messages;
use super::panel::Dock;
use super::picture::{DataCamera, Picture};
use super::preset::Preset;
use super::scene::{Scene, home};
use super::screenshot;
use crate::show::window::network::Leading;
use bevy::prelude::*;
use bevy::window::{PrimaryWindow, WindowMode};
use bevy_panorbit_camera::PanOrbitCamera;

/// A window that fills the monitor that it is on.
pub const FULLSCREEN: WindowMode = WindowMode::BorderlessFullscreen(MonitorSelection::Current);

/// What is shown beside the picture.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// The docks, if they are not hidden one by one.
    pub panel: bool,
    /// The dock at the left.
    pub left: bool,
    /// The dock at the right.
    pub right: bool,
    /// The help page.
    pub help: bool,
}

impl Shown {
    /// Whether a dock is to be seen.
    pub fn dock(&self, dock: Dock) -> bool {
        self.panel
            && match dock {
                Dock::Left => self.left,
                Dock::Right => self.right,
            }
    }

    /// Shows or hides a dock; where all are hidden, only this one is shown.
    fn toggle(&mut self, dock: Dock) {
        let side = match dock {
            Dock::Left => &mut self.left,
            Dock::Right => &mut self.right,
        };
        if self.panel {
            *side = !*side;
        } else {
            *self = Shown { panel: true, left: dock == Dock::Left, right: dock == Dock::Right, ..*self };
        }
    }
}

/// Carries out the keys that were pressed in this frame.
pub(super) fn run_shortcuts(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    owner: Res<PointerOwner>,
    preset: Res<Preset>,
    scene: Option<Res<Scene>>,
    picture: Res<Picture>,
    distance: Res<DataDistance>,
    mut shown: ResMut<Shown>,
    mut tool: ResMut<Tool>,
    mut messages: ResMut<Messages>,
    (mut exit, leading): (MessageWriter<AppExit>, Option<Res<Leading>>),
    mut windows: Query<&mut Window, With<PrimaryWindow>>,
    camera: Single<
        (Entity, &mut Navigation, &mut Fly, &mut Viewpoint, &mut Anchor, &mut PanOrbitCamera),
        With<DataCamera>,
    >,
) {
    let mut window = windows.single_mut().ok();
    let (entity, mut navigation, mut fly, mut viewpoint, mut anchor, mut orbit) = camera.into_inner();
    // With Ctrl, keys do other things: see `history` and `scene_io`.
    let control = is_control(&keys);
    if control && keys.just_pressed(KeyCode::KeyQ) {
        exit.write(AppExit::Success);
    }
    let pressed = KEYS.iter().filter(|(key, _)| !control && keys.just_pressed(*key)).map(|(_, action)| *action);
    for action in pressed {
        if !owner.keyboard_is_free() && action != Action::Leave {
            continue;
        }
        match action {
            Action::TogglePanel => shown.panel = !shown.panel,
            Action::ToggleLeft => shown.toggle(Dock::Left),
            Action::ToggleRight => shown.toggle(Dock::Right),
            Action::ToggleHelp => shown.help = !shown.help,
            Action::ToggleFullscreen => {
                if let Some(window) = &mut window {
                    window.mode = if window.mode == WindowMode::Windowed { FULLSCREEN } else { WindowMode::Windowed };
                }
            }
            Action::Screenshot => screenshot::take(&mut commands),
            Action::ToggleFly => {
                commands.entity(entity).remove::<Flight>();
                *fly = Fly::default();
                if *navigation == Navigation::Fly {
                    *navigation = Navigation::Orbit;
                    *anchor = Anchor::adopt(&viewpoint, &mut orbit);
                } else {
                    *navigation = Navigation::Fly;
                    if let Some(reach) = distance.0.filter(|reach| *reach > 0.0) {
                        let forward = (viewpoint.target - viewpoint.eye).normalize_or_zero();
                        viewpoint.target = viewpoint.eye + forward * reach;
                    }
                }
            }
            Action::Home => {
                let Some(scene) = &scene else { continue };
                match home(scene.frame, viewpoint.fov_y, &picture) {
                    Ok(target) => {
                        *navigation = Navigation::Orbit;
                        let flight = Flight::to_viewpoint(*viewpoint, target, preset.camera.flight_secs);
                        commands.entity(entity).insert(flight);
                    }
                    Err(error) => messages.error(error.to_string()),
                }
            }
            Action::Leave if shown.help => shown.help = false,
            Action::Leave if *tool != Tool::Inspect => *tool = Tool::Inspect,
            Action::Leave if *navigation != Navigation::Orbit => {
                *navigation = Navigation::Orbit;
                *anchor = Anchor::adopt(&viewpoint, &mut orbit);
            }
            Action::Leave if window.as_ref().is_some_and(|window| window.mode != WindowMode::Windowed) => {
                if let Some(window) = &mut window {
                    window.mode = WindowMode::Windowed;
                }
            }
            // An audience is watching.
            Action::Leave if leading.is_some() => messages.info("Ctrl+Q ends the show"),
            Action::Leave => {
                exit.write(AppExit::Success);
            }
        }
    }
}
