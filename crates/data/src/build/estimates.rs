//! Smoothing lengths and densities that a source lacks, from the neighbours of each particle, some buckets at a time.
//!
//! The neighbours of a bucket's particles may lie in other buckets. A block of buckets is searched together with what lies around its
//! cells in others; where the distance to a particle's k-th neighbour turns out to reach beyond that, everything inside that distance is
//! gathered and the particle searched for again, across the faces of a periodic box too. So the result is that of a search among all
//! particles, to the last bit: the more memory there is, the larger are the blocks.

use super::BuildError;
use super::found::{self, Block, Finding, Seen, ordered};
use super::partition::Partition;
use super::reach::{Reaches, Surroundings, around_ball, position};
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::octree::{Columns, Place};
use crate::import::neighbours::Neighbours;
use crate::model::Bounds;
use crate::model::progress::{Progress, Uncounted};
use glam::DVec3;
use std::ops::Range;

/// How far around each cell of a block is looked at first, in distances to the k-th neighbour if the cell were filled evenly.
const MARGIN: f64 = 1.3;

/// Particles with world positions relative to the root cell's corner.
struct Particles {
    positions: Vec<[f64; 3]>,
    mass: Vec<f32>,
}

/// How columns are estimated: from how many neighbours, among which particles.
#[derive(Clone, Copy)]
pub(super) struct Estimating<'a> {
    pub k: usize,
    pub surroundings: Surroundings<'a>,
}

impl Estimating<'_> {
    /// Fills in the densities and smoothing lengths of a partition that are not positive, for buckets of about `block` particles at a
    /// time; what is found does not depend on that number.
    ///
    /// # Errors
    /// When particles cannot be read back, or what was found not be put away.
    pub fn estimate(
        self,
        partition: &mut Partition,
        block: usize,
        progress: &dyn Progress,
    ) -> Result<(Seen, Vec<Vec<u64>>), BuildError> {
        let all = partition.numbers();
        let found = found::sum(self.of_buckets(partition, all.clone(), block, progress)?, 2);
        let columns = |columns: Columns| vec![columns.density, columns.smoothing_length];
        let counts = found::counts(partition, all, &found.ranges, columns, progress)?;
        Ok((found, counts))
    }
}

/// Densities, and then smoothing lengths.
impl Finding for Estimating<'_> {
    const STAGE: &'static str = "finding neighbours";

    fn put(partition: &mut Partition, bucket: usize, columns: &[Vec<f32>]) -> Result<(), BuildError> {
        partition.put_estimates(bucket, columns)
    }

    fn of_block(
        &self,
        partition: &Partition,
        buckets: Range<usize>,
        progress: &dyn Progress,
    ) -> Result<Block, BuildError> {
        let place = |place: Place| (place.key, position(place, self.surroundings.root));
        let parts = ordered(buckets.clone(), |bucket| partition.read(bucket), place, progress)?;
        let is_usable = |value: f32| value > 0.0 && value.is_finite();
        let mut places: (Vec<u64>, Vec<[f64; 3]>) = Default::default();
        let (mut orders, mut mass, mut density, mut smoothing_length) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for part in parts {
            progress.go_on();
            places.extend(part.places);
            mass.extend(part.columns.mass);
            density.extend(part.columns.density);
            smoothing_length.extend(part.columns.smoothing_length);
            orders.push(part.order);
        }
        // Particles are counted when all of the block is known.
        let uncounted = Uncounted(progress);
        let (keys, positions) = places;
        let own = Particles { positions, mass };
        let search = Search { partition, buckets, estimating: *self, keys, own, progress: &uncounted };
        let wanted: Vec<bool> = smoothing_length.iter().map(|&h| !is_usable(h)).collect();
        if wanted.contains(&true) {
            search.nearest(&wanted, &mut smoothing_length, &mut density)?;
        }
        let wanted: Vec<bool> = density.iter().map(|&rho| !is_usable(rho)).collect();
        if wanted.contains(&true) {
            search.density(&wanted, &smoothing_length, &mut density)?;
        }
        progress.advance(density.len() as u64);
        Ok(Block { orders, columns: vec![density, smoothing_length] })
    }
}

