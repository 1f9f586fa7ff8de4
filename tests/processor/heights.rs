//! Measured heights from the command line: what is written is read back the same, pictures show the surface and nothing but it, and numbers are
//! those of formulas.

use crate::support::golden::{difference, picture_at};
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

/// An array of this type and shape, the slowest axis first.
fn array(path: &Path, kind: &str, shape: &str, samples: &[u8]) {
    let head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(118_u16.to_le_bytes());
    bytes.extend(format!("{head:117}\n").into_bytes());
    bytes.extend(samples);
    std::fs::write(path, bytes).unwrap();
}

/// An array of doubles, NaN where nothing was measured.
fn written(path: &Path, [columns, rows]: [usize; 2], height: impl Fn(usize, usize) -> f64) {
    let all = (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row]));
    let samples: Vec<u8> = all.flat_map(|[column, row]| height(column, row).to_le_bytes()).collect();
    array(path, "<f8", &format!("{rows}, {columns}"), &samples);
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
    ends(folder, arguments, 1, expected);
}

/// As wrong usage.
fn misused(folder: &Path, arguments: &[&str], expected: &str) {
    ends(folder, arguments, 2, expected);
}

/// With this code and one line.
fn ends(folder: &Path, arguments: &[&str], code: i32, expected: &str) {
    let output = run(folder, arguments);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(code) && text.contains(expected), "{arguments:?}: {text}");
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
fn heights_within_a_bound_make_a_smaller_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df"]);
    let build = |error: &'static str| ["build", "waves.npy", "-o", "within.df", "--height-error", error];
    ok(folder, &build("0.05"));
    ok(folder, &["verify", "within.df"]);
    ok(folder, &["select", "within.df", "-o", "within.npy"]);
    let back = doubles(&folder.join("within.npy"));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (index, value) in back.iter().enumerate() {
        let (column, row) = (index % SIZE[0], index / SIZE[0]);
        assert_eq!(value.is_nan(), !is_measured(column, row));
        assert!(value.is_nan() || (value - height(column, row)).abs() <= 0.05);
        (low, high) = (low.min(*value), high.max(*value));
    }
    let [exact, told] = ["waves.df", "within.df"].map(|name| answer(folder, &["info", name, "--json"]));
    assert_eq!((&exact["height_error"], &told["height_error"]), (&Value::Null, &0.05.into()));
    assert_eq!((&told["min"], &told["max"]), (&low.into(), &high.into()));
    assert_eq!((&told["valid"], &told["lone"]), (&exact["valid"], &exact["lone"]));
    assert!(told["bytes"].as_f64().unwrap() < 0.5 * exact["bytes"].as_f64().unwrap(), "{told:#}");
    let sentence = "heights are within 0.05 of the source's";
    let said = |arguments: &[&str]| {
        let Output { stdout, stderr, .. } = ok(folder, arguments);
        String::from_utf8([stdout, stderr].concat()).unwrap().contains(sentence)
    };
    assert!(said(&["info", "within.df"]) && said(&["select", "within.df", "-o", "within.npy"]));
    assert!(said(&["probe", "within.df", "--point=20,30"]) && said(&["probe", "within.df", "--pixel", "600,400"]));
    assert!(!said(&["info", "waves.df"]) && !said(&["probe", "waves.df", "--point=20,30"]));
    let point = answer(folder, &["probe", "within.df", "--point=20,30", "--json", "-"]);
    assert_eq!(point["height_error"], 0.05);
    for (error, found) in [("0", "0"), ("-1", "-1"), ("nan", "NaN"), ("1e4", "10000")] {
        refused(folder, &build(error), &format!("waves.npy: --height-error: found {found}, expected "));
    }
    refused(folder, &["build", "within.df", "-o", "x.df", "--height-error", "1"], "found 1 for a page file");
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
    // What may take little memory is coarser, and says so.
    for (memory, is_converged) in [("64MiB", true), ("300000", false)] {
        let arguments =
            ["render", "waves.df", "-o", "x.png", "--json", "top.json", "--error-px", "0.01", "--memory", memory];
        ok(folder, &[&arguments[..], &camera].concat());
        let told: Value = serde_json::from_slice(&std::fs::read(folder.join("top.json")).unwrap()).unwrap();
        assert_eq!(told["converged"], is_converged, "{memory}: {told:#}");
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

/// What has changed since an earlier field is the colour of the later one, and nothing else of it changes.
#[test]
fn differences_lie_over_the_later_surface() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rise = |column: usize| match column {
        0..100 => 4.0,
        100..230 => 0.0,
        _ => -4.0,
    };
    written(&folder.join("after.npy"), SIZE, |column, row| height(column, row) + rise(column));
    written(&folder.join("before.npy"), SIZE, |column, row| {
        let away = (column as f64 - 280.0).hypot(row as f64 - 60.0);
        if away < 20.0 { f64::NAN } else { height(column, row) }
    });
    for name in ["before", "after"] {
        let built = format!("{name}.df");
        ok(folder, &["build", &format!("{name}.npy"), "-o", &built, "--spacing", "1,1"]);
    }
    let camera =
        ["--eye", "165,145,400", "--target", "165,145,0", "--up", "0,1,0", "--ortho", "260", "--size", "240x160"];
    let drawn = |more: &[&str]| {
        let arguments = ["-o", "top.png", "--raw", "top.npy", "--json", "top.json", "--set", "ambient=1.0"];
        ok(folder, &[&["render"], more, &arguments, &camera].concat());
        let told: Value = serde_json::from_slice(&std::fs::read(folder.join("top.json")).unwrap()).unwrap();
        (picture_at(&folder.join("top.png")).rgba, std::fs::read(folder.join("top.npy")).unwrap(), told)
    };
    let (own, raw, _) = drawn(&["after.df"]);
    let (changed, same_raw, told) = drawn(&["after.df", "--before", "before.df"]);
    assert!(raw == same_raw && own != changed);
    assert_eq!(told["range"], serde_json::json!([-4.0, 4.0]));
    let at = |[column, row]: [f64; 2]| {
        let [x, y] = [120.0 + (column - 165.0) * 160.0 / 260.0, 80.0 - (row - 145.0) * 160.0 / 260.0];
        changed[y as usize * 240 + x as usize]
    };
    let ([higher, _, low, _], [blue, _, lower, _]) = (at([50.0, 145.0]), at([290.0, 145.0]));
    assert!(higher > low.saturating_add(60) && lower > blue.saturating_add(60), "{higher} {low}, {blue} {lower}");
    let [red, green, blue, _] = at([165.0, 145.0]);
    assert!(red.min(green).min(blue) > 200, "{red} {green} {blue}");
    let [red, green, blue, _] = at([280.0, 60.0]);
    assert!(red == green && green == blue && red < 180, "not known: {red} {green} {blue}");
    // A source, a scene and the attribute's name say the same.
    let scene = "(version: 1, datasets: [(path: \"after.df\", before: \"before.df\")])";
    std::fs::write(folder.join("change.scene.ron"), scene).unwrap();
    assert!(drawn(&["after.npy", "--before", "before.npy"]).0 == changed);
    assert!(drawn(&["after.df", "--before", "before.df", "--attribute", "difference"]).0 == changed);
    assert!(drawn(&["change.scene.ron", "--mode", "surface"]).0 == changed);
    assert!(drawn(&["after.df", "--before", "before.df", "--attribute", "height"]).0 == own);
    refused(
        folder,
        &["render", "after.df", "-o", "x.png", "--attribute", "difference"],
        "after.df: attribute difference: found no earlier heights to compare with, expected some (--before FILE)",
    );
    ok(folder, &["build", "before.npy", "-o", "degrees.df", "--xy-unit", "deg", "--spacing", "1,1"]);
    refused(
        folder,
        &["render", "after.df", "-o", "x.png", "--before", "degrees.df"],
        "after.df and degrees.df: unit of x and y: found no unit and deg",
    );
    // Spacings count in probes and lines as they do in builds.
    let told = answer(folder, &["probe", "after.npy", "--spacing", "2,3", "--point", "40,30", "--json", "-"]);
    assert_eq!(told["height"].as_f64(), Some(height(20, 10) + 4.0));
}

