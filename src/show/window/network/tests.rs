//! A leader and followers in ECSs without windows, with sockets on the loopback; time passes by the frame.

use super::*;
use crate::build::{BuildOptions, build_source};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::LoadOptions;
use crate::look::{DatasetRef, LookPatch, SceneFile};
use crate::modes;
use crate::show::protocol::ShowKey;
use crate::window::adopt::adopt_opened;
use crate::window::camera::{Anchor, Navigation, Viewpoint};
use crate::window::objects::Objects;
use crate::window::open::{Opened, Openings, finish_opening};
use crate::window::pages::Upcoming;
use crate::window::picture::{DataCamera, Picture};
use crate::window::playhead::Playhead;
use crate::window::preset::Preset;
use crate::window::scene::{Scene, Settings, TransferKept};
use crate::window::scene_io::{Bookmarks, SceneFiles};
use crate::window::state::choices::Choices;
use crate::window::state::notices::Notices;
use crate::window::state::panels::Closed;
use crate::window::state::panels::Shown;
use crate::window::statistics::{Converged, FrameClock, Statistics};
use crate::window::touring::{Asked, Player, player};
use bevy::input::mouse::AccumulatedMouseScroll;
use bevy::math::DVec3;
use bevy::time::TimeUpdateStrategy;
use bevy_panorbit_camera::PanOrbitCamera;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[cfg(feature = "remote")]
mod afar;

/// Patience with threads that open files on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// The demo dataset as a page file.
fn data(folder: &Path) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
    let path = folder.join("demo.df");
    build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &path, &()).unwrap();
    path
}

/// A window without anything but what a show is about.
fn window() -> App {
    let preset = Preset::embedded("desktop").unwrap();
    let fov_y = preset.camera.field_of_view_deg.to_radians();
    let viewpoint = Viewpoint { eye: DVec3::Z * 9.0, target: DVec3::ZERO, up: DVec3::Y, fov_y };
    let picture = Picture::at(Rect::new(0.0, 0.0, 900.0, 600.0));
    let mut app = App::new();
    app.add_plugins(MinimalPlugins)
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_millis(16)))
        .insert_resource(Settings::new(&preset, None))
        .insert_resource(preset)
        .insert_resource(picture)
        .insert_resource(Openings::new(Arc::new(|path, _, _| Ok(path.to_owned()))))
        .insert_resource(Choices::of_program())
        .init_resource::<Notices>()
        .init_resource::<Objects>()
        .init_resource::<Player>()
        .init_resource::<Upcoming>()
        .init_resource::<Closed>()
        .init_resource::<Shown>()
        .init_resource::<SceneFiles>()
        .init_resource::<crate::window::state::plots::PlotChoice>()
        .init_resource::<Bookmarks>()
        .init_resource::<FrameClock>()
        .init_resource::<Statistics>()
        .init_resource::<Converged>()
        .init_resource::<PointerOwner>()
        .init_resource::<ButtonInput<KeyCode>>()
        .init_resource::<ButtonInput<MouseButton>>()
        .init_resource::<AccumulatedMouseScroll>()
        .add_message::<Opened>()
        .add_message::<TransferKept>()
        .add_systems(Update, (finish_opening, adopt_opened, player::play_tour.run_if(not(is_led))).chain());
    let mut orbit = PanOrbitCamera::default();
    let anchor = Anchor::default().adopt(&viewpoint, &mut orbit);
    app.world_mut().spawn((DataCamera, viewpoint, anchor, orbit, Navigation::Orbit));
    app
}

fn leader(data: &Path, key: &ShowKey) -> (App, SocketAddr) {
    let mut app = window();
    let leader = Leader::bind("127.0.0.1:0".parse().unwrap(), key.clone()).unwrap();
    let address = leader.address().unwrap();
    add_leader(&mut app, leader);
    app.world_mut().resource_mut::<Openings>().start(crate::window::OpenRequest::of(data));
    let start = Instant::now();
    while !app.world().contains_resource::<Scene>() {
        app.update();
        assert!(start.elapsed() < PATIENCE);
    }
    (app, address)
}

fn follower(address: SocketAddr, key: &ShowKey, name: &str, data: Vec<PathBuf>) -> App {
    let mut app = window();
    add_follower(&mut app, Following::new(Follower::new(address, key.clone(), name), data));
    app
}

