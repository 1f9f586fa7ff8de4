//! A file's pages as a view needs them: selection, prefetching, reading and forgetting, a frame at a time. The window,
//! `bench flight` and whoever draws single pictures all stream through this.
//!
//! A frame is: [`Streamer::arrive`] takes in what has been read; [`Streamer::select`] chooses what to draw from what
//! is there and notes what is missing; [`Streamer::serve`] begins to read that; [`Streamer::take_evicted`] and
//! [`Streamer::plan_copies`] tell what goes and what the renderer has to copy. None of them waits for a disk, and pages
//! are decoded and given back on other threads.

use super::ahead::{Ahead, LookAhead, ahead};
use super::copies::{Copies, CopyOptions, CopyPlan};
use super::loader::Loader;
use super::pace::Pace;
use super::patience::stall_of;
use super::report::Report;
use super::{PageState, Residency};
use crate::hierarchy::Purpose;
use crate::hierarchy::pca::Step;
use crate::store::{NodeRef, Page, PageId, Tree, take_notes};
use crate::view::{Detail, NodeInfo, NodeTree, Occluder, Selection, View, select_unhidden};
use std::collections::HashSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How a file is streamed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamOptions {
    /// Memory that pages may take, bytes.
    pub budget: u64,
    /// Pages that are read at a time.
    pub in_flight: usize,
    /// Time without an answer after which a read counts as stalled.
    pub stall: Duration,
    /// Whether pages are read before they are needed.
    pub prefetch: bool,
    /// How far ahead.
    pub ahead: LookAhead,
}

impl Default for StreamOptions {
    fn default() -> StreamOptions {
        let stall = Duration::from_secs(5);
        StreamOptions { budget: 2 << 30, in_flight: 8, stall, prefetch: true, ahead: LookAhead::default() }
    }
}

/// Time between two walks through the prefetching sphere at least.
const WALK: Duration = Duration::from_millis(50);
/// Reads at a time at most where what pages are read from says how many serve best.
const MOST_READS: usize = 64;
/// Pages that wait there for their turn, where fewer are read at a time; else as many as are read. With fewer, a link idles in long frames.
const WAITING: usize = 4;

/// What [`Streamer::arrive`] has found.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// Pages whose reads have ended, well or badly.
    pub pages: Vec<PageId>,
    /// Bytes that were read from the disk.
    pub bytes: u64,
    /// What is to be told, a sentence each.
    pub messages: Vec<String>,
}

/// What [`Streamer::serve`] has changed.
#[derive(Clone, Debug, Default)]
pub struct Served {
    /// Pages that are on their way from now on.
    pub started: Vec<PageId>,
    /// Pages that were, and are not any more: nobody had begun to read them.
    pub withdrawn: Vec<PageId>,
}

/// The pages of one file, streamed.
pub struct Streamer {
    /// Which pages are in memory.
    pub residency: Residency,
    /// Which of them a renderer has copies of; `None`: it draws from main memory, and every resident page counts.
    pub copies: Option<Copies>,
    /// What hides nodes from the view that is selected for: nothing below them is read.
    pub occluder: Option<Arc<dyn Occluder>>,
    /// Views that are known to come, as of a tour or of time that goes on, and the roots below which each looks, the next one first: what
    /// they need is read ahead of time too, of each once all is there that those before it need.
    pub upcoming: Vec<(View, Vec<NodeRef>)>,
    /// In what detail, and below which roots, pages are read ahead of time, where that is not what frames select for.
    pub goal: Option<(Detail, Vec<NodeRef>)>,
    loader: Loader,
    options: StreamOptions,
    pace: Pace,
    report: Report,
    start: Instant,
    /// When the prefetching sphere was walked through last, and what was found.
    walked: Option<Duration>,
    ahead: Ahead,
    /// How many pages the last selection looked at.
    visited: usize,
    /// The pages that the last selection lacked.
    missing: Vec<PageId>,
    /// The pages in memory of which it lacked copies, the most missed first.
    uncopied: Vec<PageId>,
    /// Pages that others still hold on to.
    discarded: Vec<Arc<Page>>,
    /// Pages that were on their way and were taken back, since [`Streamer::serve`] was called.
    recalled: HashSet<PageId>,
}

impl Streamer {
    /// Nothing of `tree` is in memory yet.
    pub fn new(tree: impl Tree + 'static, options: StreamOptions) -> Streamer {
        let tree: Arc<dyn Tree> = Arc::new(tree);
        let reads_at_once = tree.reads_at_once();
        // While some read, others decode.
        let threads = reads_at_once.map_or(options.in_flight, |_| 2 * MOST_READS);
        let loader = Loader::new(Arc::clone(&tree), threads, stall_of(options.stall, reads_at_once));
        Streamer {
            residency: Residency::new(tree, options.budget),
            copies: None,
            occluder: None,
            upcoming: Vec::new(),
            goal: None,
            loader,
            options,
            pace: Pace::default(),
            report: Report::default(),
            start: Instant::now(),
            walked: None,
            ahead: Ahead::default(),
            visited: 0,
            missing: Vec::new(),
            uncopied: Vec::new(),
            discarded: Vec::new(),
            recalled: HashSet::new(),
        }
    }

