//! Volumes whose pages do not fit into memory together: what they draw is listed, and their grid filled with it slab by slab, from front to
//! back. They have the bits that they would have with all pages at once.

use super::clusters::Drawn;
use super::passes::shows_selections;
use super::{Data, Session, Shown};
use crate::color::transfer::Levels;
use crate::cpu::volume::Supply;
use crate::mode::{Depiction, Plan, Raw, SettingValue};
use crate::modes::grid::SLAB_MEMORY;
use crate::picture::left_out::LeftOut;
use crate::picture::supplied::Supplied;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, Subject};
use crate::store::Tree;
use crate::stream::{Listing, Visited};
use crate::view::View;
use std::time::Instant;

/// A list that was drawn.
struct Filled {
    values: Raw,
    visited: Visited,
    /// Particles that the view does not leave out.
    particles: u64,
}

impl Session {
    /// A depiction whose slabs take no more than their share of the memory, whatever pages take: they are thinner, and show the same.
    pub(super) fn within_slabs(&self, mut depiction: Depiction) -> Depiction {
        let usual = depiction.settings.number(&SLAB_MEMORY);
        let has_slabs = depiction.mode.all_settings().any(|setting| setting.name == SLAB_MEMORY.name);
        let most = self.account.filter(|_| has_slabs).map(|account| account.slab as f64 / f64::from(1 << 20));
        if let Some(most) = most.filter(|most| *most < usual) {
            depiction.settings.0.insert(SLAB_MEMORY.name.to_owned(), SettingValue::Number(most));
        }
        depiction
    }

    /// Whether a flat picture is drawn in slabs where views are listed. The processor draws it then, also where an adapter was asked for: that would
    /// need all nodes at once, and draws the same picture of them but for rounding.
    pub(super) fn fills_slabs(&mut self, subject: &Subject<'_>, shown: &Shown<'_>) -> Result<bool, PictureError> {
        let takes_paths = shown.depiction.mode.technique.takes_paths();
        if !subject.takes_supply() || takes_paths && self.has_paths(&shown.shot.look) {
            return Ok(false);
        }
        if self.passes_without_paths(shown)?.is_some() {
            self.tell_once("volumes whose pages do not fit into memory together are drawn by the processor");
        }
        Ok(true)
    }

    /// Whether a flat volume is drawn in slabs though its pages fit, since there is no room for all of their particles beside, and neither an adapter
    /// draws nor selections, which would be left out.
    pub(super) fn spares_particles(&mut self, subject: &Subject<'_>, shown: &Shown<'_>) -> Result<bool, PictureError> {
        let may_be = subject.takes_supply() && !self.holds_all_at_once() && !shows_selections(&shown.shot.look);
        Ok(may_be && self.passes_without_paths(shown)?.is_none() && self.fills_slabs(subject, shown)?)
    }

    /// Whether there is room for all particles of the data's pages at once.
    fn holds_all_at_once(&self) -> bool {
        let account = self.account.filter(|_| matches!(self.data, Data::Pages(_)));
        account.is_none_or(|account| self.scene.streamer.residency.all_take_at_most(account.at_once))
    }

    /// Draws a flat picture in slabs.
    pub(super) fn draw_in_slabs(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Picture, PictureError> {
        let Shown { shot, view, depiction, .. } = *shown;
        let start = Instant::now();
        let subject = self.subject(tree, shown);
        let listing = self.list(&subject, &view, shot.look.error_px())?;
        self.tell_of_selections(&shot.look);
        // There is no room for pages of the next picture beside those of this one's slabs.
        self.ahead = None;
        let mut times = Times::default();
        times.note("load", start.elapsed() + self.loading.take().unwrap_or_default());
        let blank = self.blank(shown, view)?;
        let mut filled = times.frame(|times| self.fill(&subject, &view, &listing, times))?;
        for _ in 1..self.options.repeat.max(1) {
            filled = times.frame(|times| self.fill(&subject, &view, &listing, times))?;
        }
        let Filled { values, visited, particles } = filled;
        let left_out = LeftOut::new(&shot.look.budget.file_budget(), &Plan::default());
        let drawn = Drawn { splats: listing.particles, has_clusters: listing.has_clusters, values: &values };
        let level_report = self.plain_report(depiction, drawn);
        Ok(Picture {
            values,
            converged: listing.converged && visited.is_complete,
            error_px: visited.error_pixels,
            particles: listing.particles,
            moment: self.shown_moment(listing.particles),
            nodes: listing.nodes.len(),
            left_out: LeftOut { thinned: Some(listing.particles.saturating_sub(particles)), ..left_out },
            level_report,
            milliseconds: times.medians(),
            ..blank
        })
    }

    /// The ranges of a volume's colours where not all of it is decoded at once; `None` of what is not drawn in slabs.
    pub(in crate::picture) fn levels_in_slabs(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        tau: f64,
    ) -> Result<Option<Levels>, PictureError> {
        if !subject.takes_supply() || self.holds_all_at_once() {
            return Ok(None);
        }
        let listing = self.list(subject, view, tau)?;
        let mut supplied = self.supplied(subject, view, &listing)?;
        let levels = subject.supplied_levels(view, &mut supplied);
        // Where it has ended early, ranges are of a part.
        let visited = supplied.finish()?;
        self.note_memory(visited.is_complete);
        Ok(levels?)
    }

    fn fill(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        listing: &Listing,
        times: &mut Times,
    ) -> Result<Filled, PictureError> {
        let mut supplied = self.supplied(subject, view, listing)?;
        let particles = supplied.particles();
        let drawn = subject.draw_supplied(view, &mut supplied);
        // Where it has ended early, there is a part of a picture.
        let visited = supplied.finish()?;
        self.note_memory(visited.is_complete);
        let values = drawn?;
        if let Raw::Light(light) = &values {
            times.note("resample", light.report.resampling);
            times.note("render", light.report.rendering);
        }
        Ok(Filled { values, visited, particles })
    }

    /// The particles of a list, for whoever asks for parts of them.
    fn supplied<'a>(
        &'a mut self,
        subject: &Subject<'a>,
        view: &View,
        listing: &Listing,
    ) -> Result<Supplied<'a>, PictureError> {
        let slab_bytes = self.account.map_or(u64::MAX, |account| account.slab);
        Supplied::new(*subject, view, (&mut self.scene, &*self.reporter), listing, slab_bytes)
    }
}
