//! The flow levels of a run, step by step: clusters are sought region by region at the end of each interval, from where particles are
//! there and in which clusters they were at its beginning.

use super::matching::{NOBODY, TrackRecord, UNRESOLVED, track_words};
use super::memory::default_memory;
use super::shuffle::Shuffle;
use super::spill::Spill;
use super::states::{State, StateLayout, StepStates};
use super::{BuildError, BuildOptions};
use crate::codec::AttributeMerge;
use crate::codec::states::{MASS_BITS, VALUE_BITS, float_of, round_float};
use crate::hierarchy::octree::Plan;
use crate::hierarchy::spacetime::lattice::morton_key;
use crate::hierarchy::spacetime::{
    Before, ClusterList, Flow, Gathered, Interval, Lattice, TrackFlags, Tracks, Traveller, flow_errors,
};
use crate::store::StoreError;
use crate::store::run::{FlowParts, FlowTracks, MOST_FLOW_LEVELS, NodePart, RunFileWriter, TrackCoding};
use crate::store::temporary::folder_of;
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;

/// Particles of a region.
const REGION: usize = 1 << 16;
/// Words of a record that says in which cluster a particle is: its bucket by id, its number there, and the cluster.
const CARRIED: usize = 3;

/// Which flow levels are built.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlowOptions {
    /// How many, at most [`MOST_FLOW_LEVELS`]; `None`: as many as keep the finest one small beside the particles.
    pub levels: Option<usize>,
    /// The error of the coarsest one, run units; `None`: half of how far the middle 80 % of the particles reach.
    pub error: Option<f64>,
}

/// What is known of flow levels from step to step.
pub(super) struct FlowBuild {
    /// The error of each level, the finest first, run units.
    pub errors: Vec<f64>,
    /// The clusters of the step at the beginning of the next interval: of each family its levels.
    clusters: Vec<Vec<ClusterList>>,
    /// Which cluster of the finest level each particle of that step is in.
    carried: Shuffle,
    rules: Vec<Vec<AttributeMerge>>,
}

/// What flow levels are sought with in an interval.
pub(super) struct FlowStep<'a> {
    pub layout: &'a StateLayout,
    pub options: &'a BuildOptions,
    pub out: &'a Path,
    pub space: &'a Interval,
    /// The length of the interval after the step that clusters are sought at; `None` at the last one.
    pub next_length: Option<f64>,
    /// The edge of the periodic box, units of the lattice.
    pub edge: Option<i64>,
}

impl FlowBuild {
    /// The errors of the levels, from a sample of the first step.
    pub fn new(options: &FlowOptions, first: &StepStates, step: &FlowStep<'_>) -> FlowBuild {
        let layout = step.layout;
        let span = step.space.spans[0];
        let traveller = |record: &[u32]| {
            let state = State::of(record);
            let velocity = state.velocity.map(|v| if v.is_finite() { f64::from(v) } else { 0.0 });
            let movement = layout.lattice.movement(velocity, span, 0);
            Traveller { place: state.place, movement, mass: f64::from(state.values[0]), before: None }
        };
        let sample: Vec<Traveller> = first.sample.chunks_exact(layout.words).map(traveller).collect();
        let levels = options.levels.map(|levels| levels.min(MOST_FLOW_LEVELS));
        let rate = step.space.length / span;
        // Clusters of half a periodic box would have no nearest image.
        let most = step.edge.map(|edge| edge as f64 * layout.lattice.unit() / 8.0);
        let root = most.map(|most| options.error.unwrap_or(most).min(most)).or(options.error);
        let errors = flow_errors(&layout.lattice, &sample, layout.stride as f64, rate, levels, root);
        let rules = layout.families.iter();
        let rules = rules.map(|(_, attributes)| attributes.iter().map(|(name, _)| AttributeMerge::of(name)).collect());
        let clusters = vec![vec![ClusterList::default(); errors.len()]; layout.families.len()];
        FlowBuild { errors, clusters, carried: step.carry(), rules: rules.collect() }
    }

