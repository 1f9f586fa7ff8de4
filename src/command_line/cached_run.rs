//! Runs of sources that were opened directly: built in the cache of page files while the first step is shown, outwards from that, and
//! built again where a simulation writes on.

use super::cache::{folder, make_room, page_file_of};
use crate::build::{BuildError, BuildOptions, RunBuild, StepProgress, StillOf, TrackOptions};
use crate::import::{
    ImportError, LoadOptions, Run, RunOptions, RunStep, Times, file_of_step, open, open_run, sources_of,
};
use crate::look::page_cache::{BUDGET_VARIABLE, budget, cached_name, mark_as_used, stated_budget};
use crate::model::{Progress, ReadMethod, When, scale_factor_of};
use crate::store::{PageFile, RunFile};
use std::error::Error;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// A file that has not changed for so long is not being written any more.
const SETTLED: Duration = Duration::from_secs(2);

/// Steps are built for at least so long before those that are there are given, so that a run of many small ones is not given one by one.
const PART: Duration = Duration::from_secs(1);

/// Bytes of a run file for each particle and interval, about: its track with a few attributes, and its share of what is above it.
const TRACK_BYTES: u64 = 20;

type Failure = Box<dyn Error + Send + Sync>;

/// What has become of a run since it was last asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Grown {
    /// It is in this file, with the steps that are there.
    Run(PathBuf),
    /// Something to be known about it, in a sentence; it may be asked for at once.
    Told(String),
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
    /// The source that is shown while nothing else is there.
    shown: Option<PathBuf>,
    /// Whether it is given with the steps that are there before it is there as a whole.
    in_parts: bool,
    /// What the last run was built of.
    built: Option<Vec<Stamp>>,
    /// The files as they were when they were looked at before.
    looked_at: Vec<Stamp>,
    /// What is being built.
    plan: Option<Plan>,
}

/// A file at some time: its length, and when it was changed.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Stamp {
    path: PathBuf,
    bytes: u64,
    changed: Option<SystemTime>,
}

/// How much of a run the cache has room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extent {
    /// The run, and beside it its steps and runs of some of them.
    Parts,
    /// The run alone.
    Whole,
    /// Its steps, and nothing that moves between them.
    Steps,
    /// One step.
    One,
}

impl Extent {
    /// Of a run whose steps and tracks take so many bytes, with this budget.
    fn of(steps: u64, tracks: u64, budget: u64) -> Extent {
        let whole = steps.saturating_add(tracks);
        // Runs of some of the steps hold at most as many as two of all of them.
        match () {
            () if whole.saturating_add(steps.saturating_mul(3)) <= budget => Extent::Parts,
            () if whole <= budget => Extent::Whole,
            () if steps <= budget => Extent::Steps,
            () => Extent::One,
        }
    }

    /// What is to be known before a run of so many bytes is begun.
    fn told(self, bytes: u64, budget: u64) -> Option<String> {
        let what = match self {
            Extent::Parts | Extent::Whole => return None,
            Extent::Steps => "its steps are shown, and nothing that moves between them",
            Extent::One => "one step is shown",
        };
        let gb = |bytes: u64| bytes as f64 / 1e9;
        Some(format!(
            "the run takes about {:.2} GB, and the cache may hold {:.2} GB ({BUDGET_VARIABLE}): {what}; `deepfield build` makes a file \
             of all of it",
            gb(bytes),
            gb(budget)
        ))
    }
}

/// A run on its way.
#[derive(Debug)]
struct Plan {
    run: Run,
    /// The file that it will be in.
    file: PathBuf,
    extent: Extent,
    /// Whether sources that turn out to be damaged are left out.
    skip_damaged: bool,
    /// Of each step whether it is in the cache; `None` where it is damaged.
    ready: Vec<Option<bool>>,
}

impl CachedRun {
    /// The run of the sources that these names stand for. Where it `follows`, sources that are written later become its steps.
    pub fn new(names: Vec<PathBuf>, follows: bool) -> CachedRun {
        CachedRun { names, follows, shown: None, in_parts: false, built: None, looked_at: Vec::new(), plan: None }
    }

