//! Reads that whoever asks for them waits for, but not for ever: each is on a thread of its own, which is left to itself where no answer comes.

use super::residency::MOST_STALLED;
use crate::store::PageId;
use std::collections::HashSet;
use std::io;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tracing::debug_span;

/// Time without an answer after which a read over a link counts as stalled, at least: a slow link takes as long for a page, and reads that get
/// nothing more end by themselves.
const SLOW: Duration = Duration::from_secs(60);

/// How long reads may take where what they are of says how many at a time serve best, or does not: see [`crate::store::Disk::reads_at_once`].
pub(super) fn stall_of(stall: Duration, reads_at_once: Option<usize>) -> Duration {
    if reads_at_once.is_some() { stall.max(SLOW) } else { stall }
}

/// How long the reads of one file are waited for, and those that got no answer so far.
pub(crate) struct Patience {
    stall: Duration,
    stalled: Arc<Mutex<HashSet<PageId>>>,
}

impl Patience {
    /// Reads are waited for so long, over a link for a minute at least.
    pub fn new(stall: Duration, reads_at_once: Option<usize>) -> Patience {
        Patience { stall: stall_of(stall, reads_at_once), stalled: Arc::default() }
    }

    /// Reads are waited for so long from now on, as [`Patience::new`] has it.
    pub fn set_stall(&mut self, stall: Duration, reads_at_once: Option<usize>) {
        self.stall = stall_of(stall, reads_at_once);
    }

    /// How many reads have no answer yet, of those that were waited for in vain.
    pub fn stalled(&self) -> usize {
        locked(&self.stalled).len()
    }

    /// Whether a page's read is one of them.
    pub fn is_stalled(&self, page: PageId) -> bool {
        locked(&self.stalled).contains(&page)
    }

    /// What a read of a page gives, or for how long it was waited for in vain. The more reads have no answer, the shorter others are waited
    /// for, so that a disk that is gone takes four times the whole time and not as many as there are pages; where [`MOST_STALLED`] have none,
    /// no more are begun.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn wait<T: Send + 'static>(
        &self,
        page: PageId,
        read: impl FnOnce() -> T + Send + 'static,
    ) -> io::Result<Result<T, Duration>> {
        let stalled = self.stalled();
        if stalled >= MOST_STALLED {
            return Ok(Err(Duration::ZERO));
        }
        let longest = self.stall / (1 + stalled as u32);
        let (sender, receiver) = sync_channel(1);
        let without_answer = Arc::clone(&self.stalled);
        let read = move || {
            let answer = debug_span!("read", page = page.0).in_scope(read);
            // Nobody may wait for it any more.
            drop(sender.send(answer));
            locked(&without_answer).remove(&page);
        };
        std::thread::Builder::new().name("deepfield read".into()).spawn(read)?;
        if let Ok(answer) = receiver.recv_timeout(longest) {
            return Ok(Ok(answer));
        }
        let mut stalled = locked(&self.stalled);
        // It may have come just now; what comes from here on finds the page among these.
        match receiver.try_recv() {
            Ok(answer) => Ok(Ok(answer)),
            Err(_) => {
                stalled.insert(page);
                Ok(Err(longest))
            }
        }
    }
}

fn locked(stalled: &Mutex<HashSet<PageId>>) -> MutexGuard<'_, HashSet<PageId>> {
    stalled.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Instant;

    /// Reads that hang are left to themselves, so many and no more, and are known until they end.
    #[test]
    fn so_many_reads_are_left_to_themselves() {
        let patience = Patience::new(Duration::from_millis(50), None);
        let (gate, begun, start) = (Arc::new(Mutex::new(())), Arc::new(AtomicUsize::new(0)), Instant::now());
        let shut = gate.lock().unwrap();
        for page in 0..2 * MOST_STALLED as u32 {
            let (gate, begun) = (Arc::clone(&gate), Arc::clone(&begun));
            let read = move || {
                begun.fetch_add(1, Ordering::Relaxed);
                drop(gate.lock());
            };
            assert!(patience.wait(PageId(page), read).unwrap().is_err());
        }
        assert_eq!(patience.stalled(), MOST_STALLED);
        assert!(patience.is_stalled(PageId(0)) && !patience.is_stalled(PageId(MOST_STALLED as u32)));
        drop(shut);
        while patience.stalled() > 0 {
            assert!(start.elapsed() < Duration::from_secs(60));
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(begun.load(Ordering::Relaxed), MOST_STALLED);
        assert_eq!(patience.wait(PageId(3), || 7).unwrap(), Ok(7));
    }
}
