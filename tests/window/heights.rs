//! Measured heights in the window: drawn as `deepfield render` draws them, read, measured along and across, and never seen from below.

use super::desktop::{Desktop, Program, Screen, columns, distance, keep, middle, point, repeat};
use serde_json::Value;
use std::path::Path;

const SIZE: [u16; 2] = [640, 400];
/// Of pictures that the same renderer draws into a file: they are the same at any size.
const SMALL: [u16; 2] = [400, 250];
/// Columns and rows.
const SAMPLES: [usize; 2] = [161, 121];
/// Columns and rows where nothing was measured.
const HOLE: [std::ops::Range<usize>; 2] = [100..120, 30..50];

/// The height at a place: a plane, so that it is the same between samples.
fn height(x: f64, y: f64) -> f64 {
    0.25 * x - 0.125 * y + 3.0
}

/// A field of float64 whose heights are those of places.
fn field(path: &Path, [columns, rows]: [usize; 2], height: impl Fn(usize, usize) -> f64) {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let head = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    let head = format!("{head:<117}\n");
    bytes.extend(u16::try_from(head.len()).unwrap().to_le_bytes());
    bytes.extend(head.as_bytes());
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        bytes.extend(height(column, row).to_le_bytes());
    }
    std::fs::write(path, bytes).unwrap();
}

/// A tilted plane with a hole.
fn slope(path: &Path) {
    field(path, SAMPLES, |column, row| {
        let is_open = HOLE[0].contains(&column) && HOLE[1].contains(&row);
        if is_open { f64::NAN } else { height(column as f64, row as f64) }
    });
}

#[test]
fn heights_are_drawn_as_they_are_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    slope(&folder.join("slope.npy"));
    let slopes =
        ", attribute: named(\"slope\"), settings: {\"light\": \"eye\", \"contours\": 4.0, \"exaggeration\": 2.0}";
    let dome = ", projection: dome(aperture: 180.0, tilt: 20.0)";
    let filled = ", settings: {\"holes\": \"filled\"}";
    let rays = ", settings: {\"technique\": \"rays\"}";
    for (number, (more, [asked, draws])) in [
        ("", ["cpu"; 2]),
        // Face by face, as files are.
        (dome, ["compute"; 2]),
        (slopes, ["compute"; 2]),
        (filled, ["raster"; 2]),
        (rays, ["compute"; 2]),
    ]
    .into_iter()
    .enumerate()
    {
        let by = if more == dome { draws } else { "cpu" };
        let size = if by == draws { SMALL } else { SIZE };
        let scene = folder.join("slope.scene.ron");
        let text = format!(
            "(version: 2, datasets: [(path: \"slope.npy\")], mode: \"surface\", size: ({}, {}), \
             camera: (eye: (80.0, -90.0, 120.0), target: (80.0, 60.0, 10.0), up: (0.0, 0.0, 1.0), fov: 40.0), \
             panels: (shown: false, closed: []), annotations: (legend: false, scale_bar: false){more})",
            size[0], size[1]
        );
        std::fs::write(&scene, text).unwrap();
        let expected = super::fields::render(folder, &scene, by, size);
        let desktop = Desktop::with_screen(size);
        let mut program = Program::open(&desktop, folder, &scene, size, &["--backend", asked]);
        let status = program.wait("a converged picture", |status| status["converged"] == true);
        assert_eq!(
            (&status["mode"], &status["levels"], &status["backend"]),
            (&"surface".into(), &"chunks".into(), &draws.into()),
            "{status:#}"
        );
        keep(&desktop, &format!("heights-{number}.png"));
        desktop.wait("the rendered picture", |screen| super::fields::difference(screen, &expected, size) < 0.01);
        let lit = expected.iter().filter(|pixel| pixel.iter().any(|byte| *byte > 60)).count();
        assert!(256 * lit > 3 * expected.len(), "{more}");
    }
}

