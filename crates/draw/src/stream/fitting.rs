//! Views that need more memory than there is: in what detail they are selected in place of the one that is asked for. It is the finest of a row of
//! fixed steps ([`Detail::coarser`]) that there is room for, and follows from the data, the view and the budget alone: not from what was in memory
//! before, nor from the order in which pages come. So a picture is as coarse in a tour as by itself.

use super::Scene;
use super::outline::{Held, Outline};
use crate::store::{NodeRef, PageId, StoreError};
use crate::view::{Detail, Selection, View, select_unhidden};
use std::collections::HashSet;
use std::sync::Arc;

/// One part in so many of the budget is for what is known of pages, where a view's pages are held at once.
const KNOWN_SHARE: u64 = 8;
/// The same where they are visited some at a time.
const LISTED_SHARE: u64 = 2;

/// Whether a selection from what is known of pages takes more than there is room for.
type Exceeds<'a> = dyn Fn(&Outline, &Selection<NodeRef>) -> bool + 'a;

impl Scene {
    /// Whether a view was selected in less detail than was asked for since this was asked last: what it needs does not fit into memory.
    pub fn take_coarser(&mut self) -> bool {
        std::mem::take(&mut self.is_coarser)
    }

    /// The finest detail up to this one whose pages fit into memory together.
    ///
    /// # Errors
    /// As [`Scene::list`].
    pub(super) fn held_detail(
        &mut self,
        view: &View,
        detail: Detail,
        tell: &mut dyn FnMut(String),
    ) -> Result<Detail, StoreError> {
        if self.streamer.residency.has_room_for_all() {
            // What lists have left known would take the room of pages.
            self.forget_beyond(0);
            return Ok(detail);
        }
        let (tree, most) = (Arc::clone(self.streamer.residency.tree()), self.most(Held::Pages));
        self.forget_beyond(self.budget() / KNOWN_SHARE);
        let is_final = is_final(detail);
        // What is expected of pages that are not known yet says whether it is worth to look at them, and not how coarse the view becomes.
        let is_expected_to = |outline: &Outline, selection: &Selection<NodeRef>| {
            let missing: HashSet<PageId> = selection.missing.iter().map(|missing| missing.id.page).collect();
            let expected: u64 = missing.into_iter().map(|page| tree.page_memory(page)).sum();
            is_final(selection) && outline.bytes_of(Held::Pages, &selection.visited).saturating_add(expected) > most
        };
        let detail = match self.fits(view, detail, &is_expected_to, tell)? {
            true => detail,
            false => self.fitted(view, detail, Held::Pages, tell)?,
        };
        self.forget_beyond(self.budget() / KNOWN_SHARE);
        Ok(detail)
    }

    /// The finest of the steps up to this detail for which there is room, the coarsest where there is for none.
    ///
    /// # Errors
    /// As [`Scene::list`].
    pub(super) fn fitted(
        &mut self,
        view: &View,
        detail: Detail,
        held: Held,
        tell: &mut dyn FnMut(String),
    ) -> Result<Detail, StoreError> {
        let (most, is_final) = (self.most(held), is_final(detail));
        let exceeds = |outline: &Outline, selection: &Selection<NodeRef>| {
            is_final(selection) && outline.bytes_of(held, &selection.visited) > most
        };
        if held == Held::Outlines {
            // What is known of other views would leave less room for this one.
            self.forget_beyond(0);
        }
        // From the coarsest on, so that no more is looked at than has room, and what the next step adds.
        let mut steps = Detail::COARSEST;
        while steps > 0 && self.fits(view, detail.coarser(view, steps - 1), &exceeds, tell)? {
            steps -= 1;
        }
        if held == Held::Outlines {
            self.forget_beyond(most);
        }
        Ok(detail.coarser(view, steps))
    }

    /// Whether what is known of pages leaves too little room for what a list's nodes are drawn from, or for more that this one needs.
    pub(super) fn is_full(&self, selection: &Selection<NodeRef>) -> bool {
        self.is_stopped(selection) || self.outline.bytes() > self.most(Held::Outlines)
    }

    fn fits(
        &mut self,
        view: &View,
        detail: Detail,
        exceeds: &Exceeds<'_>,
        tell: &mut dyn FnMut(String),
    ) -> Result<bool, StoreError> {
        let (selection, is_exceeded) = self.outlined(view, detail, exceeds, tell)?;
        // What is damaged is missing in any detail.
        Ok(!is_exceeded && !self.is_stopped(&selection))
    }

    /// Whether there is no room for what a selection lacks.
    fn is_stopped(&self, selection: &Selection<NodeRef>) -> bool {
        !selection.is_converged() && self.streamer.residency.statistics().over_budget
    }

    /// Selects what a view draws in this detail by what is known of pages, and looks at those that it lacks, waiting for the disk, until there are
    /// none, no more can be had, or the selection exceeds what there is room for: whether it does. What is known counts in the budget
    /// ([`Scene::look_at`]), so that no more of it is looked at than leaves room for a next page, whatever detail is asked for.
    ///
    /// # Errors
    /// As [`Scene::list`].
    pub(super) fn outlined(
        &mut self,
        view: &View,
        detail: Detail,
        exceeds: &Exceeds<'_>,
        tell: &mut dyn FnMut(String),
    ) -> Result<(Selection<NodeRef>, bool), StoreError> {
        let (roots, occluder) = (self.roots(view), self.streamer.occluder.clone());
        loop {
            let selection = select_unhidden(view, detail, occluder.as_deref(), &self.outline, &roots);
            if exceeds(&self.outline, &selection) {
                return Ok((selection, true));
            }
            let known = self.outline.len();
            let wanted: Vec<NodeRef> = selection.missing.iter().map(|missing| missing.id).collect();
            self.look_at(wanted.iter().map(|node| node.page));
            if self.outline.len() > known {
                continue;
            }
            self.streamer.read_ahead([]);
            self.streamer.begin();
            self.streamer.hold(wanted);
            self.make_room();
            if !self.streamer.is_busy() {
                if self.has_roots(&roots, |scene, page| scene.outline.has(page))? {
                    return Ok((selection, false));
                }
                continue;
            }
            // Everything that was asked for is looked at before the view is selected again.
            while self.streamer.is_busy() && !self.streamer.is_retry_due() {
                let (arrived, of_roots) = self.wait(tell);
                // Those that are known are no error.
                let of_known = of_roots.into_iter().filter(|(page, _)| self.outline.has(*page));
                of_known.for_each(|(_, message)| tell(message));
                self.look_at(arrived);
                self.make_room();
            }
        }
    }

    fn budget(&self) -> u64 {
        self.streamer.residency.statistics().budget_bytes
    }

    /// Memory that a view may take, bytes.
    fn most(&self, held: Held) -> u64 {
        let budget = self.budget();
        match held {
            Held::Pages => budget - budget / KNOWN_SHARE,
            Held::Outlines => budget / LISTED_SHARE,
        }
    }

    /// Forgets what is known of pages where that is more than so many bytes.
    fn forget_beyond(&mut self, most: u64) {
        if self.outline.bytes() > most {
            self.outline = Outline::default();
            self.streamer.residency.set_aside(0);
        }
    }
}

/// Whether a selection can only grow as more pages become known: one within a number of splats may come to other nodes as long as it lacks any.
fn is_final(detail: Detail) -> impl Fn(&Selection<NodeRef>) -> bool {
    move |selection: &Selection<NodeRef>| !matches!(detail, Detail::Budget { .. }) || selection.is_converged()
}
