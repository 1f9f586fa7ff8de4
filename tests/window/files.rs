//! A window without a file: its first page, paths that are typed where there are no dialogs, another process that has a file opened in it,
//! and the list of what was opened.

use super::desktop::{Desktop, HEIGHT, Program, WIDTH, keep, repeat};
use crate::support::{demo, program};
use std::path::Path;

const RETURN: u32 = 0xff0d;
const CONTROL: u32 = 0xffe3;
const SHIFT: u32 = 0xffe1;

#[test]
fn a_window_without_a_file_opens_one_and_another_process_hands_it_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first.hdf5", "second.hdf5"].map(|name| folder.path().join(name));
    std::fs::copy(demo(), &first).unwrap();
    std::fs::copy(demo(), &second).unwrap();
    let desktop = Desktop::start();
    // Neither a portal nor zenity: as on a machine without a desktop's services.
    let bare = [("DBUS_SESSION_BUS_ADDRESS", Path::new("unix:path=/nonexistent")), ("PATH", Path::new("/nonexistent"))];
    let mut window = Program::without_file(&desktop, folder.path(), [WIDTH, HEIGHT], &["--backend", "cpu"], &bare);
    let page = window.wait("the first page", |status| status["first_page"] == true);
    for control in ["page:open", "page:open-folder", "page:demo"] {
        assert!(page["controls"][control].is_array(), "{control}: {page:#}");
    }
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    keep(&desktop, "first-page.png");

    let open = || desktop.press_with(&[CONTROL], u32::from('o'));
    let typing = repeat(&window, "Ctrl+O", open, |status| status["typing"] == true);
    let told = typing["messages"].to_string();
    assert!(told.contains("no file dialog"), "{told}");
    desktop.type_text("first.hdf5");
    desktop.press(RETURN);
    let is_open = |name: &'static str| {
        move |status: &serde_json::Value| status["open"].as_str().is_some_and(|path| path.ends_with(name))
    };
    let opened = window.wait("the file that was typed", is_open("first.hdf5"));
    assert!(opened["first_page"] == false && opened["typing"] == false, "{opened:#}");

    let save_as = || desktop.press_with(&[CONTROL, SHIFT], u32::from('s'));
    repeat(&window, "Ctrl+Shift+S", save_as, |status| status["typing"] == true);
    desktop.type_text("kept");
    desktop.press(RETURN);
    let is_kept =
        |status: &serde_json::Value| status["scene"].as_str().is_some_and(|path| path.ends_with("kept.scene.ron"));
    window.wait("the scene under the name that was typed", is_kept);
    let scene = std::fs::read_to_string(folder.path().join("kept.scene.ron")).unwrap();
    assert!(scene.contains("path: \"first.hdf5\""), "{scene}");

    let reused = program()
        .arg("view")
        .arg(&second)
        .arg("--reuse")
        .current_dir(folder.path())
        .envs(["XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_RUNTIME_DIR"].map(|name| (name, folder.path())))
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    assert!(reused.status.success() && reused.stdout.is_empty(), "{reused:?}");
    window.wait("the file that was handed over", is_open("second.hdf5"));

    let list = folder.path().join("deepfield").join("recent.ron");
    window.wait("the list of what was opened", |_| {
        let text = std::fs::read_to_string(&list).unwrap_or_default();
        matches!((text.find("second.hdf5"), text.find("first.hdf5")), (Some(latest), Some(before)) if latest < before)
    });
}
