//! Attributes that are derived from how the neighbours of each particle move, some buckets at a time.
//!
//! The neighbours of a bucket's particles may lie in other buckets. As with [`super::estimates`], a block of buckets is searched together
//! with everything in others that its particles' smoothing lengths reach, across the faces of a periodic box too, so that the result is that
//! of a search among all particles, to the last bit; one search serves all quantities.

use super::BuildError;
use super::found::{self, Block, Finding, Ordered, Seen, ordered};
use super::partition::Partition;
use super::reach::{Reaches, Surroundings, around_ball, position};
use crate::hierarchy::octree::{Columns, Place};
use crate::import::derived;
use crate::import::neighbours::Moving;
use crate::model::progress::{Progress, Uncounted};
use crate::model::{Bounds, Derivation, Kernel};
use std::ops::Range;

/// Particles with world positions relative to the root cell's corner.
#[derive(Default)]
struct Particles {
    positions: Vec<[f64; 3]>,
    mass: Vec<f32>,
    density: Vec<f32>,
    smoothing_length: Vec<f32>,
    velocities: Vec<[f64; 3]>,
}

/// How columns are derived: what, with which kernel, beside how many attributes, among which particles.
#[derive(Clone, Copy)]
pub(super) struct Deriving<'a> {
    pub derivation: &'a Derivation,
    pub kernel: Kernel,
    pub own: usize,
    pub surroundings: Surroundings<'a>,
}

impl Deriving<'_> {
    /// Adds the derived columns to a partition whose densities and smoothing lengths are complete, for buckets of about `block`
    /// particles at a time; what is found does not depend on that number.
    ///
    /// # Errors
    /// When particles cannot be read back, or what was found not be put away.
    pub fn derive(
        &self,
        partition: &mut Partition,
        block: usize,
        progress: &dyn Progress,
    ) -> Result<(Seen, Vec<Vec<u64>>), BuildError> {
        let all = partition.numbers();
        let found = found::sum(self.of_buckets(partition, all.clone(), block, progress)?, self.number());
        partition.derived(found.means());
        let counts = found::counts(partition, all, &found.ranges, |columns| columns.attributes, progress)?;
        Ok((found, counts))
    }

    /// Number of derived columns.
    fn number(&self) -> usize {
        self.derivation.quantities.len()
    }

    /// Appends the particles of other buckets that are within reach.
    fn add_others(
        &self,
        partition: &Partition,
        buckets: Range<usize>,
        reaches: &Reaches,
        all: &mut Particles,
    ) -> Result<(), BuildError> {
        let parts = self.surroundings.beside(&buckets, partition, Some(reaches), |partition, bucket| {
            let (places, columns) = partition.read_inputs(bucket)?;
            Ok(self.within(reaches, &places, &columns))
        })?;
        for part in parts {
            all.positions.extend(part.positions);
            all.mass.extend(part.mass);
            all.density.extend(part.density);
            all.smoothing_length.extend(part.smoothing_length);
            all.velocities.extend(part.velocities);
        }
        Ok(())
    }

    /// Those particles of a bucket that are within reach.
    fn within(&self, reaches: &Reaches, places: &[Place], columns: &Columns) -> Particles {
        let root = self.surroundings.root;
        let is_near = |&i: &u32| reaches.contains(position(places[i as usize], root));
        let near: Vec<u32> = (0..places.len() as u32).filter(is_near).collect();
        let columns = columns.gather(&near);
        Particles {
            positions: near.iter().map(|&i| position(places[i as usize], root)).collect(),
            velocities: derived::velocities(&columns.attributes[self.own..]),
            mass: columns.mass,
            density: columns.density,
            smoothing_length: columns.smoothing_length,
        }
    }
}

impl Finding for Deriving<'_> {
    const STAGE: &'static str = "looking at motion";

    fn put(partition: &mut Partition, bucket: usize, columns: &[Vec<f32>]) -> Result<(), BuildError> {
        partition.put_derived(bucket, columns)
    }

    fn of_block(
        &self,
        partition: &Partition,
        buckets: Range<usize>,
        progress: &dyn Progress,
    ) -> Result<Block, BuildError> {
        let Surroundings { root, edge, plan, .. } = self.surroundings;
        let place = |place: Place| position(place, root);
        let parts = ordered(buckets.clone(), |bucket| partition.read_inputs(bucket), place, progress)?;
        let mut all = Particles::default();
        let mut heat: Vec<f32> = Vec::new();
        let mut orders = Vec::new();
        for Ordered { order, places, columns } in parts {
            let inputs = &columns.attributes[self.own..];
            all.velocities.extend(derived::velocities(inputs));
            heat.extend(inputs.get(Derivation::COMPONENTS).into_iter().flatten());
            all.positions.extend(places);
            all.mass.extend(columns.mass);
            all.density.extend(columns.density);
            all.smoothing_length.extend(columns.smoothing_length);
            orders.push(order);
        }
        let count = all.positions.len();
        if self.derivation.needs_neighbours() && buckets.len() < plan.len() {
            let balls = all.positions.iter().zip(&all.smoothing_length);
            let balls: Vec<Bounds> = balls.map(|(at, &h)| around_ball(*at, Moving::reach(h, edge))).collect();
            let reaches = Reaches::of(balls, &self.surroundings);
            self.add_others(partition, buckets, &reaches, &mut all)?;
        }
        let moving = Moving {
            positions: &all.positions,
            mass: &all.mass,
            density: &all.density,
            smoothing_length: &all.smoothing_length,
            velocities: &all.velocities,
            edge,
        };
        let wanted = (count, Some(&heat[..]));
        let columns = derived::columns(self.derivation, self.kernel, &moving, wanted, &Uncounted(progress));
        progress.advance(count as u64);
        Ok(Block { orders, columns })
    }
}