    /// The clusters of the particles of a bucket by their numbers there.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn carried(&self, bucket: usize) -> Result<Vec<u32>, BuildError> {
        let records = self.carried.get(bucket)?;
        let most = records.chunks_exact(CARRIED).map(|record| record[1] as usize + 1).max().unwrap_or(0);
        let mut clusters = vec![NOBODY; most];
        records.chunks_exact(CARRIED).for_each(|record| clusters[record[1] as usize] = record[2]);
        Ok(clusters)
    }

    /// Seeks the clusters of the first step, from the tracks of the first interval by region of where they begin.
    ///
    /// # Errors
    /// When tracks cannot be read back, or clusters not be put away.
    pub fn begin(&mut self, step: &FlowStep<'_>, regions: &Regions) -> Result<(), BuildError> {
        for family in 0..step.layout.families.len() {
            let mut levels = vec![ClusterList::default(); self.errors.len()];
            for some in regions.chunks(family) {
                let gathered = some.into_par_iter().map(|region| {
                    let records = regions.tracks.get(region)?;
                    let own = Region::of(&records, step, &self.rules[family]);
                    Ok((own.first_clusters(&self.errors), records))
                });
                for ((gathered, present), records) in gathered.collect::<Result<Vec<_>, BuildError>>()? {
                    let words = track_words(step.layout);
                    let first = levels[0].len() as u32;
                    let mut out = Vec::with_capacity(present.len() * CARRIED);
                    for (i, cluster) in present.iter().zip(&gathered.clusters) {
                        let record = TrackRecord::of(&records[*i as usize * words..(*i as usize + 1) * words]);
                        out.extend([step.layout.bucket_of(record.id) as u32, record.numbers[0], first + cluster]);
                    }
                    append(&mut levels, gathered.levels);
                    self.carried.put(&out, |record| record[0] as usize)?;
                }
            }
            self.clusters[family] = levels;
        }
        Ok(())
    }

    /// Seeks the clusters at the end of an interval, from its tracks by region of where they end, and writes the flow levels of each
    /// family. The tracks go on to `sorted`, each with its track of the finest level in place of its cluster.
    ///
    /// # Errors
    /// When tracks cannot be read back, or something not be written.
    pub fn advance(
        &mut self,
        step: &FlowStep<'_>,
        regions: &Regions,
        sorted: &Shuffle,
        bucket_of: &(dyn Fn(&TrackRecord<'_>) -> usize + Sync),
        writer: &mut RunFileWriter,
    ) -> Result<Vec<FlowParts>, BuildError> {
        let carried = step.carry();
        let coding = TrackCoding::of(step.space);
        let words = track_words(step.layout);
        let mut parts = Vec::with_capacity(step.layout.families.len());
        for family in 0..step.layout.families.len() {
            let rates = step.space.spans.map(|span| step.space.length / span);
            let before = Before::new(&step.layout.lattice, &self.clusters[family], rates[0]);
            let mut clusters = vec![ClusterList::default(); self.errors.len()];
            let mut flow = FlowLevels::new(&self.errors, self.rules[family].len());
            for some in regions.chunks(family) {
                let built = some.into_par_iter().map(|region| {
                    let records = regions.tracks.get(region)?;
                    let own = Region::of(&records, step, &self.rules[family]);
                    let built = own.flow(&self.errors, &self.clusters[family], &before);
                    Ok((built, records))
                });
                let built = built.collect::<Result<Vec<_>, BuildError>>()?;
                // Numbers are given in the order of regions, so that threads change nothing.
                let mut numbered = Vec::with_capacity(built.len());
                for (built, records) in built {
                    let firsts = (clusters[0].len() as u32, flow.levels[0].len() as u32);
                    let starts: Vec<u32> = clusters.iter().map(|list| list.len() as u32).collect();
                    append(&mut clusters, built.gathered.levels);
                    flow.append(built.flow, &starts);
                    numbered.push((records, built.tracks, built.ends, firsts));
                }
                numbered.into_par_iter().try_for_each(
                    |(mut records, tracks, ends, (first_cluster, first_track))| {
                        let mut out = Vec::new();
                        for ((record, track), end) in records.chunks_exact_mut(words).zip(&tracks).zip(&ends) {
                            let own = TrackRecord::of(record);
                            if *end != NOBODY {
                                let bucket = step.layout.bucket_of(own.id) as u32;
                                out.extend([bucket, own.numbers[1], first_cluster + end]);
                            }
                            TrackRecord::set_number(record, first_track + track);
                        }
                        carried.put(&out, |record| record[0] as usize)?;
                        sorted.put(&records, |record| bucket_of(&TrackRecord::of(record)))
                    },
                )?;
            }
            let counts = [&self.clusters[family], &clusters].map(|levels| levels.iter().map(ClusterList::len));
            let [begins, ends]: [Vec<usize>; 2] = counts.map(Iterator::collect);
            let mut own = FlowParts { section: writer.begin(), levels: Vec::new() };
            for (level, tracks) in flow.finish(&begins, &ends).into_iter().enumerate() {
                let bytes = tracks.encode(coding);
                let reason =
                    || format!("flow level {} takes more than 4 GiB; --flow-levels with fewer of them", level + 1);
                let too_large = || StoreError::Unwritable { path: step.out.to_owned(), reason: reason() };
                let len = u32::try_from(bytes.len()).map_err(|_| too_large())?;
                writer.extend(&mut own.section, &bytes)?;
                own.levels.push((tracks.len() as u32, NodePart { len, crc: crc32c::crc32c(&bytes) }));
            }
            writer.close()?;
            parts.push(own);
            self.clusters[family] = clusters;
        }
        self.carried = carried;
        Ok(parts)
    }
}

/// Appends the clusters of another region, level by level.
fn append(levels: &mut [ClusterList], more: Vec<ClusterList>) {
    let starts: Vec<u32> = levels.iter().map(|list| list.len() as u32).collect();
    for (level, (list, more)) in levels.iter_mut().zip(more).enumerate() {
        list.append(more, starts.get(level + 1).copied().unwrap_or(0));
    }
}

impl FlowStep<'_> {
    fn spill(&self) -> Spill {
        let folder = self.options.temporary.clone().unwrap_or_else(|| folder_of(self.out).to_owned());
        let memory = self.options.memory.unwrap_or_else(default_memory);
        Spill::new(self.out, &folder, memory / 12, self.options.read)
    }

    fn carry(&self) -> Shuffle {
        Shuffle::new(self.layout.buckets, CARRIED, self.spill())
    }

    /// The image of a place that lies in the box.
    fn in_box(&self, place: [i64; 3]) -> [i64; 3] {
        let Some(edge) = self.edge else { return place };
        let lattice = &self.layout.lattice;
        let corner = lattice.root.min.to_array().map(|min| (-min / lattice.unit()).round() as i64);
        std::array::from_fn(|axis| (place[axis] - corner[axis]).rem_euclid(edge) + corner[axis])
    }
}

