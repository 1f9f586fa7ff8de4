//! Particles of a bucket in Morton order.

use crate::codec::coordinates::CELL_BITS;
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::RootCell;
use crate::model::portable::portable;
use glam::DVec3;
use std::sync::OnceLock;

/// Bits per coordinate of a [`Place`]: as many as the deepest leaf resolves.
const PLACE_BITS: u32 = 2 * MORTON_BITS;

/// A position as a fraction of the root cell with 42 bits a coordinate: a Morton key, and one of 2^-21 of the key's cell. In the
/// order of pairs, places are in Morton order. What it loses is at most `2^-43` of the root cell along each axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The Morton key over the root cell.
    pub key: u64,
    /// The Morton key inside the cell of `key`.
    pub rest: u64,
}

impl Place {
    /// The place of a position; one outside the root cell goes to the nearest place in it.
    #[inline]
    pub fn of(position: [f64; 3], root: RootCell) -> Place {
        let unit = (DVec3::from_array(position) - root.min) / root.size;
        // The saturating cast takes care of what rounding puts outside.
        let fixed =
            unit.to_array().map(|x| ((x * (1_u64 << PLACE_BITS) as f64) as i64).clamp(0, (1 << PLACE_BITS) - 1));
        Place {
            key: morton::encode(fixed.map(|v| (v >> MORTON_BITS) as u32)),
            rest: morton::encode(fixed.map(|v| (v & ((1 << MORTON_BITS) - 1)) as u32)),
        }
    }

    /// The position as fractions of the root cell, each in `(0, 1)`; exact in doubles.
    #[inline]
    pub fn unit(self) -> [f64; 3] {
        let (high, low) = (morton::decode(self.key), morton::decode(self.rest));
        std::array::from_fn(|axis| {
            let fixed = u64::from(high[axis]) << MORTON_BITS | u64::from(low[axis]);
            (fixed as i64 as f64 + 0.5) * (1.0 / (1_u64 << PLACE_BITS) as f64)
        })
    }
}

/// Quantities of many particles, one column each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Masses.
    pub mass: Vec<f32>,
    /// Densities.
    pub density: Vec<f32>,
    /// Smoothing lengths.
    pub smoothing_length: Vec<f32>,
    /// Attributes, in the family's order.
    pub attributes: Vec<Vec<f32>>,
}

portable!(Columns { mass, density, smoothing_length, attributes });

impl Columns {
    /// No particles yet, room for `capacity`.
    pub fn with_capacity(attributes: usize, capacity: usize) -> Columns {
        let column = || Vec::with_capacity(capacity);
        Columns {
            mass: column(),
            density: column(),
            smoothing_length: column(),
            attributes: (0..attributes).map(|_| column()).collect(),
        }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }

    /// All columns: mass, density, smoothing length, attributes.
    pub fn iter(&self) -> impl Iterator<Item = &Vec<f32>> {
        [&self.mass, &self.density, &self.smoothing_length].into_iter().chain(&self.attributes)
    }

    /// The same, to write.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        [&mut self.mass, &mut self.density, &mut self.smoothing_length].into_iter().chain(&mut self.attributes)
    }

    /// The order of particles at these places: by place, and those of one place by their quantities, so that the order in
    /// which they come does not matter.
    pub fn order(&self, places: &[Place]) -> Vec<u32> {
        order_of(places, |a, b| {
            let differ = |column: &Vec<f32>| column[a as usize].total_cmp(&column[b as usize]);
            self.iter().map(differ).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
        })
    }

    /// A run of the particles.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Columns {
        let slice = |column: &Vec<f32>| column[range.clone()].to_vec();
        Columns {
            mass: slice(&self.mass),
            density: slice(&self.density),
            smoothing_length: slice(&self.smoothing_length),
            attributes: self.attributes.iter().map(slice).collect(),
        }
    }

    /// The particles with these indices.
    pub fn gather(&self, order: &[u32]) -> Columns {
        let gather = |column: &Vec<f32>| order.iter().map(|&i| column[i as usize]).collect();
        Columns {
            mass: gather(&self.mass),
            density: gather(&self.density),
            smoothing_length: gather(&self.smoothing_length),
            attributes: self.attributes.iter().map(gather).collect(),
        }
    }
}