fn viewpoint(app: &mut App) -> Viewpoint {
    *app.world_mut().query_filtered::<&Viewpoint, With<DataCamera>>().single(app.world()).unwrap()
}

fn shown(app: &App) -> u64 {
    app.world().resource::<Following>().shown()
}

fn notices(app: &App) -> Vec<String> {
    app.world().resource::<Notices>().all().map(|notice| notice.text.clone()).collect()
}

/// Leads all to the place of frame `i`, and lets everybody draw a frame.
fn step(leader: &mut App, followers: &mut [Option<App>], i: u64) -> Viewpoint {
    let angle = 0.003 * i as f64;
    let mut cameras = leader.world_mut().query_filtered::<&mut Viewpoint, With<DataCamera>>();
    let mut camera = cameras.single_mut(leader.world_mut()).unwrap();
    camera.eye = DVec3::new(25.0 + 60.0 * angle.cos(), 25.0 + angle / 3.0, 25.0 + 60.0 * angle.sin());
    camera.target = DVec3::splat(25.0);
    leader.update();
    followers.iter_mut().flatten().for_each(App::update);
    viewpoint(leader)
}

#[test]
fn two_windows_stay_within_a_frame_for_a_thousand_frames_and_one_is_killed_on_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let (data, key) = (data(folder.path()), ShowKey::random());
    let (mut leader, address) = leader(&data, &key);
    let new = |name: &str| Some(follower(address, &key, name, Vec::new()));
    let mut followers = [new("left"), new("right")];
    let (mut i, mut checked) = (0, 0);
    let mut before = viewpoint(&mut leader);
    let start = Instant::now();
    while checked < 1000 {
        i += 1;
        let now = step(&mut leader, &mut followers, i);
        let number = leader.world().resource::<Leading>().leader().frame();
        if followers.iter().flatten().any(|follower| shown(follower) == 0) {
            // Its data is being opened, on a thread of its own.
            std::thread::sleep(Duration::from_millis(1));
            assert!(start.elapsed() < PATIENCE, "{:?}", notices(followers[1].as_ref().unwrap()));
        } else {
            checked += 1;
        }
        for follower in followers.iter_mut().flatten().filter(|follower| shown(follower) > 0) {
            let behind = number - shown(follower);
            assert!(behind <= 1, "{behind} frames behind");
            let place = viewpoint(follower);
            assert_eq!(place, if behind == 0 { now } else { before }, "frame {number}");
        }
        before = now;
        match checked {
            300 if followers[1].is_some() => std::mem::forget(followers[1].take()),
            400 if followers[1].is_none() => followers[1] = new("right"),
            500 => {
                let mut settings = leader.world_mut().resource_mut::<Settings>();
                settings.choose_mode(modes::find("density-squared").unwrap());
                settings.error_px = 2.25;
                settings.lens.parallel = true;
            }
            _ => {}
        }
    }
    let wanted = leader.world().resource::<Settings>().clone();
    for follower in followers.iter().flatten() {
        assert!(*follower.world().resource::<Settings>() == wanted, "the leader's settings");
        assert!(follower.world().resource::<PointerOwner>().is_locked());
    }
    let all = leader.world().resource::<Leading>().leader().followers().to_vec();
    assert!(all.len() == 2 && all.iter().all(|info| info.is_in_step()), "{all:?}");
    let told = notices(&leader);
    for text in ["left follows", "right follows", "right follows again"] {
        assert!(told.iter().any(|notice| notice == text), "{told:?}");
    }
}

