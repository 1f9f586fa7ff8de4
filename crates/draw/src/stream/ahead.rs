//! What the camera will need soon: the prefetching sphere (F12 4.8.2), walked over what is resident.

use super::Residency;
use crate::store::{NodeRef, PageId};
use crate::view::{Detail, NodeTree, View};
use std::collections::HashMap;

/// How far ahead of the camera pages are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookAhead {
    /// The camera's way is looked ahead for so many times the time that the largest page takes to load.
    pub loads: f64,
    /// Least time that is looked ahead for, seconds: some frames, in which a page is copied to the GPU and drawn.
    pub least_secs: f64,
    /// Most time that is looked ahead for, seconds: beyond it, nobody knows where the camera will be.
    pub most_secs: f64,
    /// Pages that are asked for ahead of time at once: more would be outdated before their turn comes.
    pub pages: usize,
    /// Share of the pages read at a time that may be ones that nothing misses yet.
    pub share: f64,
}

impl Default for LookAhead {
    fn default() -> LookAhead {
        LookAhead { loads: 3.0, least_secs: 0.3, most_secs: 10.0, pages: 256, share: 0.5 }
    }
}

impl LookAhead {
    /// How many of the pages read at a time may be ones that nothing misses yet.
    pub fn reads(&self, at_once: usize) -> usize {
        (self.share * at_once as f64).ceil() as usize
    }

    /// The same over a link, where what is missed waits for what was asked for before it: half of them at most.
    pub fn reads_over_link(&self, at_once: usize) -> usize {
        self.reads(at_once).min(at_once / 2)
    }
}

/// The pages within the sphere, each with the way that the camera has to move until it needs them (world units).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ahead {
    /// Pages in memory, the least urgent first.
    pub resident: Vec<(PageId, f64)>,
    /// Pages that are not, the most urgent first.
    pub missing: Vec<(PageId, f64)>,
    /// The sphere's radius beyond `d_min`: `d_prefetch`, world units.
    pub distance_world: f64,
}

impl Ahead {
    /// With what another view will need, which comes as surely as what a camera that moves that way needs at once; of what is
    /// missing, `pages` at most.
    pub fn with(mut self, other: Ahead, pages: usize) -> Ahead {
        for (own, others) in [(&mut self.resident, other.resident), (&mut self.missing, other.missing)] {
            let mut known: HashMap<PageId, usize> = own.iter().enumerate().map(|(i, (page, _))| (*page, i)).collect();
            // Roots stay before all others.
            for (page, travel) in others {
                let travel = travel.min(0.0);
                match known.get(&page) {
                    Some(&i) => own[i].1 = own[i].1.min(travel),
                    None => {
                        known.insert(page, own.len());
                        own.push((page, travel));
                    }
                }
            }
        }
        self.sort(pages);
        self
    }

    fn sort(&mut self, pages: usize) {
        self.resident.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then_with(|| b.0.cmp(&a.0)));
        self.missing.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then_with(|| a.0.cmp(&b.0)));
        self.missing.truncate(pages);
    }
}

/// Everything below `roots` that may be needed refined, to be drawn in this detail, after a turn by any angle and a move by
/// `distance_world`, but for what is below hidden pages if those are left out (they are hidden from a camera in one place, and need not
/// be from another); of what is missing, `pages` at most.
pub fn ahead(
    view: &View,
    detail: Detail,
    (distance_world, leaves_out_hidden): (f64, bool),
    pages: usize,
    residency: &Residency,
    roots: &[NodeRef],
) -> Ahead {
    let mut travels: HashMap<PageId, f64> = HashMap::new();
    let mut open = Vec::with_capacity(64);
    for root in roots {
        travels.insert(root.page, f64::NEG_INFINITY);
        open.push(*root);
    }
    while let Some(id) = open.pop() {
        let Some(info) = residency.node(id).filter(|_| !(leaves_out_hidden && residency.is_hidden(id.page))) else {
            continue;
        };
        let travel = detail.travel(view, &info);
        if travel > distance_world || !info.is_at(view.time) || !view.cut.reaches(&info.extent.bounds) {
            continue;
        }
        for child in residency.children(id) {
            let least = travels.entry(child.page).or_insert(travel);
            *least = least.min(travel);
            open.push(child);
        }
    }
    let (resident, missing): (Vec<_>, Vec<_>) =
        travels.into_iter().partition(|(page, _)| residency.page(*page).is_some());
    let mut ahead = Ahead { resident, missing, distance_world };
    ahead.sort(pages);
    ahead
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_reads_half_ahead_at_most_whatever_the_share() {
        for share in [0.0, 0.1, 0.5, 0.8, 1.0] {
            let ahead = LookAhead { share, ..LookAhead::default() };
            for at_once in 2..=64 {
                let (reads, over_link) = (ahead.reads(at_once), ahead.reads_over_link(at_once));
                assert!(2 * over_link <= at_once && over_link <= reads, "{share} of {at_once}: {over_link}");
                // A small share is one page at least.
                assert_eq!(over_link > 0, share > 0.0, "{share} of {at_once}");
                assert!((reads as f64 - share * at_once as f64) < 1.0, "{share} of {at_once}: {reads}");
            }
        }
        assert_eq!([1, 8, 9].map(|at_once| LookAhead::default().reads(at_once)), [1, 4, 5]);
        assert_eq!([8, 9].map(|at_once| LookAhead::default().reads_over_link(at_once)), [4, 4]);
    }
}
