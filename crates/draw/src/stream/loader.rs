//! Reading pages on threads of its own, so that no thread pool of anybody else ever waits for a disk.
//!
//! A read that is not answered for long is told and left to itself; another thread takes its place. The processor's part
//! (checksum, decoding) runs on a few threads at a time only, so that it does not take the processor from what draws. Both parts
//! are spans, `read` and `decode`, of the page that they name.

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
    jobs: VecDeque<Job>,
    done: Vec<Loaded>,
    reading: HashMap<PageId, Reading>,
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
}

/// Threads that read pages of one tree. Dropping it does not wait for them.
pub struct Loader {
    shared: Arc<Shared>,
    stall: Duration,
}

impl Loader {
    /// No thread is started yet; at most `in_flight` will read at a time, those left out that have been without an
    /// answer for `stall`.
    pub fn new(tree: Arc<dyn Tree>, in_flight: usize, stall: Duration) -> Loader {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        let shared = Shared {
            tree,
            state: Mutex::default(),
            work: Condvar::new(),
            done: Condvar::new(),
            most_threads: in_flight.max(1),
            most_decoding: (processors / 4).max(1),
        };
        Loader { shared: Arc::new(shared), stall }
    }

    /// Begins to read a page; never waits. Roots come before what others wait for: without them nothing can be drawn.
    pub fn start(&self, page: PageId) {
        self.give(Job::Read(page, Instant::now()), self.shared.tree.is_root(page));
    }

    /// Gives back a page's memory, elsewhere.
    pub fn discard(&self, page: Arc<Page>) {
        self.give(Job::Drop(page), false);
    }

    fn give(&self, job: Job, is_first: bool) {
        let mut state = self.shared.lock();
        match is_first {
            true => state.jobs.push_front(job),
            false => state.jobs.push_back(job),
        }
        self.staff(&mut state);
        self.shared.work.notify_all();
    }

    /// Starts threads for what waits. Where the system gives none, the threads that there are do it all; without any, the
    /// reads fail.
    fn staff(&self, state: &mut State) {
        while state.jobs.len() > state.idle && state.threads - state.stuck < self.shared.most_threads {
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
            self.staff(&mut state);
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
        state.jobs.clear();
        self.shared.work.notify_all();
    }
}

/// Ends all waiting reads with an error.
fn fail_all(state: &mut State, tree: &dyn Tree, error: &std::io::Error) {
    for job in std::mem::take(&mut state.jobs) {
        if let Job::Read(page, asked) = job {
            let source = std::io::Error::new(error.kind(), format!("no thread can be started: {error}"));
            let outcome = Err(StoreError::Page { path: tree.path_of(page).to_path_buf(), page: page.0, source });
            state.done.push(Loaded { page, outcome, bytes: 0, took: asked.elapsed(), change: None });
        }
    }
}

/// A thread's life.
fn work(shared: &Shared) {
    let mut state = shared.lock();
    loop {
        let Some(job) = state.jobs.pop_front() else {
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
        drop(state);
        let fetched = debug_span!("read", page = page.0).in_scope(|| shared.tree.fetch_page(page));
        let change = shared.tree.change_of(page);
        state = shared.lock();
        let was_stuck = state.reading.remove(&page).is_some_and(|reading| reading.is_stalled);
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
    use crate::store::InMemory;
    use crate::synth::{self, merger::Merger};
    use std::fmt::Debug;
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

    #[test]
    fn reads_are_spans_of_their_page() {
        let spans = Spans::default();
        tracing::subscriber::set_global_default(tracing_subscriber::registry().with(spans.clone())).unwrap();
        let loader =
            Loader::new(Arc::new(InMemory::new(synth::dataset(&Merger::new(1, 8)))), 1, Duration::from_secs(60));
        // There are no such pages, which takes as many steps to find out.
        for page in [711, 712] {
            loader.start(PageId(page));
            loader.wait(Duration::from_secs(60));
            assert!(loader.take_done()[0].outcome.is_err());
        }
        let spans = spans.0.lock().unwrap();
        let of_here: Vec<_> = spans.iter().copied().filter(|(_, page)| (711..=712).contains(page)).collect();
        assert_eq!(of_here, [("read", 711), ("decode", 711), ("read", 712), ("decode", 712)]);
    }
}
