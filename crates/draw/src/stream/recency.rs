//! The order in which cached pages go: what nobody wants and is hidden first, then the least recently used of what nobody wants; then
//! what the prefetching sphere holds, the least urgent foremost; what the present frame uses never.

use crate::store::PageId;
use lru::LruCache;
use std::collections::BTreeSet;

/// Why room is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Demand {
    /// The present frame lacks a page.
    Miss,
    /// The camera will, after moving so far (world units).
    Ahead(f64),
}

/// A page's last uses.
#[derive(Clone, Copy, Debug)]
struct Use {
    bytes: u64,
    /// The frame that used it last.
    frame: u64,
    /// The sphere that held it last, and how far the camera was from needing it then.
    sphere: u64,
    travel_world: f64,
}

/// Pages with their bytes and last uses.
#[derive(Debug)]
pub(super) struct Recency {
    /// Those that go first are the least recently used ones.
    uses: LruCache<PageId, Use>,
    /// Those of them that are hidden.
    hidden: BTreeSet<PageId>,
    bytes: u64,
    frame: u64,
    sphere: u64,
    /// By how much more urgent a page must be to take the place of another one of the sphere, so that they do not take
    /// turns.
    slack_world: f64,
}

impl Recency {
    pub fn new() -> Recency {
        let (uses, hidden) = (LruCache::unbounded(), BTreeSet::new());
        Recency { uses, hidden, bytes: 0, frame: 0, sphere: 0, slack_world: 0.0 }
    }

    /// Bytes of all pages.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Number of pages.
    pub fn len(&self) -> usize {
        self.uses.len()
    }

    /// A new frame begins and uses nothing yet.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// The present frame uses a page.
    pub fn touch(&mut self, page: PageId) {
        if let Some(used) = self.uses.get_mut(&page) {
            used.frame = self.frame;
        }
    }

    /// From now on a page is hidden, or is not.
    pub fn hide(&mut self, page: PageId, is_hidden: bool) {
        match is_hidden && self.uses.contains(&page) {
            true => self.hidden.insert(page),
            false => self.hidden.remove(&page),
        };
    }

    /// Whether a page is hidden.
    pub fn is_hidden(&self, page: PageId) -> bool {
        self.hidden.contains(&page)
    }

    /// A new prefetching sphere holds these pages, the least urgent first. To be called before the frame's
    /// [`Recency::touch`], whose pages must stay the last to go.
    pub fn anticipate(&mut self, pages: &[(PageId, f64)], slack_world: f64) {
        self.sphere += 1;
        self.slack_world = slack_world;
        for (page, travel) in pages {
            if let Some(used) = self.uses.get_mut(page) {
                (used.sphere, used.travel_world) = (self.sphere, *travel);
            }
        }
    }

    /// A page has come, for a reason.
    pub fn insert(&mut self, page: PageId, bytes: u64, demand: Demand) {
        let used = match demand {
            Demand::Miss => Use { bytes, frame: self.frame, sphere: 0, travel_world: 0.0 },
            Demand::Ahead(travel) => Use { bytes, frame: 0, sphere: self.sphere, travel_world: travel },
        };
        self.bytes += bytes;
        if let Some(old) = self.uses.put(page, used) {
            self.bytes = self.bytes.saturating_sub(old.bytes);
        }
    }

    /// A page has gone.
    pub fn remove(&mut self, page: PageId) {
        self.hidden.remove(&page);
        if let Some(used) = self.uses.pop(&page) {
            self.bytes = self.bytes.saturating_sub(used.bytes);
        }
    }

    /// The page that has to go next, if any may for that reason; it is forgotten.
    pub fn evict(&mut self, demand: Demand) -> Option<PageId> {
        let is_wanted = |used: &Use| used.sphere == self.sphere && self.sphere > 0;
        let is_unused = |used: &Use| used.frame < self.frame && !is_wanted(used);
        let hidden = self.hidden.iter().copied().find(|page| self.uses.peek(page).is_some_and(is_unused));
        if let Some(page) = hidden {
            self.remove(page);
            return Some(page);
        }
        let (&page, used) = self.uses.peek_lru()?;
        let wanted = is_wanted(used);
        let goes = used.frame < self.frame
            && match demand {
                Demand::Miss => true,
                Demand::Ahead(travel) => !wanted || used.travel_world > travel + self.slack_world,
            };
        if goes {
            self.remove(page);
        }
        goes.then_some(page)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pages(recency: &mut Recency, demand: Demand) -> Vec<u32> {
        std::iter::from_fn(|| recency.evict(demand)).map(|page| page.0).collect()
    }

    #[test]
    fn what_is_unwanted_goes_before_what_is_far_and_what_is_used_stays() {
        let mut recency = Recency::new();
        recency.begin_frame();
        (0..6).for_each(|page| recency.insert(PageId(page), 10, Demand::Miss));
        recency.begin_frame();
        // 0 and 3 are unwanted, 1 is near, 2 and 4 are far, 5 is drawn.
        recency.anticipate(&[(PageId(4), 9.0), (PageId(2), 8.0), (PageId(1), 1.0), (PageId(5), -1.0)], 0.5);
        recency.touch(PageId(5));
        assert_eq!((recency.len(), recency.bytes()), (6, 60));
        assert_eq!(pages(&mut recency, Demand::Ahead(7.6)), [0, 3, 4]);
        assert_eq!(pages(&mut recency, Demand::Ahead(7.6)), [0; 0], "8.0 is not more than the slack behind 7.6");
        assert_eq!(pages(&mut recency, Demand::Miss), [2, 1]);
        recency.begin_frame();
        assert_eq!(pages(&mut recency, Demand::Miss), [5]);
        assert_eq!((recency.len(), recency.bytes()), (0, 0));
    }

    #[test]
    fn what_is_hidden_and_unwanted_goes_first() {
        let mut recency = Recency::new();
        recency.begin_frame();
        (0..6).for_each(|page| recency.insert(PageId(page), 10, Demand::Miss));
        [2, 3, 4, 5, 9].into_iter().for_each(|page| recency.hide(PageId(page), true));
        recency.hide(PageId(4), false);
        assert_eq!([2, 3, 4, 5, 9].map(|page| recency.is_hidden(PageId(page))), [true, true, false, true, false]);
        recency.begin_frame();
        recency.anticipate(&[(PageId(2), 1.0), (PageId(1), 1.0)], 0.5);
        recency.touch(PageId(5));
        // 2 will be wanted, though it is hidden; 5 is drawn.
        assert_eq!(pages(&mut recency, Demand::Ahead(7.0)), [3, 0, 4]);
        recency.begin_frame();
        assert_eq!(pages(&mut recency, Demand::Miss), [5, 2, 1]);
        recency.insert(PageId(5), 10, Demand::Miss);
        assert!(!recency.is_hidden(PageId(5)), "what comes anew is not known to be");
    }
}
