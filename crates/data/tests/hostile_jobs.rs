//! What one stage of a job leaves for another, cut or changed at random: whoever reads it names the task that is to be run again, or the output
//! is the same. Where the checksums were made right, too, [`Job::verify`] reads it as something else or refuses it, never with a panic, nor with
//! more memory than its size allows; and the stages that come after go on to some output, or say in a line what is wrong.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(unsafe_code, reason = "an allocator that counts is unsafe to write")]

#[path = "support/counting.rs"]
mod counting;
#[path = "support/job_checksums.rs"]
mod job_checksums;

use counting::counted;
use deepfield_data::build::cluster::{Job, Split, Stage};
use deepfield_data::build::{BuildError, BuildOptions, RunBuild, build_source};
use deepfield_data::hierarchy::OctreeOptions;
use deepfield_data::import::{LoadOptions, RunOptions, open_run};
use deepfield_data::model::{DerivedQuantity, ReadMethod};
use job_checksums::{correct, correct_plan};
use rand_pcg::Pcg32;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Held by each test: memory is counted for the whole process.
static ALONE: Mutex<()> = Mutex::new(());

/// Bytes of the header of a task's file.
const HEADER: usize = 80;

/// Bytes of a header between two places where it is cut: fewer than there are stages, so that it is cut at every byte.
const STRIDE: usize = 8;

/// Buffers of a fixed size, and what a list of the largest values takes whose bytes are zeros.
fn most(bytes: usize) -> usize {
    (64 << 20) + 1024 * bytes
}

/// A table of particles that lack densities and smoothing lengths.
fn table(path: PathBuf, particles: usize) -> PathBuf {
    let mut random = Pcg32::seed_from_u64(7);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let mut text = "x [kpc],y [kpc],z [kpc],vx [km/s],vy [km/s],vz [km/s],mass\n".to_owned();
    for _ in 0..particles {
        let [x, y, z, vx, vy, vz] = [(); 6].map(|()| number());
        writeln!(text, "{x},{},{z},{vx},{vy},{vz},{}", y * y, 1.0 + number()).unwrap();
    }
    std::fs::write(&path, text).unwrap();
    path
}

/// A job, and what one machine builds.
struct Case {
    folder: tempfile::TempDir,
    job: Job,
    expected: Vec<u8>,
}

/// Files by path.
type Files = BTreeMap<PathBuf, Vec<u8>>;

impl Case {
    /// The page file of a snapshot.
    fn snapshot(particles: usize, tasks: u32, refined: bool) -> Case {
        let folder = tempfile::tempdir().unwrap();
        let [source, alone, job, out] =
            ["source.csv", "alone.df", "job", "out.df"].map(|name| folder.path().join(name));
        let source = table(source, particles);
        let load = LoadOptions { derive: vec![DerivedQuantity::VelocityDispersion], ..LoadOptions::default() };
        let octree = OctreeOptions {
            refined,
            bucket_particles: Some(300),
            leaf_capacity: 100,
            volume_levels: true,
            ..OctreeOptions::default()
        };
        let options = BuildOptions { octree, page_bytes: 1 << 13, ..BuildOptions::default() };
        build_source(&source, &load, &options, &alone, &()).unwrap();
        let split = Split { tasks: Some(tasks) };
        let job = Job::plan(&job, &source, &load, &options, split, &out, &()).unwrap();
        Case { folder, job, expected: std::fs::read(alone).unwrap() }
    }

    /// A run of snapshots.
    fn run() -> Case {
        let folder = tempfile::tempdir().unwrap();
        let [alone, job, out] = ["alone.df", "job", "out.df"].map(|name| folder.path().join(name));
        let files = ["0.csv", "1.csv"].map(|name| table(folder.path().join(name), 200));
        let options = RunOptions { times: Some("0.1:0.7".parse().unwrap()), ..RunOptions::default() };
        let run = open_run(&files, &options, ReadMethod::default()).unwrap();
        let (load, options) = (LoadOptions::default(), BuildOptions::default());
        let build = RunBuild { load: &load, options: &options, tracks: None, skip_damaged: false, still_of: None };
        build.build(run.clone(), &alone, &()).unwrap();
        let job = Job::plan_run(&job, &run, &build, &out, &()).unwrap();
        Case { folder, job, expected: std::fs::read(alone).unwrap() }
    }

    /// Runs what is left.
    fn work(&self) -> Result<(), BuildError> {
        for Stage { name, tasks, .. } in self.job.stages() {
            (0..*tasks).try_for_each(|task| self.job.run(name, task, None, &()))?;
        }
        Ok(())
    }

    fn is_built(&self) -> bool {
        std::fs::read(self.job.output()).unwrap() == self.expected
    }

    /// What the job has written, and the sources.
    fn files(&self) -> Files {
        let folders = [self.folder.path(), self.job.folder()].into_iter();
        let entries = folders.flat_map(|folder| std::fs::read_dir(folder).unwrap());
        let paths = entries.map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
        paths.map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
    }

