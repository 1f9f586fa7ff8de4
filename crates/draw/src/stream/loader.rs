//! Reading pages on threads of its own, so that no thread pool of anybody else ever waits for a disk.
//!
//! A read that is not answered for long is told and left to itself; another thread takes its place. The processor's part
//! (checksum, decoding) runs on a few threads at a time only, so that it does not take the processor from what draws. Both parts
//! are spans, `read` and `decode`, of the page that they name.
//!
//! A link is asked for as many pages at a time as it takes, and for the next one as soon as one has come, decoded or not: it would idle else
//! until the next frame asks. What waits for that can be taken back.

use crate::store::{Change, Page, PageId, StoreError, Tree};
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tracing::{debug, debug_span};

/// A read that has ended.
#[derive(Debug)]
pub struct Loaded {
    /// The page.
    pub page: PageId,
    /// What came of it.
    pub outcome: Result<Page, StoreError>,
    /// Its bytes on the disk.
    pub bytes: u64,
    /// Time since it was asked for.
    pub took: Duration,
    /// What has become of the file, though the page may have been read.
    pub change: Option<Change>,
}

/// What a thread is to do.
enum Job {
    Read(PageId, Instant),
    /// Giving back the memory of a page takes a while too.
    Drop(Arc<Page>),
}

/// A read under way.
struct Reading {
    since: Instant,
    is_stalled: bool,
}

#[derive(Default)]
struct State {
    /// Pages that nobody has begun to read, and when they were asked for.
    waiting: VecDeque<(PageId, Instant)>,
    /// Pages whose memory is to be given back.
    discarded: Vec<Arc<Page>>,
    done: Vec<Loaded>,
    reading: HashMap<PageId, Reading>,
    /// Reads that may still be answered soon.
    under_way: usize,
    threads: usize,
    idle: usize,
    /// Threads whose read is not answered.
    stuck: usize,
    decoding: usize,
    is_closed: bool,
}

struct Shared {
    tree: Arc<dyn Tree>,
    state: Mutex<State>,
    /// Something is to be done, or may be decoded.
    work: Condvar,
    /// Something is done.
    done: Condvar,
    most_threads: usize,
    most_decoding: usize,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Every change below is complete before the lock is given back, so a panic elsewhere leaves it consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What there is to do now. How many reads at a time serve best changes with the reads.
    fn next_job(&self, state: &mut State) -> Option<Job> {
        if let Some(page) = state.discarded.pop() {
            return Some(Job::Drop(page));
        }
        if state.waiting.is_empty() || self.tree.reads_at_once().is_some_and(|most| state.under_way >= most) {
            return None;
        }
        let (page, asked) = state.waiting.pop_front()?;
        Some(Job::Read(page, asked))
    }
}

/// Threads that read pages of one tree. Dropping it does not wait for them.
pub struct Loader {
    shared: Arc<Shared>,
    stall: Duration,
}

impl Loader {
    /// No thread is started yet; at most `threads` will be, those left out that have been without an answer for `stall`.
    pub fn new(tree: Arc<dyn Tree>, threads: usize, stall: Duration) -> Loader {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let shared = Shared {
            tree,
            state: Mutex::default(),
            work: Condvar::new(),
            done: Condvar::new(),
            most_threads: threads.max(1),
            most_decoding: (processors / 4).max(1),
        };
        Loader { shared: Arc::new(shared), stall }
    }

    /// Reads a page as soon as its turn comes; never waits. Roots come before what others wait for: without them nothing can be drawn.
    pub fn start(&self, page: PageId) {
        let (read, is_root) = ((page, Instant::now()), self.shared.tree.is_root(page));
        self.give(|state| match is_root {
            true => state.waiting.push_front(read),
            false => state.waiting.push_back(read),
        });
    }

    /// Takes back these of the pages that nobody has begun to read.
    pub fn recall(&self, which: impl Fn(PageId) -> bool) -> Vec<PageId> {
        let mut state = self.shared.lock();
        let waiting = std::mem::take(&mut state.waiting).into_iter();
        let (recalled, left): (VecDeque<_>, VecDeque<_>) = waiting.partition(|(page, _)| which(*page));
        state.waiting = left;
        recalled.into_iter().map(|(page, _)| page).collect()
    }

    /// Gives back a page's memory, elsewhere.
    pub fn discard(&self, page: Arc<Page>) {
        self.give(|state| state.discarded.push(page));
    }

    fn give(&self, add: impl FnOnce(&mut State)) {
        let mut state = self.shared.lock();
        add(&mut state);
        self.staff(&mut state);
        self.shared.work.notify_all();
    }

