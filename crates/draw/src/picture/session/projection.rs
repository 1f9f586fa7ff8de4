//! Pictures of all directions and for two eyes.

use super::clusters::{Attempt, Drawn};
use super::{Session, Shown};
use crate::color::transfer::TransferFunction;
use crate::cpu::paths::fragments::lay_over_colors;
use crate::cpu::volume::VolumeError;
use crate::explore::SelectionSet;
use crate::explore::selection::Show;
use crate::mode::{Depiction, LodBudget, Plan};
use crate::modes;
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::LevelReport;
use crate::picture::paths::ChosenPaths;
use crate::picture::projected::{Means, Projector};
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError};
use crate::store::Tree;
use std::sync::Arc;
use std::time::Instant;

impl Session {
    pub(super) fn draw_projected(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let asked = |why: &str| Err(PictureError::Asked(why.to_owned()));
        if self.options.overdraw.is_some() {
            return asked("--overdraw: is for flat pictures");
        }
        let Shown { shot, view, depiction, .. } = *shown;
        let lod_budget = shot.look.budget.file_budget();
        if lod_budget.presence > 0.0 || lod_budget.thinning > 0.0 {
            self.tell_once("presence and thinning are for flat pictures; nothing is left out");
        }
        let is_shown = |set: &SelectionSet| set.show != Show::Hidden;
        if shot.look.selections.as_ref().is_some_and(|sets| sets.iter().any(is_shown)) {
            self.tell_once("selections are shown in flat pictures only");
        }
        let mode = depiction.mode;
        let projector = Projector::new(view, shot.surround, shot.stereo)?;
        let mut paths = match self.has_paths(&shot.look) {
            true => self.choose_paths(shown, &projector.sight()?)?,
            false if mode.is_of_paths() => return Err(self.no_paths(&shot.look)),
            false => None,
        };
        if mode.is_of_paths() {
            return self.draw_projected_paths(shown, &projector, paths);
        }
        let drawn_as = depiction.blended();
        let passes = self.passes_without_paths(&Shown { depiction: &drawn_as, ..*shown })?;
        let passes = passes.filter(|_| shown.ground.is_none());
        let passes = match (passes, projector.only_on_processor(&drawn_as), self.options.backend) {
            (Some(_), Some(why), Some(_)) => return asked(&format!("--backend: only cpu draws {why}")),
            (Some(_), Some(_), None) => None,
            (passes, _, _) => passes,
        };
        let attempt = &mut |session: &mut Session, depiction: &Depiction| {
            session.attempt_projected(tree, &Shown { depiction, ..*shown }, &projector)
        };
        let chosen = self.chosen(tree, depiction, attempt)?;
        let shown = &Shown { depiction: chosen.as_ref().unwrap_or(depiction), ..*shown };
        let over = self.laid_over(tree, shown, &projector)?;
        let shown = match &over {
            Some((depiction, transfer)) => &Shown { depiction, transfer, ..*shown },
            None => shown,
        };
        let depiction = shown.depiction;
        let mut times = Times::default();
        let subject = self.subject(tree, shown);
        let (tau, is_asked) = (shot.look.error_px(), self.options.backend.is_some());
        let lists = self.lists();
        let adapter = passes.zip(self.adapter.as_deref_mut());
        let layer = self.paths.as_mut().zip(paths.as_mut());
        let ground = shown.ground;
        let scene = &mut self.scene;
        let mut means = Means { scene, lists, adapter, reporter: &*self.reporter, paths: layer, ground };
        let drawn = times.measure("frame", || projector.draw(&mut means, &subject, tau));
        let (values, tally) = match drawn {
            Err(PictureError::Volume(VolumeError::Device(error))) if is_asked => return asked(&error),
            Err(PictureError::Volume(VolumeError::Device(error))) => {
                self.reporter.tell(format!("{error}; drawing with the CPU instead"));
                means.adapter = None;
                times.measure("frame", || projector.draw(&mut means, &subject, tau))?
            }
            drawn => drawn?,
        };
        let on_top = match means.paths.is_some() && !mode.technique.takes_paths() {
            true => Some(Arc::new(times.measure("paths", || projector.paths(&mut means))?)),
            false => None,
        };
        let under = match depiction.mode.is_light() {
            true => None,
            false => times.measure("surfaces", || projector.ground(&means))?.map(Arc::new),
        };
        self.note_memory(tally.converged);
        let on_processor = tally.drawn_by.is_none();
        let (outside, splats) = match depiction.mode.is_light() {
            true => (None, None),
            // An adapter does not count what lies outside.
            false => (on_processor.then_some(tally.counts.outside), Some(tally.counts.drawn)),
        };
        let drawn = Drawn { splats: tally.particles, has_clusters: tally.has_clusters, values: &values };
        let level_report = match shown.ground {
            Some(_) => self.plain_report(depiction, drawn),
            None => self.level_report(depiction, drawn, attempt)?,
        };
        let level_report = if on_processor { level_report } else { level_report.by_adapter() };
        let level_report = LevelReport { error_bound: tally.error_bound, ..level_report };
        let blank = self.blank(shown, projector.base)?;
        let counts = paths.as_ref().map(ChosenPaths::counts);
        let moment = self.shown_moment(tally.particles);
        let moment = moment.map(|moment| counts.map_or(moment, |counts| moment.with_paths(counts)));
        Ok(Picture {
            values,
            converged: tally.converged,
            error_px: tally.error_px,
            particles: tally.particles,
            moment,
            nodes: tally.nodes,
            left_out: LeftOut { outside, splats, ..LeftOut::new(&LodBudget::NONE, &Plan::default()) },
            milliseconds: times.medians(),
            drawn_by: tally.drawn_by.unwrap_or(blank.drawn_by),
            level_report,
            paths: on_top,
            ground: under,
            ..blank
        })
    }

