//! Flat pictures.

use super::{Data, Session, Shortage, Shown};
use crate::color::output;
use crate::color::transfer::Levels;
use crate::cpu::overdraw::Overdraw;
use crate::cpu::paths::PathFragments;
use crate::cpu::volume::VolumeError;
use crate::hierarchy::Purpose;
use crate::mode::{Adapter, Depiction, LightPicture, LodBudget, Output, Plan, Raw};
use crate::picture::adapter::{AdapterJob, Passes, draw_on};
use crate::picture::ground::{among, lighting};
use crate::picture::hiding::{self, Hiding};
use crate::picture::left_out::LeftOut;
use crate::picture::paths::PathLayer;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, Subject};
use crate::store::{NodeRef, Tree};
use crate::stream::SceneNode;
use crate::view::perspective_grid::GridError;
use crate::view::{Hidden, View};
use std::sync::Arc;
use std::time::Instant;

impl Session {
    /// Draws a picture. Where it is certain that what is hidden changes nothing, what the picture before hides (or a sketch, if there was
    /// none) is neither read nor drawn, as long as the picture itself hides it too.
    pub(super) fn draw_flat(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let depiction = shown.depiction;
        if depiction.mode.is_of_paths() {
            return self.draw_paths_alone(shown);
        }
        let attempt = &mut |session: &mut Session, depiction: &Depiction| session.attempt_flat(tree, shown, depiction);
        let chosen = self.chosen(tree, depiction, attempt)?;
        let own = chosen.as_ref().unwrap_or(depiction);
        let drawn_as = &own.blended();
        let shown = &Shown { depiction: drawn_as, ..*shown };
        match self.levels_of_sums(tree, shown, own)? {
            Some(levels) => {
                let transfer = &shown.transfer.clone().with_levels(&levels);
                self.draw_flat_as(tree, &Shown { transfer, ..*shown })
            }
            None => self.draw_flat_as(tree, shown),
        }
    }

    /// The ranges of the colours of splats that lie over each other, where an adapter draws them: it is told, and the processor finds them
    /// itself.
    fn levels_of_sums(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        own: &Depiction,
    ) -> Result<Option<Levels>, PictureError> {
        let lies_over = shown.depiction.mode.technique.tells_columns();
        if !lies_over || shown.transfer.numbers().is_some() || self.passes_without_paths(shown)?.is_none() {
            return Ok(None);
        }
        let attempt = self.attempt_flat(tree, &Shown { depiction: own, ..*shown }, own)?;
        let (sums, _) = attempt.values.sums(own.mode)?;
        Ok(Some(shown.transfer.levels(&sums)))
    }

    /// The same as the depiction says.
    fn draw_flat_as(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let Shown { view, depiction, transfer, .. } = *shown;
        let start = Instant::now();
        if shown.ground.is_none() {
            let subject = self.subject(tree, shown);
            let in_slabs = match self.lists() {
                true => {
                    let has_adapter = self.passes_without_paths(shown)?.is_some();
                    let listing = self.listing(&subject, &view, shown.shot.look.error_px(), has_adapter)?;
                    if let Some(listing) = listing {
                        return self.draw_listed(tree, shown, (&listing, start.elapsed()));
                    }
                    self.fills_slabs(&subject, shown)?
                }
                false => self.spares_particles(&subject, shown)?,
            };
            if in_slabs {
                return self.draw_in_slabs(tree, shown);
            }
        }
        let is_sure =
            shown.ground.is_none() && matches!(self.data, Data::Pages(_)) && hiding::is_sure(depiction, transfer);
        let fits = self.scene.streamer.residency.has_room_for_all();
        let mut known = match self.hiding.take() {
            _ if !is_sure => None,
            // How coarse a picture is that does not fit depends on what it is known to hide: that has to be known of itself.
            _ if !fits => self.sketch(tree, shown)?,
            Some(hiding) if hiding.is_of(depiction) => Some(hiding),
            // The processor decodes nothing for an adapter's picture.
            _ if self.passes_without_paths(shown)?.is_some() => None,
            _ => self.sketch(tree, shown)?,
        };
        let mut attempts = 0..hiding::ATTEMPTS;
        loop {
            // The last one hides nothing.
            known = known.filter(|_| attempts.next().is_some());
            // What a sketch, or an attempt that hides less, lacks may not be lacked here.
            self.shortage = Shortage::default();
            let mut times = Times::default();
            if is_sure {
                times.note("hide", start.elapsed());
            }
            self.scene.streamer.occluder = known.as_ref().and_then(|known| known.opaque.occluder(&view));
            let drawn = self.draw_selected(tree, shown, &mut times, known.as_ref());
            self.scene.streamer.occluder = None;
            let (picture, hidden) = drawn?;
            known = Hiding::of(depiction, &picture.values).filter(|_| is_sure);
            if hidden.is_empty() || known.as_ref().is_some_and(|known| known.shows(&hidden, &picture.values, depiction))
            {
                self.hiding = known;
                return Ok(Picture { milliseconds: times.medians(), ..picture });
            }
        }
    }

