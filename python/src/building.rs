//! Builds from files and from arrays.

use crate::arrays::{ArraySource, Said};
use crate::error::{Failure, told};
use crate::work;
use deepfield_draw::build::grid::{GridBuildOptions, build_grid};
use deepfield_draw::build::{BuildOptions, FEW_PARTICLES, RunBuild, TrackOptions, build_opened, build_source};
use deepfield_draw::heights::build::HeightBuildOptions;
use deepfield_draw::heights::import::HeightOptions;
use deepfield_draw::heights::{OpenHeights, is_heights};
use deepfield_draw::import::{
    AttributeChoice, GridOptions, LoadOptions, RunOptions, grid_format, open_grid, open_run, sources_of, steps_in,
};
use deepfield_draw::look::DataKind;
use deepfield_draw::model::{FamilyName, Skipped};
use deepfield_draw::picture::asked::{State, on_threads};
use pyo3::prelude::*;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How something is built.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Asked {
    /// Bytes of memory that the build may take.
    memory: Option<u64>,
    /// Threads that build; all where nothing is said. The file is the same for any number.
    threads: Option<usize>,
    /// Attributes that are kept.
    attributes: Option<Vec<String>>,
    /// Families that are kept; all where none is named.
    families: Vec<FamilyName>,
    /// How far heights may be from the source's.
    height_error: Option<f64>,
    /// What is said of arrays.
    said: Said,
}

impl Asked {
    /// As `deepfield build` has them.
    fn options(&self) -> BuildOptions {
        let attributes = self.attributes.clone();
        BuildOptions { attributes, memory: self.memory, exact_below: FEW_PARTICLES, ..BuildOptions::default() }
    }
}

/// Builds the file `out` of sources; gives what there was to tell.
///
/// # Errors
/// As [`work::run`].
#[pyfunction]
pub fn build_files(
    py: Python<'_>,
    sources: Vec<PathBuf>,
    out: PathBuf,
    asked: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<String>> {
    let job = |state: &Arc<State>| -> Result<(), Failure> {
        let asked: Asked = serde_json::from_str(asked)?;
        on_threads(asked.threads, || of_files(&sources, &out, &asked, state))
    };
    Ok(work::run(py, progress, job)?.1)
}

fn of_files(sources: &[PathBuf], out: &Path, asked: &Asked, state: &State) -> Result<(), Failure> {
    for path in sources {
        // What is no file is found where it is opened.
        if let Ok(kind @ (DataKind::Pages | DataKind::Run | DataKind::Grid | DataKind::Heights)) = DataKind::of(path) {
            let found = kind.described();
            return Err(format!("{}: content: found {found}, expected a source to build it of", path.display()).into());
        }
    }
    if let [only] = sources
        && is_heights(only)
    {
        let options = HeightBuildOptions {
            memory: asked.memory,
            height_error: asked.height_error,
            ..HeightBuildOptions::default()
        };
        let built = OpenHeights::open(only, &HeightOptions::default())?.build(&options, out, state)?;
        let kept = options.not_rounded(&built);
        built.notes.into_iter().chain(kept).for_each(|note| state.note(note));
        return Ok(());
    }
    if asked.height_error.is_some() {
        let named = sources.first().map(|path| path.display().to_string()).unwrap_or_default();
        return Err(format!("{named}: height_error: found no heights, expected some").into());
    }
    if let [only] = sources
        && grid_format(only)?.is_some()
    {
        let options = GridBuildOptions { memory: asked.memory, ..GridBuildOptions::default() };
        let built = build_grid(&open_grid(only, &GridOptions::default())?, &options, out, state)?;
        built.notes.into_iter().for_each(|note| state.note(note));
        return Ok(());
    }
    let options = asked.options();
    let load = LoadOptions {
        families: asked.families.clone(),
        attributes: asked.attributes.clone().map_or(AttributeChoice::Usual, AttributeChoice::Named),
        ..LoadOptions::default()
    };
    let sources = sources_of(sources)?;
    if let [only] = &sources[..]
        && steps_in(only)? == 1
    {
        return of_one(only, &load, &options, out, state);
    }
    let run_options = RunOptions { attributes: asked.attributes.clone(), ..RunOptions::default() };
    let run = open_run(&sources, &run_options, options.read)?;
    if let [only] = &run.steps[..] {
        // Files of one snapshot.
        return of_one(&only.about.path, &load, &options, out, state);
    }
    let tracks = TrackOptions::default();
    let build = RunBuild { load: &load, options: &options, tracks: Some(&tracks), skip_damaged: false, still_of: None };
    build.build(run, out, state)?;
    Ok(())
}

fn of_one(source: &Path, load: &LoadOptions, options: &BuildOptions, out: &Path, state: &State) -> Result<(), Failure> {
    let built = build_source(source, load, options, out, state)?;
    note_skipped(&built.metadata.skipped, state);
    Ok(())
}

fn note_skipped(skipped: &[Skipped], state: &State) {
    for Skipped { reason, count } in skipped {
        state.note(format!("left out {count} particles: {reason}"));
    }
}

/// Builds the file `out` of arrays: columns with their family's name, their own and their unit. Gives what there was to tell.
///
/// # Errors
/// As [`work::run`], and where arrays do not fit together.
#[pyfunction]
pub fn build_arrays<'py>(
    py: Python<'py>,
    columns: Vec<(String, String, String, Bound<'py, PyAny>)>,
    out: PathBuf,
    asked: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<String>> {
    let mut asked: Asked = serde_json::from_str(asked).map_err(|error| told(error.into()))?;
    let source = ArraySource::new(columns, &asked.said).map_err(told)?;
    let attributes = asked.attributes.take().unwrap_or_else(|| source.attributes());
    asked.attributes = Some(attributes.clone());
    let job = |state: &Arc<State>| -> Result<(), Failure> {
        let load = LoadOptions {
            families: asked.families.clone(),
            attributes: AttributeChoice::Named(attributes),
            ..LoadOptions::default()
        };
        on_threads(asked.threads, || {
            let built = build_opened(&source, &load, &asked.options(), &out, &**state)?;
            note_skipped(&built.metadata.skipped, state);
            Ok(())
        })
    };
    Ok(work::run(py, progress, job)?.1)
}
