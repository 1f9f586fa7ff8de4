//! Runs of sources that were opened directly: built in the cache of page files while the first step is shown, and built again where
//! a simulation writes on.

use super::cache::{cached_name, folder, make_room, mark_as_used, page_file_of, stated_budget};
use crate::build::{BuildError, BuildOptions, RunBuild, StillOf, TrackOptions};
use crate::import::{ImportError, LoadOptions, Run, RunOptions, RunStep, Times, file_of_step, open_run, sources_of};
use crate::model::{Progress, ReadMethod, When, scale_factor_of};
use crate::store::RunFile;
use std::error::Error;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// A file that has not changed for so long is not being written any more.
const SETTLED: Duration = Duration::from_secs(2);

type Failure = Box<dyn Error + Send + Sync>;

/// What has become of a run since it was last asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Grown {
    /// It is in this file, with all of its steps that are there.
    Run(PathBuf),
    /// Nothing yet: it may be asked for again in a second.
    Later,
    /// Nothing, and nothing will.
    Done,
}

/// A run that is named by its sources.
#[derive(Debug)]
pub struct CachedRun {
    names: Vec<PathBuf>,
    follows: bool,
    /// What the last run was built of.
    built: Option<Vec<Stamp>>,
    /// The files as they were when they were looked at before.
    looked_at: Vec<Stamp>,
}

/// A file at some time: its length, and when it was changed.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Stamp {
    path: PathBuf,
    bytes: u64,
    changed: Option<SystemTime>,
}

impl CachedRun {
    /// The run of the sources that these names stand for. Where it `follows`, sources that are written later become its steps.
    pub fn new(names: Vec<PathBuf>, follows: bool) -> CachedRun {
        CachedRun { names, follows, built: None, looked_at: Vec::new() }
    }

    /// The source that is shown while the run is built: of the step at that moment, else the first one. `None` where none can be opened
    /// yet.
    ///
    /// # Errors
    /// When a source cannot be opened and the run does not follow, or there is none.
    pub fn first(&self, when: Option<When>) -> Result<Option<PathBuf>, Failure> {
        let sources = match sources_of(&self.names) {
            Err(_) if self.follows => return Ok(None),
            sources => sources?,
        };
        let run = match opened(&sources, self.follows) {
            Err(_) if self.follows => return Ok(None),
            run => run?,
        };
        let last = run.steps.len().saturating_sub(1);
        let step = match when {
            None => 0,
            Some(When::Last) => last,
            Some(When::Step(step)) => (step as usize).min(last),
            Some(When::Time(time)) => run.steps.partition_point(|step| step.time <= time).saturating_sub(1),
            Some(When::ScaleFactor(factor)) => before_scale_factor(&run, factor),
            Some(When::Redshift(redshift)) => before_scale_factor(&run, scale_factor_of(redshift).unwrap_or(0.0)),
        };
        Ok(run.steps.get(step).map(|step| step.about.path.clone()))
    }

    /// Builds the run, if there is more of it than there was.
    ///
    /// # Errors
    /// When its sources do not make a run, or it cannot be written.
    pub fn grow(&mut self, progress: &dyn Progress) -> Result<Grown, Failure> {
        if !self.follows {
            if self.built.is_some() {
                return Ok(Grown::Done);
            }
            self.built = Some(Vec::new());
            return Ok(Grown::Run(run_file_of(&sources_of(&self.names)?, false, progress)?));
        }
        // A folder without anything in it yet is no error.
        let sources = sources_of(&self.names).unwrap_or_default();
        let found: Vec<Stamp> = sources.iter().filter_map(|path| stamp(path)).collect();
        let now = SystemTime::now();
        let is_settled = |stamp: &&Stamp| {
            let rests =
                stamp.changed.and_then(|changed| now.duration_since(changed).ok()).is_some_and(|age| age > SETTLED);
            rests || (self.looked_at.contains(stamp) && stamp.changed.is_none_or(|changed| changed > now))
        };
        let settled: Vec<Stamp> = found.iter().filter(is_settled).cloned().collect();
        self.looked_at = found;
        if settled.is_empty() || self.built.as_ref() == Some(&settled) {
            return Ok(Grown::Later);
        }
        let paths: Vec<PathBuf> = settled.iter().map(|stamp| stamp.path.clone()).collect();
        // What has failed is tried again when something has changed.
        self.built = Some(settled);
        match opened(&paths, true) {
            // None of them can be opened yet.
            Err(_) if paths.len() == 1 => Ok(Grown::Later),
            Err(error) => Err(error.into()),
            Ok(_) => Ok(Grown::Run(run_file_of(&paths, true, progress)?)),
        }
    }
}

