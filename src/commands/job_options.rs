//! Options of `build` for a build that is cut into tasks.

use super::arguments::bytes;
use super::progress_bar::TerminalProgress;
use super::{CommandResult, slurm};
use crate::build::cluster::{Job, Split, StageStatus, Status};
use crate::build::{BuildOptions, RunBuild};
use crate::import::{LoadOptions, Run};
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A build by many processes, of one machine or of several.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Many processes")]
pub struct JobOptions {
    /// Build nothing yet: cut the build into tasks and write the plan to this folder, which all machines have to see. The tasks are run by
    /// `deepfield stage`; the file will be the one that is built without --plan.
    #[arg(long, value_name = "JOB")]
    pub plan: Option<PathBuf>,
    /// Tasks of the largest stages, about [default: a few fat ones, by the number of particles and --memory; a run has one for each step and
    /// takes no --tasks].
    #[arg(long, value_name = "N", requires = "plan", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub tasks: Option<u32>,
    /// Write JOB/submit.sh, too, which gives the tasks to SLURM.
    #[arg(long, requires = "plan")]
    pub slurm: bool,
    /// Say how far the job in this folder is.
    #[arg(long, value_name = "JOB", conflicts_with_all = ["sources", "output", "plan", "cancel"])]
    pub status: Option<PathBuf>,
    /// Say it as JSON.
    #[arg(long, requires = "status")]
    pub json: bool,
    /// Remove what the job in this folder has written, but not the file that it has built.
    #[arg(long, value_name = "JOB", conflicts_with_all = ["sources", "output", "plan"])]
    pub cancel: Option<PathBuf>,
}

impl JobOptions {
    /// Tells of the job that is asked for, or removes it; `None` where there is none.
    pub fn of_job(&self) -> Option<CommandResult> {
        match (&self.status, &self.cancel) {
            (Some(folder), _) => Some(tell(folder, self.json)),
            (None, Some(folder)) => Some(cancel(folder)),
            (None, None) => None,
        }
    }

    /// Plans the build of a source in a folder.
    ///
    /// # Errors
    /// When the source cannot be read, or the folder takes no job.
    pub fn plan(
        &self,
        folder: &Path,
        source: &Path,
        load: &LoadOptions,
        options: &BuildOptions,
        output: &Path,
        progress: &TerminalProgress,
    ) -> CommandResult {
        let split = Split { tasks: self.tasks };
        self.tell_plan(&Job::plan(folder, source, load, options, split, output, progress)?)
    }

    /// Plans the build of a run in a folder.
    ///
    /// # Errors
    /// When the folder takes no job, or a number of tasks is asked for.
    pub fn plan_run(
        &self,
        folder: &Path,
        run: &Run,
        build: &RunBuild,
        output: &Path,
        progress: &TerminalProgress,
    ) -> CommandResult {
        if let Some(tasks) = self.tasks {
            let (folder, steps) = (folder.display(), run.steps.len());
            return Err(format!(
                "{folder}: --tasks: found {tasks}, expected none: a run of {steps} steps has a task for each"
            )
            .into());
        }
        self.tell_plan(&Job::plan_run(folder, run, build, output, progress)?)
    }

    /// Says how the tasks of a job that is planned are run.
    fn tell_plan(&self, job: &Job) -> CommandResult {
        if self.slurm {
            return slurm::write(job, job.folder());
        }
        let mut out = std::io::stdout().lock();
        for stage in job.stages() {
            writeln!(out, "deepfield stage {} {} 0..{}", slurm::shown(job.folder()), stage.name, stage.tasks)?;
        }
        Ok(())
    }
}

/// Removes a job.
fn cancel(folder: &Path) -> CommandResult {
    Ok(Job::open(folder)?.remove()?)
}