    /// How the file is streamed.
    pub fn options(&self) -> &StreamOptions {
        &self.options
    }

    /// The first nodes of these families (indices in the file's metadata) at a time, made for this purpose where there are such.
    pub fn roots(&self, families: impl IntoIterator<Item = u32>, purpose: Purpose, time: f64) -> Vec<NodeRef> {
        let families: Vec<u32> = families.into_iter().collect();
        self.residency.tree().roots(&families, purpose, time)
    }

    /// Takes in the pages that have been read.
    pub fn arrive(&mut self) -> Arrivals {
        let (mut arrivals, of_roots) = self.arrive_apart();
        arrivals.messages.extend(of_roots.into_iter().map(|(_, message)| message));
        arrivals
    }

    /// The same, with what is to be told of root pages apart: that they cannot be read is the error of whoever waits for them.
    pub(super) fn arrive_apart(&mut self) -> (Arrivals, Vec<(PageId, String)>) {
        let path = self.residency.tree().path().to_path_buf();
        let (mut arrivals, mut of_roots) = (Arrivals::default(), Vec::new());
        for loaded in self.loader.take_done() {
            arrivals.pages.push(loaded.page);
            if loaded.outcome.is_ok() {
                arrivals.bytes += loaded.bytes;
                self.pace.loaded(loaded.bytes, loaded.took);
                if let Some(change) = loaded.change {
                    self.report.changed(&path, change);
                }
            }
            self.residency.loaded(loaded.page, loaded.outcome);
        }
        for (page, age) in self.loader.take_stalled() {
            self.residency.stalled(page);
            self.report.stalled(&path, page, age);
        }
        if !arrivals.pages.is_empty() && self.residency.statistics().stalled == 0 {
            self.report.answered(&path);
        }
        for (page, why) in self.residency.take_failures() {
            match self.residency.tree().is_root(page) {
                true => of_roots.extend(self.report.failed_root(&path, &why).map(|message| (page, message))),
                false => self.report.failed(&path, &why),
            }
        }
        arrivals.messages = self.report.take();
        arrivals.messages.extend(take_notes());
        (arrivals, of_roots)
    }

    /// From now on the renderer draws from copies, of which it has none, or from main memory.
    pub fn keep_copies(&mut self, options: Option<CopyOptions>) {
        self.copies = options.map(Copies::new);
    }

    /// From now on all nodes of a page are hidden, or not all are: see [`Residency::hide`].
    pub fn hide(&mut self, page: PageId, is_hidden: bool) {
        self.residency.hide(page, is_hidden);
        if let Some(copies) = &mut self.copies {
            copies.hide(page, is_hidden);
        }
    }

    /// Starts a frame: chooses what `view` draws below `roots` in this detail (a number is an error in pixels), and notes what it
    /// lacks.
    pub fn select(&mut self, view: &View, detail: impl Into<Detail>, roots: &[NodeRef]) -> Selection<NodeRef> {
        let detail = detail.into();
        let now = self.start.elapsed();
        self.residency.begin_frame(now);
        if let Some(copies) = &mut self.copies {
            copies.begin_frame();
        }
        self.pace.moved(view.eye, now);
        if self.options.prefetch && self.walked.is_none_or(|then| now >= then + WALK) {
            self.walked = Some(now);
            let (distance, pages) = (self.prefetch_distance(), self.options.ahead.pages);
            let (detail, roots) = self.goal.as_ref().map_or((detail, roots), |(detail, roots)| (*detail, &roots[..]));
            self.ahead = ahead(view, detail, (distance, true), pages, &self.residency, roots);
            for (next, roots) in &self.upcoming {
                let next = ahead(next, detail, (0.0, false), pages, &self.residency, roots);
                let is_there = next.missing.is_empty();
                self.ahead = std::mem::take(&mut self.ahead).with(next, pages);
                if !is_there {
                    break;
                }
            }
            self.residency.anticipate(&self.ahead);
            if let Some(copies) = &mut self.copies {
                copies.anticipate(&self.ahead);
            }
        }
        let tree = Drawable { residency: &self.residency, copies: self.copies.as_ref() };
        let selection = select_unhidden(view, detail, self.occluder.as_deref(), &tree, roots);
        self.ask(&selection);
        selection
    }

