//! Pictures of sums whose pages do not fit into memory together: what they draw is listed, then visited some pages at a time and added up in the
//! order of the list. On the processor they have the bits that they would have with all pages at once.

use super::clusters::{Attempt, Drawn};
use super::{Data, Session, Shown};
use crate::color::{Accumulation, output};
use crate::cpu::around::add;
use crate::cpu::overdraw::Overdraw;
use crate::cpu::volume::VolumeError;
use crate::explore::selection::Show;
use crate::hierarchy::Purpose;
use crate::look::LookPatch;
use crate::mode::{Adapter, Depiction, LodBudget, Output, Plan, Raw};
use crate::picture::account::{Account, Task};
use crate::picture::adapter::{AdapterFrame, AdapterJob, Passes, draw_on};
use crate::picture::left_out::LeftOut;
use crate::picture::level_report::{LevelReport, bound_of, misfit_in};
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, Subject};
use crate::store::{NodeRef, Tree};
use crate::stream::{Listing, SceneNode, Visited};
use crate::view::{self, View};
use std::time::{Duration, Instant};

/// A list that was drawn.
struct Passed {
    values: Raw,
    visited: Visited,
    /// Particles that were decoded; `None` where an adapter drew.
    taken: Option<u64>,
    /// See [`misfit_in`].
    misfit: f64,
    /// What an adapter said of its frames, times added up.
    frame: Option<AdapterFrame>,
    /// How long decoding took, and drawing.
    took: [Duration; 2],
}

impl Session {
    /// Whether views are listed, since the pages of all the data do not fit.
    pub(super) fn lists(&self) -> bool {
        self.account.is_some()
            && matches!(self.data, Data::Pages(_))
            && !self.scene.streamer.residency.has_room_for_all()
    }

    /// What a subject's picture of a view draws, where that is not held at once: of sums that the processor adds up, or else an adapter.
    pub(in crate::picture) fn listing(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        tau: f64,
        has_adapter: bool,
    ) -> Result<Option<Listing>, PictureError> {
        let depiction = subject.depiction;
        let is_sum = depiction.mode.technique.output() == Output::Sums;
        if !is_sum || !self.lists() || !(has_adapter || subject.summing(view, &Plan::default()).is_some()) {
            return Ok(None);
        }
        self.list(subject, view, tau).map(Some)
    }

    /// What a subject's picture of a view draws, whatever is held of it.
    pub(super) fn list(&mut self, subject: &Subject<'_>, view: &View, tau: f64) -> Result<Listing, PictureError> {
        let depiction = subject.depiction;
        let detail = depiction.detail(view, tau, self.tree().metadata());
        let reporter = &*self.reporter;
        let seen = depiction.selection_view(view);
        let listing = self.scene.list(&seen, detail, &mut |why| reporter.tell(why))?;
        self.note_memory(listing.converged);
        Ok(listing)
    }

    /// Tells that a listed picture has no selections, where it would have some.
    pub(super) fn tell_of_selections(&self, look: &LookPatch) {
        if shows_selections(look) {
            self.reporter
                .tell("selections are left out of a picture whose pages do not fit into memory together".into());
        }
    }

    /// What of a list may be left undrawn.
    pub(in crate::picture) fn plan_listed(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        lod_budget: &LodBudget,
        listing: &Listing,
    ) -> Result<Plan, PictureError> {
        let plan = Plan { culling: lod_budget.culling, ..Plan::default() };
        // Clusters were chosen as few as they may be.
        let estimate = subject.estimating(view, listing.particles, lod_budget).filter(|_| !listing.has_clusters);
        let Some(mut estimate) = estimate else { return Ok(plan) };
        self.visit(listing, &[], &mut |nodes| {
            estimate.add(nodes);
            Ok(())
        })?;
        Ok(estimate.plan(lod_budget, None)?)
    }

    /// The sums of a list, as the processor adds them up.
    pub(in crate::picture) fn sums_of_listed(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        listing: &Listing,
        plan: &Plan,
    ) -> Result<Accumulation, PictureError> {
        let passed = self.pass_on_processor(subject, view, (listing, &[]), plan)?;
        Ok(passed.values.sums(subject.depiction.mode)?.0)
    }