    /// Starts threads for what waits. Where the system gives none, the threads that there are do it all; without any, the
    /// reads fail.
    fn staff(&self, state: &mut State) {
        let jobs = state.waiting.len() + state.discarded.len();
        while jobs > state.idle && state.threads - state.stuck < self.shared.most_threads {
            let shared = Arc::clone(&self.shared);
            let thread = std::thread::Builder::new().name("deepfield read".into()).spawn(move || work(&shared));
            match thread {
                // A thread counts as idle until it takes its first job.
                Ok(_) => (state.threads, state.idle) = (state.threads + 1, state.idle + 1),
                Err(error) => {
                    if state.threads == state.stuck {
                        fail_all(state, &*self.shared.tree, &error);
                    }
                    return;
                }
            }
        }
    }

    /// The reads that have ended since the last call.
    pub fn take_done(&self) -> Vec<Loaded> {
        std::mem::take(&mut self.shared.lock().done)
    }

    /// Reads that have now been without an answer for too long, each told once, and for how long.
    pub fn take_stalled(&self) -> Vec<(PageId, Duration)> {
        let mut state = self.shared.lock();
        let mut stalled = Vec::new();
        for (&page, reading) in &mut state.reading {
            let age = reading.since.elapsed();
            if !reading.is_stalled && age >= self.stall {
                reading.is_stalled = true;
                stalled.push((page, age));
            }
        }
        if !stalled.is_empty() {
            state.stuck += stalled.len();
            state.under_way -= stalled.len();
            self.staff(&mut state);
            self.shared.work.notify_all();
        }
        stalled
    }

    /// Waits until a read has ended, or for so long.
    pub fn wait(&self, longest: Duration) {
        let state = self.shared.lock();
        let result = self.shared.done.wait_timeout_while(state, longest, |state| state.done.is_empty());
        drop(result);
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.is_closed = true;
        state.waiting.clear();
        state.discarded.clear();
        self.shared.work.notify_all();
    }
}

/// Ends all waiting reads with an error.
fn fail_all(state: &mut State, tree: &dyn Tree, error: &std::io::Error) {
    state.discarded.clear();
    for (page, asked) in std::mem::take(&mut state.waiting) {
        let source = std::io::Error::new(error.kind(), format!("no thread can be started: {error}"));
        let outcome = Err(StoreError::Page { path: tree.path_of(page).to_path_buf(), page: page.0, source });
        state.done.push(Loaded { page, outcome, bytes: 0, took: asked.elapsed(), change: None });
    }
}

