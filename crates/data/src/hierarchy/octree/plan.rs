//! How a family is cut into buckets that are built one by one: runs of whole cells in Morton order.
//!
//! The cut depends on the data alone (on a sample of it), never on memory or threads, so that neither changes the tree. A
//! bucket ends where a cell ends; merging at depth `d` works in cells of depth `d + 8`, so a bucket whose ends are those of
//! cells of depth at most 8 can be merged up to the root by itself. Where more particles than a bucket should hold lie in one
//! cell of depth 8 (a zoom simulation in its box), buckets are cut inside of it, and the last merging steps join them
//! ([`super::joint`]). What of such a bucket is merged by itself is a part of one cell, that of its [`Plan::closed_depth`].

use crate::codec::coordinates::CELL_BITS;
use crate::codec::morton::MORTON_BITS;
use crate::hierarchy::cell::CELL_DEPTH;
use crate::model::portable::Portable;
use std::ops::Range;

/// First key behind all others.
pub(super) const END: u64 = 1 << (3 * MORTON_BITS);

/// Where one bucket ends and the next begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// First key of each unit (a cell that is not cut), in order; the first is 0.
    units: Vec<u64>,
    /// First key of each bucket, in order.
    starts: Vec<u64>,
    /// The bucket of the first key with each value of the highest [`TABLE_BITS`] bits, and the last bucket.
    table: Vec<u32>,
}

/// Groups of buckets that follow each other, at most.
const GROUPS: usize = 64;

/// Bits of a key that are looked up to find its bucket.
const TABLE_BITS: u32 = 15;

impl Plan {
    /// Cuts cells until none holds more than `most` particles, each key of the sorted `sample` standing for `weight` of them,
    /// and gathers neighbouring cells in buckets of about that size.
    pub fn new(sample: &[u64], weight: f64, most: usize) -> Plan {
        let most = ((most.max(1) as f64 / weight.max(1.0)) as usize).max(1);
        let mut cut = Cut { sample, most, units: Vec::new() };
        cut.cell(0, 0, 0..sample.len());
        let (mut units, mut starts) = (Vec::with_capacity(cut.units.len()), Vec::new());
        let (mut held, mut group) = (0, None);
        for (number, unit) in cut.units.iter().enumerate() {
            // Units below depth 8 share a bucket only with others of their cell of that depth, and those below depth 16 only with others of
            // the cell 8 above them, within which they end.
            let depth = u32::from(unit.depth);
            let shared = CELL_BITS.max(depth.saturating_sub(CELL_BITS));
            let own = (depth > CELL_BITS).then(|| (shared, unit.start >> (3 * (MORTON_BITS - shared))));
            if number == 0 || own != group || held + unit.particles > most {
                starts.push(unit.start);
                held = 0;
            }
            group = own;
            held += unit.particles;
            units.push(unit.start);
        }
        Plan::of(units, starts)
    }

    /// The plan with these units and buckets, of both of which the first begins at 0.
    fn of(units: Vec<u64>, starts: Vec<u64>) -> Plan {
        let keys = (0..1_u64 << TABLE_BITS).map(|top| top << (3 * MORTON_BITS - TABLE_BITS));
        let last = starts.len() as u32 - 1;
        let bucket = |key| starts.partition_point(|&start| start <= key) as u32 - 1;
        let table = keys.map(bucket).chain([last]).collect();
        Plan { units, starts, table }
    }

    /// Number of buckets, at least 1.
    pub fn len(&self) -> usize {
        self.starts.len()
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// The bucket of a key.
    #[inline]
    pub fn bucket(&self, key: u64) -> usize {
        let top = (key >> (3 * MORTON_BITS - TABLE_BITS)) as usize;
        let (first, last) = (self.table[top] as usize, self.table[top + 1] as usize);
        if first == last { first } else { first + self.starts[first + 1..=last].partition_point(|&start| start <= key) }
    }

    /// The group of a bucket: sums over a family's nodes are taken for each group by itself, then added up in the order of groups, so that
    /// it does not matter who takes them.
    pub fn group(&self, bucket: usize) -> u32 {
        (bucket * GROUPS.min(self.len()) / self.len()) as u32
    }

    /// The keys of a bucket.
    pub fn keys(&self, bucket: usize) -> Range<u64> {
        let start = |bucket: usize| self.starts.get(bucket).copied().unwrap_or(END);
        start(bucket)..start(bucket + 1)
    }

    /// The key before which all that buckets have left open can be joined once those before one of this number are built.
    pub fn joined_before(&self, bucket: usize) -> u64 {
        let within = cell_keys(CELL_BITS as u8) - 1;
        self.starts.get(bucket).map_or(END, |start| start & !within)
    }

    /// The largest cells that a bucket is made of, in order: depth and first key of each.
    pub fn cells(&self, bucket: usize) -> impl Iterator<Item = (u32, u64)> {
        let Range { start: mut key, end } = self.keys(bucket);
        std::iter::from_fn(move || {
            let left = end.checked_sub(key).filter(|left| *left > 0)?;
            // As large as its first key and what is left of the bucket allow; key 0 is the first one of all cells.
            let height = key.trailing_zeros().min(left.ilog2()) / 3;
            let cell = (MORTON_BITS - height, key);
            key += 1 << (3 * height);
            Some(cell)
        })
    }

    /// Whether a cell was cut in making the plan: then it is an inner node, however many particles it has.
    pub(super) fn is_cut(&self, depth: u8, first: u64) -> bool {
        let end = first + cell_keys(depth);
        let next = self.units.partition_point(|&start| start <= first);
        self.units.get(next).is_some_and(|&start| start < end)
    }

    /// The smallest depth at which a bucket can be merged by itself. It lies in one cell of that depth.
    pub(super) fn closed_depth(&self, bucket: usize) -> u8 {
        let keys = self.keys(bucket);
        let cut = |key: u64| if key == 0 || key == END { 0 } else { boundary_depth(key - 1, key) };
        cut(keys.start).max(cut(keys.end)).saturating_sub(CELL_BITS) as u8
    }
}

impl Portable for Plan {
    fn put(&self, to: &mut Vec<u8>) {
        self.units.put(to);
        self.starts.put(to);
    }

