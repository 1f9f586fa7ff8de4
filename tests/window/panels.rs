//! The window's panels, driven as a user would under a virtual X server: settings are dragged, typed and switched, undone and
//! redone, sections and docks are hidden, and a scene is saved, opened again and rendered without a window.

use super::desktop::{Desktop, Program, click, keep, repeat};
use crate::support::demo;
use serde_json::Value;
use std::time::Duration;

const TAB: u32 = 0xff09;
const RETURN: u32 = 0xff0d;
const CONTROL: u32 = 0xffe3;
const SHIFT: u32 = 0xffe1;
const F2: u32 = 0xffbf;
const F3: u32 = 0xffc0;
/// Wide enough for both docks.
const SIZE: [u16; 2] = [960, 540];

/// Chooses an entry of a combo box.
fn choose(program: &Program, desktop: &Desktop, combo: &str, entry: &str, seen: impl Fn(&Value) -> bool) -> Value {
    super::desktop::choose(program, desktop, combo, &format!("{combo}:{entry}"), seen)
}

/// Clicks a number and types another.
fn type_number(program: &Program, desktop: &Desktop, field: &str, number: &str, seen: impl Fn(&Value) -> bool) {
    let enter = || {
        desktop.click(program.reveal(desktop, field));
        std::thread::sleep(Duration::from_millis(400));
        desktop.press_with(&[CONTROL], u32::from('a'));
        desktop.type_text(number);
        desktop.press(RETURN);
    };
    repeat(program, field, enter, seen);
}

fn undo(program: &Program, desktop: &Desktop, seen: impl Fn(&Value) -> bool) -> Value {
    repeat(program, "undo", || desktop.press_with(&[CONTROL], u32::from('z')), seen)
}

fn near(value: &Value, expected: f64) -> bool {
    value.as_f64().is_some_and(|value| (value - expected).abs() < 1e-9)
}

#[test]
fn settings_are_dragged_typed_switched_undone_and_redone() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let mut program = Program::with_size(&desktop, folder.path(), SIZE, &["--backend", "cpu"]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    keep(&desktop, "panels.png");
    assert_eq!(first["history"], serde_json::json!([0, 0]));
    assert!(first["picture"][2].as_f64().unwrap() < f64::from(SIZE[0]), "the right dock takes its part: {first:#}");

    // A drag on a slider is one step.
    let settings = |status: &Value| status["settings"].clone();
    let drag = || {
        let [x, y] = program.reveal(&desktop, "error-bound:slider");
        desktop.drag([x, y], [x + 20, y]);
    };
    let dragged = repeat(&program, "a drag on the slider", drag, |status| {
        !near(&status["settings"]["error_px"], 0.8) && status["history"][0].as_u64() == Some(1)
    });
    undo(&program, &desktop, |status| near(&status["settings"]["error_px"], 0.8));
    repeat(
        &program,
        "redo",
        || desktop.press_with(&[CONTROL], u32::from('y')),
        |status| status["settings"] == settings(&dragged),
    );

    // A number is typed; the mark puts it back.
    type_number(&program, &desktop, "field-of-view:field", "30.5", |status| near(&status["settings"]["fov"], 30.5));
    click(&program, &desktop, "field-of-view:reset", |status| near(&status["settings"]["fov"], 45.0));

    // Projection, clip box, slice and fade are switched on; particles beyond are not drawn and not read.
    choose(&program, &desktop, "projection", "orthographic", |status| status["settings"]["parallel"] == true);
    click(&program, &desktop, "slice", |status| status["settings"]["cut"]["slab"].is_object());
    let slice = program.wait("the slice converges", |status| {
        status["converged"] == true && status["particles_drawn"].as_u64() < first["particles_drawn"].as_u64()
    });
    keep(&desktop, "slice.png");
    assert_eq!(slice["settings"]["cut"]["slab"]["axis"], "z");
    click(&program, &desktop, "slice", |status| status["settings"]["cut"]["slab"].is_null());
    click(&program, &desktop, "clip-box", |status| status["settings"]["cut"]["clip"].is_object());
    type_number(&program, &desktop, "clip-x-max", "2.5e4", |status| {
        near(&status["settings"]["cut"]["clip"]["max"][0], 25_000.0)
    });
    click(&program, &desktop, "depth-fade", |status| status["settings"]["cut"]["fade"].is_object());

    // Another mode brings its own settings, which are undone with it.
    let before = program.wait("it rests", |status| status["converged"] == true);
    choose(&program, &desktop, "mode", "density-squared", |status| status["mode"] == "density-squared");
    program.wait("it rests", |status| status["converged"] == true);
    undo(&program, &desktop, |status| status["settings"] == settings(&before));

    // Everything is undone to the start, button by button, and redone to the end.
    let steps = before["history"][0].as_u64().unwrap();
    assert!(steps >= 7, "{before:#}");
    for left in (0..steps).rev() {
        click(&program, &desktop, "undo", |status| status["history"][0].as_u64() == Some(left));
    }
    let start = program.wait("the start", |status| status["converged"] == true);
    assert_eq!(settings(&start), settings(&first), "all undone is the start");
    let redo = || desktop.press_with(&[CONTROL, SHIFT], u32::from('z'));
    repeat(&program, "redo", redo, |status| status["settings"] == settings(&before));

    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));
}

