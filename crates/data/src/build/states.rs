//! The states of a step's particles, sent to buckets by their ids: where they are, how they move and what they are.

use super::derive::Deriving;
use super::estimates::Estimating;
use super::memory::{Memory, default_memory};
use super::partition::Partition;
use super::reach::Surroundings;
use super::shuffle::Shuffle;
use super::spill::Spill;
use super::survey::Survey;
use super::{BuildError, BuildOptions};
use crate::hierarchy::octree::Plan;
use crate::hierarchy::spacetime::Lattice;
use crate::hierarchy::spacetime::lattice::morton_key;
use crate::import::{SourceStream, StateChunk};
use crate::model::mixing::{GOLDEN, mix_bits};
use crate::model::{Chunk, Derivation, FamilyName, ParticleStream, Progress, StreamError, Unit};
use crate::store::temporary::folder_of;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Mutex;

/// Words of a state before its attributes.
const FIXED: usize = 15;
/// Particles of a step, at most about, that are looked at for what no whole step is held in memory for.
const SAMPLE: u64 = 1 << 16;
/// Particles of a bucket of ids.
const BUCKET: u64 = 1 << 15;
/// Buckets of ids at most.
const MOST_BUCKETS: u64 = 1 << 12;
/// Parts that an id is carried in where only floats are: 16 bits each.
const ID_PARTS: usize = 4;

/// A particle at a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct State<'a> {
    pub id: u64,
    /// The family's number in the run.
    pub family: usize,
    /// Its number among those of its step and bucket, where they are in order.
    pub number: u32,
    /// Where it is on the lattice, to a unit.
    pub place: [i64; 3],
    /// `dx/dtau`, run units by the clock's; `NaN` where it is not known.
    pub velocity: [f32; 3],
    /// Mass, density, smoothing length, then attributes.
    pub values: &'a [f32],
}

impl State<'_> {
    /// Reads a record.
    #[inline]
    pub fn of(record: &[u32]) -> State<'_> {
        let long = |at: usize| u64::from(record[at]) | u64::from(record[at + 1]) << 32;
        State {
            id: long(0),
            family: record[2] as usize,
            number: 0,
            place: [3, 5, 7].map(|at| long(at) as i64),
            velocity: [9, 10, 11].map(|at| f32::from_bits(record[at])),
            values: bytemuck::cast_slice(&record[12..]),
        }
    }

    fn put(&self, words: usize, out: &mut Vec<u32>) {
        let end = out.len() + words;
        let long = |value: u64| [value as u32, (value >> 32) as u32];
        out.extend(long(self.id));
        out.push(self.family as u32);
        self.place.into_iter().for_each(|x| out.extend(long(x as u64)));
        out.extend(self.velocity.map(f32::to_bits));
        out.extend(self.values.iter().map(|value| value.to_bits()));
        out.resize(end, 0);
    }

    /// The smoothing length.
    pub fn smoothing_length(&self) -> f32 {
        self.values[2]
    }

    /// The Morton key of where it is.
    pub fn key(&self) -> u64 {
        morton_key(self.place)
    }
}

/// A number that looks random, the same for the same id.
pub(super) fn hash(id: u64) -> u64 {
    mix_bits(id.wrapping_add(GOLDEN))
}

/// What the states of all steps have in common.
#[derive(Clone, Debug)]
pub(super) struct StateLayout {
    pub lattice: Lattice,
    /// Families, and the names and units of their attributes.
    pub families: Vec<(FamilyName, Vec<(String, Unit)>)>,
    /// Words of a record.
    pub words: usize,
    /// Buckets by id.
    pub buckets: usize,
    /// One of so many ids is sampled.
    pub stride: u64,
}

impl StateLayout {
    /// For steps of at most `most` particles.
    pub fn new(lattice: Lattice, families: Vec<(FamilyName, Vec<(String, Unit)>)>, most: u64) -> StateLayout {
        let attributes = families.iter().map(|(_, attributes)| attributes.len()).max().unwrap_or(0);
        StateLayout {
            lattice,
            words: FIXED + attributes,
            buckets: most.div_ceil(BUCKET).clamp(1, MOST_BUCKETS) as usize,
            stride: most.div_ceil(SAMPLE).next_power_of_two(),
            families,
        }
    }

