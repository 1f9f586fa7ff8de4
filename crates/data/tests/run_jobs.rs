//! A run that the tasks of a job build is the one that one machine builds, byte for byte, in whatever order they come and whatever is lost.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::build::cluster::{Job, Stage, StageStatus};
use deepfield_data::build::{BuildError, BuildOptions, FlowOptions, RunBuild, TrackOptions};
use deepfield_data::hierarchy::Kinds;
use deepfield_data::import::{LoadOptions, Run, RunOptions, RunStep, open_run};
use deepfield_data::model::{DerivedQuantity, FamilyName, Progress, ReadMethod};
use deepfield_data::store::RunFile;
use deepfield_data::store::run::Tangents;
use deepfield_data::synth::moving::{self, Births, Moving, Orbits, Pancake};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A run, whose snapshots are named from where the test runs, and what is to be built of it.
struct Case {
    folder: tempfile::TempDir,
    run: Run,
    load: LoadOptions,
    options: BuildOptions,
    tracks: Option<TrackOptions>,
}

/// The name of a file from where the test runs.
fn from_here(path: &Path) -> PathBuf {
    let up: PathBuf = std::env::current_dir().unwrap().components().skip(1).map(|_| "..").collect();
    up.join(path.strip_prefix("/").unwrap())
}

impl Case {
    fn new(folder: tempfile::TempDir, files: &[PathBuf], options: &RunOptions) -> Case {
        let files: Vec<PathBuf> = files.iter().map(|file| from_here(file)).collect();
        let run = open_run(&files, options, ReadMethod::default()).unwrap();
        let (load, options) = (LoadOptions::default(), BuildOptions::default());
        Case { folder, run, load, options, tracks: Some(TrackOptions::default()) }
    }

    fn generated(kind: &dyn Moving, steps: usize) -> Case {
        let folder = tempfile::tempdir().unwrap();
        let times = moving::times(kind, steps, 1.5, 3);
        let files = moving::write(kind, &times, 3, &folder.path().join("run"), &()).unwrap();
        Case::new(folder, &files, &RunOptions::default())
    }

    /// Tables without times, in units that differ, the last one without the temperature that others have.
    fn tables() -> Case {
        let folder = tempfile::tempdir().unwrap();
        let tables = [("t0.csv", "kpc", true), ("t1.csv", "Mpc", true), ("t2.csv", "kpc", false)].map(
            |(name, unit, has_temperature)| {
                let more = if has_temperature { ",temp" } else { "" };
                let mut text = format!("x [{unit}],y [{unit}],z [{unit}],mass{more}\n");
                for i in 0..200_u32 {
                    let [x, y, z] = [1.1, 2.3, 3.7].map(|rate| (rate * f64::from(i)).sin());
                    let temperature = if has_temperature { format!(",{i}") } else { String::new() };
                    writeln!(text, "{x},{y},{z},1{temperature}").unwrap();
                }
                let path = folder.path().join(name);
                std::fs::write(&path, text).unwrap();
                path
            },
        );
        let options = RunOptions { times: Some("0.1:0.7".parse().unwrap()), ..RunOptions::default() };
        Case { tracks: None, ..Case::new(folder, &tables, &options) }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn build(&self) -> RunBuild<'_> {
        let tracks = self.tracks.as_ref();
        RunBuild { load: &self.load, options: &self.options, tracks, skip_damaged: false, still_of: None }
    }

    /// What one machine builds.
    fn expected(&self) -> Vec<u8> {
        let out = self.path("alone.df");
        self.build().build(self.run.clone(), &out, &()).unwrap();
        std::fs::read(out).unwrap()
    }

    fn plan(&self) -> Result<Job, BuildError> {
        Job::plan_run(&self.path("job"), &self.run, &self.build(), &self.path("out.df"), &())
    }

    fn built(&self) -> Vec<u8> {
        std::fs::read(self.path("out.df")).unwrap()
    }

    /// Bytes that the tasks read: snapshots for stills, and once more for tracks; stills to sum them up, and to copy those that are kept.
    fn read(&self) -> u64 {
        let sources: u64 = self.run.steps.iter().map(|step| step.about.bytes).sum();
        let still = |step: usize| std::fs::metadata(self.path("job").join(format!("still.{step}"))).unwrap().len();
        let stills: u64 = (0..self.run.steps.len()).map(still).sum();
        let is_kept = self.tracks.is_none_or(|tracks| !tracks.no_stills);
        (2 + u64::from(self.tracks.is_some())) * sources + (1 + u64::from(is_kept)) * stills
    }

    /// What is in the folder beside the snapshots.
    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let is_source = |name: &String| name.starts_with("run_") || name.ends_with(".csv");
        let mut names: Vec<String> = names.filter(|name| !is_source(name)).collect();
        names.sort();
        names
    }
}

