//! Shaders that are written while the window runs: a change is in the picture a moment later; a mistake is told, and the picture stays.

use super::desktop::{Desktop, Program, Screen, columns, middle, turn};
use crate::support::demo;
use serde_json::Value;
use std::path::Path;

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Writes `green`, which makes the picture green, in the place of `line` in a shader, and then a mistake.
fn write_while_the_window_runs(mode: &str, shader: &str, line: &str, green: &str) {
    let folder = tempfile::tempdir().unwrap();
    let shaders = folder.path().join("shaders");
    copy_folder(&Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders"), &shaders);
    let shader = shaders.join(shader);
    let text = std::fs::read_to_string(&shader).unwrap();
    assert_eq!(text.matches(line).count(), 1);
    let text = text.replace(line, green);
    let wrong = format!("{text}\nfn wrong() -> f32 {{ return 1u; }}\n");
    let place = format!("{}:{}:", shader.display(), text.lines().count() + 2);

    let desktop = Desktop::start();
    let arguments = ["--mode", mode, "--backend", "compute"];
    let assets = [("BEVY_ASSET_ROOT", folder.path())];
    let mut program = Program::open_with(&desktop, folder.path(), &demo(), [640, 240], &arguments, &assets);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    let share = |screen: &Screen, accept: fn([u8; 3]) -> bool| screen.share(columns(&first), accept);
    let is_green = |screen: &Screen| share(screen, |[r, g, b]| g > 40 && r < 20 && b < 20) > 0.05;
    let is_other = |screen: &Screen| share(screen, |[r, g, b]| r.max(b) > 40 && g > 0) > 0.05;
    desktop.wait("the picture", |screen| is_other(screen) && !is_green(screen));

    std::fs::write(&shader, text).unwrap();
    let said = |what: &str, status: &Value| status["messages"].to_string().contains(what);
    program.wait("the change is taken up", |status| said("wgsl: in use", status));
    desktop.wait("a green picture", |screen| is_green(screen) && !is_other(screen));

    std::fs::write(&shader, wrong).unwrap();
    let told = program.wait("the mistake is told", |status| said("the last good shader stays", status));
    assert!(said(&place, &told), "{place}: {told:#}");
    // A picture from elsewhere is drawn anew, by the shader that stays.
    let [x, y] = middle(&told);
    turn(&program, &desktop, &told, [x, y], [x + 60, y + 20]);
    program.wait("the picture converges", |status| status["converged"] == true);
    desktop.wait("a picture that is green still", |screen| is_green(screen) && !is_other(screen));
}

#[test]
fn splats_are_drawn_with_what_is_written() {
    let green = "shown(vec4(0.0, max(color.r, max(color.g, color.b)), 0.0, color.a), pixel)";
    write_while_the_window_runs("column-density", "composite/composite.wgsl", "shown(color, pixel)", green);
}

#[test]
fn volumes_are_drawn_with_what_is_written() {
    let [line, green] = ["color", "vec3(0.0, 1.0, 0.0)"].map(|color| format!("(*ray).color += share * {color};"));
    write_while_the_window_runs("volume", "volume/raycast.wgsl", &line, &green);
}