#[test]
fn heights_are_read_and_measured_with_the_mouse() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let path = folder.join("slope.npy");
    slope(&path);
    let desktop = Desktop::with_screen([1280, 720]);
    let mut program = Program::open(&desktop, folder, &path, [1280, 720], &[]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!((&first["mode"], &first["levels"]), (&"surface".into(), &"chunks".into()), "{first:#}");
    // It is seen from above and in front, with z up.
    let [eye, target] = ["eye", "target"].map(|name| point(&first, name));
    assert!(eye[2] > target[2] + 20.0 && eye[1] < target[1] && (eye[0] - target[0]).abs() < 1e-6, "{eye:?} {target:?}");
    let lit = |screen: &Screen| screen.share(columns(&first), |pixel| pixel.iter().any(|&c| c > 40));
    desktop.wait("the surface", |screen| lit(screen) > 0.2);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    let at = middle(&first);
    let key = |key: char| desktop.press(u32::from(key));
    let number = |value: &Value| value.as_f64().unwrap();

    // A click reads the height there.
    let read = |place: [i16; 2], seen: &dyn Fn(&Value) -> bool| {
        repeat(&program, "a sample", || desktop.click(place), |s| seen(&s["looking"]["heights"]["found"]))
    };
    let found = read(at, &|found| found[1].is_f64())["looking"]["heights"]["found"].clone();
    let [row, column, x, y] = [0, 1, 2, 3].map(|k| number(&found[0][k]));
    assert!((number(&found[1]) - height(x, y)).abs() < 1e-9 && [row, column] == [y, x], "{found:#}");
    assert!((number(&found[2]) - 0.25_f64.hypot(0.125)).abs() < 1e-9, "{found:#}");
    assert!((x - target[0]).hypot(y - target[1]) < 12.0, "what is in the middle is in the middle: {found:#}");
    keep(&desktop, "heights-read.png");
    // Two clicks measure in space and in plan.
    let measured = || {
        key('m');
        desktop.click([at[0] - 80, at[1]]);
        // A slow frame makes one place of two clicks.
        program.settle();
        desktop.click([at[0] + 60, at[1] + 20]);
    };
    let apart = repeat(&program, "a distance", measured, |s| s["looking"]["heights"]["apart"][1].as_f64() > Some(10.0));
    let [space, plan, rise, angle] = [0, 1, 2, 3].map(|k| number(&apart["looking"]["heights"]["apart"][k]));
    assert!((space - plan.hypot(rise)).abs() < 1e-9 && (angle - rise.atan2(plan).to_degrees()).abs() < 1e-9);
    assert!(rise.abs() > 1.0, "{plan} {rise}");

    // A line becomes a profile, a rectangle the numbers of its samples.
    let draw = |tool: char| {
        key(tool);
        desktop.stroke(&[[at[0] - 90, at[1] - 10], [at[0] - 20, at[1]], [at[0] + 40, at[1] + 30]]);
    };
    let line = repeat(&program, "a profile", || draw('g'), |s| s["looking"]["heights"]["profile"][0].is_u64());
    let [length, valid] = [0, 1].map(|k| number(&line["looking"]["heights"]["profile"][1][k]));
    assert!(length > 10.0 && valid > 0.0 && valid <= length * (1.0 + 1e-12), "{length} {valid}");
    keep(&desktop, "heights-profile.png");
    let region = repeat(&program, "a region", || draw('b'), |s| s["looking"]["heights"]["region"][3].is_f64());
    let region = &region["looking"]["heights"]["region"];
    assert!(region[0].as_u64() > Some(100) && number(&region[3]) > 0.1, "{region:#}");
    keep(&desktop, "heights-region.png");
}

