//! The player in an ECS without a window.

use super::*;
use crate::build::{BuildOptions, build_source};
use crate::import::LoadOptions;
use crate::store::PageFile;
use crate::window::preset::Preset;
use crate::window::touring::tests::tour;
use bevy::math::DVec3;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The page file of the demo snapshot, which all windows of a test have.
fn pages() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5");
        let path = folder.path().join("demo.df");
        build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &path, &()).unwrap();
        std::fs::read(path).unwrap()
    })
}

/// A window without anything but what plays.
pub(crate) struct Window {
    pub app: App,
    now: Instant,
    _folder: tempfile::TempDir,
}

impl Window {
    pub fn new() -> Window {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("demo.df");
        std::fs::write(&path, pages()).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        let preset = Preset::embedded("desktop").unwrap();
        let mut settings = Settings::new(&preset, None);
        settings.families = vec![true];
        let picture = Picture::at(Rect::new(0.0, 0.0, 900.0, 600.0));
        let scene = Scene::of_file(file, Vec::new());
        let now = Instant::now();
        let mut app = App::new();
        app.insert_resource(Time::<Real>::new(now))
            .insert_resource(preset)
            .insert_resource(settings)
            .insert_resource(picture)
            .insert_resource(scene)
            .insert_resource(Choices::of_program())
            .init_resource::<ButtonInput<KeyCode>>()
            .init_resource::<ButtonInput<MouseButton>>()
            .init_resource::<AccumulatedMouseScroll>()
            .init_resource::<PointerOwner>()
            .init_resource::<Upcoming>()
            .init_resource::<Notices>()
            .init_resource::<Player>()
            .add_message::<TransferKept>()
            .add_systems(Update, (take_keys, play_tour).chain());
        let viewpoint =
            Viewpoint { eye: DVec3::new(25.0, 25.0, 150.0), target: DVec3::splat(25.0), up: DVec3::Y, fov_y: 0.7 };
        let mut orbit = PanOrbitCamera::default();
        let anchor = Anchor::default().adopt(&viewpoint, &mut orbit);
        app.world_mut().spawn((DataCamera, viewpoint, anchor, orbit, Navigation::Orbit));
        Window { app, now, _folder: folder }
    }

    /// A frame that begins `seconds` after the last one.
    pub fn frame(&mut self, seconds: f64) {
        self.now += Duration::from_secs_f64(seconds);
        let now = self.now;
        self.app.world_mut().resource_mut::<Time<Real>>().update_with_instant(now);
        self.app.update();
    }

    /// Frames until something is so.
    pub fn wait(&mut self, what: &str, mut until: impl FnMut(&App) -> bool) {
        let start = Instant::now();
        while !until(&self.app) {
            self.frame(0.0);
            std::thread::sleep(Duration::from_millis(1));
            assert!(start.elapsed() < Duration::from_secs(240), "waited in vain for {what}");
        }
    }

    pub fn ask(&mut self, what: Asked) {
        self.app.world_mut().resource_mut::<Player>().ask(what);
        self.frame(0.0);
    }

    pub fn player(&self) -> &Player {
        self.app.world().resource()
    }

    fn viewpoint(&mut self) -> Viewpoint {
        *self.app.world_mut().query::<&Viewpoint>().single(self.app.world()).unwrap()
    }

    fn navigation(&mut self) -> Navigation {
        *self.app.world_mut().query::<&Navigation>().single(self.app.world()).unwrap()
    }

    pub fn open(&mut self, tour: &TourFile) -> PathBuf {
        let path = self._folder.path().join("a.tour.ron");
        tour.write(&path).unwrap();
        self.app.world_mut().resource_mut::<Player>().ask(Asked::Open(path.clone()));
        self.frame(0.0);
        path
    }
}

#[test]
fn at_any_frame_rate_the_camera_is_where_the_recording_has_it() {
    let mut unheld = tour(false);
    unheld.keyframes.iter_mut().for_each(|keyframe| keyframe.hold = false);
    let reference = {
        let mut window = Window::new();
        window.open(&unheld);
        window.player().timeline().unwrap().clone()
    };
    for step in [1.0 / 240.0, 1.0 / 60.0, 1.0 / 7.3, 0.9] {
        let mut window = Window::new();
        window.open(&unheld);
        window.frame(0.0);
        let (mut elapsed, mut frames) = (0.0, 0);
        while window.player().clock().is_running() {
            // Frames are never alike.
            let this = step * (1.0 + 0.5 * f64::from(frames % 3));
            window.frame(this);
            elapsed += Duration::from_secs_f64(this).as_secs_f64();
            let (own, expected) = (window.viewpoint(), reference.state(elapsed).camera);
            for (own, expected) in [(own.eye, expected.eye), (own.target, expected.target)] {
                assert!(own.distance(DVec3::from(expected)) < 1e-9 * 100.0, "{elapsed}: {own} {expected:?}");
            }
            frames += 1;
        }
        assert!(elapsed > reference.duration() - 1e-6 && frames > 4, "{frames}");
        assert_eq!(window.navigation(), Navigation::Tour, "it stands at its end");
    }
}

#[test]
fn a_tour_that_is_opened_before_its_data_plays_when_that_is_there() {
    let mut window = Window::new();
    let scene = window.app.world_mut().remove_resource::<Scene>().unwrap();
    window.open(&tour(false));
    (0..5).for_each(|_| window.frame(0.1));
    assert!(window.player().state().is_none());
    window.app.insert_resource(scene);
    window.frame(0.1);
    window.frame(0.25);
    assert!((window.player().state().unwrap().time - 0.25).abs() < 1e-9);
}

