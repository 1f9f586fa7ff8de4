//! What is known of a family from step to step of its build, whichever process takes the steps: what was seen in it, how it is cut into
//! buckets, and in the end what the file says of it.

use super::clusters::CodedClusters;
use super::column_error::Picture;
use super::derive::Deriving;
use super::estimates::Estimating;
use super::found::Seen;
use super::reach::Surroundings;
use super::survey::{Survey, column_error};
use super::tree::{Books, CodedTrees};
use super::{BuildError, BuildOptions};
use crate::codec::quantize::MAX_ATTRIBUTES;
use crate::codec::{AttributeMerge, CodeBits, Scaling};
use crate::hierarchy::kind::OCTREE;
use crate::hierarchy::octree::Plan;
use crate::hierarchy::pca::SplitRule;
use crate::hierarchy::{AttributeInfo, Histogram, LevelInfo, OctreeOptions, Purpose, RootCell};
use crate::import::replaced_densities;
use crate::model::portable::{expect_that, expect_within, portable};
use crate::model::{Derivation, FamilyName, Kernel, ParticleStream, Unit};
use crate::store::paging::{FamilyTrees, PlannedNode, Written};
use crate::store::{ClusterLevel, ClusterTree, FamilyMetadata, VolumeTree};
use std::path::Path;
use std::sync::Arc;

/// What of a family's trees its metadata tells.
pub(super) struct Summary {
    /// Mass of all particles, and their `sum m rho`.
    pub mass: f64,
    pub mass_density: f64,
    /// Levels of the tree that has the leaves, without bytes.
    pub levels: Vec<LevelInfo>,
    /// Those for volumes, without leaves.
    pub volume: Option<Vec<LevelInfo>>,
    pub clusters: Option<CodedClusters>,
    pub books: Books,
    /// Whether merged particles are written.
    pub has_octree: bool,
}

impl Summary {
    /// That of coded trees.
    pub fn of(coded: CodedTrees, options: &BuildOptions) -> Summary {
        let has_octree = has_octree(&coded, options);
        let CodedTrees { splats, volume, clusters, books, .. } = coded;
        let top = &splats.nodes[0][0].node;
        Summary {
            mass: top.mass,
            mass_density: top.mass_density,
            levels: splats.levels,
            volume: volume.map(|tree| tree.levels),
            clusters,
            books,
            has_octree,
        }
    }
}

/// A family that has been looked through.
pub(super) struct Outline {
    /// Its name.
    pub name: FamilyName,
    /// What was seen, without positions.
    pub survey: Survey,
    /// The cell of depth 0.
    pub root: RootCell,
    /// How it is cut into buckets, of about `most` particles.
    pub plan: Plan,
    pub most: usize,
    /// All attributes in the end, those that are derived first.
    pub attributes: Vec<(String, Unit)>,
    /// Attributes that the source has, and with them the columns that others are derived from.
    pub own: usize,
    pub columns: usize,
    /// Neighbours of which densities and smoothing lengths are estimated, where some are missing.
    neighbours: Option<usize>,
    /// Edge of the periodic box.
    edge: Option<f64>,
}

portable!(Outline { name, survey, root, plan, most, attributes, own, columns, neighbours, edge });

impl Outline {
    /// Plans the build of a family; `None` for one without particles.
    ///
    /// # Errors
    /// When it has more attributes than can be kept.
    pub fn of(
        mut survey: Survey,
        stream: &dyn ParticleStream,
        octree: &OctreeOptions,
        out: &Path,
    ) -> Result<Option<Outline>, BuildError> {
        if survey.count == 0 {
            return Ok(None);
        }
        let root = survey.root(octree);
        let most = octree.bucket_size(survey.count);
        let plan = Plan::new(&survey.take_keys(root), survey.weight, most);
        let (attributes, own) = (stream.all_attributes(), stream.attributes().len());
        if attributes.len() > MAX_ATTRIBUTES {
            let what = format!(
                "{} attributes of {}, {} of them derived; at most {MAX_ATTRIBUTES} can be kept",
                attributes.len(),
                stream.family(),
                attributes.len() - own
            );
            return Err(BuildError::Selection { path: out.to_owned(), what });
        }
        Ok(Some(Outline {
            name: stream.family(),
            root,
            plan,
            most,
            attributes,
            own,
            columns: stream.columns(),
            neighbours: stream.neighbours().filter(|_| survey.is_lacking()),
            edge: stream.periodic_edge(survey.bounds),
            survey,
        }))
    }

