//! Progress of background tasks, as the window shows it.

use crate::model::progress::Progress;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// How far a background task has come; shared between its threads and the window.
#[derive(Debug, Default)]
pub struct SharedProgress {
    stage: Mutex<String>,
    total: AtomicU64,
    done: AtomicU64,
}

impl SharedProgress {
    /// The present stage's name, and the share of it that is done where its length is known.
    pub fn state(&self) -> (String, Option<f32>) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let total = self.total.load(Ordering::Relaxed);
        let share = self.done.load(Ordering::Relaxed) as f64 / total as f64;
        (stage, (total > 0).then_some(share.min(1.0) as f32))
    }
}

impl Progress for SharedProgress {
    fn begin(&self, stage: &str, total: u64) {
        let mut name = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        stage.clone_into(&mut name);
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
    }

    fn advance(&self, n: u64) {
        self.done.fetch_add(n, Ordering::Relaxed);
    }
}