    /// Draws a list to see how it becomes.
    pub(super) fn attempt_listed(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        listing: &Listing,
        passes: Option<Passes>,
    ) -> Result<Attempt, PictureError> {
        let passed = self.pass(subject, view, (listing, &[]), &Plan::default(), passes)?;
        let (splats, has_clusters) = (listing.particles, listing.has_clusters);
        Ok(Attempt { splats, has_clusters, took: passed.took.iter().sum(), values: passed.values })
    }

    /// Draws a flat picture of a list.
    pub(super) fn draw_listed(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        (listing, listed_in): (&Listing, Duration),
    ) -> Result<Picture, PictureError> {
        let Shown { shot, view, depiction, .. } = *shown;
        let mut times = Times::default();
        let passes = self.passes_without_paths(shown)?;
        let subject = self.subject(tree, shown);
        let lod_budget = shot.look.budget.file_budget();
        let plan = times.measure("plan", || self.plan_listed(&subject, &view, &lod_budget, listing))?;
        let mut left_out = LeftOut::new(&lod_budget, &plan);
        if let Some(path) = self.options.overdraw.clone() {
            let overdraw = self.overdraw_listed(&subject, &view, listing, &plan)?;
            output::write_png(&path, &overdraw.image())?;
            left_out.overdraw = Some((overdraw.mean(), overdraw.max()));
        }
        self.tell_of_selections(&shot.look);
        let next = match self.ahead.take() {
            Some(ahead) => self.scene.known(&ahead, depiction.detail(&ahead, shot.look.error_px(), tree.metadata())),
            None => Vec::new(),
        };
        let loading = listed_in + self.loading.take().unwrap_or_default();
        let mut drawn = None;
        for _ in 0..self.options.repeat.max(1) {
            let passed = times.frame(|times| {
                let start = Instant::now();
                let passed = self.pass(&subject, &view, (listing, &next), &plan, passes)?;
                let [decoding, drawing] = passed.took;
                times.note("load", loading + start.elapsed().saturating_sub(decoding + drawing));
                times.note("decode", decoding);
                times.note("draw", drawing);
                Ok::<_, PictureError>(passed)
            })?;
            drawn = Some(passed);
        }
        let Some(Passed { values, visited, taken, misfit, frame, .. }) = drawn else {
            return Err(PictureError::Asked("nothing was drawn".into()));
        };
        left_out.thinned = taken.map(|taken| listing.particles.saturating_sub(taken));
        if let (Raw::Sums(_, counts), None) = (&values, &frame) {
            (left_out.faint, left_out.outside) = (Some(counts.faint), Some(counts.outside));
            left_out.splats = Some(counts.drawn);
        }
        let level_report = self.report_listed(tree, shown, listing, (&values, misfit))?;
        let blank = self.blank(shown, view)?;
        let picture = Picture {
            values,
            converged: listing.converged && visited.is_complete,
            error_px: visited.error_pixels,
            particles: listing.particles,
            moment: self.shown_moment(listing.particles),
            nodes: listing.nodes.len(),
            left_out,
            level_report,
            ..blank
        };
        let picture = match frame {
            Some(AdapterFrame { splats, backend, adapter, milliseconds, .. }) => {
                times.extend(milliseconds.into_iter().filter(|(pass, _)| pass != "frame"));
                let left_out = LeftOut { splats, ..picture.left_out };
                let level_report = picture.level_report.by_adapter();
                Picture { left_out, drawn_by: [backend.to_owned(), adapter], level_report, ..picture }
            }
            None => picture,
        };
        let picture = match self.has_paths(&shot.look) {
            true => self.with_paths(picture, shown, &mut times)?,
            false => picture,
        };
        Ok(Picture { milliseconds: times.medians(), ..picture })
    }

    /// What a flat picture of a list says of its levels.
    fn report_listed(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        listing: &Listing,
        (values, misfit): (&Raw, f64),
    ) -> Result<LevelReport, PictureError> {
        let drawn = Drawn { splats: listing.particles, has_clusters: listing.has_clusters, values };
        let attempt = &mut |session: &mut Session, depiction: &Depiction| session.attempt_flat(tree, shown, depiction);
        let report = self.level_report(shown.depiction, drawn, attempt)?;
        let (Raw::Sums(sums, _), Purpose::Clusters) = (values, self.scene.purpose) else { return Ok(report) };
        let total: f64 = sums.p.iter().map(|p| f64::from(*p)).sum();
        Ok(LevelReport { error_bound: bound_of(shown.depiction, misfit, total), ..report })
    }