    /// Whether it is one of a family of at most `most` particles, all columns of which are known, or those of the source alone; else what was found
    /// and expected.
    pub fn check(&self, most: u64, is_complete: bool) -> Result<(), String> {
        let Outline { survey, root, attributes, own, columns, neighbours, edge, .. } = self;
        expect_within("particles", survey.count, 1..=most)?;
        expect_within("attributes", attributes.len() as u64, *own as u64..=MAX_ATTRIBUTES as u64)?;
        let inputs = Derivation::COMPONENTS as u64 + 1;
        expect_within("columns", *columns as u64, *own as u64..=*own as u64 + inputs)?;
        let has_derived = is_complete && self.derived_columns() > 0;
        survey.check(3 + if has_derived { attributes.len() } else { *columns })?;
        expect_within("neighbours", neighbours.map_or(0, |count| count as u64), 0..=u32::MAX.into())?;
        expect_that(survey.bounds.min.cmple(survey.bounds.max).all(), "bounds", "a box around the particles")?;
        let is_length = |length: f64| length > 0.0 && length.is_finite();
        expect_that(root.min.is_finite() && is_length(root.size), "root cell", "a cube")?;
        expect_that(edge.is_none_or(is_length), "edge", "that of a periodic box")
    }

    /// Whether its columns are those of a stream, and neighbours are looked for as there.
    pub fn is_of(&self, stream: &dyn ParticleStream) -> bool {
        (self.own, self.columns) == (stream.attributes().len(), stream.columns())
            && self.attributes == stream.all_attributes()
            && (self.neighbours.is_none() || self.neighbours == stream.neighbours())
            && self.edge == stream.periodic_edge(self.survey.bounds)
    }

    /// Columns beside mass, density and smoothing length that a particle may have at some time.
    pub fn most_columns(&self) -> usize {
        self.attributes.len() + self.columns - self.own
    }

    /// Derived attributes.
    pub fn derived_columns(&self) -> usize {
        self.attributes.len() - self.own
    }

    /// Whether particles will be looked for in other buckets than their own.
    pub fn has_neighbours(&self) -> bool {
        self.neighbours.is_some() || self.attributes.len() > self.own
    }

