//! Seeded synthetic snapshots of any size, for benchmarks and tests.
//!
//! Every particle follows from the seed and its index alone, by integer arithmetic, the four basic operations and
//! square roots, which IEEE 754 defines to the last bit: the same bytes on any machine, for any number of threads.

pub mod clusters;
pub mod gadget;
mod random;

use crate::model::{Attribute, Bounds, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use rayon::prelude::*;

/// Particles that are generated together.
pub const CHUNK: u64 = 1 << 16;

/// Particles of one chunk, structure of arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chunk {
    /// Positions within the box.
    pub positions: Vec<[f32; 3]>,
    /// Velocities, km/s.
    pub velocities: Vec<[f32; 3]>,
    /// Internal energies per mass, (km/s)^2.
    pub internal_energy: Vec<f32>,
    /// Mass densities.
    pub density: Vec<f32>,
    /// Smoothing lengths: the kernel's support radius.
    pub smoothing_length: Vec<f32>,
}

/// A way to make particles.
pub trait Generator: Sync {
    /// Number of particles.
    fn len(&self) -> u64;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Edge of the periodic box, kpc/h.
    fn box_size(&self) -> f64;

    /// Mass of each particle, 1e10 Msun/h.
    fn particle_mass(&self) -> f64;

    /// The particles from `index * CHUNK` on, at most [`CHUNK`] of them.
    fn chunk(&self, index: u64) -> Chunk;
}

/// All particles of a generator in memory, as a gas family. Positions and values are those that a file would have.
pub fn dataset(generator: &dyn Generator) -> Dataset {
    let chunks: Vec<Chunk> = (0..generator.len().div_ceil(CHUNK)).into_par_iter().map(|i| generator.chunk(i)).collect();
    let column = |of: fn(&Chunk) -> &Vec<f32>| chunks.iter().flat_map(|chunk| of(chunk).iter().copied()).collect();
    let positions: Vec<[f64; 3]> =
        chunks.iter().flat_map(|chunk| &chunk.positions).map(|position| position.map(f64::from)).collect();
    let internal_energy = Attribute {
        name: "internal-energy".into(),
        unit: Unit::new("(km/s)^2"),
        values: column(|chunk| &chunk.internal_energy),
    };
    let family = Family {
        name: FamilyName::Gas,
        mass: vec![generator.particle_mass() as f32; positions.len()],
        positions,
        smoothing_length: column(|chunk| &chunk.smoothing_length),
        density: column(|chunk| &chunk.density),
        attributes: vec![internal_energy],
    };
    Dataset {
        families: vec![family],
        length_unit: Unit::new("kpc/h"),
        mass_unit: Unit::new("1e10 Msun/h"),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance {
            format: "synthetic".into(),
            box_size: Some(generator.box_size()),
            ..Provenance::default()
        },
    }
}

/// The whole periodic box of a generator.
pub fn bounds(generator: &dyn Generator) -> Bounds {
    Bounds { min: glam::DVec3::ZERO, max: glam::DVec3::splat(generator.box_size()) }
}
