//! The flow levels of a run, step by step: clusters are sought region by region at the end of each interval ([`super::flow_region`]), from
//! where particles are there and in which clusters they were at its beginning.

use super::flow_levels::FlowLevels;
use super::flow_region::Region;
use super::flow_regions::Regions;
use super::in_order::in_order;
use super::matching::{NOBODY, TrackRecord, track_words};
use super::memory::default_memory;
use super::shuffle::Shuffle;
use super::spill::Spill;
use super::states::{State, StateLayout, StepStates};
use super::{BuildError, BuildOptions};
use crate::codec::AttributeMerge;
use crate::hierarchy::spacetime::{Before, Chains, ClusterList, Interval, Links, Traveller, flow_errors};
use crate::store::StoreError;
use crate::store::run::{FlowParts, MOST_FLOW_LEVELS, NodePart, RunFileWriter, TrackCoding, encode_long_tracks};
use crate::store::temporary::folder_of;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Words of a record that says in which cluster a particle is: its bucket by id, its number there, and the cluster.
const CARRIED: usize = 3;

/// Which flow levels are built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
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
    /// Of each family and level the tracks that may go on in longer ones.
    chains: Vec<Vec<Chains>>,
    rules: Vec<Vec<AttributeMerge>>,
}

/// What flow levels are sought with in an interval.
pub(super) struct FlowStep<'a> {
    pub layout: &'a StateLayout,
    pub options: &'a BuildOptions,
    pub out: &'a Path,
    /// Number of the interval.
    pub interval: usize,
    pub space: &'a Interval,
    /// The clock at both ends.
    pub clock: [f64; 2],
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
        let chains = vec![vec![Chains::default(); errors.len()]; layout.families.len()];
        FlowBuild { errors, clusters, carried: step.carry(), chains, rules: rules.collect() }
    }

    /// The clusters of the particles of a bucket by their numbers there; asked for once.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn carried(&self, bucket: usize) -> Result<Vec<u32>, BuildError> {
        let records = self.carried.take(bucket)?;
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
        let words = track_words(step.layout);
        for family in 0..step.layout.families.len() {
            let mut levels = vec![ClusterList::default(); self.errors.len()];
            let seek = |region: &usize| {
                let records = regions.records(*region)?;
                let own = Region::of(&records, step, &self.rules[family]);
                Ok((own.first_clusters(&self.errors), records))
            };
            in_order(&regions.of(family), seek, |((gathered, present), records)| {
                let first = levels[0].len() as u32;
                let mut out = Vec::with_capacity(present.len() * CARRIED);
                for (i, cluster) in present.iter().zip(&gathered.clusters) {
                    let record = TrackRecord::of(&records[*i as usize * words..(*i as usize + 1) * words]);
                    out.extend([step.layout.bucket_of(record.id) as u32, record.numbers[0], first + cluster]);
                }
                append(&mut levels, gathered.levels);
                self.carried.put(&out, |record| record[0] as usize)
            })?;
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
            let mut flow = FlowLevels::new(self.errors.len(), self.rules[family].len());
            let seek = |region: &usize| {
                let records = regions.records(*region)?;
                let own = Region::of(&records, step, &self.rules[family]);
                let built = own.flow(&self.errors, &self.clusters[family], &before);
                Ok((built, records))
            };
            // Numbers are given in the order of regions, so that threads change nothing.
            in_order(&regions.of(family), seek, |(built, mut records)| {
                let (first_cluster, first_track) = (clusters[0].len() as u32, flow.levels[0].len() as u32);
                let starts: Vec<u32> = clusters.iter().map(|list| list.len() as u32).collect();
                append(&mut clusters, built.gathered.levels);
                flow.append(built.flow, &starts);
                let mut out = Vec::with_capacity(built.ends.len() * CARRIED);
                for ((record, track), end) in records.chunks_exact_mut(words).zip(&built.tracks).zip(&built.ends) {
                    let own = TrackRecord::of(record);
                    if *end != NOBODY {
                        out.extend([step.layout.bucket_of(own.id) as u32, own.numbers[1], first_cluster + end]);
                    }
                    TrackRecord::set_number(record, first_track + track);
                }
                carried.put(&out, |record| record[0] as usize)?;
                sorted.put(&records, |record| bucket_of(&TrackRecord::of(record)))
            })?;
            let counts = [&self.clusters[family], &clusters].map(|levels| levels.iter().map(ClusterList::len));
            let [begins, ends]: [Vec<usize>; 2] = counts.map(Iterator::collect);
            let levels = flow.finish(&begins, &ends);
            drop(before);
            let mut own = FlowParts { section: writer.begin(), ..FlowParts::default() };
            let mut links = Vec::with_capacity(levels.len());
            // Of a level that is written only what long tracks need is held.
            for (level, tracks) in levels.into_iter().enumerate() {
                let part = step.write(writer, &mut own, level, &tracks.encode(coding))?;
                own.levels.push((tracks.len() as u32, part));
                links.push(Links::of_interval(&tracks.tracks, &tracks.clusters, *step.space, step.clock));
            }
            self.write_long(step, family, links, &mut own, writer)?;
            writer.close()?;
            parts.push(own);
            self.clusters[family] = clusters;
        }
        self.carried = carried;
        Ok(parts)
    }

    /// Writes the long tracks of a family over the stretches that end with the interval; `links` are the tracks of its levels.
    fn write_long(
        &mut self,
        step: &FlowStep<'_>,
        family: usize,
        links: Vec<Links>,
        own: &mut FlowParts,
        writer: &mut RunFileWriter,
    ) -> Result<(), BuildError> {
        let known = self.chains[family].iter_mut().zip(&self.errors);
        for (level, (links, (chains, error))) in links.into_iter().zip(known).enumerate() {
            let mut parts = Vec::new();
            chains.push(step.interval, links, |_, first, second| {
                let (long, links) = first.join(second, *error);
                let bytes = encode_long_tracks(&long, step.edge.is_some());
                parts.push((long.len() as u32, step.write(writer, own, level, &bytes)?));
                Ok::<_, BuildError>(links)
            })?;
            own.long.push(parts);
        }
        Ok(())
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
    pub fn spill(&self) -> Spill {
        let folder = self.options.temporary.clone().unwrap_or_else(|| folder_of(self.out).to_owned());
        let memory = self.options.memory.unwrap_or_else(default_memory);
        Spill::new(self.out, &folder, memory / 12, self.options.read)
    }

    /// Appends a part of a level to the section of flow levels.
    fn write(
        &self,
        writer: &mut RunFileWriter,
        own: &mut FlowParts,
        level: usize,
        bytes: &[u8],
    ) -> Result<NodePart, BuildError> {
        let reason = || format!("flow level {} takes more than 4 GiB; --flow-levels with fewer of them", level + 1);
        let too_large = || StoreError::Unwritable { path: self.out.to_owned(), reason: reason() };
        let len = u32::try_from(bytes.len()).map_err(|_| too_large())?;
        writer.extend(&mut own.section, bytes)?;
        Ok(NodePart { len, crc: crc32c::crc32c(bytes) })
    }

    fn carry(&self) -> Shuffle {
        Shuffle::new(self.layout.buckets, CARRIED, self.spill())
    }

    /// The image of a place that lies in the box.
    pub fn in_box(&self, place: [i64; 3]) -> [i64; 3] {
        let Some(edge) = self.edge else { return place };
        let lattice = &self.layout.lattice;
        let corner = lattice.root.min.to_array().map(|min| (-min / lattice.unit()).round() as i64);
        std::array::from_fn(|axis| (place[axis] - corner[axis]).rem_euclid(edge) + corner[axis])
    }
}
