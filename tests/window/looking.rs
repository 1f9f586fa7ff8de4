//! Looking closer in the window, driven as a user would under a virtual X server: a particle is inspected, a distance measured, a
//! sphere drawn and summed up, kept as a selection, shown alone, written to a table, plotted and undone; a view is kept on a key.

use super::desktop::{Desktop, Program, click, distance, keep, point, repeat, repeat_flight};
use crate::support::demo;
use serde_json::Value;
use std::time::Duration;

const CONTROL: u32 = 0xffe3;
/// Wide enough for both docks.
const SIZE: [u16; 2] = [960, 600];

fn triple(value: &Value) -> [f64; 3] {
    [0, 1, 2].map(|k| value[k].as_f64().unwrap())
}

#[test]
fn particles_are_inspected_measured_summed_up_selected_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SIZE);
    // Tables are written beside the data.
    let data = folder.path().join("box.hdf5");
    std::fs::copy(demo(), &data).unwrap();
    let mut program = Program::open(&desktop, folder.path(), &data, SIZE, &["--backend", "cpu"]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    let at = |key: usize| first["picture"][key].as_f64().unwrap();
    let middle = [((at(0) + at(2)) / 2.0) as i16, ((at(1) + at(3)) / 2.0) as i16];
    let beside = [middle[0] + 50, middle[1] - 34];

    // A click says what is there: inside the box, with values of the data.
    let inspected = repeat(&program, "a particle", || desktop.click(middle), |s| s["looking"]["inspected"].is_object());
    let particle = &inspected["looking"]["inspected"];
    assert!(triple(&particle["position"]).iter().all(|x| (0.0..=50.0).contains(x)), "{particle:#}");
    assert!(particle["values"]["velocity-dispersion"].as_f64().unwrap() > 0.0, "{particle:#}");
    keep(&desktop, "inspect.png");

    // Two clicks measure.
    click(&program, &desktop, "tool:Measure", |s| s["looking"]["tool"] == "Measure");
    desktop.click(middle);
    std::thread::sleep(Duration::from_millis(800));
    let measured = repeat(&program, "a distance", || desktop.click(beside), |s| s["looking"]["distance"].is_number());
    assert!(measured["looking"]["distance"].as_f64().unwrap() < 90.0);

    // A drag draws a sphere, and the camera stays; what is inside is what a brute-force sum over the source says.
    click(&program, &desktop, "tool:Sphere", |s| s["looking"]["tool"] == "Sphere");
    let before = point(&program.status(), "eye");
    let draw = || desktop.drag(middle, [middle[0] + 34, middle[1]]);
    let probed = repeat(&program, "a probe", draw, |s| s["looking"]["probe"].is_object());
    assert!(distance(before, point(&program.status(), "eye")) < 1e-9, "the camera moved");
    let probe = probed["looking"]["probe"].clone();
    let (center, radius) = (triple(&probe["sphere"][0]), probe["sphere"][1].as_f64().unwrap());
    let exact = click(&program, &desktop, "exact", |s| s["looking"]["probe"]["exact"] == true);
    let dataset = deepfield::import::load(&data, &deepfield::import::LoadOptions::default(), &()).unwrap();
    let inside = dataset.families[0].positions.iter().filter(|position| {
        let apart = [0, 1, 2].map(|k| {
            let offset = position[k] - center[k];
            offset - 50.0 * (offset / 50.0).round()
        });
        apart.iter().map(|x| x * x).sum::<f64>().sqrt() <= radius
    });
    let expected = inside.count() as f64;
    assert_eq!(exact["looking"]["probe"]["count"].as_f64(), Some(expected), "{exact:#}");
    let pages = probe["count"].as_f64().unwrap();
    assert!((pages - expected).abs() <= 2.0 + 1e-3 * expected, "{pages} for {expected}");
    keep(&desktop, "probe.png");

    // It is kept, shown alone, and written to a table beside the data.
    let selections = |s: &Value| s["settings"]["selections"].as_array().map_or(0, Vec::len);
    click(&program, &desktop, "keep", |s| selections(s) == 1);
    let written = click(&program, &desktop, "selection:0:CSV", |s| s["looking"]["table"].is_object());
    let table = &written["looking"]["table"];
    assert_eq!(table["rows"].as_f64(), Some(expected), "{table:#}");
    let text = std::fs::read_to_string(table["path"].as_str().unwrap()).unwrap();
    assert_eq!(text.lines().count() as f64, expected + 1.0);
    assert!(text.starts_with("family,x [a Mpc/h],"), "{}", text.lines().next().unwrap());

    // What is plotted is the region.
    let plotted = program.wait("a plot", |s| s["looking"]["plot"].is_object());
    assert_eq!(plotted["looking"]["plot"]["particles"].as_f64(), Some(pages));
    keep(&desktop, "selection.png");

    // A selection by values, undone and redone like any setting.
    let from = program.reveal(&desktop, "range:from");
    desktop.click(from);
    std::thread::sleep(Duration::from_millis(400));
    desktop.type_text("1");
    click(&program, &desktop, "range:add", |s| selections(s) == 2);
    std::thread::sleep(Duration::from_millis(600));
    repeat(&program, "undo", || desktop.press_with(&[CONTROL], u32::from('z')), |s| selections(s) == 1);
    repeat(&program, "redo", || desktop.press_with(&[CONTROL], u32::from('y')), |s| selections(s) == 2);

    // A view is kept on a key and flown back to.
    click(&program, &desktop, "tool:Inspect", |s| s["looking"]["tool"] == "Inspect");
    let kept = click(&program, &desktop, "bookmark:keep", |s| s["looking"]["bookmarks"][0][0] == 1);
    let eye = triple(&kept["looking"]["bookmarks"][0][1]);
    let turn = || desktop.drag(middle, [middle[0] + 120, middle[1] + 30]);
    repeat(&program, "another view", turn, |s| distance(point(s, "eye"), eye) > 1.0);
    let back = || desktop.click(program.reveal(&desktop, "bookmark:1:fly"));
    repeat_flight(&program, "the view again", back, |s| distance(point(s, "eye"), eye) < 1e-6);
}
