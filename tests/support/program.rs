//! The program under test, and tests in processes of their own.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The program, without arguments. What an adapter in software compiles is kept for all of them, and for the tests themselves: elsewhere each would
/// compile its own, since a test's folder is all that its programs know of their user.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_deepfield"));
    command.env("MESA_SHADER_CACHE_DIR", shader_cache());
    command
}

/// Where Mesa keeps what it compiles in this process.
fn shader_cache() -> PathBuf {
    let of = |name: &str| std::env::var_os(name).filter(|path| !path.is_empty()).map(PathBuf::from);
    let user = || of("XDG_CACHE_HOME").or_else(|| Some(of("HOME")?.join(".cache")));
    of("MESA_SHADER_CACHE_DIR").or_else(user).unwrap_or_else(|| env!("CARGO_TARGET_TMPDIR").into())
}

/// What the program does with these arguments in a folder, which is its cache, too.
pub fn run(folder: &Path, arguments: &[&str]) -> Output {
    program().args(arguments).current_dir(folder).env("XDG_CACHE_HOME", folder).output().unwrap()
}

/// A run that must succeed.
pub fn ok(folder: &Path, arguments: &[&str]) -> Output {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Standard output of a run that must succeed.
pub fn text(folder: &Path, arguments: &[&str]) -> String {
    String::from_utf8(ok(folder, arguments).stdout).unwrap()
}

/// The same, as JSON.
pub fn json(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_slice(&ok(folder, arguments).stdout).unwrap()
}

/// Standard error of a run that must fail with one line.
pub fn error(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    message
}

/// The most memory that a process has taken so far, bytes, as Linux counts it; `None` once it has ended.
#[cfg(target_os = "linux")]
pub fn peak_memory(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes << 10)
}

/// Runs a test in a process of its own, for what it measures of its process. `name` is that of the test with its modules.
pub fn alone(name: &str, test: fn()) {
    const MARK: &str = "DEEPFIELD_TEST_ALONE";
    // One process for each test is what nextest has anyway.
    if std::env::var_os("NEXTEST").is_some() || std::env::var_os(MARK).is_some() {
        return test();
    }
    let mut command = Command::new(std::env::current_exe().unwrap());
    let status = command.args([name, "--exact", "--include-ignored", "--nocapture"]).env(MARK, "1").status().unwrap();
    assert!(status.success(), "{name}: {status}");
}
