//! What the program does with flights and faults on the command line: pictures that streamed in are those that were
//! waited for, and `render` says what it could not read.

use super::disk::{offset_of, sound};
use crate::support::{program, run};
use serde_json::Value;
use std::io::{Seek, SeekFrom, Write};

#[test]
fn a_flight_writes_its_series_and_its_pictures_are_those_that_were_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sound.df"), sound()).unwrap();
    let arguments = ["bench", "flight", "sound.df", "--backends", "cpu", "--duration", "2", "--velocity", "0.1"];
    let more = ["--size", "160x120", "--check", "2", "--main-memory", "40MiB", "--json", "-"];
    let output = run(folder.path(), &[&arguments[..], &more[..]].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    let outcome: Value = serde_json::from_slice(&output.stdout).unwrap();
    let outcome = &outcome[0];
    assert!(outcome["first_picture_s"].as_f64().unwrap() <= outcome["converged_s"].as_f64().unwrap());
    assert!(outcome["flight"]["frames"].as_u64().unwrap() > 2);
    for check in outcome["checks"].as_array().unwrap() {
        assert_eq!(check["converged"], true, "{outcome:#}");
        assert_eq!(check["difference"].as_f64().unwrap(), 0.0, "{outcome:#}");
    }
    let series = std::fs::read_to_string(folder.path().join("flight/flight-cpu.csv")).unwrap();
    assert_eq!(series.lines().count() as u64, 1 + outcome["flight"]["frames"].as_u64().unwrap());
    assert!(std::fs::read_to_string(folder.path().join("flight/flight-cpu.svg")).unwrap().contains("<polyline"));
}

#[test]
fn modes_that_draw_light_are_flown_with_too() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sound.df"), sound()).unwrap();
    let arguments = ["bench", "flight", "sound.df", "--backends", "cpu", "--mode", "volume", "--duration", "1"];
    let more = ["--velocity", "0.1", "--size", "80x60", "--check", "1", "--json", "-"];
    let output = run(folder.path(), &[&arguments[..], &more[..]].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    let outcome: Value = serde_json::from_slice(&output.stdout).unwrap();
    let check = &outcome[0]["checks"][0];
    assert_eq!((&check["converged"], check["difference"].as_f64()), (&Value::Bool(true), Some(0.0)), "{outcome:#}");
    assert!(check["overdraw"].is_null(), "{outcome:#}");
    // The picture is that of `render` in kind: it is no black one.
    let picture = folder.path().join("flight/flight-cpu-0s-whole.png");
    assert!(picture.metadata().unwrap().len() > 500, "an empty picture");
}

#[test]
fn without_a_display_nothing_is_printed_and_the_processor_asks_for_no_adapter() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sound.df"), sound()).unwrap();
    let render = |backend: &[&str], loader_tells: &str| {
        let arguments = ["render", "sound.df", "-o", "p.png", "--size", "60x40"];
        let mut command = program();
        command.args(arguments).args(backend).current_dir(folder.path()).env("VK_LOADER_DEBUG", loader_tells);
        for name in ["DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR", "NODEVICE_SELECT"] {
            command.env_remove(name);
        }
        let output = command.output().unwrap();
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    // Vulkan's loader would say so.
    assert_eq!(render(&["--backend", "cpu"], "all"), (true, String::new()));
    assert_eq!(render(&[], "none"), (true, String::new()));
    let (drawn, told) = render(&["--backend", "compute"], "none");
    assert!(told.is_empty() || !drawn && told.lines().count() == 1, "{told}");
}

#[test]
fn render_says_which_page_is_damaged_and_draws_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.df");
    std::fs::write(&path, sound()).unwrap();
    let pages = deepfield::store::PageFile::open(&path).unwrap().page_count();
    let bad = pages - 1;
    let mut open = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    open.seek(SeekFrom::Start(offset_of(sound(), deepfield::store::PageId(bad)) + 700)).unwrap();
    open.write_all(&[0xa5, 0x5a, 0xa5]).unwrap();
    let arguments = ["render", "bad.df", "-o", "p.png", "--backend", "cpu", "--size", "200x150", "--error-px", "0.01"];
    let output = run(folder.path(), &[&arguments[..], &["--json", "-"]].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    assert!(told.lines().count() == 1 && told.contains(&format!("page {bad}")) && told.contains("checksum"), "{told}");
    let statistics: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(statistics["converged"], false);
    assert!(statistics["error_px"].as_f64().unwrap() > 0.01 && statistics["sum"].as_f64().unwrap() > 0.0);
    assert!(folder.path().join("p.png").is_file());
}
