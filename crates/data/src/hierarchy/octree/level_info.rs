//! The table of F12 4.1: what a tree holds at each depth.

use crate::model::portable::portable;

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

portable!(LevelInfo {
    depth,
    grid_nodes,
    leaf_nodes,
    relay_nodes,
    input,
    merged,
    skipped,
    relayed,
    sprites,
    points,
    leaf_particles,
    bytes,
});

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
