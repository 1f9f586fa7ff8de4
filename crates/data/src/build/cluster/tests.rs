mod groups;
mod told;

use super::*;
use crate::build::build_source;
use crate::codec::VqBits;
use crate::hierarchy::{Kinds, OctreeOptions};
use crate::import::{
    AttributeChoice, Description, FamilyInfo, Field, FieldKind, Format, ImportError, Source, register,
};
use crate::model::{DerivedQuantity, FamilyName, ReadMethod, Unit};
use proptest::prelude::*;
use rayon::prelude::*;
use serde::Deserialize;
use std::ops::Range;
use std::sync::{Mutex, Once};

/// A source that is made up as it is read: gas, some of it without densities, and dark matter that has masses alone. Half of either lies in a
/// corner so small that buckets end inside of merging cells.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct MadeUp {
    seed: u64,
    gas: u64,
    dark: u64,
    /// Whether some of the gas has no density.
    is_lacking: bool,
}

/// How files begin that say what is made up.
const MADE_UP: &[u8] = b"made up: ";

impl MadeUp {
    /// A number from 0 to 1 for a component of a field of a particle.
    fn number(&self, family: usize, field: usize, particle: u64, component: u64) -> f64 {
        let place = [family as u64, field as u64, particle, component];
        let mixed = place.into_iter().fold(self.seed, |state, word| {
            let mixed = (state ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9)
        });
        (mixed >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn write(&self, path: &Path) {
        std::fs::write(path, [MADE_UP, &serde_json::to_vec(self).unwrap()].concat()).unwrap();
    }
}

struct MadeUpFormat;

impl Format for MadeUpFormat {
    fn name(&self) -> &'static str {
        "made-up"
    }

    fn recognise(&self, head: &[u8], _: u64) -> bool {
        head.starts_with(MADE_UP)
    }

    fn open(&self, path: &Path, _: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        let bytes = std::fs::read(path).unwrap();
        let made_up: MadeUp = serde_json::from_slice(&bytes[MADE_UP.len()..]).unwrap();
        let field = |name: &str, components: usize, kind: FieldKind| Field {
            name: name.into(),
            stored_as: name.into(),
            unit: Unit::default(),
            components,
            kind,
        };
        let all = [
            field("position", 3, FieldKind::Position),
            field("velocity", 3, FieldKind::Velocity),
            field("mass", 1, FieldKind::Mass),
            field("smoothing-length", 1, FieldKind::SmoothingLength),
            field("density", 1, FieldKind::Density),
            field("temperature", 1, FieldKind::Other),
            field("b-magnitude", 1, FieldKind::Other),
        ];
        let families = [(FamilyName::Gas, made_up.gas, &all[..]), (FamilyName::Dark, made_up.dark, &all[..3])];
        let families = families.into_iter().filter(|(_, count, _)| *count > 0);
        let description = Description {
            families: families
                .map(|(name, count, fields)| FamilyInfo { name, count, fields: fields.to_vec() })
                .collect(),
            ..Description::unitless(path, "made-up", bytes.len() as u64)
        };
        Ok(Box::new(Opened { made_up, description }))
    }
}

struct Opened {
    made_up: MadeUp,
    description: Description,
}

impl Source for Opened {
    fn description(&self) -> &Description {
        &self.description
    }

