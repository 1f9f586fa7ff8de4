//! The flow levels of a region: the clusters where its tracks end, and the tracks that lead to them.

use super::flow::FlowStep;
use super::flow_levels::{FlowLevels, Place};
use super::flow_sums::Sums;
use super::matching::{NOBODY, TrackRecord, UNRESOLVED, track_words};
use crate::codec::AttributeMerge;
use crate::codec::states::{MASS_BITS, VALUE_BITS, float_of, round_float};
use crate::hierarchy::spacetime::lattice::morton_key;
use crate::hierarchy::spacetime::{Before, ClusterList, Flow, Gathered, Lattice, TrackFlags, Traveller};
use glam::DVec3;
use std::cmp::Ordering;

/// The tracks of a region, in an order that depends on them alone.
pub(super) struct Region<'a> {
    records: Vec<&'a [u32]>,
    /// The place of each in the region's records.
    order: Vec<u32>,
    step: &'a FlowStep<'a>,
    pub rules: &'a [AttributeMerge],
    /// Both ends of each: places in the box and movements, as leaves have them.
    states: [Vec<([i64; 3], [i64; 3])>; 2],
    /// The same of mass, density, smoothing length and attributes.
    columns: [Vec<Vec<f32>>; 2],
    flags: Vec<TrackFlags>,
    /// Their clusters of the finest level at the beginning.
    begins: Vec<u32>,
    pub is_unresolved: Vec<bool>,
}

/// What was found in a region.
pub(super) struct BuiltRegion {
    pub gathered: Gathered,
    pub flow: FlowLevels,
    /// Of each record the track of the finest level that it belongs to, from the region's first one on.
    pub tracks: Vec<u32>,
    /// Of each record its cluster at the end; [`NOBODY`] of those that are not there.
    pub ends: Vec<u32>,
}

