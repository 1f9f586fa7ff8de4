//! The particle octree of F12 4.7: 256^3 merging grids, built bottom-up, one tree for each family.
//!
//! What differs from the paper, and why:
//!
//! - **Leaves.** The paper refines all 10 levels everywhere and averages 75 particles in its finest nodes. Here a cell with
//!   at most [`OctreeOptions::leaf_capacity`] particles is a leaf that holds them unmerged with up to 21 bits a coordinate,
//!   which replaces up to 13 levels below it. Smallest cells with more, of depth 21, have several leaves, each with some of them.
//! - **Relays.** Where smoothing lengths exceed the cells (`sprites`), an inner node can merge next to nothing and would
//!   repeat its children's particles at 5 or 6 bytes each. A node that would draw more than
//!   [`OctreeOptions::relay_fraction`] of what its children draw holds no particles itself and is always refined
//!   ([`Encoding::Relay`]); so a view draws at most `1 / relay_fraction` times as many particles as it could.
//! - **Positions.** A merged particle is stored at its centroid, with two more bits a coordinate than its cell. Boxes around
//!   the source particles of each merged one are carried along, so that a node can record the largest distance that any source
//!   particle can have from what is drawn for it (F12 4.7.2 bounds it by half a cell's diagonal, which is wrong once particles of
//!   a cell are merged more than once).
//! - **Order.** F12 4.9.2 shuffles a node's particles against contention in blending. Here they are in Morton order: the
//!   CPU renderer and the compute path accumulate in tiles, where neighbours in memory that are neighbours on the screen
//!   share cache lines.
//!
//! - **Height.** The root cell of a large family is larger than its particles ([`OctreeOptions::root_particles`]), so that its
//!   coarsest nodes stay small and the first picture of any file is drawn at once.
//!
//! - **Two kinds of levels.** What is resampled to a grid needs other rules for merging (F12 5.5.1) than splats do
//!   ([`Purpose`]). Both kinds have the same cells and share the leaves, so one sorted bucket serves both.
//!
//! A tree is built in buckets ([`plan`]), each of which fits in memory: [`bucket`] builds the pieces of one, [`joint`] what
//! little goes across, [`mod@assemble`] puts the pieces together. Where particles and pieces are kept meanwhile is the business
//! of [`crate::build`]. The result depends on the particles and the options, not on threads, memory, or the order of reading.
mod assemble;
mod block;
mod bucket;
mod joint;
mod leaf;
mod level_info;
mod merge;
mod piece;
mod plan;
mod sorted;
mod thin;
mod volume;

pub use assemble::{Assembly, Tree, TreeNode};
pub use bucket::{Bucket, Open};
pub use joint::join;
pub use level_info::LevelInfo;
pub use piece::{Piece, Words};
pub use plan::Plan;
pub use sorted::{Columns, Place};

use super::{Purpose, RootCell};
use crate::codec::{AttributeMerge, CodeBits, VqBits};
use crate::model::Bounds;
use crate::model::portable::portable_variants;
use serde::{Deserialize, Serialize};

/// Fewest and most particles of a bucket: enough for parallel work on small families, and little enough to fit in memory.
const BUCKET_PARTICLES: (u64, u64) = (1 << 17, 1 << 20);
/// Buckets that a family is cut into where that gives neither too few nor too many particles for each. No option of a build:
/// a build's memory decides how many are built at once and what waits on the disk, and a file must not depend on memory.
const BUCKETS: u64 = 1024;