    /// Uses what a selection has visited and asks for what it lacks, in place of what was asked for before.
    pub fn ask(&mut self, selection: &Selection<NodeRef>) {
        let (to_copy, to_read): (Vec<NodeRef>, Vec<NodeRef>) =
            selection.missing.iter().map(|missing| missing.id).partition(|id| self.residency.page(id.page).is_some());
        // What waits for its copy is in use as much as what is drawn.
        self.residency.touch(selection.visited.iter().chain(&to_copy).copied());
        if let Some(copies) = &mut self.copies {
            copies.touch(selection.visited.iter().chain(&to_copy).map(|id| id.page));
        }
        let pages: HashSet<PageId> =
            selection.visited.iter().chain(&to_copy).chain(&to_read).map(|id| id.page).collect();
        self.visited = pages.len();
        self.missing = to_read.iter().map(|id| id.page).collect();
        self.request(to_read);
        let mut seen = HashSet::new();
        self.uncopied = to_copy.iter().map(|id| id.page).filter(|page| seen.insert(*page)).collect();
    }

    /// Asks for these nodes' pages, in place of what was asked for before and nobody has begun to read.
    fn request(&mut self, nodes: Vec<NodeRef>) {
        for page in self.loader.recall(|page| self.residency.is_missed(page)) {
            self.residency.withdraw(page);
            self.recalled.insert(page);
        }
        self.residency.request(nodes);
    }

    /// Starts a frame that nothing is selected for: what the one before used may make room.
    pub fn begin(&mut self) {
        self.residency.begin_frame(self.start.elapsed());
    }

    /// Uses the pages of these nodes as far as they are in memory, and asks for the others in the order of the file, in place of what was asked
    /// for before. Whether any is lacked.
    pub fn hold(&mut self, nodes: impl IntoIterator<Item = NodeRef>) -> bool {
        let (held, mut lacked): (Vec<NodeRef>, Vec<NodeRef>) =
            nodes.into_iter().partition(|node| self.residency.page(node.page).is_some());
        self.residency.touch(held);
        lacked.sort_unstable();
        self.missing = lacked.iter().map(|node| node.page).collect();
        self.missing.dedup();
        self.uncopied.clear();
        self.request(lacked);
        !self.missing.is_empty()
    }

    /// From now on the pages of these nodes are read ahead of time, the first ones first, and in place of what was to be read ahead before; of
    /// those that are in memory, the first stay longest.
    pub fn read_ahead(&mut self, nodes: impl IntoIterator<Item = NodeRef>) {
        let (mut known, mut resident, mut missing) = (HashSet::new(), Vec::new(), Vec::new());
        for page in nodes.into_iter().map(|node| node.page) {
            if missing.len() >= self.options.ahead.pages {
                break;
            }
            if known.insert(page) {
                let is_here = self.residency.page(page).is_some();
                let pages = if is_here { &mut resident } else { &mut missing };
                pages.push((page, known.len() as f64));
            }
        }
        // The least urgent first.
        resident.reverse();
        self.residency.anticipate(&Ahead { resident, missing, distance_world: 0.0 });
    }

    /// What another view draws below `roots` in this detail, which is known to come next, is read ahead of time from now on, as far as it is
    /// known from what is in memory; what the present frame uses stays.
    pub fn look_ahead(&mut self, view: &View, detail: impl Into<Detail>, roots: &[NodeRef]) {
        let tree = Drawable { residency: &self.residency, copies: self.copies.as_ref() };
        let next = select_unhidden(view, detail, self.occluder.as_deref(), &tree, roots);
        let missing = next.missing.into_iter().map(|missing| missing.id);
        self.read_ahead(missing.chain(next.visited));
    }

    /// Begins to read what is missing.
    pub fn serve(&mut self) -> Served {
        let (in_flight, waiting, in_advance) = self.at_once();
        let mut started = Vec::new();
        while let Some(page) = self.residency.next_to_load(in_flight + waiting, in_advance) {
            self.loader.start(page);
            if !self.recalled.remove(&page) {
                started.push(page);
            }
        }
        // Pages go on the loader's threads, as soon as nobody else would have to free their memory.
        for page in self.discarded.extract_if(.., |page| Arc::strong_count(page) == 1) {
            self.loader.discard(page);
        }
        Served { started, withdrawn: self.recalled.drain().collect() }
    }

    /// Pages that had to make room since the last call.
    pub fn take_evicted(&mut self) -> Vec<PageId> {
        let mut evicted = Vec::new();
        for (page, held) in self.residency.take_evicted() {
            self.discarded.extend(held);
            if let Some(copies) = &mut self.copies {
                copies.remove(page);
            }
            evicted.push(page);
        }
        evicted
    }