/// The depth from which on the cells that are merged in are smaller than those of keys over the root cell. There particles have keys
/// over the cell of this depth that they lie in.
pub(super) const DEEP: u8 = (MORTON_BITS - CELL_BITS) as u8 + 1;

/// The depth of the cell over which particles have keys where a node of this depth is merged.
pub(super) fn keyed_depth(depth: u8) -> u8 {
    if depth < DEEP { 0 } else { DEEP }
}

/// The particles of a bucket, in Morton order.
#[derive(Debug, Default)]
pub(super) struct Sorted {
    /// Keys over the root cell.
    pub keys: Vec<u64>,
    /// Keys over cells of depth [`DEEP`], once they have been asked for: few trees are that deep.
    deep_keys: OnceLock<Vec<u64>>,
    /// Positions as fractions of the root cell.
    pub units: Vec<[f64; 3]>,
    pub columns: Columns,
}

impl Sorted {
    /// Sorts particles by place, those of one place by their quantities: the order in which they came does not matter.
    pub fn new(places: Vec<Place>, columns: Columns) -> Sorted {
        let order = columns.order(&places);
        let keys = order.iter().map(|&i| places[i as usize].key).collect();
        let units = order.iter().map(|&i| places[i as usize].unit()).collect();
        drop(places);
        Sorted { keys, deep_keys: OnceLock::new(), units, columns: columns.gather(&order) }
    }

    /// The keys by which nodes of a depth are merged: over cells of the depth [`keyed_depth`].
    pub fn keys_at(&self, depth: u8) -> &[u64] {
        if depth < DEEP {
            return &self.keys;
        }
        let bins = f64::from(u32::from(DEEP) + MORTON_BITS).exp2();
        // The bits before those of the key do not fit into it, and are cut off.
        let key = |unit: &[f64; 3]| morton::encode(unit.map(|x| (x * bins) as u64 as u32));
        self.deep_keys.get_or_init(|| self.units.iter().map(key).collect())
    }
}

/// Bits by which places are sorted at a time.
const DIGIT: u32 = 8;
/// Bits that are sorted digit by digit; the few places that agree in them are compared.
const DIGITS: u32 = 32;

