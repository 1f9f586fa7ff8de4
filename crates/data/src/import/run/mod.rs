//! Many snapshots as one run: which files, in which order of time, and whether they fit together. Only their headers are read.

mod agree;
mod names;

use super::folder::name_of;
use super::format::{files_of_opened, open_file, open_with, steps_in};
use super::vector_field::Frame;
use super::{Description, ImportError, Source, step_name};
use crate::model::{ClockVariable, ReadMethod};
use std::collections::HashSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Where the times of steps come from, in place of their headers.
#[derive(Clone, Debug, PartialEq)]
pub enum Times {
    /// One for each file, in the order in which they are named.
    List(Vec<f64>),
    /// The first one, and how much later each further one is.
    Even {
        /// That of the first file that is named.
        from: f64,
        /// The interval.
        step: f64,
    },
    /// The number of the file in the order in which they are named, from 0.
    Steps,
}

impl FromStr for Times {
    type Err = String;

    fn from_str(text: &str) -> Result<Times, String> {
        let number = |text: &str| text.trim().parse().ok().filter(|time: &f64| time.is_finite());
        let expected = "expected times such as 0,0.5,2, FROM:STEP such as 0:0.2, or steps";
        match (text.trim(), text.split_once(':')) {
            ("steps", _) => Ok(Times::Steps),
            (_, Some((from, step))) => match (number(from), number(step)) {
                (Some(from), Some(step)) if step > 0.0 => Ok(Times::Even { from, step }),
                _ => Err(expected.into()),
            },
            (_, None) => text.split(',').map(number).collect::<Option<_>>().map(Times::List).ok_or(expected.into()),
        }
    }
}

/// How a run is put together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunOptions {
    /// The steps' times; `None`: those of their headers.
    pub times: Option<Times>,
    /// Only every so many steps, in the order of time, from the first on.
    pub every: Option<NonZeroUsize>,
    /// Leaves out files that cannot be opened.
    pub skip_damaged: bool,
    /// Attributes that were asked for by name.
    pub attributes: Option<Vec<String>>,
    /// What time is counted in; `None`: the scale factor of comoving data, else time.
    pub clock: Option<ClockVariable>,
}

/// A step of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStep {
    /// What its file says about itself.
    pub about: Description,
    /// Its time: that of its header, of comoving data the scale factor, unless told otherwise.
    pub time: f64,
    /// The value of the run's clock.
    pub clock: f64,
    /// How many of the run's lengths, the first step's, one of its own is.
    pub length: f64,
    /// The same of masses.
    pub mass: f64,
    /// What was traced through a velocity field; `None`: it lies in a file.
    pub frame: Option<Frame>,
}

impl RunStep {
    /// Opens its source; a file is read in the way `method`.
    ///
    /// # Errors
    /// [`ImportError`] when the file cannot be read, or is damaged.
    pub fn open(&self, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        match &self.frame {
            Some(frame) => Ok(frame.open()),
            None => open_with(&self.about.path, method),
        }
    }
}

/// The snapshots of a run, in the order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// One for each snapshot, each later than the one before; at least one.
    pub steps: Vec<RunStep>,
    /// Attributes that only some steps have, so that none keeps them.
    pub left_out: Vec<String>,
    /// What times are.
    pub clock: ClockVariable,
    /// Whether times are those of the headers.
    pub is_timed_by_headers: bool,
    /// What was assumed, converted or left out, one sentence each.
    pub notes: Vec<String>,
}

/// The sources that names on the command line stand for: files, folders, patterns and lists (`@steps.txt`), each source once.
///
/// # Errors
/// [`ImportError`] where a list or folder cannot be read, or a pattern or folder has no source.
pub fn sources_of(names: &[PathBuf]) -> Result<Vec<PathBuf>, ImportError> {
    names::expand(names)
}

