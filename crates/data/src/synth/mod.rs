//! Seeded synthetic snapshots, images and volumes of any size, for benchmarks and tests.
//!
//! Every particle and every sample follows from the seed and its index alone, by integer arithmetic, the four basic operations and
//! square roots, which IEEE 754 defines to the last bit, and by functions of the crate `libm`, which are made of these:
//! the same bytes on any machine, for any number of threads.

pub mod cloud;
pub mod clusters;
pub mod cosmology;
pub mod filaments;
pub mod files;
pub mod gadget;
pub mod grid_files;
pub mod grids;
pub mod merger;
pub mod moving;
pub mod random;

use crate::model::{Attribute, Bounds, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use rayon::prelude::*;
use std::ops::Range;

/// Particles that are generated together.
pub const CHUNK: u64 = 1 << 16;

/// Particles of one chunk, structure of arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chunk {
    /// Positions; within the box where there is one.
    pub positions: Vec<[f32; 3]>,
    /// Velocities, km/s.
    pub velocities: Vec<[f32; 3]>,
    /// Mass densities.
    pub density: Vec<f32>,
    /// Smoothing lengths: the kernel's support radius.
    pub smoothing_length: Vec<f32>,
    /// The further scalars, in the order of [`Generator::scalars`].
    pub scalars: Vec<Vec<f32>>,
}

impl Chunk {
    /// An empty chunk with room for `count` particles with `scalars` further scalars.
    pub fn with_capacity(count: usize, scalars: usize) -> Chunk {
        Chunk {
            positions: Vec::with_capacity(count),
            velocities: Vec::with_capacity(count),
            density: Vec::with_capacity(count),
            smoothing_length: Vec::with_capacity(count),
            scalars: (0..scalars).map(|_| Vec::with_capacity(count)).collect(),
        }
    }
}

/// A scalar of every particle beyond density and smoothing length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scalar {
    /// Label of its block in a Gadget file, four characters.
    pub label: &'static str,
    /// Standard name, as an import gives it.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
}

/// The internal energy of gas.
const INTERNAL_ENERGY: Scalar = Scalar { label: "U   ", name: "internal-energy", unit: "(km/s)^2" };

/// A way to make particles of one family.
pub trait Generator: Sync {
    /// Number of particles.
    fn len(&self) -> u64;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The family.
    fn family(&self) -> FamilyName;

    /// A box around all particles, in [`Generator::length_unit`].
    fn bounds(&self) -> Bounds;

    /// Whether the bounds are a periodic box that begins at the origin.
    fn periodic(&self) -> bool {
        true
    }

    /// Unit of lengths.
    fn length_unit(&self) -> &'static str {
        "kpc/h"
    }

    /// Unit of masses.
    fn mass_unit(&self) -> &'static str {
        "1e10 Msun/h"
    }

    /// Mass of each particle.
    fn particle_mass(&self) -> f64;

    /// The further scalars of a chunk.
    fn scalars(&self) -> &'static [Scalar];

    /// Which particles are in a chunk: those from `index * CHUNK` on, at most [`CHUNK`] of them.
    fn chunk_range(&self, index: u64) -> Range<u64> {
        (index * CHUNK).min(self.len())..((index + 1) * CHUNK).min(self.len())
    }

    /// The particles of [`Generator::chunk_range`].
    fn chunk(&self, index: u64) -> Chunk;
}

/// All particles of a generator in memory. Positions and values are those that a file would have.
pub fn dataset(generator: &dyn Generator) -> Dataset {
    let chunks: Vec<Chunk> = (0..generator.len().div_ceil(CHUNK)).into_par_iter().map(|i| generator.chunk(i)).collect();
    let column = |of: &dyn Fn(&Chunk) -> &Vec<f32>| chunks.iter().flat_map(|chunk| of(chunk).iter().copied()).collect();
    let positions: Vec<[f64; 3]> =
        chunks.iter().flat_map(|chunk| &chunk.positions).map(|position| position.map(f64::from)).collect();
    let attributes = generator.scalars().iter().enumerate().map(|(index, scalar)| Attribute {
        name: scalar.name.into(),
        unit: Unit::new(scalar.unit),
        values: column(&|chunk| &chunk.scalars[index]),
    });
    let family = Family {
        name: generator.family(),
        mass: vec![generator.particle_mass() as f32; positions.len()],
        positions,
        smoothing_length: column(&|chunk| &chunk.smoothing_length),
        density: column(&|chunk| &chunk.density),
        attributes: attributes.collect(),
    };
    Dataset {
        families: vec![family],
        length_unit: Unit::new(generator.length_unit()),
        mass_unit: Unit::new(generator.mass_unit()),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance {
            format: "synthetic".into(),
            box_size: generator.periodic().then(|| generator.bounds().size().x),
            ..Provenance::default()
        },
    }
}
