//! HE03's data structure: nodes of clusters apart from the points, which lie in runs and have coordinates relative to a cluster.
//!
//! All points so many levels below a cluster (`delta_n`) lie in one run, with the cluster's centroid and scale for their coordinates, so
//! that one loop draws them. Coordinates have 16 bits each, diameters 16 bits, masses are singles.

use super::levels::Level;
use crate::model::Bounds;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Largest code of a coordinate.
const COORDINATE: f64 = i16::MAX as f64;
/// Largest code of a diameter.
const DIAMETER: f64 = u16::MAX as f64;

/// Clusters that one task codes.
const CHUNK: usize = 4096;

/// A cluster. Lengths in world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Node {
    /// Its centroid from the structure's origin: what its points are relative to.
    pub centre: [f32; 3],
    /// A step of their coordinates.
    pub step: f32,
    /// The largest of their diameters.
    pub diameter: f32,
    /// How far anything in the cluster reaches from the centroid at most.
    pub reach: f32,
}

/// A point relative to a cluster.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Place in steps of the cluster's coordinates.
    pub place: [i16; 3],
    /// Diameter as a fraction of the cluster's largest.
    pub diameter: u16,
    /// Mass.
    pub mass: f32,
}

/// What a level holds.
#[derive(Clone, Debug, Default, PartialEq)]
struct Tier {
    /// Clusters whose points are drawn at once; none of the finest `delta_n` levels.
    nodes: Vec<Node>,
    /// Where the clusters of each begin in the next finer level, and the end; empty for the finest.
    starts: Vec<u32>,
    /// Points; none of the coarsest levels, which no cluster is so far above.
    points: Vec<Point>,
}

/// The whole. Level 0 is one cluster of everything, level 1 the coarsest that is drawn, and the last one has the particles.
#[derive(Clone, Debug, PartialEq)]
pub struct Relative {
    delta: usize,
    origin: DVec3,
    tiers: Vec<Tier>,
}

impl Relative {
    /// Codes levels, the coarsest first, for clusters that draw what is `delta` levels below them; fewer where there are no more levels.
    pub fn new(levels: &[Level], delta: usize) -> Relative {
        let delta = delta.clamp(1, levels.len().max(1));
        let bounds = levels.first().map_or(Bounds::EMPTY, |level| Bounds::of(level.places.iter().copied()));
        let mut relative = Relative { delta, origin: bounds.center(), tiers: Vec::with_capacity(levels.len() + 1) };
        let root = levels.first().map_or(Vec::new(), |level| vec![0, level.len() as u32]);
        relative.tiers.push(Tier { starts: root, ..Tier::default() });
        relative.tiers.extend(levels.iter().map(|level| Tier { starts: level.starts.clone(), ..Tier::default() }));
        for number in 0..=levels.len().saturating_sub(delta) {
            let Some(finer) = number.checked_add(delta - 1).and_then(|finer| levels.get(finer)) else { break };
            let own = number.checked_sub(1).map(|own| &levels[own]);
            let (nodes, points) = relative.coded(number, own, finer);
            relative.tiers[number].nodes = nodes;
            relative.tiers[number + delta].points = points;
        }
        relative
    }

    /// The clusters of a level, of which that of everything has no points of its own, and what they draw.
    fn coded(&self, number: usize, own: Option<&Level>, finer: &Level) -> (Vec<Node>, Vec<Point>) {
        let count = own.map_or(1, Level::len);
        let chunk = |start: usize| {
            let (mut nodes, mut points) = (Vec::new(), Vec::new());
            for index in start..count.min(start + CHUNK) {
                let centre = own.map_or(self.origin, |own| DVec3::from_array(own.places[index]));
                let mut node = self.cluster(centre, finer, self.run(number, index), &mut points);
                node.reach = match own {
                    // Centroids of whatever is in a cluster are no farther than the particles, and no diameter is larger than its own.
                    Some(own) => above(own.reach[index] + 0.5 * own.diameters[index]),
                    None => f32::INFINITY,
                };
                nodes.push(node);
            }
            (nodes, points)
        };
        let starts: Vec<usize> = (0..count).step_by(CHUNK).collect();
        let chunks: Vec<(Vec<Node>, Vec<Point>)> = starts.into_par_iter().map(chunk).collect();
        let (mut nodes, mut points) = (Vec::with_capacity(count), Vec::with_capacity(finer.len()));
        for (mut own, mut drawn) in chunks {
            nodes.append(&mut own);
            points.append(&mut drawn);
        }
        (nodes, points)
    }

