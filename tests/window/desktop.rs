//! What tests of the window share: a virtual X server with a mouse and a keyboard, the program under test with its status, and
//! the pixels on the screen.

use crate::support::{demo, keep_demo_pages, program};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::xproto::{ClientMessageEvent, ConnectionExt, EventMask, ImageFormat, InputFocus, Window};
use x11rb::rust_connection::RustConnection;

pub const WIDTH: u16 = 1280;
pub const HEIGHT: u16 = 720;
/// The slowest machine that the test is meant for compiles its shaders on one core.
pub const PATIENCE: Duration = Duration::from_secs(240);
/// Logical pixels that a notch of the wheel scrolls the panel by, or somewhat less.
const NOTCH: i32 = 60;

/// Kills a process that a failed test would leave behind.
pub struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A virtual X server with nothing on it, and a connection to it.
pub struct Desktop {
    connection: RustConnection,
    root: Window,
    xtest: u8,
    display: String,
    size: [u16; 2],
    _server: Process,
}

impl Desktop {
    pub fn start() -> Desktop {
        Desktop::with_screen([WIDTH, HEIGHT])
    }

    /// A screen of that many pixels.
    pub fn with_screen(size: [u16; 2]) -> Desktop {
        let screen = format!("{}x{}x24", size[0], size[1]);
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
        Desktop { connection, root, xtest: xtest.major_opcode, display, size, _server: server }
    }

    /// XTEST's FakeInput request (minor opcode 2): events 2 and 3 are keys, 4 and 5 buttons, 6 is motion.
    pub fn fake_input(&self, event: u8, detail: u8, [x, y]: [i16; 2]) {
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

    pub fn drag(&self, from: [i16; 2], to: [i16; 2]) {
        self.drag_with(1, from, to);
    }

    pub fn drag_with(&self, button: u8, from: [i16; 2], to: [i16; 2]) {
        self.fake_input(6, 0, from);
        self.fake_input(4, button, [0; 2]);
        for step in 1..=12 {
            let at = |axis: usize| from[axis] + (to[axis] - from[axis]) * step / 12;
            self.fake_input(6, 0, [at(0), at(1)]);
        }
        self.fake_input(5, button, [0; 2]);
    }

    /// Holds the left button from the first place over all others.
    pub fn stroke(&self, places: &[[i16; 2]]) {
        self.fake_input(6, 0, places[0]);
        self.fake_input(4, 1, [0; 2]);
        for pair in places.windows(2) {
            for step in 1..=6 {
                let at = |axis: usize| pair[0][axis] + (pair[1][axis] - pair[0][axis]) * step / 6;
                self.fake_input(6, 0, [at(0), at(1)]);
            }
        }
        self.fake_input(5, 1, [0; 2]);
    }

    /// The keyboard's code for an X keysym.
    pub fn keycode(&self, keysym: u32) -> u8 {
        let setup = self.connection.setup();
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let map = self.connection.get_keyboard_mapping(first, last - first + 1).unwrap().reply().unwrap();
        let columns = usize::from(map.keysyms_per_keycode);
        let place = map.keysyms.iter().position(|&symbol| symbol == keysym).expect("the key is on the keyboard");
        first + (place / columns) as u8
    }

    /// A click of the left button. The mouse comes from beside: a window that has missed the motion to a place learns of none while the mouse
    /// stays there.
    pub fn click(&self, at: [i16; 2]) {
        self.fake_input(6, 0, [at[0] - 1, at[1]]);
        self.fake_input(6, 0, at);
        self.fake_input(4, 1, [0; 2]);
        self.fake_input(5, 1, [0; 2]);
    }

    /// Presses a key while others are held.
    pub fn press_with(&self, held: &[u32], keysym: u32) {
        let held: Vec<u8> = held.iter().map(|&keysym| self.keycode(keysym)).collect();
        held.iter().for_each(|&keycode| self.fake_input(2, keycode, [0; 2]));
        self.press(keysym);
        held.iter().for_each(|&keycode| self.fake_input(3, keycode, [0; 2]));
    }

    /// Types digits, lower-case letters and points.
    pub fn type_text(&self, text: &str) {
        text.chars().for_each(|c| self.press(u32::from(c)));
    }

    /// Presses the key of an X keysym.
    pub fn press(&self, keysym: u32) {
        let keycode = self.keycode(keysym);
        self.fake_input(2, keycode, [0; 2]);
        self.fake_input(3, keycode, [0; 2]);
    }

    /// The program's window: the only one of the screen's size.
    pub fn window(&self) -> Option<Window> {
        let tree = self.connection.query_tree(self.root).ok()?.reply().ok()?;
        tree.children.into_iter().find(|&window| {
            let geometry = self.connection.get_geometry(window).ok().and_then(|cookie| cookie.reply().ok());
            geometry.is_some_and(|geometry| [geometry.width, geometry.height] == self.size)
        })
    }

    /// Gives the window the keyboard, which nobody else does without a window manager.
    pub fn focus(&self, window: Window) {
        self.connection.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).unwrap();
        self.connection.flush().unwrap();
        std::thread::sleep(Duration::from_millis(300));
    }

