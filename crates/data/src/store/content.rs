//! What a node draws that is not coded with a family's codebooks.

use crate::codec::Codebook;
use crate::hierarchy::spacetime::Motion;
use crate::model::Bounds;
use std::borrow::Cow;
use std::fmt::Debug;

/// Particles with values of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct Particles {
    /// World positions.
    pub positions: Vec<[f64; 3]>,
    /// Mass, density, smoothing length and the family's attributes: entry `i` is of particle `i`.
    pub values: Codebook,
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
        Particles { positions: which.iter().map(|i| self.positions[*i as usize]).collect(), values }
    }

    /// The box around the positions.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.positions.iter().copied())
    }
}
