//! The window, driven as a user would: under a virtual X server the program opens the demo dataset, a drag on the mouse
//! turns the picture, keys hide the panel and save a screenshot, and closing the window ends the program with code 0.

use super::desktop::{Desktop, HEIGHT, Program, Screen, columns, distance, is_panel, keep, point, repeat, turn};
use crate::support::program;
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

/// Opens the demo, looks, drags, presses keys, and closes the window.
fn use_the_window(arguments: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let mut program = Program::start(&desktop, folder.path(), arguments);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(first["particles_drawn"], 262_144, "the demo is drawn in full at this size: {first:#}");
    assert_eq!((&first["panel"], &first["pages_failed"]), (&Value::from(true), &Value::from(0)));
    assert_eq!(first["pages"]["drawable"], first["pages_resident"], "{first:#}");
    let picture = columns(&first);
    let left = picture.start;

    let lit = |screen: &Screen| screen.share(picture.clone(), |pixel| pixel.iter().any(|&c| c > 40));
    let before = desktop.wait("the panel at the left and data beside it", |screen| {
        screen.share(0..left, is_panel) > 0.6 && lit(screen) > 0.05
    });
    let text = before.share(0..left, |[r, g, b]| r > 120 && g > 120 && b > 120);
    assert!((0.005..0.3).contains(&text), "the panel has text on it: {text}");

    // A drag turns the camera around its target and changes the picture.
    let (middle, height) = ((picture.start + picture.end) as i16 / 2, HEIGHT as i16 / 2);
    turn(&program, &desktop, &first, [middle, height], [middle + 220, height + 40]);
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

/// Of pages that a server sends: the window knows the URL alone.
#[cfg(feature = "remote")]
#[test]
fn volumes_behind_a_url_are_drawn_by_compute_passes() {
    use crate::support::{fault_server::FaultServer, keep_demo_pages};
    use std::collections::BTreeSet;
    let folder = tempfile::tempdir().unwrap();
    let server = FaultServer::new(std::fs::read(keep_demo_pages(folder.path())).unwrap());
    let url = server.url("demo.df");
    let desktop = Desktop::start();
    let arguments = ["--mode", "volume", "--backend", "compute"];
    let mut program = Program::open(&desktop, folder.path(), Path::new(&url), [640, 240], &arguments);
    let status = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!((&status["backend"], &status["pages_failed"]), (&Value::from("compute"), &Value::from(0)), "{status:#}");
    assert_eq!(status["open"], *url, "{status:#}");
    // More than the ends of the file.
    let ranges: BTreeSet<_> = server.asked().into_iter().filter_map(|asked| asked.range).collect();
    assert!(ranges.len() > 2, "{ranges:?}");
    let lit = |screen: &Screen| screen.share(columns(&status), |pixel| pixel.iter().any(|&c| c > 40));
    // The window is a third of the screen's height.
    desktop.wait("a volume", |screen| lit(screen) > 0.01);
}

/// Levels for volumes are drawn where the file has them, and what lies behind an opaque surface is known to.
#[test]
fn volume_levels_are_drawn_and_surfaces_hide_what_is_behind_them() {
    let folder = tempfile::tempdir().unwrap();
    let [source, file] = ["merger", "merger.df"].map(|name| folder.path().join(name));
    let run = |arguments: &[&str], paths: &[&Path]| {
        let status = program().args(arguments).args(paths).status().unwrap();
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
    let but_frames = |mut status: Value| {
        status["frames"].take();
        status
    };
    assert_eq!(but_frames(program.status()), but_frames(status));
}

/// A window whose pictures take little time.
const SMALL: [u16; 2] = [640, 360];

/// Flies where there is no time for all particles.
fn sample_in_motion(arguments: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SMALL);
    let mut program = Program::with_size(&desktop, folder.path(), SMALL, arguments);
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
    for (mode, backend) in [("column-density", "cpu"), ("volume", "compute")] {
        let folder = tempfile::tempdir().unwrap();
        let desktop = Desktop::with_screen(SMALL);
        let arguments = ["--backend", backend, "--simulate", "--mode", mode, "--frame-ms", "200"];
        let mut program = Program::with_size(&desktop, folder.path(), SMALL, &arguments);
        let state = |status: &Value| status["live"].as_u64().unwrap_or(0);
        let first = program.wait("a state of the simulation", |status| state(status) > 0);
        let picture = columns(&first);
        let lit = |screen: &Screen| screen.share(picture.clone(), |pixel| pixel.iter().any(|&c| c > 40));
        let before = desktop.wait("particles in the picture", |screen| lit(screen) > 0.05);
        let later = program.wait("a later state", |status| state(status) > state(&first) + 3);
        desktop.wait("that they move", |screen| screen.difference(&before, picture.clone()) > 0.02);
        assert_eq!(later["eye"], first["eye"], "{later:#}");
        assert_eq!(later["converged"], false, "what moves has no last picture: {later:#}");
        assert_eq!(later["backend"], backend, "{later:#}");
        desktop.close(desktop.window().expect("a window of the size that was asked for"));
        assert_eq!(program.exit_code(), Some(0));
    }
}

#[test]
fn wheel_right_drag_flying_and_help() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let mut program = Program::start(&desktop, folder.path(), &["--backend", "cpu"]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let picture = columns(&first);
    let middle = [(picture.start + picture.end) as i16 / 2, HEIGHT as i16 / 2];
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
    keep(&desktop, "help.png");
    desktop.press(ESCAPE);
    program.wait("Escape leaves the help page", |status| status["help"] == false && status["flying"] == true);
    desktop.press(ESCAPE);
    program.wait("Escape leaves flying", |status| status["flying"] == false);

    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
}
