//! Clusters of particles by principal component analysis, after Hopf and Ertl, Hierarchical Splatting of Scattered Data (HE03).
//!
//! A node holds clusters of what is in its cell: of the particles where the cell is that of a leaf, of its children's clusters
//! elsewhere. They come about by binary splits through the centroid across the principal axis (HE03 fig. 3), the split that shows most
//! first, and are told in an order in which a part of the splits can be undone: so a node can be drawn with any number of clusters, from
//! one to all ([`mod@split`]).
//!
//! What differs from the paper, and why:
//!
//! - **Shape.** A cluster is represented by its mass, centroid and full second moments, those of its members' kernels included: an
//!   ellipsoid that any projection shows with the right spread, where the paper has a round splat of a size found by trial ([`members`]).
//! - **Order.** [`SplitRule::Relative`] splits first where the members' spread is large against their kernels, or these are unlike, which
//!   is what shows, and what is bright before what is faint; the paper's distortion, selectable as [`SplitRule::Distortion`], is large
//!   where there is much, whether it shows or not.
//! - **Cells.** The splits of a node stay within its octree cell, so that clusters have the leaves, the cells, the streaming and the
//!   order between cells that the octree has.
//! - **Classification.** Clusters carry mass, density and attributes by the rules by which particles are merged, so colours stay free.

pub mod members;
pub mod split;
pub mod steps;

pub use members::Members;
use serde::{Deserialize, Serialize};
pub use split::{SplitRule, Splitting, bright, split};
pub use steps::{Step, count_at, steps, take_over};

/// Clusters that an inner node holds at most.
pub const NODE_CLUSTERS: usize = 8192;

/// Particles of a leaf that has no clusters of its own, at most: its parent's stand for it.
const SMALL_LEAF: usize = 64;
/// Clusters of an inner node at least: where most of what there is lies in one child, from level to level, its clusters must not become few.
const FEWEST: usize = 1024;
/// An inner node that would have more than this share of its children's clusters has none.
const RELAY: f64 = 0.65;

/// How clusters are made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClusterOptions {
    /// Particles of a cluster of the finest level, and clusters of one level in one of the next, on average.
    pub size: f64,
    /// Which cluster is split next.
    pub rule: SplitRule,
    /// Bits of a shape's code: 0, 8, 12 or 16; with 0 all clusters are round.
    pub shape_bits: u8,
}

impl Default for ClusterOptions {
    fn default() -> ClusterOptions {
        // HE03 has about 5 from level to level.
        ClusterOptions { size: 5.0, rule: SplitRule::Relative, shape_bits: 12 }
    }
}

impl ClusterOptions {
    /// Clusters of a leaf with so many particles; `None`: it is drawn itself, since it is small.
    pub fn of_leaf(&self, particles: usize) -> Option<usize> {
        let clusters = self.shared(particles);
        (particles > SMALL_LEAF).then_some(clusters.clamp(1, NODE_CLUSTERS))
    }

    /// Clusters of an inner node whose children have so many; `None`: its children are drawn instead, since it would have hardly fewer.
    pub fn of_node(&self, members: usize) -> Option<usize> {
        let clusters = self.of_root(members);
        (clusters as f64 <= RELAY * members as f64).then_some(clusters)
    }

    /// The same for a root, which is drawn whatever it has.
    pub fn of_root(&self, members: usize) -> usize {
        self.shared(members).clamp(FEWEST.min(members), NODE_CLUSTERS).max(1)
    }

    fn shared(&self, members: usize) -> usize {
        (members as f64 / self.size).ceil() as usize
    }
}
