//! Pictures of all directions and for two eyes.

use super::{Session, Shown};
use crate::cpu::volume::VolumeError;
use crate::mode::{LodBudget, PathsOf, Plan};
use crate::picture::left_out::LeftOut;
use crate::picture::projected::{Means, Projector};
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError};
use crate::store::Tree;

impl Session {
    pub(super) fn draw_projected(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let asked = |why: &str| Err(PictureError::Asked(why.to_owned()));
        if self.options.overdraw.is_some() {
            return asked("--overdraw: is for flat pictures");
        }
        let Shown { shot, view, depiction, .. } = *shown;
        let lod_budget = shot.look.budget.file_budget();
        if lod_budget.presence > 0.0 || lod_budget.thinning > 0.0 {
            self.reporter.tell("presence and thinning are for flat pictures; nothing is left out".into());
        }
        if shot.look.selections.as_ref().is_some_and(|sets| !sets.is_empty()) {
            self.reporter.tell("selections are shown in flat pictures only".into());
        }
        if depiction.mode.is_of_paths() {
            return asked("mode paths: is for flat pictures");
        }
        if shot.look.paths_of() != PathsOf::None {
            self.tell_of_paths("paths are drawn in flat pictures only");
        }
        let projector = Projector::new(view, shot.surround, shot.stereo)?;
        let passes = self.passes(depiction.mode)?;
        let passes = match (passes, projector.only_on_processor(depiction), self.options.backend) {
            (Some(_), Some(why), Some(_)) => return asked(&format!("--backend: only cpu draws {why}")),
            (Some(_), Some(_), None) => None,
            (passes, _, _) => passes,
        };
        let mut times = Times::default();
        let subject = self.subject(tree, shown);
        let (tau, is_asked) = (shot.look.error_px(), self.options.backend.is_some());
        let on_adapter = passes.zip(self.adapter.as_deref_mut());
        let mut means = Means { scene: &mut self.scene, adapter: on_adapter, reporter: &*self.reporter };
        let drawn = times.measure("frame", || projector.draw(&mut means, &subject, tau));
        let (values, tally) = match drawn {
            Err(PictureError::Volume(VolumeError::Device(error))) if is_asked => return asked(&error),
            Err(PictureError::Volume(VolumeError::Device(error))) => {
                self.reporter.tell(format!("{error}; drawing with the CPU instead"));
                let mut means = Means { scene: &mut self.scene, adapter: None, reporter: &*self.reporter };
                times.measure("frame", || projector.draw(&mut means, &subject, tau))?
            }
            drawn => drawn?,
        };
        let on_processor = tally.drawn_by.is_none();
        let (outside, splats) = match depiction.mode.is_light() {
            true => (None, None),
            // An adapter does not count what lies outside.
            false => (on_processor.then_some(tally.counts.outside), Some(tally.counts.drawn)),
        };
        let blank = self.blank(shown, projector.base)?;
        Ok(Picture {
            values,
            converged: tally.converged,
            error_px: tally.error_px,
            particles: tally.particles,
            moment: self.shown_moment(tally.particles),
            nodes: tally.nodes,
            left_out: LeftOut { outside, splats, ..LeftOut::new(&LodBudget::NONE, &Plan::default()) },
            milliseconds: times.medians(),
            drawn_by: tally.drawn_by.unwrap_or(blank.drawn_by),
            ..blank
        })
    }
}