/// An eye below ground is lifted and looks the same way, and one that is high enough stays.
#[test]
fn eyes_stay_above_ground() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(&folder.join("flat.npy"), [40, 30], |_, _| 7.0);
    ok(folder, &["build", "flat.npy", "-o", "flat.df", "--spacing", "1,1"]);
    let eye = |z: &str, settings: &[&str]| {
        let (eye, target) = (format!("20,15,{z}"), format!("20,25,{z}"));
        let arguments = ["render", "flat.df", "-o", "x.png", "--json", "-", "--eye", &eye, "--target", &target];
        answer(folder, &[&arguments[..], &["--size", "60x40"], settings].concat())["eye"].clone()
    };
    assert_eq!(eye("-5", &["--set", "clearance=2.0"]), serde_json::json!([20.0, 15.0, 9.0]));
    let twice = ["--set", "clearance=2.0", "--set", "exaggeration=2.0"];
    assert_eq!(eye("-5", &twice), serde_json::json!([20.0, 15.0, 16.0]));
    assert!(eye("9.5", &["--set", "clearance=2.0"]).is_null() && eye("-5", &[]).is_null());
    // Pictures of numbers have the channels of what is seen, all around as well.
    for more in [["--fov", "40"], ["--projection", "dome"]] {
        let arguments =
            ["render", "flat.df", "-o", "x.exr", "--eye", "20,15,9", "--target", "20,25,7", "--size", "24x24"];
        ok(folder, &[&arguments[..], &more].concat());
        let bytes = std::fs::read(folder.join("x.exr")).unwrap();
        for name in ["R", "depth", "height", "coverage"] {
            assert!(
                bytes.windows(name.len() + 1).any(|part| part.strip_suffix(b"\0") == Some(name.as_bytes())),
                "{name} {more:?}"
            );
        }
    }
    // What is under a pixel is so of the same eye.
    let pixels =
        ["probe", "flat.df", "--pixel", "30,30", "--eye", "20,15,-5", "--target", "20,25,-5", "--size", "60x40"];
    std::fs::write(folder.join("c.ron"), "(mode: \"surface\", settings: {\"clearance\": 2.0})").unwrap();
    let told = answer(folder, &[&pixels[..], &["--config", "c.ron", "--json", "-"]].concat());
    assert_eq!(told["picks"][0]["height"].as_f64(), Some(7.0), "{told:#}");
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
    // Of these heights as many are above 0 as below, and the material ratio curve says so.
    ok(folder, &["probe", "whole.df", "--form", "plane", "-o", "ratio.csv"]);
    let table = std::fs::read_to_string(folder.join("ratio.csv")).unwrap();
    let ratio = |percent: &str| -> f64 {
        let row = table.lines().find_map(|line| line.strip_prefix(percent)?.strip_prefix(','));
        row.unwrap().parse().unwrap()
    };
    assert_eq!(table.lines().count(), 102);
    assert!((ratio("0") - AMPLITUDE).abs() < 0.1 && (ratio("100") + AMPLITUDE).abs() < 0.1, "{table}");
    assert!(ratio("50").abs() < 0.1 && (ratio("25") + ratio("75")).abs() < 0.2, "{table}");
    refused(folder, &["probe", "whole.df", "-o", "ratio.svg"], "ratio.svg: expected a name that ends in .csv or .png");
    let few = "whole.df: region: found 1 x 1 samples, expected at least 2 x 2";
    refused(folder, &["probe", "whole.df", "--rectangle=0,0,0.5,0.5"], few);
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
    std::fs::write(folder.join("unknown"), [1_u8, 2, 3, 4, 5]).unwrap();
    refused(folder, &["info", "unknown"], "(images and volumes), sur, al3d");
    written(&folder.join("none.npy"), [8, 8], |_, _| f64::NAN);
    refused(folder, &["info", "none.npy"], "found 0 of 64");
    misused(folder, &["synth", "surface", "-o", "x.npy"], "--size: expected two numbers of samples");
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