    /// What draws splats that lie over each other, where they do, and its colours: those of the sums that both eyes see.
    fn laid_over(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        projector: &Projector,
    ) -> Result<Option<(Depiction, TransferFunction)>, PictureError> {
        if shown.depiction.choice.order.is_none() {
            return Ok(None);
        }
        let (subject, tau) = (self.subject(tree, shown), shown.shot.look.error_px());
        let levels = match shown.transfer.numbers() {
            Some(levels) => levels,
            None => projector.levels(&mut self.means(), &subject, tau)?,
        };
        Ok(Some((shown.depiction.blended(), shown.transfer.clone().with_levels(&levels))))
    }

    /// Draws what is put together of faces, without paths, as it is shown.
    fn attempt_projected(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        projector: &Projector,
    ) -> Result<Attempt, PictureError> {
        let (subject, tau) = (self.subject(tree, shown), shown.shot.look.error_px());
        let mut means = self.means();
        // What has to be read takes no time of drawing.
        projector.read(&mut means, &subject)?;
        let start = Instant::now();
        let (values, tally) = projector.draw(&mut means, &subject, tau)?;
        Ok(Attempt { splats: tally.particles, has_clusters: tally.has_clusters, took: start.elapsed(), values })
    }

    /// Paths alone.
    fn draw_projected_paths(
        &mut self,
        shown: &Shown<'_>,
        projector: &Projector,
        paths: Option<ChosenPaths>,
    ) -> Result<Picture, PictureError> {
        let mut times = Times::default();
        let blank = self.blank(shown, projector.base)?;
        let mut paths = paths.ok_or_else(|| self.no_paths(&shown.shot.look))?;
        let layer = self.paths.as_mut().map(|layer| (layer, &mut paths));
        let (scene, ground) = (&mut self.scene, shown.ground);
        let mut means = Means { scene, lists: false, adapter: None, reporter: &*self.reporter, paths: layer, ground };
        let mut colors = times.measure("frame", || projector.paths(&mut means))?;
        if let Some(mut under) = projector.ground(&means)? {
            lay_over_colors(&colors, &mut under);
            colors = under;
        }
        let moment = blank.moment.map(|moment| moment.with_paths(paths.counts()));
        let values = modes::paths::picture(colors.width, colors.height, Some(colors));
        Ok(Picture { values, moment, milliseconds: times.medians(), ..blank })
    }
}
