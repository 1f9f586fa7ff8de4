//! The pages of one file that are in memory, within a budget: least recently used pages go first, pages of the
//! current frame never.

use crate::store::{NodeRef, Page, PageFile, PageId, StoreError};
use crate::view::{Extent, NodeInfo, NodeTree};
use lru::LruCache;
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

/// Where a page stands.
#[derive(Clone, Debug)]
pub enum PageState {
    /// Somebody is reading it.
    Loading,
    /// In memory.
    Resident(Arc<Page>),
    /// It could not be read; the text says why. It is not tried again.
    Failed(String),
}

/// Counts for a status display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResidencyStatistics {
    /// Pages in the file.
    pub pages: u32,
    /// Pages in memory.
    pub resident: usize,
    /// Pages being read.
    pub loading: usize,
    /// Pages asked for, not being read yet.
    pub queued: usize,
    /// Pages that could not be read.
    pub failed: usize,
    /// Memory that resident pages take, bytes.
    pub bytes: u64,
    /// How much they may take, bytes.
    pub budget: u64,
    /// Whether the last frame needed more than the budget.
    pub over_budget: bool,
}

/// The pages of one file that are in memory. A frame is: [`Residency::begin_frame`], selection through the
/// [`NodeTree`] implementation, [`Residency::touch`] for what it visited, [`Residency::request`] for what it missed;
/// then [`Residency::next_to_load`] and [`Residency::loaded`] as reads begin and end, at any time.
pub struct Residency {
    file: Arc<PageFile>,
    states: HashMap<PageId, PageState>,
    /// Resident pages with the frame of their last use, the least recently used last.
    recency: LruCache<PageId, u64>,
    queue: VecDeque<PageId>,
    evicted: Vec<PageId>,
    frame: u64,
    budget: u64,
    resident_bytes: u64,
    loading: usize,
    loading_bytes: u64,
    over_budget: bool,
}

impl Residency {
    /// No page of `file` is resident yet; resident pages may take `budget` bytes. The roots are loaded even if the
    /// budget is smaller than they are, since nothing can be drawn without them.
    pub fn new(file: Arc<PageFile>, budget: u64) -> Residency {
        Residency {
            file,
            states: HashMap::new(),
            recency: LruCache::unbounded(),
            queue: VecDeque::new(),
            evicted: Vec::new(),
            frame: 0,
            budget,
            resident_bytes: 0,
            loading: 0,
            loading_bytes: 0,
            over_budget: false,
        }
    }

    /// The file.
    pub fn file(&self) -> &Arc<PageFile> {
        &self.file
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

    /// A new frame begins: pages are free to be evicted until [`Residency::touch`] is called for them.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        self.over_budget = false;
    }

    /// The current frame uses these nodes' pages.
    pub fn touch(&mut self, nodes: impl IntoIterator<Item = NodeRef>) {
        let mut last = None;
        for page in nodes.into_iter().map(|node| node.page) {
            // Selection walks page by page, so most repetitions are neighbours.
            if last.replace(page) != Some(page)
                && let Some(frame) = self.recency.get_mut(&page)
            {
                *frame = self.frame;
            }
        }
    }

    /// Asks for these nodes' pages, the most urgent first; what an earlier call asked for and nobody reads yet is
    /// forgotten.
    pub fn request(&mut self, nodes: impl IntoIterator<Item = NodeRef>) {
        self.queue.clear();
        let mut asked = std::collections::HashSet::new();
        for page in nodes.into_iter().map(|node| node.page) {
            if !self.states.contains_key(&page) && asked.insert(page) {
                self.queue.push_back(page);
            }
        }
    }

    /// The next page to read, marked as loading, unless `in_flight` pages are being read already, nothing is asked
    /// for, or the pages of this frame fill the budget. Makes room by evicting pages that this frame does not use.
    pub fn next_to_load(&mut self, in_flight: usize) -> Option<PageId> {
        if self.loading >= in_flight {
            return None;
        }
        let page = *self.queue.front()?;
        let bytes = self.file.page_memory(page);
        let is_root = self.file.metadata().families.iter().any(|family| family.root_page == page);
        while self.resident_bytes + self.loading_bytes + bytes > self.budget && self.evict_one() {}
        if self.resident_bytes + self.loading_bytes + bytes > self.budget && !is_root {
            self.over_budget = true;
            return None;
        }
        self.queue.pop_front();
        self.states.insert(page, PageState::Loading);
        self.loading += 1;
        self.loading_bytes += bytes;
        Some(page)
    }

    /// A read of `id` that [`Residency::next_to_load`] asked for has ended.
    pub fn loaded(&mut self, id: PageId, outcome: Result<Page, StoreError>) {
        self.loading = self.loading.saturating_sub(1);
        self.loading_bytes = self.loading_bytes.saturating_sub(self.file.page_memory(id));
        match outcome {
            Ok(page) => {
                self.resident_bytes += page.memory();
                self.recency.put(id, self.frame);
                self.states.insert(id, PageState::Resident(Arc::new(page)));
            }
            Err(error) => {
                self.states.insert(id, PageState::Failed(error.to_string()));
            }
        }
    }

    /// Pages evicted since the last call, for whoever holds copies of them.
    pub fn take_evicted(&mut self) -> Vec<PageId> {
        std::mem::take(&mut self.evicted)
    }

    /// Why pages could not be read.
    pub fn failures(&self) -> impl Iterator<Item = (PageId, &str)> {
        self.states.iter().filter_map(|(&id, state)| match state {
            PageState::Failed(why) => Some((id, why.as_str())),
            _ => None,
        })
    }

    /// Counts for a status display.
    pub fn statistics(&self) -> ResidencyStatistics {
        ResidencyStatistics {
            pages: self.file.page_count(),
            resident: self.recency.len(),
            loading: self.loading,
            queued: self.queue.len(),
            failed: self.failures().count(),
            bytes: self.resident_bytes,
            budget: self.budget,
            over_budget: self.over_budget,
        }
    }

    /// Forgets the least recently used page that this frame does not use; false if there is none.
    fn evict_one(&mut self) -> bool {
        match self.recency.peek_lru() {
            Some((&id, &frame)) if frame < self.frame => {
                self.recency.pop(&id);
                if let Some(PageState::Resident(page)) = self.states.remove(&id) {
                    self.resident_bytes = self.resident_bytes.saturating_sub(page.memory());
                }
                self.evicted.push(id);
                true
            }
            _ => false,
        }
    }
}

impl NodeTree for Residency {
    type Id = NodeRef;

    fn node(&self, id: NodeRef) -> Option<NodeInfo<NodeRef>> {
        let node = self.page(id.page)?.nodes.get(id.node as usize)?;
        Some(NodeInfo {
            extent: Extent { bounds: node.bounds, margin: f64::from(node.smoothing_length_max) },
            delta: node.delta,
            particles: u64::from(node.particles),
            children: node.children,
        })
    }
}