#[test]
fn options_of_particles_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1"]);
    std::fs::write(folder.join("stars.csv"), "x,y,z\n1,2,3\n4,5,6\n").unwrap();
    let common: [&[&str]; 14] = [
        &["--sphere", "0,0,0,1"],
        &["--box", "0,0,0,1,1,1"],
        &["--region", "region.ron"],
        &["--where", "mass:1..2"],
        &["--family", "gas"],
        &["--at", "groups.hdf5#0"],
        &["--catalogue", "groups.hdf5"],
        &["--radius", "3"],
        &["--no-wrap"],
        &["--ids", "lab.ids"],
        &["--tracked-at", "1"],
        &["--selection", "a.scene.ron#halo"],
        &["--time", "1"],
        &["--interpolation", "hold"],
    ];
    let of_probes: [&[&str]; 5] =
        [&["--over-time"], &["--profile", "3"], &["--fields", "none"], &["--histogram", "mass"], &["--bins", "8"]];
    for name in ["waves.npy", "waves.df"] {
        let found = |option: &[&str]| format!("{name}: {}: found heights, expected particles", option[0]);
        for option in common.into_iter().chain([&["--frame", "physical"][..]]) {
            misused(folder, &[&["select", name, "-o", "x.csv"][..], option].concat(), &found(option));
        }
        for option in common.into_iter().chain(of_probes) {
            misused(folder, &[&["probe", name][..], option].concat(), &found(option));
        }
        for option in [
            &["--family", "gas"][..],
            &["--paths", "all"],
            &["--periodic", "wrapped"],
            &["--time", "1"],
            &["--interpolation", "hold"],
            &["--reference"],
            &["--overdraw", "o.png"],
        ] {
            misused(folder, &[&["render", name, "-o", "x.png"][..], option].concat(), &found(option));
        }
    }
    for option in [&["--family", "gas"][..], &["--attributes", "mass"], &["--smoothing", "knn:9"], &["--every", "2"]] {
        let found = format!("waves.npy: {}: found heights, expected particles", option[0]);
        misused(folder, &[&["build", "waves.npy", "-o", "x.df"][..], option].concat(), &found);
    }
    misused(
        folder,
        &["render", "waves.df", "--with", "waves.df@0,0,99", "-o", "x.png", "--family", "gas"],
        "waves.df: --family: found heights, expected particles",
    );
    misused(folder, &["render", "waves.df", "-o", "x.png", "--splats", "9"], "surface has no setting splats, expected");
    assert!(["x.csv", "x.png", "o.png"].iter().all(|name| !folder.join(name).exists()));
    // Among particles they are these particles', and the other way round it is the same.
    let among = ["render", "waves.df", "--with", "stars.csv", "-o", "x.png", "--family", "dark", "--size", "60x40"];
    ok(folder, &among);
    let rectangle = ["select", "stars.csv", "--rectangle", "0,0,9,9", "-o", "x.csv"];
    misused(folder, &rectangle, "stars.csv: --rectangle: is for heights");
}

