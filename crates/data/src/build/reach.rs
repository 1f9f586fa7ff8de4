//! How far the surroundings of some particles reach: which others a search for neighbours takes in.

use super::BuildError;
use super::partition::Partition;
use crate::codec::morton::{self, MORTON_BITS};
use crate::hierarchy::RootCell;
use crate::hierarchy::octree::{Place, Plan};
use crate::model::Bounds;
use crate::model::periodic::images;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Cells along each axis of the grid that says where the balls of some particles reach.
const CELLS: usize = 128;
/// Share of a periodic box by which an image's place may be rounded.
const ROUNDING: f64 = 1e-14;
/// Share of the root cell by which places may be rounded, with room to spare.
const PLACE_ROUNDING: f64 = 1e-9;

/// A place in world units from the root cell's corner: the same number whichever block it is read for.
pub(super) fn position(place: Place, root: RootCell) -> [f64; 3] {
    place.unit().map(|x| x * root.size)
}

/// The box around a ball.
pub(super) fn around_ball(at: [f64; 3], radius: f64) -> Bounds {
    let (at, radius) = (DVec3::from_array(at), radius * (1.0 + 1e-9));
    Bounds { min: at - radius, max: at + radius }
}

/// Who knows of the buckets that are not at hand: gives a group of them, which one is in.
pub(super) type Others<'a> = dyn Fn(usize) -> Result<Arc<Partition>, BuildError> + Sync + 'a;

/// What is known of all particles among which neighbours are looked for, whoever has them.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'a> {
    pub plan: &'a Plan,
    pub root: RootCell,
    /// Edge of the periodic box.
    pub edge: Option<f64>,
    /// The box around the particles, world coordinates.
    pub bounds: Bounds,
    /// Their number.
    pub count: u64,
    /// Of the buckets that a partition has not; `None` where it has all.
    pub others: Option<&'a Others<'a>>,
}

impl Surroundings<'_> {
    /// What `read` makes of each bucket beside some that may have particles within reach; of all without. Of those that the partition has not
    /// one group is asked for at a time.
    ///
    /// # Errors
    /// When something cannot be read back.
    pub fn beside<T: Send>(
        &self,
        own: &Range<usize>,
        partition: &Partition,
        reaches: Option<&Reaches>,
        read: impl Fn(&Partition, usize) -> Result<T, BuildError> + Sync,
    ) -> Result<Vec<T>, BuildError> {
        let is_reached = |bucket: &usize| {
            let meets = |reaches: &Reaches| self.boxes(*bucket).any(|bounds| reaches.meet(bounds));
            !own.contains(bucket) && reaches.is_none_or(meets)
        };
        let reached: Vec<usize> = (0..self.plan.len()).into_par_iter().filter(is_reached).collect();
        let mut left = &reached[..];
        let mut all = Vec::with_capacity(left.len());
        while let Some(&bucket) = left.first() {
            let has_it = partition.numbers().contains(&bucket);
            let group = self.others.filter(|_| !has_it).map(|others| others(bucket)).transpose()?;
            let group = group.as_deref().unwrap_or(partition);
            let (now, later) = left.split_at(left.partition_point(|bucket| *bucket < group.numbers().end));
            let found: Vec<T> = now.par_iter().map(|bucket| read(group, *bucket)).collect::<Result<_, _>>()?;
            all.extend(found);
            left = later;
        }
        Ok(all)
    }

    /// The box around all particles, from the root cell's corner.
    fn everything(&self) -> Bounds {
        let Surroundings { root, bounds, .. } = self;
        let slack = PLACE_ROUNDING * root.size;
        Bounds { min: bounds.min - root.min - slack, max: bounds.max - root.min + slack }
    }

    /// Boxes in which all particles of a bucket are, from the root cell's corner: its cells, as far as there are particles.
    fn boxes(&self, bucket: usize) -> impl Iterator<Item = Bounds> {
        let everything = self.everything();
        let size = self.root.size;
        let of_cell = move |(depth, key): (u32, u64)| {
            let corner = DVec3::from_array(morton::decode(key >> (3 * (MORTON_BITS - depth))).map(f64::from));
            let size = size * (-f64::from(depth)).exp2();
            Bounds { min: (corner * size).max(everything.min), max: ((corner + 1.0) * size).min(everything.max) }
        };
        self.plan.cells(bucket).map(of_cell).filter(|bounds| !bounds.is_empty())
    }
}

/// Whether two boxes have a place in common.
fn meet(one: Bounds, other: Bounds) -> bool {
    one.min.cmple(other.max).all() && other.min.cmple(one.max).all()
}