    /// Has these files be all that there are.
    fn put_back(&self, files: &Files) {
        for path in self.files().keys().filter(|path| !files.contains_key(*path)) {
            std::fs::remove_file(path).unwrap();
        }
        files.iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
    }
}

/// A number below another one.
fn below(random: &mut Pcg32, end: usize) -> usize {
    random.next_u32() as usize % end
}

/// Cut within the header, which all stages have in common, at every so many bytes from the one on that `first` says; and at some places behind it.
fn cuts_are_told(case: &Case, stage: &str, path: &Path, sound: &[u8], first: usize) {
    let parts = (1..16).map(|part| sound.len() * part / 16).chain([sound.len() - 1]);
    for len in (first % STRIDE..HEADER).step_by(STRIDE).chain(parts).filter(|len| *len < sound.len()) {
        std::fs::write(path, &sound[..len]).unwrap();
        let told = case.job.verify(stage, 0).unwrap_err().to_string();
        assert!(told.ends_with(&format!("run stage {stage}, task 0")), "{stage} at {len}: {told}");
        assert!(!path.exists(), "{stage} at {len}");
    }
}

/// A bit in the header, in the index, which ends the file, and anywhere.
fn changes_are_told_or_mended(case: &Case, stage: &str, path: &Path, files: &Files, random: &mut Pcg32) {
    let sound = &files[path];
    let len = sound.len();
    let places = [below(random, HEADER), len - 1 - below(random, len.min(100)), below(random, len), below(random, len)];
    for at in places {
        case.put_back(files);
        let mut bytes = sound.clone();
        bytes[at] ^= 1 << below(random, 8);
        std::fs::write(path, bytes).unwrap();
        match case.work() {
            Ok(()) => assert!(case.is_built(), "{stage} at {at}"),
            Err(BuildError::Job { what, .. }) => {
                assert!(what.ends_with(&format!("run stage {stage}, task 0")), "{stage} at {at}: {what}");
            }
            Err(other) => panic!("{stage} at {at}: {other}"),
        }
    }
}

/// Whoever means harm has other values read, and no more.
fn forgeries_are_read_or_refused(case: &Case, stage: &str, path: &Path, sound: &[u8], random: &mut Pcg32) {
    for round in 0..48 {
        let mut bytes = sound.to_vec();
        // The first round forges what is sound; of the others half change the end, where values are.
        let among = if round % 2 == 0 { bytes.len() } else { bytes.len().min(400) };
        for _ in 0..round.min(1 + below(random, 6)) {
            let at = bytes.len() - 1 - below(random, among);
            // Numbers as large as can be are what sizes are made of.
            let from_there = (at + [1, 8][below(random, 2)]).min(bytes.len());
            let value = if below(random, 4) == 0 { random.next_u32() as u8 } else { 0xff };
            bytes[at..from_there].fill(value);
        }
        correct(&mut bytes, sound);
        std::fs::write(path, &bytes).unwrap();
        let (read, took) = counted(|| case.job.verify(stage, 0));
        assert!(took <= most(bytes.len()), "{stage}: {took} bytes of memory for {} of a file", bytes.len());
        assert!(round > 0 || read.is_ok(), "{stage}: {read:?}");
        if let Err(error) = read {
            let told = error.to_string();
            assert!(!told.contains('\n') && !told.contains("another checksum"), "{stage}: {told}");
        }
    }
}

