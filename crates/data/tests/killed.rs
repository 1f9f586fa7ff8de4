//! A build that is killed, at whatever stage, or that nobody waits for any more leaves nothing behind; what was there before stays as it was.
//! Of one that is cut into tasks what was done stays, until it is cancelled.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::cluster::{Job, Split};
use deepfield_data::build::{BuildOptions, RunBuild, build_source};
use deepfield_data::hierarchy::Kinds;
use deepfield_data::import::{LoadOptions, RunOptions, Smoothing, open_run};
use deepfield_data::model::{Progress, ReadMethod};
use deepfield_data::store::RunFileWriter;
use deepfield_data::synth;
use deepfield_data::synth::moving::{self, Orbits};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

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

/// Runs a test as a process that finds its work in a folder, and kills it once it has begun a stage and so many before it; false where it
/// comes to its end before that.
fn is_killed(test: &str, folder: &Path, stages: usize) -> bool {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--nocapture"])
        .env(WORK, folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // Kept open, so that the child does not end by itself when nobody listens any more.
    let mut told = BufReader::new(child.stdout.take().unwrap()).lines();
    let is_stage = |line: &std::io::Result<String>| line.as_ref().is_ok_and(|line| line.contains(STAGE));
    let is_at_work = told.by_ref().filter(is_stage).nth(stages).is_some();
    if is_at_work {
        child.kill().unwrap();
    }
    let ended = child.wait().unwrap();
    assert!(is_at_work || ended.success(), "{test}: {ended}");
    is_at_work
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
    while is_killed("killed_builds_leave_nothing", folder.path(), stages) {
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

/// With work, the process that is killed: it runs what is left of the tasks of a job, and comes a few steps further than the one before.
#[test]
fn killed_tasks_are_run_again() {
    let plan = |folder: &Path| {
        let (job, source, out) = (folder.join("job"), folder.join("source"), folder.join("k.df"));
        let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
        let split = Split { tasks: Some(2) };
        Job::plan(&job, &source, &LoadOptions::default(), &options, split, &out, &()).unwrap()
    };
    if let Some(folder) = std::env::var_os(WORK) {
        let job = plan(Path::new(&folder));
        for stage in job.stages() {
            (0..stage.tasks).for_each(|task| job.run(&stage.name, task, None, &Slow).unwrap());
        }
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source");
    synth::files::write(&synth::clusters::Clusters::new(1, 20_000), &source, synth::gadget::MOST, &()).unwrap();
    let job = plan(folder.path());
    let mut killed = 0;
    while is_killed("killed_tasks_are_run_again", folder.path(), 2) {
        killed += 1;
    }
    assert!(killed > 4, "{killed} processes were killed");
    let alone = folder.path().join("alone.df");
    build_source(&source, &LoadOptions::default(), &BuildOptions::default(), &alone, &()).unwrap();
    assert!(std::fs::read(folder.path().join("k.df")).unwrap() == std::fs::read(&alone).unwrap());
    job.remove().unwrap();
    let names = || std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<_> = names().collect();
    names.sort();
    assert_eq!(names, ["alone.df", "k.df", "source"]);
}

/// Counts what builds ask in each stage; from question `most` on nobody waits.
struct Waiting {
    most: u64,
    asked: AtomicU64,
    stages: Mutex<Vec<(String, u64)>>,
}

impl Waiting {
    fn until(most: u64) -> Waiting {
        Waiting { most, asked: AtomicU64::new(0), stages: Mutex::default() }
    }
}

impl Progress for Waiting {
    fn begin(&self, stage: &str, _: u64) {
        self.stages.lock().unwrap().push((stage.to_owned(), 0));
        self.go_on();
    }

    fn advance(&self, _: u64) {
        self.go_on();
    }

    fn go_on(&self) {
        // Before the first stage as well.
        if let Some((_, asked)) = self.stages.lock().unwrap().last_mut() {
            *asked += 1;
        }
        if self.asked.fetch_add(1, Ordering::Relaxed) >= self.most && !std::thread::panicking() {
            resume_unwind(Box::new("nobody waits"));
        }
    }
}

/// Where neighbours are found, buckets merged and codes trained as well: in each of these stages a build asks at least once for every 8192
/// particles whether to go on, and where it is told no it ends.
#[test]
fn builds_ask_often_and_leave_nothing_where_nobody_waits() {
    const PARTICLES: u64 = 30_000;
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("source"), folder.path().join("out"));
    std::fs::create_dir(&out).unwrap();
    synth::files::write(&synth::clusters::Clusters::new(1, PARTICLES), &source, synth::gadget::MOST, &()).unwrap();
    let load = LoadOptions { smoothing: Smoothing::Knn(32), ..LoadOptions::default() };
    let options = BuildOptions { threads: Some(2), ..BuildOptions::default() };
    let build = |most: u64| {
        let waiting = Waiting::until(most);
        let work = || build_source(&source, &load, &options, &out.join("k.df"), &waiting).map(drop);
        let ended = catch_unwind(AssertUnwindSafe(work));
        (ended, waiting.asked.into_inner(), waiting.stages.into_inner().unwrap())
    };
    let (ended, asked, stages) = build(u64::MAX);
    ended.unwrap().unwrap();
    std::fs::remove_file(out.join("k.df")).unwrap();
    for stage in ["finding neighbours", "merging", "coding"] {
        let own: u64 = stages.iter().filter(|(name, _)| name.starts_with(stage)).map(|(_, asked)| asked).sum();
        assert!(own >= PARTICLES / 8192, "{own} questions in {stage}, of {stages:?}");
    }
    for most in (0..asked).step_by(asked as usize / 6) {
        let (ended, ..) = build(most);
        assert!(ended.is_err(), "went on after question {most} of {asked}");
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0, "stopped at question {most} of {asked}");
    }
}

/// Page files are copied into a run in pieces, and the last question comes right before the run gets its name.
#[test]
fn runs_ask_while_they_are_put_together() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let orbits = Orbits::new(4, 200);
    let times = moving::times(&orbits, 3, 1.5, 3);
    let files = moving::write(&orbits, &times, 3, &folder.path().join("run"), &()).unwrap();
    let run = open_run(&files, &RunOptions::default(), ReadMethod::default()).unwrap();
    let (load, options) = (LoadOptions::default(), BuildOptions { threads: Some(1), ..BuildOptions::default() });
    let build = RunBuild { load: &load, options: &options, tracks: None, skip_damaged: false, still_of: None };
    let work = |most: u64| {
        let waiting = Waiting::until(most);
        let work = || build.build(run.clone(), &out.join("k.df"), &waiting).map(drop);
        let ended = catch_unwind(AssertUnwindSafe(work));
        (ended, waiting.asked.into_inner(), waiting.stages.into_inner().unwrap())
    };
    let is_empty = || std::fs::read_dir(&out).unwrap().count() == 0;
    let (ended, asked, stages) = work(u64::MAX);
    ended.unwrap().unwrap();
    std::fs::remove_file(out.join("k.df")).unwrap();
    // Where it begins, behind its only piece, and at the end of all.
    assert_eq!(stages.last().unwrap(), &("step 3 of 3: copying its page file".to_owned(), 3));
    assert!(work(asked - 1).0.is_err() && is_empty());

    let large = folder.path().join("large");
    File::create(&large).unwrap().set_len(20 << 20).unwrap();
    let copy = |most: u64| {
        let waiting = Waiting::until(most);
        let mut writer = RunFileWriter::create(&out.join("k.df")).unwrap();
        let work = || writer.append(&File::open(&large).unwrap(), &waiting).unwrap().len;
        catch_unwind(AssertUnwindSafe(work))
    };
    assert_eq!(copy(u64::MAX).unwrap(), 20 << 20);
    assert!(copy(4).is_err() && is_empty());
}
