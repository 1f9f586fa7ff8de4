//! Measured heights from the command line: what is written is read back the same, pictures show the surface and nothing but it, and numbers are
//! those of formulas.

use crate::support::golden::picture_at;
use crate::support::run;
use deepfield::color::composite::Image;
use deepfield::color::output::write_png;
use serde_json::Value;
use std::f64::consts::PI;
use std::path::Path;
use std::process::Output;

/// Columns and rows of the field that is written here, no multiples of anything.
const SIZE: [usize; 2] = [331, 290];
/// A wave along each axis.
const WAVE: f64 = 64.0;
const AMPLITUDE: f64 = 20.0;

fn height(column: usize, row: usize) -> f64 {
    let turn = |at: usize| (2.0 * PI * at as f64 / WAVE).sin();
    AMPLITUDE * turn(column) * turn(row)
}

/// A hole, and samples that are alone in it.
fn is_measured(column: usize, row: usize) -> bool {
    let away = (column as f64 - 150.0).hypot(row as f64 - 120.0);
    away > 40.0 || (column.is_multiple_of(16) && row.is_multiple_of(16))
}

/// An array of doubles, NaN where nothing was measured.
fn written(path: &Path, [columns, rows]: [usize; 2], height: impl Fn(usize, usize) -> f64) {
    let head = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(118_u16.to_le_bytes());
    bytes.extend(format!("{head:117}\n").into_bytes());
    for row in 0..rows {
        bytes.extend((0..columns).flat_map(|column| height(column, row).to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

fn waves(folder: &Path) {
    written(&folder.join("waves.npy"), SIZE, |column, row| match is_measured(column, row) {
        true => height(column, row),
        false => f64::NAN,
    });
}

fn ok(folder: &Path, arguments: &[&str]) -> Output {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn answer(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_slice(&ok(folder, arguments).stdout).unwrap()
}

fn refused(folder: &Path, arguments: &[&str], expected: &str) {
    let output = run(folder, arguments);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && text.contains(expected), "{arguments:?}: {text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
}

fn doubles(path: &Path) -> Vec<f64> {
    npyz::NpyFile::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).unwrap().into_vec().unwrap()
}

#[test]
fn a_field_is_built_verified_and_selected_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--threads", "1", "--spacing", "0.5,2"]);
    ok(folder, &["build", "waves.npy", "-o", "other.df", "--threads", "3", "--memory", "64MiB", "--spacing", "0.5,2"]);
    let bytes = |name: &str| std::fs::read(folder.join(name)).unwrap();
    assert!(bytes("waves.df") == bytes("other.df"));
    ok(folder, &["verify", "waves.df"]);
    ok(folder, &["select", "waves.npy", "-o", "a.npy"]);
    ok(folder, &["select", "waves.df", "-o", "b.npy"]);
    assert!(bytes("a.npy") == bytes("b.npy"));
    let back = doubles(&folder.join("b.npy"));
    let same = back.iter().enumerate().all(|(index, value)| {
        let (column, row) = (index % SIZE[0], index / SIZE[0]);
        if is_measured(column, row) { *value == height(column, row) } else { value.is_nan() }
    });
    assert!(same && back.len() == SIZE[0] * SIZE[1]);
    let [source, built] = ["waves.npy", "waves.df"].map(|name| answer(folder, &["info", name, "--json"]));
    let measured = (0..SIZE[0] * SIZE[1]).filter(|i| is_measured(i % SIZE[0], i / SIZE[0])).count();
    assert_eq!((&source["kind"], &source["valid"]), (&"heights".into(), &measured.into()));
    for field in ["valid", "lone", "min", "max", "invalid"] {
        assert_eq!(source[field], built[field], "{field}");
    }
    // Sums go in another order.
    let mean = |told: &Value| told["mean"].as_f64().unwrap();
    assert!((mean(&source) - mean(&built)).abs() < 1e-12);
    assert!(source["lone"].as_u64().unwrap() > 10 && built["spacing"][1] == 2.0);
    // What ends with what is asked for by coordinates, as a file of another kind.
    ok(folder, &["select", "waves.df", "--rectangle=10,20,30,60", "-o", "part.asc", "--kind", "heights"]);
    let part = answer(folder, &["info", "part.asc", "--json"]);
    assert_eq!((&part["columns"], &part["rows"]), (&41.into(), &21.into()));
    refused(
        folder,
        &["select", "waves.df", "--rectangle=1e4,1e4,2e4,2e4", "-o", "none.npy"],
        "region: found no sample",
    );
    refused(folder, &["build", "waves.df", "-o", "x.df", "--spacing", "1,1"], "waves.df: --spacing: found a page file");
}

#[test]
fn pictures_show_the_surface_and_what_was_not_measured_stays_open() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1"]);
    let camera =
        ["--eye", "165,145,400", "--target", "165,145,0", "--up", "0,1,0", "--ortho", "260", "--size", "240x160"];
    for technique in ["rays", "triangles", "hybrid"] {
        let setting = format!("technique={technique}");
        let arguments =
            ["render", "waves.df", "-o", "top.png", "--raw", "top.npy", "--json", "top.json", "--set", &setting];
        ok(folder, &[&arguments[..], &camera].concat());
        let channels = doubles(&folder.join("top.npy"));
        let (mut hits, mut holes) = (0, 0);
        for (index, [_, x, y, z, row, column, coverage]) in channels.as_chunks::<7>().0.iter().copied().enumerate() {
            // The camera looks straight down: what a pixel shows is below it.
            let [i, j] = [(index % 240) as f64 + 0.5, (index / 240) as f64 + 0.5];
            let at = [165.0 + (i - 120.0) * 260.0 / 160.0, 145.0 - (j - 80.0) * 260.0 / 160.0];
            let away = (at[0] - 150.0).hypot(at[1] - 120.0);
            if coverage > 0.0 {
                hits += 1;
                let reach = if technique == "hybrid" { 2.5 } else { 1.4 };
                assert!((x - at[0]).hypot(y - at[1]) < reach, "{technique}: {x}, {y} at {at:?}");
                assert!((row - y).abs() < 1e-9 && (column - x).abs() < 1e-9);
                assert!(z.abs() <= AMPLITUDE * 1.001);
                assert!(away > 38.0 || (x / 16.0).fract() < 1e-9, "{technique}: {at:?} was not measured");
            } else if away < 40.0 {
                holes += 1;
            }
        }
        assert!(hits > 30_000 && holes > 1000, "{technique}: {hits} pixels, {holes} in the hole");
        let told: Value = serde_json::from_slice(&std::fs::read(folder.join("top.json")).unwrap()).unwrap();
        assert!(told["converged"] == true && told["error_px"].as_f64().unwrap() <= 0.8, "{told:#}");
    }
    // A dome from within, another colour, lines of equal height: each is a picture of something else.
    let pictures: Vec<Vec<[u8; 4]>> = [
        &["--attribute", "slope"][..],
        &["--set", "contours=5.0"],
        &["--set", "exaggeration=4.0", "--set", "light=eye"],
        &["--projection", "dome", "--eye", "165,145,60", "--target", "165,300,60", "--up", "0,0,-1"],
    ]
    .into_iter()
    .map(|more| {
        ok(folder, &[&["render", "waves.df", "-o", "x.png", "--size", "160x160"], more].concat());
        picture_at(&folder.join("x.png")).rgba
    })
    .collect();
    for (number, picture) in pictures.iter().enumerate() {
        let lit = picture.iter().filter(|pixel| pixel[..3].iter().any(|part| *part > 20)).count();
        assert!(lit > 4000, "picture {number}: {lit} pixels");
        assert!(pictures[..number].iter().all(|other| other != picture));
    }
    refused(
        folder,
        &["render", "waves.df", "-o", "x.png", "--mode", "volume"],
        "waves.df: mode volume does not draw heights, expected surface",
    );
    refused(folder, &["render", "waves.df", "-o", "x.png", "--attribute", "mass"], "attribute mass is not in the data");
}

#[test]
fn photos_lie_over_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    // Four squares: red and green in the first rows, blue and white in the last ones.
    let colors = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255; 4]];
    let rgba = (0..64 * 64).map(|at| colors[at / 64 / 32 * 2 + at % 64 / 32]).collect();
    write_png(&folder.join("photo.png"), &Image { width: 64, height: 64, rgba }).unwrap();
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1", "--texture", "photo.png"]);
    ok(folder, &["verify", "waves.df"]);
    let told = answer(folder, &["info", "waves.df", "--json"]);
    let corners = serde_json::json!([[0.0, 0.0], [330.0, 289.0]]);
    let plane =
        serde_json::json!({ "name": "texture", "columns": 64, "rows": 64, "source": "photo.png", "corners": corners });
    assert_eq!(told["planes"], serde_json::json!([plane]));
    let text = String::from_utf8(ok(folder, &["info", "waves.df"]).stdout).unwrap();
    assert!(text.contains("photo (texture): 64 x 64 pixels of photo.png, from 0, 0 to 330, 289"), "{text}");
    let camera = ["--eye", "165,145,400", "--target", "165,145,0", "--up", "0,1,0", "--ortho", "260"];
    let drawn = |more: &[&str]| {
        let arguments = ["-o", "top.png", "--size", "240x160", "--set", "ambient=1.0"];
        ok(folder, &[&["render"], more, &arguments, &camera].concat());
        picture_at(&folder.join("top.png")).rgba
    };
    let own = drawn(&["waves.df"]);
    // y goes up, and rows with it.
    for (at, expected) in [([60, 120], 0), ([180, 120], 1), ([60, 40], 2), ([180, 40], 3)] {
        assert_eq!(own[at[1] * 240 + at[0]][..3], colors[expected][..3], "{at:?}");
    }
    assert_eq!(drawn(&["waves.df", "--attribute", "texture"]), own);
    assert_eq!(drawn(&["waves.npy", "--texture", "photo.png"]), own);
    assert_ne!(drawn(&["waves.df", "--attribute", "height"]), own);
    let part = drawn(&["waves.npy", "--texture", "photo.png@165,0,331,145"]);
    assert_eq!([&part[120 * 240 + 60][..3], &part[40 * 240 + 60][..3]].concat(), [188; 6]);
    assert_eq!(part[150 * 240 + 130][..3], colors[0][..3]);
    // Another file of the built one has it, too.
    ok(folder, &["build", "waves.df", "-o", "again.df"]);
    assert_eq!(drawn(&["again.df"]), own);
    let build = ["build", "waves.npy", "-o", "x.df", "--texture"];
    refused(folder, &[&build[..], &["none.png"]].concat(), "none.png: ");
    refused(folder, &[&build[..], &["photo.png@900,0,950,10"]].concat(), "photo.png: --texture: found a rectangle");
    let again = ["build", "waves.df", "-o", "x.df", "--texture", "photo.png"];
    refused(folder, &again, "waves.df: --texture: found a page file");
    refused(folder, &["build", "photo.png", "-o", "x.df", "--texture", "photo.png"], "--texture: found no heights");
}