#[test]
fn commands_that_have_no_use_for_heights_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1"]);
    ok(folder, &["select", "waves.df", "-o", "waves.asc"]);
    for name in ["waves.df", "waves.asc"] {
        let instead = "deepfield select FILE -o OUT.tif writes the samples of heights";
        let found = |expected: &str| format!("{name}: content: found heights, expected {expected}; {instead}");
        refused(folder, &["export", name, "-o", "x.ply"], &found("particles"));
        refused(folder, &["export", name, "-o", "x.ply", "--mode", "column-density"], &found("particles"));
        refused(folder, &["reconstruct", name, "-o", "x.npy"], &found("an image or a volume"));
        refused(folder, &["catalogue", name], &found("a catalogue of objects"));
        refused(folder, &["plot", name, "--histogram", "height", "-o", "x.svg"], &found("particles"));
        refused(folder, &["surface", name, "--isovalue", "1", "-o", "x.ply"], &found("particles or a volume"));
    }
    // An array is an image as well.
    ok(folder, &["reconstruct", "waves.npy", "-o", "x.npy", "--exact"]);
    let as_image = ["render", "waves.df", "-o", "x.png", "--kind", "image"];
    refused(folder, &as_image, "waves.df: --kind: found a file of heights");
    // Its pixels are particles where those are asked for; other formats have none.
    let drawn = ["-o", "x.png", "--size", "32x24", "--backend", "cpu"];
    let sums = [&drawn[..], &["--mode", "column-density"]].concat();
    ok(folder, &[&["render", "waves.npy"], &sums[..]].concat());
    ok(folder, &[&["render", "waves.npy", "--kind", "particles"], &drawn[..]].concat());
    let no_sums = "mode column-density does not draw heights, expected surface";
    refused(folder, &[&["render", "waves.asc"], &sums[..]].concat(), &format!("waves.asc: {no_sums}"));
    let as_heights = [&["render", "waves.npy", "--kind", "heights"], &sums[..]].concat();
    refused(folder, &as_heights, &format!("waves.npy: {no_sums}"));
    // What is no heights is named as what it is; what could be some says how.
    array(&folder.join("three.npy"), "<f4", "6, 5, 4", &[0; 480]);
    array(&folder.join("grey.npy"), "|u1", "16, 9", &[7; 144]);
    let drawn = |name: &str| {
        let output = run(folder, &["render", name, "-o", "x.png", "--mode", "surface"]);
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(drawn("three.npy"), "deepfield: three.npy: mode surface draws heights, found a volume\n");
    let hint = "; --kind heights takes its values for heights";
    assert_eq!(drawn("grey.npy"), format!("deepfield: grey.npy: mode surface draws heights, found an image{hint}\n"));
    // Numbers below 0 reach whoever knows what is wrong with them.
    refused(
        folder,
        &["build", "waves.npy", "-o", "x.df", "--spacing", "-1,1"],
        "waves.npy: --spacing: found -1,1, expected two numbers above 0",
    );
    for option in ["--s-filter", "--l-filter", "--fov", "--ortho"] {
        let output = run(folder, &["probe", "waves.df", option, "-1"]);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && text.contains("expected a number greater than 0"), "{text}");
    }
    let help = String::from_utf8(ok(folder, &["--help"]).stdout).unwrap();
    assert!(help.contains("Formats of heights: sur, "), "{help}");
}

