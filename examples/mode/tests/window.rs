//! The mode in a window, under a virtual X server: an adapter draws it, and the panel has its settings.

#![cfg(all(target_os = "linux", feature = "viewer"))]
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot go on has failed")]

use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The slowest machine that the test is meant for compiles its shaders on one core.
const PATIENCE: Duration = Duration::from_secs(240);

/// Ends a process that a failed test would leave behind.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn status(path: &Path) -> Value {
    std::fs::read_to_string(path).ok().and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

fn wait(path: &Path, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
    let start = Instant::now();
    loop {
        let status = status(path);
        if condition(&status) {
            return status;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}: {status:#}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

#[test]
fn the_window_shows_the_mode() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", "800x500x24", "-nolisten", "tcp", "-noreset"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap_or_else(|error| panic!("this test needs Xvfb (Debian: apt-get install xvfb): {error}"));
    let mut number = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
    let _server = Process(server);
    let at = folder.path().join("status.json");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = Command::new(env!("CARGO_BIN_EXE_brightest"))
        .arg("view")
        .arg(root.join("../../assets/demo/lcdm64_z0.hdf5"))
        .args(["--mode", "brightest", "--backend", "compute", "--size", "800x500", "--status"])
        .arg(&at)
        .env("DISPLAY", format!(":{}", number.trim()))
        .env("XDG_CACHE_HOME", folder.path())
        // What an adapter in software compiles is kept from run to run.
        .env("MESA_SHADER_CACHE_DIR", env!("CARGO_TARGET_TMPDIR"))
        .env_remove("WAYLAND_DISPLAY")
        .current_dir(folder.path())
        .spawn()
        .unwrap();
    let _program = Process(program);
    let shown = wait(&at, "a converged picture", |status| status["converged"] == true);
    assert_eq!((&shown["mode"], &shown["backend"]), (&Value::from("brightest"), &Value::from("compute")), "{shown:#}");
    let controls = shown["controls"].as_object().unwrap();
    assert!(controls.keys().any(|name| name.starts_with("ripples")), "{controls:?}");
}
