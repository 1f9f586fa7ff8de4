//! A tour in the window shows what a recording has: the same ranges, and within a cross-fade the same picture.

use super::desktop::{Desktop, PATIENCE, Program, Screen, keep, repeat};
use crate::support::{demo, program};
use deepfield::annotate::overlay::read_png;
use deepfield::color::Image;
use deepfield::look::SceneFile;
use serde_json::Value;
use std::path::Path;
use std::time::Instant;

const SPACE: u32 = 0x20;
const LEFT: u32 = 0xff51;
const TAB: u32 = 0xff09;
const SIZE: [u16; 2] = [640, 360];

/// A cut with a long blend from 1 s on, from one mode to another.
fn tour_file() -> String {
    let data = demo();
    format!(
        r#"(version: 1, size: (640, 360), dataset: (path: {data:?}), keyframes: [
            (at: 0.0, mode: "density-squared", error_px: 2.0, camera: (eye: (25.0, 32.0, 110.0), target: (25.0, 25.0, 25.0))),
            (at: 1.0, move: cut, label: "blend", fade: 30.0, mode: "column-density", camera: (eye: (80.0, 40.0, 60.0), target: (25.0, 25.0, 25.0))),
            (at: 45.0, camera: (eye: (85.0, 40.0, 50.0), target: (25.0, 25.0, 25.0))),
        ])"#
    )
}

/// Mean of the values of a picture, and their mean difference from those of a screen: below the messages, and left of and above the
/// legend and the scale bar, which the window has unless it is told otherwise.
fn compare(screen: &Screen, picture: &Image) -> [f64; 2] {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let (mut sum, mut difference, mut count) = (0.0, 0.0, 0.0);
    for (x, y) in (height / 4..height * 5 / 6).flat_map(|y| (0..width * 3 / 4).map(move |x| (x, y))) {
        let (found, expected) = (screen.at(x, y), picture.rgba[y * width + x]);
        for k in 0..3 {
            sum += f64::from(expected[k]);
            difference += f64::from(found[k].abs_diff(expected[k]));
            count += 1.0;
        }
    }
    [sum / count, difference / count]
}

fn tour_time(status: &Value) -> Option<f64> {
    status["tour"]["time"].as_f64()
}

/// The frame that a recording has at a time, and the ranges of its colours.
fn recorded(folder: &Path, tour: &Path, time: f64) -> (Image, [[f64; 2]; 2]) {
    let out = folder.join("recorded");
    let _ = std::fs::remove_dir_all(&out);
    // At the window's very time: its frame is 0 of those from there on.
    let (rate, at) = (1e6, (1e6 * time).round() / 1e6);
    let mut command = program();
    command.arg("tour").arg(tour).args(["--fps", &rate.to_string(), "--backend", "cpu"]);
    command.args(["--start", &at.to_string(), "--end", &(at + 0.5 / rate).to_string()]);
    command.args(["--name", "f%d"]).arg("--record").arg(&out).env("XDG_CACHE_HOME", folder);
    assert!(command.status().unwrap().success());
    let name = format!("f{}", (1e6 * time).round() as u64);
    let scene = SceneFile::read(&out.join("scenes").join(format!("{name}.scene.ron"))).unwrap();
    let numbers = scene.look.transfer.unwrap().numbers().unwrap();
    (read_png(&out.join(format!("{name}.png"))).unwrap(), [numbers.p, numbers.s])
}

fn plays_what_is_recorded(backend: &str) {
    let folder = tempfile::tempdir().unwrap();
    let tour = folder.path().join("show.tour.ron");
    std::fs::write(&tour, tour_file()).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let arguments = ["--backend", backend, "--tour", tour.to_str().unwrap()];
    let mut program = Program::with_size(&desktop, folder.path(), SIZE, &arguments);
    program.wait("a tour", |status| tour_time(status).is_some());
    desktop.focus(desktop.window().unwrap());
    repeat(&program, "no panel", || desktop.press(TAB), |status| status["panel"] == false);
    // It is stopped in the middle of the blend.
    program.wait("the blend", |status| tour_time(status).is_some_and(|time| time > 6.0));
    let in_blend = |time: f64| (6.0..28.0).contains(&time);
    let stand = || {
        if program.status()["tour"]["running"] == true {
            desktop.press(SPACE);
            // Pressed twice it would run on; a slow machine takes a while to say that it stands.
            let begin = Instant::now();
            while program.status()["tour"]["running"] == true && begin.elapsed().as_secs() < 15 {
                std::thread::sleep(std::time::Duration::from_millis(200));
            }
        } else {
            desktop.press(LEFT);
            desktop.press(SPACE);
            std::thread::sleep(std::time::Duration::from_secs(9));
        }
    };
    let stands = |status: &Value| status["tour"]["running"] == false && tour_time(status).is_some_and(in_blend);
    repeat(&program, "to stand in the blend", stand, stands);
    let still = program.wait("the whole picture", |status| {
        let exposed = &status["tour"]["exposed"];
        stands(status) && status["converged"] == true && exposed[0] == exposed[1]
    });
    let time = tour_time(&still).unwrap();
    let (picture, ranges) = recorded(folder.path(), &tour, time);
    for (found, expected) in still["ranges"][0].as_array().unwrap().iter().zip(ranges) {
        let found = [0, 1].map(|k| found[k].as_f64().unwrap());
        for k in 0..2 {
            assert!((found[k] - expected[k]).abs() <= 1e-3 * expected[k].abs(), "{time}: {found:?} {expected:?}");
        }
    }
    let begin = Instant::now();
    loop {
        let [mean, difference] = compare(&desktop.screenshot(), &picture);
        if mean > 5.0 && difference < 0.015 * mean {
            println!("{backend}: at {time:.3} s the mean value is {mean:.2}, the mean difference {difference:.3}");
            break;
        }
        assert!(begin.elapsed() < PATIENCE, "{backend} at {time}: mean {mean}, difference {difference}");
        std::thread::sleep(std::time::Duration::from_millis(500));
    }
    let name = format!("blend-{backend}.png");
    keep(&desktop, &name);
    if let Some(folder) = std::env::var_os("DEEPFIELD_SCREENSHOTS") {
        let path = Path::new(&folder).join(format!("recorded-{name}"));
        deepfield::color::output::write_png(&path, &picture).unwrap();
    }
}

#[test]
fn the_processor_blends_splats_as_they_are_recorded() {
    plays_what_is_recorded("cpu");
}

#[test]
fn an_adapter_blends_splats_as_they_are_recorded() {
    plays_what_is_recorded("compute");
}