/// A click into a hole says so, and which sample is nearest; however far one turns, the eye stays above the ground.
#[test]
fn holes_are_told_and_the_eye_stays_above_ground() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    slope(&folder.join("slope.npy"));
    let scene = folder.join("slope.scene.ron");
    // The hole is behind what is looked at, and an eye that turns down stays over the field.
    let text = "(version: 2, datasets: [(path: \"slope.npy\")], mode: \"surface\", \
         camera: (eye: (65.0, 85.0, 48.0), target: (90.0, 60.0, 18.0), up: (0.0, 0.0, 1.0), fov: 60.0))";
    std::fs::write(&scene, text).unwrap();
    let desktop = Desktop::with_screen([1280, 720]);
    let mut program = Program::open(&desktop, folder, &scene, [1280, 720], &[]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    let (at, number) = (middle(&first), |value: &Value| value.as_f64().unwrap());
    // The hole is straight behind the target: 40.3 degrees below the eye are in the middle of the picture, and the hole from 13.5 to 27.9.
    let high = number(&first["picture"][3]) - number(&first["picture"][1]);
    let above = 0.5 * high * (40.3_f64 - 22.5).to_radians().tan() / 30.0_f64.to_radians().tan();
    let hole = [at[0], at[1] - above as i16];
    let heights = |status: &Value| status["looking"]["heights"].clone();
    let read = repeat(&program, "a hole", || desktop.click(hole), |s| heights(s)["found"].is_array());
    let read = heights(&read);
    let [row, column, x, y] = [0, 1, 2, 3].map(|k| number(&read["found"][0][k]));
    assert!(read["found"][1].is_null() && read["found"][2].is_null() && [row, column] == [y, x], "{read:#}");
    // Cells that have a corner in it are open, too.
    assert!((99.0..=120.0).contains(&x) && (29.0..=50.0).contains(&y), "{read:#}");
    let [row, column, told] = [0, 1, 2].map(|k| number(&read["nearest"][k]));
    let is_open = |row: usize, column: usize| HOLE[0].contains(&column) && HOLE[1].contains(&row);
    assert!(told == height(column, row) && !is_open(row as usize, column as usize), "{read:#}");
    let measured = (0..SAMPLES[1]).flat_map(|row| (0..SAMPLES[0]).map(move |column| (row, column)));
    let measured = measured.filter(|(row, column)| !is_open(*row, *column));
    let least = measured.map(|(row, column)| (row as f64 - y).hypot(column as f64 - x)).fold(f64::INFINITY, f64::min);
    assert!(((row - y).hypot(column - x) - least).abs() < 1e-9, "{least}: {read:#}");
    keep(&desktop, "heights-hole.png");

    // How high the eye stands above the field, and whether it is over it.
    let over = |status: &Value| {
        let [x, y, z] = point(status, "eye");
        let [columns, rows] = SAMPLES.map(|count| (count - 1) as f64);
        ((0.0..=columns).contains(&x) && (0.0..=rows).contains(&y)).then(|| z - height(x, y))
    };
    let turn = || desktop.drag(at, [at[0], at[1] - 260]);
    repeat(&program, "an eye at the ground", turn, |s| over(s).is_some_and(|over| over < 1.0));
    for _ in 0..2 {
        turn();
        program.settle();
        let status = program.status();
        let over = over(&status);
        assert!(over.is_some_and(|over| over > 0.0), "{over:?} above ground: {status:#}");
    }
}

#[test]
fn of_two_fields_the_one_in_front_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let [ground, table] = ["ground.npy", "table.npy"].map(|name| folder.join(name));
    slope(&ground);
    // A level table over the middle of the ground.
    field(&table, [61, 61], |_, _| 45.0);
    let desktop = Desktop::with_screen([1280, 720]);
    let with = format!("{}@50,20,0", table.display());
    let mut program = Program::open(&desktop, folder, &ground, [1280, 720], &["--with", &with]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    assert_eq!(first["mode"], "surface", "{first:#}");
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    let at = middle(&first);
    let read = |place: [i16; 2], field: u64| {
        let seen = |s: &Value| s["looking"]["heights"]["field"].as_u64() == Some(field);
        let status = repeat(&program, "a sample", || desktop.click(place), seen);
        let found = &status["looking"]["heights"]["found"];
        let [x, y] = [2, 3].map(|k| found[0][k].as_f64().unwrap());
        (x, y, found[1].as_f64().unwrap())
    };
    let (x, y, found) = read(at, 1);
    assert!(found == 45.0 && (0.0..=60.0).contains(&x) && (0.0..=60.0).contains(&y), "{x} {y} {found}");
    keep(&desktop, "heights-two-fields.png");
    let (x, y, found) = read([at[0] - 170, at[1]], 0);
    assert!((found - height(x, y)).abs() < 1e-9 && x < 50.0, "{x} {y} {found}");
    // Between both fields distances are those of the scene, at true heights.
    let measured = || {
        desktop.press(u32::from('m'));
        desktop.click(at);
        program.settle();
        desktop.click([at[0] - 170, at[1]]);
    };
    let apart = repeat(&program, "a distance", measured, |s| s["looking"]["heights"]["apart"][1].as_f64() > Some(10.0));
    let rise = apart["looking"]["heights"]["apart"][2].as_f64().unwrap().abs();
    assert!((rise - (45.0 - found)).abs() < 1e-6, "{rise} {found}");
    desktop.press(u32::from('i'));
    // A double-click comes near what is seen: the table, and no sample of the ground below it.
    let twice = || {
        desktop.click(at);
        desktop.click(at);
    };
    let from = point(&first, "eye");
    let far = distance(from, point(&first, "target"));
    let is_there = |s: &Value| {
        let [eye, target] = ["eye", "target"].map(|name| point(s, name));
        distance(eye, target) < 0.5 * far && (target[2] - 45.0).abs() < 1e-3
    };
    repeat(&program, "a flight to the table", twice, is_there);
}
