//! Flow levels: particles of a step gathered to clusters whose tracks none of them leaves by more than an error, in space and time
//! (F12 6.3).
//!
//! Clusters are inherited from the step before. Those that break the criterion are split by principal components in the six dimensions
//! of place and velocity (F12 3.3 and 6.3.3), and then the nearest pairs are joined as long as the union holds it. Levels are nested: what
//! is together on a level is together on the coarser ones, so that a coarse track can be refined by the tracks that it consists of.
//!
//! The criterion looks at each particle itself, with the bound on the spline of its difference to its cluster
//! ([`HermiteSpline::bound`]); the thesis keeps two maxima over a cluster's members instead.

mod pairs;

use super::lattice::{LATTICE_BITS, Lattice};
use super::spline::HermiteSpline;
use crate::codec::principal_component;
use glam::DVec3;
use pairs::Pairs;
use rayon::prelude::*;
use std::cmp::Reverse;

/// The share of the error that a deviation over the interval before may take: the rest is for rounding.
const WITHIN: f64 = 1.0 - 1.0 / 512.0;
/// What a velocity weighs against a place in the criterion that the next interval asks for. A tangent's weight in (6.1) is 4/27 at
/// most; with more than that a cluster can stay together over the interval and not only fall apart in it.
const AHEAD: f64 = 6.0 / 27.0;
/// What a velocity weighs where clusters are split and where pairs are compared: the largest weight of a tangent in (6.1).
const TANGENT_WEIGHT: f64 = 4.0 / 27.0;
/// Places of clusters are rounded to less than this part of the error.
const ROUNDING: f64 = 1024.0;
/// Particles of a cluster that is split by several threads.
const PARALLEL: usize = 1 << 13;
/// Most levels that are found where nobody says how many.
const MOST_LEVELS: usize = 8;
/// Clusters that the finest level of a small run may have.
const FEW: usize = 256;

/// A particle at the step whose clusters are sought.
#[derive(Clone, Copy, Debug)]
pub struct Traveller {
    /// Where it is on the lattice, in the box.
    pub place: [i64; 3],
    /// Its velocity as a movement on the lattice.
    pub movement: [i64; 3],
    /// Its mass there.
    pub mass: f64,
    /// The cluster of the finest level that it was in at the step before, and its place and tangent there, world units; `None` of one
    /// that was not there.
    pub before: Option<(u32, DVec3, DVec3)>,
}

/// The clusters of a level at a step, of one family.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClusterList {
    /// Where they are on the lattice, in the box.
    pub places: Vec<[i64; 3]>,
    /// Their velocities as movements on the lattice.
    pub movements: Vec<[i64; 3]>,
    /// The cluster of the next coarser level that each is part of; none on the coarsest level.
    pub parents: Vec<u32>,
}

impl ClusterList {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Appends those of another part of space, whose parents are counted from `parents` on.
    pub fn append(&mut self, other: ClusterList, parents: u32) {
        self.places.extend(other.places);
        self.movements.extend(other.movements);
        self.parents.extend(other.parents.into_iter().map(|parent| parent + parents));
    }
}

/// The clusters of the step before as they are looked up: states in world units, and where each cluster of the finest level belongs.
#[derive(Clone, Debug, Default)]
pub struct Before {
    /// Of each level, the finest first: place and tangent.
    states: Vec<Vec<(DVec3, DVec3)>>,
    /// Of each level the cluster that each one of the finest is in.
    ancestors: Vec<Vec<u32>>,
}