/// Runs each task twice, two at a time, in an order that follows from the seed.
fn run_all(job: &Job, seed: u64) {
    let mut state = seed;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for Stage { name, tasks, .. } in job.stages() {
        let mut order: Vec<u32> = (0..*tasks).chain(0..*tasks).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, random(i + 1));
        }
        let memory = Some((48 + random(64) as u64) << 20);
        std::thread::scope(|scope| {
            for half in order.chunks(order.len() / 2) {
                scope.spawn(move || half.iter().for_each(|task| job.run(name, *task, memory, &()).unwrap()));
            }
        });
    }
}

#[test]
fn the_run_is_that_of_one_machine() {
    let flow = FlowOptions { levels: Some(2), error: None };
    let pancake = TrackOptions { no_stills: true, tangents: Some(Tangents::Differences), ..TrackOptions::default() };
    let cases = [
        // Families come and go, and have clusters.
        Case {
            options: BuildOptions { hierarchies: Kinds::of_particles(), ..BuildOptions::default() },
            ..Case::generated(&Births::new(5, 1500, 4), 4)
        },
        Case {
            tracks: Some(TrackOptions { flow, ..TrackOptions::default() }),
            load: LoadOptions { derive: vec![DerivedQuantity::VelocityDispersion], ..LoadOptions::default() },
            ..Case::generated(&Orbits::new(3, 900), 3)
        },
        Case { tracks: Some(pancake), ..Case::generated(&Pancake::new(1, 800), 5) },
        Case {
            load: LoadOptions { families: vec![FamilyName::Gas], ..LoadOptions::default() },
            ..Case::generated(&Births::new(2, 900, 3), 3)
        },
        Case::tables(),
    ];
    for (number, case) in cases.iter().enumerate() {
        let expected = case.expected();
        let job = case.plan().unwrap();
        let stages: Vec<(&str, u32)> = job.stages().iter().map(|stage| (&*stage.name, stage.tasks)).collect();
        assert_eq!(stages, [("steps", case.run.steps.len() as u32), ("run", 1)]);
        run_all(&Job::open(&case.path("job")).unwrap(), number as u64);
        assert!(case.built() == expected, "case {number}");
        let read = case.read();
        let status = job.status().unwrap();
        assert!(status.finished && status.stages.iter().all(|stage| stage.done == stage.tasks));
        assert!(status.particles > 0 && status.bytes.written > expected.len() as u64);
        // And what each step has told of its page file.
        assert!((read..read + 100).contains(&status.bytes.read), "case {number}: {} of {read}", status.bytes.read);
        // The steps are told by the names that they were given.
        let told = RunFile::open(&case.path("out.df"), ReadMethod::default()).unwrap();
        assert!(told.directory().steps.iter().all(|step| step.source.to_string_lossy().starts_with("..")));
        job.remove().unwrap();
        assert_eq!(case.names(), ["alone.df", "out.df"]);
    }
}

#[test]
fn what_is_damaged_is_made_again() {
    let case = Case::generated(&Orbits::new(4, 300), 3);
    let expected = case.expected();
    let job = case.plan().unwrap();
    let run = |stage: &str, task: u32| job.run(stage, task, None, &());
    (0..3).for_each(|task| run("steps", task).unwrap());
    let harms: [(&str, u32, fn(&Path)); 5] = [
        ("still.1", 1, |path| std::fs::remove_file(path).unwrap()),
        ("still.0", 0, |path| {
            let mut bytes = std::fs::read(path).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 4;
            std::fs::write(path, bytes).unwrap();
        }),
        ("still.2", 2, |path| std::fs::write(path, &std::fs::read(path).unwrap()[..5000]).unwrap()),
        ("steps.2", 2, |path| std::fs::write(path, &std::fs::read(path).unwrap()[..50]).unwrap()),
        ("steps.1", 1, |path| std::fs::remove_file(path).unwrap()),
    ];
    for (name, task, harm) in harms {
        harm(&case.path("job").join(name));
        let told = run("run", 0).unwrap_err().to_string();
        assert!(told.ends_with(&format!("run stage steps, task {task}")), "{name}: {told}");
        let done: Vec<u32> = job.status().unwrap().stages.iter().map(|StageStatus { done, .. }| *done).collect();
        assert_eq!(done, [2, 0], "{name}");
        run("steps", task).unwrap();
    }
    run("run", 0).unwrap();
    assert!(case.built() == expected);
}

