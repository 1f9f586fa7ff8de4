//! Carries out the keys of [`KEYS`].

use super::camera::{Anchor, DataDistance, Flight, Fly, Navigation, Viewpoint};
use super::input::{Action, KEYS, PointerOwner, is_control};
use super::looking::plotting::{brush_of, clear_brush};
use super::picture::{DataCamera, Picture};
use super::playhead::Playhead;
use super::preset::Preset;
use super::scene::{Scene, Settings};
use super::screenshot;
use super::state::notices::Notices;
use super::state::panels::{Dock, Shown};
use super::state::show::{Role, ShowStatus};
use super::state::tool::Tool;
use bevy::prelude::*;
use bevy::window::{PrimaryWindow, WindowMode};
use bevy_panorbit_camera::PanOrbitCamera;

/// A window that fills the monitor that it is on.
pub const FULLSCREEN: WindowMode = WindowMode::BorderlessFullscreen(MonitorSelection::Current);

/// Carries out the keys that were pressed in this frame.
pub(super) fn run_shortcuts(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    owner: Res<PointerOwner>,
    preset: Res<Preset>,
    (scene, mut settings): (Option<Res<Scene>>, ResMut<Settings>),
    picture: Res<Picture>,
    distance: Res<DataDistance>,
    mut shown: ResMut<Shown>,
    mut tool: ResMut<Tool>,
    mut notices: ResMut<Notices>,
    (mut exit, show, mut playhead): (MessageWriter<AppExit>, Option<Res<ShowStatus>>, Option<ResMut<Playhead>>),
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
        // Esc gives up what has the keyboard first: a control, a list, a path that is typed.
        if !owner.keyboard_is_free() && (action != Action::Leave || !owner.is_locked()) {
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
            Action::PlayRun | Action::StepBack | Action::StepOn | Action::PlaySlower | Action::PlayFaster => {
                let Some(playhead) = &mut playhead else { continue };
                let to_end = keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]);
                match action {
                    Action::StepBack | Action::StepOn if to_end => playhead.go_to_end(action == Action::StepOn),
                    Action::StepBack => playhead.step(-1),
                    Action::StepOn => playhead.step(1),
                    Action::PlaySlower | Action::PlayFaster => playhead.change_speed(action == Action::PlayFaster),
                    _ => playhead.toggle(),
                }
            }
            Action::ToggleFly => {
                commands.entity(entity).remove::<Flight>();
                *fly = Fly::default();
                if *navigation == Navigation::Fly {
                    *navigation = Navigation::Orbit;
                    *anchor = anchor.adopt(&viewpoint, &mut orbit);
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
                match scene.home(&settings, viewpoint.fov_y, &picture) {
                    Ok(target) => {
                        *navigation = Navigation::Orbit;
                        let flight = Flight::to_viewpoint(*viewpoint, target, preset.camera.flight_secs);
                        commands.entity(entity).insert(flight);
                    }
                    Err(error) => notices.error(error),
                }
            }
            Action::Leave if shown.help => shown.help = false,
            Action::Leave if brush_of(&settings.selections).is_some() => clear_brush(&mut settings.selections),
            Action::Leave if *tool != Tool::Inspect => *tool = Tool::Inspect,
            Action::Leave if *navigation != Navigation::Orbit => {
                *navigation = Navigation::Orbit;
                *anchor = anchor.adopt(&viewpoint, &mut orbit);
            }
            Action::Leave if window.as_ref().is_some_and(|window| window.mode != WindowMode::Windowed) => {
                if let Some(window) = &mut window {
                    window.mode = WindowMode::Windowed;
                }
            }
            // An audience is watching.
            Action::Leave if show.as_ref().is_some_and(|show| show.role == Role::Leader) => {
                notices.info("Ctrl+Q ends the show")
            }
            Action::Leave => {
                exit.write(AppExit::Success);
            }
        }
    }
}
