//! The mode, the format and the shader as a user of this crate's program meets them.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on has failed")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn here(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn program(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_brightest"));
    command.current_dir(folder).env("XDG_CACHE_HOME", folder);
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    program(folder).args(arguments).output().unwrap()
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Renders the demo data and returns the picture's bytes, three or four a pixel.
fn render(folder: &Path, name: &str, options: &[&str]) -> Vec<u8> {
    let demo = here("../../assets/demo/lcdm64_z0.hdf5");
    let mut command = program(folder);
    command.arg("render").arg(demo).args(["-o", name, "--mode", "brightest", "--size", "120x80"]).args(options);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    pixels(&folder.join(name))
}

fn pixels(path: &Path) -> Vec<u8> {
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes
}

/// Mean difference of two pictures, of 255.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

#[test]
fn the_processor_draws_the_golden_image() {
    let folder = tempfile::tempdir().unwrap();
    let drawn = render(folder.path(), "picture.png", &["--backend", "cpu"]);
    let found = difference(&drawn, &pixels(&here("tests/golden/brightest.png")));
    assert!(found < 0.15, "differs by {found}/255");
    // A setting on, and the picture is another one.
    std::fs::write(folder.path().join("ripples.ron"), r#"(mode: "brightest", settings: {"ripples": 8.0})"#).unwrap();
    let rippled = render(folder.path(), "rippled.png", &["--backend", "cpu", "--config", "ripples.ron"]);
    assert!(difference(&rippled, &drawn) > 1.0);
}

#[cfg(feature = "viewer")]
#[test]
fn an_adapter_draws_the_golden_image() {
    let folder = tempfile::tempdir().unwrap();
    let drawn = render(folder.path(), "picture.png", &["--backend", "compute"]);
    let found = difference(&drawn, &pixels(&here("tests/golden/brightest.png")));
    assert!(found < 0.15, "differs by {found}/255");
    std::fs::write(folder.path().join("ripples.ron"), r#"(mode: "brightest", settings: {"ripples": 8.0})"#).unwrap();
    let [adapter, processor] = ["compute", "cpu"]
        .map(|backend| render(folder.path(), "rippled.png", &["--backend", backend, "--config", "ripples.ron"]));
    let found = difference(&adapter, &processor);
    assert!(found < 0.15, "ripples differ by {found}/255");
}

#[cfg(feature = "viewer")]
#[test]
fn the_shader_is_valid() {
    use brightest::adapter::SHADER;
    use deepfield::gpu::shaders::{ShaderFile, check};
    check(&[SHADER]).unwrap();
    let text: &'static str = SHADER.text.replace("value * particle.quantity", "value * particle.quantities").leak();
    let line = text.lines().position(|line| line.contains("particle.quantities")).unwrap() + 1;
    let wrong = check(&[ShaderFile { text, ..SHADER }]).unwrap_err();
    assert!(wrong.starts_with(&format!("brightest/brightest.wgsl:{line}:")), "{wrong}");
}

#[test]
fn the_mode_and_the_format_are_known_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| run(folder.path(), arguments);
    let modes = said(&run(&["modes"]));
    assert!(modes.contains("brightest\n") && modes.contains("ripples") && modes.contains("0 to 16"), "{modes}");
    let help = said(&run(&["--help"]));
    assert!(help.contains("brightest") && help.contains("xyz points"), "{help}");

    // Names and settings in RON.
    std::fs::write(folder.path().join("points.txt"), "xyz\n0 0 0 1\n1 0 0 2\n0 1 0 1\n0 0 1 1\n").unwrap();
    let scene = |mode: &str, settings: &str| {
        let text = format!("(version: 1, datasets: [(path: \"points.txt\")], mode: \"{mode}\", settings: {settings})");
        std::fs::write(folder.path().join("a.scene.ron"), text).unwrap();
        said(&run(&["render", "a.scene.ron", "-o", "a.png", "--size", "32x32", "--backend", "cpu"]))
    };
    let unknown = scene("nothing", "{}");
    assert!(unknown.contains("a.scene.ron:1:") && unknown.contains("cross-section, brightest"), "{unknown}");
    let setting = scene("brightest", "{\"ripple\": 1.0}");
    assert!(setting.contains("expected a setting of brightest: ripples, speed"), "{setting}");
    let value = scene("brightest", "{\"ripples\": 99.0}");
    assert!(value.contains("ripples") && value.contains("a number from 0 to 16"), "{value}");
    let fine = scene("brightest", "{\"ripples\": 2.0}");
    assert!(folder.path().join("a.png").exists(), "{fine}");

    std::fs::write(folder.path().join("points.txt"), "xyz\n0 0 0\n").unwrap();
    let short = said(&run(&["info", "points.txt"]));
    assert!(short.contains("points.txt") && short.contains("line 2"), "{short}");
    std::fs::write(folder.path().join("other.bin"), [0_u8, 1, 2, 3, 255]).unwrap();
    let other = said(&run(&["info", "other.bin"]));
    assert!(other.contains("xyz points"), "{other}");
}

#[test]
fn what_does_not_draw_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("points.txt"), "xyz\n0 0 0 1\n1 0 0 2\n0 1 0 1\n0 0 1 1\n").unwrap();
    let asked = ["render", "points.txt", "-o", "a.png", "--mode", "brightest", "--backend", "raster"];
    let output = run(folder.path(), &asked);
    assert!(!output.status.success());
    let expected = if cfg!(feature = "viewer") { "only compute and cpu draw the mode brightest" } else { "viewer" };
    assert!(said(&output).contains(expected), "{}", said(&output));
}

#[test]
fn a_tour_shows_it() {
    let folder = tempfile::tempdir().unwrap();
    let demo = here("../../assets/demo/lcdm64_z0.hdf5");
    let tour = format!(
        "(version: 1, dataset: (path: {:?}), size: (64, 48), keyframes: [\
         (around: (what: data), mode: \"brightest\", settings: {{\"ripples\": 1.0}}), \
         (after: 2.0, orbit: 20.0, settings: {{\"ripples\": 4.0}})])",
        demo.to_str().unwrap()
    );
    std::fs::write(folder.path().join("tour.ron"), tour).unwrap();
    let output = run(folder.path(), &["tour", "tour.ron", "--frame", "30", "still.png", "--backend", "cpu"]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(pixels(&folder.path().join("still.png")).iter().any(|&value| value > 40));
}