/// Tracks by family and region of one of their ends.
pub(super) struct Regions {
    /// The tracks.
    tracks: Shuffle,
    plans: Vec<Plan>,
    starts: Vec<usize>,
    end: usize,
}

impl Regions {
    /// Regions of where tracks are at one end, whose particles `states` are.
    pub fn new(step: &FlowStep<'_>, states: &StepStates, end: usize) -> Regions {
        let layout = step.layout;
        let plans: Vec<Plan> = (0..layout.families.len()).map(|family| states.plan(layout, family, REGION)).collect();
        let starts: Vec<usize> = plans
            .iter()
            .scan(0, |at, plan| {
                let start = *at;
                *at += plan.len();
                Some(start)
            })
            .collect();
        let buckets = plans.iter().map(Plan::len).sum();
        Regions { tracks: Shuffle::new(buckets, track_words(layout), step.spill()), plans, starts, end }
    }

    /// Bytes in the temporary file.
    pub fn on_disk(&self) -> u64 {
        self.tracks.on_disk()
    }

    /// Sends tracks to their regions.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn put(&self, step: &FlowStep<'_>, records: &[u32]) -> Result<(), BuildError> {
        self.tracks.put(records, |record| {
            let track = TrackRecord::of(record);
            self.starts[track.family] + self.plans[track.family].bucket(morton_key(step.in_box(track.places[self.end])))
        })
    }

    /// The regions of a family, as many at a time as there are threads.
    fn chunks(&self, family: usize) -> Vec<Vec<usize>> {
        let first = self.starts[family];
        let all: Vec<usize> = (first..first + self.plans[family].len()).collect();
        all.chunks(rayon::current_num_threads().max(1)).map(<[usize]>::to_vec).collect()
    }
}