/// Puts the sources `files` together to a run, each opened once to be asked what it holds. Files of one snapshot in several are
/// grouped by what their headers say.
///
/// # Errors
/// [`ImportError`] where a source cannot be opened (unless those are left out), has no time, the same time as another, or does not
/// fit to the others.
pub fn open_run(files: &[PathBuf], options: &RunOptions, method: ReadMethod) -> Result<Run, ImportError> {
    let mut notes = Vec::new();
    let (opened, places) = describe(files, options.skip_damaged, method, &mut notes)?;
    let mut steps = timed(opened, places, options.times.as_ref())?;
    let in_order = |steps: &[RunStep]| {
        steps.windows(2).all(|pair| names::by_numbers(&pair[0].about.path, &pair[1].about.path).is_le())
    };
    let named_in_order = in_order(&steps);
    steps.sort_by(|a, b| a.time.total_cmp(&b.time));
    for pair in steps.windows(2) {
        if pair[0].time == pair[1].time {
            let (path, other) = (&pair[1].about.path, name_of(&pair[0].about.path));
            let found = format!("{}, that of {other} too", pair[0].time);
            return Err(ImportError::malformed(path, "time", found, "a time of its own; --times says it otherwise"));
        }
    }
    if named_in_order && !in_order(&steps) {
        notes.push("sorted by the times in the headers, which is not the order of the names".into());
    }
    let paths: Vec<&Path> = steps.iter().map(|step| step.about.path.as_path()).collect();
    notes.extend(names::gaps(&paths));
    let every = options.every.map_or(1, NonZeroUsize::get);
    let mut steps: Vec<RunStep> = steps.into_iter().step_by(every).collect();
    agree::scale(&mut steps, &mut notes)?;
    let left_out = agree::left_out(&steps, options.attributes.as_deref(), &mut notes)?;
    let is_comoving = options.times.is_none() && steps.iter().all(|step| step.about.scale_factor.is_some());
    let usual = if is_comoving { ClockVariable::ScaleFactor } else { ClockVariable::Time };
    let clock = options.clock.unwrap_or(usual);
    if clock != usual {
        for step in &mut steps {
            let value = clock.value(&step.about.epoch()).filter(|_| is_comoving);
            step.clock = value.ok_or_else(|| {
                let expected = "comoving data whose header has a cosmology, and no --times";
                ImportError::missing(&step.about.path, "--clock", expected)
            })?;
        }
    }
    Ok(Run { steps, left_out, clock, is_timed_by_headers: options.times.is_none(), notes })
}

/// The sources with each that holds several steps in the place of its steps.
fn steps_of(files: &[PathBuf], skip_damaged: bool, notes: &mut Vec<String>) -> Result<Vec<PathBuf>, ImportError> {
    let mut all = Vec::with_capacity(files.len());
    for file in files {
        match steps_in(file) {
            Ok(0 | 1) => all.push(file.clone()),
            Ok(steps) => {
                notes.push(format!("{}: {steps} steps in the file", name_of(file)));
                all.extend((0..steps).map(|step| step_name(file, step)));
            }
            // It is told where the file is opened.
            Err(_) if skip_damaged => all.push(file.clone()),
            Err(error) => return Err(error),
        }
    }
    Ok(all)
}

/// What each source says about itself, in the order of `files`, with a place in that order; and how many places there are, with those of
/// what is left out.
fn describe(
    files: &[PathBuf],
    skip_damaged: bool,
    method: ReadMethod,
    notes: &mut Vec<String>,
) -> Result<(Vec<(usize, Description)>, usize), ImportError> {
    let mut parts: HashSet<PathBuf> = HashSet::new();
    let mut opened = Vec::new();
    let mut first_error = None;
    let files = steps_of(files, skip_damaged, notes)?;
    for file in &files {
        if parts.contains(file) {
            continue;
        }
        match open_file(file, method) {
            Ok(source) => {
                let about = source.description();
                // A file without particles of its own stands for others.
                if parts.contains(&about.path) {
                    continue;
                }
                parts.extend(files_of_opened(about)?);
                opened.push((opened.len(), about.clone()));
            }
            Err(error) if skip_damaged => {
                notes.push(format!("left out: {error}"));
                first_error = first_error.or(Some(error));
                // It has its place in what --times says.
                opened.push((opened.len(), Description::unitless(file, "", 0)));
            }
            Err(error) => return Err(error),
        }
    }
    let places = opened.len();
    opened.retain(|(_, about)| !about.format.is_empty());
    match first_error {
        Some(error) if opened.is_empty() => Err(error),
        _ => Ok((opened, places)),
    }
}

