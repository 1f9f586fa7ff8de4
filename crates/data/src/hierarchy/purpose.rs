//! What the inner nodes of a hierarchy are for.

/// What the particles of inner nodes are made for. Cells and leaves are the same for both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Purpose {
    /// Pictures made of splats (F12 4.7.3): points merge, and sprites of similar smoothing lengths; the faintest are left out.
    #[default]
    Splats,
    /// Resampling to a grid (F12 5.5.1): particles smaller than a merging cell merge, their volumes add up, and none is
    /// smaller than a cell afterwards.
    Samples,
    /// Pictures made of few splats: clusters with a shape, any part of a node's (HE03).
    Clusters,
}

impl Purpose {
    /// All of them.
    pub const ALL: [Purpose; 3] = [Purpose::Splats, Purpose::Samples, Purpose::Clusters];

    /// What statistics call inner nodes for it.
    pub fn name(self) -> &'static str {
        match self {
            Purpose::Splats => "splats",
            Purpose::Samples => "volume",
            Purpose::Clusters => "clusters",
        }
    }
}