impl<'a> Region<'a> {
    pub fn of(records: &'a [u32], step: &'a FlowStep<'a>, rules: &'a [AttributeMerge]) -> Region<'a> {
        let words = track_words(step.layout);
        let lattice = &step.layout.lattice;
        let record = |i: u32| &records[i as usize * words..(i as usize + 1) * words];
        // Neighbours beside each other, and not by the numbers of clusters, which depend on the regions before.
        let place = |record: &[u32]| morton_key(step.in_box(TrackRecord::of(record).places[1]));
        let mut order: Vec<(u64, u32)> = records.chunks_exact(words).map(place).zip(0..).collect();
        order.sort_unstable_by(|a, b| {
            a.0.cmp(&b.0).then_with(|| TrackRecord::content(record(a.1)).cmp(&TrackRecord::content(record(b.1))))
        });
        let count = order.len();
        let quantities = 3 + rules.len();
        let column = || vec![Vec::with_capacity(count); quantities];
        let mut region = Region {
            records: order.iter().map(|(_, i)| record(*i)).collect(),
            order: order.iter().map(|(_, i)| *i).collect(),
            step,
            rules,
            states: [Vec::with_capacity(count), Vec::with_capacity(count)],
            columns: [column(), column()],
            flags: Vec::with_capacity(count),
            begins: Vec::with_capacity(count),
            is_unresolved: Vec::with_capacity(count),
        };
        for record in &region.records {
            let track = TrackRecord::of(record);
            for (end, values) in track.values.into_iter().enumerate() {
                let exponent = lattice.exponent(values[2]);
                let velocity = track.velocities[end].map(f64::from);
                let movement = lattice.movement(velocity, step.space.spans[end], exponent);
                region.states[end].push((step.in_box(track.places[end]), movement));
                for (k, (column, value)) in region.columns[end].iter_mut().zip(values).enumerate() {
                    let bits = if k == 0 { MASS_BITS } else { VALUE_BITS };
                    column.push(float_of(round_float(*value, bits), bits));
                }
            }
            region.flags.push(track.flags);
            region.begins.push(track.numbers[0]);
            region.is_unresolved.push(track.unresolved > UNRESOLVED);
        }
        region
    }

    /// Which image of the box the end of a track is in, seen from its beginning: what is added to a place in the box.
    pub fn shift(&self, i: usize) -> [i64; 3] {
        let record = TrackRecord::of(self.records[i]);
        let inside = [0, 1].map(|end| self.states[end][i].0);
        std::array::from_fn(|axis| {
            (record.places[1][axis] - inside[1][axis]) - (record.places[0][axis] - inside[0][axis])
        })
    }

    /// Whether a track comes or goes.
    pub fn flags(&self, i: usize) -> TrackFlags {
        TrackFlags(self.flags[i].0 & !TrackFlags::FADES)
    }

    fn lattice(&self) -> &'a Lattice {
        &self.step.layout.lattice
    }

    /// A quantity of a track at one end, as leaves have it: mass, density, smoothing length, attributes.
    pub fn value(&self, i: usize, end: usize, column: usize) -> f64 {
        f64::from(self.columns[end][column][i])
    }

    fn rates(&self) -> [f64; 2] {
        self.step.space.spans.map(|span| self.step.space.length / span)
    }

    /// A particle at one end; `before`: its cluster of the finest level at the other end.
    fn traveller(&self, i: usize, end: usize, before: Option<u32>) -> Traveller {
        let (place, movement) = self.states[end][i];
        let before = before.map(|cluster| {
            let (place, movement) = self.states[1 - end][i];
            let tangent = DVec3::from(movement.map(|v| v as f64)) * (self.lattice().unit() * self.rates()[1 - end]);
            (cluster, DVec3::from(self.lattice().position(place)), tangent)
        });
        Traveller { place, movement, mass: self.value(i, end, 0), before }
    }

    /// The clusters where tracks begin, and which records are there.
    pub fn first_clusters(&self, errors: &[f64]) -> (Gathered, Vec<u32>) {
        let present: Vec<usize> = (0..self.records.len()).filter(|i| !self.flags[*i].has(TrackFlags::COMES)).collect();
        let travellers: Vec<Traveller> = present.iter().map(|i| self.traveller(*i, 0, None)).collect();
        let rate = self.rates()[0];
        let next_rate = Some(rate);
        let flow = Flow { lattice: self.lattice(), errors, rate, next_rate, is_joining: true, is_reversed: false };
        let gathered = flow.gather(&travellers, &Before::default());
        (gathered, present.into_iter().map(|i| self.order[i]).collect())
    }

    /// The clusters where tracks end, and the flow there.
    pub fn flow(&self, errors: &[f64], begins_at: &[ClusterList], before: &Before) -> BuiltRegion {
        let (lattice, rates, count) = (self.lattice(), self.rates(), self.records.len());
        let which = |flag: u8| (0..count).filter(move |i| self.flags[*i].has(flag));
        let next_rate = self.step.next_length.map(|length| length / self.step.space.spans[1]);
        let at_end = Flow { lattice, errors, rate: rates[1], next_rate, is_joining: true, is_reversed: false };
        let present: Vec<usize> = (0..count).filter(|i| !self.flags[*i].has(TrackFlags::GOES)).collect();
        let begins = |i: usize| Some(self.begins[i]).filter(|cluster| *cluster != NOBODY);
        let travellers: Vec<Traveller> = present.iter().map(|i| self.traveller(*i, 1, begins(*i))).collect();
        let gathered = at_end.gather(&travellers, before);
        let mut ends = vec![NOBODY; count];
        present.iter().zip(&gathered.clusters).for_each(|(i, cluster)| ends[*i] = *cluster);
        // What goes has clusters of its own where it would be, and what comes where it would have been.
        let going: Vec<usize> = which(TrackFlags::GOES).collect();
        let travellers: Vec<Traveller> = going.iter().map(|i| self.traveller(*i, 1, begins(*i))).collect();
        let ghosts_end = Flow { next_rate: None, is_joining: false, ..at_end }.gather(&travellers, before);
        let coming: Vec<usize> = which(TrackFlags::COMES).collect();
        let after = Before::new(lattice, &gathered.levels, rates[1]);
        let travellers: Vec<Traveller> = coming.iter().map(|i| self.traveller(*i, 0, Some(ends[*i]))).collect();
        let reversed = Flow { rate: rates[0], next_rate: None, is_joining: false, is_reversed: true, ..at_end };
        let ghosts_begin = reversed.gather(&travellers, &after);
        let mut clusters = [vec![Place::default(); count], vec![Place::default(); count]];
        for i in 0..count {
            clusters[0][i] = Place { is_ghost: false, number: begins(i).unwrap_or(0) };
            clusters[1][i] = Place { is_ghost: false, number: ends[i] };
        }
        coming
            .iter()
            .zip(&ghosts_begin.clusters)
            .for_each(|(i, own)| clusters[0][*i] = Place { is_ghost: true, number: *own });
        going
            .iter()
            .zip(&ghosts_end.clusters)
            .for_each(|(i, own)| clusters[1][*i] = Place { is_ghost: true, number: *own });
        let ghosts_before =
            [Before::new(lattice, &ghosts_begin.levels, rates[0]), Before::new(lattice, &ghosts_end.levels, rates[1])];
        let ancestor = |end: usize, level: usize, place: Place| match (end, place.is_ghost) {
            (_, true) => Place { number: ghosts_before[end].ancestor(level, place.number), ..place },
            (0, false) => Place { number: before.ancestor(level, place.number), ..place },
            (_, false) => Place { number: after.ancestor(level, place.number), ..place },
        };
        let state = |end: usize, level: usize, place: Place| {
            let list = match (end, place.is_ghost) {
                (0, true) => &ghosts_begin.levels[level],
                (_, true) => &ghosts_end.levels[level],
                (0, false) => &begins_at[level],
                (_, false) => &gathered.levels[level],
            };
            (list.places[place.number as usize], list.movements[place.number as usize])
        };
        let keys = |level: usize, i: usize| [0, 1].map(|end| ancestor(end, level, clusters[end][i]));
        let mut order: Vec<([Place; 2], u32)> =
            (0..count).map(|i| ([clusters[0][i], clusters[1][i]], i as u32)).collect();
        order.sort_unstable();
        let mut sums = Sums::new(self.rules.len());
        let finest: Vec<&[([Place; 2], u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        for members in &finest {
            sums.push(self, members.iter().map(|(_, i)| *i as usize));
        }
        // From the root on, so that the tracks of a level are cut to those of the next finer one.
        let of_levels: Vec<Vec<[Place; 2]>> = (0..errors.len())
            .map(|level| finest.iter().map(|members| keys(level, members[0].1 as usize)).collect())
            .collect();
        let mut sorted: Vec<u32> = (0..finest.len() as u32).collect();
        sorted.sort_unstable_by(|a, b| {
            let compared = of_levels.iter().rev().map(|keys| keys[*a as usize].cmp(&keys[*b as usize]));
            compared.fold(Ordering::Equal, Ordering::then).then(a.cmp(b))
        });
        let mut flow = FlowLevels::new(errors.len(), self.rules.len());
        let mut own = sums.in_order(&sorted);
        let mut places: Vec<Vec<[Place; 2]>> =
            of_levels.iter().map(|keys| sorted.iter().map(|track| keys[*track as usize]).collect()).collect();
        for level in 0..errors.len() {
            if level > 0 {
                // A track is the union of those of the next finer level that are in its clusters.
                let (mut union, mut children, mut first) = (Sums::new(self.rules.len()), vec![0], Vec::new());
                let mut at = 0;
                for group in places[level].chunk_by(|a, b| a == b) {
                    union.push_union(&own, at..at + group.len());
                    first.push(at);
                    at += group.len();
                    children.push(at as u32);
                }
                places[level..].iter_mut().for_each(|keys| *keys = first.iter().map(|at| keys[*at]).collect());
                flow.levels[level].children = children;
                own = union;
            }
            for (track, places) in places[level].iter().enumerate() {
                let states = [0, 1].map(|end| state(end, level, places[end]));
                own.track(self, track, states, &mut flow.levels[level]);
                let numbers = flow.levels[level].clusters.iter_mut().zip(places);
                numbers.for_each(|(numbers, place)| numbers.push(place.number));
            }
            flow.places[level].clone_from(&places[level]);
            flow.ghosts[level] = [ghosts_begin.levels[level].len() as u32, ghosts_end.levels[level].len() as u32];
        }
        let (mut tracks, mut ends_of) = (vec![0; count], vec![NOBODY; count]);
        for (track, own) in sorted.iter().enumerate() {
            let members = finest[*own as usize].iter();
            members.for_each(|(_, i)| tracks[self.order[*i as usize] as usize] = track as u32);
        }
        (0..count).for_each(|i| ends_of[self.order[i] as usize] = ends[i]);
        BuiltRegion { gathered, flow, tracks, ends: ends_of }
    }
}
