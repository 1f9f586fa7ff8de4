//! The window, driven as a user would: under a virtual X server the program opens the demo dataset, a drag on the mouse
//! turns the picture, keys hide the panel and save a screenshot, and closing the window ends the program with code 0.
#![cfg(all(feature = "viewer", target_os = "linux"))]
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "what fails here fails the test")]

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::xproto::{ClientMessageEvent, ConnectionExt, EventMask, ImageFormat, InputFocus, Window};
use x11rb::rust_connection::RustConnection;

const WIDTH: u16 = 1280;
const HEIGHT: u16 = 720;
/// The slowest machine that the test is meant for compiles its shaders on one core.
const PATIENCE: Duration = Duration::from_secs(240);

/// Kills a process that a failed test would leave behind.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A virtual X server with nothing on it, and a connection to it.
struct Desktop {
    connection: RustConnection,
    root: Window,
    xtest: u8,
    display: String,
    _server: Process,
}

impl Desktop {
    fn start() -> Desktop {
        let screen = format!("{WIDTH}x{HEIGHT}x24");
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", &screen, "-nolisten", "tcp", "-noreset"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|error| panic!("this test needs Xvfb (Debian: apt-get install xvfb): {error}"));
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        let server = Process(server);
        let display = format!(":{}", number.trim());
        let (connection, screen) = RustConnection::connect(Some(&display)).unwrap();
        let root = connection.setup().roots[screen].root;
        let xtest = connection.query_extension(b"XTEST").unwrap().reply().unwrap();
        assert!(xtest.present, "the X server has no XTEST extension");
        Desktop { connection, root, xtest: xtest.major_opcode, display, _server: server }
    }

    /// XTEST's FakeInput request (minor opcode 2): events 2 and 3 are keys, 4 and 5 buttons, 6 is motion.
    fn fake_input(&self, event: u8, detail: u8, [x, y]: [i16; 2]) {
        let mut request = [0u8; 36];
        request[..2].copy_from_slice(&[self.xtest, 2]);
        request[2..4].copy_from_slice(&9u16.to_ne_bytes());
        request[4] = event;
        request[5] = detail;
        request[24..26].copy_from_slice(&x.to_ne_bytes());
        request[26..28].copy_from_slice(&y.to_ne_bytes());
        let sent = self.connection.send_request_without_reply(&[std::io::IoSlice::new(&request)], Vec::new());
        sent.unwrap().ignore_error();
        self.connection.flush().unwrap();
        std::thread::sleep(Duration::from_millis(30));
    }

    fn drag(&self, from: [i16; 2], to: [i16; 2]) {
        self.drag_with(1, from, to);
    }

    fn drag_with(&self, button: u8, from: [i16; 2], to: [i16; 2]) {
        self.fake_input(6, 0, from);
        self.fake_input(4, button, [0; 2]);
        for step in 1..=12 {
            let at = |axis: usize| from[axis] + (to[axis] - from[axis]) * step / 12;
            self.fake_input(6, 0, [at(0), at(1)]);
        }
        self.fake_input(5, button, [0; 2]);
    }

    /// The keyboard's code for an X keysym.
    fn keycode(&self, keysym: u32) -> u8 {
        let setup = self.connection.setup();
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let map = self.connection.get_keyboard_mapping(first, last - first + 1).unwrap().reply().unwrap();
        let columns = usize::from(map.keysyms_per_keycode);
        let place = map.keysyms.iter().position(|&symbol| symbol == keysym).expect("the key is on the keyboard");
        first + (place / columns) as u8
    }

    /// Presses the key of an X keysym.
    fn press(&self, keysym: u32) {
        let keycode = self.keycode(keysym);
        self.fake_input(2, keycode, [0; 2]);
        self.fake_input(3, keycode, [0; 2]);
    }

    /// The program's window: the only one of the screen's size.
    fn window(&self) -> Option<Window> {
        let tree = self.connection.query_tree(self.root).ok()?.reply().ok()?;
        tree.children.into_iter().find(|&window| {
            let geometry = self.connection.get_geometry(window).ok().and_then(|cookie| cookie.reply().ok());
            geometry.is_some_and(|geometry| geometry.width == WIDTH && geometry.height == HEIGHT)
        })
    }