    /// Whether an id belongs to the sample.
    pub fn is_sampled(&self, id: u64) -> bool {
        hash(id) & (self.stride - 1) == 0
    }

    fn bucket(&self, record: &[u32]) -> usize {
        self.bucket_of(u64::from(record[0]) | u64::from(record[1]) << 32)
    }

    /// The bucket of an id.
    pub fn bucket_of(&self, id: u64) -> usize {
        ((u128::from(hash(id)) * self.buckets as u128) >> 64) as usize
    }
}

/// How far stored places are from those of the snapshot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Rounding {
    pub sum: f64,
    pub max: f64,
    pub count: u64,
}

impl Rounding {
    pub fn with(self, other: Rounding) -> Rounding {
        Rounding { sum: self.sum + other.sum, max: self.max.max(other.max), count: self.count + other.count }
    }
}

/// All states of a step.
pub(super) struct StepStates {
    pub shuffle: Shuffle,
    /// Of each family.
    pub rounding: Vec<Rounding>,
    /// The records of sampled ids, in the order of ids.
    pub sample: Vec<u32>,
}

/// What the values of a step's family are multiplied with, or replaced by.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scales {
    /// Lengths.
    pub length: f64,
    /// Masses.
    pub mass: f64,
    /// Velocities, to give `dx/dtau`; `None`: they are of no use.
    pub velocity: Option<f64>,
    /// What stands for attributes that are missing: the mean of the others, as in the still.
    pub means: Vec<f32>,
}

impl StepStates {
    /// Without a particle; up to `room` bytes stay in memory.
    pub fn new(layout: &StateLayout, options: &BuildOptions, out: &Path, room: u64) -> StepStates {
        let folder = options.temporary.clone().unwrap_or_else(|| folder_of(out).to_owned());
        let spill = Spill::new(out, &folder, room, options.read);
        StepStates {
            shuffle: Shuffle::new(layout.buckets, layout.words, spill),
            rounding: vec![Rounding::default(); layout.families.len()],
            sample: Vec::new(),
        }
    }

    /// Adds a family of the step; `by_row`: particles are who their row says.
    ///
    /// # Errors
    /// When it cannot be read, or its states not be put away.
    pub fn add(
        &mut self,
        layout: &StateLayout,
        stream: &SourceStream,
        by_row: bool,
        scales: &Scales,
        (options, out): (&BuildOptions, &Path),
        progress: &dyn Progress,
    ) -> Result<(), BuildError> {
        let found = layout.families.iter().position(|(name, _)| *name == stream.family());
        let Some(family) = found else { return Ok(()) };
        progress.begin(&format!("states of {}", stream.family()), stream.particles());
        let sender = Sender { layout, family, scales, states: self, sample: Mutex::default() };
        let rounding = if stream.is_lacking() || stream.derivation().is_some() {
            sender.partitioned(stream, by_row, (options, out), progress)?
        } else {
            sender.streamed(stream, by_row, progress)?
        };
        let sample = sender.sample.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        self.sample.extend(sample);
        self.rounding[family] = self.rounding[family].with(rounding);
        let mut records: Vec<&[u32]> = self.sample.chunks_exact(layout.words).collect();
        records.sort_unstable();
        self.sample = records.concat();
        Ok(())
    }

    /// The plan by which tracks that begin or end here are sorted, about `most` in a bucket.
    pub fn plan(&self, layout: &StateLayout, family: usize, most: usize) -> Plan {
        let states = self.sample.chunks_exact(layout.words).map(State::of);
        let mut keys: Vec<u64> = states.filter(|state| state.family == family).map(|state| state.key()).collect();
        keys.sort_unstable();
        Plan::new(&keys, layout.stride as f64, most)
    }

    /// Whether some of a family's particles have velocities.
    pub fn has_velocities(&self, layout: &StateLayout, family: usize) -> bool {
        let mut states = self.sample.chunks_exact(layout.words).map(State::of);
        states.any(|state| state.family == family && state.velocity.iter().all(|v| v.is_finite()))
    }
}

/// Sends the particles of a family to their buckets.
struct Sender<'a> {
    layout: &'a StateLayout,
    family: usize,
    scales: &'a Scales,
    states: &'a StepStates,
    sample: Mutex<Vec<u32>>,
}

