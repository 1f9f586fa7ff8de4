//! The pages of one file that are in memory, within a budget: which to read next, which to forget, and what to do about
//! those that cannot be read.

use super::ahead::Ahead;
use super::recency::{Demand, Recency};
use crate::hierarchy::pca::Step;
use crate::store::{Encoding, Node, NodeRef, Page, PageId, StoreError, Tree};
use crate::view::{Extent, NodeInfo, NodeTree};
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Where a page stands.
#[derive(Clone, Debug)]
pub enum PageState {
    /// Somebody is reading it.
    Loading,
    /// In memory.
    Resident(Arc<Page>),
    /// It could not be read.
    Failed(Failure),
}

/// A page that could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Why; names the file and the page.
    pub why: String,
    /// Whether it is told: nothing helps, or several attempts have failed.
    pub given_up: bool,
    /// When to try again (the clock of [`Residency::begin_frame`]); `None`: never, since it is not the disk's fault.
    pub retry_at: Option<Duration>,
}

/// Attempts at a page before a disk's errors are told; the first ones follow one another after [`backoff`].
pub(crate) const ATTEMPTS: u32 = 4;
/// Reads without an answer at most; while there are so many, no more are begun.
pub(super) const MOST_STALLED: usize = 32;

/// How long to leave the disk alone after so many failed attempts at a page: 0.1 s, 0.4 s, 1.6 s, ... up to 30 s.
pub(crate) fn backoff(attempts: u32) -> Duration {
    Duration::from_millis(100 * 4_u64.pow(attempts.saturating_sub(1).min(8))).min(Duration::from_secs(30))
}

/// Counts for a status display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResidencyStatistics {
    /// Pages in the file.
    pub pages: u32,
    /// Pages in memory.
    pub resident: usize,
    /// Pages being read, and those whose turn to be read comes next.
    pub loading: usize,
    /// Reads that have not been answered for long.
    pub stalled: usize,
    /// Pages that the view misses and that are not being read yet.
    pub queued: usize,
    /// Pages that could not be read.
    pub failed: usize,
    /// Memory that resident pages take, bytes.
    pub bytes: u64,
    /// The most that they have taken so far, with what was being read and what is kept beside them, bytes.
    pub most_bytes: u64,
    /// How much they may take, bytes.
    pub budget_bytes: u64,
    /// Whether the last frame needed more than the budget.
    pub over_budget: bool,
}

/// A read under way.
#[derive(Clone, Copy, Debug)]
struct Load {
    bytes: u64,
    demand: Demand,
}

/// The pages of one tree that are in memory. A frame is: [`Residency::begin_frame`]; [`Residency::anticipate`] now and
/// then; selection through the [`NodeTree`] implementation; [`Residency::touch`] for what it visited and
/// [`Residency::request`] for what it missed; then [`Residency::next_to_load`] and [`Residency::loaded`] as reads begin
/// and end, at any time.
pub struct Residency {
    tree: Arc<dyn Tree>,
    states: HashMap<PageId, PageState>,
    recency: Recency,
    /// What the frame misses, and what later frames will.
    missed: VecDeque<PageId>,
    ahead: VecDeque<(PageId, f64)>,
    loading: HashMap<PageId, Load>,
    loading_bytes: u64,
    stalled: HashSet<PageId>,
    attempts: HashMap<PageId, u32>,
    told: HashSet<PageId>,
    to_tell: Vec<(PageId, String)>,
    evicted: Vec<(PageId, Option<Arc<Page>>)>,
    now: Duration,
    budget_bytes: u64,
    /// Whether that has room for all pages, once somebody has asked: of a run there are very many.
    has_room_for_all: OnceLock<bool>,
    /// Bytes of the budget that are not for pages.
    aside_bytes: u64,
    most_bytes: u64,
    over_budget: bool,
    /// Whether any frame needed more since somebody asked.
    was_over_budget: bool,
}