/// The steps with their times; `places` is how many sources were named.
fn timed(opened: Vec<(usize, Description)>, places: usize, times: Option<&Times>) -> Result<Vec<RunStep>, ImportError> {
    if let (Some(Times::List(list)), Some((_, about))) = (times, opened.last()) {
        let expected = format!("{places}, one for each file");
        if list.len() != places {
            return Err(ImportError::malformed(&about.path, "--times", format!("{} times", list.len()), expected));
        }
    }
    let own = |about: &Description| {
        let missing = || ImportError::missing(&about.path, "time", "one in its header, or --times");
        about.scale_factor.or(about.time).filter(|time| time.is_finite()).ok_or_else(missing)
    };
    let time = |number: usize, about: &Description| match times {
        None => own(about),
        Some(Times::Steps) => Ok(number as f64),
        Some(Times::Even { from, step }) => Ok(from + number as f64 * step),
        // As many as there are files, by the check above.
        Some(Times::List(list)) => Ok(list.get(number).copied().unwrap_or(number as f64)),
    };
    let step = |(number, about): (usize, Description)| {
        let time = time(number, &about)?;
        Ok(RunStep { time, clock: time, about, length: 1.0, mass: 1.0, frame: None })
    };
    opened.into_iter().map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of two particles, with these units and attributes.
    fn tables(folder: &Path, tables: &[(&str, &str, &str)]) -> Vec<PathBuf> {
        let written = tables.iter().map(|(name, unit, attribute)| {
            let path = folder.join(name);
            let extra = if attribute.is_empty() { ["", "", ""] } else { [",", "1", "2"] };
            let [comma, one, two] = extra;
            let text =
                format!("x [{unit}],y [{unit}],z [{unit}]{comma}{attribute}\n0,0,0{comma}{one}\n1,1,1{comma}{two}\n");
            std::fs::write(&path, text).unwrap();
            path
        });
        written.collect()
    }

    fn opened(files: &[PathBuf], times: &str) -> Result<Run, String> {
        let options = RunOptions { times: Some(times.parse()?), ..RunOptions::default() };
        open_run(files, &options, ReadMethod::default()).map_err(|error| error.to_string())
    }

    #[test]
    fn times_are_listed_even_or_numbers() {
        assert_eq!("0, 0.5,2".parse(), Ok(Times::List(vec![0.0, 0.5, 2.0])));
        assert_eq!("0:0.2".parse(), Ok(Times::Even { from: 0.0, step: 0.2 }));
        assert_eq!("steps".parse(), Ok(Times::Steps));
        for wrong in ["", "0,", "0:0", "0:-1", "a:b", "nan", "0,inf"] {
            assert!(wrong.parse::<Times>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn steps_are_sorted_converted_and_compared() {
        let folder = tempfile::tempdir().unwrap();
        let files =
            tables(folder.path(), &[("t0.csv", "kpc", "temp"), ("t1.csv", "Mpc", "temp"), ("t3.csv", "kpc", "")]);
        let run = opened(&files, "5,1,2").unwrap();
        let times: Vec<f64> = run.steps.iter().map(|step| step.time).collect();
        assert_eq!(times, [1.0, 2.0, 5.0]);
        // The first step's units are the run's.
        let lengths: Vec<f64> = run.steps.iter().map(|step| step.length).collect();
        assert!((lengths[1] - 1e-3).abs() < 1e-15 && lengths[0] == 1.0, "{lengths:?}");
        assert_eq!(run.left_out, ["temperature"]);
        let told = run.notes.join("; ");
        for part in
            ["sorted", "t3.csv: lengths in kpc are converted to Mpc", "attribute temperature is left out: t3.csv"]
        {
            assert!(told.contains(part), "{told}");
        }
        let every = RunOptions { times: Some(Times::Steps), every: NonZeroUsize::new(2), ..RunOptions::default() };
        let run = open_run(&files, &every, ReadMethod::default()).unwrap();
        assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.0, 2.0]);
        assert!(run.notes[0].contains("no file between t1.csv and t3.csv"), "{:?}", run.notes);

        for (list, found) in [("0,1", 2), ("0,1,2,3", 4)] {
            let refused = opened(&files, list).unwrap_err();
            assert!(refused.contains(&format!("--times: found {found} times, expected 3")), "{refused}");
        }
        let twice = opened(&files, "0,1,1").unwrap_err();
        assert!(twice.contains("t3.csv: time: found 1, that of t1.csv too"), "{twice}");
        let untimed = open_run(&files, &RunOptions::default(), ReadMethod::default()).unwrap_err().to_string();
        assert!(untimed.ends_with("t0.csv: time: missing, expected one in its header, or --times"), "{untimed}");
        let asked = RunOptions { attributes: Some(vec!["temperature".into()]), ..every };
        let refused = open_run(&files, &asked, ReadMethod::default()).unwrap_err().to_string();
        assert!(refused.contains("t3.csv: attribute temperature: missing"), "{refused}");
        let strange = tables(folder.path(), &[("u0.csv", "kpc", ""), ("u1.csv", "K", "")]);
        assert!(opened(&strange, "steps").is_err());
    }

    #[test]
    fn damaged_files_are_refused_or_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let mut files = tables(folder.path(), &[("t0.csv", "kpc", ""), ("t2.csv", "kpc", "")]);
        let bad = folder.path().join("t1.csv");
        std::fs::write(&bad, "x,y\n0\n").unwrap();
        files.insert(1, bad);
        assert!(opened(&files, "0:0.5").unwrap_err().contains("t1.csv"));
        let options = RunOptions { times: Some("0:0.5".parse().unwrap()), skip_damaged: true, ..RunOptions::default() };
        let run = open_run(&files, &options, ReadMethod::default()).unwrap();
        assert_eq!(run.steps.iter().map(|step| step.time).collect::<Vec<_>>(), [0.0, 1.0]);
        assert!(run.notes[0].starts_with("left out:") && run.notes[0].contains("t1.csv"), "{:?}", run.notes);
    }
}