/// Where some boxes reach, and those of their images in a periodic box that particles may be in.
pub(super) struct Reaches {
    own: Reach,
    /// By how much those images lie beside the boxes.
    images: Vec<DVec3>,
    /// By how much places of images may be rounded.
    rounding: f64,
}

impl Reaches {
    /// Of boxes among particles.
    pub fn of(mut boxes: Vec<Bounds>, surroundings: &Surroundings<'_>) -> Reaches {
        let edge = surroundings.edge;
        let rounding = ROUNDING * edge.unwrap_or(0.0);
        for own in &mut boxes {
            *own = Bounds { min: own.min - rounding, max: own.max + rounding };
        }
        let own = Reach::of(&boxes);
        let everything = surroundings.everything();
        // Cells may reach farther than the boxes, but within the box around all of them.
        let has_particles = |image: &DVec3| meet(own.bounds.moved(*image), everything);
        Reaches { images: images(edge).into_iter().filter(has_particles).collect(), own, rounding }
    }

    /// Whether a box may have places within reach.
    fn meet(&self, bounds: Bounds) -> bool {
        self.images.iter().any(|image| self.own.meets(bounds.moved(-*image)))
    }

    /// Whether a place is within reach.
    pub fn contains(&self, at: [f64; 3]) -> bool {
        self.images.iter().any(|image| self.own.contains(DVec3::from_array(at) - *image))
    }

    /// Whether all of a ball is where the boxes reach, so that whoever is in it is within reach, or an image is.
    pub fn covers(&self, at: [f64; 3], radius: f64) -> bool {
        self.own.covers(at, radius + self.rounding)
    }
}

/// Where some boxes reach, on a coarse grid: never less than they do.
struct Reach {
    bounds: Bounds,
    step: DVec3,
    cells: Vec<bool>,
}

impl Reach {
    fn of(boxes: &[Bounds]) -> Reach {
        let bounds = boxes.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        let step = (bounds.size() / CELLS as f64).max(DVec3::splat(f64::MIN_POSITIVE));
        let mut reach = Reach { bounds, step, cells: vec![false; CELLS * CELLS * CELLS] };
        for own in boxes {
            for row in reach.rows(own) {
                reach.cells[row].fill(true);
            }
        }
        reach
    }

    /// Whether a box may have places where the boxes reach.
    fn meets(&self, other: Bounds) -> bool {
        meet(self.bounds, other) && self.rows(&other).any(|row| self.cells[row].contains(&true))
    }

    /// The cells that a box meets, in runs.
    fn rows(&self, own: &Bounds) -> impl Iterator<Item = std::ops::RangeInclusive<usize>> + use<> {
        let (low, high) = (self.cell(own.min), self.cell(own.max));
        let rows = (low[2]..=high[2]).flat_map(move |z| (low[1]..=high[1]).map(move |y| (z * CELLS + y) * CELLS));
        rows.map(move |row| row + low[0]..=row + high[0])
    }

    /// Whether all of a ball is where the boxes reach.
    fn covers(&self, at: [f64; 3], radius: f64) -> bool {
        let ball = around_ball(at, radius);
        let is_inside = ball.min.cmpge(self.bounds.min).all() && ball.max.cmple(self.bounds.max).all();
        is_inside && self.rows(&ball).all(|row| self.cells[row].iter().all(|&cell| cell))
    }

    fn cell(&self, at: DVec3) -> [usize; 3] {
        // The saturating cast puts what rounding leaves outside into the first and last cells.
        ((at - self.bounds.min) / self.step).to_array().map(|x| (x as usize).min(CELLS - 1))
    }