    /// How many of a list's splats lie over each pixel, counted by the processor.
    fn overdraw_listed(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        listing: &Listing,
        plan: &Plan,
    ) -> Result<Overdraw, PictureError> {
        let mut all = subject.overdraw(view, &[], plan)?;
        self.visit(listing, &[], &mut |nodes| {
            let more = subject.overdraw(view, &subject.decode(view, nodes, plan), plan)?;
            all.counts.iter_mut().zip(more.counts).for_each(|(all, more)| *all += more);
            Ok(())
        })?;
        Ok(all)
    }

    /// Draws a list with what draws the mode; the nodes after it are read ahead at the end.
    fn pass(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        listed: (&Listing, &[view::Drawn<NodeRef>]),
        plan: &Plan,
        passes: Option<Passes>,
    ) -> Result<Passed, PictureError> {
        let Some(passes) = passes else { return self.pass_on_processor(subject, view, listed, plan) };
        match self.pass_on_adapter(subject, view, listed, plan, passes) {
            Err(PictureError::Volume(VolumeError::Device(error))) if self.options.backend.is_some() => {
                Err(PictureError::Asked(error))
            }
            Err(PictureError::Volume(VolumeError::Device(error))) => {
                self.reporter.tell(format!("{error}; drawing with the CPU instead"));
                self.pass_on_processor(subject, view, listed, plan)
            }
            drawn => drawn,
        }
    }

    fn pass_on_processor(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        (listing, next): (&Listing, &[view::Drawn<NodeRef>]),
        plan: &Plan,
    ) -> Result<Passed, PictureError> {
        let mode = subject.depiction.mode;
        let mut summing = subject.summing(view, plan).ok_or(VolumeError::OnlyAdapter(mode.name))?;
        let mut misfit = 0.0;
        let visited = self.visit(listing, next, &mut |nodes| {
            misfit += misfit_in(view, nodes);
            Ok(summing.add(nodes)?)
        })?;
        let (taken, took) = (Some(summing.taken()), summing.took());
        Ok(Passed { values: summing.finish(), visited, taken, misfit, frame: None, took })
    }