    /// Gives the window the keyboard, which nobody else does without a window manager.
    fn focus(&self, window: Window) {
        self.connection.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).unwrap();
        self.connection.flush().unwrap();
        std::thread::sleep(Duration::from_millis(300));
    }

    fn screenshot(&self) -> Screen {
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.root, 0, 0, WIDTH, HEIGHT, !0).unwrap();
        Screen(image.reply().unwrap().data)
    }

    /// Waits until the screen satisfies a condition: it follows the program's status a few frames later.
    fn wait(&self, what: &str, condition: impl Fn(&Screen) -> bool) -> Screen {
        let start = Instant::now();
        loop {
            let screen = self.screenshot();
            if condition(&screen) {
                return screen;
            }
            assert!(start.elapsed() < PATIENCE, "waited in vain for: {what}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    fn close(&self, window: Window) {
        let atom = |name: &[u8]| self.connection.intern_atom(false, name).unwrap().reply().unwrap().atom;
        let data = [atom(b"WM_DELETE_WINDOW"), x11rb::CURRENT_TIME, 0, 0, 0];
        let message = ClientMessageEvent::new(32, window, atom(b"WM_PROTOCOLS"), data);
        self.connection.send_event(false, window, EventMask::NO_EVENT, message).unwrap();
        self.connection.flush().unwrap();
    }
}

/// The screen's pixels: blue, green, red and a byte that is not used.
struct Screen(Vec<u8>);

impl Screen {
    fn at(&self, x: usize, y: usize) -> [u8; 3] {
        let i = 4 * (y * usize::from(WIDTH) + x);
        [self.0[i + 2], self.0[i + 1], self.0[i]]
    }

    /// Share of the pixels of columns `x` for which `accept` holds.
    fn share(&self, x: std::ops::Range<usize>, accept: impl Fn([u8; 3]) -> bool) -> f64 {
        let pixels = x.len() * usize::from(HEIGHT);
        let all = (0..usize::from(HEIGHT)).flat_map(|y| x.clone().map(move |x| (x, y)));
        all.filter(|&(x, y)| accept(self.at(x, y))).count() as f64 / pixels as f64
    }

    /// Share of the pixels of columns `x` that differ visibly from those of another screen.
    fn difference(&self, other: &Screen, x: std::ops::Range<usize>) -> f64 {
        let pixels = x.len() * usize::from(HEIGHT);
        let all = (0..usize::from(HEIGHT)).flat_map(|y| x.clone().map(move |x| (x, y)));
        let differ =
            |(x, y): &(usize, usize)| self.at(*x, *y).iter().zip(other.at(*x, *y)).any(|(a, b)| a.abs_diff(b) > 12);
        all.filter(differ).count() as f64 / pixels as f64
    }
}

/// The program under test.
struct Program {
    process: Process,
    status: PathBuf,
}

/// The snapshot that the windows open.
fn demo() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/demo/lcdm64_z0.hdf5")
}

impl Program {
    fn start(desktop: &Desktop, folder: &Path, arguments: &[&str]) -> Program {
        Program::with_size(desktop, folder, [WIDTH, HEIGHT], arguments)
    }

    fn with_size(desktop: &Desktop, folder: &Path, size: [u16; 2], arguments: &[&str]) -> Program {
        Program::open(desktop, folder, &demo(), size, arguments)
    }

    fn open(desktop: &Desktop, folder: &Path, source: &Path, [width, height]: [u16; 2], arguments: &[&str]) -> Program {
        let status = folder.join("status.json");
        let process = Command::new(env!("CARGO_BIN_EXE_deepfield"))
            .arg("view")
            .arg(source)
            .args(["--size", &format!("{width}x{height}"), "--status"])
            .arg(&status)
            .args(arguments)
            .env("DISPLAY", &desktop.display)
            .env("XDG_CACHE_HOME", folder)
            .env_remove("WAYLAND_DISPLAY")
            .current_dir(folder)
            .spawn()
            .unwrap();
        Program { process: Process(process), status }
    }

    fn status(&self) -> Value {
        std::fs::read_to_string(&self.status).ok().and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
    }

