//! Frames into a folder, one after the other; a recording that was interrupted goes on.

use super::journal::{self, Journal};
use super::manifest::{self, Manifest};
use super::{Arguments, Format};
use crate::color::output;
use crate::model::new_file;
use crate::tour::{Frames, Show, Take};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// What was recorded.
#[derive(Debug)]
pub(super) struct Recorded {
    folder: PathBuf,
    drawn: usize,
    found: usize,
    took: Duration,
}

impl std::fmt::Display for Recorded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Recorded { folder, drawn, found, took } = self;
        let plural = if *drawn == 1 { "" } else { "s" };
        write!(f, "{}: {drawn} frame{plural} drawn", folder.display())?;
        if *drawn > 0 {
            write!(f, " in {:.1} s, {:.2} s each", took.as_secs_f64(), took.as_secs_f64() / *drawn as f64)?;
        }
        if *found > 0 { write!(f, "; {found} were finished before") } else { Ok(()) }
    }
}

/// The folder of scene files in that of the frames.
const SCENES: &str = "scenes";

/// The files of one frame.
struct Files {
    png: Option<PathBuf>,
    exr: Option<PathBuf>,
    scene: Option<PathBuf>,
    /// Where the scene file is, or would be.
    place: PathBuf,
}

impl Files {
    fn new(folder: &Path, arguments: &Arguments, frame: u32) -> Files {
        let number = u64::from(frame) + u64::from(arguments.offset);
        let named = |extension: &str| arguments.name.file(folder, number, extension);
        let is = |format| arguments.format.contains(&format);
        let place = arguments.name.file(&folder.join(SCENES), number, "scene.ron");
        Files {
            png: is(Format::Png).then(|| named("png")),
            exr: is(Format::Exr).then(|| named("exr")),
            scene: (!arguments.no_scenes).then(|| place.clone()),
            place,
        }
    }

    fn all(&self) -> Vec<PathBuf> {
        [&self.png, &self.exr, &self.scene].into_iter().flatten().cloned().collect()
    }
}

/// Records the frames that are not finished.
///
/// # Errors
/// When the folder holds another recording or what the tour is of, a frame cannot be drawn, or a file cannot be written. What is finished stays.
pub(super) fn record(
    show: &mut Show,
    frames: &Frames,
    arguments: &Arguments,
    folder: &Path,
) -> Result<Recorded, Error> {
    let create =
        |folder: &Path| std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()));
    let files = |frame: u32| Files::new(folder, arguments, frame);
    let all: Vec<PathBuf> = frames.range.clone().flat_map(|frame| files(frame).all()).collect();
    show.check_written(&all)?;
    create(folder)?;
    if !arguments.no_scenes {
        create(&folder.join(SCENES))?;
    }
    let mut journal = Journal::open(folder)?;
    let mut manifest = begin(show, frames, arguments, folder, &mut journal)?;
    let (finished, open): (Vec<u32>, Vec<u32>) =
        frames.range.clone().partition(|&frame| files(frame).all().iter().all(|file| journal.is_finished(file)));
    let mut progress = Progress::new(open.len(), finished.len());
    let begun = Instant::now();
    // Frames of a pause are the same picture.
    let mut last: Option<(crate::look::SceneFile, Take)> = None;
    for (i, &frame) in open.iter().enumerate() {
        let files = files(frame);
        let shot = show.shot(frames.time(frame), &files.place)?;
        if last.as_ref().is_none_or(|(before, _)| *before != shot) {
            let next = open.get(i + 1).map(|&next| frames.time(next));
            let take = show.take(&shot, next)?;
            last = Some((shot.clone(), take));
        }
        if show.is_coarser() && manifest.memory.is_none() {
            manifest.memory = show.memory();
            manifest.write(folder)?;
        }
        if let Some((_, take)) = &last {
            if let Some(scene) = &files.scene {
                shot.write(scene)?;
            }
            if let Some(exr) = &files.exr {
                take.picture.write_exr(exr)?;
            }
            if let Some(png) = &files.png {
                output::write_png(png, &take.image)?;
            }
        }
        journal.note(&files.all())?;
        progress.frame();
    }
    journal.finish(&all)?;
    Ok(Recorded { folder: folder.to_owned(), drawn: open.len(), found: finished.len(), took: begun.elapsed() })
}

/// Sees to it that the folder holds this recording and no other: what it is of.
fn begin(
    show: &Show,
    frames: &Frames,
    arguments: &Arguments,
    folder: &Path,
    journal: &mut Journal,
) -> Result<Manifest, Error> {
    let now = Manifest::new(show, frames, arguments)?;
    // A folder that is to be begun anew may hold anything.
    let before = if arguments.restart { None } else { Manifest::read(folder)? };
    let manifest = match before {
        Some(before) => {
            if let Some(difference) = before.difference(&now, show.memory()) {
                let folder = folder.display();
                return Err(format!(
                    "{folder}: it holds another recording: {difference}; choose another folder, or --restart to overwrite it"
                )
                .into());
            }
            before
        }
        None => {
            // Frames of another, longer recording would seem to be the end of this one. Other parts of this one stay.
            let is_other = match Manifest::read(folder) {
                Ok(before) => before.is_some_and(|before| before.difference(&now, show.memory()).is_some()),
                // What cannot be read is not this one.
                Err(_) => true,
            };
            if is_other {
                journal.remove_files()?;
            } else {
                journal.clear()?;
            }
            now.write(folder)?;
            now
        }
    };
    for folder in [folder.to_owned(), folder.join(SCENES)] {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(new_file::UNFINISHED) {
                std::fs::remove_file(entry.path()).map_err(|error| format!("{}: {error}", entry.path().display()))?;
            }
        }
    }
    Ok(manifest)
}

/// Removes a recording: the files that its journal names, and the folders where nothing else is in them.
///
/// # Errors
/// When a file cannot be removed.
pub(super) fn remove(folder: &Path) -> Result<(), Error> {
    Journal::open(folder)?.remove_files()?;
    for name in [manifest::NAME, journal::NAME] {
        let file = folder.join(name);
        if file.is_file() {
            std::fs::remove_file(&file).map_err(|error| format!("{}: {error}", file.display()))?;
        }
    }
    // What is not empty is somebody else's, too.
    let _ = std::fs::remove_dir(folder.join(SCENES));
    let _ = std::fs::remove_dir(folder);
    Ok(())
}

/// A bar that says how long the frames that are left will take, as the last ones took.
struct Progress {
    bar: ProgressBar,
    last: Instant,
    recent: VecDeque<Duration>,
    left: usize,
}

/// Frames from whose times the rest is estimated.
const RECENT: usize = 30;

impl Progress {
    fn new(open: usize, finished: usize) -> Progress {
        let bar = ProgressBar::with_draw_target(Some((open + finished) as u64), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{pos:>6} of {len} frames {bar:40.cyan/dim} {msg}") {
            bar.set_style(style.progress_chars("━╸─"));
        }
        bar.set_position(finished as u64);
        Progress { bar, last: Instant::now(), recent: VecDeque::new(), left: open }
    }

    fn frame(&mut self) {
        self.recent.push_back(self.last.elapsed());
        self.last = Instant::now();
        if self.recent.len() > RECENT {
            self.recent.pop_front();
        }
        self.left = self.left.saturating_sub(1);
        let each = self.recent.iter().sum::<Duration>().as_secs_f64() / self.recent.len() as f64;
        self.bar.inc(1);
        self.bar.set_message(format!("{each:.2} s a frame, {} left", duration(each * self.left as f64)));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Seconds in words.
fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole % 3600 / 60),
    }
}
