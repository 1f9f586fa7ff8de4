//! Settings of volumes that make no sense, given to the program as a user gives them: one line that names the field, and no
//! picture.

use crate::support::{json, run};
use std::path::Path;
use std::sync::OnceLock;

/// Every mode that draws colours straight from particles.
const MODES: [&str; 7] =
    ["volume", "isosurface", "volume-isosurface", "layered", "sorted-splats", "spheres", "cartesian"];

/// A folder with a small snapshot, `merger`.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let made = run(folder.path(), &["synth", "merger", "-n", "1500", "-o", "merger"]);
            assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
            folder
        })
        .path()
}

/// Renders with a configuration; what it says on standard error if it fails.
fn render(name: &str, config: &str) -> Result<(), String> {
    let folder = folder();
    let (file, picture) = (format!("{name}.ron"), format!("{name}.png"));
    std::fs::write(folder.join(&file), config).unwrap();
    // A graphics driver may have something to say of its own.
    let arguments =
        ["render", "merger", "-o", &picture, "--exact", "--backend", "cpu", "--size", "48x32", "--config", &file];
    let output = run(folder, &arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(folder.join(&picture).exists(), output.status.success(), "{name}: {told}");
    match output.status.success() {
        true => Ok(()),
        false => {
            assert_eq!(output.status.code(), Some(1), "{name}: {told}");
            assert_eq!(told.lines().count(), 1, "{name}: {told}");
            assert!(told.contains(&file), "{name} does not name the file: {told}");
            Err(told)
        }
    }
}

/// Renders what must fail with a message that has these parts.
fn fails(name: &str, config: &str, parts: &[&str]) {
    let told = render(name, config).expect_err(name);
    assert!(parts.iter().all(|part| told.contains(part)), "{name}: {told}");
}

#[test]
fn every_mode_draws_with_its_defaults() {
    for mode in MODES {
        render(&format!("fine-{mode}"), &format!("(mode: \"{mode}\")")).unwrap_or_else(|told| panic!("{mode}: {told}"));
    }
}

#[test]
fn fields_of_attributes_are_drawn() {
    for (name, mode, settings) in [
        ("heat", "volume", r#""field": "internal-energy""#),
        ("heat-sum", "volume", r#""field": "internal-energy", "field-sum": "plain", "volume-lighting": true"#),
        ("hot", "isosurface", r#""surface-field": "internal-energy""#),
        ("dense-in-heat", "volume-isosurface", r#""field": "internal-energy""#),
        ("hot-in-gas", "volume-isosurface", r#""surface-field": "internal-energy""#),
        ("large", "volume", r#""field": "smoothing-length""#),
    ] {
        let config = format!("(mode: \"{mode}\", family: gas, settings: {{{settings}}})");
        render(name, &config).unwrap_or_else(|told| panic!("{name}: {told}"));
    }
}

#[test]
fn planes_that_make_no_sense_are_named_by_every_mode() {
    for mode in MODES {
        let with = |settings: &str| format!("(mode: \"{mode}\", settings: {{{settings}}})");
        let behind = with(r#""near": 500.0, "far": 300.0"#);
        fails(&format!("planes-{mode}"), &behind, &["near is 500, expected a depth in front of far, which is 300"]);
        let negative = with(r#""near": -1.0"#);
        fails(&format!("negative-{mode}"), &negative, &["near: found -1, expected a number from 0"]);
        let beyond = with(r#""far": 0.001"#);
        fails(&format!("beyond-{mode}"), &beyond, &["no particles are in view"]);
    }
}

#[test]
fn an_empty_view_names_the_camera() {
    for mode in MODES {
        let away = format!("(mode: \"{mode}\", camera: (eye: (9e3, 0.0, 0.0), target: (9e4, 0.0, 0.0)))");
        fails(&format!("away-{mode}"), &away, &["eye, target: no particles are in view"]);
    }
}

#[test]
fn transfer_functions_and_kernels_are_checked() {
    for mode in MODES {
        let unsorted =
            format!("(mode: \"{mode}\",\n volume: (opacity: [(0.5, 0.1), (0.2, 0.4)], brightness: [(0.0, 1.0)]))");
        let parts = [".ron:2:", "opacity: points are not sorted: 0.5 comes before 0.2"];
        fails(&format!("unsorted-{mode}"), &unsorted, &parts);
        let range = format!(
            "(mode: \"{mode}\",\n volume: (range: fixed(3.0, 1.0), opacity: [(0.0, 0.1)], brightness: [(0.0, 1.0)]))"
        );
        fails(&format!("range-{mode}"), &range, &[".ron:2:", "range"]);
        if mode != "spheres" {
            let kernel = format!("(mode: \"{mode}\", settings: {{\"kernel\": \"gauss\"}})");
            let parts = ["kernel: found gauss, expected one of data, cubic-spline, poly6"];
            fails(&format!("kernel-{mode}"), &kernel, &parts);
        }
    }
}

#[test]
fn surfaces_that_cannot_be_there_are_named() {
    for (mode, content) in
        [("isosurface", ""), ("volume-isosurface", ""), ("cartesian", "\"content\": \"isosurface\", ")]
    {
        let with = |settings: &str| format!("(mode: \"{mode}\", settings: {{{content}{settings}}})");
        let parts = ["isovalues[1] is 1000000", "expected a density greater than 0 and at most the data's largest"];
        fails(&format!("iso-{mode}"), &with(r#""isovalues": [1e-9, 1e6]"#), &parts);
        let parts = ["isovalues[0] is -1", "expected a density greater than 0"];
        fails(&format!("iso-negative-{mode}"), &with(r#""isovalues": [-1.0]"#), &parts);
        let lists = with(r#""isovalues": [1e-9], "iso-opacities": [0.5, 1.0]"#);
        let parts = ["iso-opacities is a list of 2, expected as many as isovalues, 1"];
        fails(&format!("iso-lists-{mode}"), &lists, &parts);
    }
    let thin = "(mode: \"spheres\", settings: {\"threshold\": 1e6})";
    fails("thin", thin, &["threshold is 1000000, expected a density of at most the data's largest"]);
}

#[test]
fn numbers_of_layers_and_cells_are_checked() {
    let parts = ["layers: found 0, expected a number from 1 to 4096"];
    fails("layers", "(mode: \"layered\", settings: {\"layers\": 0.0})", &parts);
    fails(
        "assignment",
        "(mode: \"layered\", settings: {\"assignment\": \"all\"})",
        &["assignment: found all, expected one of"],
    );
    let parts = ["cells: found 0, expected a number from 2 to 4096"];
    fails("no-cells", "(mode: \"cartesian\", settings: {\"cells\": 0.0})", &parts);
    let large = "(mode: \"cartesian\", settings: {\"cells\": 4096.0, \"memory\": 64.0})";
    fails("cells", large, &["cells is 4096, expected fewer: a grid of", "and memory is 64 MiB"]);
    fails("resolution", "(mode: \"volume\", settings: {\"resolution\": 0.0})", &["resolution: found 0, expected"]);
    fails("radius", "(mode: \"spheres\", settings: {\"sphere-radius\": 0.0})", &["sphere-radius: found 0, expected"]);
    let others = "(mode: \"sorted-splats\", settings: {\"layers\": 3.0})";
    fails("others", others, &["layers, expected a setting of sorted-splats: opacity, occlusion, near, far"]);
}

#[test]
fn a_comparison_writes_every_picture_and_its_errors() {
    let folder = folder();
    let arguments = ["bench", "compare", "merger", "--size", "60x40", "--eye", "60,120,225", "--target", "0,0,0"];
    let more = ["--repeat", "1", "--layers", "64", "--cells", "48", "--frames", "2", "--output", "out", "--json", "-"];
    let report = json(folder, &[&arguments[..], &more[..]].concat());
    let error = |name: &str, kind: &str| {
        let outcomes = report["outcomes"].as_array().unwrap();
        let outcome = outcomes.iter().find(|outcome| outcome["name"] == name).unwrap();
        outcome[kind].as_f64().unwrap()
    };
    assert!(error("volume", "error_volume") < 1.0 && error("layered, 64 layers", "error_volume") < 5.0, "{report:#}");
    assert!(error("isosurface", "error_surface") < error("spheres", "error_surface"), "{report:#}");
    for file in
        ["compare.png", "volume.png", "spheres.png", "cartesian-48-cells-isosurface.png", "reference-volume.png"]
    {
        assert!(folder.join("out").join(file).exists(), "{file}");
    }
    for (table, rows) in [("compare.csv", 9), ("orbit.csv", 5)] {
        assert_eq!(std::fs::read_to_string(folder.join("out").join(table)).unwrap().lines().count(), 1 + rows);
    }
}
