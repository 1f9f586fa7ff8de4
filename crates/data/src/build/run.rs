//! From many snapshots to a run file: one page file after the other, each built as it would be alone.

use super::tracks::{BuiltStep, TrackBuild};
use super::{BuildError, BuildOptions, TrackOptions, alone, built_of};
use crate::import::vector_field::{TraceOptions, trace};
use crate::import::{AttributeChoice, Description, LoadOptions, Run, RunStep, has_attribute};
use crate::model::{Placement, Progress, Unit};
use crate::store::run::{Directory, RunFileWriter, Section, Step};
use crate::store::{Metadata, PageFile, PageFileWriter, StoreError};
use std::fs::File;
use std::path::{Path, PathBuf};

/// What was built.
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltRun {
    /// What the file's directory says.
    pub directory: Directory,
    /// Length of the file.
    pub bytes: u64,
    /// Most bytes that temporary files took, beside the file itself.
    pub temporary_bytes: u64,
}

/// Finds a page file that was built of a step, of what is read of it here and with the same options; `None`: it is to be built.
pub type StillOf<'a> =
    &'a (dyn Fn(&RunStep, &LoadOptions, &dyn Progress) -> Result<Option<PathBuf>, BuildError> + Sync);

/// How a run is built.
#[derive(Clone, Copy)]
pub struct RunBuild<'a> {
    /// What is read of each step.
    pub load: &'a LoadOptions,
    /// How stills are built, and with how much memory everything.
    pub options: &'a BuildOptions,
    /// How particles become tracks; `None`: the file holds stills alone.
    pub tracks: Option<&'a TrackOptions>,
    /// Whether steps that turn out to be damaged are left out.
    pub skip_damaged: bool,
    /// Where stills are that need not be built; `None`: nowhere.
    pub still_of: Option<StillOf<'a>>,
}

impl RunBuild<'_> {
    /// Builds the run file `out` from a run, whose sources are streamed one by one: memory and temporary files are those of the largest
    /// one alone, and of tracks those of two steps.
    ///
    /// # Errors
    /// When a source, or a still that is there, cannot be read, or the file not be written. Nothing is left behind then, and a file that was
    /// there before stays as it was.
    pub fn build(&self, run: Run, out: &Path, progress: &dyn Progress) -> Result<BuiltRun, BuildError> {
        alone(self.options, out, || self.build_here(run, out, &|| Ok(()), progress))
    }

    /// Builds the run file `out` of particles that are traced through the velocity field in `files`.
    ///
    /// # Errors
    /// As [`RunBuild::build`], and where nothing can be traced.
    pub fn build_traced(
        &self,
        files: &[PathBuf],
        trace_options: &TraceOptions,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<BuiltRun, BuildError> {
        alone(self.options, out, || {
            let run = trace(files, trace_options, self.options.read, progress)?;
            self.build_here(run, out, &|| Ok(()), progress)
        })
    }

    /// What is read of a step of a run.
    pub(super) fn load_of(&self, step: &RunStep, run: &Run) -> LoadOptions {
        LoadOptions { without: run.left_out.clone(), ..of_step(self.load, step, &run.steps) }
    }

    /// [`RunBuild::build`] by the threads that it is called by. `may_end` says in the end whether the file may get its name.
    pub(super) fn build_here(
        &self,
        run: Run,
        out: &Path,
        may_end: &dyn Fn() -> Result<(), BuildError>,
        progress: &dyn Progress,
    ) -> Result<BuiltRun, BuildError> {
        let RunBuild { options, tracks, skip_damaged, .. } = *self;
        run.notes.iter().for_each(|note| progress.say(&format!("note: {note}")));
        let mut writer = RunFileWriter::create(out)?;
        let first = run.steps.first().map(|step| step.about.clone());
        let mut directory = Directory {
            clock: run.clock,
            time_unit: Unit::default(),
            length_unit: first.as_ref().map(|about| about.length_unit.clone()).unwrap_or_default(),
            mass_unit: first.as_ref().map(|about| about.mass_unit.clone()).unwrap_or_default(),
            box_size: first.as_ref().and_then(|about| about.box_size),
            notes: run.notes.clone(),
            has_stills: true,
            steps: Vec::with_capacity(run.steps.len()),
            tracks: None,
            intervals: Vec::new(),
        };
        directory.has_stills = run.steps.len() < 2 || tracks.is_none_or(|tracks| !tracks.no_stills);
        let mut built_steps = Vec::with_capacity(run.steps.len());
        let (total, mut temporary_bytes, mut first_error) = (run.steps.len(), 0, None);
        for (number, step) in run.steps.iter().enumerate() {
            let here = StepProgress { progress, step: number + 1, total };
            let keeps = directory.has_stills;
            match self.append_still(step, &self.load_of(step, &run), keeps, (&mut writer, out), &here) {
                Ok(still) => {
                    temporary_bytes = temporary_bytes.max(still.temporary_bytes);
                    let metadata = &still.metadata;
                    let placement = Placement { scale: step.length, mass: step.mass, ..Placement::HERE };
                    let bounds = placement.bounds(metadata.bounds());
                    built_steps.push(BuiltStep {
                        number,
                        means: BuiltStep::means_of(metadata),
                        bounds,
                        particles: metadata.particles(),
                    });
                    directory.steps.push(Step {
                        source: metadata.provenance.path.clone(),
                        format: metadata.provenance.format.clone(),
                        source_bytes: metadata.provenance.bytes,
                        time: step.time,
                        redshift: metadata.provenance.redshift,
                        particles: metadata.particles(),
                        mass: metadata.families.iter().map(|family| family.mass).sum::<f64>() * step.mass,
                        bounds,
                        length_scale: step.length,
                        mass_scale: step.mass,
                        still: still.section,
                    });
                }
                Err(BuildError::Import(error)) if skip_damaged => {
                    let note = format!("left out: {error}");
                    progress.say(&format!("note: {note}"));
                    directory.notes.push(note);
                    first_error = first_error.or(Some(error));
                }
                Err(error) => return Err(error),
            }
        }
        if let (true, Some(error)) = (directory.steps.is_empty(), first_error) {
            return Err(error.into());
        }
        if !directory.has_stills && built_steps.len() < 2 {
            let reason = "one step is left, which has no tracks; without --no-stills it is kept".into();
            return Err(StoreError::Unwritable { path: out.to_owned(), reason }.into());
        }
        if let Some(tracks) = tracks.filter(|_| built_steps.len() > 1) {
            let load = |step: usize| self.load_of(&run.steps[built_steps[step].number], &run);
            let (run, steps, box_size) = (&run, &built_steps[..], directory.box_size);
            let built =
                TrackBuild { run, steps, load: &load, tracks, options, out, box_size }.build(&mut writer, progress)?;
            built.notes.iter().for_each(|note| progress.say(&format!("note: {note}")));
            directory.notes.extend(built.notes);
            temporary_bytes = temporary_bytes.max(built.temporary_bytes);
            (directory.tracks, directory.intervals) = (Some(built.layout), built.intervals);
        }
        // The last moment at which nothing has the file's name.
        progress.go_on();
        may_end()?;
        let bytes = writer.finish(&directory)?;
        Ok(BuiltRun { directory, bytes, temporary_bytes })
    }

    /// Appends the still of a step: a page file that is there already, or one that is built of its source; where stills are not kept, its
    /// outline.
    fn append_still(
        &self,
        step: &RunStep,
        load: &LoadOptions,
        keeps: bool,
        (writer, out): (&mut RunFileWriter, &Path),
        progress: &dyn Progress,
    ) -> Result<Still, BuildError> {
        let options = self.options;
        let known = self.still_of.map_or(Ok(None), |still_of| still_of(step, load, progress))?;
        if let Some(path) = known {
            let pages = PageFile::open_with(&path, options.read)?;
            let file = File::open(&path).map_err(|source| StoreError::Io { path, action: "open", source })?;
            let section = match keeps {
                true => writer.append(&file, progress)?,
                false => append_outline(pages.metadata(), out, writer)?,
            };
            return Ok(Still { metadata: pages.metadata().clone(), section, temporary_bytes: section.len });
        }
        let source = step.open(options.read)?;
        let built = built_of(source.as_ref(), load, options, out, progress)?;
        let section = match keeps {
            true => writer.append(built.file.file(), progress)?,
            false => append_outline(&built.metadata, out, writer)?,
        };
        let temporary_bytes = built.temporary_bytes + built.file.bytes();
        Ok(Still { metadata: built.metadata, section, temporary_bytes })
    }
}

