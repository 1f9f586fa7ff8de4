//! Tours in the window, driven as a presenter would under a virtual X server: one plays, waits, is led on and left; views become
//! keyframes that are dragged along the timeline, and the tour is saved and its timetable printed.

use super::desktop::{Desktop, Program, click, distance, keep, point, repeat};
use crate::support::demo;
use serde_json::Value;

const SPACE: u32 = 0x20;
const RIGHT: u32 = 0xff53;
/// Wide enough for both docks.
const SIZE: [u16; 2] = [960, 720];

fn stops(status: &Value) -> Vec<f64> {
    status["tour"]["stops"].as_array().map_or_else(Vec::new, |stops| stops.iter().filter_map(Value::as_f64).collect())
}

#[test]
fn a_tour_is_played_left_edited_and_saved() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("box.hdf5");
    std::fs::copy(demo(), &data).unwrap();
    let tour = folder.path().join("show.tour.ron");
    let camera = |z: f64| format!("camera: (eye: (25.0, 32.0, {z:?}), target: (25.0, 25.0, 25.0))");
    let text = format!(
        "(version: 1, title: \"A show\", dataset: (path: \"box.hdf5\"), keyframes: [
            (at: 0.0, {}, caption: \"A box of dark matter\"),
            (at: 1.0, {}, hold: true, label: \"closer\"),
            (at: 3.0, {}, mode: \"density-squared\"),
        ])",
        camera(130.0),
        camera(100.0),
        camera(80.0)
    );
    std::fs::write(&tour, text).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let arguments = ["--backend", "cpu", "--tour", tour.to_str().unwrap()];
    let mut program = Program::open(&desktop, folder.path(), &data, SIZE, &arguments);
    let waiting = program.wait("the presenter's stop", |s| s["tour"]["waiting"] == 1);
    desktop.focus(desktop.window().unwrap());
    assert!(distance(point(&waiting, "eye"), [25.0, 32.0, 100.0]) < 1e-9, "{waiting:#}");
    keep(&desktop, "tour.png");

    // The presenter goes on, and it ends where it is to end, in another mode.
    let on = repeat(&program, "on", || desktop.press(RIGHT), |s| s["tour"]["waiting"].is_null());
    assert!(on["tour"]["time"].is_number());
    let over = program.wait("the end", |s| s["tour"]["time"] == 3.0 && s["tour"]["running"] == false);
    assert!(distance(point(&over, "eye"), [25.0, 32.0, 80.0]) < 1e-9);
    assert_eq!(over["settings"]["mode"], "density-squared");

    // A drag in the picture leaves it; Space comes back, from the beginning.
    let middle = super::desktop::middle(&over);
    let turn = || desktop.drag(middle, [middle[0] + 90, middle[1] + 20]);
    let away = repeat(&program, "away", turn, |s| s["tour"].is_object() && s["tour"]["time"].is_null());
    assert!(stops(&away).len() == 3);

    // What is seen now becomes a keyframe after the end.
    let kept = click(&program, &desktop, "tour:keep", |s| stops(s).len() == 4);
    assert!(stops(&kept)[3] > 3.0, "{kept:#}");
    // It is dragged along the timeline, to the left.
    let mark = program.reveal(&desktop, "tour:3");
    let drag = || desktop.drag(program.control("tour:3").unwrap_or(mark), [mark[0] - 40, mark[1]]);
    let moved = repeat(&program, "a keyframe", drag, |s| stops(s).get(3).is_some_and(|&at| at < stops(&kept)[3] - 0.4));
    assert!(stops(&moved)[3] > 3.0 && stops(&moved)[..3] == [0.0, 1.0, 3.0]);
    keep(&desktop, "tour-edit.png");
    let count = |n: usize| move |s: &Value| stops(s).len() == n;
    click(&program, &desktop, "tour:copy", count(5));
    click(&program, &desktop, "tour:remove", count(4));
    let saved = click(&program, &desktop, "tour:save", |s| s["messages"].to_string().contains("tour saved"));
    assert_eq!(saved["tour"]["path"], tour.to_str().unwrap());

    // It plays from a key again, and the command line reads it.
    repeat(&program, "played", || desktop.press(SPACE), |s| s["tour"]["time"].is_number());
    let check = crate::support::program()
        .args(["tour", tour.to_str().unwrap(), "--check"])
        .env("XDG_CACHE_HOME", folder.path())
        .output()
        .unwrap();
    let table = String::from_utf8_lossy(&check.stdout).into_owned();
    assert!(check.status.success() && table.contains("closer"), "{table}{}", String::from_utf8_lossy(&check.stderr));
}