    fn take(from: &mut &[u8]) -> Option<Plan> {
        let (units, starts): (Vec<u64>, Vec<u64>) = Portable::take(from)?;
        let is_sound = |keys: &[u64]| keys.first() == Some(&0) && keys.is_sorted() && keys.last() < Some(&END);
        (is_sound(&units) && is_sound(&starts) && u32::try_from(starts.len()).is_ok()).then(|| Plan::of(units, starts))
    }
}

/// Keys in a cell.
pub(super) fn cell_keys(depth: u8) -> u64 {
    1 << (3 * (MORTON_BITS - u32::from(depth)))
}

/// The depth of the coarsest cells that separate two neighbouring keys; more than [`MORTON_BITS`] if they are equal.
fn boundary_depth(a: u64, b: u64) -> u32 {
    // A key has 63 bits, so the first triple of bits starts one below the top.
    ((a ^ b) << 1).leading_zeros() / 3 + 1
}

struct Unit {
    start: u64,
    depth: u8,
    particles: usize,
}

struct Cut<'a> {
    sample: &'a [u64],
    most: usize,
    units: Vec<Unit>,
}

impl Cut<'_> {
    fn cell(&mut self, depth: u8, start: u64, range: Range<usize>) {
        if range.len() <= self.most || depth == CELL_DEPTH {
            self.units.push(Unit { start, depth, particles: range.len() });
            return;
        }
        let size = cell_keys(depth + 1);
        let mut from = range.start;
        for octant in 0..8 {
            let end = start + (octant + 1) * size;
            let to = from + self.sample[from..range.end].partition_point(|&key| key < end);
            self.cell(depth + 1, end - size, from..to);
            from = to;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn buckets_cover_all_keys_and_hold_few(
            mut keys in prop::collection::vec(
                prop_oneof![0..END, (END / 3)..(END / 3 + (1 << 30)), (END / 7)..(END / 7 + (1 << 14)), (END / 7)..(END / 7 + (1 << 21))],
                1..600,
            ),
            most in 1..50_usize,
        ) {
            keys.sort_unstable();
            let plan = Plan::new(&keys, 1.0, most);
            let mut counts = vec![0; plan.len()];
            for &key in &keys {
                let bucket = plan.bucket(key);
                prop_assert!(plan.keys(bucket).contains(&key));
                counts[bucket] += 1;
            }
            let mut end = 0;
            for (bucket, count) in counts.iter().enumerate() {
                let range = plan.keys(bucket);
                prop_assert_eq!(range.start, end);
                end = range.end;
                // Groups follow each other.
                prop_assert!(bucket == 0 || plan.group(bucket) - plan.group(bucket - 1) <= 1);
                prop_assert!((plan.group(bucket) as usize) < GROUPS.min(bucket + 1));
                let mut next = range.start;
                for (depth, key) in plan.cells(bucket) {
                    prop_assert!(key == next && key.is_multiple_of(cell_keys(depth as u8)));
                    next += cell_keys(depth as u8);
                }
                prop_assert_eq!(next, range.end);
                // More only where a smallest cell holds more.
                prop_assert!(*count <= most || range.end - range.start <= cell_keys(CELL_DEPTH));
                let depth = u32::from(plan.closed_depth(bucket));
                if depth > 0 {
                    let cell = |key: u64| key >> (3 * (MORTON_BITS - depth.max(CELL_BITS)));
                    prop_assert_eq!(cell(range.start), cell(range.end - 1));
                }
            }
            prop_assert_eq!(end, END);
        }

        #[test]
        fn boundaries_are_where_digits_differ(a in 0..END, b in 0..END) {
            let depth = boundary_depth(a, b);
            if depth <= MORTON_BITS {
                prop_assert_eq!(a >> (3 * (MORTON_BITS - depth + 1)), b >> (3 * (MORTON_BITS - depth + 1)));
                prop_assert_ne!(a >> (3 * (MORTON_BITS - depth)), b >> (3 * (MORTON_BITS - depth)));
            } else {
                prop_assert_eq!(a, b);
            }
        }
    }
}
