//! How far the surroundings of some particles reach: which others a search for neighbours takes in.

use super::partition::Partition;
use crate::hierarchy::RootCell;
use crate::hierarchy::octree::Place;
use crate::model::Bounds;
use crate::model::periodic::images;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Cells along each axis of the grid that says where the balls of some particles reach.
const CELLS: usize = 128;
/// Share of a periodic box by which an image's place may be rounded.
const ROUNDING: f64 = 1e-14;

/// A place in world units from the root cell's corner: the same number whichever block it is read for.
pub(super) fn position(place: Place, root: RootCell) -> [f64; 3] {
    place.unit().map(|x| x * root.size)
}

/// The box around a ball.
pub(super) fn around_ball(at: [f64; 3], radius: f64) -> Bounds {
    let (at, radius) = (DVec3::from_array(at), radius * (1.0 + 1e-9));
    Bounds { min: at - radius, max: at + radius }
}

/// The box around the particles of a bucket, from the root cell's corner; `None` if there are none.
fn bucket_bounds(partition: &Partition, bucket: usize, root: RootCell) -> Option<Bounds> {
    let (low, high) = partition.extent(bucket)?;
    Some(Bounds { min: DVec3::from_array(low) * root.size, max: DVec3::from_array(high) * root.size })
}

/// The buckets beside some that have particles within reach; all of them without.
pub(super) fn beside(
    own: &Range<usize>,
    partition: &Partition,
    root: RootCell,
    reaches: Option<&Reaches>,
) -> impl ParallelIterator<Item = usize> {
    let is_reached = move |bucket: &usize| {
        let Some(bounds) = bucket_bounds(partition, *bucket, root) else { return false };
        !own.contains(bucket) && reaches.is_none_or(|reaches| reaches.meet(bounds))
    };
    (0..partition.buckets()).into_par_iter().filter(is_reached)
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
    /// Of boxes among the particles of a partition.
    pub fn of(mut boxes: Vec<Bounds>, partition: &Partition, root: RootCell, edge: Option<f64>) -> Reaches {
        let rounding = ROUNDING * edge.unwrap_or(0.0);
        for own in &mut boxes {
            *own = Bounds { min: own.min - rounding, max: own.max + rounding };
        }
        let own = Reach::of(&boxes);
        let buckets = (0..partition.buckets()).filter_map(|bucket| bucket_bounds(partition, bucket, root));
        let everything = buckets.fold(Bounds::EMPTY, Bounds::union);
        // Cells may reach farther than the boxes, but within the box around all of them.
        let has_particles = |image: &DVec3| meet(own.bounds.moved(*image), everything);
        Reaches { images: images(edge).into_iter().filter(has_particles).collect(), own, rounding }
    }

    /// Whether a box may have places within reach.
    fn meet(&self, bounds: Bounds) -> bool {
        self.images.iter().any(|image| meet(self.own.bounds.moved(*image), bounds))
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

    /// The cells that a box inside of the bounds meets, in runs.
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