#[test]
fn what_is_measured_is_what_formulas_say() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(&folder.join("whole.npy"), [256, 256], |column, row| {
        height(column, row) + 3.0 + 0.01 * column as f64 - 0.02 * row as f64
    });
    ok(folder, &["build", "whole.npy", "-o", "whole.df"]);
    for name in ["whole.npy", "whole.df"] {
        let told = answer(folder, &["probe", name, "--form", "plane", "--json", "-"]);
        let number = |name: &str| told["iso"][name].as_f64().unwrap();
        assert!((number("Sq") - AMPLITUDE / 2.0).abs() < 0.02 && (number("Sku") - 2.25).abs() < 0.01, "{told:#}");
        let form: Vec<f64> = serde_json::from_value(told["form"]["coefficients"].clone()).unwrap();
        assert!(form.iter().zip([3.0, 0.01, -0.02]).all(|(own, wanted)| (own - wanted).abs() < 0.02), "{form:?}");
        let profile = ["probe", name, "--line=10.5,20.25,200.5,77", "-o", "profile.csv", "--json", "-"];
        let told = answer(folder, &profile);
        assert!((told["length"].as_f64().unwrap() - 190.0_f64.hypot(56.75)).abs() < 1e-9);
        assert!(std::fs::read_to_string(folder.join("profile.csv")).unwrap().lines().count() > 300);
        let point = answer(folder, &["probe", name, "--point=16,48", "--json", "-"]);
        assert!((point["height"].as_f64().unwrap() - height(16, 48) - 3.0 - 0.16 + 0.96).abs() < 1e-9, "{point:#}");
    }
    // Under the middle of a picture from above lies what is there; beside the field nothing.
    let camera =
        ["--eye", "100.3,90.4,300", "--target", "100.3,90.4,0", "--up", "0,1,0", "--size", "101x101", "--fov", "60"];
    let picks = answer(
        folder,
        &[&["probe", "whole.df", "--pixel", "50,50", "--pixel", "0,0", "--json", "-"][..], &camera].concat(),
    );
    let hit = &picks["picks"][0];
    assert!((hit["x"].as_f64().unwrap() - 100.3).abs() < 1e-9 && hit["samples"].as_array().unwrap().len() == 3);
    assert!(picks["picks"][1].is_null(), "{picks:#}");
    // The lines of the plane that is left of nothing else.
    written(&folder.join("ramp.npy"), [100, 50], |column, _| column as f64);
    ok(folder, &["contours", "ramp.npy", "--interval", "10", "--base", "0.5", "-o", "lines.geojson"]);
    let lines: Value = serde_json::from_slice(&std::fs::read(folder.join("lines.geojson")).unwrap()).unwrap();
    let lines = lines["features"].as_array().unwrap();
    assert_eq!(lines.len(), 10);
    for line in lines {
        let level = line["properties"]["level"].as_f64().unwrap();
        let points = line["geometry"]["coordinates"].as_array().unwrap();
        assert!(points.iter().all(|point| (point[0].as_f64().unwrap() - level).abs() < 1e-12));
    }
    written(&folder.join("step.npy"), [100, 50], |column, _| column as f64 + if column >= 50 { 7.0 } else { 0.0 });
    let told = answer(folder, &["difference", "ramp.npy", "step.npy", "-o", "change.df", "--json", "-"]);
    let volume = 7.0 * 49.0 * 49.5;
    assert!(
        (told["volume_above"].as_f64().unwrap() / volume - 1.0).abs() < 1e-9 && told["volume_below"] == 0.0,
        "{told:#}"
    );
    assert_eq!(answer(folder, &["info", "change.df", "--json"])["max"], 7.0);
}

