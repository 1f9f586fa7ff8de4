//! Pictures that the adapter draws in the frame: nothing of them is decoded by the processor, and volumes converge while one flies.

use super::desktop::{Desktop, PATIENCE, Program, Screen, columns, middle};
use crate::support::demo;
use serde_json::Value;
use std::time::{Duration, Instant};

/// Opens the demo data in a mode, turns the view, and sees it converge again. What the adapter says of the passes is handed to `check`.
fn turn(mode: &str, check: fn(&Value)) {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::start();
    let arguments = ["--mode", mode, "--backend", "compute"];
    let mut program = Program::open_with(&desktop, folder.path(), &demo(), [640, 240], &arguments, &[]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let is_lit = |screen: &Screen| screen.share(columns(&first), |[r, g, b]| r.max(g).max(b) > 40) > 0.05;
    desktop.wait("the picture", is_lit);
    let [x, y] = middle(&first);
    let start = Instant::now();
    while program.status()["eye"] == first["eye"] {
        assert!(start.elapsed() < PATIENCE, "the camera does not turn");
        desktop.drag([x, y], [x + 60, y + 20]);
        std::thread::sleep(Duration::from_secs(1));
    }
    let last = program.wait("the picture converges", |status| status["converged"] == true);
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
    turn("volume", |status| {
        let slabs = status["slabs"].as_array().unwrap();
        assert!(slabs[0] == slabs[1] && slabs[1].as_u64() > Some(0), "{status:#}");
        assert!(status["passes"]["resample"].is_number() && status["passes"]["cast"].is_number(), "{status:#}");
        assert!(status["ranges"][1] == true, "{status:#}");
    });
}

#[test]
fn splats_are_measured_by_the_adapter() {
    turn("column-density", |status| {
        assert!(status["slabs"].is_null() && status["passes"]["accumulate"].is_number(), "{status:#}");
        assert!(status["ranges"][1] == true, "{status:#}");
    });
}