/// Tells how far a job is.
fn tell(folder: &Path, as_json: bool) -> CommandResult {
    let status = Job::open(folder)?.status()?;
    let mut out = std::io::stdout().lock();
    if as_json {
        return Ok(writeln!(out, "{}", serde_json::to_string_pretty(&status)?)?);
    }
    let Status { output, finished, stages, bytes, particles, temporary_bytes_needed, .. } = status;
    let state = if finished { "finished" } else { "not finished" };
    writeln!(out, "{}: {state}, {particles} particles", output.display())?;
    for StageStatus { name, tasks, done, .. } in stages {
        writeln!(out, "{name:12} {done:>6} of {tasks:>6}")?;
    }
    let mebibytes = |bytes: u64| bytes.div_ceil(1 << 20);
    let [read, shuffled, written] = [bytes.read, bytes.shuffled, bytes.written].map(mebibytes);
    writeln!(out, "{read} MiB read, {shuffled} MiB of particles handed on, {written} MiB written")?;
    writeln!(out, "{} takes up to about {} MiB", folder.display(), mebibytes(temporary_bytes_needed))?;
    Ok(())
}

/// Runs tasks of a build that `deepfield build --plan` has cut into tasks; one that has been run already is not run again. A stage's tasks
/// run in any order and at the same time, once those of the stage before are done.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  deepfield build snapshot_099.hdf5 -o galaxy.df --plan galaxy.job
  deepfield stage galaxy.job survey 0
  deepfield stage galaxy.job partition 0..8
  deepfield stage galaxy.job grow 17 --memory 8GiB
  printf 'grow 0\\ngrow 1\\n' | deepfield stage galaxy.job
  deepfield build --status galaxy.job")]
pub struct StageArguments {
    /// The job's folder.
    pub job: PathBuf,
    /// The stage; `deepfield build --status JOB` lists them [default: tasks are read from standard input, `STAGE TASK` on a line each, and
    /// such a line is written to standard output when its task is done].
    #[arg(requires = "task")]
    pub stage: Option<String>,
    /// The task, from 0, or several, one after the other: 0..8 for those from 0 to 7.
    #[arg(value_name = "TASK", value_parser = tasks)]
    pub task: Option<Range<u32>>,
    /// Memory that the task may take, such as 8GiB [default: as the job was planned, or half of what is free].
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
}

/// Runs a task, or those that are asked for one after the other.
///
/// # Errors
/// Where there is no such task, or what it needs is missing or damaged.
pub fn run_stage(arguments: &StageArguments) -> CommandResult {
    let StageArguments { job, stage, task, memory } = arguments;
    let job = Job::open(job)?;
    let run = |stage: &str, mut range: Range<u32>| {
        range.try_for_each(|task| job.run(stage, task, *memory, &TerminalProgress::new()))
    };
    if let Some((stage, range)) = stage.as_deref().zip(task.clone()) {
        return Ok(run(stage, range)?);
    }
    for line in std::io::stdin().lines() {
        let line = line.map_err(|error| format!("standard input: {error}"))?;
        let words = line.split_once(' ').and_then(|(stage, task)| Some((stage, tasks(task).ok()?)));
        let (stage, range) =
            words.ok_or_else(|| format!("standard input: line: found {line:?}, expected a stage and a task"))?;
        run(stage, range)?;
        // Whoever waits for it reads it at once: standard output is written line by line.
        writeln!(std::io::stdout(), "{line}")?;
    }
    Ok(())
}

/// Reads which tasks to run: `17`, or `0..8` for those from 0 to 7.
fn tasks(text: &str) -> Result<Range<u32>, String> {
    let number = |text: &str| text.parse::<u32>().ok();
    let range = match text.split_once("..") {
        Some((first, end)) => number(first).zip(number(end)).map(|(first, end)| first..end),
        None => number(text).and_then(|task| Some(task..task.checked_add(1)?)),
    };
    let range = range.filter(|range| !range.is_empty());
    range.ok_or_else(|| format!("found {text:?}, expected a task such as 17, or several such as 0..8"))
}