#[test]
fn synthetic_surfaces_and_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let fbm = ["synth", "surface", "--shape", "fbm", "--size", "300x200", "--type", "i16", "--seed", "5", "-o"];
    ok(folder, &[&fbm[..], &["a.npy"]].concat());
    ok(folder, &[&fbm[..], &["b.npy"]].concat());
    assert!(std::fs::read(folder.join("a.npy")).unwrap() == std::fs::read(folder.join("b.npy")).unwrap());
    ok(folder, &["build", "a.npy", "-o", "a.df"]);
    let told = answer(folder, &["info", "a.df", "--json"]);
    assert!(
        told["bytes_per_sample"].as_f64().unwrap() < 3.0 && told["notes"].to_string().contains("--spacing"),
        "{told:#}"
    );
    let whole = std::fs::read(folder.join("a.npy")).unwrap();
    std::fs::write(folder.join("cut.npy"), &whole[..whole.len() / 2]).unwrap();
    refused(folder, &["info", "cut.npy"], "cut.npy: ");
    written(&folder.join("none.npy"), [8, 8], |_, _| f64::NAN);
    refused(folder, &["info", "none.npy"], "found 0 of 64");
    written(&folder.join("row.npy"), [9, 1], |_, _| 1.0);
    refused(folder, &["info", "row.npy"], "2 x 2");
    let damaged = folder.join("damaged.df");
    let sound = std::fs::read(folder.join("a.df")).unwrap();
    for place in (0..sound.len()).step_by(sound.len() / 40) {
        let mut bytes = sound.clone();
        bytes[place] ^= 1 << (place % 8);
        std::fs::write(&damaged, bytes).unwrap();
        assert_eq!(run(folder, &["verify", "damaged.df"]).status.code(), Some(1), "byte {place}");
        let drawn = run(folder, &["render", "damaged.df", "-o", "x.png", "--size", "64x64"]);
        assert!(matches!(drawn.status.code(), Some(0 | 1)));
    }
}
