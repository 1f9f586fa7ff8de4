//! Clusters of tracks: tracks that begin near each other, end near each other and are alike become one.
//!
//! Cells are cut at both ends of the interval: tracks are merged that begin in one cell and end in one cell. A cluster's quantities
//! are the means of its members' at each end, as merged particles have them ([`crate::hierarchy::octree`]); since (6.1) is linear,
//! its spline is the mean of their splines where masses do not change. How far any source particle is from its cluster at any time
//! is bounded by the hull of the control points of their difference, of which boxes are carried along.

use super::lattice::Lattice;
use super::tracks::{Interval, TrackEnd, Tracks};
use crate::codec::AttributeMerge;
use crate::model::Bounds;
use glam::DVec3;

/// Bits of a cell's coordinate at most: six coordinates fit in a key.
const BITS: u32 = 10;
/// Largest difference of smoothing lengths, in cells, of tracks that are merged and wider than a cell.
const FUSION: f32 = 0.25;
/// A cluster's place is rounded to this power of two of a cell.
const ROUNDING_BITS: u32 = 6;

/// Spreads the bits of a coordinate so that five others fit between them.
const SPREAD: [u64; 1 << BITS] = {
    let mut table = [0; 1 << BITS];
    let mut value = 0;
    while value < table.len() {
        let mut bit = 0;
        while bit < BITS {
            table[value] |= ((value as u64 >> bit) & 1) << (6 * bit);
            bit += 1;
        }
        value += 1;
    }
    table
};

/// Where the control points of the source tracks of a cluster are, world units.
type Reach = [Bounds; 4];

/// Tracks that stand for source particles: themselves, or clusters.
#[derive(Clone, Debug, Default)]
pub struct Clusters {
    /// The tracks; those of clusters have no ids.
    pub tracks: Tracks,
    /// Boxes around the control points of what each stands for; of source particles none are needed.
    reaches: Vec<Reach>,
}

/// What tracks were merged to.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The clusters.
    pub clusters: Clusters,
    /// Largest distance at any time of the interval that a source particle can have from its cluster, world units.
    pub delta: f64,
    /// Longest edge of the cells, world units.
    pub spacing: f64,
}

impl Clusters {
    /// Source particles.
    pub fn of_sources(tracks: Tracks) -> Clusters {
        Clusters { tracks: Tracks { ids: Vec::new(), ..tracks }, reaches: Vec::new() }
    }

    fn reach(&self, interval: &Interval, i: usize) -> Reach {
        let own = || interval.spline(&self.tracks, i).control_points().map(|point| Bounds { min: point, max: point });
        self.reaches.get(i).copied().unwrap_or_else(own)
    }
}

/// Merges tracks until at most about `most` are left: cells are as small as that allows. What differs in flags, or in smoothing
/// lengths that are wider than cells, is not merged. `rules` says of each attribute how it is averaged.
pub fn merge(interval: &Interval, rules: &[AttributeMerge], parts: &[&Clusters], most: usize) -> Merged {
    let (all, exponent) = sorted(parts, most);
    let spacing = interval.lattice.unit() * (1_u64 << exponent) as f64;
    let mut out = Clusters { tracks: Tracks::new(rules.len()), reaches: Vec::new() };
    let mut delta = 0.0_f64;
    let mut group: Vec<Member> = Vec::new();
    for cell in all.chunk_by(|a, b| a.cell == b.cell) {
        // Alike ones are neighbours then: by flags, the narrow ones first.
        group.clear();
        group.extend_from_slice(cell);
        let width = |member: &Member| {
            let of = |end: usize| parts[member.part as usize].tracks.ends[end].smoothing_length[member.index as usize];
            of(0).max(of(1))
        };
        let flags = |member: &Member| parts[member.part as usize].tracks.flags[member.index as usize].0;
        group.sort_unstable_by(|a, b| {
            flags(a)
                .cmp(&flags(b))
                .then(width(a).total_cmp(&width(b)))
                .then(a.part.cmp(&b.part))
                .then(a.index.cmp(&b.index))
        });
        let mut rest = &group[..];
        while let Some(first) = rest.first() {
            let q = spacing as f32;
            let limit = if width(first) <= q { q } else { width(first) + FUSION * q };
            let is_alike = |member: &&Member| flags(member) == flags(first) && width(member) <= limit;
            let (members, after) = rest.split_at(rest.iter().take_while(is_alike).count().max(1));
            out.push(interval, rules, parts, members, exponent.saturating_sub(ROUNDING_BITS));
            rest = after;
        }
    }
    for i in 0..out.tracks.len() {
        let points = interval.spline(&out.tracks, i).control_points();
        for (reach, point) in out.reaches[i].iter().zip(points) {
            let farthest = (point - reach.min).abs().max((reach.max - point).abs());
            delta = delta.max(farthest.length());
        }
    }
    Merged { clusters: out, delta, spacing }
}

/// A track that is to be merged.
#[derive(Clone, Copy, Debug)]
struct Member {
    cell: u64,
    part: u32,
    index: u32,
}

