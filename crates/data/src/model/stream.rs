//! Particles of a family in chunks, wherever they come from: what a build reads that does not fit in memory.

use super::{Bounds, Derivation, Family, FamilyName, PeriodicBox, Unit};

/// Why particles could not be read.
pub type StreamError = Box<dyn std::error::Error + Send + Sync>;

/// A run of particles: one column for each quantity, all of the same length. See [`Family`] for what they mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chunk {
    /// World positions.
    pub positions: Vec<[f64; 3]>,
    /// Masses.
    pub mass: Vec<f32>,
    /// Densities.
    pub density: Vec<f32>,
    /// Smoothing lengths.
    pub smoothing_length: Vec<f32>,
    /// The attributes, in the stream's order, and after them the columns that a derivation takes.
    pub attributes: Vec<Vec<f32>>,
}

impl Chunk {
    /// What tells all values of the chunk of this number from others. Sums of chunks tell a family, in whatever order they are read.
    pub fn checksum(&self, number: usize) -> u64 {
        let quantities = [&self.mass, &self.density, &self.smoothing_length];
        let columns = quantities.into_iter().chain(&self.attributes);
        let positions = bytemuck::cast_slice(&self.positions);
        let crc = crc32c::crc32c_append(crc32c::crc32c(&(number as u64).to_le_bytes()), positions);
        columns.fold(crc, |crc, column| crc32c::crc32c_append(crc, bytemuck::cast_slice(column))).into()
    }
}

/// A family that is read more often than once, by several threads, in chunks that are the same each time.
pub trait ParticleStream: Sync {
    /// Which family.
    fn family(&self) -> FamilyName;

    /// Name and unit of each attribute.
    fn attributes(&self) -> &[(String, Unit)];

    /// Number of particles at most.
    fn particles(&self) -> u64;

    /// Number of chunks.
    fn chunks(&self) -> usize;

    /// Where densities and smoothing lengths may be `NaN`, because the source does not say: of how many neighbours they are to be
    /// estimated.
    fn neighbours(&self) -> Option<usize> {
        None
    }

    /// Edge of the box that the source states.
    fn box_size(&self) -> Option<f64> {
        None
    }

    /// Edge of the periodic box, if the family's particles, which lie within these bounds, lie in the box that the source states.
    fn periodic_edge(&self, bounds: Bounds) -> Option<f64> {
        PeriodicBox::of(self.box_size(), bounds).map(|periodic| periodic.edge)
    }

    /// What is to be derived once all particles are known.
    fn derivation(&self) -> Option<&Derivation> {
        None
    }

    /// Name and unit of each attribute that is known in the end: those that are derived, then [`ParticleStream::attributes`].
    fn all_attributes(&self) -> Vec<(String, Unit)> {
        let derived = self.derivation().into_iter().flat_map(Derivation::attributes);
        derived.chain(self.attributes().iter().cloned()).collect()
    }

    /// Columns of a chunk's attributes: those of [`ParticleStream::attributes`], then those that the derivation takes, which may have
    /// values that are not finite.
    fn columns(&self) -> usize {
        self.attributes().len() + self.derivation().map_or(0, Derivation::inputs)
    }

    /// Reads a chunk, replacing what `into` holds.
    ///
    /// # Errors
    /// When the source cannot be read or breaks a promise.
    fn read(&self, chunk: usize, into: &mut Chunk) -> Result<(), StreamError>;
}

/// Particles of a chunk of a family in memory.
const CHUNK: usize = 1 << 16;

/// A family in memory as a stream.
#[derive(Debug)]
pub struct FamilyStream<'a> {
    family: &'a Family,
    attributes: Vec<(String, Unit)>,
}

impl<'a> FamilyStream<'a> {
    /// Streams a family whose columns have one length.
    pub fn new(family: &'a Family) -> FamilyStream<'a> {
        let about = family.attributes.iter().map(|attribute| (attribute.name.clone(), attribute.unit.clone()));
        FamilyStream { family, attributes: about.collect() }
    }
}

impl ParticleStream for FamilyStream<'_> {
    fn family(&self) -> FamilyName {
        self.family.name
    }

    fn attributes(&self) -> &[(String, Unit)] {
        &self.attributes
    }

    fn particles(&self) -> u64 {
        self.family.len() as u64
    }

    fn chunks(&self) -> usize {
        self.family.len().div_ceil(CHUNK)
    }

    fn read(&self, chunk: usize, into: &mut Chunk) -> Result<(), StreamError> {
        let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(self.family.len());
        let column = |values: &Vec<f32>| values[range.clone()].to_vec();
        *into = Chunk {
            positions: self.family.positions[range.clone()].to_vec(),
            mass: column(&self.family.mass),
            density: column(&self.family.density),
            smoothing_length: column(&self.family.smoothing_length),
            attributes: self.family.attributes.iter().map(|attribute| column(&attribute.values)).collect(),
        };
        Ok(())
    }
}