/// Every number of a plan in turn, as large or small as it can be.
fn forged_plans_are_opened_or_refused(case: &Case) {
    let path = case.job.folder().join("job.json");
    let sound = std::fs::read_to_string(&path).unwrap();
    let open = |text: &str| {
        std::fs::write(&path, correct_plan(text).unwrap_or_else(|| text.to_owned())).unwrap();
        Job::open(case.job.folder())
    };
    open(&sound).unwrap();
    for (from, to, told) in [
        ("\"particles\": 1500", "\"particles\": 18446744073709551615", "particles: found more than "),
        ("\"input\": 1", "\"input\": 4294967295", "input: found 4294967295 tasks, expected 1 to 65536"),
    ] {
        assert!(sound.contains(from), "{sound}");
        let found = open(&sound.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(found.contains("job.json") && found.contains(told), "{found}");
    }
    let is_digit = |at: usize| sound.as_bytes()[at].is_ascii_digit();
    let starts = (sound.find("\"plan\"").unwrap()..sound.len()).filter(|at| is_digit(*at) && !is_digit(at - 1));
    for start in starts {
        let end = start + sound[start..].find(|c: char| !c.is_ascii_digit()).unwrap();
        for number in ["0", "255", "4294967295", "18446744073709551615", "-1", "1e300"] {
            let forged = format!("{}{number}{}", &sound[..start], &sound[end..]);
            let (opened, took) = counted(|| open(&forged));
            assert!(took <= most(forged.len()), "{took} bytes of memory: {forged}");
            match opened {
                Ok(job) if job.stages().iter().map(|stage| stage.tasks).sum::<u32>() < 1000 => {
                    drop(job.status().unwrap())
                }
                Ok(_) => {}
                Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
            }
        }
    }
    std::fs::write(&path, sound).unwrap();
}

#[test]
fn damage_is_told_or_mended_and_takes_no_memory() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut random = Pcg32::seed_from_u64(23);
    // Codebooks as a whole, and in parts, which are refined; then stills.
    let cases = [Case::snapshot(1500, 1, true), Case::snapshot(1500, 2, true), Case::run()];
    forged_plans_are_opened_or_refused(&cases[0]);
    let mut seen = Vec::new();
    for case in &cases {
        for Stage { name, tasks, .. } in case.job.stages() {
            for task in 0..*tasks {
                case.job.run(name, task, None, &()).unwrap();
                case.job.verify(name, task).unwrap();
            }
            let files = case.files();
            let path = case.job.folder().join(format!("{name}.0"));
            cuts_are_told(case, name, &path, &files[&path], seen.len());
            changes_are_told_or_mended(case, name, &path, &files, &mut random);
            case.put_back(&files);
            forgeries_are_read_or_refused(case, name, &path, &files[&path], &mut random);
            case.put_back(&files);
            seen.push(name.clone());
        }
        assert!(case.is_built());
    }
    assert!(seen.len() >= STRIDE, "{seen:?}");
    for name in ["neighbours", "motion", "quantize", "train", "refine", "lines", "settle", "steps"] {
        assert!(seen.iter().any(|own| own == name), "{name} of {seen:?}");
    }
}

/// What numbers become.
const FORGERIES: usize = 6;

/// Makes another number of one behind the header of a task's file, rather of one that may be a count, a length or an index; gives its place.
fn forge_number(bytes: &mut [u8], how: usize, random: &mut Pcg32) -> usize {
    let width = [4, 8][below(random, 2)];
    let number = |bytes: &[u8], at: usize| {
        bytes[at..at + width].iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte))
    };
    let room = bytes.len() - HEADER - width;
    // Half of them near the end, where values are.
    let mut place = || {
        let among = [room, room.min(600)][below(random, 2)];
        bytes.len() - width - below(random, among + 1)
    };
    let places = [(); 64].map(|()| place());
    let is_count = |at: &&usize| (1..1 << 20).contains(&number(bytes, **at));
    let at = *places.iter().find(is_count).unwrap_or(&places[0]);
    let most = u64::MAX >> (64 - 8 * width);
    let any = u64::from(random.next_u32()) << 32 | u64::from(random.next_u32());
    let next = number(bytes, at).wrapping_add(1);
    let forged: [u64; FORGERIES] = [0, 1, most, most / 2, next, any];
    bytes[at..at + width].copy_from_slice(&forged[how].to_le_bytes()[..width]);
    at
}

/// Runs what is left of a job, one of whose files is forged.
fn forgery_ends_in_a_line_or_an_output(case: &Case, what: &str, bytes: usize) {
    let worked = catch_unwind(AssertUnwindSafe(|| counted(|| case.work())));
    let Ok((worked, took)) = worked else { panic!("{what}: the task has panicked") };
    assert!(took <= most(bytes), "{what}: {took} bytes of memory for {bytes} of files");
    match worked {
        Ok(()) => assert!(case.job.output().exists(), "{what}"),
        Err(error) => {
            let told = error.to_string();
            let folder = case.folder.path().display().to_string();
            assert!(!told.contains('\n') && told.contains(&folder), "{what}: {told}");
        }
    }
}

/// One number of the file of each stage at a time, with the right checksums, and all stages behind it.
#[test]
fn later_stages_bear_forged_numbers() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut random = Pcg32::seed_from_u64(29);
    // Codebooks as a whole, and in parts.
    for tasks in [1, 2] {
        let case = Case::snapshot(800, tasks, true);
        for Stage { name, tasks, .. } in case.job.stages() {
            (0..*tasks).for_each(|task| case.job.run(name, task, None, &()).unwrap());
            let files = case.files();
            let path = case.job.folder().join(format!("{name}.0"));
            let sound = &files[&path];
            if sound.len() < HEADER + 8 {
                continue;
            }
            let all: usize = files.values().map(Vec::len).sum();
            for how in 0..FORGERIES {
                let mut forged = sound.clone();
                let at = forge_number(&mut forged, how, &mut random);
                correct(&mut forged, sound);
                case.put_back(&files);
                std::fs::write(&path, &forged).unwrap();
                forgery_ends_in_a_line_or_an_output(&case, &format!("{name} at {at}, forgery {how}"), all);
            }
            case.put_back(&files);
        }
        assert!(case.is_built());
    }
}