    fn contains(&self, at: DVec3) -> bool {
        let [x, y, z] = self.cell(at);
        self.bounds.contains(at) && self.cells[(z * CELLS + y) * CELLS + x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::spill::Spill;
    use crate::model::ReadMethod;
    use proptest::prelude::*;
    use std::path::Path;
    use std::sync::Mutex;

    const ROOT: RootCell = RootCell { min: DVec3::new(-2.0, 1.0, 0.5), size: 3.0 };

    /// Places in the root cell at these shares of an edge, and how they are cut into buckets of so many.
    fn cut(shares: &[[f64; 3]], edge: f64, most: usize) -> (Vec<Place>, Plan, Bounds) {
        let world: Vec<[f64; 3]> =
            shares.iter().map(|share| (ROOT.min + edge * DVec3::from_array(*share)).to_array()).collect();
        let places: Vec<Place> = world.iter().map(|at| Place::of(*at, ROOT)).collect();
        let mut keys: Vec<u64> = places.iter().map(|place| place.key).collect();
        keys.sort_unstable();
        (places, Plan::new(&keys, 1.0, most), Bounds::of(world))
    }

    /// The buckets that are read beside some, and the groups of `each` buckets that were asked for.
    fn read(
        own: &Range<usize>,
        surroundings: Surroundings<'_>,
        reaches: Option<&Reaches>,
        each: usize,
    ) -> (Vec<usize>, Vec<usize>) {
        let plan = surroundings.plan;
        let partition = |group: usize| {
            let spill = Spill::new(Path::new("out"), Path::new(""), 0, ReadMethod::default());
            Partition::of_group(spill, (0, 0), plan, group * each..plan.len().min((group + 1) * each))
        };
        let asked = Mutex::new(Vec::new());
        let others = |bucket: usize| {
            asked.lock().unwrap().push(bucket / each);
            Ok::<_, BuildError>(Arc::new(partition(bucket / each)))
        };
        let surroundings = Surroundings { others: Some(&others), ..surroundings };
        let mine = partition(own.start / each);
        let read = surroundings.beside(own, &mine, reaches, |partition, bucket| {
            assert!(partition.numbers().contains(&bucket));
            Ok(bucket)
        });
        let read = read.unwrap();
        (read, asked.into_inner().unwrap())
    }

    proptest! {
        #![proptest_config(crate::cases::cases(64))]

        /// Also across the faces of a periodic box. A group is asked for once, and never one's own.
        #[test]
        fn whoever_is_within_reach_is_in_a_bucket_that_is_read(
            shares in prop::collection::vec(prop::array::uniform3(0.0..1.0_f64), 50..300),
            balls in prop::collection::vec((any::<prop::sample::Index>(), 0.001..0.3_f64), 1..4),
            is_periodic: bool,
            each in 1..20_usize,
        ) {
            let (places, plan, bounds) = cut(&shares, 2.5, 10);
            let (count, edge) = (places.len() as u64, is_periodic.then_some(2.5));
            let surroundings = Surroundings { plan: &plan, root: ROOT, edge, bounds, count, others: None };
            let at = |place: &Place| position(*place, ROOT);
            let boxes = balls.iter().map(|(ball, radius)| around_ball(at(ball.get(&places)), *radius)).collect();
            let reaches = Reaches::of(boxes, &surroundings);
            let first = plan.bucket(balls[0].0.get(&places).key);
            let own = first..first + 1;
            let (found, asked) = read(&own, surroundings, Some(&reaches), each);
            prop_assert!(found.is_sorted_by(|a, b| a < b) && asked.is_sorted_by(|a, b| a < b));
            prop_assert!(!asked.contains(&(first / each)));
            for place in places.iter().filter(|place| reaches.contains(at(place))) {
                let bucket = plan.bucket(place.key);
                prop_assert!(own.contains(&bucket) || found.contains(&bucket));
            }
            let (found, _) = read(&own, surroundings, None, each);
            prop_assert!(found.into_iter().eq((0..plan.len()).filter(|bucket| *bucket != first)));
        }
    }

    /// Of what is far away nothing is asked for: here a group is an octant, of eight buckets of eight particles.
    #[test]
    fn groups_that_are_far_away_are_left_alone() {
        let shares: Vec<[f64; 3]> =
            (0..512).map(|i| [i % 8, i / 8 % 8, i / 64].map(|x| (f64::from(x) + 0.5) / 8.0)).collect();
        let (places, plan, bounds) = cut(&shares, ROOT.size, 8);
        assert_eq!(plan.len(), 64);
        let surroundings = Surroundings { plan: &plan, root: ROOT, edge: None, bounds, count: 512, others: None };
        let read_around = |at: [f64; 3], own: usize| {
            let reaches = Reaches::of(vec![around_ball(at, 0.01)], &surroundings);
            read(&(own..own + 1), surroundings, Some(&reaches), 8)
        };
        assert_eq!(read_around(position(places[0], ROOT), 0), (Vec::<usize>::new(), Vec::<usize>::new()));
        // In the middle all octants meet, each in the bucket that is the farthest one of its corner.
        let octants: Vec<usize> = (1..8).collect();
        let inner: Vec<usize> = octants.iter().map(|octant| 8 * octant + 7 - octant).collect();
        assert_eq!(read_around([0.5 * ROOT.size; 3], 7), (inner, octants));
    }
}