    fn read(&self, family: usize, field: usize, range: Range<u64>, out: &mut [f64]) -> Result<(), ImportError> {
        let components = self.description.check_range(family, field, &range, out.len())?.components;
        for (particle, values) in range.zip(out.chunks_exact_mut(components)) {
            let number = |component: usize| self.made_up.number(family, field, particle, component as u64);
            let is_far = particle % 2 == 0;
            for (component, value) in values.iter_mut().enumerate() {
                let x = number(component);
                *value = match field {
                    0 if is_far => x * x,
                    0 => 0.3 + 1e-4 * x,
                    1 => 100.0 * (x - 0.5),
                    2 => 1.0 + x,
                    // One is left out.
                    3 if particle == 7 => -1.0,
                    3 => (if is_far { 0.05 } else { 4e-6 }) * (0.5 + x),
                    4 if self.made_up.is_lacking && particle % 5 == 0 => f64::NAN,
                    4 => 0.5 + x,
                    5 if particle % 11 == 0 => f64::NAN,
                    5 => 1e4 * x,
                    _ => 20.0 + 5.0 * x,
                };
            }
        }
        Ok(())
    }
}

/// A folder with a source, and what is to be built of it.
struct Case {
    folder: tempfile::TempDir,
    load: LoadOptions,
    options: BuildOptions,
}

impl Case {
    fn new(made_up: &MadeUp, load: LoadOptions, options: BuildOptions) -> Case {
        static KNOWN: Once = Once::new();
        KNOWN.call_once(|| register(&MadeUpFormat).unwrap());
        let folder = tempfile::tempdir().unwrap();
        made_up.write(&folder.path().join("source"));
        Case { folder, load, options }
    }

    /// Of a small source, with tiny buckets.
    fn small() -> Case {
        let made_up = MadeUp { seed: 1, gas: 3000, dark: 0, is_lacking: false };
        Case::new(&made_up, LoadOptions::default(), options(VqBits::Eight, 300, 100, true))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// What one machine builds.
    fn expected(&self) -> Vec<u8> {
        let out = self.path("alone.df");
        build_source(&self.path("source"), &self.load, &self.options, &out, &()).unwrap();
        std::fs::read(out).unwrap()
    }

    fn plan(&self, tasks: u32) -> Result<Job, BuildError> {
        let split = Split { tasks: Some(tasks) };
        let (folder, source, out) = (self.path("job"), self.path("source"), self.path("out.df"));
        Job::plan(&folder, &source, &self.load, &self.options, split, &out, &())
    }

    fn built(&self) -> Vec<u8> {
        std::fs::read(self.path("out.df")).unwrap()
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

fn options(bits: VqBits, bucket: usize, leaf: usize, volume_levels: bool) -> BuildOptions {
    let octree = OctreeOptions {
        bucket_particles: Some(bucket),
        leaf_capacity: leaf,
        volume_levels,
        ..BuildOptions::with_vq_bits(bits).octree
    };
    BuildOptions { octree, page_bytes: 1 << 14, ..BuildOptions::default() }
}

fn run_all(job: &Job) {
    run_before(job, "");
}

/// Runs all stages before the one of this name.
fn run_before(job: &Job, stage: &str) {
    for Stage { name, tasks, .. } in job.stages().iter().take_while(|own| own.name != stage) {
        (0..*tasks).for_each(|task| job.run(name, task, None, &()).unwrap());
    }
}

proptest! {
    #![proptest_config(crate::cases::cases(6))]

    /// Whatever the tasks, their order, how often and by how many at a time they are run, and with how much memory.
    #[test]
    fn the_file_is_that_of_one_machine(
        (seed, gas, dark) in (any::<u64>(), 2000..9000_u64, prop_oneof![Just(0), 1000..5000_u64]),
        bits in prop::sample::select(vec![VqBits::Eight, VqBits::Twelve, VqBits::Sixteen]),
        (bucket, leaf) in (200..2000_usize, 40..400_usize),
        (is_lacking, volume_levels, derives, is_refined) in any::<(bool, bool, bool, bool)>(),
        attributes in prop::sample::select(vec!["", "temperature", "temperature,b-magnitude"]),
        tasks in 1..9_u32,
        order: u64,
    ) {
        let attributes: Vec<String> =
            attributes.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
        let load = LoadOptions {
            attributes: AttributeChoice::Named(attributes.clone()),
            derive: if derives { vec![DerivedQuantity::VelocityDispersion] } else { Vec::new() },
            ..LoadOptions::default()
        };
        let mut options = options(bits, bucket, leaf, volume_levels);
        options.octree.refined = is_refined;
        options.attributes = Some(attributes);
        let case = Case::new(&MadeUp { seed, gas, dark, is_lacking }, load, options);
        let job = case.plan(tasks).unwrap();
        let mut state = order;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % below
        };
        for Stage { name, tasks, .. } in job.stages() {
            let mut order: Vec<u32> = (0..*tasks).chain(0..*tasks).collect();
            for i in (1..order.len()).rev() {
                order.swap(i, random(i as u64 + 1) as usize);
            }
            // With none runs of particles are as short as may be.
            let memory = Some(if name == "partition" { 0 } else { (24 + random(40)) << 20 });
            order.par_iter().for_each(|task| job.run(name, *task, memory, &()).unwrap());
        }
        prop_assert!(case.built() == case.expected());
        let status = job.status().unwrap();
        prop_assert!(status.finished && status.stages.iter().all(|stage| stage.done == stage.tasks));
        prop_assert!(status.bytes.shuffled > 16 * gas && status.bytes.written > case.built().len() as u64);
        job.remove().unwrap();
        prop_assert_eq!(case.names(), ["alone.df", "out.df", "source"]);
    }

    /// What is lost, cut off or changed at any time is made again.
    #[test]
    fn what_is_damaged_is_made_again(
        harms in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0..3_u8), 1..12),
    ) {
        let case = Case::small();
        let job = case.plan(3).unwrap();
        let mut harms = harms.into_iter();
        let mut rounds = 0;
        while !job.status().unwrap().finished {
            rounds += 1;
            prop_assert!(rounds < 100);
            // As an engine does that looks for what is left, and begins again where something is missing.
            let is_left = |stage: &&StageStatus| stage.done < stage.tasks;
            let stages = job.status().unwrap().stages;
            let Some(stage) = stages.iter().find(is_left) else { continue };
            for task in 0..stage.tasks {
                match job.run(&stage.name, task, None, &()) {
                    Ok(()) => {}
                    Err(BuildError::Job { what, .. }) => prop_assert!(what.contains("run stage "), "{}", what),
                    Err(other) => return Err(TestCaseError::fail(other.to_string())),
                }
            }
            if let Some((which, place, how)) = harms.next().filter(|_| rounds % 2 == 0) {
                let mut files: Vec<PathBuf> =
                    std::fs::read_dir(case.path("job")).unwrap().map(|entry| entry.unwrap().path()).collect();
                files.retain(|path| !path.ends_with(settings::FILE));
                files.extend(Some(job.growing()).filter(|path| path.exists()));
                files.sort();
                let path = which.get(&files);
                let mut bytes = std::fs::read(path).unwrap();
                let at = place.index(bytes.len());
                match how {
                    0 => std::fs::remove_file(path).unwrap(),
                    1 => std::fs::write(path, &bytes[..at]).unwrap(),
                    _ => {
                        bytes[at] ^= 1 << (at % 8);
                        std::fs::write(path, &bytes).unwrap();
                    }
                }
            }
        }
        prop_assert!(case.built() == case.expected());
    }