    /// Gives the run with some of its steps as soon as they are there.
    pub fn in_parts(self) -> CachedRun {
        CachedRun { in_parts: true, ..self }
    }

    /// The source that is shown while the run is built: of the step at that moment, else the first one. `None` where none can be opened
    /// yet.
    ///
    /// # Errors
    /// When a source cannot be opened and the run does not follow, or there is none.
    pub fn first(&mut self, when: Option<When>) -> Result<Option<PathBuf>, Failure> {
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
            Some(When::Time(time)) => before_time(&run, time),
            Some(When::ScaleFactor(factor)) => before_scale_factor(&run, factor),
            Some(When::Redshift(redshift)) => before_scale_factor(&run, scale_factor_of(redshift).unwrap_or(0.0)),
        };
        self.shown = run.steps.get(step).map(|step| step.about.path.clone());
        Ok(self.shown.clone())
    }

    /// Goes on with the run, if there is more of it than there was: builds steps outwards from the one that is shown at the time `present`,
    /// then what moves between them.
    ///
    /// # Errors
    /// When its sources do not make a run, or it cannot be written.
    pub fn grow(&mut self, present: Option<f64>, progress: &dyn Progress) -> Result<Grown, Failure> {
        if self.plan.is_none()
            && let Some(grown) = self.begin(progress)?
        {
            return Ok(grown);
        }
        // What fails is not tried again before its sources change.
        let Some(mut plan) = self.plan.take() else { return Ok(Grown::Done) };
        let shown = plan.shown(present, self.shown.as_deref());
        if self.in_parts
            && let Some(file) = plan.part(shown, progress)?
        {
            self.plan = Some(plan);
            return Ok(Grown::Run(file));
        }
        let file = plan.whole(progress)?;
        // A run that has what moves between its steps is not shown without it again.
        self.in_parts = false;
        Ok(Grown::Run(file))
    }

    /// Plans the run, if there is more of it than there was; else what there is to say.
    fn begin(&mut self, progress: &dyn Progress) -> Result<Option<Grown>, Failure> {
        let sources = match self.follows {
            true => self.settled(),
            false if self.built.is_some() => return Ok(Some(Grown::Done)),
            false => {
                self.built = Some(Vec::new());
                Some(sources_of(&self.names)?)
            }
        };
        let Some(sources) = sources else { return Ok(Some(Grown::Later)) };
        let run = match opened(&sources, self.follows) {
            // Nothing of it can be opened yet.
            Err(_) if self.follows && sources.iter().all(|path| open(path).is_err()) => return Ok(Some(Grown::Later)),
            run => run?,
        };
        let file = run_file_of(&sources)?;
        if RunFile::open(&file, ReadMethod::default()).is_ok() {
            mark_as_used(&file);
            self.in_parts = false;
            return Ok(Some(Grown::Run(file)));
        }
        let ready = vec![Some(false); run.steps.len()];
        let mut plan = Plan { run, file, extent: Extent::Parts, skip_damaged: self.follows, ready };
        let shown = plan.shown(None, self.shown.as_deref());
        let budget = budget(&folder("pages")?)?;
        let [steps, tracks] = plan.bytes(shown, progress)?;
        plan.extent = Extent::of(steps, tracks, budget);
        let told = plan.extent.told(steps.saturating_add(tracks), budget);
        self.plan = (plan.extent != Extent::One).then_some(plan);
        Ok(told.map(Grown::Told))
    }

    /// The sources that are not being written any more, where they are others than before.
    fn settled(&mut self) -> Option<Vec<PathBuf>> {
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
            return None;
        }
        let paths = settled.iter().map(|stamp| stamp.path.clone()).collect();
        // What has failed is tried again when something has changed.
        self.built = Some(settled);
        Some(paths)
    }
}

impl Plan {
    /// The step that is shown at a time; where that is not known, the one of this source.
    fn shown(&self, present: Option<f64>, source: Option<&Path>) -> usize {
        let of_source = || self.run.steps.iter().position(|step| Some(step.about.path.as_path()) == source);
        let at = present.filter(|_| self.run.is_timed_by_headers || self.ready.contains(&Some(true)));
        at.map(|time| before_time(&self.run, time)).or_else(of_source).unwrap_or(0)
    }

