//! What a node draws that is not coded with a family's codebooks.

use crate::codec::Codebook;
use crate::hierarchy::pca::Step;
use crate::hierarchy::spacetime::Motion;
use crate::model::{Bounds, Covariance};
use std::borrow::Cow;
use std::fmt::Debug;

/// Particles with values of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct Particles {
    /// World positions.
    pub positions: Vec<[f64; 3]>,
    /// Mass, density, smoothing length and the family's attributes: entry `i` is of particle `i`.
    pub values: Codebook,
    /// Second moments of each where they are ellipsoids, whose smoothing lengths are those of spheres with the same trace; empty else.
    pub covariances: Vec<Covariance>,
}

/// What stands for a cluster in pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Representative {
    /// An ellipsoid with its second moments.
    #[default]
    Ellipsoid,
    /// A ball of equal spread.
    Round,
    /// A ball of the diameter that HE03 gives it (equation 2), of files whose clusters were split as there; else as [`Self::Round`].
    Published,
}

/// A node's clusters, and what these become where splits are undone, in the order in which splits make them: drawn are those for which
/// `from <= limit <= to`, with the limit that [`crate::codec::clusters::cluster_limit`] has for their number.
#[derive(Clone, Debug, PartialEq)]
pub struct ClusterUnions {
    /// Every one that there is for some number.
    pub clusters: Particles,
    /// The first limit with which each is drawn.
    pub from: Vec<u16>,
    /// The last one.
    pub to: Vec<u16>,
}

/// How a node holds what it draws, dispatched once a node: trees that are no page files bring their own.
pub trait Content: Debug + Send + Sync {
    /// What is drawn at a time, in the data's unit: always the same number of particles. What does not change is borrowed.
    fn particles(&self, time: f64) -> Cow<'_, Particles>;

    /// Some of the particles at a time, by their numbers, each of which there is.
    fn some(&self, time: f64, which: &[u32]) -> Particles {
        self.particles(time).some(which)
    }

    /// The particles at every time of the interval in which the node is there, where they move, in the order of
    /// [`Content::particles`].
    fn motion(&self) -> Option<Motion> {
        None
    }

    /// Whether [`Content::motion`] tells of any.
    fn moves(&self) -> bool {
        false
    }

    /// Where it holds clusters about so many of the first, or all, represented in this way: their sums and means are those of all.
    fn clusters(&self, _count: Option<u32>, _representative: Representative) -> Option<Particles> {
        None
    }

    /// Where it holds clusters all that can be drawn of them, for those who choose from it many times.
    fn cluster_unions(&self, _representative: Representative) -> Option<ClusterUnions> {
        None
    }

    /// What a part of the clusters is worth, where it holds clusters.
    fn steps(&self) -> &[Step] {
        &[]
    }

    /// Bytes of memory that it takes.
    fn memory(&self) -> u64;
}

impl Content for Particles {
    fn particles(&self, _time: f64) -> Cow<'_, Particles> {
        Cow::Borrowed(self)
    }

    fn memory(&self) -> u64 {
        let columns = (3 + self.values.attributes.len()) * size_of::<f32>();
        (self.positions.len() * (size_of::<[f64; 3]>() + columns)) as u64
    }
}

impl Particles {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Some of them, by their numbers. Panics if there is none of such a number.
    pub fn some(&self, which: &[u32]) -> Particles {
        let column = |values: &Vec<f32>| which.iter().map(|i| values[*i as usize]).collect();
        let values = Codebook {
            particles: which.len() as u64,
            mass: column(&self.values.mass),
            density: column(&self.values.density),
            smoothing_length: column(&self.values.smoothing_length),
            attributes: self.values.attributes.iter().map(column).collect(),
            errors: self.values.errors.clone(),
            ..self.values
        };
        let positions = which.iter().map(|i| self.positions[*i as usize]).collect();
        let covariances = match self.covariances.is_empty() {
            true => Vec::new(),
            false => which.iter().map(|i| self.covariances[*i as usize]).collect(),
        };
        Particles { positions, values, covariances }
    }

    /// The box around the positions.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.positions.iter().copied())
    }
}
