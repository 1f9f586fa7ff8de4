//! Flow levels of a run: clusters of tracks that stay together within an error in space and time (F12 6.3), level by level.

use super::RunFile;
use super::tracks::TrackNode;
use crate::hierarchy::spacetime::Tracks;
use crate::store::error::StoreError;

/// The tracks of clusters of one flow level, of a family over an interval. Where clusters split and merge, several tracks begin or end in
/// one cluster; what a track has of mass, density and everything else is that of its own particles, but its states are the clusters'.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlowTracks {
    /// Both ends of each: without ids; masses by the weight of their particles.
    pub tracks: Tracks,
    /// Particles of each.
    pub counts: Vec<u32>,
    /// The clusters at both ends, by their numbers within family and step.
    pub clusters: [Vec<u32>; 2],
    /// The first of the tracks of the next finer level that each consists of, and one more at the end; empty on level 1.
    pub children: Vec<u32>,
    /// Share of the mass of each whose orbits the steps do not resolve.
    pub faded: Vec<f32>,
}

impl RunFile {
    /// The error of each flow level, from level 1, the finest, to the root, run units; none where the run has no flow levels. At no time is
    /// a particle farther than that from the track of its cluster.
    pub fn flow_errors(&self) -> &[f64] {
        &[]
    }

    /// The tracks of a flow level, from 1 on, of a family over an interval.
    ///
    /// # Errors
    /// Where there are none, or they cannot be read or are damaged.
    pub fn flow_tracks(&self, interval: usize, family: usize, level: usize) -> Result<FlowTracks, StoreError> {
        Err(self.damaged(format!("interval {interval}, family {family}, flow level {level}"), "flow levels"))
    }

    /// Which track of flow level 1 each track of a leaf belongs to.
    ///
    /// # Errors
    /// As [`RunFile::flow_tracks`].
    pub fn leaf_flow(&self, interval: usize, family: usize, _leaf: &TrackNode) -> Result<Vec<u32>, StoreError> {
        Err(self.damaged(format!("interval {interval}, family {family}"), "flow levels"))
    }
}