impl Before {
    /// Those of a step, the finest level first; `rate` is the interval's length by the span of the step's movements.
    pub fn new(lattice: &Lattice, levels: &[ClusterList], rate: f64) -> Before {
        let state = |list: &ClusterList, i: usize| {
            let movement = DVec3::from(list.movements[i].map(|v| v as f64));
            (DVec3::from(lattice.position(list.places[i])), movement * (lattice.unit() * rate))
        };
        let states = levels.iter().map(|list| (0..list.len()).map(|i| state(list, i)).collect()).collect();
        let mut ancestors: Vec<Vec<u32>> = Vec::with_capacity(levels.len());
        for (level, list) in levels.iter().enumerate() {
            ancestors.push(match (level.checked_sub(1), ancestors.last()) {
                (Some(finer), Some(own)) => {
                    own.iter().map(|cluster| levels[finer].parents[*cluster as usize]).collect()
                }
                _ => (0..list.len() as u32).collect(),
            });
        }
        Before { states, ancestors }
    }

    /// The cluster of a level that a cluster of the finest one is in.
    pub fn ancestor(&self, level: usize, cluster: u32) -> u32 {
        self.ancestors[level][cluster as usize]
    }
}

/// How clusters are sought.
#[derive(Clone, Copy, Debug)]
pub struct Flow<'a> {
    /// The grid of places.
    pub lattice: &'a Lattice,
    /// The error of each level, the finest first, world units.
    pub errors: &'a [f64],
    /// The length of the interval before by the span of the step's movements: what gives tangents there.
    pub rate: f64,
    /// The same of the interval that comes next; `None` where there is none, and nothing has to last.
    pub next_rate: Option<f64>,
    /// Whether clusters of different ones before may be joined.
    pub is_joining: bool,
    /// Whether what is called before comes after: the step is the beginning of the interval.
    pub is_reversed: bool,
}

/// Clusters of travellers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Of each level, the finest first.
    pub levels: Vec<ClusterList>,
    /// The cluster of the finest level that each traveller is in.
    pub clusters: Vec<u32>,
}

impl Flow<'_> {
    /// Gathers travellers to clusters. The result depends on their order and on nothing else; not on the number of threads.
    pub fn gather(&self, travellers: &[Traveller], before: &Before) -> Gathered {
        let mut levels = Vec::with_capacity(self.errors.len());
        let mut groups: Vec<Vec<u32>> = vec![(0..travellers.len() as u32).collect()];
        let points: Vec<Point> = travellers.iter().map(Point::of).collect();
        let ends: Vec<[DVec3; 2]> = travellers
            .iter()
            .map(|traveller| {
                let movement = DVec3::from(traveller.movement.map(|v| v as f64));
                [DVec3::from(self.lattice.position(traveller.place)), movement * (self.lattice.unit() * self.rate)]
            })
            .collect();
        for level in (0..self.errors.len()).rev() {
            let of = Level::new(self, travellers, (&points, &ends), before, level);
            let parts: Vec<Vec<Part>> = groups.into_par_iter().map(|group| of.parts(&group)).collect();
            let is_coarsest = level + 1 == self.errors.len();
            let (mut list, mut next) = (ClusterList::default(), Vec::new());
            for (parent, parts) in parts.into_iter().enumerate() {
                for part in parts {
                    list.places.push(part.center.place);
                    list.movements.push(part.center.movement);
                    if !is_coarsest {
                        list.parents.push(parent as u32);
                    }
                    next.push(part.members);
                }
            }
            levels.push(list);
            groups = next;
        }
        levels.reverse();
        let mut clusters = vec![0; travellers.len()];
        for (cluster, members) in groups.iter().enumerate() {
            members.iter().for_each(|i| clusters[*i as usize] = cluster as u32);
        }
        Gathered { levels, clusters }
    }
}

