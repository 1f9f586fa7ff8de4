//! What nodes are: one large point, samples, or directed, each by the set that its own error chose.

use super::grid::{children, for_each_place, index};
use super::sets::{NONE, Set, directions};
use super::tree::{Hierarchy, Level};
use rayon::prelude::*;

/// What is drawn of a node is good enough where the root of its mean squared error is below this share of the range: half a step of 8 bits.
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
    /// Directed along a published direction, see [`super::sets::direction`]: that of its set or, where this lies between two of them, the one
    /// along which values around the node change more.
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

/// The squared error per sample that is good enough, weighted over planes of these ranges.
pub(super) fn tolerance(weights: &[f32], ranges: &[(f32, f32)]) -> f32 {
    let spans = ranges.iter().map(|(low, high)| high - low);
    weights.iter().zip(spans).map(|(w, span)| w * span * span).sum::<f32>() * TOLERANCE * TOLERANCE
}

impl Hierarchy {
    fn tolerance(&self) -> f32 {
        tolerance(&self.planes.weights, &self.ranges)
    }

    /// What a node of a hierarchy that was built is; a file has no more than what [`Hierarchy::kinds`] found.
    pub fn kind(&self, level: &Level, node: usize) -> NodeKind {
        let (good, large) = (self.tolerance() * level.samples[node] as f32, level.large_error[node]);
        if large <= good {
            return NodeKind::Large;
        }
        let explained = level.set_error[node] <= good.max(DIRECTED * large);
        if level.set[node] == NONE || !explained {
            return NodeKind::Samples;
        }
        NodeKind::Directed(usize::from(level.toward[node]))
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
                            all.points += Set::points_of(self.dimensions, level.set[node]).unwrap_or(1);
                        }
                    }
                    all
                })
                .reduce(none, |mut a, b| {
                    a += &b;
                    a
                })
        };
        self.levels.iter().map(of).collect()
    }

    /// The difference that is good enough.
    pub(super) fn good_enough(&self) -> f32 {
        self.tolerance().sqrt() / self.planes.weights.iter().sum::<f32>().sqrt().max(f32::MIN_POSITIVE)
    }

    /// How many points the nodes of the last level have in the cut by measured largest differences; `below` are those of the nodes below
    /// the first level, where these are no samples.
    pub(super) fn points_within(&self, most: f32, mut below: Option<Vec<usize>>) -> Vec<usize> {
        let mut finer = self.shape;
        for level in &self.levels {
            let points = for_each_place(level.shape, |at| {
                let node = index(level.shape, at);
                match &below {
                    _ if level.samples[node] == 0 => 0,
                    _ if level.large_max[node] <= most => 1,
                    _ if level.set_max[node] <= most => Set::points_of(self.dimensions, level.set[node]).unwrap_or(1),
                    Some(below) => children(self.dimensions, finer, at).map(|child| below[child]).sum(),
                    None => level.samples[node] as usize,
                }
            });
            below = Some(points);
            finer = level.shape;
        }
        below.unwrap_or_default()
    }
}

impl std::ops::AddAssign<&LevelKinds> for LevelKinds {
    fn add_assign(&mut self, other: &LevelKinds) {
        self.nodes += other.nodes;
        self.points += other.points;
        self.large += other.large;
        self.samples += other.samples;
        self.directed.resize(self.directed.len().max(other.directed.len()), 0);
        self.directed.iter_mut().zip(&other.directed).for_each(|(own, other)| *own += other);
    }
}
