//! What the footer of a page file says about its content: units, families, attribute tables, levels, codebooks.

use super::page::PageId;
pub use crate::codec::AttributeMerge;
use crate::codec::{Codebook, VqBits};
pub use crate::hierarchy::{AttributeInfo, Histogram, LevelInfo};
use crate::hierarchy::{Purpose, RootCell};
use crate::model::{Bounds, FamilyName, Kernel, PeriodicBox, Provenance, Skipped, Unit};

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

    /// Whether every family has levels for volumes.
    pub fn has_volume_levels(&self) -> bool {
        self.families.iter().all(|family| family.volume.is_some())
    }

    /// What is still known where there are no pages.
    pub fn outline(&self) -> Metadata {
        let without = |family: &FamilyMetadata| FamilyMetadata {
            levels: Vec::new(),
            volume: None,
            codebooks: Vec::new(),
            ..family.clone()
        };
        Metadata { families: self.families.iter().map(without).collect(), ..self.clone() }
    }

    /// The box around the source positions of all families.
    pub fn bounds(&self) -> Bounds {
        self.families.iter().fold(Bounds::EMPTY, |bounds, family| bounds.union(family.bounds))
    }

    /// The periodic box that the particles fill, where they do.
    pub fn periodic_box(&self) -> Option<PeriodicBox> {
        PeriodicBox::of(self.provenance.box_size, self.bounds())
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
    /// The levels for volumes, if the file has them.
    pub volume: Option<VolumeTree>,
    /// The codebooks; [`super::Node::codebook`] indexes them.
    pub codebooks: Vec<Codebook>,
}

/// A second tree over the leaves of a family, whose inner nodes are made for volumes (F12 5.5.1).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VolumeTree {
    /// The page that holds the root; the root is node 0 of it. That of the other tree if the root is a leaf.
    pub root_page: PageId,
    /// One entry for each depth, the root first, without leaves.
    pub levels: Vec<LevelInfo>,
}

impl FamilyMetadata {
    /// The page of the root of the tree for this purpose; `None` if the family has none.
    pub fn root_page_of(&self, purpose: Purpose) -> Option<PageId> {
        match purpose {
            Purpose::Splats => Some(self.root_page),
            Purpose::Samples => self.volume.as_ref().map(|volume| volume.root_page),
        }
    }

    /// Whether a page holds a root.
    pub fn has_root(&self, page: PageId) -> bool {
        [Purpose::Splats, Purpose::Samples].into_iter().any(|purpose| self.root_page_of(purpose) == Some(page))
    }

    /// The attribute of that name and its index in [`Codebook::attributes`].
    pub fn attribute(&self, name: &str) -> Option<(usize, &AttributeInfo)> {
        self.attributes.iter().enumerate().find(|(_, attribute)| attribute.name == name)
    }
}