    pub fn screenshot(&self) -> Screen {
        let [width, height] = self.size;
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.root, 0, 0, width, height, !0).unwrap();
        Screen { pixels: image.reply().unwrap().data, size: self.size.map(usize::from) }
    }

    /// Waits until the screen satisfies a condition: it follows the program's status a few frames later.
    pub fn wait(&self, what: &str, condition: impl Fn(&Screen) -> bool) -> Screen {
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

    pub fn close(&self, window: Window) {
        let atom = |name: &[u8]| self.connection.intern_atom(false, name).unwrap().reply().unwrap().atom;
        let data = [atom(b"WM_DELETE_WINDOW"), x11rb::CURRENT_TIME, 0, 0, 0];
        let message = ClientMessageEvent::new(32, window, atom(b"WM_PROTOCOLS"), data);
        self.connection.send_event(false, window, EventMask::NO_EVENT, message).unwrap();
        self.connection.flush().unwrap();
    }
}

/// The screen's pixels: blue, green, red and a byte that is not used.
pub struct Screen {
    pixels: Vec<u8>,
    size: [usize; 2],
}

impl Screen {
    /// Saves the screen as a PNG, to be looked at.
    pub fn save(&self, path: &Path) {
        let file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
        let mut encoder = png::Encoder::new(file, self.size[0] as u32, self.size[1] as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let rgb: Vec<u8> = self.pixels.chunks_exact(4).flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect();
        encoder.write_header().unwrap().write_image_data(&rgb).unwrap();
    }

    pub fn at(&self, x: usize, y: usize) -> [u8; 3] {
        let i = 4 * (y * self.size[0] + x);
        [self.pixels[i + 2], self.pixels[i + 1], self.pixels[i]]
    }

    /// Share of the pixels of columns `x` for which `accept` holds.
    pub fn share(&self, x: std::ops::Range<usize>, accept: impl Fn([u8; 3]) -> bool) -> f64 {
        let pixels = x.len() * self.size[1];
        let all = (0..self.size[1]).flat_map(|y| x.clone().map(move |x| (x, y)));
        all.filter(|&(x, y)| accept(self.at(x, y))).count() as f64 / pixels as f64
    }

    /// Share of the pixels of columns `x` that differ visibly from those of another screen.
    pub fn difference(&self, other: &Screen, x: std::ops::Range<usize>) -> f64 {
        let pixels = x.len() * self.size[1];
        let all = (0..self.size[1]).flat_map(|y| x.clone().map(move |x| (x, y)));
        let differ =
            |(x, y): &(usize, usize)| self.at(*x, *y).iter().zip(other.at(*x, *y)).any(|(a, b)| a.abs_diff(b) > 12);
        all.filter(differ).count() as f64 / pixels as f64
    }
}

/// The program under test.
pub struct Program {
    process: Process,
    status: PathBuf,
}

impl Drop for Program {
    /// A window that another process keeps open ends a moment after that; the next test is not to find it.
    fn drop(&mut self) {
        let window = self.status()["process"].as_u64();
        let _ = self.process.0.kill();
        let _ = self.process.0.wait();
        let start = Instant::now();
        while window.is_some_and(|window| Path::new(&format!("/proc/{window}")).exists())
            && start.elapsed() < Duration::from_secs(5)
        {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Program {
    pub fn start(desktop: &Desktop, folder: &Path, arguments: &[&str]) -> Program {
        Program::with_size(desktop, folder, [WIDTH, HEIGHT], arguments)
    }

    pub fn with_size(desktop: &Desktop, folder: &Path, size: [u16; 2], arguments: &[&str]) -> Program {
        Program::open(desktop, folder, &demo(), size, arguments)
    }

    pub fn open(
        desktop: &Desktop,
        folder: &Path,
        source: &Path,
        [width, height]: [u16; 2],
        arguments: &[&str],
    ) -> Program {
        Program::open_with(desktop, folder, source, [width, height], arguments, &[])
    }

    /// As [`Program::open`], with variables of the environment.
    pub fn open_with(
        desktop: &Desktop,
        folder: &Path,
        source: &Path,
        size: [u16; 2],
        arguments: &[&str],
        variables: &[(&str, &Path)],
    ) -> Program {
        Program::view(desktop, folder, Some(source), size, arguments, variables)
    }

    /// A window that nothing is opened in.
    pub fn without_file(
        desktop: &Desktop,
        folder: &Path,
        size: [u16; 2],
        arguments: &[&str],
        variables: &[(&str, &Path)],
    ) -> Program {
        Program::view(desktop, folder, None, size, arguments, variables)
    }

    /// `folder` is all that the program knows of its user, with what it has made of the demo snapshot before.
    fn view(
        desktop: &Desktop,
        folder: &Path,
        source: Option<&Path>,
        [width, height]: [u16; 2],
        arguments: &[&str],
        variables: &[(&str, &Path)],
    ) -> Program {
        keep_demo_pages(folder);
        let status = folder.join("status.json");
        // What an earlier program has left behind is not this one's.
        let _ = std::fs::remove_file(&status);
        let process = program()
            .arg("view")
            .args(source)
            .args(["--size", &format!("{width}x{height}"), "--status"])
            .arg(&status)
            .args(arguments)
            .env("DISPLAY", &desktop.display)
            .envs(["XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_RUNTIME_DIR"].map(|name| (name, folder)))
            .envs(variables.iter().copied())
            .env_remove("WAYLAND_DISPLAY")
            .current_dir(folder)
            .spawn()
            .unwrap();
        Program { process: Process(process), status }
    }

    pub fn status(&self) -> Value {
        std::fs::read_to_string(&self.status).ok().and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
    }

    /// Waits until the status satisfies a condition.
    pub fn wait(&mut self, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
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

    /// The middle of a control of the panel, as the status names it, on the screen.
    pub fn control(&self, name: &str) -> Option<[i16; 2]> {
        let rect = &self.status()["controls"][name];
        let side = |i: usize| rect[i].as_f64();
        Some([(side(0)? + side(2)?) as i16 / 2, (side(1)? + side(3)?) as i16 / 2])
    }

    /// Scrolls until a control is on the screen, and returns its middle. Sections of the panel are scrolled with the wheel.
    pub fn reveal(&self, desktop: &Desktop, name: &str) -> [i16; 2] {
        let start = Instant::now();
        let height = desktop.size[1] as i16;
        // What has been scrolled glides on for a while: where it stays is where it is the second time.
        let (mut scrolled, mut last) = (false, None);
        loop {
            let at = self.control(name);
            let rests = !scrolled || last == at;
            match at {
                Some([x, y]) if rests => {
                    if self.status()["controls"][name][4] == 1.0 {
                        return [x, y];
                    }
                    scrolled = true;
                    desktop.fake_input(6, 0, [x, height / 2]);
                    let (button, beyond) =
                        if y < height / 2 { (4, -i32::from(y)) } else { (5, i32::from(y) - i32::from(height)) };
                    for _ in 0..(beyond / NOTCH).clamp(1, 20) {
                        desktop.fake_input(4, button, [0; 2]);
                        desktop.fake_input(5, button, [0; 2]);
                    }
                    self.draw_frames();
                }
                _ => {}
            }
            last = at;
            assert!(start.elapsed() < PATIENCE, "no control {name}: {:#}", self.status()["controls"]);
            std::thread::sleep(Duration::from_millis(250));
        }
    }

    /// Waits until what was done with mouse and keys is in the status: some frames have been drawn since, and the file has been written. Less
    /// than half a second after a click the next one would make a double-click of both.
    pub fn settle(&self) {
        self.draw_frames();
        std::thread::sleep(Duration::from_millis(400));
    }

    /// Waits until some more frames have been drawn.
    fn draw_frames(&self) {
        let start = Instant::now();
        let frames = || self.status()["frames"].as_u64().unwrap_or(0);
        let before = frames();
        while frames() < before + 3 && start.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until the program ends by itself and returns its exit code.
    pub fn exit_code(&mut self) -> Option<i32> {
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

/// Saves what is on the screen where the environment variable `DEEPFIELD_SCREENSHOTS` names a folder.
pub fn keep(desktop: &Desktop, name: &str) {
    if let Some(folder) = std::env::var_os("DEEPFIELD_SCREENSHOTS") {
        std::thread::sleep(Duration::from_millis(900));
        desktop.screenshot().save(&Path::new(&folder).join(name));
    }
}

/// Clicks a control until the status shows the effect.
pub fn click(program: &Program, desktop: &Desktop, control: &str, seen: impl Fn(&Value) -> bool) -> Value {
    repeat(program, control, || desktop.click(program.reveal(desktop, control)), seen)
}

/// Opens a combo box and clicks an entry, which has a name of its own, until the status shows the effect.
pub fn choose(program: &Program, desktop: &Desktop, combo: &str, entry: &str, seen: impl Fn(&Value) -> bool) -> Value {
    let choose = || {
        desktop.click(program.reveal(desktop, combo));
        program.settle();
        if let Some(at) = program.control(entry) {
            desktop.click(at);
        }
    };
    repeat(program, entry, choose, seen)
}

/// The middle of the picture on the screen.
pub fn middle(status: &Value) -> [i16; 2] {
    let side = |i: usize| status["picture"][i].as_f64().unwrap();
    [((side(0) + side(2)) / 2.0) as i16, ((side(1) + side(3)) / 2.0) as i16]
}

/// The columns of the screen that the picture takes.
pub fn columns(status: &Value) -> std::ops::Range<usize> {
    let side = |i: usize| status["picture"][i].as_f64().unwrap() as usize;
    side(0)..side(2)
}

/// A colour of the panel's background, within a rounding step.
pub fn is_panel([r, g, b]: [u8; 3]) -> bool {
    r.abs_diff(0x14) <= 2 && g.abs_diff(0x17) <= 2 && b.abs_diff(0x1c) <= 2
}

pub fn point(status: &Value, name: &str) -> [f64; 3] {
    [0, 1, 2].map(|axis| status[name][axis].as_f64().unwrap())
}

pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Repeats an input until the status shows its effect: a frame may take longer than a gesture, which is then lost.
pub fn repeat(program: &Program, what: &str, act: impl Fn(), seen: impl Fn(&Value) -> bool) -> Value {
    let start = Instant::now();
    loop {
        let status = program.status();
        if status["eye"].is_array() && seen(&status) {
            return status;
        }
        assert!(start.elapsed() < PATIENCE, "{what} in vain; status: {status:#}");
        act();
        program.settle();
    }
}

/// Drags until the eye is elsewhere than a status has it, and some frames have been drawn since: one that takes longer than a drag sees the button
/// pressed and released at once, so the hand tries again.
pub fn turn(program: &Program, desktop: &Desktop, before: &Value, from: [i16; 2], to: [i16; 2]) {
    let start = Instant::now();
    let has_turned = || {
        let status = program.status();
        status["eye"].is_array() && status["eye"] != before["eye"]
    };
    while !has_turned() {
        assert!(start.elapsed() < PATIENCE, "the camera does not turn");
        desktop.drag(from, to);
        let dragged = Instant::now();
        while !has_turned() && dragged.elapsed() < Duration::from_secs(1) {
            std::thread::sleep(Duration::from_millis(50));
        }
    }
    program.draw_frames();
}

/// As [`repeat`], of what takes its time, which another input would begin anew: for some seconds there is none.
pub fn repeat_flight(program: &Program, what: &str, act: impl Fn(), seen: impl Fn(&Value) -> bool) -> Value {
    let act = || {
        act();
        let start = Instant::now();
        while !seen(&program.status()) && start.elapsed() < Duration::from_secs(4) {
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    repeat(program, what, act, &seen)
}