    /// All particles, for who has all buckets.
    fn surroundings(&self) -> Surroundings<'_> {
        let Outline { plan, root, edge, survey: Survey { bounds, count, .. }, .. } = self;
        Surroundings { plan, root: *root, edge: *edge, bounds: *bounds, count: *count, others: None }
    }

    /// How densities and smoothing lengths are estimated, where some are missing.
    pub fn estimating(&self) -> Option<Estimating<'_>> {
        self.neighbours.map(|k| Estimating { k, surroundings: self.surroundings() })
    }

    /// How attributes are derived.
    pub fn deriving<'a>(&'a self, derivation: &'a Derivation, kernel: Kernel) -> Deriving<'a> {
        Deriving { derivation, kernel, own: self.own, surroundings: self.surroundings() }
    }

    /// What is to be told of densities that are not the source's, before they are estimated.
    pub fn note(&self) -> Option<String> {
        let lacking = self.survey.ranges[1].missing;
        let are_some = self.neighbours.is_some() && lacking > 0 && lacking < self.survey.count;
        are_some.then(|| replaced_densities(self.name, lacking))
    }

    /// Takes note of derived attributes.
    pub fn derived(&mut self, found: Seen) {
        self.survey.derived(self.own, found);
    }

    /// How the quantiser scales the columns, once all are known.
    pub fn scaling(&mut self) -> Scaling {
        self.survey.scaling(self.attributes.iter().map(|(name, _)| name.as_str()))
    }

    /// How each attribute is merged.
    pub fn rules(&self) -> Vec<AttributeMerge> {
        self.attributes.iter().map(|(name, _)| AttributeMerge::of(name)).collect()
    }

    /// The options that its trees are built with.
    pub fn octree(&self, options: &OctreeOptions) -> OctreeOptions {
        // What has magnitudes is seen as points of light, and its smoothing lengths say nothing of how near one comes.
        let has_magnitudes = self.rules().contains(&AttributeMerge::Magnitude);
        OctreeOptions { exact_positions: options.exact_positions || has_magnitudes, ..*options }
    }

    /// The picture whose error is told.
    pub fn picture(&self, kernel: Kernel, bits: CodeBits) -> Option<Picture> {
        // Files with plain codes have no place for it.
        Picture::new(self.root, self.survey.bounds, kernel).filter(|_| bits.is_refined())
    }

    /// What the file says of the family, whose trees were `written` there.
    ///
    /// # Errors
    /// When there is no tree.
    pub fn metadata(
        &self,
        histograms: &[Histogram],
        summary: Summary,
        written: Vec<Written>,
        options: &BuildOptions,
    ) -> Result<FamilyMetadata, BuildError> {
        let has_octree = summary.has_octree;
        let mut written = written.into_iter();
        let (Some(splats), volume, clusters) = (
            written.next(),
            summary.volume.as_ref().and_then(|_| written.next()),
            summary.clusters.as_ref().and_then(|_| written.next()),
        ) else {
            return Err(column_error(self.name, "count", "at least one particle"));
        };
        let with_bytes = |levels: &[LevelInfo], bytes: Vec<u64>| {
            levels.iter().zip(bytes).map(|(level, bytes)| LevelInfo { bytes, ..*level }).collect()
        };
        let survey = &self.survey;
        let describe = |k: usize, name: &str, unit: &Unit| {
            AttributeInfo::new(name, unit, &survey.ranges[k], histograms[k].clone())
        };
        let unit = Unit::default();
        let quantities =
            [describe(0, "mass", &unit), describe(1, "density", &unit), describe(2, "smoothing-length", &unit)];
        Ok(FamilyMetadata {
            name: self.name,
            count: survey.count,
            mass: summary.mass,
            mass_density: summary.mass_density,
            bounds: survey.bounds,
            root: self.root,
            root_page: clusters.as_ref().filter(|_| !has_octree).map_or(splats.root_page, |tree| tree.root_page),
            quantities,
            attributes: (3..).zip(&self.attributes).map(|(k, (name, unit))| describe(k, name, unit)).collect(),
            levels: own_levels(with_bytes(&summary.levels, splats.bytes), has_octree),
            volume: volume.zip(summary.volume.as_ref()).map(|(written, levels)| VolumeTree {
                root_page: written.root_page,
                levels: with_bytes(levels, written.bytes),
            }),
            codebooks: summary.books.codebooks,
            refinements: summary.books.refinements,
            column_error: summary.books.column_error,
            clusters: clusters.zip(summary.clusters).map(|(written, tree)| ClusterTree {
                root_page: written.root_page,
                levels: tree
                    .levels
                    .into_iter()
                    .zip(written.bytes)
                    .map(|(level, bytes)| ClusterLevel { bytes, ..level })
                    .collect(),
                shape_bits: options.clusters.shape_bits,
                is_published: options.clusters.rule == SplitRule::Distortion,
                book: Arc::new(tree.book),
            }),
        })
    }
}

/// The trees beside that for splats.
pub(super) fn others(coded: &CodedTrees) -> Vec<(Purpose, &[Vec<PlannedNode>])> {
    let volume = coded.volume.as_ref().map(|tree| (Purpose::Samples, &tree.nodes[..]));
    let clusters = coded.clusters.as_ref().map(|tree| (Purpose::Clusters, &tree.nodes[..]));
    volume.into_iter().chain(clusters).collect()
}

/// The trees that are written.
pub(super) fn trees<'a>(
    coded: &'a CodedTrees,
    others: &'a [(Purpose, &'a [Vec<PlannedNode>])],
    options: &BuildOptions,
) -> FamilyTrees<'a> {
    FamilyTrees { splats: &coded.splats.nodes, has_octree: has_octree(coded, options), others }
}

/// Whether merged particles are written.
fn has_octree(coded: &CodedTrees, options: &BuildOptions) -> bool {
    options.hierarchies.has(&OCTREE) || coded.clusters.is_none()
}

/// The levels of an octree as they are written: leaves alone where there is no other node.
fn own_levels(levels: Vec<LevelInfo>, has_octree: bool) -> Vec<LevelInfo> {
    if has_octree {
        return levels;
    }
    let leaves = |level: LevelInfo| LevelInfo {
        depth: level.depth,
        leaf_nodes: level.leaf_nodes,
        leaf_particles: level.leaf_particles,
        bytes: level.bytes,
        ..LevelInfo::default()
    };
    levels.into_iter().map(leaves).collect()
}