#[test]
fn a_presenter_is_waited_for_and_leads() {
    let mut window = Window::new();
    window.open(&tour(false));
    window.frame(0.0);
    for _ in 0..100 {
        window.frame(0.1);
    }
    assert_eq!(window.player().clock().waiting(), Some(1));
    let halo = window.player().timeline().unwrap().stops()[1].arrive;
    assert_eq!(window.player().state().unwrap().time, halo);
    assert_eq!(window.app.world().resource::<Upcoming>().0, None);
    window.app.world_mut().resource_mut::<ButtonInput<KeyCode>>().press(KeyCode::ArrowRight);
    window.frame(0.5);
    window.app.world_mut().resource_mut::<ButtonInput<KeyCode>>().clear();
    assert!(window.player().clock().is_running());
    window.frame(0.5);
    let time = window.player().state().unwrap().time;
    assert!((time - halo - 1.0 - 0.5).abs() < 1e-9, "{time}");
    let ahead = window.player().timeline().unwrap().state(time + FORESIGHT_SECS).camera;
    let upcoming = window.app.world().resource::<Upcoming>().0.unwrap();
    assert!(upcoming.eye.distance(DVec3::from(ahead.eye)) < 1e-9, "what comes is known");
    window.ask(Asked::Back);
    assert_eq!(window.player().state().unwrap().time, halo);

    // Whoever takes the mouse to the picture leaves the tour, and the camera stays where it was.
    let before = window.viewpoint();
    window.app.world_mut().resource_mut::<ButtonInput<MouseButton>>().press(MouseButton::Left);
    window.frame(0.2);
    assert_eq!((window.navigation(), window.player().clock().is_running()), (Navigation::Orbit, false));
    assert_eq!(window.viewpoint(), before);
    window.app.world_mut().resource_mut::<ButtonInput<MouseButton>>().release(MouseButton::Left);
    window.ask(Asked::Toggle);
    assert_eq!(window.navigation(), Navigation::Tour);
}

#[test]
fn views_and_flights_become_a_tour_that_is_saved() {
    let mut window = Window::new();
    window.frame(0.1);
    // There is no tour yet.
    window.app.world_mut().resource_mut::<ButtonInput<KeyCode>>().press(KeyCode::KeyK);
    window.frame(0.0);
    window.app.world_mut().resource_mut::<ButtonInput<KeyCode>>().clear();
    window.frame(0.1);
    assert_eq!(window.player().tour().unwrap().keyframes.len(), 1);
    // A flight: the camera comes closer, evenly.
    window.ask(Asked::Record);
    for _ in 0..60 {
        window.frame(0.1);
        let world = window.app.world_mut();
        let mut viewpoint = world.query::<&mut Viewpoint>().single_mut(world).unwrap();
        viewpoint.eye.z -= 1.0;
    }
    window.ask(Asked::Record);
    window.frame(0.0);
    let count = window.player().tour().unwrap().keyframes.len();
    assert!((6..=8).contains(&count) && !window.player().is_recording(), "{count}");
    let timeline = window.player().timeline().unwrap();
    assert!((timeline.duration() - 1.5 - 6.0).abs() < 0.2, "{}", timeline.duration());
    let middle = timeline.state(1.5 + 3.0).camera;
    assert!((middle.eye[2] - 120.0).abs() < 1.6, "{middle:?}");
    assert_eq!(timeline.state(timeline.duration()).camera.eye[2], 90.0);

    window.ask(Asked::Label(0, "begin".into()));
    window.frame(0.0);
    window.ask(Asked::Caption(0, "A box of dark matter".into()));
    window.frame(0.0);
    window.ask(Asked::Save);
    let path = window.player().path().unwrap().to_owned();
    assert!(path.to_string_lossy().ends_with("demo.tour.ron") && !window.player().is_edited());
    let read = TourFile::read(&path).unwrap();
    assert_eq!(Some(&read), window.player().tour());
    assert_eq!(read.dataset.as_ref().unwrap().path, Path::new("demo.df"));
    assert_eq!(read.keyframes[0].label.as_deref(), Some("begin"));
    let mut again = Window::new();
    again.app.world_mut().resource_mut::<Player>().ask(Asked::Open(path));
    again.frame(0.0);
    again.frame(0.0);
    assert_eq!(again.player().state().unwrap().caption.text, "A box of dark matter");
}

#[test]
fn settings_follow_the_tour() {
    let mut colored = tour(false);
    colored.keyframes[1].hold = false;
    colored.keyframes[1].look.mode = crate::modes::find("density-squared");
    colored.keyframes[2].look.error_px = Some(3.0);
    let mut window = Window::new();
    window.open(&colored);
    window.frame(0.0);
    assert_eq!(window.app.world().resource::<Settings>().mode.name, "column-density");
    window.frame(4.5);
    assert_eq!(window.app.world().resource::<Settings>().mode.name, "density-squared");
    window.frame(10.0);
    assert_eq!(window.app.world().resource::<Settings>().error_px, 3.0);
    // A tour that cannot be read is told, and the one that is open stays where it is.
    window.ask(Asked::Open("/nowhere/a.tour.ron".into()));
    window.frame(0.1);
    assert!(window.player().tour().is_some() && !window.player().clock().is_running());
    let notices: Vec<String> =
        window.app.world().resource::<Notices>().all().map(|notice| notice.text.clone()).collect();
    assert!(notices.iter().any(|text| text.contains("/nowhere/a.tour.ron")), "{notices:?}");
}
