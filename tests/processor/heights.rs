//! Measured heights from the command line: what is written is read back the same, and numbers are those of formulas.

mod commands;
mod pictures;

use crate::support::golden::picture_at;
use crate::support::{json, ok, run};
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
    let [source, built] = ["waves.npy", "waves.df"].map(|name| json(folder, &["info", name, "--json"]));
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
    let part = json(folder, &["info", "part.asc", "--json"]);
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
    let [exact, told] = ["waves.df", "within.df"].map(|name| json(folder, &["info", name, "--json"]));
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
    let point = json(folder, &["probe", "within.df", "--point=20,30", "--json", "-"]);
    assert_eq!(point["height_error"], 0.05);
    for (error, found) in [("0", "0"), ("-1", "-1"), ("nan", "NaN"), ("1e4", "10000")] {
        refused(folder, &build(error), &format!("waves.npy: --height-error: found {found}, expected "));
    }
    refused(folder, &["build", "within.df", "-o", "x.df", "--height-error", "1"], "found 1 for a page file");
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
        let told = json(folder, &["probe", name, "--form", "plane", "--json", "-"]);
        let number = |name: &str| told["iso"][name].as_f64().unwrap();
        assert!((number("Sq") - AMPLITUDE / 2.0).abs() < 0.02 && (number("Sku") - 2.25).abs() < 0.01, "{told:#}");
        let form: Vec<f64> = serde_json::from_value(told["form"]["coefficients"].clone()).unwrap();
        assert!(form.iter().zip([3.0, 0.01, -0.02]).all(|(own, wanted)| (own - wanted).abs() < 0.02), "{form:?}");
        let profile = ["probe", name, "--line=10.5,20.25,200.5,77", "-o", "profile.csv", "--json", "-"];
        let told = json(folder, &profile);
        assert!((told["length"].as_f64().unwrap() - 190.0_f64.hypot(56.75)).abs() < 1e-9);
        assert!(std::fs::read_to_string(folder.join("profile.csv")).unwrap().lines().count() > 300);
        let point = json(folder, &["probe", name, "--point=16,48", "--json", "-"]);
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
    // Numbers that hang on how far samples are apart, and in which unit, come with what is not known of that.
    let noted = |arguments: &[&str]| String::from_utf8(ok(folder, arguments).stderr).unwrap();
    let apart = "note: the distance of samples is not stated";
    assert!(noted(&["probe", "whole.npy"]).starts_with(apart) && noted(&["probe", "whole.df"]).starts_with(apart));
    assert_eq!(noted(&["probe", "whole.npy", "--spacing", "2,2"]), "");
    let degrees = noted(&["probe", "whole.npy", "--spacing", "0.001,0.001"]);
    assert!(degrees.starts_with("note: x and y, without a unit,") && degrees.contains("--xy-unit deg"), "{degrees}");
    let crossed = "--s-filter: found 80, expected less than --l-filter 25";
    refused(folder, &["probe", "whole.npy", "--s-filter", "80", "--l-filter", "25"], crossed);
    let few = "whole.df: region: found 1 x 1 samples, expected at least 2 x 2";
    refused(folder, &["probe", "whole.df", "--rectangle=0,0,0.5,0.5"], few);
    // Under the middle of a picture from above lies what is there; beside the field nothing.
    let camera =
        ["--eye", "100.3,90.4,300", "--target", "100.3,90.4,0", "--up", "0,1,0", "--size", "101x101", "--fov", "60"];
    let picks = json(
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
    let told = json(folder, &["difference", "ramp.npy", "step.npy", "-o", "change.df", "--json", "-"]);
    let volume = 7.0 * 49.0 * 49.5;
    assert!(
        (told["volume_above"].as_f64().unwrap() / volume - 1.0).abs() < 1e-9 && told["volume_below"] == 0.0,
        "{told:#}"
    );
    assert_eq!(json(folder, &["info", "change.df", "--json"])["max"], 7.0);
}