#[test]
fn docks_and_sections_are_hidden_and_a_scene_brings_everything_back() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("box.hdf5");
    std::fs::copy(demo(), &data).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let mut program = Program::open(&desktop, folder.path(), &data, SIZE, &["--backend", "cpu"]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let window = desktop.window().expect("a window of the size that was asked for");
    desktop.focus(window);
    let [width, height] = SIZE.map(f64::from);
    let side = |status: &Value, i: usize| status["picture"][i].as_f64().unwrap();
    desktop.press(TAB);
    program.wait("Tab hides both", |status| side(status, 0) == 0.0 && side(status, 2) == width);
    desktop.press(F3);
    program.wait("F3 shows the right one", |status| side(status, 0) == 0.0 && side(status, 2) < width);
    desktop.press(F2);
    program.wait("F2 shows the left one", |status| status["picture"] == first["picture"]);
    click(&program, &desktop, "section:data", |status| status["settings"]["closed"] == serde_json::json!(["data"]));
    click(&program, &desktop, "section:statistics", |status| {
        status["settings"]["closed"] == serde_json::json!(["data", "statistics"])
    });
    keep(&desktop, "closed.png");

    // A picture of one's own: another mode, projection, field of view and place.
    choose(&program, &desktop, "mode", "density-squared", |status| status["mode"] == "density-squared");
    type_number(&program, &desktop, "field-of-view:field", "37.25", |status| near(&status["settings"]["fov"], 37.25));
    click(&program, &desktop, "slice", |status| status["settings"]["cut"]["slab"].is_object());
    let middle = [(side(&first, 0) + side(&first, 2)) as i16 / 2, height as i16 / 2];
    let turn = || desktop.drag(middle, [middle[0] + 120, middle[1] - 30]);
    repeat(&program, "a drag turns", turn, |status| status["eye"] != first["eye"]);
    program.wait("it rests", |status| status["converged"] == true);
    let saved = repeat(
        &program,
        "Ctrl+S saves",
        || desktop.press_with(&[CONTROL], u32::from('s')),
        |status| status["scene"].is_string(),
    );
    let scene = folder.path().join("box.scene.ron");
    assert!(saved["messages"].to_string().contains("scene saved in"), "{saved:#}");
    let text = std::fs::read_to_string(&scene).unwrap();
    assert!(text.contains("path: \"box.hdf5\""), "relative to the scene: {text}");
    // What is told of it fades away.
    std::thread::sleep(Duration::from_millis(4500));
    let before = desktop.screenshot();
    desktop.close(window);
    assert_eq!(program.exit_code(), Some(0));

    // The scene moves with its data, and a window shows what it showed.
    let moved = folder.path().join("moved");
    std::fs::create_dir(&moved).unwrap();
    let scene = moved.join("renamed.scene.ron");
    std::fs::rename(folder.path().join("box.scene.ron"), &scene).unwrap();
    std::fs::rename(&data, moved.join("box.hdf5")).unwrap();
    let mut program = Program::open(&desktop, folder.path(), &scene, SIZE, &["--backend", "cpu"]);
    let again = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(again["settings"], saved["settings"]);
    assert_eq!(again["picture"], saved["picture"]);
    assert_eq!((&again["eye"], &again["target"]), (&saved["eye"], &saved["target"]), "to the last bit");
    let (left, right) = (side(&saved, 0) as usize, side(&saved, 2) as usize);
    desktop.wait("the same picture", |screen| screen.difference(&before, left..right) < 0.03);

    // Without a window: twice the same picture, and the window's, which has a legend over it.
    let render = |name: &str| {
        let output = folder.path().join(name);
        let status = crate::support::program()
            .args(["render", "--backend", "cpu"])
            .arg(&scene)
            .arg("-o")
            .arg(&output)
            .env("XDG_CACHE_HOME", folder.path())
            .status()
            .unwrap();
        assert!(status.success());
        std::fs::read(output).unwrap()
    };
    let picture = render("a.png");
    assert_eq!(picture, render("b.png"), "a scene gives the same picture each time");
    let mut reader = png::Decoder::new(std::io::Cursor::new(&picture)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!([info.width as usize, info.height as usize], [right - left, height as usize]);
    let channels = info.color_type.samples();
    let differ = |x: usize, y: usize| {
        let at = channels * (y * (right - left) + x);
        before.at(left + x, y).iter().zip(&pixels[at..at + 3]).any(|(a, b)| a.abs_diff(*b) > 12)
    };
    // The upper left quarter, where nothing lies over the picture.
    let quarter: Vec<(usize, usize)> =
        (120..height as usize / 2).flat_map(|y| (0..(right - left) / 2).map(move |x| (x, y))).collect();
    let share = quarter.iter().filter(|(x, y)| differ(*x, *y)).count() as f64 / quarter.len() as f64;
    assert!(share < 0.02, "{share} of the pixels differ from the window's");

    desktop.close(desktop.window().unwrap());
    assert_eq!(program.exit_code(), Some(0));
}

#[test]
fn a_scene_whose_data_has_changed_opens_with_what_applies() {
    let folder = tempfile::tempdir().unwrap();
    let demo = demo();
    let scene = folder.path().join("odd.scene.ron");
    let text = format!(
        "(version: 1, datasets: [(path: {:?}, fingerprint: (bytes: 7, crc32c: 1), families: [dark, stars])],
          mode: \"density-squared\", attribute: named(\"beauty\"), panels: (closed: [\"data\"]))",
        demo.canonicalize().unwrap()
    );
    std::fs::write(&scene, text).unwrap();
    // As many rows, but only as many columns as the left dock and a narrow picture take: text is as large, and less is drawn.
    let size = [1280, 2160];
    let desktop = Desktop::with_screen(size);
    let mut program = Program::open(&desktop, folder.path(), &scene, size, &["--backend", "cpu"]);
    let status = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(status["mode"], "density-squared");
    let messages = status["messages"].to_string();
    for part in ["it has", "no attribute beauty", "no particles of family stars"] {
        assert!(messages.contains(part), "{messages}");
    }
    // At twice the rows of a usual screen text is twice as large.
    let [left, top, _, bottom] = [0, 1, 2, 3].map(|i| status["controls"]["error-bound"][i].as_f64().unwrap());
    assert!(left > 100.0 && (30.0..42.0).contains(&(bottom - top)), "{status:#}");
    keep(&desktop, "panels-2160-rows.png");
    desktop.close(desktop.window().unwrap());
    assert_eq!(program.exit_code(), Some(0));
}

#[test]
fn several_datasets_are_shown_hidden_saved_and_closed() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("box.hdf5");
    std::fs::copy(demo(), &data).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let with = format!("{}@60,0,0", data.display());
    let arguments = ["--backend", "cpu", "--with", &with];
    let mut program = Program::open(&desktop, folder.path(), &data, SIZE, &arguments);
    let both = program.wait("a converged picture", |status| status["converged"] == true);
    desktop.focus(desktop.window().unwrap());
    assert_eq!(both["settings"]["families"], serde_json::json!([true, true]), "{both:#}");
    let drawn = both["particles_drawn"].as_f64().unwrap();
    keep(&desktop, "datasets.png");

    // The second one's particles are hidden by themselves.
    let hidden = click(&program, &desktop, "family:dark:2", |s| s["settings"]["families"][1] == false);
    assert_eq!(hidden["settings"]["families"][0], true);
    let fewer = program.wait("fewer particles", |s| s["particles_drawn"].as_f64().is_some_and(|n| n < 0.8 * drawn));

    // A scene brings both back as they are.
    let press = || desktop.press_with(&[CONTROL], u32::from('s'));
    let saved = repeat(&program, "saved", press, |s| s["scene"].is_string());
    let text = std::fs::read_to_string(saved["scene"].as_str().unwrap()).unwrap();
    assert!(text.contains("offset: (60.0, 0.0, 0.0)") || text.contains("offset: [60.0, 0.0, 0.0]"), "{text}");
    let picture = folder.path().join("same.png");
    let statistics = folder.path().join("same.json");
    let rendered = crate::support::program()
        .args(["render", saved["scene"].as_str().unwrap(), "--backend", "cpu", "--json"])
        .arg(&statistics)
        .arg("-o")
        .arg(&picture)
        .env("XDG_CACHE_HOME", folder.path())
        .output()
        .unwrap();
    assert!(rendered.status.success(), "{}", String::from_utf8_lossy(&rendered.stderr));
    let rendered: Value = serde_json::from_str(&std::fs::read_to_string(&statistics).unwrap()).unwrap();
    assert_eq!(rendered["particles_drawn"], fewer["particles_drawn"]);

    // The first is closed; the second stays where it is.
    click(&program, &desktop, "dataset:0:remove", |s| s["settings"]["families"].as_array().map(Vec::len) == Some(1));
    let one = program.wait("the other alone", |s| s["converged"] == true && s["target"][0].as_f64() > Some(60.0));
    assert!(one["controls"]["dataset:0:remove"].is_null(), "nothing else can be closed");
}