impl Residency {
    /// No page of `tree` is resident yet; resident pages may take `budget_bytes`. The roots are loaded even if the
    /// budget is smaller than they are, since nothing can be drawn without them.
    pub fn new(tree: Arc<dyn Tree>, budget_bytes: u64) -> Residency {
        Residency {
            tree,
            states: HashMap::new(),
            recency: Recency::new(),
            missed: VecDeque::new(),
            ahead: VecDeque::new(),
            loading: HashMap::new(),
            loading_bytes: 0,
            stalled: HashSet::new(),
            attempts: HashMap::new(),
            told: HashSet::new(),
            to_tell: Vec::new(),
            evicted: Vec::new(),
            now: Duration::ZERO,
            budget_bytes,
            has_room_for_all: OnceLock::new(),
            aside_bytes: 0,
            most_bytes: 0,
            over_budget: false,
            was_over_budget: false,
        }
    }

    /// Whether any frame needed more than the budget since this was asked last.
    pub fn take_over_budget(&mut self) -> bool {
        std::mem::take(&mut self.was_over_budget)
    }

    /// Resident pages may take so much from now on; those that the frame does not use make room for it.
    pub fn set_budget(&mut self, budget_bytes: u64) {
        if budget_bytes != self.budget_bytes {
            self.budget_bytes = budget_bytes;
            self.has_room_for_all = OnceLock::new();
            self.make_room(0, Demand::Miss);
        }
    }

    /// So many bytes of the budget are taken by something else from now on; pages that the frame does not use make room for it.
    pub fn set_aside(&mut self, bytes: u64) {
        self.aside_bytes = bytes;
        self.make_room(0, Demand::Miss);
        self.note_most();
    }

    /// Whether the budget has room for all pages of the tree at once.
    pub fn has_room_for_all(&self) -> bool {
        *self.has_room_for_all.get_or_init(|| self.budget_bytes == u64::MAX || self.all_take_at_most(self.budget_bytes))
    }

    /// Whether all pages of the tree take no more than so many bytes together.
    pub fn all_take_at_most(&self, bytes: u64) -> bool {
        let add = |sum: u64, page: u32| {
            let sum = sum.checked_add(self.tree.page_memory(PageId(page)))?;
            (sum <= bytes).then_some(sum)
        };
        (0..self.tree.page_count()).try_fold(0, add).is_some()
    }

    /// The tree.
    pub fn tree(&self) -> &Arc<dyn Tree> {
        &self.tree
    }

    /// A page, if it is in memory.
    pub fn page(&self, id: PageId) -> Option<&Arc<Page>> {
        match self.states.get(&id) {
            Some(PageState::Resident(page)) => Some(page),
            _ => None,
        }
    }

    /// Where a page stands; `None` if it is neither in memory nor on its way.
    pub fn state(&self, id: PageId) -> Option<&PageState> {
        self.states.get(&id)
    }

    /// A new frame begins, at a time since any fixed one: pages are free to be evicted until [`Residency::touch`] is
    /// called for them.
    pub fn begin_frame(&mut self, now: Duration) {
        self.now = self.now.max(now);
        self.recency.begin_frame();
        self.over_budget = false;
    }

    /// From now on all nodes of a resident page are hidden, from wherever the camera may soon be, or not all are. What is below them is
    /// not read, and they make room first unless a frame or the prefetching sphere uses them.
    pub fn hide(&mut self, page: PageId, is_hidden: bool) {
        self.recency.hide(page, is_hidden);
    }

    /// Whether all nodes of a page are known to be hidden.
    pub fn is_hidden(&self, page: PageId) -> bool {
        self.recency.is_hidden(page)
    }

    /// The current frame uses these nodes' pages.
    pub fn touch(&mut self, nodes: impl IntoIterator<Item = NodeRef>) {
        let mut last = None;
        for page in nodes.into_iter().map(|node| node.page) {
            // Selection walks page by page, so most repetitions are neighbours.
            if last.replace(page) != Some(page) {
                self.recency.touch(page);
            }
        }
    }

    /// Asks for these nodes' pages, the most missed first; what an earlier call asked for and nobody reads yet is
    /// forgotten.
    pub fn request(&mut self, nodes: impl IntoIterator<Item = NodeRef>) {
        self.missed.clear();
        let mut asked = HashSet::new();
        for page in nodes.into_iter().map(|node| node.page) {
            if self.may_load(page) && asked.insert(page) {
                self.missed.push_back(page);
            }
        }
    }