/// The order of places; `tie` orders those of one place by index.
fn order_of(places: &[Place], tie: impl Fn(u32, u32) -> std::cmp::Ordering) -> Vec<u32> {
    let (all, any) = places.iter().fold((u64::MAX, 0), |(all, any), place| (all & place.key, any | place.key));
    // The highest bits in which keys differ, as far as they fit beside an index.
    let shift = (u64::BITS - (all ^ any).leading_zeros()).saturating_sub(DIGITS);
    let low = (1_u64 << DIGITS) - 1;
    let mut order: Vec<u64> =
        places.iter().zip(0..).map(|(place, i)| (place.key >> shift & low) << DIGITS | i).collect();
    let mut sorted = vec![0; order.len()];
    for digit in 0..DIGITS / DIGIT {
        let digit_of = |entry: u64| (entry >> (DIGITS + DIGIT * digit)) as usize & ((1 << DIGIT) - 1);
        let mut starts = [0_usize; 1 << DIGIT];
        order.iter().for_each(|&entry| starts[digit_of(entry)] += 1);
        let mut end = 0;
        for start in &mut starts {
            end += std::mem::replace(start, end);
        }
        for &entry in &order {
            let start = &mut starts[digit_of(entry)];
            sorted[*start] = entry;
            *start += 1;
        }
        std::mem::swap(&mut order, &mut sorted);
    }
    for run in order.chunk_by_mut(|a, b| a >> DIGITS == b >> DIGITS).filter(|run| run.len() > 1) {
        let place = |entry: u64| places[(entry & low) as usize];
        run.sort_unstable_by(|&a, &b| place(a).cmp(&place(b)).then_with(|| tie(a as u32, b as u32)));
    }
    order.into_iter().map(|entry| entry as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn places_are_sorted_like_pairs(
            pairs in prop::collection::vec((prop_oneof![0..1_u64 << 63, 7 << 40..(7_u64 << 40) + 300], 0..1_u64 << 63), 1..300),
        ) {
            let places: Vec<Place> = pairs.iter().map(|&(key, rest)| Place { key, rest }).collect();
            let mut expected: Vec<(Place, u32)> = places.iter().copied().zip(0..).collect();
            expected.sort_unstable();
            let order = order_of(&places, |a, b| a.cmp(&b));
            prop_assert_eq!(order, expected.into_iter().map(|(_, i)| i).collect::<Vec<_>>());
        }

        #[test]
        fn places_are_near_and_in_morton_order(a in prop::array::uniform3(-5.0..5.0_f64), b in prop::array::uniform3(-5.0..5.0_f64)) {
            let root = RootCell { min: DVec3::splat(-5.0), size: 10.0 };
            let (pa, pb) = (Place::of(a, root), Place::of(b, root));
            let back = root.min + DVec3::from_array(pa.unit()) * root.size;
            prop_assert!((back - DVec3::from_array(a)).abs().max_element() <= root.size * 2.0_f64.powi(-42));
            if pa.key != pb.key {
                prop_assert_eq!(pa < pb, pa.key < pb.key);
            }
        }

        /// Those over small cells go on where those over the root cell end, in the same order.
        #[test]
        fn deep_keys_are_the_bits_that_follow(pairs in prop::collection::vec((0..1_u64 << 63, 0..1_u64 << 63), 1..50)) {
            let mut places: Vec<Place> = pairs.iter().map(|&(key, rest)| Place { key, rest }).collect();
            let column = vec![1.0; places.len()];
            let columns =
                Columns { mass: column.clone(), density: column.clone(), smoothing_length: column, attributes: Vec::new() };
            let sorted = Sorted::new(places.clone(), columns);
            places.sort_unstable();
            let deep = 3 * u32::from(DEEP);
            let follow = |place: &Place| place.key << deep & ((1 << 63) - 1) | place.rest >> (3 * MORTON_BITS - deep);
            prop_assert_eq!(sorted.keys_at(DEEP), places.iter().map(follow).collect::<Vec<_>>());
            prop_assert_eq!(sorted.keys_at(DEEP - 1), places.iter().map(|place| place.key).collect::<Vec<_>>());
        }

        #[test]
        fn the_order_of_arrival_does_not_matter(
            particles in prop::collection::vec((0..4_u64, 0..3_u64, 0..3_u8, 0..3_u8), 1..60), seed: u64,
        ) {
            let sort = |particles: &[(u64, u64, u8, u8)]| {
                let places = particles.iter().map(|p| Place { key: p.0, rest: p.1 }).collect();
                let column = |value: &dyn Fn(&(u64, u64, u8, u8)) -> u8| particles.iter().map(|p| f32::from(value(p))).collect::<Vec<_>>();
                let columns = Columns {
                    mass: column(&|p| p.2),
                    density: column(&|_| 1),
                    smoothing_length: column(&|p| p.3),
                    attributes: vec![column(&|p| p.2 + p.3)],
                };
                let sorted = Sorted::new(places, columns);
                (sorted.keys, sorted.units, sorted.columns)
            };
            let mut shuffled = particles.clone();
            for i in (1..shuffled.len()).rev() {
                shuffled.swap(i, (seed.rotate_left(i as u32) % (i as u64 + 1)) as usize);
            }
            prop_assert_eq!(sort(&particles), sort(&shuffled));
        }
    }
}