/// The errors of flow levels, the finest first: so many as there are asked for, else from a sample of the particles at the first step
/// (their places, and movements in the first interval, world units; each stands for `weight` particles) as many as keep the finest
/// level small beside the particles. The coarsest one is `root`, where it is said, else half of how far the middle 80 % of the
/// sample reach; each finer one is half of it.
pub fn flow_errors(
    lattice: &Lattice,
    sample: &[Traveller],
    weight: f64,
    rate: f64,
    levels: Option<usize>,
    root: Option<f64>,
) -> Vec<f64> {
    let extent = |axis: usize| {
        let mut values: Vec<i64> = sample.iter().map(|traveller| traveller.place[axis]).collect();
        values.sort_unstable();
        let at = |share: f64| values.get((share * (values.len().max(1) - 1) as f64) as usize).copied().unwrap_or(0);
        (at(0.9) - at(0.1)) as f64 * lattice.unit()
    };
    let own = || (0..3).map(extent).fold(0.0, f64::max) / 2.0;
    let root = root.unwrap_or_else(own).max(lattice.unit() * ROUNDING);
    let errors = |levels: usize| (0..levels).rev().map(|level| root / f64::from(1_u32 << level)).collect::<Vec<_>>();
    if let Some(levels) = levels {
        return errors(levels);
    }
    let all = errors(MOST_LEVELS);
    let flow = Flow { lattice, errors: &all, rate, next_rate: Some(rate), is_joining: true, is_reversed: false };
    let gathered = flow.gather(sample, &Before::default());
    let most = (sample.len() / 16).min((sample.len() as f64 * weight / 128.0) as usize).max(FEW);
    let few = gathered.levels.iter().rev().take_while(|list| list.len() <= most).count();
    errors(few.max(1))
}

/// A traveller as sums take it, in a line of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Point {
    place: [f64; 3],
    movement: [f64; 3],
    mass: f64,
}

impl Point {
    fn of(traveller: &Traveller) -> Point {
        let [place, movement] = [traveller.place, traveller.movement].map(|state| state.map(|x| x as f64));
        // What has no mass has a place all the same.
        Point { place, movement, mass: traveller.mass.max(1e-60) }
    }
}

/// One level of a flow.
struct Level<'a> {
    flow: &'a Flow<'a>,
    points: &'a [Point],
    /// Place and tangent of each traveller, world units.
    ends: &'a [[DVec3; 2]],
    /// The same less those of its cluster at the step before; zeros of one that was not there.
    before: Vec<[DVec3; 2]>,
    /// The cluster of this level that each was in at the step before.
    ancestors: Vec<u32>,
    error: f64,
    exponent: u32,
}

/// Sums over travellers: mass, and places and movements times mass.
#[derive(Clone, Copy, Default)]
struct Sums {
    mass: f64,
    place: [f64; 3],
    movement: [f64; 3],
}

impl Sums {
    fn with(self, other: Sums) -> Sums {
        let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|k| a[k] + b[k]);
        Sums {
            mass: self.mass + other.mass,
            place: sum(self.place, other.place),
            movement: sum(self.movement, other.movement),
        }
    }
}

/// A cluster's state at the step.
#[derive(Clone, Copy)]
struct Center {
    place: [i64; 3],
    movement: [i64; 3],
    position: DVec3,
    tangent: DVec3,
}

/// Travellers that are a cluster.
struct Part {
    members: Vec<u32>,
    sums: Sums,
    center: Center,
    /// The box around places and weighted tangents.
    low: [f64; 6],
    high: [f64; 6],
}

impl Part {
    /// How far the centres are apart, in place and tangent.
    fn distances(&self, other: &Part) -> [f64; 2] {
        [self.center.position - other.center.position, self.center.tangent - other.center.tangent].map(DVec3::length)
    }

    /// Whether the union with another one is wider than a cluster can be.
    fn is_apart(&self, other: &Part, error: f64) -> bool {
        (0..6).any(|i| self.high[i].max(other.high[i]) - self.low[i].min(other.low[i]) > 2.0 * error)
    }
}