    /// What a small picture hides.
    fn sketch(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Option<Hiding>, PictureError> {
        let Shown { shot, view, depiction, .. } = *shown;
        let small = hiding::sketch_view(&view);
        let selection = self.select(depiction, &small, shot.look.error_px())?;
        let drawn = self.subject(tree, shown).draw_nodes(&small, &selection.nodes, &Plan::default());
        // What is wrong with the picture, it says itself.
        Ok(drawn.ok().and_then(|values| Hiding::of(depiction, &values)))
    }

    /// Selects and draws with what hides nodes; and what was hidden.
    fn draw_selected(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        times: &mut Times,
        known: Option<&Hiding>,
    ) -> Result<(Picture, Vec<Hidden<NodeRef>>), PictureError> {
        let Shown { shot, view, depiction, .. } = *shown;
        let (metadata, mode) = (tree.metadata(), depiction.mode);
        let is_sum = mode.technique.output() == Output::Sums;
        let has_paths = self.has_paths(&shot.look);
        let takes_paths = mode.technique.takes_paths();
        let passes = self.passes_without_paths(shown)?;
        let subject = self.subject(tree, shown);
        let tau = shot.look.error_px();
        let (seen, detail) = (depiction.selection_view(&view), depiction.detail(&view, tau, metadata));
        let start = Instant::now();
        let selection = self.select(depiction, &view, tau)?;
        let detail = selection.coarser.unwrap_or(detail);
        times.note("load", start.elapsed() + self.loading.take().unwrap_or_default());
        if let Some(ahead) = self.ahead.take() {
            let from_there = known.and_then(|known| known.opaque.occluder(&ahead));
            let from_here = std::mem::replace(&mut self.scene.streamer.occluder, from_there);
            self.scene.look_ahead(&ahead, detail);
            self.scene.streamer.occluder = from_here;
        }
        // What is asked for at full precision is drawn as a whole.
        let lod_budget = if self.options.exact.is_some() { LodBudget::NONE } else { shot.look.budget.file_budget() };
        let plan = match is_sum && self.options.exact.is_none() {
            true => times.measure("plan", || subject.plan(&view, &selection.nodes, &lod_budget, None))?,
            false => Plan::default(),
        };
        // The pages are there; what follows is the longest part, and asks nobody.
        self.go_on()?;
        let mut left_out = LeftOut::new(&lod_budget, &plan);
        let repeat = self.options.repeat.max(1);
        let nodes = &selection.nodes;
        let job = passes.map(|passes| AdapterJob {
            view: &view,
            depiction,
            metadata,
            nodes,
            plan: &plan,
            passes,
            light: None,
            repeat,
        });
        if let Some(path) = self.options.overdraw.clone() {
            let counts = job.as_ref().filter(|_| self.scene.purpose != Purpose::Clusters);
            let overdraw = self.overdraw(&subject, &view, nodes, &plan, counts)?;
            output::write_png(&path, &overdraw.image())?;
            left_out.overdraw = Some((overdraw.mean(), overdraw.max()));
        }
        let blank = self.blank(shown, view)?;
        let picture = Picture {
            annotation: self.marked(blank.annotation, &shot.look, &selection)?,
            converged: selection.converged,
            error_px: selection.error_pixels,
            particles: selection.particles,
            moment: self.shown_moment(selection.particles),
            nodes: selection.nodes.len(),
            ..blank
        };
        if let Some((job, adapter)) = job.zip(self.adapter.as_mut()) {
            match draw_on(&mut **adapter, &subject, job) {
                Ok((values, frame)) => {
                    times.extend(frame.milliseconds);
                    let left_out = LeftOut { splats: frame.splats, ..left_out };
                    let drawn_by = [frame.backend.to_owned(), frame.adapter];
                    let level_report = self.flat_report(tree, shown, &selection, &values)?.by_adapter();
                    let picture = Picture { values, left_out, drawn_by, level_report, ..picture };
                    let picture = if has_paths { self.with_paths(picture, shown, times)? } else { picture };
                    return Ok((picture, selection.hidden));
                }
                Err(VolumeError::Device(error)) if self.options.backend.is_some() => {
                    return Err(PictureError::Asked(error));
                }
                Err(VolumeError::Device(error)) => {
                    self.reporter.tell(format!("{error}; drawing with the CPU instead"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        let mut values = picture.values;
        let (mut counts, mut on_top) = (None, None);
        let in_the_way = |from: &View| shown.ground.and_then(|ground| ground.opaque(from, &view));
        let subject = Subject { lighting: lighting(shown.ground, &in_the_way), ..subject };
        let surfaces = shown
            .ground
            .map(|ground| times.measure("surfaces", || subject.ground_among(ground, &view, &selection.nodes, &plan)));
        let surfaces = surfaces.transpose()?;
        if has_paths {
            // Everything is read before times are measured.
            self.gather_paths(shown)?;
        }
        for _ in 0..repeat {
            values = times.frame(|times| {
                let mut paths: Option<PathFragments> = None;
                if has_paths {
                    counts = Some(times.measure("paths", || self.gather_paths(shown))?);
                    times.measure("paths", || match takes_paths {
                        true => paths = self.paths.as_ref().map(PathLayer::fragments),
                        false => {
                            let colors = |layer: &PathLayer| Arc::new(layer.colors_behind(surfaces.as_ref()));
                            on_top = self.paths.as_ref().map(colors);
                        }
                    });
                }
                let among = among(paths, surfaces.as_ref());
                let selection = times.measure("select", || self.scene.select(&seen, detail));
                if let (None, Some(mut summing)) = (&among, subject.summing(&view, &plan)) {
                    summing.add(&selection.nodes)?;
                    let [decoding, drawing] = summing.took();
                    times.note("decode", decoding);
                    times.note("draw", drawing);
                    left_out.thinned = Some(selection.particles - summing.taken());
                    return Ok::<_, PictureError>(summing.finish());
                }
                let nodes = times.measure("decode", || subject.decode(&view, &selection.nodes, &plan));
                let drawn = || subject.draw_with_paths(&view, &nodes, &plan, among.as_deref());
                let drawn = match (times.measure("draw", drawn), &among) {
                    // What nobody sees of particles is a picture of the rest.
                    (Err(VolumeError::Grid(GridError::NothingInView)), Some(among)) if surfaces.is_some() => {
                        Raw::Light(LightPicture::of(among.colors()))
                    }
                    (drawn, _) => drawn?,
                };
                let kept: u64 = nodes.iter().map(|node| node.len() as u64).sum();
                left_out.thinned = Some(selection.particles - kept);
                Ok(drawn)
            })?;
            match &values {
                Raw::Sums(_, counts) => {
                    (left_out.faint, left_out.outside) = (Some(counts.faint), Some(counts.outside));
                    left_out.splats = Some(counts.drawn);
                }
                Raw::Light(painted) => {
                    times.note("resample", painted.report.resampling);
                    times.note("render", painted.report.rendering);
                }
            }
        }
        let moment = picture.moment.map(|moment| counts.map_or(moment, |counts| moment.with_paths(counts)));
        let level_report = self.flat_report(tree, shown, &selection, &values)?;
        let ground = surfaces.filter(|_| !mode.is_light()).map(|surfaces| Arc::new(surfaces.colors()));
        Ok((Picture { values, left_out, level_report, moment, paths: on_top, ground, ..picture }, selection.hidden))
    }

    /// The passes of an adapter that draw a picture: none where paths lie among what it shows.
    pub(super) fn passes_without_paths(&mut self, shown: &Shown<'_>) -> Result<Option<Passes>, PictureError> {
        let mode = shown.depiction.mode;
        let passes = self.passes(shown.depiction)?.filter(|_| shown.ground.is_none());
        if passes.is_some() && mode.technique.takes_paths() && self.has_paths(&shown.shot.look) {
            self.tell_once("volumes with paths are drawn by the processor");
            return Ok(None);
        }
        let sums = mode.technique.adapter() == Adapter::Splats;
        if passes.is_some() && self.scene.purpose == Purpose::Clusters && !sums {
            self.tell_once("clusters in this mode are drawn by the processor");
            return Ok(None);
        }
        Ok(passes)
    }

    /// How many of a picture's splats lie over each pixel, counted by what draws it.
    fn overdraw(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        nodes: &[SceneNode],
        plan: &Plan,
        job: Option<&AdapterJob<'_>>,
    ) -> Result<Overdraw, PictureError> {
        if let Some((job, adapter)) = job.zip(self.adapter.as_mut()) {
            match adapter.overdraw(job) {
                Err(VolumeError::Device(error)) => {
                    // An adapter that draws may still be one that does not count.
                    self.reporter.tell(format!("{error}; counting the overdraw with the CPU instead"));
                }
                counted => return Ok(counted?),
            }
        }
        Ok(subject.overdraw(view, &subject.decode(view, nodes, plan), plan)?)
    }
}
