//! The ranges of a run's colours, found once for the present view at a few moments of the whole run, so that colours do not flicker while
//! it plays: on a thread of its own, once the camera rests.

use super::camera::Viewpoint;
use super::look::Look;
use super::picture::{DataCamera, Picture};
use super::playhead::Playhead;
use super::preset::{Over, Preset};
use super::scene::{Scene, Settings};
use super::scene_io::camera_of;
use super::state::answer::Answer;
use super::statistics::Converged;
use crate::color::ExposureMode;
use crate::color::transfer::{Levels, Range};
use crate::look::{Camera, LookPatch};
use crate::model::{FamilyName, When};
use crate::picture::ranges::{Format, Measured};
use crate::picture::{PictureError, Session};
use crate::view::Surround;
use bevy::prelude::*;
use std::time::{Duration, Instant};

/// Moments at which ranges are found, at most.
const MOMENTS: usize = 9;
/// Pixels along the picture's shorter side that they are found from, at most.
const SIDE: u32 = 270;
/// How long the camera rests before they are sought.
const REST: Duration = Duration::from_millis(200);

/// What ranges depend on.
#[derive(Clone, PartialEq)]
struct Key {
    dataset: u32,
    look: LookPatch,
    camera: Camera,
    size: (u32, u32),
}

/// The ranges of the run, as far as they are known.
#[derive(Resource, Default)]
pub struct RunRanges {
    /// What is wanted, and since when.
    wanted: Option<(Key, Instant)>,
    /// What is being measured, its moments that are still to come, and what was found.
    coming: Option<(Key, Vec<f64>, Option<Measured>)>,
    answer: Answer<(Session, Result<Measured, PictureError>)>,
    session: Option<(u32, Session)>,
    found: Option<(Key, Measured)>,
    failed: Option<Key>,
}

impl RunRanges {
    /// The ranges of a picture with this look; `None` before they are known, or where they are of another look.
    pub fn levels(&self, look: &Look) -> Option<Levels> {
        self.wanted.as_ref()?;
        let (_, measured) = self.found.as_ref()?;
        // What the user has set stays.
        let set = |range: Range, found: [f64; 2]| match range {
            Range::Fixed(low, high) => [low, high],
            Range::Auto => found,
        };
        let s = look.transfer.hue.as_ref().map_or(measured.levels.s, |hue| set(hue.range, measured.levels.s));
        look.shows(measured).then(|| Levels { p: set(look.transfer.range, measured.levels.p), s })
    }

    /// Whether what is wanted is not known yet.
    fn is_pending(&self) -> bool {
        self.wanted.as_ref().is_some_and(|(wanted, _)| {
            self.found.as_ref().is_none_or(|(known, _)| known != wanted) && self.failed.as_ref() != Some(wanted)
        })
    }

    /// Takes in what has been measured at a moment.
    fn receive(&mut self) {
        if !self.answer.receive() {
            return;
        }
        let (Some((key, left, before)), answer) = (self.coming.take(), std::mem::take(&mut self.answer)) else {
            return;
        };
        let Answer::Here((session, Ok(measured))) = answer else {
            // The picture's own ranges are used.
            self.failed = Some(key);
            return;
        };
        self.session = Some((key.dataset, session));
        let measured = match before {
            None => measured,
            Some(before) => {
                let both = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
                let levels =
                    Levels { p: both(before.levels.p, measured.levels.p), s: both(before.levels.s, measured.levels.s) };
                Measured { levels, ..measured }
            }
        };
        match left.is_empty() {
            true => self.found = Some((key, measured)),
            false => self.coming = Some((key, left, Some(measured))),
        }
    }
}

/// The moments of a run of these steps: all of them, or some evenly along them.
fn moments(times: &[f64]) -> Vec<f64> {
    let count = times.len().min(MOMENTS);
    (0..count).map(|i| times[i * (times.len() - 1) / (count - 1).max(1)]).collect()
}

