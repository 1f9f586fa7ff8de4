//! How the particles of a chunk come to their buckets. They wait there in memory until a run of them is put away; where those that wait take
//! more than they may, buckets put away what they have, one after the other. A bucket has the same particles whatever the length of its runs.

use super::{Bucket, RUN, particle_bytes, run};
use crate::build::BuildError;
use crate::build::spill::Spill;
use crate::hierarchy::RootCell;
use crate::hierarchy::octree::{Columns, Place, Plan};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Memory for distributing chunks.
#[derive(Default)]
pub(super) struct Scratch {
    places: Vec<Place>,
    /// Bucket of each particle.
    buckets: Vec<u32>,
    /// Where each bucket's particles end in `order`.
    ends: Vec<u32>,
    /// Particles by bucket.
    order: Vec<u32>,
}

/// Where particles go.
pub(super) struct Buckets<'a> {
    plan: &'a Plan,
    root: RootCell,
    spill: &'a Spill,
    buckets: Vec<Mutex<Bucket>>,
    /// Bytes of a particle.
    particle: u64,
    /// Bytes for particles that wait, as many as there may be and as there are.
    most: u64,
    waiting: AtomicU64,
    /// Counts the buckets that have made room for others.
    next: AtomicUsize,
}

impl<'a> Buckets<'a> {
    /// The empty buckets of a plan, for particles with so many columns beside mass, density and smoothing length, which may take `most` bytes
    /// while they wait.
    pub fn new(plan: &'a Plan, root: RootCell, spill: &'a Spill, columns: usize, most: u64) -> Buckets<'a> {
        let empty = || Bucket { columns: Columns::with_capacity(columns, 0), ..Bucket::default() };
        let buckets = (0..plan.len()).map(|_| Mutex::new(empty())).collect();
        let (waiting, next) = (AtomicU64::new(0), AtomicUsize::new(0));
        Buckets { plan, root, spill, buckets, particle: particle_bytes(columns), most, waiting, next }
    }

    /// The buckets with all that has come.
    pub fn filled(self) -> Vec<Bucket> {
        let buckets = self.buckets.into_iter();
        buckets.map(|bucket| bucket.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }

    /// Sends the particles of a chunk to their buckets.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn distribute(
        &self,
        positions: &[[f64; 3]],
        columns: &[&Vec<f32>],
        scratch: &mut Scratch,
    ) -> Result<(), BuildError> {
        let Scratch { places, buckets, ends, order } = scratch;
        places.clear();
        places.extend(positions.iter().map(|&position| Place::of(position, self.root)));
        buckets.clear();
        buckets.extend(places.iter().map(|place| self.plan.bucket(place.key) as u32));
        ends.clear();
        ends.resize(self.buckets.len(), 0);
        buckets.iter().for_each(|&bucket| ends[bucket as usize] += 1);
        let mut end = 0;
        for count in &mut *ends {
            end += std::mem::replace(count, end);
        }
        order.resize(places.len(), 0);
        for (&bucket, i) in buckets.iter().zip(0..) {
            let end = &mut ends[bucket as usize];
            order[*end as usize] = i;
            *end += 1;
        }
        let mut start = 0;
        for (bucket, &end) in self.buckets.iter().zip(&*ends).filter(|(_, end)| **end > 0) {
            let mut rest = &order[start as usize..end as usize];
            start = end;
            if rest.is_empty() {
                continue;
            }
            let mut bucket = bucket.lock().unwrap_or_else(PoisonError::into_inner);
            while !rest.is_empty() {
                let (now, after) = rest.split_at(rest.len().min(RUN - bucket.places.len()));
                let grown = bucket.reserve(now.len()) as u64;
                self.waiting.fetch_add(grown * self.particle, Ordering::Relaxed);
                bucket.places.extend(now.iter().map(|&i| places[i as usize]));
                for (own, column) in bucket.columns.iter_mut().zip(columns) {
                    own.extend(now.iter().map(|&i| column[i as usize]));
                }
                rest = after;
                if bucket.places.len() == RUN {
                    bucket.put_away(self.spill)?;
                }
            }
            drop(bucket);
            self.make_room()?;
        }
        Ok(())
    }

    /// Has buckets put away what waits, in turn, until it takes no more than it may. Each thread makes room for what it brings, so that none
    /// waits for another.
    fn make_room(&self) -> Result<(), BuildError> {
        for _ in &self.buckets {
            if self.waiting.load(Ordering::Relaxed) <= self.most {
                break;
            }
            let next = self.next.fetch_add(1, Ordering::Relaxed) % self.buckets.len();
            let mut bucket = self.buckets[next].lock().unwrap_or_else(PoisonError::into_inner);
            let given = bucket.give_way(self.spill)? as u64;
            self.waiting.fetch_sub(given * self.particle, Ordering::Relaxed);
        }
        Ok(())
    }
}