/// The step at or before a scale factor.
fn before_scale_factor(run: &Run, factor: f64) -> usize {
    let is_before = |step: &RunStep| step.about.scale_factor.is_some_and(|own| own <= factor);
    run.steps.partition_point(is_before).saturating_sub(1)
}

fn stamp(path: &Path) -> Option<Stamp> {
    let about = std::fs::metadata(file_of_step(path)).ok()?;
    Some(Stamp { path: path.to_owned(), bytes: about.len(), changed: about.modified().ok() })
}

/// Reads the headers. Where files have no times, their numbers are taken.
fn opened(sources: &[PathBuf], skip_damaged: bool) -> Result<Run, ImportError> {
    let options = RunOptions { skip_damaged, ..RunOptions::default() };
    match open_run(sources, &options, ReadMethod::default()) {
        Err(ImportError::Missing { field, .. }) if field == "time" => {
            let options = RunOptions { times: Some(Times::Steps), ..options };
            let mut run = open_run(sources, &options, ReadMethod::default())?;
            run.notes.push("not all steps have a time: their numbers are taken".into());
            Ok(run)
        }
        run => run,
    }
}

/// The path of a run of these sources in the cache, built first unless it is there already. Each step is built as a page file of its own
/// in the cache, so that a run that has grown builds its new steps alone, and all tracks.
fn run_file_of(sources: &[PathBuf], skip_damaged: bool, progress: &dyn Progress) -> Result<PathBuf, Failure> {
    let folder = folder("pages")?;
    let mut hasher = DefaultHasher::new();
    for source in sources {
        cached_name(source)?.hash(&mut hasher);
    }
    let first = sources.first().and_then(|first| first.file_stem()).unwrap_or_default().to_string_lossy();
    let cached = folder.join(format!("{first}-run-{:016x}.df", hasher.finish()));
    if RunFile::open(&cached, ReadMethod::default()).is_ok() {
        mark_as_used(&cached);
        return Ok(cached);
    }
    let stated = stated_budget()?;
    let run = opened(sources, skip_damaged)?;
    let (load, options) = (LoadOptions::default(), BuildOptions::default());
    let still_of = |step: &RunStep, progress: &dyn Progress| page_file_of(&step.about.path, progress).ok();
    let tracks = TrackOptions::default();
    let build = |run: Run, tracks| {
        let still_of = Some::<StillOf>(&still_of);
        RunBuild { load: &load, options: &options, tracks, skip_damaged, still_of }.build(run, &cached, progress)
    };
    match build(run.clone(), Some(&tracks)) {
        Ok(_) => {}
        // Particles without ids, or with those of others: steps can be shown all the same.
        Err(error @ (BuildError::Import(_) | BuildError::Selection { .. })) => {
            let mut run = run;
            run.notes.push(format!("no tracks: {error}"));
            build(run, None)?;
        }
        Err(error) => return Err(error.into()),
    }
    make_room(&folder, stated, &cached)?;
    Ok(cached)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_still_written_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, age: u64| {
            let path = folder.path().join(name);
            std::fs::write(&path, "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n9\n").unwrap();
            let changed = SystemTime::now() - Duration::from_secs(age);
            std::fs::File::options().append(true).open(&path).unwrap().set_modified(changed).unwrap();
            path
        };
        let mut run = CachedRun::new(vec![folder.path().to_owned()], true);
        assert_eq!(run.grow(&()).unwrap(), Grown::Later, "nothing is there");
        assert_eq!(run.first(None).unwrap(), None);
        write("dump.0", 0);
        assert_eq!(run.grow(&()).unwrap(), Grown::Later, "it has just been written");
        assert!(run.built.is_none());
        // Settled, but cut short: it is no step yet, and no error.
        write("dump.0", 60);
        assert_eq!(run.grow(&()).unwrap(), Grown::Later);
        assert_eq!(run.built.as_ref().map(Vec::len), Some(1));
        assert_eq!(run.grow(&()).unwrap(), Grown::Later);
    }
}
