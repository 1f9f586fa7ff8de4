//! What the picture hides is left out while the camera moves, and the picture at rest is the one that everything gives.

use super::desktop::{Desktop, Program, columns, distance, point};
use crate::support::eclipse;
use deepfield::build::{BuildOptions, build};
use deepfield::hierarchy::OctreeOptions;
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

/// Of a window without panels: an adapter in software draws half of them.
const SIZE: [u16; 2] = [252, 180];

/// The pixels of the picture at two places, but for where messages come and go, and the status there.
fn fly(folder: &Path, file: &Path, (mode, backend): (&str, &str), occlusion: bool) -> Vec<(Vec<[u8; 3]>, Value)> {
    // The automatic threshold lies above the densities, which are not in the unit of the masses.
    let own = if mode == "spheres" { r#", "threshold": 0.5"# } else { "" };
    // Nothing is written over the pictures: letters differ by one of 255 with when the window's fonts first met them.
    let scene = format!(
        r#"(version: 1, datasets: [(path: {file:?})], mode: "{mode}", error_px: 0.2,
            settings: {{"near": 0.5, "far": 8.0, "occlusion": {occlusion}{own}}},
            transfer: (range: fixed(1e-2, 1e2), unit_length: fixed(1e-4), opacity: [(0.0, 0.0), (0.01, 0.5)],
                       brightness: [(0.0, 1.0)]),
            annotations: (legend: false, scale_bar: false), panels: (shown: false, closed: []),
            camera: (eye: (0.0, 0.0, 3.0), target: (0.0, 0.0, 0.0), fov: 34.0),
            bookmarks: [(key: 1, name: "aside", camera: (eye: (0.4, 0.1, 2.9), target: (0.0, 0.0, 0.0), fov: 34.0))])"#
    );
    let path = folder.join("eclipse.scene.ron");
    std::fs::write(&path, scene).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let mut program = Program::open(&desktop, folder, &path, SIZE, &["--backend", backend]);
    let places = [([0.0, 0.0, 3.0], None), ([0.4, 0.1, 2.9], Some('1'))];
    let stops = places.into_iter().map(|(eye, key)| {
        if let Some(key) = key {
            desktop.focus(desktop.window().expect("a window of the size that was asked for"));
            desktop.press(u32::from(key));
        }
        let is_there = |status: &Value| distance(point(status, "eye"), eye) < 1e-6;
        let status = program.wait("a converged picture", |status| status["converged"] == true && is_there(status));
        // It stays as it is: pictures and what they hide do not chase each other.
        std::thread::sleep(Duration::from_millis(1500));
        let later = program.status();
        assert_eq!((&later["converged"], &later["nodes_hidden"]), (&Value::from(true), &status["nodes_hidden"]));
        let screen = desktop.wait("the picture", |_| true);
        let rows = 80..usize::from(SIZE[1]);
        let pixels = columns(&status).flat_map(|x| rows.clone().map(move |y| (x, y))).map(|(x, y)| screen.at(x, y));
        (pixels.collect(), status)
    });
    stops.collect()
}

#[test]
fn pictures_at_rest_are_those_of_everything_after_the_camera_has_moved() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("eclipse.df");
    let octree = OctreeOptions { leaf_capacity: 200, volume_levels: true, ..OctreeOptions::default() };
    build(eclipse(), &BuildOptions { octree, ..BuildOptions::default() }, &file, &()).unwrap();
    // Each backend once: a window takes long, and what either hides without one, in each mode, is tested beside it.
    for (mode, backend) in [("spheres", "cpu"), ("volume", "compute")] {
        let [found, all] = [true, false].map(|occlusion| fly(folder.path(), &file, (mode, backend), occlusion));
        for ((found, at), (all, everything)) in found.iter().zip(&all) {
            let pairs = found.as_flattened().iter().zip(all.as_flattened());
            let unlike = pairs.enumerate().filter(|(_, (a, b))| a != b);
            let unlike: Vec<(usize, (&u8, &u8))> = unlike.collect();
            let first = &unlike[..unlike.len().min(8)];
            let (here, there) = (&at["eye"], &everything["eye"]);
            let count = unlike.len();
            assert!(count == 0, "{mode} by {backend}, {count} channels, {first:?}, {here} and {there}: {at:#}");
            let is_hidden = at["nodes_hidden"].as_u64().unwrap() > 0;
            assert!(is_hidden && everything["nodes_hidden"] == 0, "{mode} by {backend}: {at:#}");
            let particles = |status: &Value| status["particles_drawn"].as_u64().unwrap();
            assert!(particles(at) < particles(everything), "{mode} by {backend}: {at:#}");
        }
    }
}