    /// Waits until the status satisfies a condition.
    fn wait(&mut self, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let status = self.status();
            if condition(&status) {
                return status;
            }
            if let Some(code) = self.process.0.try_wait().unwrap() {
                panic!("the program ended ({code}) before: {what}; status: {status:#}");
            }
            assert!(start.elapsed() < PATIENCE, "waited in vain for: {what}; status: {status:#}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Waits until the program ends by itself and returns its exit code.
    fn exit_code(&mut self) -> Option<i32> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Some(status) = self.process.0.try_wait().unwrap() {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("the program did not end");
    }
}

/// A colour of the panel's background, within a rounding step.
fn is_panel([r, g, b]: [u8; 3]) -> bool {
    r.abs_diff(0x14) <= 2 && g.abs_diff(0x17) <= 2 && b.abs_diff(0x1c) <= 2
}

/// Opens the demo, looks, drags, presses keys, and closes the window.
fn use_the_window(arguments: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let mut program = Program::start(&desktop, folder.path(), arguments);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(first["particles_drawn"], 262_144, "the demo is drawn in full at this size: {first:#}");
    assert_eq!((&first["panel"], &first["pages_failed"]), (&Value::from(true), &Value::from(0)));
    let left = first["picture"][0].as_f64().unwrap() as usize;
    let picture = left..usize::from(WIDTH);

    let lit = |screen: &Screen| screen.share(picture.clone(), |pixel| pixel.iter().any(|&c| c > 40));
    let before = desktop.wait("the panel at the left and data beside it", |screen| {
        screen.share(0..left, is_panel) > 0.6 && lit(screen) > 0.05
    });
    let text = before.share(0..left, |[r, g, b]| r > 120 && g > 120 && b > 120);
    assert!((0.005..0.3).contains(&text), "the panel has text on it: {text}");

    // A drag turns the camera around its target and changes the picture.
    let (middle, height) = ((left as i16 + WIDTH as i16) / 2, HEIGHT as i16 / 2);
    // A frame that takes longer than a drag sees the button pressed and released at once, so the hand tries again.
    let start = Instant::now();
    while program.status()["eye"] == first["eye"] {
        assert!(start.elapsed() < PATIENCE, "the camera does not turn");
        desktop.drag([middle, height], [middle + 220, height + 40]);
        std::thread::sleep(Duration::from_secs(1));
    }
    let turned = program.wait("the picture converges", |status| status["converged"] == true);
    assert_eq!(turned["target"], first["target"], "a turn keeps the target");
    desktop.wait("another picture after the drag", |screen| screen.difference(&before, picture.clone()) > 0.05);

    // A drag on the panel does not.
    desktop.drag([60, 700], [200, 640]);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(program.status()["eye"], turned["eye"], "a drag on the panel moves no camera");

    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    const TAB: u32 = 0xff09;
    const F12: u32 = 0xffc9;
    desktop.press(TAB);
    program.wait("Tab hides the panel", |status| status["panel"] == false && status["picture"][0] == 0.0);
    desktop.wait("the picture in the panel's place", |screen| screen.share(0..left, is_panel) < 0.5);
    desktop.press(F12);
    program.wait("F12 saves a picture", |status| status.to_string().contains("saved "));
    let saved = std::fs::read(folder.path().join("deepfield-0001.png")).unwrap();
    assert_eq!(saved[..8], *b"\x89PNG\r\n\x1a\n");

    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
}

#[test]
fn the_window_shows_turns_and_closes_on_the_processor() {
    use_the_window(&["--backend", "cpu"]);
}

#[test]
fn the_window_shows_turns_and_closes_on_the_graphics_adapter() {
    use_the_window(&["--backend", "compute"]);
}

#[test]
fn volumes_are_drawn_by_compute_passes() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let arguments = ["--mode", "volume", "--backend", "compute"];
    let mut program = Program::with_size(&desktop, folder.path(), [640, 240], &arguments);
    let status = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(status["backend"], "compute", "{status:#}");
    let left = status["picture"][0].as_f64().unwrap() as usize;
    let lit = |screen: &Screen| screen.share(left..640, |pixel| pixel.iter().any(|&c| c > 40));
    // The window is a third of the screen's height.
    desktop.wait("a volume", |screen| lit(screen) > 0.01);
}

/// Levels for volumes are drawn where the file has them, and what lies behind an opaque surface is known to.
#[test]
fn volume_levels_are_drawn_and_surfaces_hide_what_is_behind_them() {
    let folder = tempfile::tempdir().unwrap();
    let [source, file] = ["merger", "merger.df"].map(|name| folder.path().join(name));
    let run = |arguments: &[&str], paths: &[&Path]| {
        let status = Command::new(env!("CARGO_BIN_EXE_deepfield")).args(arguments).args(paths).status().unwrap();
        assert!(status.success());
    };
    run(&["synth", "merger", "-n", "400000", "-o"], &[&source]);
    run(&["build", "--volume-levels", "-o"], &[&file, &source]);
    let desktop = Desktop::start();
    let arguments = ["--mode", "isosurface", "--backend", "cpu"];
    let mut program = Program::open(&desktop, folder.path(), &file, [640, 360], &arguments);
    let status = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(status["levels"], "volume", "{status:#}");
    assert!(status["particles_drawn"].as_u64().unwrap() > 0 && status["nodes_hidden"].is_u64(), "{status:#}");
    let messages = status["messages"].as_array().unwrap();
    let complains = |message: &Value| message.as_str().is_some_and(|text| text.contains("no particles"));
    assert!(!messages.iter().any(complains), "nothing is wrong before pages have come: {status:#}");
    // It stays as it is: pictures and what they hide do not chase each other.
    std::thread::sleep(Duration::from_millis(1500));
    assert_eq!(program.status(), status);
}

/// Flies where there is no time for all particles.
fn sample_in_motion(arguments: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let mut program = Program::start(&desktop, folder.path(), arguments);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(first["sampled"], Value::Null, "all is drawn at rest: {first:#}");
    assert!(
        !first["messages"].to_string().contains("no particles"),
        "pages that have not come are no mistake: {first:#}"
    );
    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    desktop.press(u32::from('f'));
    program.wait("F flies", |status| status["flying"] == true);
    let forward = desktop.keycode(u32::from('w'));
    desktop.fake_input(2, forward, [0; 2]);
    let moving = program.wait("a sample while W is held", |status| status["sampled"].is_u64());
    assert!(
        moving["sampled"].as_u64() < moving["particles_drawn"].as_u64() && moving["converged"] == false,
        "{moving:#}"
    );
    desktop.fake_input(3, forward, [0; 2]);
    let rest = program.wait("all particles at rest", |status| status["converged"] == true);
    assert_eq!(rest["sampled"], Value::Null, "all is drawn at rest: {rest:#}");
    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
}

#[test]
fn motion_is_drawn_with_a_sample_on_the_processor() {
    sample_in_motion(&["--backend", "cpu", "--frame-ms", "0.5"]);
}

#[test]
fn volumes_in_motion_take_a_sample() {
    sample_in_motion(&["--backend", "cpu", "--mode", "volume"]);
}

#[test]
fn motion_is_drawn_with_a_sample_on_the_graphics_adapter() {
    sample_in_motion(&["--backend", "compute", "--frame-ms", "0.5"]);
}

#[test]
fn particles_that_another_system_moves_are_drawn_state_by_state() {
    for mode in ["column-density", "volume"] {
        let folder = tempfile::tempdir().unwrap();
        let desktop = Desktop::start();
        let arguments = ["--backend", "cpu", "--simulate", "--mode", mode, "--frame-ms", "200"];
        let mut program = Program::start(&desktop, folder.path(), &arguments);
        let state = |status: &Value| status["live"].as_u64().unwrap_or(0);
        let first = program.wait("a state of the simulation", |status| state(status) > 0);
        let left = first["picture"][0].as_f64().unwrap() as usize;
        let picture = left..usize::from(WIDTH);
        let lit = |screen: &Screen| screen.share(picture.clone(), |pixel| pixel.iter().any(|&c| c > 40));
        let before = desktop.wait("particles in the picture", |screen| lit(screen) > 0.05);
        let later = program.wait("a later state", |status| state(status) > state(&first) + 10);
        desktop.wait("that they move", |screen| screen.difference(&before, picture.clone()) > 0.02);
        assert_eq!(later["eye"], first["eye"], "{later:#}");
        assert_eq!(later["converged"], false, "what moves has no last picture: {later:#}");
        desktop.close(desktop.window().expect("a window of the size that was asked for"));
        assert_eq!(program.exit_code(), Some(0));
    }
}

fn point(status: &Value, name: &str) -> [f64; 3] {
    [0, 1, 2].map(|axis| status[name][axis].as_f64().unwrap())
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Repeats an input until the status shows its effect: a frame may take longer than a gesture, which is then lost.
fn repeat(program: &Program, what: &str, act: impl Fn(), seen: impl Fn(&Value) -> bool) -> Value {
    let start = Instant::now();
    loop {
        let status = program.status();
        if status["eye"].is_array() && seen(&status) {
            return status;
        }
        assert!(start.elapsed() < PATIENCE, "{what} in vain; status: {status:#}");
        act();
        std::thread::sleep(Duration::from_millis(700));
    }
}

#[test]
fn wheel_right_drag_flying_and_help() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let mut program = Program::start(&desktop, folder.path(), &["--backend", "cpu"]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let left = first["picture"][0].as_f64().unwrap() as i16;
    let middle = [(left + WIDTH as i16) / 2, HEIGHT as i16 / 2];
    let range = |status: &Value| distance(point(status, "eye"), point(status, "target"));

    // The wheel upwards (button 4) comes nearer to the same target, downwards goes away again.
    desktop.fake_input(6, 0, middle);
    let turn = |button: u8| {
        desktop.fake_input(4, button, [0; 2]);
        desktop.fake_input(5, button, [0; 2]);
    };
    let near = repeat(&program, "the wheel zooms in", || turn(4), |status| range(status) < 0.9 * range(&first));
    assert_eq!(near["target"], first["target"], "a zoom keeps the target");
    let near = range(&near);
    repeat(&program, "the wheel zooms out", || turn(5), |status| range(status) > near * 1.05);

    // The right button shifts the target and keeps the direction.
    let shift = || desktop.drag_with(3, middle, [middle[0] + 160, middle[1] - 60]);
    let moved = |status: &Value| distance(point(status, "target"), point(&first, "target"));
    let shifted = repeat(&program, "a right drag shifts", shift, |status| moved(status) > 0.01 * range(&first));
    let direction = |status: &Value| {
        let (eye, target, range) = (point(status, "eye"), point(status, "target"), range(status));
        [0, 1, 2].map(|axis| (eye[axis] - target[axis]) / range)
    };
    assert!(distance(direction(&shifted), direction(&first)) < 1e-3, "a shift does not turn: {shifted:#}");

    // F flies, and W moves forward as long as it is held.
    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    desktop.press(u32::from('f'));
    let flying = program.wait("F flies", |status| status["flying"] == true);
    let forward = desktop.keycode(u32::from('w'));
    desktop.fake_input(2, forward, [0; 2]);
    let flown = |status: &Value| distance(point(status, "eye"), point(&flying, "eye"));
    let there = program.wait("W moves the camera", |status| flown(status) > 0.02 * range(&flying));
    desktop.fake_input(3, forward, [0; 2]);
    let ahead: f64 =
        (0..3).map(|axis| -(point(&there, "eye")[axis] - point(&flying, "eye")[axis]) * direction(&flying)[axis]).sum();
    assert!(ahead > 0.9 * flown(&there), "W moves forward: {ahead} of {}", flown(&there));

    // F1 shows the help page; Escape leaves it, then flying.
    const F1: u32 = 0xffbe;
    const ESCAPE: u32 = 0xff1b;
    desktop.press(F1);
    program.wait("F1 shows the help page", |status| status["help"] == true);
    desktop.press(ESCAPE);
    program.wait("Escape leaves the help page", |status| status["help"] == false && status["flying"] == true);
    desktop.press(ESCAPE);
    program.wait("Escape leaves flying", |status| status["flying"] == false);

    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
}