    /// A cluster, which appends what it draws to `points`.
    fn cluster(&self, centre: DVec3, finer: &Level, range: Range<usize>, points: &mut Vec<Point>) -> Node {
        let centre = (centre - self.origin).as_vec3();
        // From the centroid as it is stored, whose rounding then costs nothing.
        let away = |i: usize| DVec3::from_array(finer.places[i]) - self.origin - centre.as_dvec3();
        let farthest = range.clone().map(|i| away(i).abs().max_element()).fold(0.0, f64::max);
        let largest = range.clone().map(|i| finer.diameters[i]).fold(0.0, f64::max);
        let (step, diameter) = (above(farthest / COORDINATE), above(largest));
        // What has no extent has no steps.
        let code = |length: f64, step: f32| if step > 0.0 { (length / f64::from(step)).round() } else { 0.0 };
        let point = |i: usize| Point {
            place: away(i).to_array().map(|length| code(length, step) as i16),
            diameter: (finer.diameters[i] / f64::from(diameter) * DIAMETER).round().max(1.0) as u16,
            mass: finer.mass[i] as f32,
        };
        points.extend(range.map(point));
        Node { centre: centre.to_array(), step, diameter, reach: 0.0 }
    }

    /// So many levels below a cluster are its points.
    pub fn delta(&self) -> usize {
        self.delta
    }

    /// What centroids are relative to.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// The number of the level of particles.
    pub fn finest(&self) -> usize {
        self.tiers.len() - 1
    }

    /// A cluster of a level.
    pub fn node(&self, level: usize, index: usize) -> &Node {
        &self.tiers[level].nodes[index]
    }

    /// The clusters of the next finer level that a cluster has.
    pub fn children(&self, level: usize, index: usize) -> Range<usize> {
        self.below(level, index..index + 1)
    }

    /// What some clusters have in the next finer level.
    fn below(&self, level: usize, range: Range<usize>) -> Range<usize> {
        let starts = &self.tiers[level].starts;
        starts[range.start] as usize..starts[range.end] as usize
    }

    /// The run of points that a cluster draws, among those of the level `delta` below.
    pub fn run(&self, level: usize, index: usize) -> Range<usize> {
        (level..level + self.delta).fold(index..index + 1, |range, level| self.below(level, range))
    }

    /// The points of a level.
    pub fn points(&self, level: usize) -> &[Point] {
        &self.tiers[level].points
    }

    /// Bytes that all of it takes.
    pub fn bytes(&self) -> u64 {
        let tier =
            |tier: &Tier| size_of_val(&tier.nodes[..]) + size_of_val(&tier.starts[..]) + size_of_val(&tier.points[..]);
        self.tiers.iter().map(tier).sum::<usize>() as u64
    }
}

impl Node {
    /// Where a point of the cluster is, from the structure's origin.
    #[inline]
    pub fn place(&self, point: &Point) -> [f32; 3] {
        std::array::from_fn(|k| self.centre[k] + f32::from(point.place[k]) * self.step)
    }

    /// Its diameter.
    #[inline]
    pub fn diameter_of(&self, point: &Point) -> f32 {
        f32::from(point.diameter) * (self.diameter / DIAMETER as f32)
    }
}

/// The next single that is not less.
fn above(value: f64) -> f32 {
    let single = value as f32;
    if f64::from(single) < value { single.next_up() } else { single }
}
