//! Probes in the window: a region that is summed up over the whole data.

use super::asking::Asking;
use crate::explore::data::{open_source, source_of};
use crate::explore::{ExploreError, Members, Probe, ProbeOptions, ProfileOptions, Work, probe};
use crate::import::Source;
use crate::store::PageFile;
use crate::window::scene::Scene;
use crate::window::state::answer::Answer;
use bevy::prelude::*;
use std::path::PathBuf;

/// Shells of a profile.
const SHELLS: usize = 24;

/// What is looked at, and what is known of it.
#[derive(Resource, Default)]
pub struct Prober {
    /// What is summed up.
    pub members: Option<Members>,
    /// Its sums.
    pub sums: Answer<Probe>,
    /// The same of another moment, on their way.
    again: Answer<Probe>,
    /// The time of the run that was asked for last.
    asked_at: Option<f64>,
    /// Whether they are exact where they can be.
    exact: bool,
}

impl Prober {
    /// Sums up what is there now, `exact` or as a page file has it; what was going on is stopped.
    pub fn start(&mut self, scene: &Scene, members: Members, exact: bool) {
        self.sums = Prober::ask(scene, &members, exact);
        *self = Prober {
            members: Some(members),
            sums: std::mem::take(&mut self.sums),
            again: Answer::Nothing,
            asked_at: scene.time,
            exact,
        };
    }

    fn ask(scene: &Scene, members: &Members, exact: bool) -> Answer<Probe> {
        let (asking, asked) = (Asking::about(scene, members, exact), members.clone());
        Answer::ask("probe", move |work| sum_up(&asking, &asked, work))
    }

    /// Asks once more where another moment of the run is shown; what was found stays until the answer is here.
    pub(super) fn keep_up(&mut self, scene: &Scene, is_playing: bool) {
        if self.again.receive() && matches!(self.again, Answer::Here(_) | Answer::Failed(_)) {
            self.sums = std::mem::take(&mut self.again);
        }
        let Some(members) = &self.members else { return };
        let is_busy = matches!(self.sums, Answer::Coming(_)) || matches!(self.again, Answer::Coming(_));
        // Who is in a region now is found by looking at it: when time stands.
        if scene.times.is_none() || self.asked_at == scene.time || is_busy || is_playing && !members.stay() {
            return;
        }
        self.again = Prober::ask(scene, members, self.exact);
        self.asked_at = scene.time;
    }
}

/// The source of a page file: the one that is named, else the one that the file names itself.
///
/// # Errors
/// Where it cannot be opened, is not there any more, or is another one.
pub fn opened(file: &PageFile, source: Option<PathBuf>) -> Result<Box<dyn Source>, ExploreError> {
    match source {
        Some(path) => open_source(&path, file),
        None => source_of(file),
    }
}

fn sum_up(asking: &Asking, members: &Members, work: Work<'_>) -> Result<Probe, ExploreError> {
    asking.ask(members, work, |data, members, periodic| {
        let sphere = match members {
            Members::Region(region) => region.first_sphere(),
            Members::Ids(_) | Members::Tracked { .. } => None,
        };
        let profile = sphere.map(|_| ProfileOptions::logarithmic(SHELLS));
        let options = ProbeOptions { profile, periodic, ..ProbeOptions::default() };
        probe(data, members, &options, work)
    })
}
