//! Which clusters of a level may be one: the nearest pairs, found in a grid.

use super::{AHEAD, Level, Part, ROUNDING, TANGENT_WEIGHT};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// Parts that may be joined: the pairs of them that are near, in a grid as wide as the error.
pub(super) struct Pairs<'a> {
    level: &'a Level<'a>,
    pub parts: Vec<Option<Part>>,
    /// The part that each one began as. Those that were split from one are neighbours in this order.
    origins: Vec<u32>,
    /// By origin the parts of a cell.
    grid: HashMap<[i64; 3], Vec<(u32, usize)>>,
    /// Distances, which are positive, so that their bits are in their order, and pairs.
    pub queue: BinaryHeap<Reverse<(u64, usize, usize)>>,
    near: Vec<(u64, usize)>,
}

/// Pairs that a part is tried in. Where tracks are not resolved, hundreds of parts are near that never can be joined.
const MOST_PAIRS: usize = 48;
/// How many parts of a cell are looked at on each side of a part in their order.
const WINDOW: usize = 192;

impl<'a> Pairs<'a> {
    pub fn new(level: &'a Level<'a>, parts: Vec<Part>) -> Pairs<'a> {
        let mut pairs = Pairs {
            level,
            origins: (0..parts.len() as u32).collect(),
            parts: parts.into_iter().map(Some).collect(),
            grid: HashMap::new(),
            queue: BinaryHeap::new(),
            near: Vec::new(),
        };
        for (i, part) in pairs.parts.iter().enumerate() {
            if let Some(part) = part {
                let cell = cell(part, level.error);
                pairs.grid.entry(cell).or_default().push((pairs.origins[i], i));
            }
        }
        pairs
    }

    /// Queues the nearest pairs of a part.
    pub fn offer(&mut self, i: usize) {
        let Some(own) = &self.parts[i] else { return };
        let (middle, error) = (cell(own, self.level.error), self.level.error);
        // No two members of a cluster are farther apart than this, nor are centres of what is within it.
        let ahead = self.level.flow.next_rate.map_or(0.0, |next| AHEAD * next / self.level.flow.rate);
        let most = 2.0 * error * (1.0 + 4.0 / ROUNDING);
        self.near.clear();
        for offset in 0..27 {
            let at = [offset % 3 - 1, offset / 3 % 3 - 1, offset / 9 - 1];
            let at = std::array::from_fn(|axis| middle[axis].saturating_add(at[axis]));
            let Some(all) = self.grid.get(&at) else { continue };
            let here = all.partition_point(|entry| *entry < (self.origins[i], i));
            for &(_, other) in &all[here.saturating_sub(WINDOW)..all.len().min(here + WINDOW)] {
                let Some(part) = self.parts[other].as_ref().filter(|_| other != i) else { continue };
                let [apart, tangents] = own.distances(part);
                if apart + ahead * tangents <= most && !own.is_apart(part, error) {
                    self.near.push(((apart + TANGENT_WEIGHT * tangents).to_bits(), other));
                }
            }
        }
        if self.near.len() > MOST_PAIRS {
            self.near.select_nth_unstable(MOST_PAIRS);
            self.near.truncate(MOST_PAIRS);
        }
        let pairs = self.near.iter().map(|(distance, other)| Reverse((*distance, i.min(*other), i.max(*other))));
        self.queue.extend(pairs);
    }

    /// Puts a union in the place of two parts.
    pub fn replace(&mut self, old: [usize; 2], joined: Part) {
        for i in old {
            let Some(part) = self.parts[i].take() else { continue };
            if let Some(all) = self.grid.get_mut(&cell(&part, self.level.error))
                && let Ok(at) = all.binary_search(&(self.origins[i], i))
            {
                all.remove(at);
            }
        }
        let entry = (self.origins[old[0]], self.parts.len());
        let all = self.grid.entry(cell(&joined, self.level.error)).or_default();
        all.insert(all.partition_point(|other| *other < entry), entry);
        self.origins.push(entry.0);
        self.parts.push(Some(joined));
        self.offer(entry.1);
    }
}

/// The cell of the grid that a part's centre is in.
fn cell(part: &Part, error: f64) -> [i64; 3] {
    (part.center.position / error).floor().to_array().map(|x| x as i64)
}
