//! What was made of leaves lately: rows of a run are asked for field by field, by several threads.

use std::sync::{Arc, Mutex, PoisonError};

/// Leaves that are kept for each thread: a chunk of rows lies in some twenty of them.
const KEPT: usize = 48;

/// What was made of some leaves, which `K` names.
#[derive(Debug)]
pub(super) struct Kept<K, T>(Mutex<Vec<(K, Arc<T>)>>);

impl<K, T> Default for Kept<K, T> {
    fn default() -> Kept<K, T> {
        Kept(Mutex::default())
    }
}

impl<K: PartialEq, T> Kept<K, T> {
    /// What was made of a leaf, if it is here.
    pub fn peek(&self, leaf: &K) -> Option<Arc<T>> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|(known, _)| known == leaf).map(|(_, made)| Arc::clone(made))
    }

    /// What was made of a leaf, or is now.
    pub fn get<E>(&self, leaf: K, make: impl FnOnce() -> Result<T, E>) -> Result<Arc<T>, E> {
        if let Some(made) = self.peek(&leaf) {
            return Ok(made);
        }
        // Not under the lock: others go on meanwhile, at worst with the same leaf.
        let made = Arc::new(make()?);
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= KEPT * rayon::current_num_threads().max(1) {
            kept.remove(0);
        }
        kept.push((leaf, Arc::clone(&made)));
        Ok(made)
    }
}