#[test]
fn depth_decides_among_heights_and_other_data() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rows: Vec<String> = (0..19).map(|row| vec![(row * 100).to_string(); 37].join(" ")).collect();
    let head = "ncols 37\nnrows 19\nxllcenter -180\nyllcenter -90\ncellsize 10\n";
    std::fs::write(folder.join("globe.asc"), format!("{head}{}\n", rows.join("\n"))).unwrap();
    ok(folder, &["build", "globe.asc", "-o", "globe.df", "--xy-unit", "deg", "--height-unit", "m"]);
    let radius = 1_737_400.0;
    for (name, share) in [("behind.csv", 0.5), ("before.csv", -0.6)] {
        let [x, z] = [4.0 * share * radius, -1.5 * share * radius];
        std::fs::write(folder.join(name), format!("x [m],y [m],z [m],mag\n{x},0,{z},-1\n")).unwrap();
    }
    let eye = format!("{},0,{}", -4.0 * radius, 1.5 * radius);
    let camera = ["--eye", &eye, "--target", "0,0,0", "--map", "globe:moon", "--size", "240x160", "--backend", "cpu"];
    let picture = |more: &[&str]| {
        ok(folder, &[&["render", "globe.df", "-o", "a.png"][..], more, &camera].concat());
        picture_at(&folder.join("a.png"))
    };
    let plain = picture(&[]);
    let changed = |image: &deepfield::color::Image| {
        let differs = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
        image.rgba.iter().zip(&plain.rgba).filter(|pair| differs(*pair)).count()
    };
    assert_eq!(changed(&picture(&["--with", "behind.csv"])), 0);
    assert!((5..100).contains(&changed(&picture(&["--with", "before.csv"]))));
    // The other way round particles are what the picture is about; heights keep their settings.
    let set = ["--set", "exaggeration=3.0", "--set", "radius=4.0"];
    let what = ["render", "before.csv", "--with", "globe.df", "-o", "b.png", "--json", "b.json"];
    let more = [&what[..], &set, &camera];
    ok(folder, &more.concat());
    let told: Value = serde_json::from_slice(&std::fs::read(folder.join("b.json")).unwrap()).unwrap();
    assert_eq!((&told["mode"], &told["particles_drawn"]), (&"points".into(), &1.into()));
    assert!(told["surface"]["covered"].as_f64().unwrap() > 1000.0, "{told}");
    let cartesian = ["render", "globe.df", "--with", "behind.csv", "-o", "c.png", "--mode", "cartesian"];
    refused(folder, &[&cartesian[..], &camera].concat(), "mode: found cartesian");
}

