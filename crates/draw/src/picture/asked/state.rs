//! Work that somebody waits for: how far it has come, what there is to tell, and whether anybody still waits.
//!
//! What reports progress is stopped by unwinding from its next report, since progress has no answer: everything that the library leaves
//! behind on its way is removed by its owners, as on any error. Whoever starts such work catches that.

use crate::model::Progress;
use crate::picture::Reporter;
use crate::store;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// With what stopped work is unwound.
struct Stopped;

/// How far work has come, what it has to tell, and whether anybody waits for it.
#[derive(Default)]
pub struct State {
    /// The stage, and how many steps it takes; 0 where that is not known.
    stage: Mutex<(String, u64)>,
    done: AtomicU64,
    is_stopped: AtomicBool,
    is_writing: AtomicBool,
    notes: Mutex<Vec<String>>,
}

impl State {
    /// Set where nobody waits any more.
    pub fn stop(&self) -> &AtomicBool {
        &self.is_stopped
    }

    /// Whether work that writes may be in the middle of that: in its stages, but for what [`State::set_writing`] excepts.
    pub fn is_writing(&self) -> bool {
        self.is_writing.load(Ordering::Relaxed)
    }

    /// Says whether what comes next in a stage writes.
    pub fn set_writing(&self, is_writing: bool) {
        self.is_writing.store(is_writing, Ordering::Relaxed);
    }

    /// Keeps a sentence for the user.
    pub fn note(&self, note: String) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(note);
    }

    /// The sentences since the last time.
    pub fn take_notes(&self) -> Vec<String> {
        let mut notes = std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner));
        notes.extend(store::take_notes());
        notes
    }

    /// The stage, the steps done and their number; 0 where that is not known.
    pub fn reached(&self) -> Option<(String, u64, u64)> {
        let (stage, total) = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (!stage.is_empty()).then(|| (stage, self.done.load(Ordering::Relaxed), total))
    }
}

impl Progress for State {
    fn begin(&self, stage: &str, total: u64) {
        self.go_on();
        self.set_writing(true);
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = (stage.to_owned(), total);
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, n: u64) {
        self.go_on();
        self.done.fetch_add(n, Ordering::Relaxed);
    }

    /// Unwinds where nobody waits any more.
    fn go_on(&self) {
        if self.is_stopped.load(Ordering::Relaxed) && !std::thread::panicking() {
            resume_unwind(Box::new(Stopped));
        }
    }

    fn say(&self, line: &str) {
        self.note(line.to_owned());
    }
}

/// The progress of a state that somebody else owns.
struct Shared<'a>(&'a State);

impl Progress for Shared<'_> {
    fn begin(&self, stage: &str, total: u64) {
        self.0.begin(stage, total);
    }

    fn advance(&self, n: u64) {
        self.0.advance(n);
    }

    fn go_on(&self) {
        self.0.go_on();
    }

    fn say(&self, line: &str) {
        self.0.say(line);
    }
}

impl Reporter for State {
    fn tell(&self, message: String) {
        self.note(message);
    }

    fn progress(&self) -> Box<dyn Progress + '_> {
        Box::new(Shared(self))
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn work_writes_in_its_stages_but_for_what_it_excepts_and_ends_where_it_asks() {
        let state = State::default();
        assert!(!state.is_writing());
        state.begin("drawing frames", 2);
        assert!(state.is_writing());
        state.set_writing(false);
        state.advance(1);
        assert!(!state.is_writing());
        state.stop().store(true, Ordering::Relaxed);
        let begun = catch_unwind(AssertUnwindSafe(|| state.begin("writing", 1)));
        // What was given up before its stage has begun to write nothing.
        assert!(begun.is_err() && !state.is_writing());
        assert_eq!(state.reached(), Some(("drawing frames".to_owned(), 1, 2)));
    }
}