/// The still of a step: what its file says, and what it takes.
struct Still {
    metadata: Metadata,
    section: Section,
    temporary_bytes: u64,
}

/// Appends what a page file says of itself, without pages.
fn append_outline(metadata: &Metadata, out: &Path, writer: &mut RunFileWriter) -> Result<Section, BuildError> {
    let outline = PageFileWriter::create(out)?.complete(&metadata.outline())?;
    Ok(writer.append(outline.file(), &())?)
}

/// The options for one step: families and attributes that only other steps have are not asked of it.
fn of_step(options: &LoadOptions, step: &RunStep, steps: &[RunStep]) -> LoadOptions {
    let mut own = options.clone();
    let is_there = |about: &Description, name| about.families.iter().any(|info| info.name == name);
    let elsewhere = |name| steps.iter().any(|other| is_there(&other.about, name));
    own.families.retain(|name| is_there(&step.about, *name) || !elsewhere(*name));
    if own.families.is_empty() {
        // None of them is here: the step says so itself.
        own.families.clone_from(&options.families);
    }
    if let AttributeChoice::Named(names) = &mut own.attributes {
        let elsewhere = |name: &str| steps.iter().any(|other| has_attribute(&other.about, name));
        names.retain(|name| has_attribute(&step.about, name) || !elsewhere(name));
    }
    own
}

/// Says which step a stage belongs to.
pub struct StepProgress<'a> {
    /// Who is told.
    pub progress: &'a dyn Progress,
    /// The step, counted from 1.
    pub step: usize,
    /// How many there are.
    pub total: usize,
}

impl Progress for StepProgress<'_> {
    fn begin(&self, stage: &str, total: u64) {
        self.progress.begin(&format!("step {} of {}: {stage}", self.step, self.total), total);
    }

    fn advance(&self, n: u64) {
        self.progress.advance(n);
    }

    fn go_on(&self) {
        self.progress.go_on();
    }

    fn say(&self, line: &str) {
        self.progress.say(line);
    }
}
