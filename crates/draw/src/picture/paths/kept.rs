//! What was read, kept for the next pictures.

use crate::cpu::paths::Curves;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::Arc;

/// Interval, family, flow level (0 for particles), and leaf.
pub type Place = [u32; 4];

/// What is kept.
pub trait Held {
    /// Bytes that it takes.
    fn memory(&self) -> u64;
}

impl Held for Curves {
    fn memory(&self) -> u64 {
        Curves::memory(self)
    }
}

impl Held for Vec<u32> {
    fn memory(&self) -> u64 {
        size_of_val(&self[..]) as u64
    }
}

/// Things by where they come from.
pub struct Kept<K, T> {
    held: HashMap<K, (Arc<T>, u64)>,
    bytes: u64,
    /// Bytes that are kept beyond those that a picture needs.
    limit: u64,
    picture: u64,
}

impl<K: Copy + Ord + Hash, T: Held> Kept<K, T> {
    /// Nothing yet; up to `limit` bytes are kept beyond those that a picture needs.
    pub fn within(limit: u64) -> Kept<K, T> {
        Kept { held: HashMap::new(), bytes: 0, limit, picture: 0 }
    }

    /// The next picture begins; what has not been used for longest goes where there is too much.
    pub fn begin(&mut self) {
        self.picture += 1;
        if self.bytes <= self.limit {
            return;
        }
        let mut old: Vec<(u64, K)> = self.held.iter().map(|(place, (_, used))| (*used, *place)).collect();
        old.sort_unstable();
        for (_, place) in old {
            if self.bytes <= self.limit / 2 {
                break;
            }
            if let Some((held, _)) = self.held.remove(&place) {
                self.bytes -= held.memory();
            }
        }
    }

    /// Whether something is here.
    pub fn has(&self, place: &K) -> bool {
        self.held.contains_key(place)
    }

    /// Something that is here.
    pub fn get(&mut self, place: &K) -> Option<Arc<T>> {
        let (held, used) = self.held.get_mut(place)?;
        *used = self.picture;
        Some(Arc::clone(held))
    }

    /// Keeps something.
    pub fn put(&mut self, place: K, own: T) -> Arc<T> {
        let own = Arc::new(own);
        self.bytes += own.memory();
        if let Some((before, _)) = self.held.insert(place, (Arc::clone(&own), self.picture)) {
            self.bytes -= before.memory();
        }
        own
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.held.clear();
        self.bytes = 0;
    }
}