    /// What the prefetching sphere holds now. Its missing pages are read once nothing is missed, and go into memory
    /// that is free, that holds pages outside the sphere, or less urgent ones of it; never pages of the current frame.
    /// To be called before the frame's [`Residency::touch`].
    pub fn anticipate(&mut self, ahead: &Ahead) {
        self.recency.anticipate(&ahead.resident, 0.1 * ahead.distance_world);
        self.ahead = ahead.missing.iter().copied().filter(|(page, _)| self.may_load(*page)).collect();
    }

    /// The next page to read, marked as loading, unless `most` pages are already (`in_advance` for pages that nothing misses
    /// yet), nothing is asked for, or the budget is full of what is needed more. Makes room.
    pub fn next_to_load(&mut self, most: usize, in_advance: usize) -> Option<PageId> {
        if self.loading.len() >= most || self.stalled.len() >= MOST_STALLED {
            return None;
        }
        while let Some(&page) = self.missed.front() {
            if self.may_load(page) {
                let is_root = self.tree.is_root(page);
                if !self.make_room(self.tree.page_memory(page), Demand::Miss) && !is_root {
                    self.exceed();
                    return None;
                }
                self.missed.pop_front();
                return Some(self.begin(page, Demand::Miss));
            }
            self.missed.pop_front();
        }
        if self.loading.len() >= in_advance {
            return None;
        }
        while let Some((page, travel)) = self.ahead.pop_front() {
            if self.may_load(page) {
                let demand = Demand::Ahead(travel);
                if !self.make_room(self.tree.page_memory(page), demand) {
                    self.ahead.clear();
                    return None;
                }
                return Some(self.begin(page, demand));
            }
        }
        None
    }

    /// Whether a page is loading because a frame missed it.
    pub fn is_missed(&self, id: PageId) -> bool {
        self.loading.get(&id).is_some_and(|load| load.demand == Demand::Miss)
    }

    /// Nobody has begun to read `id`, which [`Residency::next_to_load`] asked for, and nobody will unless it is asked for again.
    pub fn withdraw(&mut self, id: PageId) {
        if let Some(load) = self.loading.remove(&id) {
            self.loading_bytes -= load.bytes;
            self.states.remove(&id);
        }
    }

    /// A read of `id` that [`Residency::next_to_load`] asked for has ended.
    pub fn loaded(&mut self, id: PageId, outcome: Result<Page, StoreError>) {
        self.stalled.remove(&id);
        let load = self.loading.remove(&id);
        self.loading_bytes -= load.map_or(0, |load| load.bytes);
        let demand = load.map_or(Demand::Miss, |load| load.demand);
        match outcome {
            Ok(page) => {
                self.attempts.remove(&id);
                self.told.remove(&id);
                let bytes = page.memory();
                let is_root = self.tree.is_root(id);
                // It may be larger than was expected.
                if !self.make_room(bytes, demand) && !is_root {
                    if demand == Demand::Miss {
                        self.exceed();
                    }
                    self.states.remove(&id);
                    self.evicted.push((id, Some(Arc::new(page))));
                    return;
                }
                self.recency.insert(id, bytes, demand);
                self.states.insert(id, PageState::Resident(Arc::new(page)));
                self.note_most();
            }
            Err(error) => {
                let attempts = self.attempts.entry(id).or_default();
                *attempts += 1;
                let failure = Failure {
                    why: error.to_string(),
                    given_up: !error.may_pass() || *attempts >= ATTEMPTS,
                    retry_at: error.may_pass().then(|| self.now + backoff(*attempts)),
                };
                if failure.given_up && self.told.insert(id) {
                    self.to_tell.push((id, failure.why.clone()));
                }
                self.states.insert(id, PageState::Failed(failure));
            }
        }
    }

    /// The read of a page that is loading gets no answer. It may still come; until then its place is free for others.
    pub fn stalled(&mut self, id: PageId) {
        if let Some(load) = self.loading.remove(&id) {
            self.loading_bytes -= load.bytes;
            self.stalled.insert(id);
        }
    }

    /// Pages evicted since the last call, for whoever holds copies of them. Those that were read but found no room are
    /// among them.
    pub fn take_evicted(&mut self) -> Vec<(PageId, Option<Arc<Page>>)> {
        std::mem::take(&mut self.evicted)
    }