/// A block and where its neighbours are.
struct Search<'a> {
    partition: &'a Partition,
    buckets: Range<usize>,
    estimating: Estimating<'a>,
    /// Morton keys of the own particles, in order.
    keys: Vec<u64>,
    own: Particles,
    progress: &'a dyn Progress,
}

impl Search<'_> {
    /// Smoothing lengths, and densities where there are none, of the wanted particles.
    fn nearest(&self, wanted: &[bool], lengths: &mut [f32], density: &mut [f32]) -> Result<(), BuildError> {
        let count = self.own.positions.len();
        let covered = self.reaches(self.cells());
        let around = self.others(Some(&covered))?;
        let everything = (count + around.positions.len()) as u64 == self.estimating.surroundings.count;
        let mut left: Vec<bool> = wanted.to_vec();
        let mut radii = vec![0.0; if everything { 0 } else { count }];
        self.search(&self.own, around, wanted, |i, h, rho| {
            if everything {
                (lengths[i], density[i]) = (positive(h), stated(density[i], rho));
                return;
            }
            radii[i] = h;
            if covered.covers(self.own.positions[i], h) {
                left[i] = false;
                (lengths[i], density[i]) = (positive(h), stated(density[i], rho));
            }
        });
        if everything || !left.contains(&true) {
            return Ok(());
        }
        // The true distance is at most what was found, unless there were too few particles to find that many.
        let reaches = if count > self.estimating.k && self.are_apart() {
            let balls = self.own.positions.iter().zip(&radii).zip(&left).filter(|(_, left)| **left);
            Some(self.reaches(balls.map(|((at, radius), _)| around_ball(*at, *radius)).collect()))
        } else {
            None
        };
        let around = self.others(reaches.as_ref())?;
        // Only what the balls of those that are left reach is searched.
        let is_near = |place: [f64; 3]| reaches.as_ref().is_none_or(|reaches| reaches.contains(place));
        let near: Vec<usize> = (0..count).filter(|&i| left[i] || is_near(self.own.positions[i])).collect();
        let own = Particles {
            positions: near.iter().map(|&i| self.own.positions[i]).collect(),
            mass: near.iter().map(|&i| self.own.mass[i]).collect(),
        };
        let wanted: Vec<bool> = near.iter().map(|&i| left[i]).collect();
        self.search(&own, around, &wanted, |i, h, rho| {
            let i = near[i];
            (lengths[i], density[i]) = (positive(h), stated(density[i], rho));
        });
        Ok(())
    }

    /// Densities of the wanted particles within their smoothing lengths.
    fn density(&self, wanted: &[bool], lengths: &[f32], density: &mut [f32]) -> Result<(), BuildError> {
        let radii: Vec<f64> = lengths.iter().map(|&h| f64::from(h)).collect();
        let balls = self.own.positions.iter().zip(&radii).zip(wanted).filter(|(_, wanted)| **wanted);
        let reaches = self.reaches(balls.map(|((at, radius), _)| around_ball(*at, *radius)).collect());
        let around = self.others(Some(&reaches))?;
        let (positions, mass, count) = joined(&self.own, around);
        let mut all: Vec<f32> = lengths.to_vec();
        all.resize(positions.len(), 0.0);
        let mut all_wanted = wanted.to_vec();
        all_wanted.resize(positions.len(), false);
        if let Some(tree) = Neighbours::of(&positions, self.estimating.surroundings.edge, self.progress) {
            let sums = tree.density(&all, &mass, Some(&all_wanted), self.progress);
            for (i, sum) in sums.into_iter().take(count).enumerate().filter(|(i, _)| wanted[*i]) {
                density[i] = positive(sum);
            }
        }
        Ok(())
    }

    /// Whether the own particles are not all in one place, of a periodic box.
    fn are_apart(&self) -> bool {
        let size = Bounds::of(self.own.positions.iter().copied()).size().to_array();
        let edge = self.estimating.surroundings.edge;
        let is_edge = |size: f64| edge.is_some_and(|edge| (size - edge).abs() <= 1e-9 * edge);
        size.into_iter().any(|size| size > 0.0 && !is_edge(size))
    }

    fn reaches(&self, boxes: Vec<Bounds>) -> Reaches {
        Reaches::of(boxes, &self.estimating.surroundings)
    }

    /// Boxes in which most of the neighbours of the own particles lie: around cells with a few times `k` of them at most.
    fn cells(&self) -> Vec<Bounds> {
        let Estimating { k, surroundings: Surroundings { root, .. } } = self.estimating;
        let most = 2 * k.max(8);
        let mut boxes = Vec::new();
        let mut waiting = vec![(0, 0..self.keys.len())];
        while let Some((depth, range)) = waiting.pop() {
            let bits = 3 * (MORTON_BITS - depth);
            if range.len() > most && depth < MORTON_BITS {
                let mut from = range.start;
                while from < range.end {
                    let octant = self.keys[from] >> (bits - 3);
                    let to = from + self.keys[from..range.end].partition_point(|&key| key >> (bits - 3) <= octant);
                    waiting.push((depth + 1, from..to));
                    from = to;
                }
            } else if !range.is_empty() {
                let size = root.size * (-f64::from(depth)).exp2();
                let corner = morton::decode(self.keys[range.start] >> bits).map(f64::from);
                let min = DVec3::from_array(corner) * size;
                let margin = MARGIN * size * (k as f64 / (4.18 * range.len() as f64)).cbrt();
                boxes.push(Bounds { min: min - margin, max: min + size + margin });
            }
        }
        boxes
    }

    /// The particles of other buckets that are within reach; all of them without.
    fn others(&self, reaches: Option<&Reaches>) -> Result<Particles, BuildError> {
        let surroundings = &self.estimating.surroundings;
        let is_near = |place: [f64; 3]| reaches.is_none_or(|reaches| reaches.contains(place));
        let parts = surroundings.beside(&self.buckets, self.partition, reaches, |partition, bucket| {
            self.progress.go_on();
            let (places, masses) = partition.read_masses(bucket)?;
            let positions = places.into_iter().map(|place| position(place, surroundings.root));
            Ok(positions.zip(masses).filter(|(place, _)| is_near(*place)).collect::<Vec<_>>())
        })?;
        let (positions, mass) = parts.into_iter().flatten().unzip();
        Ok(Particles { positions, mass })
    }

    /// Calls `found` with distance to the `k`-th neighbour and density of every wanted particle of `own`, among those and others.
    fn search(&self, own: &Particles, around: Particles, wanted: &[bool], mut found: impl FnMut(usize, f64, f64)) {
        let Estimating { k, surroundings: Surroundings { edge, .. } } = self.estimating;
        let (positions, mass, count) = joined(own, around);
        let mut all_wanted = wanted.to_vec();
        all_wanted.resize(positions.len(), false);
        if let Some(tree) = Neighbours::of(&positions, edge, self.progress) {
            drop(positions);
            let estimates = tree.estimate(k, &mass, Some(&all_wanted), self.progress);
            for (i, estimate) in estimates.into_iter().take(count).enumerate().filter(|(i, _)| wanted[*i]) {
                found(i, estimate.smoothing_length, estimate.density);
            }
        }
    }
}

/// Some particles, then others; and the number of the former.
fn joined(own: &Particles, around: Particles) -> (Vec<[f64; 3]>, Vec<f32>, usize) {
    let positions = [&own.positions[..], &around.positions].concat();
    let mass = [&own.mass[..], &around.mass].concat();
    (positions, mass, own.positions.len())
}

/// A density that the source states, or the estimate.
fn stated(density: f32, estimate: f64) -> f32 {
    if density > 0.0 && density.is_finite() { density } else { positive(estimate) }
}

/// The nearest positive finite `f32`.
fn positive(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}