    /// Whatever of a plan is changed or cut off is told.
    #[test]
    fn damaged_plans_are_told(place: prop::sample::Index, bit in 0..8_u8, cut: bool) {
        let case = Case::small();
        let job = case.plan(2).unwrap();
        let path = case.path("job").join(settings::FILE);
        let mut bytes = std::fs::read(&path).unwrap();
        let at = place.index(bytes.len());
        if cut { bytes.truncate(at) } else { bytes[at] ^= 1 << bit };
        std::fs::write(&path, &bytes).unwrap();
        match Job::open(&case.path("job")) {
            // White space may have become other white space.
            Ok(same) => prop_assert_eq!(same.plan, job.plan),
            Err(error) => prop_assert!(error.to_string().contains(settings::FILE), "{}", error),
        }
    }
}

/// Leaves have as many codebooks as two tasks here, each of which has some as a whole; three have parts of all.
#[test]
fn codebooks_are_coded_as_a_whole_or_in_parts() {
    for is_refined in [false, true] {
        let mut options = options(VqBits::Eight, 8000, 500, true);
        options.octree.refined = is_refined;
        let made_up = MadeUp { seed: 3, gas: 40_000, dark: 0, is_lacking: false };
        let case = Case::new(&made_up, LoadOptions::default(), options);
        let expected = case.expected();
        for (tasks, is_whole) in [(2, true), (3, false)] {
            let job = case.plan(tasks).unwrap();
            let has = |name: &str| job.stages().iter().any(|stage| stage.name == name);
            assert_eq!((has("quantize"), has("train"), has("settle")), (is_whole, !is_whole, !is_whole));
            for Stage { name, tasks, .. } in job.stages() {
                // The first with all of a codebook in memory, and as many parts at a time as there are threads; others with nothing of it, and one.
                let codes = ["quantize", "code", "refine", "settle"].contains(&name.as_str());
                let memory = |task: u32| (codes && task > 0).then_some(0);
                (0..*tasks).into_par_iter().for_each(|task| job.run(name, task, memory(task), &()).unwrap());
            }
            assert!(case.built() == expected, "{tasks} tasks, refined: {is_refined}");
            job.remove().unwrap();
            assert_eq!(case.names(), ["alone.df", "out.df", "source"]);
        }
    }
}

/// Also where samples, and sums for each of many codes, outweigh the particles.
#[test]
fn a_job_takes_no_more_than_is_said_of_it() {
    let of = |bits, bucket, gas| {
        let made_up = MadeUp { seed: 4, gas, dark: 0, is_lacking: true };
        Case::new(&made_up, LoadOptions::default(), options(bits, bucket, 500, true))
    };
    let cases = [
        (Case::small(), 3),
        (of(VqBits::Sixteen, 20_000, 12_000), 3),
        (of(VqBits::Eight, 8000, 40_000), 3),
        (of(VqBits::Eight, 8000, 40_000), 2),
    ];
    for (case, tasks) in cases {
        let job = case.plan(tasks).unwrap();
        run_all(&job);
        let files = std::fs::read_dir(case.path("job")).unwrap();
        let held: u64 = files.map(|file| file.unwrap().metadata().unwrap().len()).sum();
        let said = job.status().unwrap().temporary_bytes_needed;
        assert!(held <= said, "{tasks} tasks: {held} bytes, said to be up to {said}");
    }
}

/// Each value of a plan, with another one in its place, or none.
#[test]
fn every_field_of_a_plan_is_checked() {
    let case = Case::small();
    case.plan(2).unwrap();
    let path = case.path("job").join(settings::FILE);
    let text = std::fs::read_to_string(&path).unwrap();
    let whole: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut pointers = Vec::new();
    let mut waiting = vec![(String::new(), whole.clone())];
    while let Some((pointer, value)) = waiting.pop() {
        match &value {
            serde_json::Value::Object(fields) => {
                waiting.extend(fields.iter().map(|(name, field)| (format!("{pointer}/{name}"), field.clone())));
            }
            serde_json::Value::Array(items) => {
                waiting.extend(items.iter().enumerate().map(|(i, item)| (format!("{pointer}/{i}"), item.clone())));
            }
            _ => {}
        }
        pointers.push(pointer);
    }
    assert!(pointers.len() > 40);
    for pointer in pointers {
        for other in
            [serde_json::json!(null), serde_json::json!(1e9), serde_json::json!("other"), serde_json::json!([[]])]
        {
            let mut changed = whole.clone();
            *changed.pointer_mut(&pointer).unwrap() = other;
            if changed == whole {
                continue;
            }
            std::fs::write(&path, changed.to_string()).unwrap();
            let error = Job::open(&case.path("job")).unwrap_err().to_string();
            assert!(error.contains(settings::FILE), "{pointer}: {error}");
        }
    }
    std::fs::write(&path, whole.to_string()).unwrap();
    Job::open(&case.path("job")).unwrap();
}

#[test]
fn plans_are_opened_again_and_others_refused() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    job.run("survey", 0, None, &()).unwrap();
    assert_eq!(case.plan(2).unwrap().status().unwrap().stages[0].done, 1);
    let other = case.plan(1).unwrap_err().to_string();
    assert!(other.contains("found another job"), "{other}");
    let occupied = case.path("occupied");
    std::fs::create_dir(&occupied).unwrap();
    std::fs::write(occupied.join("thesis.tex"), "").unwrap();
    let plan = |folder: &Path, options: &BuildOptions, out: &Path| {
        Job::plan(folder, &case.path("source"), &case.load, options, Split::default(), out, &())
            .unwrap_err()
            .to_string()
    };
    let found = plan(&occupied, &case.options, &case.path("other.df"));
    assert!(found.contains("found thesis.tex, expected an empty folder"), "{found}");
    // What is left of a plan that was killed is no job, and goes with the next one.
    let killed = case.path("killed");
    std::fs::create_dir(&killed).unwrap();
    std::fs::write(killed.join("job.json.tmpKilled"), "").unwrap();
    let (source, other) = (case.path("source"), case.path("other.df"));
    let planned = Job::plan(&killed, &source, &case.load, &case.options, Split::default(), &other, &());
    planned.unwrap().remove().unwrap();
    assert!(!killed.exists());
    let nowhere = plan(&case.path("none"), &case.options, &case.path("no").join("other.df"));
    assert!(nowhere.contains("other.df"), "{nowhere}");
    let clusters = BuildOptions { hierarchies: Kinds::of_particles(), ..case.options.clone() };
    let refused = plan(&case.path("none"), &clusters, &case.path("other.df"));
    assert!(refused.contains("hierarchy: found octree,pca, expected octree"), "{refused}");
}