/// How a tree is built.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OctreeOptions {
    /// Bits of a codebook index.
    pub vq_bits: VqBits,
    /// Whether codes of leaves have more bits, which tell smoothing lengths more finely ([`crate::codec::Refinement`]); 16 have none left.
    pub refined: bool,
    /// Largest number of particles in a leaf.
    pub leaf_capacity: usize,
    /// Largest difference of smoothing lengths, in cells, of sprites that are merged (F12 4.7.3, `epsilon`).
    pub fusion: f64,
    /// Share of a node's mass and of its `sum m rho` that presence thinning may leave out.
    pub thinning_budget: f64,
    /// An inner node that would draw more than this share of what its children draw is a relay.
    pub relay_fraction: f64,
    /// Particles of a bucket, about; `None`: chosen by their number.
    pub bucket_particles: Option<usize>,
    /// Whether leaves keep all 21 bits of each coordinate. If not, positions are rounded to a small fraction of the smoothing
    /// length, which takes half the space ([`leaf`]).
    pub exact_positions: bool,
    /// Source particles from which on the root cell is made larger than the particles' box, by a factor of 2 for each factor
    /// of 8 more particles.
    pub root_particles: u64,
    /// Whether levels for volumes are built beside those for splats.
    pub volume_levels: bool,
}

impl Default for OctreeOptions {
    fn default() -> OctreeOptions {
        OctreeOptions {
            vq_bits: VqBits::Eight,
            refined: true,
            leaf_capacity: 16384,
            fusion: 0.25,
            thinning_budget: 5e-4,
            relay_fraction: 0.65,
            bucket_particles: None,
            exact_positions: false,
            root_particles: 1 << 19,
            volume_levels: false,
        }
    }
}

impl OctreeOptions {
    /// The levels to build, those that hold the leaves first.
    pub fn levels(&self) -> &'static [Purpose] {
        if self.volume_levels { &[Purpose::Splats, Purpose::Samples] } else { &[Purpose::Splats] }
    }

    /// Bits of codes.
    pub fn code_bits(&self) -> CodeBits {
        if self.refined { CodeBits::refined(self.vq_bits) } else { CodeBits::plain(self.vq_bits) }
    }

    /// Particles of a bucket of a family of so many.
    pub fn bucket_size(&self, particles: u64) -> usize {
        let (fewest, most) = BUCKET_PARTICLES;
        self.bucket_particles.unwrap_or((particles / BUCKETS).clamp(fewest, most) as usize)
    }

    /// The root cell of a family: around its bounds; `fallback` is a length that matters where they have no extent.
    pub fn root_cell(&self, particles: u64, bounds: Bounds, fallback: f64) -> RootCell {
        let tight = RootCell::around(bounds, fallback);
        let octaves = (particles as f64 / self.root_particles.max(1) as f64).log2() / 3.0;
        // Growing to one side keeps the particles' box a cell of the tree.
        RootCell { size: tight.size * octaves.ceil().clamp(0.0, 4.0).exp2(), ..tight }
    }
}

/// What building the nodes of a family needs to know beside the particles.
#[derive(Clone, Copy, Debug)]
pub struct Context<'a> {
    /// The cell of depth 0.
    pub root: RootCell,
    /// How to build.
    pub options: &'a OctreeOptions,
    /// Merge rule of each attribute.
    pub rules: &'a [AttributeMerge],
}

/// Whether merging gains too little over drawing the children. The root for splats is what is drawn while nothing else is there.
fn is_relay(levels: Purpose, depth: u8, merged: u64, children_cost: u64, options: &OctreeOptions) -> bool {
    (depth > 0 || levels == Purpose::Samples) && merged as f64 > options.relay_fraction * children_cost as f64
}

/// How a node holds its particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// It holds none and must be refined: drawing its children costs next to nothing more than it would have. Its
    /// `delta` is infinite, so that error-driven selection refines it at any distance. The root for splats is never a relay.
    Relay,
    /// Merged particles, one `u32` each ([`crate::codec::coordinates::unpack_grid`]).
    Grid,
    /// Source particles, one `u64` each ([`crate::codec::coordinates::unpack_leaf`]).
    Leaf,
    /// Clusters of the children's clusters ([`crate::codec::clusters`]).
    Clusters,
    /// Clusters of the particles of a leaf, which is its one child and has the same cell.
    LeafClusters,
}

portable_variants!(Encoding { Relay = 0, Grid = 1, Leaf = 2, Clusters = 3, LeafClusters = 4 });

impl Encoding {
    /// Whether nodes hold clusters.
    pub fn is_clusters(self) -> bool {
        matches!(self, Encoding::Clusters | Encoding::LeafClusters)
    }
}
