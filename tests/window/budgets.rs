//! Budgets of memory under a stress that fills them: one flies through more than they allow, and they hold at every moment.

use super::desktop::{Desktop, PATIENCE, Program, Screen, columns, middle};
use crate::support::{demo, program};
use serde_json::Value;
use std::path::Path;
use std::time::{Duration, Instant};

/// MiB for pages in main memory and for the adapter's, of which volumes and lists have the half: less than the particles take.
const BUDGETS: [u64; 2] = [16, 32];
/// Particles, of some seven bytes each on disk.
const PARTICLES: &str = "3e6";

fn run(arguments: &[&str], folder: &Path) {
    let status = program().args(arguments).current_dir(folder).status().unwrap();
    assert!(status.success(), "{arguments:?}");
}

/// Of windows without panels: an adapter in software draws them.
const SIZE: [u16; 2] = [336, 240];
const NO_PANELS: &str = "panels: (shown: false, closed: [])";

/// Buttons of the mouse wheel.
const NEARER: u8 = 4;
const FARTHER: u8 = 5;

fn wheel(desktop: &Desktop, at: [i16; 2], button: u8) {
    desktop.fake_input(6, 0, at);
    for _ in 0..4 {
        desktop.fake_input(4, button, [0; 2]);
        desktop.fake_input(5, button, [0; 2]);
    }
}

/// What is held, and what may be.
fn bytes(status: &Value, name: &str) -> [u64; 2] {
    let pair = &status["memory"][name];
    [0, 1].map(|index: usize| pair[index].as_u64().unwrap_or_else(|| panic!("{name}: {status:#}")))
}

#[test]
fn budgets_hold_while_one_flies_through_more_than_they_allow() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(&["synth", "merger", "-n", PARTICLES, "-o", "merger.gadget2"], folder);
    run(&["build", "merger.gadget2", "-o", "merger.df"], folder);
    let file = folder.join("merger.df");
    let [pages_mib, adapter_mib] = BUDGETS;
    assert!(file.metadata().unwrap().len() > pages_mib.max(adapter_mib / 2) << 20, "the budgets hold the whole file");
    std::fs::create_dir(folder.join("configs")).unwrap();
    let preset = format!(
        "(residency: (budget_mib: {pages_mib}, gpu_budget_mib: {adapter_mib}, upload_mib: 1), drawing: (error_px: 0.3))"
    );
    std::fs::write(folder.join("configs/laptop.ron"), preset).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    for mode in ["column-density", "volume", "sorted-splats", "layered"] {
        let scene = folder.join("stress.scene.ron");
        // With more layers the lists of slabs alone take as much.
        let settings = if mode == "layered" { r#"{"layers": 16}"# } else { "{}" };
        let text =
            format!(r#"(version: 1, datasets: [(path: {file:?})], mode: "{mode}", settings: {settings}, {NO_PANELS})"#);
        std::fs::write(&scene, text).unwrap();
        let arguments = ["--backend", "compute", "--preset", "laptop"];
        let variables = [("BEVY_ASSET_ROOT", folder)];
        let mut program = Program::open_with(&desktop, folder, &scene, SIZE, &arguments, &variables);
        let first = program.wait("a picture", |status| status["particles_drawn"].as_u64() > Some(0));
        let is_lit = |screen: &Screen| screen.share(columns(&first), |[r, g, b]| r.max(g).max(b) > 40) > 0.06;
        desktop.wait("the picture", is_lit);
        let [x, y] = middle(&first);
        // Of pages and copies as a share of what they may be, of what volumes and lists work in as bytes.
        let mut most = [0.0, 0.0, 0.0];
        let look = |program: &Program, most: &mut [f64; 3]| {
            let status = program.status();
            // A file that is being replaced reads as nothing.
            if status.is_null() {
                return;
            }
            for (index, name) in ["pages", "copies"].into_iter().enumerate() {
                let [held, allowed] = bytes(&status, name);
                assert!(held <= allowed && allowed <= BUDGETS[index] << 20, "{mode}: {name}: {status:#}");
                most[index] = most[index].max(held as f64 / allowed as f64);
            }
            let volumes = status["memory"]["volumes"].as_u64().unwrap();
            assert!(volumes <= (adapter_mib << 17).max(16 << 20), "{mode}: volumes: {status:#}");
            most[2] = most[2].max(volumes as f64);
            assert_eq!(status["decoded"], 0, "{mode}: {status:#}");
        };
        // Near, around and away again, so that pages come and go.
        let start = Instant::now();
        for step in 0.. {
            match step % 4 {
                0 => desktop.drag([x, y], [x + 90, y + 15]),
                1 => wheel(&desktop, [x, y], NEARER),
                2 => desktop.drag([x, y], [x - 50, y - 30]),
                _ if step % 8 == 3 => wheel(&desktop, [x, y], NEARER),
                _ => wheel(&desktop, [x, y], FARTHER),
            }
            for _ in 0..6 {
                std::thread::sleep(Duration::from_millis(80));
                look(&program, &mut most);
            }
            if step >= 7 && most[0] > 0.5 && most[1] > 0.5 {
                break;
            }
            assert!(start.elapsed() < PATIENCE, "{mode}: the budgets are not filled: {most:?}");
        }
        assert_eq!(most[2] > 0.0, mode != "column-density", "{mode}: {most:?}");
        println!("{mode}: at most {most:?} of pages, copies, volumes");
        desktop.wait("the picture after it all", |screen| {
            screen.share(columns(&first), |[r, g, b]| r.max(g).max(b) > 20) > 0.015
        });
    }
}

#[test]
fn a_grid_that_does_not_fit_is_drawn_with_fewer_cells() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("configs")).unwrap();
    std::fs::write(folder.join("configs/laptop.ron"), "(residency: (gpu_budget_mib: 32))").unwrap();
    let scene = folder.join("grid.scene.ron");
    let text = format!(r#"(version: 1, datasets: [(path: {:?})], mode: "cartesian", {NO_PANELS})"#, demo());
    std::fs::write(&scene, text).unwrap();
    let desktop = Desktop::with_screen(SIZE);
    let arguments = ["--backend", "compute", "--preset", "laptop"];
    let variables = [("BEVY_ASSET_ROOT", folder)];
    let mut program = Program::open_with(&desktop, folder, &scene, SIZE, &arguments, &variables);
    let is_told = |status: &Value| {
        let messages = status["messages"].as_array().into_iter().flatten();
        messages.filter_map(Value::as_str).any(|message| message.contains("too small for so many cells"))
    };
    let drawn = program.wait("a converged picture", |status| status["converged"] == true);
    assert!(is_told(&drawn), "{drawn:#}");
    assert!(drawn["memory"]["volumes"].as_u64().unwrap() <= 16 << 20, "{drawn:#}");
    assert_eq!(drawn["decoded"], 0, "{drawn:#}");
    desktop.wait("the picture", |screen| screen.share(columns(&drawn), |[r, g, b]| r.max(g).max(b) > 40) > 0.06);
}