#[test]
fn what_is_missing_is_named_and_tasks_that_are_none_too() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    let told = |stage: &str, task: u32| job.run(stage, task, None, &()).unwrap_err().to_string();
    assert!(told("grow", 0).ends_with("run stage scale, task 0"), "{}", told("grow", 0));
    assert!(told("plan", 0).ends_with("run stage survey, task 0"), "{}", told("plan", 0));
    #[cfg(unix)]
    {
        // What is there and cannot be read is not said to be damaged.
        let unreadable = case.path("job").join("survey.0");
        std::fs::create_dir(&unreadable).unwrap();
        let found = told("plan", 0);
        assert!(found.contains("survey.0: ") && !found.contains("run stage"), "{found}");
        std::fs::remove_dir(unreadable).unwrap();
    }
    assert!(told("grow", 99).contains("task: found 99 of stage grow, expected 0 to "));
    assert!(told("bake", 0).contains("stage: found \"bake\", expected one of survey, plan, "));
    // A source that has changed is none of this job.
    MadeUp { seed: 1, gas: 30_000, dark: 0, is_lacking: false }.write(&case.path("source"));
    assert!(told("survey", 0).contains("as it was when the job was planned"));
    job.remove().unwrap();
    assert_eq!(case.names(), ["source"]);
}