impl Sender<'_> {
    /// Chunk by chunk, where nothing has to be estimated or derived.
    fn streamed(&self, stream: &SourceStream, by_row: bool, progress: &dyn Progress) -> Result<Rounding, BuildError> {
        let one = |scratch: &mut StateChunk, number: usize| {
            stream.read_states(number, by_row, scratch)?;
            let chunk = &scratch.chunk;
            let columns: Vec<&[f32]> = [&chunk.mass, &chunk.density, &chunk.smoothing_length]
                .into_iter()
                .chain(&chunk.attributes)
                .map(Vec::as_slice)
                .collect();
            let rounding = self.send(&scratch.ids, &chunk.positions, &scratch.velocities, &columns)?;
            progress.advance(chunk.positions.len() as u64);
            Ok(rounding)
        };
        let all = (0..stream.chunks()).into_par_iter().map_init(StateChunk::default, one);
        let all: Vec<Rounding> = all.collect::<Result<_, BuildError>>()?;
        // Summed in order, so that the number of threads changes nothing.
        Ok(all.into_iter().fold(Rounding::default(), Rounding::with))
    }

    /// By way of the places where neighbours are found, as for the still: smoothing lengths, densities and what is derived are those of the
    /// still.
    fn partitioned(
        &self,
        stream: &SourceStream,
        by_row: bool,
        (options, out): (&BuildOptions, &Path),
        progress: &dyn Progress,
    ) -> Result<Rounding, BuildError> {
        let carrier = Carrier::new(stream, by_row);
        let octree = &options.octree;
        let mut survey = Survey::of(&carrier, octree, progress)?;
        let root = survey.root(octree);
        let most = octree.bucket_size(survey.count);
        let plan = Plan::new(&survey.take_keys(root), survey.weight, most);
        let derivation = stream.derivation();
        let derived = derivation.map_or(0, |derivation| derivation.quantities.len());
        let columns = derived + carrier.columns();
        let halved =
            BuildOptions { memory: Some(options.memory.unwrap_or_else(default_memory) / 2), ..options.clone() };
        let memory = Memory::plan(&halved, out, survey.count, columns, most, plan.len())?;
        let spill = Spill::new(out, &memory.folder, memory.particles, options.read);
        let room = (spill, memory.waiting);
        let (mut partition, _) = Partition::of(&carrier, &survey, &plan, root, room, progress)?;
        let Survey { bounds, count, .. } = survey;
        let edge = stream.periodic_edge(bounds);
        let surroundings = Surroundings { plan: &plan, root, edge, bounds, count, others: None };
        if let Some(k) = stream.neighbours().filter(|_| survey.is_lacking()) {
            Estimating { k, surroundings }.estimate(&mut partition, memory.neighbour_block(), progress)?;
        }
        if let Some(derivation) = derivation {
            let own = carrier.attributes.len();
            let deriving = Deriving { derivation, kernel: stream.kernel(), own, surroundings };
            deriving.derive(&mut partition, memory.motion_block(), progress)?;
        }
        let own = derived + stream.attributes().len();
        let all = partition.numbers().into_par_iter().map(|bucket| {
            let (places, columns) = partition.read(bucket)?;
            let corner = root.min.to_array();
            let positions: Vec<[f64; 3]> = places
                .iter()
                .map(|place| {
                    let unit = place.unit();
                    std::array::from_fn(|axis| corner[axis] + root.size * unit[axis])
                })
                .collect();
            let (attributes, carried) = columns.attributes.split_at(own);
            let (parts, velocities) = carried.split_at(ID_PARTS);
            let id = |i: usize| parts.iter().rev().fold(0, |id, part| id << 16 | part[i] as u64);
            let ids: Vec<u64> = (0..places.len()).map(id).collect();
            let velocity = |i: usize| std::array::from_fn(|axis| f64::from(velocities[axis][i]));
            let moving = stream.velocity_unit().is_some();
            let velocities: Vec<[f64; 3]> =
                (0..places.len()).map(|i| if moving { velocity(i) } else { [f64::NAN; 3] }).collect();
            let columns: Vec<&[f32]> = [&columns.mass, &columns.density, &columns.smoothing_length]
                .into_iter()
                .chain(attributes)
                .map(Vec::as_slice)
                .collect();
            self.send(&ids, &positions, &velocities, &columns)
        });
        let all: Vec<Rounding> = all.collect::<Result<_, BuildError>>()?;
        Ok(all.into_iter().fold(Rounding::default(), Rounding::with))
    }

    /// Sends some particles.
    fn send(
        &self,
        ids: &[u64],
        positions: &[[f64; 3]],
        velocities: &[[f64; 3]],
        columns: &[&[f32]],
    ) -> Result<Rounding, BuildError> {
        let Scales { length, mass, velocity, means } = self.scales;
        let (length, mass, velocity) = (*length, *mass, *velocity);
        let scales = [mass, mass / (length * length * length), length];
        let words = self.layout.words;
        let lattice = &self.layout.lattice;
        let mut records = Vec::with_capacity(ids.len() * words);
        let mut sampled = Vec::new();
        let mut rounding = Rounding::default();
        let mut values = vec![0.0; columns.len()];
        for i in 0..ids.len() {
            for (k, (value, column)) in values.iter_mut().zip(columns).enumerate() {
                *value = match scales.get(k) {
                    Some(scale) => (f64::from(column[i]) * scale) as f32,
                    None if column[i].is_nan() => means.get(k - 3).copied().unwrap_or(0.0),
                    None => column[i],
                };
            }
            let position = positions[i].map(|x| x * length);
            let place = lattice.place(position);
            let back = lattice.position(Lattice::settled(place, lattice.exponent(values[2])));
            let error = (0..3).map(|axis| (back[axis] - position[axis]).powi(2)).sum::<f64>().sqrt();
            rounding = rounding.with(Rounding { sum: error, max: error, count: 1 });
            let state = State {
                id: ids[i],
                family: self.family,
                number: 0,
                place,
                velocity: velocities[i].map(|v| velocity.map_or(f32::NAN, |factor| (v * factor) as f32)),
                values: &values,
            };
            let start = records.len();
            state.put(words, &mut records);
            if self.layout.is_sampled(ids[i]) {
                sampled.extend_from_slice(&records[start..]);
            }
        }
        self.states.shuffle.put(&records, |record| self.layout.bucket(record))?;
        self.sample.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).extend(sampled);
        Ok(rounding)
    }
}

