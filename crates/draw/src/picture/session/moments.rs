//! The moment of a run that is open: the tracks between two steps, or a stored step.

use super::{Data, Session};
use crate::hierarchy::spacetime::Interpolation;
use crate::import::{AttributeChoice, LoadOptions, load_source};
use crate::look::LookPatch;
use crate::picture::{PictureError, ShownMoment};
use crate::store::InMemory;
use crate::store::run::RunTree;
use crate::stream::Scene;
use std::sync::Arc;

/// Pages of earlier intervals are kept while all take no more than so much.
const KEPT_BYTES: u64 = 1 << 30;

impl Session {
    /// Opens what is shown at a moment, unless it is open: between the steps of a run its tracks, else the step at or before it. Data
    /// without times has but one.
    pub(super) fn go_to(&mut self, look: &LookPatch) -> Result<(), PictureError> {
        let Some(opened) = &self.opened else { return Ok(()) };
        let Some(moment) = opened.moment(look.time)? else { return Ok(()) };
        let interpolation = look.interpolation.unwrap_or_default();
        let run = opened.run().filter(|run| {
            let moves = moment.u > 0.0 && interpolation != Interpolation::Hold || !run.has_stills();
            // Runs among other datasets are shown by their steps.
            moves && self.members.len() == 1 && run.tracks().is_ok()
        });
        let is_open = |moving: &ShownMoment| (self.moment, moving.interpolation) == (moment, interpolation);
        match run {
            Some(_) if self.moving.as_ref().is_some_and(is_open) => {}
            Some(run) => {
                let snapshot = run.at(moment, interpolation)?;
                let directory = run.directory();
                let units = (&directory.length_unit, &directory.mass_unit);
                let placement = self.members[0].placement(units, units);
                let is_open = |tree: &RunTree| tree.interpolation() == interpolation;
                let held = self.scene.streamer.residency.statistics().bytes;
                let is_kept = moment.step == self.moment.step || held <= KEPT_BYTES;
                match &self.tracks {
                    _ if !placement.is_here() => {
                        let options = LoadOptions { attributes: AttributeChoice::All, ..LoadOptions::default() };
                        let mut dataset = load_source(&snapshot, &options, &())?;
                        placement.place(&mut dataset);
                        self.scene = Scene::new(InMemory::new(dataset), u64::MAX);
                    }
                    Some(tree) if self.moving.is_some() && is_open(tree) && is_kept => {
                        self.scene.time = Some(tree.time(moment));
                    }
                    _ => {
                        let known = self.tracks.take().filter(|tree| is_open(tree));
                        let tree =
                            known.map_or_else(|| RunTree::new(Arc::clone(run), interpolation).map(Arc::new), Ok)?;
                        self.scene = Scene::new(Arc::clone(&tree), self.budget_bytes);
                        self.scene.time = Some(tree.time(moment));
                        self.tracks = Some(tree);
                    }
                }
                let faded_mass = snapshot.faded_mass();
                self.moving = Some(ShownMoment { interpolation, faded_mass, ..ShownMoment::of(run, moment) });
                self.data = Data::Moment(Box::new(snapshot));
                (self.framed, self.hiding) = (None, None);
            }
            None if moment.step != self.moment.step || self.moving.is_some() => {
                let file = Arc::new(opened.at(moment)?.0);
                self.scene = Scene::new(Arc::clone(&file), self.budget_bytes);
                self.data = Data::Pages(file);
                (self.framed, self.hiding, self.moving) = (None, None, None);
            }
            None => {}
        }
        self.moment = moment;
        Ok(())
    }

    /// The moment of the run that a picture of so many particles shows; `None` for data without times.
    pub(super) fn shown_moment(&self, particles: u64) -> Option<ShownMoment> {
        let moving = self.moving.map(|moving| ShownMoment { tracks_drawn: particles, ..moving });
        moving.or_else(|| Some(ShownMoment::of(self.run()?, self.moment)))
    }
}