/// With as many bytes and particles, but others, so that it is told by what is read of it.
#[test]
fn a_source_that_is_written_again_is_told() {
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "partition");
    let write = |seed: u64| MadeUp { seed, gas: 3000, dark: 0, is_lacking: false }.write(&case.path("source"));
    write(2);
    let told = job.run("partition", 0, None, &()).unwrap_err().to_string();
    assert!(told.contains("source: found other values than stage survey has read, expected the source as"), "{told}");
    write(1);
    run_all(&job);
    assert!(case.built() == case.expected());
}

/// Whenever it is given up.
#[test]
fn cancelled_jobs_leave_nothing() {
    let case = Case::small();
    let stages = case.plan(2).unwrap().stages().to_vec();
    for last in 0..stages.len() {
        let job = case.plan(2).unwrap();
        for Stage { name, tasks, .. } in &stages[..last] {
            (0..*tasks).for_each(|task| job.run(name, task, None, &()).unwrap());
        }
        // As killed tasks leave them where files need names, and schedulers what they are told.
        let folder = case.path("job");
        for name in ["grow.0.tmpKilled", "spill.1.tmpKilled", "job.json.tmpKilled", "submit.sh"] {
            std::fs::write(folder.join(name), "").unwrap();
        }
        std::fs::create_dir(folder.join("logs")).unwrap();
        std::fs::write(folder.join("logs").join("grow-0-12-3.log"), "").unwrap();
        job.remove().unwrap();
        assert_eq!(case.names(), ["source"], "before {}", stages[last].name);
    }
    // What is somebody else's stays.
    let job = case.plan(2).unwrap();
    run_all(&job);
    std::fs::write(case.path("job").join("notes.txt"), "").unwrap();
    job.remove().unwrap();
    assert_eq!(case.names(), ["job", "out.df", "source"]);
    assert_eq!(std::fs::read_dir(case.path("job")).unwrap().count(), 1);
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

/// Neither results, in a folder that stays for what others keep there, nor the output, which `write` begins after that.
#[test]
fn tasks_whose_job_is_cancelled_while_they_run_leave_nothing() {
    let case = Case::small();
    let mut cancelled = Vec::new();
    for Stage { name, .. } in case.plan(2).unwrap().stages() {
        let job = case.plan(2).unwrap();
        run_before(&job, name);
        std::fs::write(case.path("job").join("notes.txt"), "").unwrap();
        let cancelling = Cancelling(Mutex::new(Some(job.clone())));
        let ran = job.run(name, 0, None, &cancelling);
        // Short stages do not say that they begin.
        match cancelling.0.into_inner().unwrap() {
            Some(job) => job.remove().unwrap(),
            None => {
                let told = ran.unwrap_err().to_string();
                assert!(
                    told.ends_with("was removed (`deepfield build --cancel`) while the task ran"),
                    "{name}: {told}"
                );
                cancelled.push(name.clone());
            }
        }
        assert_eq!(case.names(), ["job", "source"], "{name}");
        assert_eq!(std::fs::read_dir(case.path("job")).unwrap().count(), 1, "{name}");
        std::fs::remove_dir_all(case.path("job")).unwrap();
    }
    for name in ["survey", "partition", "grow", "write", "finish"] {
        assert!(cancelled.iter().any(|own| own == name), "{name} of {cancelled:?}");
    }
}

/// The next job in the folder is the same one, planned again, or another: no result of it goes, and none of the one before is taken for one.
#[test]
fn tasks_of_cancelled_jobs_leave_results_of_the_next_one() {
    let case = Case::small();
    let expected = case.expected();
    for tasks in [2, 3] {
        let old = case.plan(2).unwrap();
        old.clone().remove().unwrap();
        let next = case.plan(tasks).unwrap();
        let done = || next.status().unwrap().stages.iter().map(|stage| stage.done).collect::<Vec<u32>>();
        for Stage { name, tasks, .. } in next.stages() {
            (0..*tasks).for_each(|task| next.run(name, task, None, &()).unwrap());
            let before = done();
            for Stage { name, .. } in old.stages() {
                let told = old.run(name, 0, None, &()).unwrap_err().to_string();
                assert!(told.ends_with("while the task ran"), "{name}: {told}");
            }
            assert_eq!(done(), before, "{name} of {tasks} tasks");
        }
        assert!(case.built() == expected, "{tasks} tasks");
        next.remove().unwrap();
        assert_eq!(case.names(), ["alone.df", "out.df", "source"]);
        std::fs::remove_file(case.path("out.df")).unwrap();
    }
}

/// What has the folder's name then is nothing, but the job is there, and so are its pages.
#[cfg(unix)]
#[test]
fn a_job_that_is_moved_while_a_task_runs_keeps_its_pages() {
    struct Moving([PathBuf; 2]);
    impl Progress for Moving {
        fn begin(&self, _: &str, _: u64) {
            let _ = std::fs::rename(&self.0[0], &self.0[1]);
        }

        fn advance(&self, _: u64) {}
    }
    let case = Case::small();
    let job = case.plan(2).unwrap();
    run_before(&job, "finish");
    let moving = Moving(["job", "moved"].map(|name| case.path(name)));
    job.run("finish", 0, None, &moving).unwrap_err();
    let moved = Job::open(&case.path("moved")).unwrap();
    moved.run("finish", 0, None, &()).unwrap();
    assert!(case.built() == case.expected());
}
