//! Builds from files and from arrays.

use crate::arrays::{ArraySource, Said};
use crate::asked::read_asked;
use crate::error::{Failure, told};
use crate::work;
use deepfield_draw::build::grid::{GridBuildOptions, build_grid};
use deepfield_draw::build::{BuildOptions, FEW_PARTICLES, RunBuild, TrackOptions, build_opened, build_source};
use deepfield_draw::heights::build::HeightBuildOptions;
use deepfield_draw::heights::{OpenHeights, is_heights};
use deepfield_draw::hierarchy::{Kinds, Matter};
use deepfield_draw::import::grid::RawGrid;
use deepfield_draw::import::{
    AttributeChoice, GridOptions, LoadOptions, Run, RunOptions, Smoothing, Source as _, Times, UnpackedOnce,
    grid_format, is_one_table, open_grid, open_run, sources_of, steps_in,
};
use deepfield_draw::look::{DataKind, is_file_of};
use deepfield_draw::model::{DerivedQuantity, FamilyName, ReadMethod, SampleType, Skipped, Unit};
use deepfield_draw::picture::asked::{State, on_threads, said};
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How something is built.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Asked {
    /// Bytes of memory that the build may take.
    memory: Option<u64>,
    /// Threads that build; all where nothing is said. The file is the same for any number.
    threads: Option<usize>,
    /// Attributes that are kept.
    attributes: Option<Vec<String>>,
    /// Families that are kept; all where none is named.
    families: Vec<FamilyName>,
    /// Attributes that are derived from velocities, as `--derive` names them.
    derive: Option<String>,
    /// What is built over the leaves, as `--hierarchy` names it.
    hierarchy: Option<String>,
    /// Where smoothing lengths come from, as `--smoothing` says it.
    smoothing: Option<String>,
    /// How far heights may be from the source's.
    height_error: Option<f64>,
    /// What is said of heights, as [`said`] reads it.
    heights: Map<String, Value>,
    /// What a file without a header holds.
    raw: Option<AskedRaw>,
    /// Times of the steps of a run, as `--times` says them.
    times: Option<String>,
    /// Every so many-th step of a run alone.
    every: Option<NonZeroUsize>,
    /// Whether steps are left out whose files are damaged.
    skip_damaged: bool,
    /// What is said of arrays.
    said: Said,
}

/// What a file without a header holds.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AskedRaw {
    shape: Vec<u64>,
    r#type: String,
    #[serde(default)]
    spacing: Vec<f64>,
    big_endian: bool,
    channels: u64,
    skip: u64,
}

