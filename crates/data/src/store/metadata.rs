//! What the footer of a page file says about its content: units, families, attribute tables, levels, codebooks.

use super::page::PageId;
pub use crate::codec::AttributeMerge;
use crate::codec::shapes::ShapeBook;
use crate::codec::{CodeBits, Codebook, Refinement};
pub use crate::hierarchy::{AttributeInfo, Histogram, LevelInfo};
use crate::hierarchy::{Kind, Purpose, RootCell};
use crate::model::{Bounds, FamilyName, Kernel, PeriodicBox, Provenance, Skipped, Unit};
use std::sync::Arc;

/// Everything that is known of a page file without reading a page.
#[derive(Clone, Debug, PartialEq)]
pub struct Metadata {
    /// Unit of positions and smoothing lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// The kernel that the smoothing lengths belong to.
    pub kernel: Kernel,
    /// Bits of codes on disk.
    pub bits: CodeBits,
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

    /// The kinds of hierarchies over the leaves of any family.
    pub fn hierarchies(&self) -> Vec<&'static Kind> {
        let is_there = |kind: &&Kind| {
            let mut trees = self.families.iter().flat_map(FamilyMetadata::trees);
            trees.any(|(purpose, _)| kind.purposes.first() == Some(&purpose))
        };
        Kind::ALL.into_iter().filter(is_there).collect()
    }

    /// Whether every family has levels for volumes.
    pub fn has_volume_levels(&self) -> bool {
        self.families.iter().all(|family| family.volume.is_some())
    }

    /// Whether every family has clusters.
    pub fn has_clusters(&self) -> bool {
        self.families.iter().all(|family| family.clusters.is_some())
    }

    /// Whether clusters have the diameters of HE03.
    pub fn is_published(&self) -> bool {
        self.families.iter().filter_map(|family| family.clusters.as_ref()).all(|clusters| clusters.is_published)
    }

    /// What is still known where there are no pages.
    pub fn outline(&self) -> Metadata {
        let without = |family: &FamilyMetadata| FamilyMetadata {
            levels: Vec::new(),
            volume: None,
            codebooks: Vec::new(),
            refinements: Vec::new(),
            clusters: None,
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
    /// Where codes of leaves are refined, how the lines run of each codebook of leaves, in their order; what these hold has been unrolled.
    pub refinements: Vec<Refinement>,
    /// About how far pictures of column density are from those of the source by the codes of leaves alone, the root of the mean of squares
    /// over that of the picture (relative L2), where that was measured: of the whole box along z, the longer of its sides 1024 pixels long.
    pub column_error: Option<f64>,
    /// The levels of clusters, if the file has them.
    pub clusters: Option<ClusterTree>,
}

/// A second tree over the leaves of a family, whose inner nodes are made for volumes (F12 5.5.1).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VolumeTree {
    /// The page that holds the root; the root is node 0 of it. That of the other tree if the root is a leaf.
    pub root_page: PageId,
    /// One entry for each depth, the root first, without leaves.
    pub levels: Vec<LevelInfo>,
}

/// A tree over the leaves of a family whose other nodes hold clusters (HE03).
#[derive(Clone, Debug, PartialEq)]
pub struct ClusterTree {
    /// The page that holds the root; the root is node 0 of it. That of the family if there are no levels of other kinds.
    pub root_page: PageId,
    /// One entry for each depth that has clusters, the root first.
    pub levels: Vec<ClusterLevel>,
    /// Bits of a shape's code: 0, 8, 12 or 16.
    pub shape_bits: u8,
    /// Whether clusters were split by distortion, and have the diameters of HE03, too.
    pub is_published: bool,
    /// What codes stand for.
    pub book: Arc<ClusterBook>,
}

impl ClusterTree {
    /// Number of all finest clusters: those over leaves.
    pub fn finest(&self) -> u64 {
        self.levels.iter().map(|level| level.finest).sum()
    }
}

/// What the codes of a family's clusters stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct ClusterBook {
    /// Shapes.
    pub shapes: ShapeBook,
    /// Moments of each shape at size 1.
    pub moments: Vec<[f64; 6]>,
    /// Densities and attributes; its masses and smoothing lengths are of no use.
    pub values: Codebook,
}

impl ClusterBook {
    /// The book with these shapes and values.
    pub fn new(shapes: ShapeBook, values: Codebook) -> ClusterBook {
        let moments = shapes.moments();
        ClusterBook { shapes, moments, values }
    }
}

/// The clusters of a depth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClusterLevel {
    /// Depth of their cells.
    pub depth: u8,
    /// Nodes with clusters.
    pub nodes: u64,
    /// Their clusters.
    pub clusters: u64,
    /// Those over leaves among them.
    pub finest: u64,
    /// Mean of the geometric mean of the standard deviations of a cluster along its principal axes, length unit.
    pub size: f64,
    /// Misfit of all of them together ([`crate::hierarchy::pca::members::misfit`]), relative to their mass.
    pub misfit: f64,
    /// Bytes of its nodes' records and sections, alignment included.
    pub bytes: u64,
}

impl FamilyMetadata {
    /// Whether there are levels of merged particles.
    pub fn has_octree(&self) -> bool {
        self.clusters.as_ref().is_none_or(|clusters| clusters.root_page != self.root_page)
    }

    /// The trees that there are, each with the page of its root.
    pub fn trees(&self) -> impl Iterator<Item = (Purpose, PageId)> {
        let splats = self.has_octree().then_some((Purpose::Splats, self.root_page));
        let volume = self.volume.as_ref().map(|volume| (Purpose::Samples, volume.root_page));
        let clusters = self.clusters.as_ref().map(|clusters| (Purpose::Clusters, clusters.root_page));
        [splats, volume, clusters].into_iter().flatten()
    }

    /// The page of the root of the tree for this purpose; `None` if the family has none.
    pub fn root_page_of(&self, purpose: Purpose) -> Option<PageId> {
        match purpose {
            Purpose::Splats => Some(self.root_page),
            Purpose::Samples => self.volume.as_ref().map(|volume| volume.root_page),
            Purpose::Clusters => self.clusters.as_ref().map(|clusters| clusters.root_page),
        }
    }

    /// Whether a page holds a root.
    pub fn has_root(&self, page: PageId) -> bool {
        self.trees().any(|(_, root)| root == page)
    }

    /// The attribute of that name and its index in [`Codebook::attributes`].
    pub fn attribute(&self, name: &str) -> Option<(usize, &AttributeInfo)> {
        self.attributes.iter().enumerate().find(|(_, attribute)| attribute.name == name)
    }
}
