//! A run of snapshots as a job: the page file of each step is built by a task of its own, as one machine builds it, and a last task puts them
//! together and builds the tracks, which lead from step to step.
//!
//! | stage | tasks | reads | hands on |
//! |---|---|---|---|
//! | steps | for each step | its source | its page file, and the checksum of that |
//! | run | 1 | these; for tracks the sources | the output, under its name |

use super::super::memory::OUTPUT_PARTICLE;
use super::super::{
    BuildError, BuildOptions, RunBuild, StepProgress, TrackOptions, built_of_streams, remove_left, streams_of,
};
use super::parts::Parts;
use super::{Job, MOST_TASKS, absolute, check_particles, job_error, settings};
use crate::import::{Description, LoadOptions, Run, RunOptions, RunStep, Times, open_run, open_with};
use crate::model::portable::portable;
use crate::model::positioned::read_exact_at;
use crate::model::{ClockVariable, Progress, ReadMethod};
use crate::store::StoreError;
use crate::store::temporary::clean;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// The stages.
const STEPS: &str = "steps";
pub(super) const RUN: &str = "run";
/// How names of the steps' page files begin.
pub(super) const STILL: &str = "still";
/// Bytes of the output for each particle's track over an interval at most, with its share of the levels above, about.
const TRACK_PARTICLE: u64 = 28;
/// Bytes that are summed up at a time.
const PIECE: u64 = 1 << 20;

/// What is built of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RunSettings {
    /// In the order of time.
    steps: Vec<StepSettings>,
    /// The steps' times; `None`: those of their headers.
    times: Option<Vec<f64>>,
    clock: ClockVariable,
    /// What was told of the run when it was put together.
    notes: Vec<String>,
    pub output: PathBuf,
    load: LoadOptions,
    pub options: BuildOptions,
    /// `None`: the run has stills alone.
    tracks: Option<TrackOptions>,
}

/// What is built of a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StepSettings {
    /// The source as it was named, which the output tells, and where it is.
    named: PathBuf,
    source: PathBuf,
    /// Its length and its particles of the families that are read, by which it is recognised.
    source_bytes: u64,
    particles: u64,
    /// What is read of it.
    load: LoadOptions,
}

/// A step's page file, as its task has written it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Still {
    len: u64,
    /// CRC-32C of all of it.
    crc: u32,
}

portable!(Still { len, crc });

impl RunSettings {
    /// What is built of a run as `build` says it, into the file `out`.
    ///
    /// # Errors
    /// Where steps are in no files.
    pub fn of(run: &Run, build: &RunBuild, out: &Path) -> Result<RunSettings, BuildError> {
        if run.steps.iter().any(|step| step.frame.is_some()) {
            return Err(job_error(out, "run: found particles that were traced, expected snapshots in files"));
        }
        let steps = run.steps.iter().map(|step| StepSettings::of(&step.about, build.load_of(step, run)));
        Ok(RunSettings {
            steps: steps.collect::<Result<_, _>>()?,
            times: (!run.is_timed_by_headers).then(|| run.steps.iter().map(|step| step.time).collect()),
            clock: run.clock,
            notes: run.notes.clone(),
            output: absolute(out)?,
            load: build.load.clone(),
            options: BuildOptions {
                temporary: build.options.temporary.as_deref().map(absolute).transpose()?,
                ..build.options.clone()
            },
            tracks: build.tracks.copied(),
        })
    }

    pub fn particles(&self) -> u64 {
        self.steps.iter().map(|step| step.particles).sum()
    }

    /// Bytes that page files of all steps take, about; what their tasks put away while they work comes on top.
    pub fn temporary_bytes(&self) -> u64 {
        OUTPUT_PARTICLE * self.particles()
    }

    /// Bytes of the output, about.
    pub fn output_bytes(&self) -> u64 {
        let tracks = self.tracks.filter(|_| self.steps.len() > 1);
        let still = if tracks.is_some_and(|tracks| tracks.no_stills) { 0 } else { OUTPUT_PARTICLE };
        let track = if tracks.is_some() { TRACK_PARTICLE } else { 0 };
        (still + track) * self.particles()
    }

    /// Name and number of tasks of each stage, each of which comes after the one before.
    pub fn stages(&self) -> Vec<(&'static str, u32)> {
        vec![(STEPS, self.steps.len() as u32), (RUN, 1)]
    }

    /// Whether there are as many steps and particles as are planned.
    pub fn check(&self, folder: &Path) -> Result<(), BuildError> {
        match self.steps.len() {
            found if (1..=MOST_TASKS as usize).contains(&found) => {
                check_particles(folder, self.steps.iter().map(|step| step.particles))
            }
            found => {
                let path = folder.join(settings::FILE);
                Err(job_error(&path, &format!("steps: found {found}, expected 1 to {MOST_TASKS}")))
            }
        }
    }

