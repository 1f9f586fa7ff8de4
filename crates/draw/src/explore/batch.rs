//! Particles that answer a question, handed over in runs of bounded length, wherever they come from.

use super::error::ExploreError;
use crate::codec::QuantityError;
use crate::model::Progress;
use glam::DVec3;
use std::sync::atomic::{AtomicBool, Ordering};

/// A run of particles of one family that are members of what was asked for: columns of one length.
#[derive(Clone, Debug, Default)]
pub struct Batch<'a> {
    /// Index of the family in the data.
    pub family: usize,
    /// World positions, as the data has them.
    pub positions: Vec<DVec3>,
    /// From the region's reference to the particle's nearest image: [`super::Shapes::relative`].
    pub relative: Vec<DVec3>,
    /// Masses.
    pub mass: Vec<f64>,
    /// The columns that were asked for, in that order; empty where the family has no such field.
    pub columns: Vec<Vec<f64>>,
    /// Velocities; empty where they were not asked for or the data has none.
    pub velocities: Vec<DVec3>,
    /// Row of each particle in its family (source), or a number that tells it apart from others (page file).
    pub keys: Vec<u64>,
    /// Ids; empty where they were not asked for.
    pub ids: Vec<u64>,
    /// All fields of the source's rows, where they were asked for: by field of the family, `components` values each row.
    pub rows: Vec<Vec<f64>>,
    /// What of the leaf's answer is not certain.
    pub uncertain: Uncertain,
    /// Errors of the codebook that values come from: mass, density, smoothing length, attributes. Empty for a source.
    pub errors: &'a [QuantityError],
}

impl Batch<'_> {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }

    pub(super) fn clear(&mut self, columns: usize) {
        self.positions.clear();
        self.relative.clear();
        self.mass.clear();
        self.columns.resize_with(columns, Vec::new);
        self.columns.iter_mut().for_each(Vec::clear);
        self.velocities.clear();
        self.keys.clear();
        self.ids.clear();
        self.rows.clear();
        self.uncertain = Uncertain::default();
    }
}

/// Particles of a page file that may be inside or outside: their rounded positions are nearer to the region's surface than the
/// rounding, or their coded values nearer to the end of a range than the codebook's largest error.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Uncertain {
    /// How many.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Largest rounding of a coordinate in the leaves that were looked into, world units.
    pub position: f64,
}

impl Uncertain {
    /// Adds what another run is not certain of.
    pub fn add(&mut self, other: &Uncertain) {
        self.count += other.count;
        self.mass += other.mass;
        self.position = self.position.max(other.position);
    }

    /// As though each particle had been there so many times.
    pub(super) fn scaled(self, factor: f64) -> Uncertain {
        let count = (factor * self.count as f64).round() as u64;
        Uncertain { count, mass: factor * self.mass, position: self.position }
    }
}

/// What is done with the particles. Runs are worked on in parallel, each into a part of its own; the parts are joined in the data's
/// order, so that an answer does not depend on the number of threads.
pub trait Gather: Sync {
    /// What comes of a run.
    type Part: Send;

    /// Of no particles.
    fn part(&self) -> Self::Part;

    /// Takes a run of particles.
    fn take(&self, part: &mut Self::Part, batch: &Batch);

    /// Takes a whole node of a page file by its exact sums: how many particles, and their mass. Only called where
    /// [`Gather::takes_nodes`].
    fn take_node(&self, _part: &mut Self::Part, _family: usize, _count: u64, _mass: f64) {}

    /// Whether sums over whole nodes are enough.
    fn takes_nodes(&self) -> bool {
        false
    }

    /// Joins what comes next.
    ///
    /// # Errors
    /// When it cannot be written to where it belongs.
    fn join(&self, whole: &mut Self::Part, next: Self::Part) -> Result<(), ExploreError>;
}

/// The caller's side of long work: told of its progress, and able to stop it.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    /// Hears how many particles have been dealt with.
    pub progress: &'a dyn Progress,
    /// Set by whoever no longer wants the answer.
    pub stop: &'a AtomicBool,
}

static NEVER: AtomicBool = AtomicBool::new(false);

impl Work<'static> {
    /// Nobody listens and nobody stops it.
    pub fn quiet() -> Work<'static> {
        Work { progress: &(), stop: &NEVER }
    }
}

impl<'a> Work<'a> {
    /// Work that nobody stops.
    pub fn told(progress: &'a dyn Progress) -> Work<'a> {
        Work { progress, stop: &NEVER }
    }

    /// # Errors
    /// [`ExploreError::Stopped`] where it was stopped.
    pub(super) fn go_on(&self) -> Result<(), ExploreError> {
        if self.stop.load(Ordering::Relaxed) { Err(ExploreError::Stopped) } else { Ok(()) }
    }
}
