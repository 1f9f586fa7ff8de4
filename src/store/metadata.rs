//! What the footer of a page file says about its content: units, families, attribute tables, levels, codebooks.

use super::page::PageId;
use crate::codec::{Codebook, VqBits};
use crate::hierarchy::RootCell;
use crate::model::{Bounds, FamilyName, Kernel, Provenance, Skipped, Unit};

/// Everything that is known of a page file without reading a page.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// Unit of positions and smoothing lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// The kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// Bits of a codebook index on disk.
    pub vq_bits: VqBits,
    /// The source.
    pub provenance: Provenance,
    /// Particles that the import left out.
    pub skipped: Vec<Skipped>,
    /// One tree for each family.
    pub families: Vec<FamilyMetadata>,
}

impl Metadata {
    /// Source particles in all families.
    pub fn particles(&self) -> u64 {
        self.families.iter().map(|family| family.count).sum()
    }

    /// The box around the source positions of all families.
    pub fn bounds(&self) -> Bounds {
        self.families.iter().fold(Bounds::EMPTY, |bounds, family| bounds.union(family.bounds))
    }

    /// The family of that name and its index (the one a [`super::Page`] carries).
    pub fn family(&self, name: FamilyName) -> Option<(u32, &FamilyMetadata)> {
        self.families.iter().enumerate().find(|(_, family)| family.name == name).map(|(i, family)| (i as u32, family))
    }
}

/// One family and its tree.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyMetadata {
    /// Which family.
    pub name: FamilyName,
    /// Number of source particles.
    pub count: u64,
    /// Their total mass.
    pub mass: f64,
    /// Their total `sum m rho`.
    pub mass_density: f64,
    /// The box around the source positions.
    pub bounds: Bounds,
    /// The cell of depth 0.
    pub root: RootCell,
    /// The page that holds the root; the root is node 0 of it.
    pub root_page: PageId,
    /// Mass, density and smoothing length of the source particles, named `mass`, `density`, `smoothing-length`.
    pub quantities: [AttributeInfo; 3],
    /// The further attributes, in the order of [`Codebook::attributes`].
    pub attributes: Vec<AttributeInfo>,
    /// One entry for each depth, the root first.
    pub levels: Vec<LevelInfo>,
    /// The codebooks; [`super::Node::codebook`] indexes them.
    pub codebooks: Vec<Codebook>,
}

impl FamilyMetadata {
    /// The attribute of that name and its index in [`Codebook::attributes`].
    pub fn attribute(&self, name: &str) -> Option<(usize, &AttributeInfo)> {
        self.attributes.iter().enumerate().find(|(_, attribute)| attribute.name == name)
    }
}

/// How an attribute of merged particles follows from theirs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttributeMerge {
    /// The mean, weighted with `m rho` (F12 4.2).
    Mean,
    /// Astronomical magnitudes: their fluxes `10^(-0.4 a)` are added.
    Magnitude,
}

/// One quantity of a family, over its source particles.
#[derive(Clone, Debug, PartialEq)]
pub struct AttributeInfo {
    /// Standard name in kebab case.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// Smallest finite value; 0 where there is none.
    pub min: f64,
    /// Largest finite value.
    pub max: f64,
    /// Mean of the finite values.
    pub mean: f64,
    /// Values that were not finite; the tree holds the mean in their place.
    pub missing: u64,
    /// How it is merged.
    pub merge: AttributeMerge,
    /// Distribution of the finite values.
    pub histogram: Histogram,
}

/// Counts in bins of equal width, linear or logarithmic.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Whether the bins are equal in the logarithm (all values are positive then).
    pub logarithmic: bool,
    /// Lower edge of the first bin, a value (not its logarithm).
    pub min: f64,
    /// Upper edge of the last bin.
    pub max: f64,
    /// The counts.
    pub counts: Vec<u64>,
}

/// One row of F12's table 4.1: what the tree holds at one depth, and how it came about. `input` particles arrive from
/// depth + 1 (drawn or not: [`LevelInfo::input`]); `input = merged + skipped + sprites + points + relayed` for the
/// grid and relay nodes of this depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelInfo {
    /// 0 for the root.
    pub depth: u8,
    /// Nodes that hold merged particles.
    pub grid_nodes: u64,
    /// Nodes that hold source particles.
    pub leaf_nodes: u64,
    /// Nodes that hold none because merging would have gained next to nothing over their children.
    pub relay_nodes: u64,
    /// Particles of the children before this depth's merging, skipped ones included.
    pub input: u64,
    /// Particles that merging removed.
    pub merged: u64,
    /// Particles left out by presence thinning; they take part in merging further up.
    pub skipped: u64,
    /// Particles that relay nodes pass on to their parents without holding them.
    pub relayed: u64,
    /// Particles of grid nodes that cover more than a quantisation cell.
    pub sprites: u64,
    /// Particles of grid nodes that cover at most one.
    pub points: u64,
    /// Source particles in leaves of this depth.
    pub leaf_particles: u64,
    /// Bytes of the nodes' records and sections.
    pub bytes: u64,
}

impl LevelInfo {
    /// Nodes of all kinds.
    pub fn nodes(&self) -> u64 {
        self.grid_nodes + self.leaf_nodes + self.relay_nodes
    }

    /// Particles stored at this depth.
    pub fn particles(&self) -> u64 {
        self.sprites + self.points + self.leaf_particles
    }
}