impl<'a> Level<'a> {
    fn new(
        flow: &'a Flow<'a>,
        travellers: &[Traveller],
        (points, ends): (&'a [Point], &'a [[DVec3; 2]]),
        before: &Before,
        level: usize,
    ) -> Level<'a> {
        let error = flow.errors[level];
        let units = (error / ROUNDING / flow.lattice.unit()).max(1.0);
        let exponent = (units.log2().floor() as u32).min(LATTICE_BITS);
        let of = |traveller: &Traveller| match traveller.before {
            None => (u32::MAX, [DVec3::ZERO; 2]),
            Some((cluster, place, tangent)) => {
                let cluster = before.ancestor(level, cluster);
                let (position, own) = before.states[level][cluster as usize];
                (cluster, [place - position, tangent - own])
            }
        };
        let (ancestors, before) = travellers.iter().map(of).unzip();
        Level { flow, points, ends, before, ancestors, error, exponent }
    }

    /// The clusters of a group.
    fn parts(&self, group: &[u32]) -> Vec<Part> {
        let ancestor = |i: &u32| self.ancestors[*i as usize];
        let mut keys: Vec<u64> = group.iter().map(|i| u64::from(ancestor(i)) << 32 | u64::from(*i)).collect();
        keys.sort_unstable();
        let mut members: Vec<u32> = keys.iter().map(|key| *key as u32).collect();
        let mut inherited: Vec<&mut [u32]> = members.chunk_by_mut(|a, b| ancestor(a) == ancestor(b)).collect();
        let split = |members: &mut &mut [u32]| {
            let mut parts = Vec::new();
            self.split(members, &mut parts);
            parts
        };
        let parts = match group.len() > PARALLEL {
            true => inherited.par_iter_mut().flat_map_iter(split).collect(),
            false => inherited.iter_mut().flat_map(split).collect(),
        };
        if self.flow.is_joining { self.join(parts) } else { parts }
    }

    /// Splits travellers until each part is a cluster; the parts go to `out`.
    fn split(&self, members: &mut [u32], out: &mut Vec<Part>) {
        if let Some(part) = self.cluster(members) {
            return out.push(part);
        }
        let is_large = members.len() > PARALLEL;
        let (near, far) = self.halves(members);
        if is_large {
            let mut more = Vec::new();
            rayon::join(|| self.split(near, out), || self.split(far, &mut more));
            out.extend(more);
        } else {
            self.split(near, out);
            self.split(far, out);
        }
    }

    /// Where the centre of mass is.
    fn center(&self, sums: &Sums) -> Center {
        let place = Lattice::settle(sums.place.map(|x| x / sums.mass), self.exponent);
        let movement = Lattice::settle(sums.movement.map(|v| v / sums.mass), self.exponent);
        let lattice = self.flow.lattice;
        let tangent = DVec3::from(movement.map(|v| v as f64)) * (lattice.unit() * self.flow.rate);
        Center { place, movement, position: DVec3::from(lattice.position(place)), tangent }
    }

    /// Travellers as a cluster, if the criterion holds; one alone is always one.
    fn cluster(&self, members: &[u32]) -> Option<Part> {
        let mut sums = Sums::default();
        for i in members {
            let Point { place, movement, mass } = &self.points[*i as usize];
            sums.mass += mass;
            sums.place.iter_mut().zip(place).for_each(|(sum, x)| *sum += mass * x);
            sums.movement.iter_mut().zip(movement).for_each(|(sum, v)| *sum += mass * v);
        }
        let center = self.center(&sums);
        if members.len() > 1 && !self.holds(members, &center) {
            return None;
        }
        let (mut low, mut high) = ([f64::INFINITY; 6], [f64::NEG_INFINITY; 6]);
        for i in members {
            let state = self.state(*i);
            for k in 0..6 {
                low[k] = low[k].min(state[k]);
                high[k] = high[k].max(state[k]);
            }
        }
        Some(Part { members: members.to_vec(), sums, center, low, high })
    }

    /// The union of two clusters, if it is one.
    fn union(&self, first: &Part, second: &Part) -> Option<Part> {
        let sums = first.sums.with(second.sums);
        let center = self.center(&sums);
        // Those of the smaller one are farther from the common centre.
        let [small, large] = if first.members.len() < second.members.len() { [first, second] } else { [second, first] };
        if ![small, large].into_iter().all(|part| self.holds(&part.members, &center)) {
            return None;
        }
        Some(Part {
            members: [&first.members[..], &second.members[..]].concat(),
            sums,
            center,
            low: std::array::from_fn(|k| first.low[k].min(second.low[k])),
            high: std::array::from_fn(|k| first.high[k].max(second.high[k])),
        })
    }

    /// Whether travellers may be where they are from a cluster.
    fn holds(&self, members: &[u32], center: &Center) -> bool {
        let limit = self.error * WITHIN;
        let square = limit * limit;
        let ahead = self.flow.next_rate.map(|next| (AHEAD * next / self.flow.rate) * (AHEAD * next / self.flow.rate));
        members.iter().all(|i| {
            let [place, tangent] = self.ends[*i as usize];
            let (off, off_tangent) = (place - center.position, tangent - center.tangent);
            if let Some(ahead) = ahead {
                // The sum of two lengths, by their squares.
                let (a, b) = (off.length_squared(), ahead * off_tangent.length_squared());
                if 2.0 * (a + b) > square && a + b + 2.0 * (a * b).sqrt() > square {
                    return false;
                }
            }
            let [begin, begin_tangent] = self.before[*i as usize];
            let (mut positions, mut tangents) = ([begin, off], [begin_tangent, off_tangent]);
            if self.flow.is_reversed {
                positions.reverse();
                tangents.reverse();
            }
            HermiteSpline { positions, tangents }.is_within(limit)
        })
    }

    /// Place and weighted tangent.
    fn state(&self, i: u32) -> [f64; 6] {
        let [place, tangent] = self.ends[i as usize];
        let tangent = TANGENT_WEIGHT * tangent;
        [place.x, place.y, place.z, tangent.x, tangent.y, tangent.z]
    }

    /// Both sides of the plane through the centroid across the principal component of places and weighted tangents.
    fn halves<'b>(&self, members: &'b mut [u32]) -> (&'b mut [u32], &'b mut [u32]) {
        let count = members.len() as f64;
        let mut mean = [0.0; 6];
        for i in &*members {
            mean.iter_mut().zip(self.state(*i)).for_each(|(sum, x)| *sum += x);
        }
        let mean = mean.map(|sum| sum / count);
        let mut covariance = [[0.0; 6]; 6];
        for i in &*members {
            let state = self.state(*i);
            let off: [f64; 6] = std::array::from_fn(|k| state[k] - mean[k]);
            for (row, a) in covariance.iter_mut().zip(off) {
                row.iter_mut().zip(off).for_each(|(sum, b)| *sum += a * b);
            }
        }
        let trace = (0..6).map(|i| covariance[i][i]).sum();
        let normal = principal_component(&covariance, trace).map(f64::from);
        let mut near = 0;
        for at in 0..members.len() {
            let own = self.state(members[at]);
            if (0..6).map(|k| normal[k] * (own[k] - mean[k])).sum::<f64>() <= 0.0 {
                members.swap(near, at);
                near += 1;
            }
        }
        // All in one place: they differ in where they come from.
        let is_cut = near > 0 && near < members.len();
        let middle = if is_cut { near } else { members.len() / 2 };
        members.split_at_mut(middle)
    }

    /// Joins the nearest pairs as long as their unions are clusters.
    fn join(&self, parts: Vec<Part>) -> Vec<Part> {
        if parts.len() < 2 {
            return parts;
        }
        let mut pairs = Pairs::new(self, parts);
        for i in 0..pairs.parts.len() {
            pairs.offer(i);
        }
        let mut last = None;
        while let Some(Reverse(pair @ (_, a, b))) = pairs.queue.pop() {
            // Both of a pair may have queued it.
            if last.replace(pair) == Some(pair) {
                continue;
            }
            let (Some(first), Some(second)) = (&pairs.parts[a], &pairs.parts[b]) else { continue };
            if let Some(joined) = self.union(first, second) {
                pairs.replace([a, b], joined);
            }
        }
        pairs.parts.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests;