impl AskedRaw {
    fn grid(&self) -> Result<RawGrid, Failure> {
        let sample_type = self.r#type.parse::<SampleType>();
        Ok(RawGrid {
            shape: self.shape.clone(),
            sample_type: sample_type.map_err(|expected| format!("type: found {:?}, {expected}", self.r#type))?,
            spacing: self.spacing.clone(),
            big_endian: self.big_endian,
            channels: self.channels,
            offset: self.skip,
            length_unit: Unit::default(),
        })
    }
}

impl Asked {
    /// The hierarchies that are asked for, if any are.
    fn hierarchies(&self) -> Result<Option<Kinds>, Failure> {
        let kinds = self.hierarchy.as_deref().map(str::parse::<Kinds>).transpose();
        Ok(kinds.map_err(|sentence| format!("hierarchy: {sentence}"))?)
    }

    /// What is kept of `source` and how it is built, as `deepfield build` has them.
    ///
    /// # Errors
    /// The program's sentence about what cannot be asked of particles.
    pub fn options(&self, source: &Path) -> Result<(LoadOptions, BuildOptions), Failure> {
        let attributes = self.attributes.clone();
        let hierarchies = self.hierarchies()?;
        if let Some(kinds) = hierarchies.filter(|kinds| kinds.matter() != Some(Matter::Particles)) {
            let source = source.display();
            return Err(format!("{source}: hierarchy {kinds}: found particles, expected an image or a volume").into());
        }
        let derive = self.derive.as_deref().map(DerivedQuantity::list).transpose();
        let smoothing = self
            .smoothing
            .as_deref()
            .map(|text| text.parse::<Smoothing>().map_err(|expected| format!("smoothing: found {text:?}, {expected}")));
        let load = LoadOptions {
            families: self.families.clone(),
            attributes: attributes.clone().map_or(AttributeChoice::Usual, AttributeChoice::Named),
            smoothing: smoothing.transpose()?.unwrap_or_default(),
            derive: derive.map_err(|sentence| format!("derive: {sentence}"))?.unwrap_or_default(),
            ..LoadOptions::default()
        };
        let options = BuildOptions {
            attributes,
            memory: self.memory,
            exact_below: FEW_PARTICLES,
            hierarchies: hierarchies.unwrap_or_default(),
            ..BuildOptions::default()
        };
        Ok((load, options))
    }

    /// What particles the files of `sources` hold.
    ///
    /// # Errors
    /// What the importer says.
    pub fn particles(&self, sources: &[PathBuf], load: &LoadOptions, read: ReadMethod) -> Result<Particles, Failure> {
        // What is said of steps is of a run, also of one step.
        let is_one = self.times.is_none() && self.every.is_none();
        let sources = match sources {
            // Parts of a table are told apart by numbers, as steps are.
            [only] if is_one && is_one_table(only)? => vec![only.clone()],
            names => sources_of(names)?,
        };
        if let (true, [only]) = (is_one, &sources[..])
            && steps_in(only)? == 1
        {
            return Ok(Particles::One(only.clone()));
        }
        // What is derived is no step's own.
        let attributes = self.attributes.clone().map(|mut names| {
            names.retain(|name| !load.derive.iter().any(|quantity| quantity.name() == name));
            names
        });
        let times = self
            .times
            .as_deref()
            .map(|text| text.parse::<Times>().map_err(|expected| format!("times: found {text:?}, {expected}")));
        let options = RunOptions {
            times: times.transpose()?,
            every: self.every,
            skip_damaged: self.skip_damaged,
            attributes,
            ..RunOptions::default()
        };
        let run = open_run(&sources, &options, read)?;
        Ok(match &run.steps[..] {
            // Files of one snapshot.
            [only] if is_one && !self.skip_damaged => Particles::One(only.about.path.clone()),
            _ => Particles::Many(run),
        })
    }

    /// Refuses what only particles have.
    ///
    /// # Errors
    /// The program's sentence, where it is asked of `found`.
    fn refuse_of_particles(&self, source: &Path, found: &str, own: Option<Matter>) -> Result<(), Failure> {
        let source = source.display();
        if self.derive.is_some() {
            return Err(format!("{source}: derive: found {found}, expected particles with velocities").into());
        }
        let of_particles = [
            ("smoothing", self.smoothing.is_some()),
            ("times", self.times.is_some()),
            ("every", self.every.is_some()),
            ("skip_damaged", self.skip_damaged),
        ];
        if let Some((name, _)) = of_particles.iter().find(|(_, is_said)| *is_said) {
            return Err(format!("{source}: {name}: found {found}, expected particles").into());
        }
        match self.hierarchies()?.filter(|kinds| kinds.matter() != own) {
            Some(kinds) => Err(format!("{source}: hierarchy {kinds}: found {found}, expected particles").into()),
            None => Ok(()),
        }
    }
}

/// The particles of files.
pub enum Particles {
    /// Those of one time, by the path of their source.
    One(PathBuf),
    /// Those of several.
    Many(Run),
}

/// Refuses sources that are built already.
///
/// # Errors
/// The program's sentence.
pub fn refuse_built(sources: &[PathBuf]) -> Result<(), Failure> {
    for path in sources {
        // What is no file is found where it is opened.
        if let Ok(kind @ (DataKind::Pages | DataKind::Run | DataKind::Grid | DataKind::Heights)) = DataKind::of(path) {
            let found = kind.described();
            return Err(format!("{}: content: found {found}, expected a source to build it of", path.display()).into());
        }
    }
    Ok(())
}

/// Refuses to write over what is read.
///
/// # Errors
/// The program's sentence.
pub fn refuse_over(written: &Path, read: &[PathBuf]) -> Result<(), Failure> {
    if is_file_of(written, read) {
        let written = written.display();
        return Err(format!("{written}: cannot be written: found a file that is read, expected another name").into());
    }
    Ok(())
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
    let asked: Asked = read_asked(asked).map_err(told)?;
    let job = move |state: &Arc<State>| -> Result<(), Failure> {
        on_threads(asked.threads, || of_files(&sources, &out, &asked, state))
    };
    Ok(work::run_writing(py, progress, job)?.1)
}

fn of_files(sources: &[PathBuf], out: &Path, asked: &Asked, state: &State) -> Result<(), Failure> {
    refuse_built(sources)?;
    refuse_over(out, sources)?;
    // What it is, and of how many steps, is asked before it is opened.
    let _held = if let [only] = sources { Some(UnpackedOnce::of(only)) } else { None };
    let stated = said(&asked.heights)?;
    let raw = asked.raw.as_ref().map(AskedRaw::grid).transpose()?;
    if let [only] = sources
        && raw.is_none()
        && stated.is_heights().unwrap_or_else(|| is_heights(only))
    {
        asked.refuse_of_particles(only, "heights", None)?;
        let options = HeightBuildOptions {
            memory: asked.memory,
            height_error: asked.height_error,
            ..HeightBuildOptions::default()
        };
        let built = OpenHeights::open(only, &stated.options(ReadMethod::default()))?.build(&options, out, state)?;
        let kept = options.not_rounded(&built);
        built.notes.into_iter().chain(kept).for_each(|note| state.note(note));
        return Ok(());
    }
    let named = || sources.first().map(|path| path.display().to_string()).unwrap_or_default();
    if asked.height_error.is_some() {
        return Err(format!("{}: height_error: found no heights, expected some", named()).into());
    }
    if let Some(name) = asked.heights.keys().find(|name| *name != "kind") {
        let instead = "an array or a grey picture is taken for such by kind \"heights\"";
        return Err(format!("{}: {name}: found no heights, expected some; {instead}", named()).into());
    }
    if let [only] = sources
        && (raw.is_some() || grid_format(only)?.is_some())
    {
        asked.refuse_of_particles(only, "an image or a volume", Some(Matter::Grids))?;
        let options = GridBuildOptions { memory: asked.memory, ..GridBuildOptions::default() };
        let built =
            build_grid(&open_grid(only, &GridOptions { raw, ..GridOptions::default() })?, &options, out, state)?;
        built.notes.into_iter().for_each(|note| state.note(note));
        return Ok(());
    }
    if raw.is_some() {
        return Err(format!("{}: shape: found {} files, expected one of samples", named(), sources.len()).into());
    }
    let first = sources.first().map_or(Path::new(""), PathBuf::as_path);
    let (load, options) = asked.options(first)?;
    let run = match asked.particles(sources, &load, options.read)? {
        Particles::One(source) => return of_one(&source, &load, &options, out, state),
        Particles::Many(run) => run,
    };
    let tracks = TrackOptions::default();
    let build = RunBuild { skip_damaged: asked.skip_damaged, ..run_build(&load, &options, &tracks) };
    build.build(run, out, state)?;
    Ok(())
}

/// How a run is built.
pub fn run_build<'a>(load: &'a LoadOptions, options: &'a BuildOptions, tracks: &'a TrackOptions) -> RunBuild<'a> {
    RunBuild { load, options, tracks: Some(tracks), skip_damaged: false, still_of: None }
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
    let asked: Asked = read_asked(asked).map_err(told)?;
    let source = ArraySource::new(columns, &asked.said).map_err(told)?;
    let job = move |state: &Arc<State>| -> Result<(), Failure> {
        let (mut load, options) = asked.options(&source.description().path)?;
        let is_named = asked.attributes.is_some();
        if !is_named {
            load.attributes = AttributeChoice::Named(source.attributes());
        }
        on_threads(asked.threads, || {
            let built = build_opened(&source, &load, &options, &out, &**state)?;
            if !is_named {
                source.left_out(&built.metadata.families).into_iter().for_each(|note| state.note(note));
            }
            note_skipped(&built.metadata.skipped, state);
            Ok(())
        })
    };
    Ok(work::run_writing(py, progress, job)?.1)
}
