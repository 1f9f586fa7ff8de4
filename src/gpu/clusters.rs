//! Clusters of a node as shaders read them (`load_cluster` in shaders/lib/particle.wgsl): all that a node may be drawn with, whatever the
//! number, so that another number costs one word for each node.

use super::content_look::ContentLook;
use super::scene::CLUSTER_WORDS;
use crate::store::Page;
use crate::stream::copies::CLUSTER_BYTES;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

/// A cluster, or several that undone splits have left together, in the order in which shaders read it.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct GpuCluster {
    /// The place, from the node's origin, world units.
    pub place: [f32; 3],
    /// Smoothing length of the ball with the same trace of second moments, world units.
    pub smoothing_length: f32,
    /// Second moments xx, yy, zz, xy, xz, yz in world axes, squared world units; zeros of what is drawn as that ball.
    pub moments: [f32; 6],
    /// The weight.
    pub weight: f32,
    /// The attribute.
    pub attribute: f32,
    /// The density, for modes that draw with it.
    pub density: f32,
    /// The last limit with which it is drawn ([`crate::store::ClusterUnions`]).
    pub to: f32,
    /// Makes it whole vectors of four.
    pub unused: [f32; 2],
}

const _: () = assert!(size_of::<GpuCluster>() as u64 == CLUSTER_BYTES && CLUSTER_WORDS * 4 == CLUSTER_BYTES as usize);

/// A node's clusters, as they are to be seen.
#[derive(Clone, Debug)]
pub struct ClusterNode {
    /// The page.
    pub page: Arc<Page>,
    /// Index of the node in it.
    pub node: u32,
    /// How it is to be seen.
    pub look: Arc<ContentLook>,
}

/// How many of a node's clusters are looked at for each limit: those that come to be with it or before.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidates(Vec<u16>);

impl Candidates {
    /// Those for a limit.
    pub fn within(&self, limit: u16) -> u32 {
        self.0.partition_point(|from| *from <= limit) as u32
    }
}

impl ClusterNode {
    /// The clusters, placed from an origin; `None` where there are none.
    pub(super) fn clusters(&self, origin: DVec3) -> Option<(Vec<GpuCluster>, Candidates)> {
        let content = self.page.content(self.node as usize)?;
        let unions = content.cluster_unions(self.look.depiction.choice.representative)?;
        let held = &unions.clusters;
        let columns = self.look.columns(self.page.family, &held.values)?;
        let of = |column: &Option<Vec<f32>>, i: usize| column.as_ref().map_or(0.0, |values| values[i]);
        let cluster = |i: usize| GpuCluster {
            place: (DVec3::from_array(held.positions[i]) - origin).as_vec3().to_array(),
            smoothing_length: held.values.smoothing_length[i],
            moments: held.covariances.get(i).map_or([0.0; 6], |covariance| covariance.0),
            weight: columns.weight[i],
            attribute: of(&columns.attribute, i),
            density: of(&columns.density, i),
            to: unions.to[i].into(),
            unused: [0.0; 2],
        };
        let clusters = (0..held.len()).into_par_iter().map(cluster).collect();
        Some((clusters, Candidates(unions.from)))
    }

    /// Bytes that its copy takes at most.
    pub fn bytes(&self) -> u64 {
        self.page.nodes.get(self.node as usize).map_or(0, |node| crate::stream::copies::cluster_bytes(node.particles))
    }

    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.page.nodes.get(self.node as usize).map_or(0, |node| node.particles as usize)
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