    /// About how many bytes its steps take, and its tracks: as many for each particle as the step that is shown, which is built for that.
    fn bytes(&mut self, shown: usize, progress: &dyn Progress) -> Result<[u64; 2], Failure> {
        let particles = |step: &RunStep| step.about.families.iter().map(|family| family.count).sum::<u64>();
        let Some(file) = self.step(shown, progress)? else { return Ok([0, 0]) };
        let own = particles(&self.run.steps[shown]).max(1);
        let each = std::fs::metadata(&file)?.len() as f64 / own as f64;
        let all: u64 = self.run.steps.iter().map(particles).sum();
        let at_ends = self.run.steps.last().map_or(0, particles);
        Ok([(all as f64 * each) as u64, (all - at_ends).saturating_mul(TRACK_BYTES)])
    }

    /// The page file of a step in the cache, built unless it is there; `None` where its source is damaged and may be.
    fn step(&mut self, step: usize, progress: &dyn Progress) -> Result<Option<PathBuf>, Failure> {
        match page_file_of(&self.run.steps[step].about.path, progress) {
            Ok(file) => {
                self.ready[step] = Some(true);
                Ok(Some(file))
            }
            Err(_) if self.skip_damaged => {
                self.ready[step] = None;
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Builds steps, those that are nearest to the one that is shown first, until there are twice as many as before; the file of a run of
    /// those that are there. `None` where all have been given, or there is no room for that.
    fn part(&mut self, shown: usize, progress: &dyn Progress) -> Result<Option<PathBuf>, Failure> {
        // Steps that lack what others have are not those that are built alone.
        if self.extent != Extent::Parts || !self.run.left_out.is_empty() {
            return Ok(None);
        }
        let order: Vec<usize> =
            outwards(self.ready.len(), shown).filter(|step| self.ready[*step] == Some(false)).collect();
        if order.is_empty() {
            return Ok(None);
        }
        let there = |ready: &[Option<bool>]| ready.iter().filter(|ready| **ready == Some(true)).count();
        let (begun, wanted, total) = (Instant::now(), (2 * there(&self.ready)).max(2), self.ready.len());
        for step in order {
            let here = StepProgress { progress, step: there(&self.ready) + 1, total };
            self.step(step, &here)?;
            if there(&self.ready) >= wanted && begun.elapsed() > PART {
                break;
            }
        }
        let steps = self.run.steps.iter().zip(&self.ready).filter(|(_, ready)| **ready == Some(true));
        let steps: Vec<RunStep> = steps.map(|(step, _)| step.clone()).collect();
        if steps.len() < 2 {
            return Ok(None);
        }
        let sources: Vec<PathBuf> = steps.iter().map(|step| step.about.path.clone()).collect();
        let file = run_file_of(&sources)?.with_extension("steps.df");
        if RunFile::open(&file, ReadMethod::default()).is_err() {
            self.build(Run { steps, ..self.run.clone() }, None, &file, progress)?;
        }
        Ok(Some(file))
    }

    /// Builds the run with all of its steps.
    fn whole(&self, progress: &dyn Progress) -> Result<PathBuf, Failure> {
        let tracks = TrackOptions::default();
        match self.build(self.run.clone(), (self.extent != Extent::Steps).then_some(&tracks), &self.file, progress) {
            Ok(()) => {}
            // Particles without ids, or with those of others: steps can be shown all the same.
            Err(error @ (BuildError::Import(_) | BuildError::Selection { .. })) => {
                let mut run = self.run.clone();
                run.notes.push(format!("no tracks: {error}"));
                self.build(run, None, &self.file, progress)?;
            }
            Err(error) => return Err(error.into()),
        }
        Ok(self.file.clone())
    }

    /// Builds a run file. Where there is room for that, each step is a page file of its own in the cache, so that a run that has grown builds
    /// its new steps alone, and all tracks.
    fn build(
        &self,
        run: Run,
        tracks: Option<&TrackOptions>,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<(), BuildError> {
        let (load, options) = (LoadOptions::default(), BuildOptions::default());
        let still_of = |step: &RunStep, read: &LoadOptions, progress: &dyn Progress| {
            // Alone, a step would keep what others lack.
            let is_as_alone = read.without.is_empty();
            let file = is_as_alone.then(|| page_file_of(&step.about.path, progress).ok()).flatten();
            Ok::<_, BuildError>(file.filter(|file| PageFile::open(file).is_ok()))
        };
        let still_of = (self.extent == Extent::Parts).then_some(&still_of as StillOf);
        let skip_damaged = self.skip_damaged;
        RunBuild { load: &load, options: &options, tracks, skip_damaged, still_of }.build(run, out, progress)?;
        // What cannot be removed stays.
        if let (Ok(folder), Ok(stated)) = (folder("pages"), stated_budget()) {
            let _ = make_room(&folder, stated, out);
        }
        Ok(())
    }
}

/// The numbers below `count`, those nearest to `from` first.
fn outwards(count: usize, from: usize) -> impl Iterator<Item = usize> {
    let beside = (1..=count).flat_map(move |away| [from.checked_add(away), from.checked_sub(away)]);
    std::iter::once(Some(from)).chain(beside).flatten().filter(move |number| *number < count)
}

/// The step at or before a time.
fn before_time(run: &Run, time: f64) -> usize {
    run.steps.partition_point(|step| step.time <= time).saturating_sub(1)
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

/// The path of a run of these sources in the cache.
fn run_file_of(sources: &[PathBuf]) -> Result<PathBuf, Failure> {
    let mut hasher = DefaultHasher::new();
    for source in sources {
        cached_name(source)?.hash(&mut hasher);
    }
    let first = sources.first().and_then(|first| first.file_stem()).unwrap_or_default().to_string_lossy();
    Ok(folder("pages")?.join(format!("{first}-run-{:016x}.df", hasher.finish())))
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
        let mut run = CachedRun::new(vec![folder.path().to_owned()], true).in_parts();
        assert_eq!(run.grow(None, &()).unwrap(), Grown::Later, "nothing is there");
        assert_eq!(run.first(None).unwrap(), None);
        write("dump.0", 0);
        assert_eq!(run.grow(None, &()).unwrap(), Grown::Later, "it has just been written");
        assert!(run.built.is_none());
        // Settled, but cut short: it is no step yet, and no error.
        write("dump.0", 60);
        assert_eq!(run.grow(None, &()).unwrap(), Grown::Later);
        assert_eq!(run.built.as_ref().map(Vec::len), Some(1));
        assert_eq!(run.grow(None, &()).unwrap(), Grown::Later);
        write("dump.1", 50);
        assert_eq!(run.grow(None, &()).unwrap(), Grown::Later, "neither of two can be opened");
        assert_eq!(run.built.as_ref().map(Vec::len), Some(2));
        assert_eq!(run.first(None).unwrap(), None);
    }

    #[test]
    fn the_cache_says_how_much_of_a_run_it_has_room_for() {
        let extents =
            [(0, Extent::One), (9, Extent::One), (10, Extent::Steps), (29, Extent::Steps), (30, Extent::Whole)];
        for (budget, extent) in extents.into_iter().chain([(59, Extent::Whole), (60, Extent::Parts)]) {
            assert_eq!(Extent::of(10, 20, budget), extent, "{budget}");
        }
        assert_eq!(Extent::of(u64::MAX, u64::MAX, u64::MAX - 1), Extent::One);
        assert_eq!(Extent::Whole.told(30, 31), None);
        let told = Extent::Steps.told(31_000_000_000, 20_000_000_000).unwrap();
        assert!(told.contains("about 31.00 GB") && told.contains("20.00 GB (DEEPFIELD_CACHE)"), "{told}");
    }

    #[test]
    fn steps_are_built_outwards() {
        assert_eq!(outwards(6, 2).collect::<Vec<_>>(), [2, 3, 1, 4, 0, 5]);
        assert_eq!(outwards(3, 0).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(outwards(0, 0).count(), 0);
    }
}