/// A thread's life.
fn work(shared: &Shared) {
    let mut state = shared.lock();
    loop {
        let Some(job) = shared.next_job(&mut state) else {
            if state.is_closed {
                return;
            }
            state = shared.work.wait(state).unwrap_or_else(PoisonError::into_inner);
            continue;
        };
        state.idle -= 1;
        let (page, asked) = match job {
            Job::Read(page, asked) => (page, asked),
            Job::Drop(page) => {
                drop(state);
                drop(page);
                state = shared.lock();
                state.idle += 1;
                continue;
            }
        };
        state.reading.insert(page, Reading { since: Instant::now(), is_stalled: false });
        state.under_way += 1;
        drop(state);
        let fetched = debug_span!("read", page = page.0).in_scope(|| shared.tree.fetch_page(page));
        let change = shared.tree.change_of(page);
        state = shared.lock();
        let was_stuck = state.reading.remove(&page).is_some_and(|reading| reading.is_stalled);
        state.under_way -= usize::from(!was_stuck);
        shared.work.notify_all();
        while state.decoding >= shared.most_decoding && !state.is_closed {
            state = shared.work.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.decoding += 1;
        drop(state);
        let decode = || fetched.and_then(|bytes| shared.tree.decode_page(bytes));
        let outcome = debug_span!("decode", page = page.0).in_scope(decode);
        let (bytes, took) = (shared.tree.page_bytes(page), asked.elapsed());
        debug!(page = page.0, bytes, ?took);
        state = shared.lock();
        state.decoding -= 1;
        state.done.push(Loaded { page, outcome, bytes, took, change });
        shared.done.notify_all();
        shared.work.notify_all();
        if was_stuck {
            state.stuck -= 1;
            if state.threads - state.stuck > shared.most_threads {
                // Another thread has taken its place meanwhile.
                state.threads -= 1;
                return;
            }
        }
        state.idle += 1;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;
    use crate::store::{InMemory, Metadata, PageBytes};
    use crate::synth::{self, merger::Merger};
    use std::fmt::Debug;
    use std::path::Path;
    use tracing::field::{Field, Visit};
    use tracing::span::{Attributes, Id};
    use tracing_subscriber::layer::{Context, Layer, SubscriberExt};

    /// Names of spans and the pages that they name.
    #[derive(Clone, Default)]
    struct Spans(Arc<Mutex<Vec<(&'static str, u64)>>>);

    struct OfPage(u64);

    impl Visit for OfPage {
        fn record_u64(&mut self, field: &Field, value: u64) {
            if field.name() == "page" {
                self.0 = value;
            }
        }

        fn record_debug(&mut self, _: &Field, _: &dyn Debug) {}
    }

    impl<S: tracing::Subscriber> Layer<S> for Spans {
        fn on_new_span(&self, attributes: &Attributes<'_>, _: &Id, _: Context<'_, S>) {
            let mut page = OfPage(u64::MAX);
            attributes.record(&mut page);
            self.0.lock().unwrap().push((attributes.metadata().name(), page.0));
        }
    }

    const PATIENCE: Duration = Duration::from_secs(60);

    fn in_memory() -> InMemory {
        InMemory::new(synth::dataset(&Merger::new(1, 8)))
    }

    /// What has been asked for over a link, and what may pass.
    #[derive(Debug, Default)]
    struct Passed {
        asked: Vec<u32>,
        /// Of the requests so far, so many are answered.
        answered: usize,
        decodes: bool,
    }

    /// A file over a link that takes two requests at a time.
    #[derive(Debug)]
    struct Link {
        file: InMemory,
        passed: Mutex<Passed>,
        changed: Condvar,
    }

    impl Link {
        fn change(&self, change: impl FnOnce(&mut Passed)) {
            change(&mut self.passed.lock().unwrap());
            self.changed.notify_all();
        }

        /// Waits for so many requests. The pages that have been asked for.
        fn asked(&self, requests: usize) -> Vec<u32> {
            let is_early = |passed: &mut Passed| passed.asked.len() < requests;
            let passed = self.changed.wait_timeout_while(self.passed.lock().unwrap(), PATIENCE, is_early).unwrap().0;
            assert!(passed.asked.len() >= requests, "{passed:?}");
            passed.asked.clone()
        }
    }

    impl Tree for Link {
        fn metadata(&self) -> &Metadata {
            self.file.metadata()
        }

        fn path(&self) -> &Path {
            self.file.path()
        }

        fn page_count(&self) -> u32 {
            self.file.page_count()
        }

        fn page_bytes(&self, page: PageId) -> u64 {
            self.file.page_bytes(page)
        }

        fn page_memory(&self, page: PageId) -> u64 {
            self.file.page_memory(page)
        }

        fn fetch_page(&self, page: PageId) -> Result<PageBytes, StoreError> {
            let mut passed = self.passed.lock().unwrap();
            passed.asked.push(page.0);
            self.changed.notify_all();
            let number = passed.asked.len();
            drop(self.changed.wait_while(passed, |passed| passed.answered < number).unwrap());
            self.file.fetch_page(page)
        }

        fn decode_page(&self, bytes: PageBytes) -> Result<Page, StoreError> {
            drop(self.changed.wait_while(self.passed.lock().unwrap(), |passed| !passed.decodes).unwrap());
            self.file.decode_page(bytes)
        }

        fn reads_at_once(&self) -> Option<usize> {
            Some(2)
        }
    }

    #[test]
    fn the_next_read_waits_for_no_frame_and_no_decoding_and_can_be_taken_back() {
        let link = Arc::new(Link { file: in_memory(), passed: Mutex::default(), changed: Condvar::new() });
        let loader = Loader::new(link.clone(), 16, PATIENCE);
        (100..106).for_each(|page| loader.start(PageId(page)));
        let mut first = link.asked(2);
        first.sort_unstable();
        // As long as neither is answered, no more are asked for.
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!((first, link.asked(2).len()), (vec![100, 101], 2));
        link.change(|passed| passed.answered = 1);
        assert_eq!(link.asked(3)[2], 102);
        assert_eq!(loader.recall(|page| page.0 > 103), [PageId(104), PageId(105)]);
        loader.start(PageId(105));
        link.change(|passed| passed.answered = 2);
        assert_eq!(link.asked(4)[3], 103);
        link.change(|passed| passed.answered = 3);
        assert_eq!(link.asked(5)[4], 105);
        assert!(loader.take_done().is_empty() && loader.recall(|_| true).is_empty());
        link.change(|passed| (passed.answered, passed.decodes) = (usize::MAX, true));
        let (mut done, start) = (Vec::new(), Instant::now());
        while done.len() < 5 {
            assert!(start.elapsed() < PATIENCE, "{done:?}");
            loader.wait(Duration::from_millis(10));
            done.extend(loader.take_done().into_iter().map(|loaded| loaded.page.0));
        }
        done.sort_unstable();
        assert_eq!((done, link.asked(0).len()), (vec![100, 101, 102, 103, 105], 5));
    }

    #[test]
    fn reads_are_spans_of_their_page() {
        let spans = Spans::default();
        tracing::subscriber::set_global_default(tracing_subscriber::registry().with(spans.clone())).unwrap();
        let loader = Loader::new(Arc::new(in_memory()), 1, PATIENCE);
        // There are no such pages, which takes as many steps to find out.
        for page in [711, 712] {
            loader.start(PageId(page));
            loader.wait(PATIENCE);
            assert!(loader.take_done()[0].outcome.is_err());
        }
        let spans = spans.0.lock().unwrap();
        let of_here: Vec<_> = spans.iter().copied().filter(|(_, page)| (711..=712).contains(page)).collect();
        assert_eq!(of_here, [("read", 711), ("decode", 711), ("read", 712), ("decode", 712)]);
    }
}
