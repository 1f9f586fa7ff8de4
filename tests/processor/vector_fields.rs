//! Velocity fields from the command line: a run of the particles that they carry along, with tracks that paths are drawn from.

use crate::support::golden::picture_at;
use crate::support::{json, ok, run};
use serde_json::Value;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// Times, rows and columns of the double gyre that is written here.
const SHAPE: [usize; 3] = [21, 33, 65];

/// The double gyre of Shadden et al. (2005, Definition and properties of Lagrangian coherent structures) on [0, 2] x [0, 1].
fn gyre([x, y]: [f64; 2], time: f64) -> [f64; 2] {
    let (height, depth, turn) = (0.1, 0.25 * (0.2 * PI * time).sin(), PI);
    let (f, slope) = (depth * x * x + (1.0 - 2.0 * depth) * x, 2.0 * depth * x + 1.0 - 2.0 * depth);
    [-turn * height * (turn * f).sin() * (turn * y).cos(), turn * height * (turn * f).cos() * (turn * y).sin() * slope]
}

/// It as an array of (time, y, x, component), over a time of 10.
fn written(folder: &Path) {
    let [times, rows, columns] = SHAPE;
    let head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({times}, {rows}, {columns}, 2), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(118_u16.to_le_bytes());
    bytes.extend(format!("{head:117}\n").into_bytes());
    for (time, row, column) in
        (0..times * rows * columns).map(|i| (i / columns / rows, i / columns % rows, i % columns))
    {
        let at = [2.0 * column as f64 / (columns - 1) as f64, row as f64 / (rows - 1) as f64];
        bytes.extend(gyre(at, 0.5 * time as f64).into_iter().flat_map(|part| (part as f32).to_le_bytes()));
    }
    std::fs::write(folder.join("gyre.npy"), bytes).unwrap();
}

/// Pixels of a picture that are not black.
fn lit(path: &Path) -> usize {
    picture_at(path).rgba.iter().filter(|pixel| pixel[..3].iter().any(|part| *part > 0)).count()
}

const TRACE: [&str; 6] = ["--trace", "--times", "0:0.5", "--box", "0,0,2,1", "--seeds"];

#[test]
fn a_field_is_a_run_whose_paths_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(folder);
    let build = |out: &str, more: &[&str]| {
        ok(folder, &[&["build", "gyre.npy", "-o", out], &TRACE[..], &["600", "--steps", "11"], more].concat());
        std::fs::read(folder.join(out)).unwrap()
    };
    let whole = build("flow.df", &["--threads", "1"]);
    assert!(whole == build("other.df", &["--threads", "3"]));
    ok(folder, &["verify", "flow.df"]);
    let about = json(folder, &["info", "flow.df", "--json"]);
    assert_eq!(about["kind"], "run");
    let steps = about["steps"].as_array().unwrap();
    let times: Vec<f64> = steps.iter().map(|step| step["time"].as_f64().unwrap()).collect();
    assert_eq!(times, (0..=10).map(f64::from).collect::<Vec<_>>());
    // The walls of the box let nobody through.
    assert!(steps.iter().all(|step| step["particles"] == 600), "{about}");
    let intervals = about["intervals"].as_array().unwrap();
    assert_eq!(intervals.len(), 10);
    for interval in intervals {
        let family = &interval["families"][0];
        assert_eq!(
            (&family["matched"], &family["tangents"]),
            (&Value::from(600), &Value::from("velocity")),
            "{family}"
        );
    }

    // Paths alone, and over another mode.
    let small = ["--size", "160x100", "--backend", "cpu", "--time", "5.5", "--eye", "1,0.5,3", "--target", "1,0.5,0"];
    for (name, more) in
        [("alone.png", &["--mode", "paths"][..]), ("over.png", &["--mode", "column-density", "--paths", "all"])]
    {
        let told = ok(folder, &[&["render", "flow.df", "-o", name, "--json", "-"], &small[..], more].concat()).stdout;
        let told: Value = serde_json::from_slice(&told).unwrap();
        assert!(told["tracks_drawn"].as_u64().is_some_and(|tracks| tracks > 20), "{told}");
        let lit = lit(&folder.join(name));
        assert!(lit > 500, "{name}: {lit} pixels");
    }
    // Without a time, paths alone are those into the last step; with a lead, those out of the first one.
    std::fs::write(folder.join("lead.ron"), r#"(mode: "paths", paths: (tail: 0, lead: 2))"#).unwrap();
    for (more, step) in [(&["--mode", "paths"][..], 10), (&["--config", "lead.ron"], 0), (&["--mode", "points"], 0)] {
        let common = ["render", "flow.df", "-o", "end.png", "--json", "-", "--size", "160x100", "--backend", "cpu"];
        let told = json(folder, &[&common[..], more].concat());
        assert_eq!(told["step"], step, "{more:?}: {told}");
    }
}

