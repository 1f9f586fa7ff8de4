//! Curves that were read, kept for the next pictures.

use crate::cpu::paths::Curves;
use std::collections::HashMap;
use std::sync::Arc;

/// Interval, family, flow level (0 for particles), and leaf.
pub type Place = [u32; 4];

/// Curves by where they come from.
pub struct Kept {
    held: HashMap<Place, (Arc<Curves>, u64)>,
    bytes: u64,
    /// Bytes that are kept beyond those that a picture needs.
    limit: u64,
    picture: u64,
}

impl Kept {
    /// Nothing yet; up to `limit` bytes are kept beyond those that a picture needs.
    pub fn within(limit: u64) -> Kept {
        Kept { held: HashMap::new(), bytes: 0, limit, picture: 0 }
    }

    /// The next picture begins; what has not been used for longest goes where there is too much.
    pub fn begin(&mut self) {
        self.picture += 1;
        if self.bytes <= self.limit {
            return;
        }
        let mut old: Vec<(u64, Place)> = self.held.iter().map(|(place, (_, used))| (*used, *place)).collect();
        old.sort_unstable();
        for (_, place) in old {
            if self.bytes <= self.limit / 2 {
                break;
            }
            if let Some((curves, _)) = self.held.remove(&place) {
                self.bytes -= curves.memory();
            }
        }
    }

    /// Whether curves are here.
    pub fn has(&self, place: &Place) -> bool {
        self.held.contains_key(place)
    }

    /// Curves that are here.
    pub fn get(&mut self, place: &Place) -> Option<Arc<Curves>> {
        let (curves, used) = self.held.get_mut(place)?;
        *used = self.picture;
        Some(Arc::clone(curves))
    }

    /// Keeps curves.
    pub fn put(&mut self, place: Place, curves: Curves) {
        self.bytes += curves.memory();
        if let Some((before, _)) = self.held.insert(place, (Arc::new(curves), self.picture)) {
            self.bytes -= before.memory();
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.held.clear();
        self.bytes = 0;
    }
}