#[test]
fn what_cannot_be_built_is_told_and_cancelled_jobs_leave_nothing() {
    let mut case = Case::generated(&Orbits::new(4, 200), 3);
    let temporary = case.path("temporary");
    std::fs::create_dir(&temporary).unwrap();
    case.options.temporary = Some(from_here(&temporary));
    let job = case.plan().unwrap();
    // Tasks run elsewhere.
    let found = std::fs::read_to_string(case.path("job").join("job.json")).unwrap();
    let expected = std::path::absolute(from_here(&temporary)).unwrap();
    assert!(found.contains(&format!("\"temporary\": {expected:?}")), "{found}");
    let told = |stage: &str, task: u32| job.run(stage, task, None, &()).unwrap_err().to_string();
    assert!(told("run", 0).ends_with("run stage steps, task 0"), "{}", told("run", 0));
    assert!(told("steps", 3).contains("task: found 3 of stage steps, expected 0 to 2"));
    assert!(told("survey", 0).contains("stage: found \"survey\", expected one of steps, run"));
    job.run("steps", 0, None, &()).unwrap();
    assert_eq!(case.plan().unwrap().status().unwrap().stages[0].done, 1);
    let other = RunBuild { tracks: None, ..case.build() };
    let other = Job::plan_run(&case.path("job"), &case.run, &other, &case.path("out.df"), &()).unwrap_err();
    assert!(other.to_string().contains("found another job"), "{other}");
    // Another snapshot in the place of one is none of this run.
    std::fs::copy(case.path("run_001"), case.path("kept")).unwrap();
    let longer = Orbits::new(4, 250);
    let time = case.run.steps[1].time;
    let files = moving::write(&longer, &[time], 3, &case.path("longer"), &()).unwrap();
    std::fs::rename(&files[0], case.path("run_001")).unwrap();
    for (stage, task) in [("steps", 1), ("run", 0)] {
        let told = told(stage, task);
        assert!(told.contains("run_001: found ") && told.ends_with("as it was when the job was planned"), "{told}");
    }
    std::fs::rename(case.path("kept"), case.path("run_001")).unwrap();
    // As killed tasks leave it where files need names.
    let killed =
        ["job/still.2.tmpKilled", "out.df.tmpKilled", "temporary/out.df.tmpKilled", "temporary/still.1.tmpKilled"];
    killed.iter().for_each(|name| std::fs::write(case.path(name), "").unwrap());
    std::fs::write(temporary.join("other.df.tmpKilled"), "").unwrap();
    job.remove().unwrap();
    assert_eq!(case.names(), ["temporary"]);
    let left: Vec<_> = std::fs::read_dir(&temporary).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["other.df.tmpKilled"]);
}

/// Cancels a job as a task of it begins to work.
struct Cancelling(Mutex<Option<Job>>);

impl Progress for Cancelling {
    fn begin(&self, _: &str, _: u64) {
        if let Some(job) = self.0.lock().unwrap().take() {
            job.remove().unwrap();
        }
    }

    fn advance(&self, _: u64) {}
}

/// In a folder that stays for what others keep there.
#[test]
fn steps_whose_job_is_cancelled_while_they_run_leave_nothing() {
    let case = Case::generated(&Orbits::new(4, 100), 2);
    let job = case.plan().unwrap();
    job.run("steps", 0, None, &()).unwrap();
    std::fs::write(case.path("job").join("notes.txt"), "").unwrap();
    let told = job.run("steps", 1, None, &Cancelling(Mutex::new(Some(job.clone())))).unwrap_err().to_string();
    assert!(told.ends_with("was removed (`deepfield build --cancel`) while the task ran"), "{told}");
    assert_eq!(case.names(), ["job"]);
    let left: Vec<_> = std::fs::read_dir(case.path("job")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["notes.txt"]);
}

/// Cancels a job at the last moment at which its output has no name.
struct CancellingAtLast(Mutex<Option<Job>>);

impl Progress for CancellingAtLast {
    fn begin(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {}

    fn go_on(&self) {
        if let Some(job) = self.0.lock().unwrap().take() {
            job.remove().unwrap();
        }
    }
}

/// Which somebody may have built otherwise since.
#[test]
fn a_run_that_is_cancelled_before_its_end_leaves_what_has_the_name_of_its_output() {
    let case = Case { tracks: None, ..Case::generated(&Orbits::new(4, 100), 2) };
    let job = case.plan().unwrap();
    (0..2).for_each(|step| job.run("steps", step, None, &()).unwrap());
    std::fs::write(case.path("out.df"), "of somebody").unwrap();
    let told = job.run("run", 0, None, &CancellingAtLast(Mutex::new(Some(job.clone())))).unwrap_err().to_string();
    assert!(told.ends_with("was removed (`deepfield build --cancel`) while the task ran"), "{told}");
    assert_eq!(case.built(), b"of somebody");
    assert_eq!(case.names(), ["out.df"]);
}

/// Other bytes than those that were promised are not built in its place.
#[test]
fn a_page_file_that_cannot_be_opened_is_told() {
    let case = Case::generated(&Orbits::new(4, 100), 2);
    let gone = case.path("gone.df");
    let still_of = |_: &RunStep, _: &LoadOptions, _: &dyn Progress| Ok::<_, BuildError>(Some(gone.clone()));
    let build = RunBuild { still_of: Some(&still_of), ..case.build() };
    let told = build.build(case.run.clone(), &case.path("out.df"), &()).unwrap_err().to_string();
    assert!(told.contains("gone.df"), "{told}");
    assert_eq!(case.names(), [""; 0]);
}
