//! Outputs in windows of their own: bent and blended they are the dome master of the processor, with a tour's words; one that is killed
//! comes back, as the presenter's does, which goes on where it was; and all end with the presenter's window, or with what keeps them open.

use super::desktop::{Desktop, PATIENCE, Program, Screen, keep};
use crate::support::{demo, keep_demo_pages, program};
use deepfield::annotate::overlay::read_png;
use deepfield::color::Image;
use deepfield::color::output::write_png;
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Sides of an output's window.
const SIDE: u32 = 280;
/// The presenter's window, most of which its outputs cover: nobody looks at it.
const STAGE: [u16; 2] = [640, 320];

/// Each channel's mean over a part of a screen, and its mean difference from a part of a picture whose values are multiplied by
/// `factor`.
fn compare(screen: &Screen, at: [u32; 2], master: &Image, corner: [u32; 2], factor: f64) -> [f64; 2] {
    let (mut sum, mut difference) = (0.0, 0.0);
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let found = screen.at((at[0] + x) as usize, (at[1] + y) as usize);
        let expected = master.rgba[((corner[1] + y) * master.width + corner[0] + x) as usize];
        for k in 0..3 {
            let expected = factor * f64::from(expected[k]);
            difference += (f64::from(found[k]) - expected).abs();
            sum += expected;
        }
    }
    [sum, difference].map(|value| value / f64::from(3 * SIDE * SIDE))
}

fn in_step(status: &Value) -> bool {
    let followers = status["show"]["followers"].as_array();
    followers.is_some_and(|all| all.len() == 2 && all.iter().all(|one| one[1] == true && one[2] == true))
}

fn process(status: &Value, index: usize) -> Option<u64> {
    status["show"]["outputs"][index][1].as_u64()
}

#[test]
fn outputs_are_parts_of_the_dome_master_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    keep_demo_pages(folder.path());
    let at = |name: &str| folder.path().join(name);
    let demo = demo();
    let scene = format!(
        r#"(version: 1, datasets: [(path: {demo:?})], mode: "column-density", error_px: 0.5,
            camera: (eye: (25.0, 25.0, 55.0), target: (25.0, 25.0, 25.0)),
            transfer: (scale: log, range: fixed(20.0, 2000.0)))"#
    );
    std::fs::write(at("show.scene.ron"), scene).unwrap();
    let grey = Image { width: 2, height: 2, rgba: vec![[128, 128, 128, 255]; 4] };
    write_png(&at("half.png"), &grey).unwrap();
    let left = u32::from(STAGE[0]) - 2 * SIDE;
    let rig = format!(
        r#"(version: 1, outputs: [
            (name: "left", window: ({left}, 0, {SIDE}, {SIDE}), shows: dome(tilt: 60.0, part: (0.0, 0.0, 0.5, 0.5))),
            (name: "right", window: ({}, 0, {SIDE}, {SIDE}), shows: dome(tilt: 60.0, part: (0.5, 0.5, 1.0, 1.0)), blend: "half.png"),
        ])"#,
        left + SIDE
    );
    std::fs::write(at("rig.ron"), rig).unwrap();
    let size = format!("{}x{}", 2 * SIDE, 2 * SIDE);
    let mut master = program();
    master.arg("render").arg(at("show.scene.ron")).arg("-o").arg(at("master.png")).args(["--backend", "cpu"]);
    master.args(["--projection", "dome", "--tilt", "60", "--size", &size]).env("XDG_CACHE_HOME", folder.path());
    assert!(master.status().unwrap().success());
    let master = read_png(&at("master.png")).unwrap();

    let stage = Desktop::with_screen(STAGE);
    let rig = at("rig.ron");
    let outputs = ["--backend", "cpu", "--outputs", rig.to_str().unwrap()];
    let mut leader = Program::open(&stage, folder.path(), &at("show.scene.ron"), STAGE, &outputs);
    leader.wait("two outputs in step", |status| status["converged"] == true && in_step(status));
    let shown = |what: &str| {
        let begin = Instant::now();
        loop {
            let screen = stage.screenshot();
            // Half of the light is what values to the power 2.2 say.
            let factor = (128f64 / 255.0).powf(1.0 / 2.2);
            let left_part = compare(&screen, [left, 0], &master, [0, 0], 1.0);
            let right_part = compare(&screen, [left + SIDE, 0], &master, [SIDE, SIDE], factor);
            let fits = |[mean, difference]: [f64; 2]| mean > 10.0 && difference < 0.06 * mean;
            if fits(left_part) && fits(right_part) {
                return;
            }
            assert!(begin.elapsed() < PATIENCE, "{what}: mean and difference {left_part:?}, {right_part:?}");
            std::thread::sleep(Duration::from_millis(300));
        }
    };
    shown("parts of the dome master");
    keep(&stage, "outputs.png");

    // The window of an output fails as hard as it can.
    let killed = process(&leader.status(), 0).unwrap();
    assert!(Command::new("kill").args(["-9", &killed.to_string()]).status().unwrap().success());
    let back = leader.wait("a window that is opened again", |status| {
        process(status, 0).is_some_and(|process| process != killed) && in_step(status)
    });
    assert!(back["messages"].to_string().contains("left: its window has ended"), "{:#}", back["messages"]);
    shown("after it was opened again");

    // All end with the presenter's window.
    let windows = windows(&leader.status());
    assert_eq!(windows.len(), 3);
    stage.close(stage.window().unwrap());
    assert_eq!(leader.exit_code(), Some(0));
    wait_for_the_end(&windows);
}

/// The processes of all windows: the presenter's and its outputs'.
fn windows(status: &Value) -> Vec<u64> {
    let outputs = (0..2).filter_map(|index| process(status, index));
    status["process"].as_u64().into_iter().chain(outputs).collect()
}