    /// Each part of a list is a picture of the adapter's, and these are added up.
    fn pass_on_adapter(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        (listing, next): (&Listing, &[view::Drawn<NodeRef>]),
        plan: &Plan,
        passes: Passes,
    ) -> Result<Passed, PictureError> {
        let &Subject { depiction, metadata, .. } = subject;
        // The adapter is elsewhere while it draws, so that the session can read.
        let mut adapter = self.adapter.take();
        let mut misfit = 0.0;
        let (mut sums, mut frame): (Option<Accumulation>, Option<AdapterFrame>) = (None, None);
        let mut part = |nodes: &[SceneNode]| -> Result<(), PictureError> {
            let missing = || VolumeError::Device("no adapter is open".into());
            let adapter = adapter.as_deref_mut().ok_or_else(missing)?;
            let job = AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 };
            let (values, more) = draw_on(adapter, subject, job)?;
            let (own, _) = values.sums(depiction.mode)?;
            match &mut sums {
                Some(sums) => add(sums, &own),
                None => sums = Some(own),
            }
            frame = Some(match frame.take() {
                Some(known) => joined(known, more),
                None => more,
            });
            misfit += misfit_in(view, nodes);
            Ok(())
        };
        let visited = match listing.nodes.is_empty() {
            true => part(&[]).map(|()| Visited { is_complete: true, error_pixels: 0.0 }),
            false => self.visit(listing, next, &mut part),
        };
        self.adapter = adapter;
        let visited = visited?;
        let milliseconds =
            frame.as_ref().and_then(|frame| frame.milliseconds.get("frame")).copied().unwrap_or_default();
        let took = [Duration::ZERO, Duration::from_secs_f64(1e-3 * milliseconds.max(0.0))];
        let values = Raw::Sums(sums.unwrap_or_default(), Default::default());
        Ok(Passed { values, visited, taken: None, misfit, frame, took })
    }

    /// Hands over a list's nodes, some at a time, and tells what there is to tell of their pages.
    fn visit(
        &mut self,
        listing: &Listing,
        next: &[view::Drawn<NodeRef>],
        each: &mut dyn FnMut(&[SceneNode]) -> Result<(), PictureError>,
    ) -> Result<Visited, PictureError> {
        let reporter = &*self.reporter;
        let mut go_on = |nodes: &[SceneNode]| match reporter.is_stopped() {
            true => Err(PictureError::Stopped),
            false => each(nodes),
        };
        let visited = self.scene.visit::<PictureError>(listing, next, &mut |why| reporter.tell(why), &mut go_on)?;
        self.note_memory(visited.is_complete);
        Ok(visited)
    }

    /// Notes whether a picture is coarser than asked for, or not complete, since that needs more memory than pages may take.
    pub(in crate::picture) fn note_memory(&mut self, is_complete: bool) {
        let is_over = self.scene.streamer.residency.take_over_budget();
        self.shortage.is_coarser |= self.scene.take_coarser();
        self.shortage.is_missing |= is_over && !is_complete;
    }

    /// Whether an adapter draws a flat picture by itself: nothing is decoded for it, as it is for fields of columns.
    pub(super) fn is_on_adapter(&mut self, depiction: &Depiction) -> bool {
        let is_of_splats = depiction.adapter() == Adapter::Splats;
        let may_be = !depiction.draws_fields() && (is_of_splats || self.scene.purpose != Purpose::Clusters);
        // What an adapter that was asked for does not draw, the picture says itself.
        may_be && matches!(self.passes(depiction), Ok(Some(_)))
    }

    /// Shares the memory out for a picture, where there is a limit; tells how much is taken where that is more.
    pub(in crate::picture) fn share_memory(&mut self, task: Task) {
        let Some(memory) = self.options.page_memory.filter(|_| self.account.is_some()) else { return };
        let account = Account::of(memory, task);
        (self.account, self.budget_bytes) = (Some(account), account.pages);
        let residency = &mut self.scene.streamer.residency;
        // What lies in memory as a whole has no limit.
        if residency.statistics().budget_bytes != u64::MAX {
            residency.set_budget(account.pages);
        }
        let taken = account.exceeding.filter(|_| !residency.has_room_for_all());
        let mebibytes = taken.map_or(0, |taken| taken.div_ceil(1 << 20));
        if mebibytes > self.told_mebibytes {
            self.told_mebibytes = mebibytes;
            self.reporter.tell(format!(
                "{}: a picture of this size takes {mebibytes} MiB, however few of the pages are held; --memory sets how much there is",
                self.path().display()
            ));
        }
    }

    /// Tells, once, that pictures are drawn without what they have no memory for.
    pub(in crate::picture) fn tell_of_memory(&mut self) {
        if !self.lacks_memory() || self.account.is_none() || std::mem::replace(&mut self.has_told_of_memory, true) {
            return;
        }
        let mebibytes = self.budget_bytes as f64 / f64::from(1 << 20);
        self.reporter.tell(format!(
            "{}: what is in view does not fit into the {mebibytes:.1} MiB that pages may take and is drawn coarser; --memory sets how much there is",
            self.path().display()
        ));
    }

    /// Bytes that pages may take, with what is drawn of them at a time; `None` where nothing limits them.
    pub fn page_memory(&self) -> Option<u64> {
        self.options.page_memory
    }

    /// Whether the picture that was drawn last lacks some that no coarser one would have, for want of memory.
    pub fn misses_for_memory(&self) -> bool {
        self.shortage.is_missing
    }

    /// Whether the picture that was drawn last, or what was found of a view since, needed more memory than pages may take.
    pub fn lacks_memory(&self) -> bool {
        self.shortage.is_coarser || self.shortage.is_missing
    }
}

/// Whether a look has selections that are drawn.
pub(super) fn shows_selections(look: &LookPatch) -> bool {
    look.selections.iter().flatten().any(|set| set.show != Show::Hidden)
}

/// Two frames of an adapter's as one.
fn joined(mut frame: AdapterFrame, more: AdapterFrame) -> AdapterFrame {
    frame.splats = frame.splats.zip(more.splats).map(|(own, more)| own + more);
    for (pass, milliseconds) in more.milliseconds {
        *frame.milliseconds.entry(pass).or_default() += milliseconds;
    }
    frame
}