/// A family whose ids and velocities are carried as attributes, so that they stay with the particles while neighbours are found.
struct Carrier<'a> {
    stream: &'a SourceStream<'a>,
    by_row: bool,
    attributes: Vec<(String, Unit)>,
}

impl<'a> Carrier<'a> {
    fn new(stream: &'a SourceStream<'a>, by_row: bool) -> Carrier<'a> {
        let mut attributes = stream.attributes().to_vec();
        let carried = (0..ID_PARTS).map(|part| format!("id part {part}"));
        attributes
            .extend(carried.chain((0..3).map(|axis| format!("velocity {axis}"))).map(|name| (name, Unit::default())));
        Carrier { stream, by_row, attributes }
    }
}

impl ParticleStream for Carrier<'_> {
    fn family(&self) -> FamilyName {
        self.stream.family()
    }

    fn attributes(&self) -> &[(String, Unit)] {
        &self.attributes
    }

    fn particles(&self) -> u64 {
        self.stream.particles()
    }

    fn chunks(&self) -> usize {
        self.stream.chunks()
    }

    fn neighbours(&self) -> Option<usize> {
        self.stream.neighbours()
    }

    fn box_size(&self) -> Option<f64> {
        self.stream.box_size()
    }

    fn derivation(&self) -> Option<&Derivation> {
        self.stream.derivation()
    }

    fn read(&self, number: usize, into: &mut Chunk) -> Result<(), StreamError> {
        let mut states = StateChunk { chunk: std::mem::take(into), ..StateChunk::default() };
        states.chunk.attributes.truncate(self.stream.attributes().len());
        self.stream.read_states(number, self.by_row, &mut states)?;
        let StateChunk { mut chunk, ids, velocities } = states;
        let inputs = chunk.attributes.split_off(self.stream.attributes().len());
        for part in 0..ID_PARTS {
            chunk.attributes.push(ids.iter().map(|id| (id >> (16 * part) & 0xffff) as f32).collect());
        }
        for axis in 0..3 {
            chunk.attributes.push(velocities.iter().map(|velocity| velocity[axis] as f32).collect());
        }
        chunk.attributes.extend(inputs);
        *into = chunk;
        Ok(())
    }
}
