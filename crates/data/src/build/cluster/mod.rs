//! A build beyond one machine: its stages as tasks that any engine runs, on any machine that sees the job's folder, in any number of
//! processes. A task reads files and writes one ([`parts`]); running it again, twice at the same time or after a loss, does no harm. The
//! page file is the one that [`super::build_source`] writes, byte for byte: the steps are the same functions, and whatever is summed is summed
//! in the same order whoever has the parts. What tasks read of one another is checked where it is read ([`stages`]): files may be forged.
//!
//! | stage | tasks | reads | hands on |
//! |---|---|---|---|
//! | survey | for each input block | the source | ranges, sums, a sample |
//! | plan | 1 | surveys | root cell and buckets of each family |
//! | partition | for each input block | the source | its particles by bucket, counts for histograms |
//! | neighbours | for each group of buckets | particles of the group and around it | densities and smoothing lengths where some are missing |
//! | motion | for each group of buckets, with attributes that are derived | the same | those attributes |
//! | scale | 1 | what was found there | ranges of all columns, how the quantiser scales them |
//! | grow | for each group of buckets | its particles | leaves and grids |
//! | join | 1 | what is known of these | nodes, and what shares a codebook |
//! | quantize | for some codebooks, where each task can have some | what shares one | codes, codebooks, errors, what they do to a picture |
//! | train | else for some codebooks | a sample of the quantities that share one | quantisers |
//! | code | for some parts of these quantities | them | codes, sums by code |
//! | draft | 1 | sums | codebooks |
//! | refine | as code, where codes are refined | quantities and codes | finer codes, how often each is |
//! | lines | 1, where codes are refined | that | codebooks of these |
//! | settle | as code | quantities and codes | what these decode to, errors |
//! | pages | 1 | nodes, codebooks | which nodes each page has, and the footer |
//! | write | for each run of pages | positions and codes | pages, at their places in the file that will be the output |
//! | finish | 1 | checksums | the output, under its name |
//!
//! A run of snapshots has two stages of its own ([`run`]).

mod parts;
mod removing;
mod run;
mod settings;
mod stages;
#[cfg(test)]
mod tests;

use super::coding::leaf_books;
use super::memory::{Memory, check_room};
use super::partition::particle_bytes;
use super::{BuildError, BuildOptions, RunBuild, in_pool, streams_of};
use crate::hierarchy::kind::PCA;
use crate::import::{LoadOptions, Run, open_with};
use crate::model::{ParticleStream, Progress};
use crate::store::temporary::{MARK, folder_of};
use crate::store::{PageFileWriter, StoreError};
use parts::{Header, Names};
pub(super) use parts::{PartError, PartPlace, Parts};
use run::RunSettings;
use serde::Serialize;
use settings::{FamilyTasks, Plan, Settings};
use stages::Task;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Particles that a task reads by default, where a job has neither too few nor too many tasks then.
const TASK_PARTICLES: u64 = 1 << 24;
/// Fewest and most tasks by default that a source is read by.
const TASKS: (u64, u64) = (8, 4096);
/// Tasks of a stage at most, so that their numbers fit everywhere.
pub(super) const MOST_TASKS: u32 = 1 << 16;
/// Particles of a job at most, so that bytes of them can be counted.
const MOST_PARTICLES: u64 = 1 << 56;
/// Codebooks of a family, about: no more tasks have anything to train.
const BOOKS: u32 = 48;

/// What is wrong with a folder that has another job.
const OTHER_JOB: &str = "found another job, expected none or the same one, with source, output, options and --tasks as they were; \
                         `deepfield build --cancel` removes it";

/// How finely a job is cut.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Tasks that the source is read by, about, and as many for each further stage that can use them; `None`: a few fat ones, by the number
    /// of particles and the memory that each may take.
    pub tasks: Option<u32>,
}

/// A stage of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// Number of its tasks, which may run in any order and at the same time.
    pub tasks: u32,
    /// The stages that come before it.
    pub after: Vec<String>,
}