impl Bucket {
    /// Makes room for so many particles beside those that wait: by how many it has grown.
    fn reserve(&mut self, more: usize) -> usize {
        let (len, before) = (self.places.len(), self.places.capacity());
        if len + more <= before {
            return 0;
        }
        // A power of two, so that it doubles until it takes a run, and no more.
        let room = (len + more).next_power_of_two() - len;
        self.places.reserve_exact(room);
        self.columns.iter_mut().for_each(|column| column.reserve_exact(room));
        self.places.capacity() - before
    }

    /// Puts the particles that wait away.
    fn put_away(&mut self, spill: &Spill) -> Result<(), BuildError> {
        let run = run(&self.places, &self.columns, |parts| spill.put(parts));
        self.runs.push(run.map_err(|error| BuildError::temporary(spill, error))?);
        self.places.clear();
        self.columns.iter_mut().for_each(Vec::clear);
        Ok(())
    }

    /// The same, and gives back their room: for how many.
    fn give_way(&mut self, spill: &Spill) -> Result<usize, BuildError> {
        if !self.places.is_empty() {
            self.put_away(spill)?;
        }
        self.columns.iter_mut().for_each(|column| *column = Vec::new());
        Ok(std::mem::take(&mut self.places).capacity())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Partition;
    use super::*;
    use crate::model::ReadMethod;
    use glam::DVec3;

    const ROOT: RootCell = RootCell { min: DVec3::ZERO, size: 1.0 };

    /// However little room there is, buckets have the particles that belong there, and no more wait than may.
    #[test]
    fn no_more_particles_wait_than_there_is_room_for() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut positions: Vec<[f64; 3]> = (0..20_000).map(|_| [(); 3].map(|()| random())).collect();
        // More than a run in one bucket.
        positions.extend([[0.3; 3]; 3000]);
        let places: Vec<Place> = positions.iter().map(|position| Place::of(*position, ROOT)).collect();
        let mut keys: Vec<u64> = places.iter().map(|place| place.key).collect();
        keys.sort_unstable();
        let plan = Plan::new(&keys, 1.0, 500);
        let mut expected: Vec<Vec<(Place, f32)>> = vec![Vec::new(); plan.len()];
        for (number, place) in places.iter().enumerate() {
            expected[plan.bucket(place.key)].push((*place, number as f32));
        }
        let folder = tempfile::tempdir().unwrap();
        let mut runs = Vec::new();
        for most in [0, 100_000, u64::MAX] {
            let spill = Spill::new(&folder.path().join("out"), folder.path(), 10_000, ReadMethod::default());
            let to = Buckets::new(&plan, ROOT, &spill, 1, most);
            let mut scratch = Scratch::default();
            let mut first = 0;
            for positions in positions.chunks(700) {
                let numbers: Vec<f32> = (first..first + positions.len()).map(|number| number as f32).collect();
                to.distribute(positions, &[&numbers; 4], &mut scratch).unwrap();
                first += positions.len();
                let held = |bucket: &Mutex<Bucket>| {
                    let bucket = bucket.lock().unwrap();
                    let values: usize = bucket.columns.iter().map(Vec::capacity).sum();
                    size_of::<Place>() * bucket.places.capacity() + size_of::<f32>() * values
                };
                let held: usize = to.buckets.iter().map(held).sum();
                assert_eq!(held as u64, to.waiting.load(Ordering::Relaxed));
                assert!(held as u64 <= most, "{held} of {most}");
            }
            let buckets = to.filled();
            runs.push(buckets.iter().map(|bucket| bucket.runs.len()).sum::<usize>());
            let partition = Partition { spill, columns: 1, own: 1, means: Vec::new(), first: 0, buckets };
            for (bucket, expected) in expected.iter().enumerate() {
                let (places, columns) = partition.read(bucket).unwrap();
                assert!(columns.iter().all(|column| *column == columns.mass));
                let mut found: Vec<(Place, f32)> = places.into_iter().zip(columns.mass).collect();
                found.sort_by(|one, other| one.1.total_cmp(&other.1));
                assert!(found == *expected, "bucket {bucket}, {most} bytes");
            }
        }
        // Without a bound only the bucket with more than a run has put some away.
        assert!(runs.is_sorted_by(|more, fewer| more > fewer) && runs[2] >= 2, "{runs:?}");
    }
}