/// All tracks by the cells of both ends, and the power of two that a cell's longest edge has in units of the lattice.
fn sorted(parts: &[&Clusters], most: usize) -> (Vec<Member>, u32) {
    let mut corners = [[i64::MAX; 3]; 2];
    let mut extent = 0;
    for (end, corner) in corners.iter_mut().enumerate() {
        let places = || parts.iter().flat_map(|part| &part.tracks.ends[end].places);
        for (axis, corner) in corner.iter_mut().enumerate() {
            let (low, high) =
                places().fold((i64::MAX, i64::MIN), |(low, high), place| (low.min(place[axis]), high.max(place[axis])));
            *corner = low;
            extent = extent.max(high.saturating_sub(low));
        }
    }
    let exponent = (64 - extent.max(0).leading_zeros()).saturating_sub(BITS);
    let key = |tracks: &Tracks, i: usize| {
        let mut key = 0;
        for (end, corner) in corners.iter().enumerate() {
            for (axis, least) in corner.iter().enumerate() {
                // Not above 10 bits, since the extent is not.
                let coordinate = (tracks.ends[end].places[i][axis] - least) >> exponent;
                key |= SPREAD[coordinate as usize] << (2 * axis + end);
            }
        }
        key
    };
    let members = parts.iter().enumerate().flat_map(|(part, own)| {
        (0..own.tracks.len()).map(move |index| Member {
            cell: key(&own.tracks, index),
            part: part as u32,
            index: index as u32,
        })
    });
    let mut members: Vec<Member> = members.collect();
    members.sort_unstable_by_key(|member| (member.cell, member.part, member.index));
    // One axis after the other, at both ends together: so there is at most twice as much as could be.
    let cells = |step: u32| members.chunk_by(|a, b| a.cell >> (2 * step) == b.cell >> (2 * step)).count();
    let step = (0..3 * BITS).find(|step| cells(*step) <= most).unwrap_or(3 * BITS);
    members.iter_mut().for_each(|member| member.cell >>= 2 * step);
    (members, exponent + step.div_ceil(3))
}

impl Clusters {
    /// Appends what some tracks become, rounded to multiples of `2^exponent` units.
    fn push(
        &mut self,
        interval: &Interval,
        rules: &[AttributeMerge],
        parts: &[&Clusters],
        members: &[Member],
        exponent: u32,
    ) {
        let tracks = |member: &Member| &parts[member.part as usize].tracks;
        if let Some(first) = members.first() {
            self.tracks.flags.push(tracks(first).flags[first.index as usize]);
        }
        for (end, out) in self.tracks.ends.iter_mut().enumerate() {
            let mut sums = Sums::default();
            for member in members {
                sums.add(&tracks(member).ends[end], member.index as usize);
            }
            let weight = sums.weight;
            out.places.push(Lattice::settle(sums.place.map(|x| x / weight), exponent));
            out.movements.push(Lattice::settle(sums.movement.map(|v| v / weight), exponent));
            out.mass.push(single(sums.mass));
            out.density.push(single(sums.presence / weight));
            out.smoothing_length.push(single(sums.smoothing_length / weight));
            for (k, (out, rule)) in out.attributes.iter_mut().zip(rules).enumerate() {
                let values = members.iter().map(|member| {
                    let own = &tracks(member).ends[end];
                    let i = member.index as usize;
                    (f64::from(own.mass[i]), f64::from(own.attributes[k][i]))
                });
                out.push(single(match rule {
                    _ if members.len() == 1 => values.map(|(_, value)| value).sum(),
                    AttributeMerge::Mean if sums.mass > 0.0 => {
                        values.map(|(mass, value)| mass * value).sum::<f64>() / sums.mass
                    }
                    AttributeMerge::Mean => values.map(|(_, value)| value).sum::<f64>() / members.len() as f64,
                    AttributeMerge::Magnitude => {
                        let flux: f64 = values.map(|(_, value)| 10.0_f64.powf(-0.4 * value)).sum();
                        -2.5 * flux.log10()
                    }
                }));
            }
        }
        let reaches = members.iter().map(|member| parts[member.part as usize].reach(interval, member.index as usize));
        let around = |all: Reach, own: Reach| std::array::from_fn(|i| all[i].union(own[i]));
        self.reaches.push(reaches.fold([Bounds::EMPTY; 4], around));
    }
}

/// The least weight of a track in a mean.
const LEAST_WEIGHT: f64 = 1e-60;

/// Sums of an end's quantities, weighted with mass.
#[derive(Default)]
struct Sums {
    mass: f64,
    weight: f64,
    presence: f64,
    smoothing_length: f64,
    place: [f64; 3],
    movement: [f64; 3],
}

impl Sums {
    fn add(&mut self, end: &TrackEnd, i: usize) {
        let mass = f64::from(end.mass[i]);
        // What has no mass has a place all the same.
        let weight = mass.max(LEAST_WEIGHT);
        self.mass += mass;
        self.weight += weight;
        self.presence += mass * f64::from(end.density[i]);
        self.smoothing_length += weight * f64::from(end.smoothing_length[i]);
        self.place.iter_mut().zip(end.places[i]).for_each(|(sum, x)| *sum += weight * x as f64);
        self.movement.iter_mut().zip(end.movements[i]).for_each(|(sum, v)| *sum += weight * v as f64);
    }
}

/// The nearest finite single.
fn single(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

impl Tracks {
    /// A box around all tracks for the whole interval, world units.
    pub fn bounds(&self, interval: &Interval) -> Bounds {
        let points = (0..self.len()).flat_map(|i| interval.spline(self, i).control_points());
        points.fold(Bounds::EMPTY, |bounds: Bounds, point: DVec3| bounds.with(point))
    }
}
