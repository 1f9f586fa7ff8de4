//! A build that is killed, at whatever stage, leaves nothing behind; what was there before stays as it was.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::{BuildOptions, build_source};
use deepfield_data::hierarchy::Kinds;
use deepfield_data::import::LoadOptions;
use deepfield_data::model::Progress;
use deepfield_data::synth;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Where the process that is to be killed finds its work.
const WORK: &str = "DEEPFIELD_TEST_KILLED";
/// What it says before the name of each stage.
const STAGE: &str = "stage: ";

/// Says stages, and waits a moment in each.
struct Slow;

impl Progress for Slow {
    fn begin(&self, stage: &str, _: u64) {
        println!("{STAGE}{stage}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }

    fn advance(&self, _: u64) {}
}

/// With work, the process that is killed: it builds from a snapshot with so little memory that most is on the disk.
#[test]
fn killed_builds_leave_nothing() {
    if let Some(folder) = std::env::var_os(WORK) {
        let folder = Path::new(&folder);
        let options = BuildOptions {
            hierarchies: Kinds::of_particles(),
            memory: Some(12 << 20),
            threads: Some(1),
            ..BuildOptions::default()
        };
        let out = folder.join("out").join("k.df");
        build_source(&folder.join("source"), &LoadOptions::default(), &options, &out, &Slow).unwrap();
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    if tempfile::tempfile_in(&out).is_err() || !has_unnamed(&out) {
        return;
    }
    let generator = synth::clusters::Clusters::new(1, 20_000);
    synth::files::write(&generator, &folder.path().join("source"), synth::gadget::MOST, &()).unwrap();
    let names = || -> Vec<_> { std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect() };
    let mut stages = 0;
    // Killed at the first stage, at the second one, and so on until a build comes to its end.
    loop {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "killed_builds_leave_nothing", "--nocapture"])
            .env(WORK, folder.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        // Kept open, so that the child does not end by itself when nobody listens any more.
        let mut told = BufReader::new(child.stdout.take().unwrap()).lines();
        let is_stage = |line: &std::io::Result<String>| line.as_ref().is_ok_and(|line| line.contains(STAGE));
        if told.by_ref().filter(is_stage).nth(stages).is_none() {
            assert!(child.wait().unwrap().success());
            break;
        }
        child.kill().unwrap();
        assert!(!child.wait().unwrap().success());
        assert_eq!(names(), [""; 0], "killed at stage {stages}");
        stages += 1;
    }
    assert!(stages > 3, "{stages} stages");
    assert_eq!(names(), ["k.df"]);
}

/// Whether the file system of a folder has files without names.
fn has_unnamed(folder: &Path) -> bool {
    use std::os::unix::fs::OpenOptionsExt;
    let flags = rustix::fs::OFlags::TMPFILE.bits() as i32;
    std::fs::OpenOptions::new().read(true).write(true).custom_flags(flags).open(folder).is_ok()
}