#[test]
fn a_tour_goes_on_without_the_leader() {
    let folder = tempfile::tempdir().unwrap();
    let (data, key) = (data(folder.path()), ShowKey::random());
    let (mut leader, address) = leader(&data, &key);
    let path = folder.path().join("show.tour.ron");
    crate::window::touring::tests::tour(false).write(&path).unwrap();
    // A copy of the data under another name, as the command line names it.
    let copy = folder.path().join("copy.df");
    std::fs::copy(&data, &copy).unwrap();
    let mut follower = follower(address, &key, "dome", vec![copy.clone()]);
    let start = Instant::now();
    while shown(&follower) == 0 {
        leader.update();
        follower.update();
        std::thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < PATIENCE, "{:?}", notices(&follower));
    }
    assert_eq!(follower.world().resource::<Scene>().path, copy);
    leader.world_mut().resource_mut::<Player>().ask(Asked::Open(path));
    for _ in 0..60 {
        leader.update();
        follower.update();
    }
    let time = |app: &App| app.world().resource::<Player>().state().map(|state| state.time);
    let (there, here) = (time(&leader).unwrap(), time(&follower).unwrap());
    assert!(there > 0.8 && (there - here).abs() < 1e-9, "{there} {here}");
    let label = |app: &App| app.world().resource::<Player>().timeline().map(|timeline| timeline.duration());
    assert_eq!(label(&leader), label(&follower));
    // The leader is gone: the tour goes on by this machine's clock, to where a presenter is waited for.
    drop(leader);
    let mut last = here;
    for _ in 0..400 {
        follower.update();
        let now = time(&follower).unwrap();
        assert!(now >= last && now <= 4.0 + 1e-9);
        last = now;
    }
    assert!((last - 4.0).abs() < 1e-9, "{last}");
    let state = follower.world().resource::<Player>().state().cloned().unwrap();
    assert_eq!(viewpoint(&mut follower).eye.to_array(), state.camera.eye);
    assert!(notices(&follower).iter().any(|notice| notice.contains("is lost")), "{:?}", notices(&follower));
}

#[test]
fn a_follower_without_the_data_says_so_and_shows_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (data, key) = (data(folder.path()), ShowKey::random());
    let (mut leader, address) = leader(&data, &key);
    // On another machine the path leads nowhere.
    leader.update();
    std::fs::remove_file(&data).unwrap();
    let mut follower = follower(address, &key, "wall", Vec::new());
    let start = Instant::now();
    while !notices(&leader).iter().any(|notice| notice.starts_with("wall: the data is not here")) {
        leader.update();
        follower.update();
        std::thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < PATIENCE, "{:?} {:?}", notices(&leader), notices(&follower));
    }
    assert_eq!(shown(&follower), 0);
    let info = leader.world().resource::<Leading>().leader().followers()[0].clone();
    assert!(!info.is_in_step() && info.warning.is_some());
}

#[test]
fn followers_show_the_moment_of_the_leader() {
    let folder = tempfile::tempdir().unwrap();
    let (data, key) = (crate::window::playhead::tests::run_file(folder.path()), ShowKey::random());
    let (mut leader, address) = leader(&data, &key);
    let mut followers = [Some(follower(address, &key, "left", Vec::new()))];
    let start = Instant::now();
    for (time, i) in [(2.5, 0), (0.25, 1000), (4.0, 2000)] {
        leader.world_mut().resource_mut::<Playhead>().seek(time);
        for i in i.. {
            step(&mut leader, &mut followers, i);
            let follower = followers[0].as_ref().unwrap();
            if follower.world().get_resource::<Playhead>().is_some_and(|playhead| playhead.time() == time) {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
            assert!(start.elapsed() < PATIENCE, "{:?}", notices(follower));
        }
    }
}

#[test]
fn what_moves_in_a_run_moves_as_the_leader_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let (run, key) = (crate::window::playhead::tests::tracked_run_file(folder.path()), ShowKey::random());
    let scene = folder.path().join("run.scene.ron");
    let look = LookPatch { interpolation: Some(Interpolation::Linear), ..LookPatch::default() };
    let file = SceneFile { look, ..SceneFile::new(vec![DatasetRef::of(&run, &scene)]) };
    file.write(&scene).unwrap();
    let (mut leader, address) = leader(&scene, &key);
    let moves = |app: &App| app.world().get_resource::<Playhead>().and_then(Playhead::moves);
    assert_eq!(moves(&leader), Some(Interpolation::Linear));
    let mut followers = [Some(follower(address, &key, "left", Vec::new()))];
    let start = Instant::now();
    for i in 0.. {
        step(&mut leader, &mut followers, i);
        let follower = followers[0].as_ref().unwrap();
        if follower.world().contains_resource::<Playhead>() {
            assert_eq!(moves(follower), Some(Interpolation::Linear));
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
        assert!(start.elapsed() < PATIENCE, "{:?}", notices(follower));
    }
}
