//! Particles in memory: structure of arrays, one set of columns for each family.

use super::{Bounds, FamilyName, Kernel, Unit};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// One scalar quantity per particle, beyond mass, smoothing length and density.
#[derive(Clone, Debug, PartialEq)]
pub struct Attribute {
    /// Standard name in kebab case: `temperature`, `internal-energy`, `velocity-dispersion`, `speed`, `magnitude`,
    /// `color-index`, or the source's own name where there is no standard one.
    pub name: String,
    /// Unit of the values.
    pub unit: Unit,
    /// One value per particle, in the family's order. May be negative or zero; non-finite values are `NaN`.
    pub values: Vec<f32>,
}

/// The particles of one family. All columns have the same length.
#[derive(Clone, Debug, PartialEq)]
pub struct Family {
    /// Which family.
    pub name: FamilyName,
    /// World positions in the source's length unit; all finite.
    pub positions: Vec<[f64; 3]>,
    /// Masses; all positive. Sources without any mass have 1 for each particle.
    pub mass: Vec<f32>,
    /// Smoothing lengths `h`: the kernel's support radius (F12 3.2.2), length unit; all positive.
    pub smoothing_length: Vec<f32>,
    /// Mass densities `rho`, mass unit per length unit cubed; all positive.
    pub density: Vec<f32>,
    /// Further scalar attributes.
    pub attributes: Vec<Attribute>,
}

impl Family {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether the family has no particles.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The box around all positions.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.positions.iter().copied())
    }

    /// The attribute of that name.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|attribute| attribute.name == name)
    }
}

/// Particles that an import left out, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skipped {
    /// A reason a person understands: `non-finite position`, `mass not positive, or beyond single precision`.
    pub reason: String,
    /// How many particles.
    pub count: u64,
}

/// Where a dataset came from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The file that was named.
    pub path: PathBuf,
    /// The format's name: `gadget`, `gadget-hdf5`, `swift`, `tipsy`, `csv`.
    pub format: String,
    /// Size of all source files together, bytes.
    pub bytes: u64,
    /// Simulation time in the source's unit, where it says so.
    pub time: Option<f64>,
    /// Redshift, where the source says so.
    pub redshift: Option<f64>,
    /// Edge of the periodic box in the length unit, where there is one.
    pub box_size: Option<f64>,
    /// What the import assumed or estimated, one sentence each (`smoothing length: 32 nearest neighbours`).
    pub notes: Vec<String>,
}

/// Everything that was imported from one source.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// The families that hold particles, in Gadget's order.
    pub families: Vec<Family>,
    /// Unit of positions and smoothing lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// The SPH kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// Particles left out.
    pub skipped: Vec<Skipped>,
    /// Where it came from.
    pub provenance: Provenance,
}

impl Dataset {
    /// Number of particles in all families.
    pub fn len(&self) -> usize {
        self.families.iter().map(Family::len).sum()
    }

    /// Whether no family has a particle.
    pub fn is_empty(&self) -> bool {
        self.families.iter().all(Family::is_empty)
    }

    /// The periodic box that the particles fill, where they do.
    pub fn periodic_box(&self) -> Option<super::PeriodicBox> {
        super::PeriodicBox::of(self.provenance.box_size, self.bounds())
    }

    /// The box around all families.
    pub fn bounds(&self) -> Bounds {
        self.families.iter().fold(Bounds::EMPTY, |bounds, family| bounds.union(family.bounds()))
    }

    /// The family of that name.
    pub fn family(&self, name: FamilyName) -> Option<&Family> {
        self.families.iter().find(|family| family.name == name)
    }
}
