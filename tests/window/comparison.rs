//! Two hierarchies of a file side by side in the window, driven as a user would; and the levels of the picture itself.

use super::desktop::{Desktop, Program, Screen, choose, click, columns, keep, repeat};
use crate::support::{demo, kept_page_file, run};
use serde_json::Value;
use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

/// Few pixels, since an adapter in software draws the window.
const SIZE: [u16; 2] = [960, 540];
const F6: u32 = 0xffc3;
const RIGHT: u32 = 0xff53;

fn found(status: &Value) -> Option<([u64; 2], f64)> {
    let found = &status["comparison"][0];
    let splats = |side: usize| found["splats"][side].as_u64();
    Some(([splats(0)?, splats(1)?], found["color_error"].as_f64()?))
}

fn divider(status: &Value) -> f64 {
    status["comparison"][1].as_f64().unwrap_or(f64::NAN)
}

/// A scene of the demo data with both hierarchies, in which these sections of the panels are closed.
fn with_clusters(folder: &Path, closed: &str) -> std::path::PathBuf {
    let kept = kept_page_file("demo-of-both", |path| {
        let (source, output) = (demo(), path.to_str().unwrap());
        let both = ["build", source.to_str().unwrap(), "-o", output, "--hierarchy", "octree,pca"];
        let built = run(folder, &both);
        assert!(built.status.success(), "{built:?}");
    });
    std::fs::write(folder.join("both.df"), kept).unwrap();
    let scene = folder.join("both.scene.ron");
    let text = format!("(version: 1, datasets: [(path: \"both.df\")], panels: (closed: [{closed}]))");
    std::fs::write(&scene, text).unwrap();
    scene
}

#[test]
fn two_hierarchies_stand_at_both_sides_of_a_divider() {
    let folder = tempfile::tempdir().unwrap();
    let file = with_clusters(folder.path(), r#""data", "mode", "transfer", "view""#);
    let desktop = Desktop::with_screen(SIZE);
    let mut program = Program::open(&desktop, folder.path(), &file, SIZE, &["--backend", "cpu"]);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    assert!(found(&first).is_none());

    let both = click(&program, &desktop, "compare", |status| found(status).is_some());
    let ([few, clusters], apart) = found(&both).unwrap();
    // The octree's first node has more.
    assert!(few > clusters && (19_000..=20_000).contains(&clusters), "{few} {clusters}");
    assert!(apart > 0.1 && divider(&both) == 0.5, "{both:#}");
    keep(&desktop, "comparison.png");

    // The divider follows the pointer, and the camera stays where it is.
    let rows = both["picture"][3].as_f64().unwrap() as usize / 2;
    let drag = || {
        // It is there while the pictures are those of the view.
        let Some([x, y]) = program.control("divider") else { return };
        // The frame that finds the pointer over it comes before the one in which it is pressed.
        desktop.fake_input(6, 0, [x, y + 60]);
        std::thread::sleep(Duration::from_millis(1000));
        desktop.drag([x, y + 60], [x - 150, y + 60]);
        // A second drag from where it was would turn the camera.
        let start = Instant::now();
        while divider(&program.status()) == 0.5 && start.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    let moved = repeat(&program, "a drag of the divider", drag, |status| divider(status) < 0.45);
    assert_eq!((&moved["eye"], &moved["target"]), (&both["eye"], &both["target"]));

    // F6 goes from the left dock to the right one and on to the divider, which arrow keys move.
    let walk = || {
        for key in [F6, F6, F6, RIGHT] {
            desktop.press(key);
            // A frame that sees two presses of a key takes one step.
            std::thread::sleep(Duration::from_millis(700));
        }
    };
    let dragged = divider(&moved);
    repeat(&program, "keys for the divider", walk, |status| divider(status) > dragged + 0.005);

    // What is the same at both sides does not differ: its difference is black.
    let screen = desktop.screenshot();
    let light = |screen: &Screen| -> u64 {
        // Between what is written at the picture's edges.
        let Range { start, end } = columns(&both);
        let row = ((2 * start + end) / 3..(start + 2 * end) / 3).map(|x| screen.at(x, rows));
        row.map(|pixel| pixel.iter().map(|value| u64::from(*value)).sum::<u64>()).sum()
    };
    assert!(light(&screen) > 0);
    let same =
        choose(&program, &desktop, "left", "left:pca", |status| found(status).is_some_and(|found| found.1 == 0.0));
    assert_eq!(found(&same).unwrap().0, [clusters; 2]);
    // Until the pictures are there no divider is, and that says nothing of what is shown.
    program.wait("both pictures", |status| status["controls"]["divider"].is_array());
    click(&program, &desktop, "difference", |status| found(status).is_some() && program.control("divider").is_none());
    desktop.wait("a black difference", |screen| light(screen) == 0);

    // Without a comparison the window's own picture is there again.
    click(&program, &desktop, "compare", |status| found(status).is_none());
    desktop.wait("the window's own picture", |screen| light(screen) > 0);
    desktop.close(desktop.window().unwrap());
    assert_eq!(program.exit_code(), Some(0));
}

#[test]
fn the_window_draws_the_levels_that_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let file = with_clusters(folder.path(), r#""data", "transfer", "view""#);
    let desktop = Desktop::with_screen(SIZE);
    for backend in ["cpu", "compute"] {
        let mut program = Program::open(&desktop, folder.path(), &file, SIZE, &["--backend", backend]);
        let all = program.wait("a converged picture", |status| status["converged"] == true);
        assert_eq!((&all["levels"], &all["backend"]), (&"splats".into(), &backend.into()));
        desktop.focus(desktop.window().expect("a window of the size that was asked for"));
        choose(&program, &desktop, "levels", "levels:clusters", |status| status["levels"] == "clusters");
        let type_number = || {
            desktop.click(program.reveal(&desktop, "splats:field"));
            std::thread::sleep(Duration::from_millis(400));
            desktop.press_with(&[0xffe3], u32::from('a'));
            desktop.type_text("3000");
            desktop.press(0xff0d);
        };
        let few = repeat(&program, "a number of splats", type_number, |status| {
            status["particles_drawn"].as_u64().is_some_and(|drawn| drawn <= 3000) && status["converged"] == true
        });
        assert!(few["particles_drawn"].as_u64() >= Some(2850) && few["levels"] == "clusters", "{few:#}");
        desktop.close(desktop.window().unwrap());
        assert_eq!(program.exit_code(), Some(0));
    }
}
