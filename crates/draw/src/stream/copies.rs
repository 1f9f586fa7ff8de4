//! Which pages a renderer has copies of (in GPU memory), within a budget of their own: the least recently used copies
//! make room, and only so much is copied in a frame.

use super::ahead::Ahead;
use super::recency::{Demand, Recency};
use crate::store::{Page, PageId};
use std::collections::HashMap;

/// How copies are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CopyOptions {
    /// Memory that copies may take, bytes.
    pub budget: u64,
    /// Bytes that may be on their way at a time: what some frames copy.
    pub on_their_way: u64,
}

/// What the renderer is to do: removals first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CopyPlan {
    /// Pages whose copies go, each with its number of nodes.
    pub remove: Vec<(PageId, u32)>,
    /// Pages to copy, the most missed first.
    pub insert: Vec<PageId>,
}

/// Frames after which a copy that found no room is tried again.
const REJECTED_FRAMES: u64 = 60;

/// Bytes that a particle takes in a copy which has it on its way through an interval.
pub const MOVING_BYTES: u64 = 96;

/// Bytes that a cluster takes in a copy.
pub const CLUSTER_BYTES: u64 = 64;

/// Bytes that a copy of a node of so many clusters takes at most: with what these become where splits are undone.
pub fn cluster_bytes(clusters: u32) -> u64 {
    2 * u64::from(clusters) * CLUSTER_BYTES
}

/// Bytes that a copy of a page takes.
pub fn copy_bytes(page: &Page) -> u64 {
    let node = |index: usize| {
        let particles = page.nodes[index].particles;
        match page.content(index) {
            Some(content) if content.moves() => return u64::from(particles) * MOVING_BYTES,
            Some(content) if !content.steps().is_empty() => return cluster_bytes(particles),
            _ => {}
        }
        let particles = page.particles(index);
        (size_of_val(particles.words()) + size_of_val(particles.codes).next_multiple_of(4)) as u64
    };
    (0..page.nodes.len()).map(node).sum()
}

#[derive(Clone, Copy, Debug)]
struct Copied {
    bytes: u64,
    nodes: u32,
    is_there: bool,
}

/// The copies of a file's pages.
#[derive(Debug)]
pub struct Copies {
    options: CopyOptions,
    copies: HashMap<PageId, Copied>,
    recency: Recency,
    on_their_way: u64,
    rejected: HashMap<PageId, u64>,
    to_remove: Vec<(PageId, u32)>,
    frame: u64,
    copied_bytes: u64,
    is_full: bool,
}

impl Copies {
    /// No copies yet.
    pub fn new(options: CopyOptions) -> Copies {
        Copies {
            options,
            copies: HashMap::new(),
            recency: Recency::new(),
            on_their_way: 0,
            rejected: HashMap::new(),
            to_remove: Vec::new(),
            frame: 0,
            copied_bytes: 0,
            is_full: false,
        }
    }

    /// How copies are kept.
    pub fn options(&self) -> &CopyOptions {
        &self.options
    }

    /// Whether there is a copy of a page, complete.
    pub fn has(&self, page: PageId) -> bool {
        self.copies.get(&page).is_some_and(|copied| copied.is_there)
    }

    /// Bytes of all copies, those on their way included.
    pub fn bytes(&self) -> u64 {
        self.recency.bytes()
    }

    /// Whether the present frame misses a page for which there is no room.
    pub fn is_full(&self) -> bool {
        self.is_full
    }

    /// Whether a page has no copy, and there may be room for one.
    pub(super) fn can_take(&self, page: PageId) -> bool {
        !self.is_full && !self.copies.contains_key(&page) && !self.rejected.contains_key(&page)
    }

    /// The pages whose copies are on their way.
    pub fn on_their_way(&self) -> impl Iterator<Item = PageId> {
        self.copies.iter().filter(|(_, copied)| !copied.is_there).map(|(page, _)| *page)
    }

