//! A run that a simulation is still writing: its steps come into the window as they are written, and all else stays as it is.

use super::desktop::{Desktop, Program};
use crate::support::run;
use serde_json::Value;

#[test]
fn steps_appear_as_they_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["written", "out"] {
        std::fs::create_dir(folder.join(name)).unwrap();
    }
    let made = run(folder, &["synth", "orbits", "-n", "2000", "--steps", "4", "-o", "written/run"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let mut files: Vec<_> =
        std::fs::read_dir(folder.join("written")).unwrap().map(|file| file.unwrap().path()).collect();
    files.sort();
    let place = |i: usize| folder.join("out").join(files[i].file_name().unwrap());
    let write = |i: usize| std::fs::copy(&files[i], place(i)).unwrap();
    write(0);
    write(1);
    let desktop = Desktop::with_screen([960, 600]);
    let more = ["--follow-folder", "--backend", "cpu", "--mode", "column-density"];
    let mut program = Program::open(&desktop, folder, &folder.join("out"), [960, 600], &more);
    let has = |steps: u64| {
        move |status: &Value| {
            let is_settled = status["converged"] == true && status["time"]["there"] == true;
            is_settled && status["time"]["steps_ready"] == steps
        }
    };
    program.wait("the steps that are there", has(2));
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    desktop.press(u32::from('.'));
    let before = program.wait("the second step", |status| has(2)(status) && status["time"]["step"] == 1);
    write(2);
    let after = program.wait("a third one", has(3));
    for key in ["eye", "target", "mode"] {
        assert_eq!(before[key], after[key], "{key}");
    }
    assert_eq!((&before["time"]["time"], &after["time"]["step"]), (&after["time"]["time"], &1.into()));
    // What is not complete yet is waited for.
    let whole = std::fs::read(&files[3]).unwrap();
    std::fs::write(place(3), &whole[..whole.len() / 2]).unwrap();
    std::thread::sleep(std::time::Duration::from_secs(5));
    let half = program.status();
    assert_eq!(half["time"]["steps_ready"], 3, "{half:#}");
    assert_eq!(half["time"]["damaged"].as_array().map(Vec::len), Some(0));
    assert!(!half["messages"].to_string().contains("run_003"), "{}", half["messages"]);
    std::fs::write(place(3), &whole).unwrap();
    program.wait("the fourth one", has(4));
}