/// The lines of an SVG picture: the height, the points, and whether it is closed.
fn paths(picture: &str) -> Vec<(f64, Vec<[f64; 2]>, bool)> {
    let path = |line: &str| {
        let (course, level) = line.strip_prefix("<path d=\"M")?.split_once("\"><title>")?;
        let level = level.strip_suffix("</title></path>")?.parse::<f64>().ok()?;
        let place = |place: &str| {
            let (x, y) = place.split_once(' ')?;
            Some([x.parse::<f64>().ok()?, y.parse::<f64>().ok()?])
        };
        let points = course.trim_end_matches('Z').split('L').map(place).collect::<Option<Vec<_>>>()?;
        Some((level, points, course.ends_with('Z')))
    };
    picture.lines().filter_map(path).collect()
}

/// Lines of equal height are tables and pictures as well, profiles are plots in which gaps are seen, and discs leave out the corners around them.
#[test]
fn lines_are_written_and_plotted_and_discs_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A ramp that is not there between x = 30 and x = 60.
    written(&folder.join("ramp.npy"), [101, 41], |column, _| match column {
        31..60 => f64::NAN,
        _ => column as f64,
    });
    let ramp = ["contours", "ramp.npy", "--interval", "10", "--base", "5.5", "-o"];
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let sorted = |one: f64, other: f64| [one.min(other), one.max(other)];
    let told = ok(folder, &[&ramp[..], &["lines.csv"]].concat());
    assert!(String::from_utf8_lossy(&told.stdout).starts_with("7 lines at 10 heights"), "{told:?}");
    refused(folder, &[&ramp[..], &["missing/lines.csv"]].concat(), "missing/lines.csv: cannot be written: ");
    let as_image = [&ramp[..], &["lines.csv", "--kind", "image"]].concat();
    refused(folder, &as_image, "ramp.npy: --kind: found image, expected heights");
    let table = text("lines.csv");
    let row = |line: &str| -> [f64; 4] {
        let parts: Vec<f64> = line.split(',').map(|part| part.parse().unwrap()).collect();
        parts.try_into().unwrap()
    };
    let rows: Vec<[f64; 4]> = table.lines().skip(1).map(row).collect();
    assert!(table.starts_with("line,level,x,y\n"), "{table}");
    let mut levels = Vec::new();
    for number in 1..=7 {
        let own: Vec<[f64; 4]> = rows.iter().copied().filter(|row| row[0] == f64::from(number)).collect();
        let ([_, level, _, first], [.., last]) = (own[0], own[own.len() - 1]);
        assert!(own.iter().all(|row| row[1] == level && (row[2] - level).abs() < 1e-12), "{own:?}");
        assert_eq!(sorted(first, last), [0.0, 40.0]);
        levels.push(level);
    }
    levels.sort_by(f64::total_cmp);
    assert_eq!(levels, [5.5, 15.5, 25.5, 65.5, 75.5, 85.5, 95.5]);
    // The longer side is 1000 wide.
    ok(folder, &[&ramp[..], &["lines.svg"]].concat());
    let picture = text("lines.svg");
    let lines = paths(&picture);
    assert!(picture.contains("viewBox=\"0 0 1000.00 400.00\"") && lines.len() == 7, "{picture}");
    for (level, points, is_closed) in lines {
        let ends = sorted(points[0][1], points[points.len() - 1][1]);
        assert!(!is_closed && ends == [0.0, 400.0], "{points:?}");
        assert!(points.iter().all(|point| (point[0] - 10.0 * level).abs() < 0.006), "{level}: {points:?}");
    }
    // A pyramid about x = 6 and y = 12: up in the picture is up in y.
    written(&folder.join("hill.npy"), [21, 21], |column, row| 10.0 - column.abs_diff(6).max(row.abs_diff(12)) as f64);
    ok(folder, &["contours", "hill.npy", "--interval", "100", "--base", "5.5", "-o", "hill.svg"]);
    let lines = paths(&text("hill.svg"));
    let [(level, points, is_closed)] = &lines[..] else { panic!("{lines:?}") };
    let reach = |axis: usize| {
        let places = points.iter().map(|point| point[axis]);
        places.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
    };
    assert!(*level == 5.5 && *is_closed);
    assert_eq!([reach(0), reach(1)], [[75.0, 525.0], [175.0, 625.0]]);
    let ending = "lines.txt: expected a name that ends in .geojson, .csv or .svg";
    refused(folder, &[&ramp[..], &["lines.txt"]].concat(), ending);
    // The frame is 492 pixels wide for 100, and 214 high for heights from -6 to 106.
    let line = ["probe", "ramp.npy", "--line=0,20.25,100,20.25", "-o", "line.png", "--size", "600x300", "--json", "-"];
    let told = json(folder, &line);
    let is_near = |told: &Value, expected: f64| (told.as_f64().unwrap() - expected).abs() < 1e-9;
    assert!(is_near(&told["length"], 100.0) && is_near(&told["valid_length"], 70.0), "{told:#}");
    let plot = picture_at(&folder.join("line.png"));
    assert_eq!((plot.width, plot.height), (600, 300));
    let at = |x: usize, y: usize| plot.rgba[y * 600 + x];
    let grey = |x: &usize| at(*x, 60) == [205, 207, 211, 255];
    let (within, beside) = ((235..375).filter(grey).count(), (86..228).chain(383..574).filter(grey).count());
    assert!(within > 120 && beside == 0, "{within} {beside}");
    let curve = |x: usize| -> Vec<usize> {
        let is_blue = |y: &usize| {
            let [red, _, blue, _] = at(x, *y);
            red < 128 && blue > red.saturating_add(40)
        };
        (36..246).filter(is_blue).collect()
    };
    for (x, expected) in [(157, 208.0), (477, 83.7)] {
        let rows = curve(x);
        let is_there = rows.iter().all(|row| (*row as f64 + 0.5 - expected).abs() < 2.5);
        assert!(is_there && !rows.is_empty(), "{x}: {rows:?}");
    }
    assert!(curve(305).is_empty());
    let disc = ["probe", "ramp.npy", "--disc", "80,20,7.5", "--json", "-"];
    let told = json(folder, &disc);
    let squares = (-7..=7_i32).flat_map(|x| (-7..=7_i32).map(move |y| x * x + y * y));
    let inside = squares.filter(|square| *square <= 56).count();
    assert_eq!((&told["samples"], &told["valid"]), (&225.into(), &inside.into()));
    let iso = &told["iso"];
    assert!(is_near(&told["mean"], 80.0) && is_near(&iso["Sp"], 7.0) && is_near(&iso["Sv"], 7.0), "{told:#}");
    let told = json(folder, &[&disc[..], &["--form", "plane"]].concat());
    assert!(is_near(&told["iso"]["Sq"], 0.0), "{told:#}");
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
        let told = json(folder, &["probe", "globe.df", "--rectangle", rectangle, "--json", "-"]);
        // Columns 34, 35, 0, 1 and 2.
        let is_right = |told: &Value| (told["mean"].as_f64().unwrap() - 14.4).abs() < 1e-9;
        assert!(told["samples"] == 85 && is_right(&told), "{told:#}");
        ok(folder, &["select", "globe.df", "--rectangle", rectangle, "-o", "part.npy"]);
        let told = json(folder, &["info", "part.npy", "--json"]);
        assert!(told["columns"] == 5 && is_right(&told), "{told:#}");
    }
    let told = json(folder, &["probe", "globe.df", "--line", "325,0,375,0", "--json", "-"]);
    assert!((told["valid_length"].as_f64().unwrap() / told["length"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{told:#}");
    let lines = ok(folder, &["contours", "globe.df", "--interval", "10", "-o", "lines.geojson"]);
    // Three between the last column and the first, too.
    assert!(String::from_utf8_lossy(&lines.stdout).starts_with("6 lines at 4 heights"));
    let both = "wide.df: region: found samples at both ends of the field in it, expected a part of x 0 to 330";
    refused(folder, &["probe", "wide.df", "--rectangle", "300,-80,385,80"], both);
}