/// A globe without its first column once more is closed: regions, profiles and lines go over its seam.
#[test]
fn regions_and_lines_go_over_the_seam_of_a_globe() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, columns) in [("globe", 36), ("wide", 34)] {
        let row = (0..columns).map(|column| column.to_string()).collect::<Vec<_>>().join(" ");
        let head = format!("ncols {columns}\nnrows 17\nxllcenter 0\nyllcenter -80\ncellsize 10\n");
        std::fs::write(folder.join(format!("{name}.asc")), format!("{head}{}\n", vec![row; 17].join("\n"))).unwrap();
        let [source, built] = ["asc", "df"].map(|end| format!("{name}.{end}"));
        ok(folder, &["build", &source, "-o", &built, "--xy-unit", "deg", "--height-unit", "m"]);
    }
    for rectangle in ["-25,-80,25,80", "335,-80,385,80"] {
        let told = answer(folder, &["probe", "globe.df", "--rectangle", rectangle, "--json", "-"]);
        // Columns 34, 35, 0, 1 and 2.
        let is_right = |told: &Value| (told["mean"].as_f64().unwrap() - 14.4).abs() < 1e-9;
        assert!(told["samples"] == 85 && is_right(&told), "{told:#}");
        ok(folder, &["select", "globe.df", "--rectangle", rectangle, "-o", "part.npy"]);
        let told = answer(folder, &["info", "part.npy", "--json"]);
        assert!(told["columns"] == 5 && is_right(&told), "{told:#}");
    }
    let told = answer(folder, &["probe", "globe.df", "--line", "325,0,375,0", "--json", "-"]);
    assert!((told["valid_length"].as_f64().unwrap() / told["length"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{told:#}");
    let lines = ok(folder, &["contours", "globe.df", "--interval", "10", "-o", "lines.geojson"]);
    // Three between the last column and the first, too.
    assert!(String::from_utf8_lossy(&lines.stdout).starts_with("6 lines at 4 heights"));
    let both = "wide.df: region: found samples at both ends of the field in it, expected a part of x 0 to 330";
    refused(folder, &["probe", "wide.df", "--rectangle", "300,-80,385,80"], both);
}

/// On the way between two keyframes the light, the exaggeration and the lines change: each shows, and a frame is made again from its scene.
#[test]
fn tours_change_light_exaggeration_and_lines() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(&folder.join("waves.npy"), [81, 61], height);
    let tour = r#"(
    version: 1,
    dataset: (path: "waves.npy", xy_unit: "m", height_unit: "m"),
    size: (64, 48),
    rate: 4.0,
    keyframes: [
        (mode: "surface", around: (what: data, elevation: 45.0),
            settings: {"light": "sun", "azimuth": 300.0, "altitude": 40.0, "exaggeration": 1.0, "contours": 5.0}),
        (after: 1.0, easing: linear, settings: {"azimuth": 60.0, "altitude": 20.0, "exaggeration": 4.0, "contours": 10.0}),
    ],
)"#;
    std::fs::write(folder.join("waves.ron"), tour).unwrap();
    ok(folder, &["tour", "waves.ron", "--record", "frames"]);
    let scene = "frames/scenes/frame-00002.scene.ron";
    let text = std::fs::read_to_string(folder.join(scene)).unwrap();
    // Half-way, of what is a factor by equal factors.
    for setting in ["\"azimuth\": 180.0", "\"altitude\": 30.0", "\"exaggeration\": 2.0", "\"contours\": 7.5"] {
        assert!(text.contains(setting), "{setting}: {text}");
    }
    let again = |more: &[&str]| {
        ok(folder, &[&["render", scene, "--backend", "cpu", "-o", "again.png"][..], more].concat());
        picture_at(&folder.join("again.png"))
    };
    let frame = picture_at(&folder.join("frames/frame-00002.png"));
    assert!(again(&[]) == frame);
    for begins in ["azimuth=300.0", "altitude=40.0", "exaggeration=1.0", "contours=5.0"] {
        assert!(again(&["--set", begins]) != frame, "{begins}");
    }
}

/// x and y that look like degrees are so in pictures of a page file as in those of its source, and numbers are those of the file.
#[test]
fn page_files_without_a_unit_are_drawn_as_their_sources_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (columns, rows) = (400, 300);
    let line = |row: usize| {
        let heights = (0..columns).map(|column| format!("{:.2}", 650.0 + 20.0 * height(column, row)));
        heights.collect::<Vec<_>>().join(" ")
    };
    let head = format!("ncols {columns}\nnrows {rows}\nxllcorner -84.41\nyllcorner 36.73\ncellsize {}", 1.0 / 1200.0);
    let lines: Vec<String> = (0..rows).map(line).collect();
    std::fs::write(folder.join("hills.asc"), format!("{head}\n{}\n", lines.join("\n"))).unwrap();
    ok(folder, &["build", "hills.asc", "-o", "hills.df"]);
    ok(folder, &["build", "hills.asc", "-o", "metres.df", "--xy-unit", "m"]);
    let drawn = |name: &str| {
        let size = ["--size", "80x60", "--attribute", "slope"];
        let output = ok(folder, &[&["render", name, "-o", "x.png"][..], &size].concat());
        (picture_at(&folder.join("x.png")), String::from_utf8(output.stderr).unwrap())
    };
    let [(source, told), (built, told_again), (metres, other)] = ["hills.asc", "hills.df", "metres.df"].map(drawn);
    let found = difference(&built, &source);
    assert!(found < 1.0, "{found} of 255");
    assert!(difference(&metres, &source) > 20.0);
    let taken = "heights 800.0 apart, and count as degrees in pictures: --xy-unit m if they are metres";
    let is_told = |told: &str, end: &str| told.contains(&format!("{taken}{end}\n")) && !told.contains("--xy-unit deg");
    assert!(is_told(&told, "") && is_told(&told_again, ", when it is built"), "{told}{told_again}");
    assert!(!other.contains("count as degrees"), "{other}");
    let [source, built] =
        ["hills.asc", "hills.df"].map(|name| answer(folder, &["probe", name, "--point", "-84.3,36.9", "--json", "-"]));
    assert!(built["slope"].as_f64().unwrap() > 100.0, "{built}");
    assert_eq!((&source["height"], &source["slope"]), (&built["height"], &built["slope"]));
    let told = answer(folder, &["info", "hills.df", "--json"]);
    assert_eq!(told["xy_unit"], "");
    assert!(told["notes"].to_string().contains("--xy-unit deg if these are degrees"), "{told}");
}
