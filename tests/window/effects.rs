//! Vectors over slices, shadows and bloom in the window: at rest its pictures are those that `deepfield render` writes of the same scenes.

use super::desktop::{Desktop, Program, keep};
use super::fields::{balls, difference, is_off, render};
use crate::support::text;

const SIZE: [u16; 2] = [400, 250];

// Particles with velocities, and a volume: the file, and where it is seen from.
const MERGER: [&str; 2] = ["flow.df", "eye: (70.0, 35.0, 150.0), target: (0.0, 0.0, 0.0)"];
const BALLS: [&str; 2] = ["balls.nrrd", "eye: (25.0, 20.0, 40.0), target: (9.0, 9.0, 8.0)"];

#[test]
fn vectors_shadows_and_bloom_are_those_of_files() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    balls(&folder.join("balls.nrrd"));
    text(folder, &["synth", "merger", "-n", "3000", "-o", "merger.g2"]);
    text(folder, &["build", "merger.g2", "-o", "flow.df", "--attributes", "velocity-x,velocity-y,velocity-z"]);
    let slice = r#"settings: {"through": [0, 0, 0]}"#;
    let arrows = r#"settings: {"through": [0, 0, 0], "vectors": "arrows", "vector-spacing": 20.0}"#;
    let streaks = r#"settings: {"through": [0, 0, 0], "vectors": "lic"}"#;
    let dark = r#"settings: {"ambient-occlusion": 0.8, "shadows": 0.7, "light-samples": 6}"#;
    // What the window leaves undrawn of sums, files have.
    let all = r#"budget: {"thinning": 0.0}"#;
    let bloom = "bloom: (strength: 0.6, threshold: 0.2, radius: 0.1)";
    let adaptive = format!("{all}, exposure: adaptive(bright: 0.1, dark: 0.2)");
    let glow = format!("{adaptive}, {bloom}");
    // What a scene says, and the same without what is looked at.
    let scenes = [
        (MERGER, "cross-section", [arrows, slice], ["cpu"; 2]),
        // Planes are the processor's.
        (MERGER, "cross-section", [streaks, slice], ["compute", "cpu"]),
        (MERGER, "spheres", [dark, "settings: {}"], ["cpu"; 2]),
        (MERGER, "column-density", [&*glow, &*adaptive], ["cpu"; 2]),
        (BALLS, "volume", [bloom, "settings: {}"], ["compute"; 2]),
    ];
    for (number, ([data, camera], mode, says, [asked, draws])) in scenes.into_iter().enumerate() {
        let [with, without] = ["with.scene.ron", "without.scene.ron"].map(|name| folder.join(name));
        for (scene, more) in [&with, &without].into_iter().zip(says) {
            let text = format!(
                "(version: 2, datasets: [(path: {data:?})], mode: {mode:?}, size: ({}, {}), error_px: 0.5, \
                 camera: ({camera}, fov: 30.0), panels: (shown: false, closed: []), \
                 annotations: (legend: false, scale_bar: false), {more})",
                SIZE[0], SIZE[1]
            );
            std::fs::write(scene, text).unwrap();
        }
        let [expected, plain] = [&with, &without].map(|scene| render(folder, scene, "cpu", SIZE));
        // More of what is compared below than may be off there.
        let compared = 3 * expected.len() / 4;
        let pairs = expected.iter().zip(&plain).take(compared);
        let changed = pairs.filter(|(with, without)| is_off(**with, **without)).count();
        assert!(200 * changed > 3 * compared, "{mode} {number}: {changed} of {compared} pixels show it");
        let desktop = Desktop::with_screen(SIZE);
        let mut program = Program::open(&desktop, folder, &with, SIZE, &["--backend", asked]);
        let status = program.wait("a converged picture", |status| status["converged"] == true);
        assert_eq!((&status["mode"], &status["backend"]), (&mode.into(), &draws.into()), "{status:#}");
        keep(&desktop, &format!("effects-{number}-{mode}.png"));
        desktop.wait("the rendered picture", |screen| difference(screen, &expected, SIZE) < 0.01);
    }
}