/// Seeks the ranges of the run in the present view.
pub(super) fn measure_run(
    mut ranges: ResMut<RunRanges>,
    scene: Option<Res<Scene>>,
    playhead: Option<Res<Playhead>>,
    settings: Res<Settings>,
    (picture, preset): (Res<Picture>, Res<Preset>),
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let ranges = ranges.bypass_change_detection();
    ranges.receive();
    let is_auto = settings.transfer.range == Range::Auto
        || settings.transfer.hue.as_ref().is_some_and(|hue| hue.range == Range::Auto);
    let is_wanted =
        is_auto && !settings.is_projected() && preset.playing.range == Over::Run && !settings.mode.is_of_paths();
    let run = scene.zip(playhead).filter(|(scene, playhead)| {
        is_wanted && scene.opened.is_some() && scene.members.len() == 1 && playhead.times().times.len() > 1
    });
    let Some((scene, playhead)) = run else {
        if ranges.wanted.is_some() {
            *ranges = RunRanges::default();
        }
        return;
    };
    let names: Vec<FamilyName> = {
        let shown = scene.metadata().families.iter().zip(&settings.families).filter(|(_, shown)| **shown);
        shown.map(|(family, _)| family.name).collect()
    };
    let interpolation = Some(playhead.interpolation());
    let look = LookPatch {
        families: (names.len() < scene.metadata().families.len()).then_some(names),
        interpolation,
        selections: None,
        paths: None,
        annotations: None,
        ..settings.look.patch()
    };
    let size = picture.size();
    let shrink = (f64::from(SIDE) / f64::from(size.x.min(size.y).max(1))).min(1.0);
    let size = (size.x, size.y);
    let key = Key { dataset: scene.dataset, look, camera: camera_of(&camera, &settings.lens), size };
    let is_fixed = settings.exposure == ExposureMode::Fixed;
    let key = match &ranges.found {
        // Wherever the camera is since.
        Some((known, _)) if is_fixed && known.dataset == key.dataset && known.look == key.look => known.clone(),
        _ => key,
    };
    if ranges.wanted.as_ref().is_none_or(|(wanted, _)| *wanted != key) {
        ranges.wanted = Some((key.clone(), Instant::now()));
    }
    let is_at_rest = ranges.wanted.as_ref().is_some_and(|(_, since)| since.elapsed() >= REST);
    if matches!(ranges.answer, Answer::Coming(_)) || !ranges.is_pending() || !is_at_rest {
        return;
    }
    if ranges.coming.as_ref().is_none_or(|(known, ..)| *known != key) {
        ranges.coming = Some((key.clone(), moments(&playhead.times().times), None));
    }
    let Some((_, left, _)) = &mut ranges.coming else { return };
    let Some(time) = left.pop() else { return };
    let known = ranges.session.take().filter(|(dataset, _)| *dataset == key.dataset).map(|(_, session)| session);
    let (opened, members) = (scene.opened.clone(), scene.members.clone());
    ranges.answer = Answer::ask("ranges of the run", move |_| {
        let mut session = match (known, opened) {
            (Some(session), _) => session,
            (None, Some(opened)) => Session::of_opened(opened, members).map_err(|error| error.to_string())?.0,
            (None, None) => return Err("no run is open".to_owned()),
        };
        let side = |pixels: u32| ((f64::from(pixels) * shrink).round() as u32).max(1);
        let format = Format { size: (side(key.size.0), side(key.size.1)), surround: Surround::Flat };
        let look = LookPatch { time: Some(When::Time(time)), ..key.look };
        let draw = move || {
            let measured = session.ranges(&look, &key.camera, format);
            (session, measured)
        };
        // A part of the processor only: the window's picture needs it more.
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        let few = rayon::ThreadPoolBuilder::new().num_threads((all / 4).max(1)).build();
        few.map(|few| few.install(draw)).map_err(|error| error.to_string())
    });
}

/// Whoever waits for a picture waits for its ranges.
pub(super) fn hold_convergence(
    ranges: Res<RunRanges>,
    playhead: Option<Res<Playhead>>,
    mut converged: ResMut<Converged>,
) {
    // While time goes on nobody waits.
    converged.0 &= playhead.is_none_or(|playhead| playhead.is_playing()) || !ranges.is_pending();
}
