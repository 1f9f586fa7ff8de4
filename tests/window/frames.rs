//! Pictures that the adapter draws in the frame: nothing of them is decoded by the processor, and volumes converge while one flies.

use super::desktop::{Desktop, Program, Screen, columns, middle};
use crate::support::demo;
use serde_json::Value;
use std::time::{Duration, Instant};

/// Of a window without panels: an adapter in software draws it.
const SIZE: [u16; 2] = [224, 160];

/// Opens the demo data in a mode, with whatever more a scene says of it, turns the view, and sees it converge again, by these passes. What the
/// adapter says of it is handed to `check`.
fn turn(mode: &str, more: &str, passes: &[&str], check: fn(&Value)) {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let scene = folder.path().join("turn.scene.ron");
    let panels = "panels: (shown: false, closed: [])";
    let text = format!(r#"(version: 1, datasets: [(path: {:?})], mode: "{mode}", {panels}{more})"#, demo());
    std::fs::write(&scene, text).unwrap();
    let mut program = Program::open(&desktop, folder.path(), &scene, SIZE, &["--backend", "compute"]);
    // Times come some frames late.
    let is_drawn =
        |status: &Value| status["converged"] == true && passes.iter().all(|pass| status["passes"][pass].is_number());
    let first = program.wait("a converged picture", is_drawn);
    let is_lit = |screen: &Screen| screen.share(columns(&first), |[r, g, b]| r.max(g).max(b) > 40) > 0.15;
    desktop.wait("the picture", is_lit);
    let [x, y] = middle(&first);
    super::desktop::turn(&program, &desktop, &first, [x, y], [x + 60, y + 20]);
    let last = program.wait("the picture converges", is_drawn);
    desktop.wait("the picture from elsewhere", is_lit);
    for status in [&first, &last] {
        assert_eq!(status["backend"], "compute", "{status:#}");
        assert_eq!(status["decoded"], 0, "the processor decodes nothing for a picture: {status:#}");
        check(status);
    }
    assert_ne!(first["eye"], last["eye"]);
}

#[test]
fn volumes_converge_in_the_frame() {
    turn("volume", "", &["resample", "cast"], |status| {
        let slabs = status["slabs"].as_array().unwrap();
        assert!(slabs[0] == slabs[1] && slabs[1].as_u64() > Some(0), "{status:#}");
        assert!(status["ranges"][1] == true, "{status:#}");
    });
}

#[test]
fn cartesian_grids_converge_in_the_frame() {
    // A grid that is held is not resampled for the last picture. Of few cells, since an adapter in software fills them.
    turn("cartesian", r#", settings: {"cells": 96}"#, &["cast"], |status| {
        let slabs = status["slabs"].as_array().unwrap();
        assert!(slabs[0] == slabs[1] && slabs[1].as_u64() > Some(0), "{status:#}");
        assert!(status["ranges"][1] == true, "{status:#}");
    });
}

#[test]
fn splats_are_measured_by_the_adapter() {
    turn("column-density", "", &["accumulate"], |status| {
        assert!(status["slabs"].is_null() && status["ranges"][1] == true, "{status:#}");
    });
}

#[test]
fn layers_converge_in_the_frame() {
    // Few, since an adapter in software draws them.
    let more = r#", settings: {"layers": 24}, error_px: 2.0"#;
    turn("layered", more, &["layers"], |status| {
        assert!(status["slabs"].is_null() && status["ranges"][1] == true, "{status:#}");
    });
}

#[test]
fn sorted_splats_converge_in_the_frame() {
    turn("sorted-splats", ", error_px: 2.0", &["list", "blend"], |status| {
        assert!(status["slabs"].is_null(), "{status:#}");
    });
}

#[test]
fn spheres_converge_in_the_frame() {
    turn("spheres", "", &["list", "nearest", "surface"], |status| assert!(status["slabs"].is_null(), "{status:#}"));
}

#[test]
fn frames_are_few_while_nothing_moves() {
    let folder = tempfile::tempdir().unwrap();
    let size = [640, 360];
    let desktop = Desktop::with_screen(size);
    let mut program = Program::with_size(&desktop, folder.path(), size, &["--backend", "cpu"]);
    let status = program.wait("a converged picture", |status| status["converged"] == true);
    let frames = |secs: u64, stir: &dyn Fn()| {
        let start = (Instant::now(), program.status()["frames"].as_u64().unwrap());
        while start.0.elapsed() < Duration::from_secs(secs) {
            stir();
        }
        (program.status()["frames"].as_u64().unwrap() - start.1) as f64 / start.0.elapsed().as_secs_f64()
    };
    let [x, y] = middle(&status);
    let touched = frames(3, &|| {
        desktop.fake_input(6, 0, [x, y]);
        desktop.fake_input(6, 0, [x + 4, y]);
    });
    std::thread::sleep(Duration::from_secs(2));
    let at_rest = frames(3, &|| std::thread::sleep(Duration::from_millis(100)));
    assert!((2.0..0.6 * touched).contains(&at_rest), "{at_rest} frames a second at rest, {touched} under the mouse");
    let before = program.status()["eye"].clone();
    desktop.drag([x, y], [x + 60, y + 20]);
    program.wait("the camera turns after a rest", |status| status["eye"] != before);
}