/// How far a job has come.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Status {
    /// Its folder.
    pub job: PathBuf,
    /// The page file.
    pub output: PathBuf,
    /// Whether the page file is there.
    pub finished: bool,
    /// Its stages, in order.
    pub stages: Vec<StageStatus>,
    /// What its tasks have moved so far.
    pub bytes: Moved,
    /// Particles of the source.
    pub particles: u64,
    /// Bytes that its folder takes at most, about, without what tasks put away while they work.
    pub temporary_bytes_needed: u64,
}

/// How far a stage has come.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StageStatus {
    /// Its name.
    pub name: String,
    /// Number of its tasks.
    pub tasks: u32,
    /// Those that are done.
    pub done: u32,
    /// The stages that come before it.
    pub after: Vec<String>,
}

/// Bytes that tasks have moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Moved {
    /// Of the source, about, and of the files of other tasks.
    pub read: u64,
    /// Particles on their way from where they were read to their buckets, and what was found for them.
    pub shuffled: u64,
    /// All else: hierarchies, codes, and the output.
    pub written: u64,
}

/// A build that is cut into tasks.
#[derive(Clone, Debug)]
pub struct Job {
    folder: PathBuf,
    id: u64,
    plan: Plan,
    stages: Vec<Stage>,
}

impl Job {
    /// Plans the build of the page file `out` from the source at `source`, in stages whose numbers of tasks are fixed from here on, and
    /// writes the plan to `folder`. The same plan is opened where it is there already.
    ///
    /// # Errors
    /// When the source cannot be read, the folder holds something else, or it or that of `out` takes no files or has not the room; and for
    /// clusters ([`PCA`]), which are made of whole trees.
    pub fn plan(
        folder: &Path,
        source: &Path,
        load: &LoadOptions,
        options: &BuildOptions,
        split: Split,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<Job, BuildError> {
        Job::begin(folder, Plan::Snapshot(settings(source, load, options, split, out)?), out, progress)
    }

    /// Plans the build of the run file `out`: the one that [`RunBuild::build`] writes of the same run, byte for byte. Each step is built by a task
    /// of its own, and a step that turns out to be damaged ends its task, whatever [`RunBuild::skip_damaged`] says.
    ///
    /// # Errors
    /// As [`Job::plan`], and where particles were traced.
    pub fn plan_run(
        folder: &Path,
        run: &Run,
        build: &RunBuild,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<Job, BuildError> {
        Job::begin(folder, Plan::Run(RunSettings::of(run, build, out)?), out, progress)
    }

    /// Writes a plan to a folder, or finds the same one there.
    fn begin(folder: &Path, plan: Plan, out: &Path, progress: &dyn Progress) -> Result<Job, BuildError> {
        plan.check(folder)?;
        let unwritable = |source| StoreError::Io { path: folder.to_owned(), action: "create", source };
        std::fs::create_dir_all(folder).map_err(unwritable)?;
        if folder.join(settings::FILE).exists() {
            let job = Job::open(folder)?;
            return match job.plan == plan {
                true => Ok(job),
                false => Err(job_error(folder, OTHER_JOB)),
            };
        }
        // A plan that was killed may have left what it had of its file.
        let entries = std::fs::read_dir(folder).map_err(unwritable)?.filter_map(Result::ok);
        if let Some(found) = entries.map(|entry| entry.file_name()).find(|name| !is_begun_plan(name)) {
            let found = found.to_string_lossy();
            return Err(job_error(folder, &format!("found {found}, expected an empty folder for the job")));
        }
        // Nothing stays of it.
        drop(PageFileWriter::create(plan.output())?);
        let (temporary_bytes, output_bytes) = (plan.temporary_bytes(), plan.output_bytes());
        check_room(folder, temporary_bytes, plan.output())?;
        check_room(folder_of(plan.output()), output_bytes, plan.output())?;
        let id = settings::write(folder, &plan)?;
        let job = Job::of(folder, id, plan);
        let mebibytes = |bytes: u64| bytes.div_ceil(1 << 20);
        progress.say(&format!(
            "{} tasks; up to about {} MiB in {} and {} MiB for {}",
            job.names().tasks(),
            mebibytes(temporary_bytes),
            folder.display(),
            mebibytes(output_bytes),
            out.display()
        ));
        Ok(job)
    }

    /// Opens the job in a folder.
    ///
    /// # Errors
    /// Where there is none, or its plan is damaged.
    pub fn open(folder: &Path) -> Result<Job, BuildError> {
        let (id, plan) = settings::read(folder)?;
        plan.check(folder)?;
        Ok(Job::of(folder, id, plan))
    }

    fn of(folder: &Path, id: u64, plan: Plan) -> Job {
        let mut stages: Vec<Stage> = Vec::new();
        for (name, tasks) in plan.stages() {
            let after = stages.last().map(|stage| stage.name.clone()).into_iter().collect();
            stages.push(Stage { name: name.to_owned(), tasks, after });
        }
        Job { folder: folder.to_owned(), id, plan, stages }
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The page file, or the run, that it builds.
    pub fn output(&self) -> &Path {
        self.plan.output()
    }

    /// Its stages, in order.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Runs task `task`, from 0, of a stage; one whose result is there returns at once. `memory` bounds it as [`BuildOptions::memory`] bounds
    /// a build; `None`: by what the job was planned with.
    ///
    /// # Errors
    /// Where there is no such task, the result of one that it needs is missing or damaged, or something cannot be read or written; and where the
    /// job is removed meanwhile: nothing is left of the task then.
    pub fn run(&self, stage: &str, task: u32, memory: Option<u64>, progress: &dyn Progress) -> Result<(), BuildError> {
        let number = self.number(stage, task)?;
        if self.done(&self.names(), number).is_some() {
            return Ok(());
        }
        let mut options = self.plan.options().clone();
        options.memory = memory.or(options.memory);
        let ran = in_pool(&options, || match &self.plan {
            Plan::Snapshot(settings) => Task::new(self, settings, number, &options, progress)?.run(stage, task),
            Plan::Run(settings) => settings.run(self, (stage, task), &options, progress),
        });
        // Where it is not, that is why a task has failed.
        self.check_is_there(number)?;
        ran
    }

    /// How far it has come.
    ///
    /// # Errors
    /// When its folder cannot be read.
    pub fn status(&self) -> Result<Status, BuildError> {
        let names = self.names();
        let mut moved = Moved::default();
        let mut stages = Vec::with_capacity(self.stages.len());
        for (index, Stage { name, tasks, after }) in self.stages.iter().enumerate() {
            let done = (0..*tasks).filter_map(|task| self.done(&names, names.number(index, task)));
            let done: Vec<Header> = done.collect();
            // Numbers that were forged do not add up.
            let add =
                |sum: &mut u64, of: fn(&Header) -> u64| *sum = done.iter().map(of).fold(*sum, u64::saturating_add);
            add(&mut moved.read, |header| header.read);
            match name.as_str() {
                "partition" | "neighbours" | "motion" => add(&mut moved.shuffled, Header::bytes),
                _ => add(&mut moved.written, |header| header.bytes().saturating_add(header.written)),
            }
            stages.push(StageStatus {
                name: name.clone(),
                tasks: *tasks,
                done: done.len() as u32,
                after: after.clone(),
            });
        }
        Ok(Status {
            job: self.folder.clone(),
            output: self.output().to_owned(),
            finished: stages.last().is_some_and(|last| last.done == last.tasks),
            stages,
            bytes: moved,
            particles: self.plan.particles(),
            temporary_bytes_needed: self.plan.temporary_bytes(),
        })
    }

    /// The file that will be the output.
    fn growing(&self) -> PathBuf {
        let mut name = std::ffi::OsString::from(".");
        name.push(self.output().file_name().unwrap_or_default());
        name.push(format!(".{:016x}.part", self.id));
        folder_of(self.output()).join(name)
    }

    fn names(&self) -> Names {
        let stages = self.stages.iter().map(|stage| (stage.name.clone(), stage.tasks)).collect();
        Names { folder: self.folder.clone(), job: self.id, stages }
    }

    /// The header of a task that is done, of the last one while its output is there.
    fn done(&self, names: &Names, number: u32) -> Option<Header> {
        names.done(number).filter(|_| number + 1 < names.tasks() || self.output().exists())
    }

    /// The number in the job of a task.
    fn number(&self, stage: &str, task: u32) -> Result<u32, BuildError> {
        let error = |what: String| Err(job_error(&self.folder, &what));
        let Some(index) = self.stages.iter().position(|own| own.name == stage) else {
            let names: Vec<&str> = self.stages.iter().map(|own| own.name.as_str()).collect();
            return error(format!("stage: found {stage:?}, expected one of {}", names.join(", ")));
        };
        let tasks = self.stages[index].tasks;
        if task >= tasks {
            return error(format!("task: found {task} of stage {stage}, expected 0 to {}", tasks - 1));
        }
        Ok(self.names().number(index, task))
    }
}

impl Settings {
    fn particles(&self) -> u64 {
        self.families.iter().map(|family| family.particles).sum()
    }

    /// Name and number of tasks of each stage, each of which comes after the one before.
    fn stages(&self) -> Vec<(&'static str, u32)> {
        let input = self.families.iter().map(|family| family.input).sum();
        let groups = self.families.iter().map(|family| family.groups).sum();
        let mut stages =
            vec![("survey", input), ("plan", 1), ("partition", input), ("neighbours", groups), ("motion", groups)];
        if self.load.derive.is_empty() {
            stages.pop();
        }
        stages.extend([("scale", 1), ("grow", groups), ("join", 1)]);
        if self.has_whole_books() {
            stages.push(("quantize", self.code));
        } else {
            stages.extend([("train", self.train), ("code", self.code), ("draft", 1)]);
            if self.options.octree.code_bits().is_refined() {
                stages.extend([("refine", self.code), ("lines", 1)]);
            }
            stages.push(("settle", self.code));
        }
        stages.extend([("pages", 1), ("write", self.write), ("finish", 1)]);
        stages
    }

    /// Whether tasks code what shares a codebook as a whole: where leaves alone have as many codebooks as there are tasks, which each have
    /// enough to do then and need not wait for one another.
    fn has_whole_books(&self) -> bool {
        let bits = self.options.octree.code_bits().entries;
        let books: u64 = self.families.iter().map(|family| leaf_books(family.particles, bits)).sum();
        u64::from(self.code) <= books
    }

    /// Whether numbers of tasks and particles are such as are planned.
    fn check(&self, folder: &Path) -> Result<(), BuildError> {
        let families = &self.families;
        if families.is_empty() {
            return Err(job_error(&folder.join(settings::FILE), "families: found none, expected at least one"));
        }
        let most = u64::from(MOST_TASKS);
        let counts = families.iter().flat_map(|family| [("input", family.input), ("groups", family.groups)]);
        let counts = counts.chain([("train", self.train), ("code", self.code), ("write", self.write)]);
        let counts = counts.map(|(name, tasks)| (name, u64::from(tasks), most));
        // However small a family is, it has a task of its own.
        let total =
            |tasks: fn(&FamilyTasks) -> u32| families.iter().map(|family| u64::from(tasks(family))).sum::<u64>();
        let totals = [total(|family| family.input), total(|family| family.groups)];
        let mut counts = counts.chain([("input", totals[0], 2 * most), ("groups", totals[1], 2 * most)]);
        match counts.find(|(_, tasks, most)| !(1..=*most).contains(tasks)) {
            Some((name, found, most)) => {
                let path = folder.join(settings::FILE);
                Err(job_error(&path, &format!("{name}: found {found} tasks, expected 1 to {most}")))
            }
            None => check_particles(folder, families.iter().map(|family| family.particles)),
        }
    }
}

/// Whether a plan has this name until it is complete.
fn is_begun_plan(name: &OsStr) -> bool {
    name.to_str().and_then(|name| name.strip_prefix(settings::FILE)).is_some_and(|rest| rest.starts_with(MARK))
}

/// Whether there are no more particles than can be.
fn check_particles(folder: &Path, mut counts: impl Iterator<Item = u64>) -> Result<(), BuildError> {
    match counts.try_fold(0_u64, |sum, count| sum.checked_add(count).filter(|sum| *sum <= MOST_PARTICLES)) {
        Some(_) => Ok(()),
        None => {
            let what = format!("particles: found more than {MOST_PARTICLES}, expected at most so many");
            Err(job_error(&folder.join(settings::FILE), &what))
        }
    }
}

fn job_error(path: &Path, what: &str) -> BuildError {
    BuildError::Job { path: path.to_owned(), what: what.to_owned() }
}

/// A path as all processes of a job find it.
fn absolute(path: &Path) -> Result<PathBuf, BuildError> {
    let io = |source| StoreError::Io { path: path.to_owned(), action: "find", source };
    Ok(std::path::absolute(path).map_err(io)?)
}

/// Looks at the source and decides what the tasks are.
fn settings(
    source: &Path,
    load: &LoadOptions,
    options: &BuildOptions,
    split: Split,
    out: &Path,
) -> Result<Settings, BuildError> {
    let named = source.to_owned();
    let (source, output) = (absolute(source)?, absolute(out)?);
    let opened = open_with(&source, options.read)?;
    let (streams, options) = streams_of(opened.as_ref(), load, options)?;
    if options.hierarchies.has(&PCA) {
        let what =
            format!("hierarchy: found {}, expected octree: clusters are built by one machine", options.hierarchies);
        return Err(job_error(out, &what));
    }
    let particles: u64 = streams.families.iter().map(ParticleStream::particles).sum();
    let columns =
        |stream: &dyn ParticleStream| stream.all_attributes().len() + stream.columns() - stream.attributes().len();
    let largest = streams.families.iter().map(|stream| particle_bytes(columns(stream))).max().unwrap_or(0);
    let by_memory = options.memory.map_or(0, |memory| particles.saturating_mul(2 * largest) / memory.max(1));
    let usual = (particles / TASK_PARTICLES).max(by_memory).clamp(TASKS.0, TASKS.1);
    let tasks = split.tasks.map_or(usual, u64::from).clamp(1, u64::from(MOST_TASKS));
    let families: Vec<FamilyTasks> = streams
        .families
        .iter()
        .map(|stream| {
            let own = stream.particles();
            let share = (u128::from(tasks) * u128::from(own)).div_ceil(u128::from(particles.max(1))).max(1) as u64;
            let buckets = own / options.octree.bucket_size(own).max(1) as u64 + 1;
            FamilyTasks {
                name: stream.family(),
                particles: own,
                chunks: stream.chunks(),
                input: share.min(stream.chunks().max(1) as u64) as u32,
                groups: share.min(2 * buckets) as u32,
            }
        })
        .collect();
    let mut settings = Settings {
        source_bytes: opened.description().bytes,
        temporary_bytes: 0,
        train: (tasks as u32).min(BOOKS * families.len().max(1) as u32),
        code: tasks as u32,
        write: tasks as u32,
        named,
        source,
        output,
        load: load.clone(),
        families,
        options,
    };
    let in_parts = !settings.has_whole_books();
    let of_family = streams.families.iter().zip(&settings.families).map(|(stream, own)| {
        let tasks = (own.input, own.groups);
        Memory::of_job(&settings.options, stream, columns(stream), tasks, in_parts)
    });
    settings.temporary_bytes = of_family.fold(0, u64::saturating_add);
    Ok(settings)
}
