//! Runs that are built while their first step is shown, or while a simulation writes them: what has come is opened in the place of what
//! was there, with the view as it is.

use super::open::{Opened, Openings, open_members};
use super::options::{Grower, More, Opener};
use super::playhead::Playhead;
use super::scene::Scene;
use super::state::notices::Notices;
use super::state::progress::SharedProgress;
use crate::look::Member;
use crate::model::{ReadMethod, When};
use bevy::prelude::*;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// Seconds between two looks.
const INTERVAL_SECS: f64 = 1.0;

/// The run that grows.
#[derive(Resource)]
pub struct Growing {
    grower: Grower,
    opener: Opener,
    /// The time that is shown, for whoever opens what has come.
    present: Arc<Mutex<Option<f64>>>,
    /// What it is shown by; another file means that the user has turned to something else.
    shown: Option<PathBuf>,
    next_secs: f64,
    work: Option<Mutex<Receiver<Outcome>>>,
    is_done: bool,
}

type Outcome = Result<Grown, String>;

/// What a look has found.
enum Grown {
    Opened(Box<Opened>),
    Told(String),
    Later,
    Done,
}

impl Growing {
    /// Nothing has come yet.
    pub fn new(grower: Grower, opener: Opener) -> Growing {
        let present = Arc::new(Mutex::new(None));
        Growing { grower, opener, present, shown: None, next_secs: 0.0, work: None, is_done: false }
    }

    /// Begins to look for more.
    fn start(&mut self, read: ReadMethod) -> Arc<SharedProgress> {
        let progress = Arc::new(SharedProgress::default());
        let (grower, opener, present) = (Arc::clone(&self.grower), Arc::clone(&self.opener), Arc::clone(&self.present));
        let (shared, (send, outcome)) = (Arc::clone(&progress), channel());
        let look = move || -> Outcome {
            let now = *present.lock().unwrap_or_else(PoisonError::into_inner);
            let path = match grower(now, shared.as_ref())? {
                More::Run(path) => path,
                More::Told(what) => return Ok(Grown::Told(what)),
                More::Later => return Ok(Grown::Later),
                More::Done => return Ok(Grown::Done),
            };
            let time = *present.lock().unwrap_or_else(PoisonError::into_inner);
            let (members, moment) = (vec![Member::new(path)], (time.map(When::Time), None));
            let mut opened = open_members(members, None, moment, read, &opener, shared.as_ref())?;
            // A time that the run does not have is not one that the user has named.
            opened.notes.clear();
            Ok(Grown::Opened(Box::new(Opened { keeps: true, ..opened })))
        };
        let thread = std::thread::Builder::new().name("deepfield run".into()).spawn(move || drop(send.send(look())));
        // Without a thread, the end of the channel is the answer.
        drop(thread);
        self.work = Some(Mutex::new(outcome));
        progress
    }

    /// What the look that is under way has found; `None` where it is not over.
    fn found(&mut self) -> Option<Outcome> {
        let outcome = self.work.as_mut()?.get_mut().unwrap_or_else(PoisonError::into_inner).try_recv();
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(TryRecvError::Disconnected) => Err("building the run has failed".into()),
            Err(TryRecvError::Empty) => return None,
        };
        self.work = None;
        Some(outcome)
    }
}

/// Looks for more of the run, once a second, and hands over what has come.
pub(super) fn grow(
    time: Res<Time<Real>>,
    mut growing: ResMut<Growing>,
    scene: Option<Res<Scene>>,
    playhead: Option<Res<Playhead>>,
    mut openings: ResMut<Openings>,
    mut notices: ResMut<Notices>,
    mut opened: MessageWriter<Opened>,
) {
    let growing = growing.bypass_change_detection();
    if growing.is_done || openings.is_opening() {
        return;
    }
    if let Some(scene) = &scene {
        let shown = growing.shown.get_or_insert_with(|| scene.path.clone());
        if *shown != scene.path || scene.members.len() > 1 {
            growing.is_done = true;
            openings.behind = None;
            return;
        }
        let present = playhead.map(|playhead| playhead.time()).or(scene.file.metadata().provenance.time);
        *growing.present.lock().unwrap_or_else(PoisonError::into_inner) = present;
    }
    let now = time.elapsed_secs_f64();
    if growing.work.is_none() && now >= growing.next_secs {
        let progress = growing.start(openings.read);
        let name = growing.shown.clone().unwrap_or_default();
        openings.bypass_change_detection().behind = Some((name, progress));
        return;
    }
    let Some(outcome) = growing.found() else { return };
    growing.next_secs = now + INTERVAL_SECS;
    openings.bypass_change_detection().behind = None;
    match outcome {
        Ok(Grown::Opened(file)) => {
            growing.shown = Some(file.path.clone());
            opened.write(*file);
        }
        Ok(Grown::Told(what)) => notices.error(what),
        Ok(Grown::Later) => {}
        Ok(Grown::Done) => growing.is_done = true,
        Err(why) => notices.error(why),
    }
}