    /// Pages given up since the last call, and why.
    pub fn take_failures(&mut self) -> Vec<(PageId, String)> {
        std::mem::take(&mut self.to_tell)
    }

    /// Why pages could not be read, those that are still being tried left out.
    pub fn failures(&self) -> impl Iterator<Item = (PageId, &str)> {
        self.states.iter().filter_map(|(&id, state)| match state {
            PageState::Failed(failure) if failure.given_up => Some((id, failure.why.as_str())),
            _ => None,
        })
    }

    /// When to try one of these pages again that has failed and is not given up.
    pub fn next_retry(&self, pages: impl IntoIterator<Item = PageId>) -> Option<Duration> {
        let retry = |page| match self.states.get(&page) {
            Some(PageState::Failed(failure)) if !failure.given_up => failure.retry_at,
            _ => None,
        };
        pages.into_iter().filter_map(retry).min()
    }

    /// Counts for a status display.
    pub fn statistics(&self) -> ResidencyStatistics {
        ResidencyStatistics {
            pages: self.tree.page_count(),
            resident: self.recency.len(),
            loading: self.loading.len(),
            stalled: self.stalled.len(),
            queued: self.missed.len(),
            failed: self.failures().count(),
            bytes: self.recency.bytes(),
            most_bytes: self.most_bytes,
            budget_bytes: self.budget_bytes,
            over_budget: self.over_budget,
        }
    }

    /// Whether a page is neither in memory nor on its way nor to be left alone.
    fn may_load(&self, page: PageId) -> bool {
        match self.states.get(&page) {
            None => true,
            Some(PageState::Failed(failure)) => failure.retry_at.is_some_and(|at| at <= self.now),
            Some(_) => false,
        }
    }

    fn begin(&mut self, page: PageId, demand: Demand) -> PageId {
        let bytes = self.tree.page_memory(page);
        self.states.insert(page, PageState::Loading);
        self.loading.insert(page, Load { bytes, demand });
        self.loading_bytes += bytes;
        self.note_most();
        page
    }

    fn exceed(&mut self) {
        (self.over_budget, self.was_over_budget) = (true, true);
    }

    /// Bytes of the budget that are in use.
    fn used_bytes(&self) -> u64 {
        self.recency.bytes() + self.loading_bytes + self.aside_bytes
    }

    fn note_most(&mut self) {
        self.most_bytes = self.most_bytes.max(self.used_bytes());
    }

    /// Evicts until there is room for so many bytes more; false where that needs pages that have to stay.
    fn make_room(&mut self, bytes: u64, demand: Demand) -> bool {
        while self.used_bytes().saturating_add(bytes) > self.budget_bytes {
            let Some(page) = self.recency.evict(demand) else { return false };
            let held = match self.states.remove(&page) {
                Some(PageState::Resident(held)) => Some(held),
                _ => None,
            };
            self.evicted.push((page, held));
        }
        true
    }
}

/// What selection needs to know of a node.
pub(super) fn info_of(node: &Node) -> NodeInfo {
    NodeInfo {
        extent: Extent { bounds: node.bounds, margin: f64::from(node.smoothing_length_max) },
        delta: node.delta,
        spacing: node.spacing,
        particles: u64::from(node.particles),
        source_particles: node.source_particles,
        mass: node.mass,
        is_leaf: node.children.is_empty(),
        stands_for_leaf: node.encoding == Encoding::LeafClusters,
        time: node.time,
    }
}

impl NodeTree for Residency {
    type Id = NodeRef;

    fn node(&self, id: NodeRef) -> Option<NodeInfo> {
        self.page(id.page)?.nodes.get(id.node as usize).map(info_of)
    }

    fn steps(&self, id: NodeRef) -> &[Step] {
        let content = self.page(id.page).and_then(|page| page.content(id.node as usize));
        content.map_or(&[], |content| content.steps())
    }

    fn children(&self, id: NodeRef) -> impl Iterator<Item = NodeRef> {
        self.page(id.page).map_or(&[][..], |page| page.children(id.node as usize)).iter().copied()
    }

    fn is_hidden(&self, id: NodeRef) -> bool {
        Residency::is_hidden(self, id.page)
    }
}