/// The tracks of a region, in an order that depends on them alone.
struct Region<'a> {
    records: Vec<&'a [u32]>,
    /// The place of each in the region's records.
    order: Vec<u32>,
    step: &'a FlowStep<'a>,
    rules: &'a [AttributeMerge],
    /// Both ends of each: places in the box and movements, as leaves have them.
    states: [Vec<([i64; 3], [i64; 3])>; 2],
    /// The same of mass, density, smoothing length and attributes.
    columns: [Vec<Vec<f32>>; 2],
    flags: Vec<TrackFlags>,
    /// Their clusters of the finest level at the beginning.
    begins: Vec<u32>,
    is_unresolved: Vec<bool>,
}

/// What was found in a region.
struct BuiltRegion {
    gathered: Gathered,
    flow: FlowLevels,
    /// Of each record the track of the finest level that it belongs to, from the region's first one on.
    tracks: Vec<u32>,
    /// Of each record its cluster at the end; [`NOBODY`] of those that are not there.
    ends: Vec<u32>,
}

impl<'a> Region<'a> {
    fn of(records: &'a [u32], step: &'a FlowStep<'a>, rules: &'a [AttributeMerge]) -> Region<'a> {
        let words = track_words(step.layout);
        let record = |i: u32| &records[i as usize * words..(i as usize + 1) * words];
        let mut order: Vec<u32> = (0..(records.len() / words) as u32).collect();
        // Not by the numbers of clusters, which depend on the regions before.
        order.sort_unstable_by(|a, b| TrackRecord::content(record(*a)).cmp(&TrackRecord::content(record(*b))));
        let records: Vec<&[u32]> = order.iter().map(|i| record(*i)).collect();
        let lattice = &step.layout.lattice;
        let states = [0, 1].map(|end| {
            let state = |record: &&[u32]| {
                let track = TrackRecord::of(record);
                let exponent = lattice.exponent(track.values[end * track.values.len() / 2 + 2]);
                let velocity = track.velocities[end].map(f64::from);
                (step.in_box(track.places[end]), lattice.movement(velocity, step.space.spans[end], exponent))
            };
            records.iter().map(state).collect()
        });
        let count = records.first().map_or(0, |record| TrackRecord::of(record).values.len() / 2);
        let mut columns =
            [vec![Vec::with_capacity(records.len()); count], vec![Vec::with_capacity(records.len()); count]];
        let (mut flags, mut begins, mut is_unresolved) = (Vec::new(), Vec::new(), Vec::new());
        for record in &records {
            let track = TrackRecord::of(record);
            for (end, values) in track.values.chunks_exact(count).enumerate() {
                for (k, (column, value)) in columns[end].iter_mut().zip(values).enumerate() {
                    let bits = if k == 0 { MASS_BITS } else { VALUE_BITS };
                    column.push(float_of(round_float(*value, bits), bits));
                }
            }
            flags.push(track.flags);
            begins.push(track.numbers[0]);
            is_unresolved.push(track.unresolved > UNRESOLVED);
        }
        Region { records, order, step, rules, states, columns, flags, begins, is_unresolved }
    }

    fn track(&self, i: usize) -> TrackRecord<'a> {
        TrackRecord::of(self.records[i])
    }

    fn lattice(&self) -> &'a Lattice {
        &self.step.layout.lattice
    }

    /// A quantity of a track at one end, as leaves have it: mass, density, smoothing length, attributes.
    fn value(&self, i: usize, end: usize, column: usize) -> f64 {
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
    fn first_clusters(&self, errors: &[f64]) -> (Gathered, Vec<u32>) {
        let present: Vec<usize> = (0..self.records.len()).filter(|i| !self.flags[*i].has(TrackFlags::COMES)).collect();
        let travellers: Vec<Traveller> = present.iter().map(|i| self.traveller(*i, 0, None)).collect();
        let rate = self.rates()[0];
        let next_rate = Some(rate);
        let flow = Flow { lattice: self.lattice(), errors, rate, next_rate, is_joining: true, is_reversed: false };
        let gathered = flow.gather(&travellers, &Before::default());
        (gathered, present.into_iter().map(|i| self.order[i]).collect())
    }

    /// The clusters where tracks end, and the flow there.
    fn flow(&self, errors: &[f64], begins_at: &[ClusterList], before: &Before) -> BuiltRegion {
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
        // From the root on, so that the tracks of a level are cut to those of the next finer one.
        let mut groups: Vec<Vec<u32>> = vec![(0..count as u32).collect()];
        let mut flow = FlowLevels::new(errors, self.rules.len());
        for level in (0..errors.len()).rev() {
            let mut next = Vec::new();
            let mut children = vec![0];
            let key = |i: &u32| [0, 1].map(|end| ancestor(end, level, clusters[end][*i as usize]));
            for mut group in groups {
                group.sort_by_cached_key(key);
                let own = group.chunk_by(|a, b| key(a) == key(b));
                next.extend(own.map(<[u32]>::to_vec));
                children.push(next.len() as u32);
            }
            if level + 1 < errors.len() {
                flow.levels[level + 1].children = children;
            }
            for members in &next {
                let places = [0, 1].map(|end| ancestor(end, level, clusters[end][members[0] as usize]));
                let states = [0, 1].map(|end| state(end, level, places[end]));
                self.push(members, places, states, &mut flow.levels[level]);
                flow.places[level].push(places);
            }
            flow.ghosts[level] = [ghosts_begin.levels[level].len() as u32, ghosts_end.levels[level].len() as u32];
            groups = next;
        }
        let (mut tracks, mut ends_of) = (vec![0; count], vec![NOBODY; count]);
        for (track, members) in groups.iter().enumerate() {
            members.iter().for_each(|i| tracks[self.order[*i as usize] as usize] = track as u32);
        }
        (0..count).for_each(|i| ends_of[self.order[i] as usize] = ends[i]);
        BuiltRegion { gathered, flow, tracks, ends: ends_of }
    }

    /// Appends the track of some particles.
    fn push(&self, members: &[u32], places: [Place; 2], states: [([i64; 3], [i64; 3]); 2], out: &mut FlowTracks) {
        let first = members[0] as usize;
        // Which image of the box its end is in.
        let record = self.track(first);
        let inside = [0, 1].map(|end| self.states[end][first].0);
        for (end, (place, movement)) in states.into_iter().enumerate() {
            let column = |column: usize| members.iter().map(move |i| self.value(*i as usize, end, column));
            let mass: f64 = column(0).sum();
            let volume: f64 = column(0).zip(column(1)).map(|(m, rho)| if rho > 0.0 { m / rho } else { 0.0 }).sum();
            let mean = |weights: &dyn Fn(usize) -> f64, k: usize| {
                let (mut sum, mut all, mut plain) = (0.0, 0.0, 0.0);
                for i in members {
                    let (weight, value) = (weights(*i as usize), self.value(*i as usize, end, k));
                    (sum, all, plain) = (sum + weight * value, all + weight, plain + value);
                }
                if all > 0.0 { sum / all } else { plain / members.len() as f64 }
            };
            let by_mass = |i: usize| self.value(i, end, 0);
            let by_presence = |i: usize| self.value(i, end, 0) * self.value(i, end, 1);
            let own = &mut out.tracks.ends[end];
            let shift: [i64; 3] = match end {
                0 => [0; 3],
                _ => std::array::from_fn(|axis| {
                    (record.places[1][axis] - inside[1][axis]) - (record.places[0][axis] - inside[0][axis])
                }),
            };
            own.places.push(std::array::from_fn(|axis| place[axis] + shift[axis]));
            own.movements.push(movement);
            own.mass.push(mass as f32);
            let density = if volume > 0.0 { mass / volume } else { 0.0 };
            own.density.push(density as f32);
            own.smoothing_length.push(mean(&by_mass, 2) as f32);
            for (k, (attribute, rule)) in own.attributes.iter_mut().zip(self.rules).enumerate() {
                attribute.push(match rule {
                    AttributeMerge::Mean => mean(&by_presence, 3 + k),
                    AttributeMerge::Magnitude => {
                        let flux: f64 = column(3 + k).map(|value| 10.0_f64.powf(-0.4 * value)).sum();
                        -2.5 * flux.log10()
                    }
                } as f32);
            }
        }
        let flags = record.flags.0 & !TrackFlags::FADES;
        out.tracks.flags.push(TrackFlags(flags));
        out.counts.push(members.len() as u32);
        for (numbers, place) in out.clusters.iter_mut().zip(places) {
            numbers.push(place.number);
        }
        let mass = |i: &u32| self.value(*i as usize, 0, 0);
        let all: f64 = members.iter().map(mass).sum();
        let lost: f64 = members.iter().filter(|i| self.is_unresolved[**i as usize]).map(mass).sum();
        out.faded.push(if all > 0.0 { (lost / all) as f32 } else { 0.0 });
    }
}

