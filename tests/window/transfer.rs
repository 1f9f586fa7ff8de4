//! The transfer-function editor and the annotations, driven as a user would under a virtual X server.

use super::desktop::{Desktop, Program, keep, repeat};
use serde_json::Value;

/// High enough for the plots.
const SIZE: [u16; 2] = [960, 720];

/// Where a place of a plot is on the screen.
fn place(program: &Program, desktop: &Desktop, plot: &str, [x, y]: [f64; 2]) -> [i16; 2] {
    program.reveal(desktop, plot);
    let status = program.status();
    let side = |i: usize| status["controls"][plot][i].as_f64().unwrap();
    [(side(0) + x * (side(2) - side(0))) as i16, (side(3) - y * (side(3) - side(1))) as i16]
}

fn points(status: &Value, curve: &str) -> usize {
    status["settings"]["transfer"][curve].as_array().map_or(0, Vec::len)
}

fn double_click(desktop: &Desktop, at: [i16; 2]) {
    desktop.click(at);
    desktop.click(at);
}

fn regions(status: &Value) -> usize {
    status["settings"]["transfer"]["plane"]["regions"].as_array().map_or(0, Vec::len)
}

#[test]
fn curves_and_regions_are_edited_with_the_mouse() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let arguments = ["--backend", "cpu", "--mode", "density-squared"];
    let mut program = Program::with_size(&desktop, folder.path(), SIZE, &arguments);
    program.wait("a converged picture", |status| status["converged"] == true);
    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    // Room for the plots: the sections around them are closed.
    for section in ["section:data", "section:mode"] {
        let before = program.status()["settings"]["closed"].clone();
        repeat(
            &program,
            section,
            || desktop.click(program.reveal(&desktop, section)),
            |status| status["settings"]["closed"] != before,
        );
    }
    let curve = "plot:brightness";
    let add = || double_click(&desktop, place(&program, &desktop, curve, [0.5, 0.8]));
    let added = repeat(&program, "a point is added", add, |status| points(status, "brightness") >= 3);
    let point = |status: &Value| status["settings"]["transfer"]["brightness"][1].clone();
    assert!((point(&added)[0].as_f64().unwrap() - 0.5).abs() < 0.03, "{added:#}");
    let drag = || {
        let [from, to] = [[0.5, 0.8], [0.6, 0.3]].map(|at| place(&program, &desktop, curve, at));
        desktop.drag(from, to);
    };
    repeat(&program, "it is dragged", drag, |status| point(status)[1].as_f64().is_some_and(|value| value < 0.5));
    keep(&desktop, "transfer-curve.png");
    let remove = || {
        let at = program.status()["settings"]["transfer"]["brightness"][1].clone();
        if let (Some(x), Some(y)) = (at[0].as_f64(), at[1].as_f64()) {
            let at = place(&program, &desktop, curve, [x, y]);
            desktop.fake_input(6, 0, at);
            desktop.fake_input(4, 3, [0; 2]);
            desktop.fake_input(5, 3, [0; 2]);
        }
    };
    repeat(&program, "it is removed", remove, |status| points(status, "brightness") == 2);

    // Regions over the joint histogram.
    let show = || desktop.click(program.reveal(&desktop, "tab:regions"));
    repeat(&program, "the regions", show, |status| status["controls"]["plot:plane"].is_array());
    let add = || double_click(&desktop, place(&program, &desktop, "plot:plane", [0.5, 0.5]));
    repeat(&program, "a region is added", add, |status| regions(status) == 1);
    let widen = || {
        let [from, to] = [[0.65, 0.5], [0.8, 0.5]].map(|at| place(&program, &desktop, "plot:plane", at));
        desktop.drag(from, to);
    };
    let wide = |status: &Value| {
        status["settings"]["transfer"]["plane"]["regions"][0]["radius"][0].as_f64().is_some_and(|width| width > 0.2)
    };
    repeat(&program, "it is widened", widen, wide);
    keep(&desktop, "transfer-regions.png");

    // What is written into the picture.
    let axes = || desktop.click(program.reveal(&desktop, "axes"));
    repeat(&program, "the axes", axes, |status| status["settings"]["annotations"]["axes"] == true);
    keep(&desktop, "annotations.png");
    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
}
