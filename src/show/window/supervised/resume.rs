//! What is shown, kept in a file every second, so that a window that has failed goes on there when it is opened again: the scene, the
//! tour with its time and edits that are not saved, and where the window was.

use super::Supervised;
use crate::model::{new_file, ron_file};
use crate::show::supervisor::RunFolder;
use crate::tour::TourFile;
use crate::window::camera::Viewpoint;
use crate::window::picture::{DataCamera, Picture};
use crate::window::playhead::Playhead;
use crate::window::scene::{Scene, Settings};
use crate::window::scene_io::{SceneParts, ShownData, say_moment, scene_file};
use crate::window::shortcuts::FULLSCREEN;
use crate::window::state::notices::Notices;
use crate::window::touring::clock::ClockState;
use crate::window::touring::{Asked, Player};
use bevy::prelude::*;
use bevy::tasks::{IoTaskPool, Task, futures::check_ready};
use bevy::window::{PrimaryWindow, WindowMode, WindowPosition};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Time between two files.
const INTERVAL: Duration = Duration::from_secs(1);
/// A tour that played goes on as if it had never stood, after so many seconds at most: longer ones are another day's.
const LONGEST_GAP: f64 = 600.0;

/// What is kept beside the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// When it was so, seconds since 1970.
    at: f64,
    /// Where the scene is saved by its user.
    saves_to: Option<PathBuf>,
    tour: Option<TourState>,
    window: Option<WindowPlace>,
}

/// The open tour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TourState {
    text: String,
    path: Option<PathBuf>,
    edited: bool,
    /// Where it is; `None` while it shows nothing.
    moment: Option<ClockState>,
}

/// Where a window is, physical pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WindowPlace {
    position: Option<(i32, i32)>,
    size: (u32, u32),
    fullscreen: bool,
}

impl State {
    /// What the window before this one left, and the scene that it showed.
    pub fn read(folder: &RunFolder) -> Option<(State, PathBuf)> {
        let state = ron_file::read(&folder.state()).ok()?;
        Some((state, folder.scene()))
    }
}

/// What was kept last.
#[derive(Resource, Default)]
pub(crate) struct Keeping {
    kept: Option<State>,
    scene: String,
    data: ShownData,
    next: Duration,
    writing: Option<Task<Result<(), String>>>,
}

/// What a window is to go on from, until its data is there.
#[derive(Resource)]
pub(crate) struct GoingOn(pub State);

fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Keeps what is shown, where it has changed.
pub(crate) fn keep_state(
    mut keeping: ResMut<Keeping>,
    supervised: Res<Supervised>,
    going_on: Option<Res<GoingOn>>,
    (time, scene, playhead): (Res<Time<Real>>, Option<Res<Scene>>, Option<Res<Playhead>>),
    (settings, picture, player): (Res<Settings>, Res<Picture>, Res<Player>),
    parts: SceneParts,
    mut notices: ResMut<Notices>,
    windows: Query<&Window, With<PrimaryWindow>>,
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let keeping = keeping.bypass_change_detection();
    if let Some(outcome) = keeping.writing.as_mut().and_then(check_ready) {
        keeping.writing = None;
        if let Err(why) = outcome {
            notices.error(format!("what is shown is not kept for the case that this window fails: {why}"));
        }
    }
    // A source of live particles, or nothing at all, is not gone on with; nor is what has yet to come.
    let (Some(scene), None) = (scene, going_on) else { return };
    if time.elapsed() < keeping.next || keeping.writing.is_some() {
        return;
    }
    keeping.next = time.elapsed() + INTERVAL;
    let moment = player.state().map(|_| {
        let clock = player.clock();
        ClockState { time: clock.time(time.elapsed_secs_f64()), running: clock.is_running(), waiting: clock.waiting() }
    });
    let tour = player.tour().map(|tour| TourState {
        text: tour.to_ron(),
        path: player.path().map(|path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned())),
        edited: player.is_edited(),
        moment,
    });
    let path = supervised.folder.scene();
    let mut file = scene_file(keeping.data.of(&scene, &settings), &settings, &camera, &picture, &parts, &path);
    say_moment(&mut file.look, &scene, playhead.as_deref());
    let state = State {
        at: now(),
        saves_to: parts.saves_to().map(|path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned())),
        tour,
        window: windows.single().ok().map(window_place),
    };
    let Ok(text) = file.text(&path) else { return };
    let same = keeping.kept.as_ref().is_some_and(|kept| State { at: state.at, ..kept.clone() } == state);
    if same && keeping.scene == text {
        return;
    }
    let target = supervised.folder.state();
    let (scene_text, state_text) = (text.clone(), ron::to_string(&state));
    (keeping.kept, keeping.scene) = (Some(state), text);
    // The disk may be slow; the picture is not to wait for it.
    keeping.writing = Some(IoTaskPool::get().spawn(async move {
        let state_text = state_text.map_err(|error| error.to_string())?;
        new_file::write(&path, &scene_text).map_err(|error| error.to_string())?;
        new_file::write(&target, &state_text).map_err(|error| error.to_string())
    }));
}

fn window_place(window: &Window) -> WindowPlace {
    WindowPlace {
        position: match window.position {
            WindowPosition::At(at) => Some((at.x, at.y)),
            _ => None,
        },
        size: (window.physical_width(), window.physical_height()),
        fullscreen: window.mode != WindowMode::Windowed,
    }
}