    /// Gives up pages that had to make room here and now, as far as nobody holds them: what is read in their place would come on top of them
    /// else. How many bytes they took.
    pub fn free_evicted(&mut self) -> u64 {
        self.take_evicted();
        self.discarded.extract_if(.., |page| Arc::strong_count(page) == 1).map(|page| page.memory()).sum()
    }

    /// What is to be copied and removed in this frame; nothing where the renderer needs no copies. To be called after
    /// [`Streamer::take_evicted`].
    pub fn plan_copies(&mut self) -> CopyPlan {
        let Some(copies) = &mut self.copies else { return CopyPlan::default() };
        let residency = &self.residency;
        copies.plan(&self.uncopied, &self.ahead.resident, |id| residency.page(id).map(|page| &**page))
    }

    /// Pages in memory of which the last selection lacked copies, the most missed first.
    pub fn uncopied(&self) -> &[PageId] {
        &self.uncopied
    }

    /// The pages that the prefetching sphere held when it was walked through last.
    pub fn ahead(&self) -> &Ahead {
        &self.ahead
    }

    /// `d_prefetch` now, world units.
    pub fn prefetch_distance(&self) -> f64 {
        self.pace.prefetch_distance(self.residency.tree().largest_page_bytes(), &self.options.ahead)
    }

    /// How many pages are read at a time, how many more wait for that, and how many of the former may be read ahead of time: as is set, or
    /// as a link takes them.
    fn at_once(&self) -> (usize, usize, usize) {
        let (StreamOptions { in_flight, ahead, .. }, tree) = (&self.options, self.residency.tree());
        match tree.reads_at_once() {
            Some(reads) => {
                let reads = reads.min(MOST_READS);
                (reads, reads.max(WAITING), ahead.reads_over_link(reads))
            }
            None => {
                let reads = in_flight * tree.pages_at_once();
                (reads, 0, ahead.reads(reads))
            }
        }
    }

    /// How long before it is needed another view as large as the last one has to be read, seconds: so many times as long as its pages
    /// take to come ([`LookAhead::loads`]), within the bounds of [`LookAhead`].
    pub fn lead_secs(&self) -> f64 {
        let LookAhead { loads, least_secs, most_secs, .. } = self.options.ahead;
        let tree = self.residency.tree();
        let turns = self.visited.div_ceil(self.at_once().0.max(1)) as f64;
        (loads * turns * self.pace.load_secs(tree.largest_page_bytes())).min(most_secs).max(least_secs)
    }

    /// Whether anything may still come for the last selection: pages are being read or copied, or will be tried again soon.
    pub fn is_busy(&self) -> bool {
        self.residency.statistics().loading > 0 || self.next_retry().is_some() || self.is_copying()
    }

    /// Whether a copy of something that the last selection lacked is on its way or about to be.
    fn is_copying(&self) -> bool {
        let Some(copies) = &self.copies else { return false };
        let mut lacked = self.missing.iter().chain(&self.uncopied);
        copies.on_their_way().next().is_some()
            || lacked.any(|page| self.residency.page(*page).is_some() && copies.can_take(*page))
    }

    /// Whether a page that the last selection lacks may be tried again now.
    pub fn is_retry_due(&self) -> bool {
        self.next_retry().is_some_and(|at| at <= self.start.elapsed())
    }

    fn next_retry(&self) -> Option<Duration> {
        self.residency.next_retry(self.missing.iter().copied())
    }

    /// Waits until a page has been read or may be tried again, or for so long: for callers that draw no frames meanwhile.
    pub fn wait(&self, longest: Duration) {
        let retry = self.next_retry().map_or(longest, |at| at.saturating_sub(self.start.elapsed()));
        self.loader.wait(longest.min(retry));
    }

    /// Whether a page is given up.
    pub fn is_failed(&self, page: PageId) -> bool {
        matches!(self.residency.state(page), Some(PageState::Failed(failure)) if failure.given_up)
    }
}

/// What may be drawn: resident, and copied where the renderer needs copies.
struct Drawable<'a> {
    residency: &'a Residency,
    copies: Option<&'a Copies>,
}

impl NodeTree for Drawable<'_> {
    type Id = NodeRef;

    fn node(&self, id: NodeRef) -> Option<NodeInfo> {
        self.copies.is_none_or(|copies| copies.has(id.page)).then(|| self.residency.node(id))?
    }

    fn children(&self, id: NodeRef) -> impl Iterator<Item = NodeRef> {
        self.residency.children(id)
    }

    fn steps(&self, id: NodeRef) -> &[Step] {
        self.residency.steps(id)
    }

    fn is_hidden(&self, id: NodeRef) -> bool {
        NodeTree::is_hidden(self.residency, id)
    }
}