fn wait_for_the_end(windows: &[u64]) {
    let begin = Instant::now();
    while windows.iter().any(|process| is_running(*process)) {
        assert!(begin.elapsed() < PATIENCE, "windows are left behind: {windows:?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// How much of the bright letters of a part of a picture is seen on the screen, and how much of those on the screen in the picture, to
/// a pixel: edges of letters are blurred where a picture is bent.
fn letters(screen: &Screen, at: [u32; 2], master: &Image, corner: [u32; 2], side: u32) -> [f64; 2] {
    let on_screen = |level: u8| {
        move |x: u32, y: u32| screen.at((at[0] + x) as usize, (at[1] + y) as usize).iter().all(|&c| c > level)
    };
    let in_master = |level: u8| {
        move |x: u32, y: u32| {
            master.rgba[((corner[1] + y) * master.width + corner[0] + x) as usize][..3].iter().all(|&c| c > level)
        }
    };
    let share = |of: &dyn Fn(u32, u32) -> bool, found: &dyn Fn(u32, u32) -> bool| {
        let all = (1..side - 1).flat_map(|y| (1..side - 1).map(move |x| (x, y))).filter(|&(x, y)| of(x, y));
        let near = |&(x, y): &(u32, u32)| (y - 1..=y + 1).any(|y| (x - 1..=x + 1).any(|x| found(x, y)));
        let all: Vec<(u32, u32)> = all.collect();
        if all.len() < 40 { 0.0 } else { all.iter().filter(|place| near(place)).count() as f64 / all.len() as f64 }
    };
    [share(&in_master(150), &on_screen(110)), share(&on_screen(190), &in_master(110))]
}

#[test]
fn words_are_where_the_dome_master_has_them_and_a_presenter_that_fails_goes_on() {
    const SIDE: u32 = 500;
    let folder = tempfile::tempdir().unwrap();
    keep_demo_pages(folder.path());
    let at = |name: &str| folder.path().join(name);
    let demo = demo();
    let tour = format!(
        r#"(version: 1, dataset: (path: {demo:?}), keyframes: [
            (at: 0.0, mode: "column-density", error_px: 1.0, caption: "WORDS AMONG THE DIRECTIONS",
             camera: (eye: (25.0, 25.0, 55.0), target: (25.0, 25.0, 25.0)), transfer: (scale: log, range: fixed(20.0, 20000.0))),
            (at: 1.0, hold: true),
        ])"#
    );
    std::fs::write(at("show.tour.ron"), tour).unwrap();
    let rig = format!(
        r#"(version: 1, outputs: [
            (name: "left", window: (760, 0, {SIDE}, {SIDE}), shows: dome(tilt: 30.0, part: (0.0, 0.5, 0.5, 1.0))),
            (name: "right", window: (760, 520, 180, 180), shows: dome(tilt: 30.0, part: (0.5, 0.5, 1.0, 1.0))),
        ])"#
    );
    std::fs::write(at("rig.ron"), rig).unwrap();
    let mut master = program();
    master.arg("tour").arg(at("show.tour.ron")).args(["--frame", "30"]).arg(at("master.png"));
    master.args(["--projection", "dome", "--tilt", "30", "--size", &format!("{0}x{0}", 2 * SIDE)]);
    assert!(master.env("XDG_CACHE_HOME", folder.path()).status().unwrap().success());
    let master = read_png(&at("master.png")).unwrap();

    let stage = Desktop::start();
    let (rig, tour) = (at("rig.ron"), at("show.tour.ron"));
    let show = ["--backend", "cpu", "--outputs", rig.to_str().unwrap(), "--tour", tour.to_str().unwrap()];
    // Beside its outputs, so that it does not cover them when it is opened again.
    let mut leader = Program::open(&stage, folder.path(), &demo, [740, 320], &show);
    let is_there = |status: &Value| status["tour"]["waiting"] == 1 && status["converged"] == true && in_step(status);
    let first = leader.wait("a tour that waits, with two outputs in step", is_there);
    let shown = |what: &str| {
        let begin = Instant::now();
        loop {
            let shares = letters(&stage.screenshot(), [760, 0], &master, [0, SIDE], SIDE);
            if shares.iter().all(|share| *share > 0.8) {
                return;
            }
            assert!(begin.elapsed() < PATIENCE, "{what}: {shares:?} of the letters");
            std::thread::sleep(Duration::from_millis(300));
        }
    };
    keep(&stage, "outputs-words.png");
    shown("the words");

    // The presenter's window fails as hard as it can, a second after what it shows has been kept.
    std::thread::sleep(Duration::from_millis(2500));
    let before = windows(&first);
    assert!(Command::new("kill").args(["-9", &before[0].to_string()]).status().unwrap().success());
    let back = leader.wait("a presenter's window that goes on", |status| {
        status["process"].as_u64().is_some_and(|process| process != before[0]) && is_there(status)
    });
    assert_eq!(windows(&back)[1..], before[1..], "the audience's windows stay");
    for name in ["eye", "target", "settings"] {
        assert_eq!(back[name], first[name], "{name}");
    }
    assert_eq!(back["tour"]["time"], first["tour"]["time"]);
    assert!(back["messages"].to_string().contains("this window has failed"), "{:#}", back["messages"]);
    shown("the words after the presenter's window was opened again");

    // All end with the process that keeps them open.
    let windows = windows(&back);
    drop(leader);
    wait_for_the_end(&windows);
}

/// Whether a process is there and has not ended.
fn is_running(process: u64) -> bool {
    let status = std::fs::read_to_string(Path::new("/proc").join(process.to_string()).join("stat"));
    status.is_ok_and(|text| !text.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('Z')))
}
