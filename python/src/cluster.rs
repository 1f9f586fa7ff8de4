//! Builds cut into tasks, which processes of one machine or of many run: a job is planned, run, asked how far it is, and removed.

use crate::asked::read_asked;
use crate::building::{Asked, Particles, refuse_built, refuse_over, run_build};
use crate::error::{Failure, told};
use crate::work;
use deepfield_draw::build::TrackOptions;
use deepfield_draw::build::cluster::{Job, Split};
use deepfield_draw::heights::is_heights;
use deepfield_draw::import::grid_format;
use deepfield_draw::picture::asked::{State, on_threads};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Plans the job that builds the file `out` of sources, in the folder `job`; opens it where it is there. Gives its state as [`cluster_status`]
/// does, and what there was to tell.
///
/// # Errors
/// As [`work::run`].
#[pyfunction]
pub fn cluster_plan(
    py: Python<'_>,
    job: PathBuf,
    sources: Vec<PathBuf>,
    out: PathBuf,
    asked: &str,
    tasks: Option<u32>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let asked: Asked = read_asked(asked).map_err(told)?;
    let plan = move |state: &Arc<State>| -> Result<String, Failure> {
        described(&planned(&job, &sources, &out, &asked, Split { tasks }, state)?)
    };
    work::run(py, progress, plan)
}

fn planned(
    job: &Path,
    sources: &[PathBuf],
    out: &Path,
    asked: &Asked,
    split: Split,
    state: &State,
) -> Result<Job, Failure> {
    refuse_built(sources)?;
    refuse_over(out, sources)?;
    let first = sources.first().map_or(Path::new(""), PathBuf::as_path);
    let named = first.display();
    if let [only] = sources
        && (is_heights(only) || grid_format(only)?.is_some())
    {
        return Err(format!("{named}: content: found heights, an image or a volume, expected particles").into());
    }
    let (load, options) = asked.options(first)?;
    match asked.particles(sources, &load, options.read)? {
        Particles::One(source) => Ok(Job::plan(job, &source, &load, &options, split, out, state)?),
        Particles::Many(run) => {
            if let Some(tasks) = split.tasks {
                let steps = run.steps.len();
                return Err(format!(
                    "{named}: tasks: found {tasks}, expected none: a run of {steps} steps has a task for each"
                )
                .into());
            }
            let tracks = TrackOptions::default();
            Ok(Job::plan_run(job, &run, &run_build(&load, &options, &tracks), out, state)?)
        }
    }
}

/// A job's state as JSON.
fn described(job: &Job) -> Result<String, Failure> {
    Ok(serde_json::to_string(&job.status()?)?)
}

/// Runs a task of a job on so many threads; one that has been run already returns at once. Gives what there was to tell.
///
/// # Errors
/// As [`work::run`].
#[pyfunction]
pub fn cluster_run(
    py: Python<'_>,
    job: PathBuf,
    stage: &str,
    task: u32,
    memory: Option<u64>,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<String>> {
    let stage = stage.to_owned();
    let run = move |state: &Arc<State>| -> Result<(), Failure> {
        on_threads(threads, || Ok(Job::open(&job)?.run(&stage, task, memory, &**state)?))
    };
    Ok(work::run(py, progress, run)?.1)
}

/// How far the job in a folder has come, as `deepfield build --status --json` tells it.
///
/// # Errors
/// [`crate::error::Error`] where the folder cannot be read or holds no job.
#[pyfunction]
pub fn cluster_status(py: Python<'_>, job: PathBuf) -> PyResult<String> {
    py.detach(|| -> Result<String, Failure> { described(&Job::open(&job)?) }).map_err(told)
}

/// Removes what a job has written, but not the file that it has built.
///
/// # Errors
/// [`crate::error::Error`] where the folder cannot be read or holds no job, or something cannot be removed.
#[pyfunction]
pub fn cluster_remove(py: Python<'_>, job: PathBuf) -> PyResult<()> {
    py.detach(|| -> Result<(), Failure> { Ok(Job::open(&job)?.remove()?) }).map_err(told)
}