    /// Does what a task of a stage is to do.
    ///
    /// # Errors
    /// Where the result of another is missing or damaged, or something cannot be read or written.
    pub fn run(
        &self,
        job: &Job,
        (stage, task): (&str, u32),
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<(), BuildError> {
        let parts = Parts::of_task(job.names(), job.number(stage, task)?)?;
        match stage {
            STEPS => {
                let (step, total) = (task as usize, self.steps.len());
                let here = StepProgress { progress, step: step + 1, total };
                self.steps[step].build(parts, &still_path(job.folder(), task), options, &here)
            }
            _ => self.join(job, parts, options, progress),
        }
    }

    /// Puts the steps together, and builds tracks.
    fn join(&self, job: &Job, parts: Parts, options: &BuildOptions, progress: &dyn Progress) -> Result<(), BuildError> {
        let stills = AtomicU64::new(0);
        let still_of = |step: &RunStep, _: &LoadOptions, progress: &dyn Progress| {
            let number = self.steps.iter().position(|own| own.source == step.about.path);
            let known = number.map(|number| known_still(job, &parts, number as u32, progress)).transpose()?;
            Ok::<_, BuildError>(known.map(|(path, len)| {
                stills.fetch_add(len, Ordering::Relaxed);
                path
            }))
        };
        let (load, tracks) = (&self.load, self.tracks.as_ref());
        let build = RunBuild { load, options, tracks, skip_damaged: false, still_of: Some(&still_of) };
        // Of a job that was removed nothing comes over what has the output's name now.
        let may_end = || job.check_is_there(job.number(RUN, 0)?);
        let built = build.build_here(self.opened(options.read)?, &self.output, &may_end, progress)?;
        // Stills are summed up, and copied where they are kept.
        let stills = stills.into_inner() * if built.directory.has_stills { 2 } else { 1 };
        let sources = self.steps.iter().map(|step| step.source_bytes).sum::<u64>();
        let read = stills + if built.directory.tracks.is_some() { sources } else { 0 };
        parts.finish(&(), read, built.bytes)
    }

    /// Removes what killed tasks have left outside of the job's folder.
    pub fn remove_left(&self, folder: &Path) {
        remove_left(&self.options, &self.output);
        if let Some(temporary) = &self.options.temporary {
            for step in 0..self.steps.len() as u32 {
                clean(&still_path(folder, step), temporary);
            }
        }
    }

    /// The run, which must be the one that was planned for.
    fn opened(&self, read: ReadMethod) -> Result<Run, BuildError> {
        let files: Vec<PathBuf> = self.steps.iter().map(|step| step.source.clone()).collect();
        let times = self.times.clone().map(Times::List);
        let run = open_run(&files, &RunOptions { times, clock: Some(self.clock), ..RunOptions::default() }, read)?;
        for (number, own) in self.steps.iter().enumerate() {
            match run.steps.get(number).filter(|step| step.about.path == own.source) {
                Some(step) => own.check(&step.about)?,
                None => return Err(own.changed("another order in time")),
            }
        }
        // Names are those that the sources had then.
        Ok(Run { notes: self.notes.clone(), ..run })
    }
}

impl StepSettings {
    fn of(about: &Description, load: LoadOptions) -> Result<StepSettings, BuildError> {
        Ok(StepSettings {
            named: about.path.clone(),
            source: absolute(&about.path)?,
            source_bytes: about.bytes,
            particles: particles(about, &load),
            load,
        })
    }

    /// Whether a source is as it was.
    fn check(&self, about: &Description) -> Result<(), BuildError> {
        match (about.bytes, particles(about, &self.load)) {
            found if found == (self.source_bytes, self.particles) => Ok(()),
            (bytes, particles) => Err(self.changed(&format!("{bytes} bytes and {particles} particles"))),
        }
    }

    fn changed(&self, found: &str) -> BuildError {
        let what = format!("found {found}, expected the source as it was when the job was planned");
        job_error(&self.source, &what)
    }

    /// Builds the step's page file at `path`.
    fn build(
        &self,
        parts: Parts,
        path: &Path,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<(), BuildError> {
        let source = open_with(&self.source, options.read)?;
        self.check(source.description())?;
        let (mut streams, options) = streams_of(source.as_ref(), &self.load, options)?;
        let provenance = &mut streams.about.provenance;
        if provenance.path == self.source {
            provenance.path.clone_from(&self.named);
        }
        let built = built_of_streams(&streams, &options, path, progress)?;
        let io = |source| StoreError::Io { path: path.to_owned(), action: "read", source };
        let still = Still::of(built.file.file(), progress).map_err(io)?;
        parts.check_folder()?;
        built.named()?;
        // A source is read twice.
        parts.finish(&still, 2 * self.source_bytes, still.len)
    }
}

impl Still {
    /// What a file is.
    fn of(file: &File, progress: &dyn Progress) -> io::Result<Still> {
        let len = file.metadata()?.len();
        progress.begin("summing up its page file", len);
        let mut buffer = vec![0; PIECE.min(len) as usize];
        let (mut at, mut crc) = (0, 0);
        while at < len {
            let piece = &mut buffer[..PIECE.min(len - at) as usize];
            read_exact_at(file, piece, at)?;
            crc = crc32c::crc32c_append(crc, piece);
            at += piece.len() as u64;
            progress.advance(piece.len() as u64);
        }
        Ok(Still { len, crc })
    }
}

/// Particles of the families that are read.
fn particles(about: &Description, load: &LoadOptions) -> u64 {
    let is_read = |name| load.families.is_empty() || load.families.contains(name);
    about.families.iter().filter(|info| is_read(&info.name)).map(|info| info.count).sum()
}

/// Where the page file of a step is.
pub(super) fn still_path(folder: &Path, step: u32) -> PathBuf {
    folder.join(format!("{STILL}.{step}"))
}

/// The page file of a step and its length, if it is the one that its task has written.
pub(super) fn known_still(
    job: &Job,
    parts: &Parts,
    step: u32,
    progress: &dyn Progress,
) -> Result<(PathBuf, u64), BuildError> {
    let number = job.number(STEPS, step)?;
    let known: Still = parts.index(number)?;
    let path = still_path(job.folder(), step);
    let found = File::open(&path).and_then(|file| Still::of(&file, progress));
    if found.is_ok_and(|found| found == known) {
        return Ok((path, known.len));
    }
    // It is not done any more.
    job.names().forget(number);
    let what = format!("found other bytes than those that were written, or none; run stage {STEPS}, task {step}");
    Err(job_error(&path, &what))
}