/// A cluster at one end of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    /// Whether it is of particles that are not there.
    is_ghost: bool,
    number: u32,
}

/// The flow levels of a family over an interval, as far as regions are done.
struct FlowLevels {
    levels: Vec<FlowTracks>,
    /// Of each level which clusters its tracks' numbers name.
    places: Vec<Vec<[Place; 2]>>,
    /// Clusters of particles that are not there, at both ends.
    ghosts: Vec<[u32; 2]>,
}

impl FlowLevels {
    fn new(errors: &[f64], attributes: usize) -> FlowLevels {
        let level = |_| FlowTracks { tracks: Tracks::new(attributes), ..FlowTracks::default() };
        FlowLevels {
            levels: errors.iter().map(level).collect(),
            places: vec![Vec::new(); errors.len()],
            ghosts: vec![[0; 2]; errors.len()],
        }
    }

    /// Appends those of another region; `starts`: the number of its first cluster at the end, of each level.
    fn append(&mut self, other: FlowLevels, starts: &[u32]) {
        let firsts: Vec<u32> = self.levels.iter().map(|level| level.len() as u32).collect();
        for (level, more) in other.levels.into_iter().enumerate() {
            let own = &mut self.levels[level];
            let children = more.children.iter().skip(usize::from(!own.children.is_empty()));
            let first_child = level.checked_sub(1).map_or(0, |finer| firsts[finer]);
            own.children.extend(children.map(|child| first_child + child));
            own.tracks.flags.extend(more.tracks.flags);
            for (end, more) in own.tracks.ends.iter_mut().zip(more.tracks.ends) {
                end.places.extend(more.places);
                end.movements.extend(more.movements);
                end.mass.extend(more.mass);
                end.density.extend(more.density);
                end.smoothing_length.extend(more.smoothing_length);
                end.attributes.iter_mut().zip(more.attributes).for_each(|(column, more)| column.extend(more));
            }
            own.counts.extend(more.counts);
            own.faded.extend(more.faded);
            let ghosts = self.ghosts[level];
            let global = |places: [Place; 2]| {
                let [begin, end] = places;
                let begin_first = if begin.is_ghost { ghosts[0] } else { 0 };
                let end_first = if end.is_ghost { ghosts[1] } else { starts[level] };
                [Place { number: begin_first + begin.number, ..begin }, Place { number: end_first + end.number, ..end }]
            };
            self.places[level].extend(other.places[level].iter().copied().map(global));
            (0..2).for_each(|end| self.ghosts[level][end] += other.ghosts[level][end]);
        }
    }

    /// With numbers of clusters that are those of their steps: the ones that are there first, as many as `begins` and `ends` say.
    fn finish(self, begins: &[usize], ends: &[usize]) -> Vec<FlowTracks> {
        let mut levels = self.levels;
        for (level, own) in levels.iter_mut().enumerate() {
            if level > 0 && own.children.is_empty() {
                own.children.push(0);
            }
            // What would be at the step from the interval before, and from the one after, has no number in common.
            let number = |place: &Place, count: usize, parity: u32| match place.is_ghost {
                true => count as u32 + 2 * place.number + parity,
                false => place.number,
            };
            let places = &self.places[level];
            own.clusters = [
                places.iter().map(|[begin, _]| number(begin, begins[level], 0)).collect(),
                places.iter().map(|[_, end]| number(end, ends[level], 1)).collect(),
            ];
        }
        levels
    }
}
