//! What to build, and with what.

use crate::codec::VqBits;
use crate::hierarchy::kind::PCA;
use crate::hierarchy::{ClusterOptions, Kinds, OctreeOptions};
use crate::model::{FamilyName, ReadMethod};
use crate::store::paging::PAGE_BYTES;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// As many particles as the largest codebook has entries.
pub const FEW_PARTICLES: u64 = 1 << 16;

/// What to build, and with what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildOptions {
    /// Families to keep; none named: all.
    pub families: Vec<FamilyName>,
    /// Attributes to keep, by name; `None`: the most useful ones that there are.
    pub attributes: Option<Vec<String>>,
    /// How the trees are built.
    pub octree: OctreeOptions,
    /// The kinds of hierarchies that are built.
    pub hierarchies: Kinds,
    /// How clusters are made, where they are.
    pub clusters: ClusterOptions,
    /// Source particles of all families from which on a file gets clusters, where [`BuildOptions::hierarchies`] has them beside others.
    pub clusters_from: u64,
    /// Source particles of all families below which indices have [`VqBits::Sixteen`] whatever [`OctreeOptions::vq_bits`] is: up to
    /// [`FEW_PARTICLES`] each has an entry of the codebook of its own.
    pub exact_below: u64,
    /// Bytes that a page aims at; only a page of a single node may be longer.
    pub page_bytes: usize,
    /// Bytes of memory that the build may take; `None`: half of what the machine has free.
    pub memory: Option<u64>,
    /// Folder for temporary files; `None`: that of the output.
    pub temporary: Option<PathBuf>,
    /// Threads; `None`: as many as the machine has. The file is the same for any number.
    pub threads: Option<usize>,
    /// How the source and temporary files are read. The file is the same for both.
    pub read: ReadMethod,
}

impl Default for BuildOptions {
    fn default() -> BuildOptions {
        BuildOptions {
            families: Vec::new(),
            attributes: None,
            octree: OctreeOptions::default(),
            hierarchies: Kinds::default(),
            clusters: ClusterOptions::default(),
            clusters_from: 0,
            exact_below: 0,
            page_bytes: PAGE_BYTES,
            memory: None,
            temporary: None,
            threads: None,
            read: ReadMethod::default(),
        }
    }
}

impl BuildOptions {
    /// The default options with this many bits for a codebook index.
    pub fn with_vq_bits(vq_bits: VqBits) -> BuildOptions {
        BuildOptions { octree: OctreeOptions { vq_bits, ..OctreeOptions::default() }, ..BuildOptions::default() }
    }

    /// The same for a source of so many particles.
    pub(super) fn for_particles(&self, particles: u64) -> BuildOptions {
        let without: Kinds = Kinds::of(self.hierarchies.iter().filter(|kind| **kind != PCA));
        let is_small = particles < self.clusters_from && !without.is_empty();
        let hierarchies = if is_small { without } else { self.hierarchies };
        let vq_bits = if particles < self.exact_below { VqBits::Sixteen } else { self.octree.vq_bits };
        BuildOptions { hierarchies, octree: OctreeOptions { vq_bits, ..self.octree }, ..self.clone() }
    }

    /// What of the hierarchy differs from the defaults, for the file's provenance; `None`: nothing.
    pub(super) fn hierarchy_note(&self) -> Option<String> {
        let (own, usual) = (&self.octree, OctreeOptions::default());
        let differing = [
            (self.page_bytes != PAGE_BYTES, format!("pages of {} bytes", self.page_bytes)),
            (own.leaf_capacity != usual.leaf_capacity, format!("leaves of {} particles", own.leaf_capacity)),
            (own.refined != usual.refined, "plain codes of leaves".to_owned()),
            (own.fusion != usual.fusion, format!("fusion within {} cells", own.fusion)),
            (own.thinning_budget != usual.thinning_budget, format!("thinning of {}", own.thinning_budget)),
            (own.relay_fraction != usual.relay_fraction, format!("relays from {}", own.relay_fraction)),
            (
                own.root_particles != usual.root_particles,
                format!("a larger root beyond {} particles", own.root_particles),
            ),
        ];
        let differing: Vec<_> = differing.into_iter().filter(|(differs, _)| *differs).map(|(_, what)| what).collect();
        (!differing.is_empty()).then(|| format!("built with {}", differing.join(", ")))
    }
}
