//! What nodes are: one large point, samples, or directed, each by the set that its own error chose.

use super::sets::{Set, directions};
use super::tree::{Hierarchy, Level};
use rayon::prelude::*;

/// A node's set is good enough where the root of its mean squared error is below this share of the range: half a step of 8 bits.
const TOLERANCE: f32 = 1.0 / 512.0;
/// A directed set that is not good enough still tells what a node is where it leaves at most this share of what the large point leaves.
const DIRECTED: f32 = 0.5;
/// A cut that spares less than this share of the samples spares nothing.
pub const SPARES: f64 = 0.02;

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// One point shows it.
    Large,
    /// Its children's points are needed.
    Samples,
    /// Directed along a published direction, see [`super::sets::direction`].
    Directed(usize),
}

/// How many nodes of a level are what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LevelKinds {
    /// Number of nodes with samples.
    pub nodes: usize,
    /// Points of their sets; a node that needs its children's has as many as those children.
    pub points: usize,
    /// Nodes of one point.
    pub large: usize,
    /// Nodes that need their children's points.
    pub samples: usize,
    /// Nodes directed to each published direction.
    pub directed: Vec<usize>,
}

impl Hierarchy {
    /// The squared error per sample that is good enough.
    fn tolerance(&self) -> f32 {
        let spans = self.ranges.iter().map(|(low, high)| high - low);
        self.planes.weights.iter().zip(spans).map(|(w, span)| w * span * span).sum::<f32>() * TOLERANCE * TOLERANCE
    }

    /// What a node is.
    pub fn kind(&self, level: &Level, node: usize) -> NodeKind {
        let (good, large) = (self.tolerance() * level.samples[node] as f32, level.large_error[node]);
        let set = level.set[node];
        if large <= good {
            return NodeKind::Large;
        }
        let explained = level.set_error[node] <= good.max(DIRECTED * large);
        match Set::direction_of(set) {
            Some(n) if explained => NodeKind::Directed(self.nearest(n)),
            _ => NodeKind::Samples,
        }
    }

    /// The published direction nearest to one that may be turned.
    fn nearest(&self, n: usize) -> usize {
        n % directions(self.dimensions)
    }

    /// How many nodes of each level are what, the finest level first.
    pub fn kinds(&self) -> Vec<LevelKinds> {
        let count = directions(self.dimensions);
        let none = || LevelKinds { directed: vec![0; count], ..LevelKinds::default() };
        let of = |level: &Level| {
            (0..level.set.len())
                .into_par_iter()
                .filter(|&node| level.samples[node] > 0)
                .fold(none, |mut all, node| {
                    all.nodes += 1;
                    match self.kind(level, node) {
                        NodeKind::Large => (all.large, all.points) = (all.large + 1, all.points + 1),
                        NodeKind::Samples => {
                            all.samples += 1;
                            all.points += (level.samples[node] as usize).min(1 << self.dimensions);
                        }
                        NodeKind::Directed(n) => {
                            all.directed[n] += 1;
                            all.points += Set::of(self.dimensions, level.set[node]).map_or(1, |set| set.points);
                        }
                    }
                    all
                })
                .reduce(none, |a, b| LevelKinds {
                    nodes: a.nodes + b.nodes,
                    points: a.points + b.points,
                    large: a.large + b.large,
                    samples: a.samples + b.samples,
                    directed: a.directed.iter().zip(&b.directed).map(|(a, b)| a + b).collect(),
                })
        };
        self.levels.iter().map(of).collect()
    }

    /// Whether nothing is spared at half a step of 8 bits: noise, of which nearly all points are leaves.
    pub fn is_noise(&self) -> bool {
        let Some(finest) = self.levels.first() else { return false };
        let samples: f64 = finest.samples.iter().map(|&n| f64::from(n)).sum();
        let good = self.tolerance().sqrt() / self.planes.weights.iter().sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        let cut = self.cut_by_maximum(good);
        samples > 1.0 && (samples - cut.points as f64) < SPARES * samples
    }
}