    /// A new frame begins and uses no copy yet.
    pub(super) fn begin_frame(&mut self) {
        self.frame += 1;
        self.is_full = false;
        self.recency.begin_frame();
    }

    /// As [`super::Residency::anticipate`].
    pub(super) fn anticipate(&mut self, ahead: &Ahead) {
        self.recency.anticipate(&ahead.resident, 0.1 * ahead.distance_world);
    }

    /// As [`super::Residency::hide`].
    pub(super) fn hide(&mut self, page: PageId, is_hidden: bool) {
        self.recency.hide(page, is_hidden);
    }

    /// The present frame uses the copies of these pages.
    pub(super) fn touch(&mut self, pages: impl IntoIterator<Item = PageId>) {
        let mut last = None;
        for page in pages {
            if last.replace(page) != Some(page) {
                self.recency.touch(page);
            }
        }
    }

    /// What to copy and what to remove now. `missed`: pages in memory that the frame lacks copies of, the most missed
    /// first; `ahead`: those that later frames will, the least urgent first; `page`: a page in memory.
    pub(super) fn plan<'a>(
        &mut self,
        missed: &[PageId],
        ahead: &[(PageId, f64)],
        page: impl Fn(PageId) -> Option<&'a Page>,
    ) -> CopyPlan {
        let mut insert = Vec::new();
        let missed = missed.iter().map(|&page| (page, Demand::Miss));
        let ahead = ahead.iter().rev().map(|&(page, travel)| (page, Demand::Ahead(travel)));
        for (id, demand) in missed.chain(ahead) {
            if self.on_their_way >= self.options.on_their_way {
                break;
            }
            let waits = self.rejected.get(&id).is_some_and(|&until| until > self.frame);
            if self.copies.contains_key(&id) || waits {
                self.is_full |= waits && demand == Demand::Miss;
                continue;
            }
            let Some(page) = page(id) else { continue };
            let copied = Copied { bytes: copy_bytes(page), nodes: page.nodes.len() as u32, is_there: false };
            if !self.make_room(copied.bytes, demand) {
                self.is_full |= demand == Demand::Miss;
                break;
            }
            self.rejected.remove(&id);
            self.copies.insert(id, copied);
            self.recency.insert(id, copied.bytes, demand);
            self.on_their_way += copied.bytes;
            insert.push(id);
        }
        CopyPlan { remove: std::mem::take(&mut self.to_remove), insert }
    }

    /// A copy is complete.
    pub fn arrived(&mut self, page: PageId) {
        if let Some(copied) = self.copies.get_mut(&page)
            && !std::mem::replace(&mut copied.is_there, true)
        {
            self.on_their_way = self.on_their_way.saturating_sub(copied.bytes);
            self.copied_bytes += copied.bytes;
        }
    }

    /// Bytes of all copies that were ever completed.
    pub fn copied_bytes(&self) -> u64 {
        self.copied_bytes
    }

    /// The renderer found no room for a copy, though the budget has some (it lies in pieces): what there is of it goes,
    /// another one makes room, and it is tried again later.
    pub fn rejected(&mut self, page: PageId) {
        self.remove(page);
        self.rejected.insert(page, self.frame + REJECTED_FRAMES);
        if let Some(other) = self.recency.evict(Demand::Miss) {
            self.forget(other);
        }
    }

    /// A page is gone from memory, and its copy goes with it.
    pub(super) fn remove(&mut self, page: PageId) {
        self.recency.remove(page);
        self.forget(page);
    }

    fn forget(&mut self, page: PageId) {
        let Some(copied) = self.copies.remove(&page) else { return };
        if !copied.is_there {
            self.on_their_way = self.on_their_way.saturating_sub(copied.bytes);
        }
        self.to_remove.push((page, copied.nodes));
    }

    fn make_room(&mut self, bytes: u64, demand: Demand) -> bool {
        while self.recency.bytes() + bytes > self.options.budget {
            let Some(page) = self.recency.evict(demand) else { return false };
            self.forget(page);
        }
        true
    }
}