#[test]
fn info_says_what_reads_velocities() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(folder);
    let told = String::from_utf8(ok(folder, &["info", "gyre.npy"]).stdout).unwrap();
    assert!(told.contains("2 values, as vectors have: deepfield build --trace reads a velocity field"), "{told}");
    // With an axis of z it is no image and no volume.
    let head = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 1, 2, 3), }";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(118_u16.to_le_bytes());
    bytes.extend(format!("{head:117}\n").into_bytes());
    bytes.extend([0; 24]);
    std::fs::write(folder.join("abc.npy"), bytes).unwrap();
    let output = run(folder, &["info", "abc.npy"]);
    let why = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.success(), why.lines().count()), (false, 1), "{why}");
    assert!(why.contains("(1, 1, 1, 2, 3)") && why.contains("build --trace reads a velocity field"), "{why}");
}

#[test]
fn what_cannot_be_traced_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(folder);
    // Usage.
    for wrong in [
        &["--seeds", "5"][..],
        &["--trace", "--steps", "1"],
        &["--trace", "--periodic=t"],
        &["--trace", "--box", "1,0,0,1"],
        &["--trace", "--every", "2"],
        &["--trace", "--duration", "0"],
        &["--trace", "--seed-point", "1,1", "--seeds", "5"],
    ] {
        let output = run(folder, &[&["build", "gyre.npy", "-o", "a.df"], wrong].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    std::fs::write(folder.join("cut.npy"), &std::fs::read(folder.join("gyre.npy")).unwrap()[..5000]).unwrap();
    std::fs::write(folder.join("table.csv"), "x,y,z\n0,0,0\n").unwrap();
    for (source, more, expected) in [
        ("cut.npy", &[][..], "cut.npy: data: found 4872 bytes"),
        ("gyre.npy", &["--times", "0,1"], "gyre.npy: --times: found 2 times, expected 21"),
        ("gyre.npy", &["--duration", "99"], "gyre.npy: --duration: found 99"),
        ("gyre.npy", &["--seed-point", "-5,0"], "gyre.npy: seeds: missing"),
        ("table.csv", &[], "table.csv: content: not a known format"),
    ] {
        let output = run(folder, &[&["build", source, "--trace", "-o", "a.df"], more].concat());
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{source} {more:?}: {told}");
        let last = told.lines().last().unwrap_or_default();
        assert!(last.contains(expected), "{told}");
        assert!(!folder.join("a.df").exists());
    }
}

fn reference(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os("DEEPFIELD_DATA").unwrap()).join("vectorfields").join(name)
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn fields_of_the_reference_data_are_built() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let period = "0,0,0,6.283185307179586,6.283185307179586,6.283185307179586";
    let cases = [
        ("double_gyre_unsteady.npy", &["--times", "0:0.5", "--box", "0,0,2,1"][..]),
        ("abc_unsteady_32.npy", &["--times", "0:1.2566370614359172", "--periodic", "--box", period]),
        ("arctic20_ocean_uv.npz", &["--box", "0,0,-3000,1800000,1000000,0"]),
    ];
    for (name, more) in cases {
        let path = reference(name);
        let source = path.to_str().unwrap();
        let common = ["build", source, "--trace", "--seeds", "1000", "--steps", "21", "-o", "flow.df"];
        ok(folder, &[&common[..], more].concat());
        ok(folder, &["verify", "flow.df"]);
        ok(
            folder,
            &[
                "render",
                "flow.df",
                "--mode",
                "paths",
                "--time",
                "step:10",
                "--backend",
                "cpu",
                "--size",
                "200x150",
                "-o",
                "a.png",
            ],
        );
        assert!(lit(&folder.join("a.png")) > 500, "{name}");
    }
}