/// Goes on, as soon as the data is there.
pub(crate) fn restore_state(
    mut commands: Commands,
    going_on: Option<Res<GoingOn>>,
    scene: Option<Res<Scene>>,
    mut player: ResMut<Player>,
    mut parts: SceneParts,
    mut windows: Query<&mut Window, With<PrimaryWindow>>,
) {
    let (Some(GoingOn(state)), Some(_)) = (going_on.as_deref(), scene) else { return };
    commands.remove_resource::<GoingOn>();
    parts.save_to(state.saves_to.clone());
    if let (Some(place), Ok(mut window)) = (state.window, windows.single_mut()) {
        window.mode = if place.fullscreen { FULLSCREEN } else { WindowMode::Windowed };
        if !place.fullscreen {
            window.resolution.set_physical_resolution(place.size.0, place.size.1);
        }
        if let Some((x, y)) = place.position {
            window.position = WindowPosition::At(IVec2::new(x, y));
        }
    }
    let Some(tour) = &state.tour else { return };
    let name = tour.path.as_ref().map_or_else(|| "the tour".to_owned(), |path| path.display().to_string());
    let Ok(file) = TourFile::parse(&name, &tour.text) else { return };
    player.restore(file, tour.path.clone(), tour.edited);
    if let Some(moment) = tour.moment {
        let gap = if moment.running { (now() - state.at).clamp(0.0, LONGEST_GAP) } else { 0.0 };
        player.ask(Asked::GoOn(ClockState { time: moment.time + gap, ..moment }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::{Attribute, Member, SceneFile};
    use crate::modes;
    use crate::tour::Keyframe;
    use crate::window::adopt::adopt_opened;
    use crate::window::objects::Objects;
    use crate::window::open::{Opened, OpenedScene};
    use crate::window::scene_io::{Bookmarks, SceneFiles};
    use crate::window::state::panels::{Closed, Shown};
    use crate::window::touring::look::tests::unusual_settings;
    use crate::window::touring::player::tests::Window;
    use bevy::tasks::TaskPool;
    use std::sync::Arc;
    use std::sync::mpsc::channel;

    #[test]
    fn what_was_left_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let folder = RunFolder::at(folder.path());
        assert!(State::read(&folder).is_none());
        let moment = ClockState { time: 3.25, running: true, waiting: None };
        let state = State {
            at: 1.5e9,
            saves_to: Some("/data/box.scene.ron".into()),
            tour: Some(TourState { text: "(version: 1)".into(), path: None, edited: true, moment: Some(moment) }),
            window: Some(WindowPlace { position: Some((-3, 40)), size: (800, 600), fullscreen: false }),
        };
        std::fs::write(folder.state(), ron::to_string(&state).unwrap()).unwrap();
        assert_eq!(State::read(&folder), Some((state, folder.scene())));
        std::fs::write(folder.state(), "(at: 1.5e9, saves_to").unwrap();
        assert!(State::read(&folder).is_none(), "half of one is none");
    }

    /// A window without anything but what plays, with what a scene sets.
    fn window() -> Window {
        let mut window = Window::new();
        window
            .app
            .init_resource::<SceneFiles>()
            .init_resource::<crate::window::state::plots::PlotChoice>()
            .init_resource::<Bookmarks>()
            .init_resource::<Closed>()
            .init_resource::<Shown>()
            .init_resource::<Objects>();
        window
    }

    #[test]
    fn every_mode_and_a_tour_through_it_go_on_with_all_their_settings() {
        IoTaskPool::get_or_init(TaskPool::new);
        let folder = tempfile::tempdir().unwrap();
        let folder = RunFolder::at(folder.path());
        let mut failed = window();
        failed
            .app
            .init_resource::<Keeping>()
            .insert_resource(Supervised::new(folder.clone(), channel().1))
            .add_systems(Last, keep_state);
        let mut scene = failed.app.world_mut().resource_mut::<Scene>();
        let (path, file, frame) = (scene.path.clone(), Arc::clone(&scene.file), scene.frame);
        scene.members = vec![Member::new(&path)];
        let attribute = file.metadata().families[0].quantities[0].name.clone();
        let mut next = window();
        next.app.add_message::<Opened>().add_systems(First, (adopt_opened, restore_state).chain());
        for mode in modes::all().into_iter().filter(|mode| mode.takes_particles()) {
            let mut wanted = unusual_settings(mode);
            (wanted.attribute, wanted.families) = (Attribute::Named(attribute.clone()), vec![true]);
            let tour = TourFile::new(vec![Keyframe { look: wanted.look.patch(), ..Keyframe::default() }]);
            failed.app.insert_resource(wanted.clone());
            failed.app.world_mut().resource_mut::<Player>().restore(tour.clone(), None, true);
            failed.frame(INTERVAL.as_secs_f64());
            while failed.app.world().resource::<Keeping>().writing.is_some() {
                std::thread::sleep(Duration::from_millis(1));
                failed.frame(0.0);
            }
            let (state, scene) = State::read(&folder).unwrap();
            let scene = OpenedScene { scene: SceneFile::read(&scene).unwrap(), path: scene, notes: Vec::new() };
            next.app.insert_resource(GoingOn(state)).world_mut().write_message(Opened {
                path: path.clone(),
                members: vec![Member::new(&path)],
                notes: Vec::new(),
                run: None,
                tracks: None,
                field: None,
                file: Arc::clone(&file),
                frame,
                scene: Some(Arc::new(scene)),
                map: None,
                keeps: false,
                has_more: false,
            });
            next.frame(0.0);
            assert!(*next.app.world().resource::<Settings>() == wanted, "{}", mode.name);
            assert_eq!(next.player().tour(), Some(&tour), "{}", mode.name);
            assert!(next.player().is_edited());
        }
    }
}
