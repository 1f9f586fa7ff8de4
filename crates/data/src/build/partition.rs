//! The second pass over a family: every particle goes to the bucket that its Morton key says, and into the histograms.

mod distribute;

use super::BuildError;
use super::spill::{Blob, Spill};
use super::survey::Survey;
use crate::hierarchy::attribute_info::{HistogramBins, Range, missing_replaced};
use crate::hierarchy::octree::{Columns, Place, Plan};
use crate::hierarchy::{Histogram, RootCell};
use crate::model::portable::{Portable, expect, expect_that, expect_within, portable, total};
use crate::model::progress::Progress;
use crate::model::{Chunk, ParticleStream};
use distribute::{Buckets, Scratch};
use rayon::prelude::*;
use std::io;

/// Particles of a bucket that are put away together while a family is read, where there is room for as many to wait.
pub(super) const RUN: usize = 1024;

/// The particles of all buckets, or of some that follow each other.
pub(super) struct Partition {
    spill: Spill,
    /// Attributes, and then the columns that others are derived from.
    columns: usize,
    /// The attributes among them.
    own: usize,
    /// What stands for missing values of each derived attribute.
    means: Vec<f32>,
    /// The number of the first bucket.
    first: usize,
    buckets: Vec<Bucket>,
}

/// One bucket: runs that have been put away, and the particles that still wait for enough company.
#[derive(Default)]
struct Bucket {
    runs: Vec<Blob>,
    places: Vec<Place>,
    columns: Columns,
    /// Keys that its particles must have, where others have sorted them.
    keys: Option<std::ops::Range<u64>>,
    /// Densities, then smoothing lengths, in the order of reading, where they had to be estimated.
    estimates: Option<Blob>,
    /// Derived attributes, one after the other, in the order of reading.
    derived: Option<Blob>,
}

/// What an input block has of the buckets of a group, where it is not the only one.
#[derive(Debug)]
pub(super) struct Shares {
    /// Particles that the block has, in the buckets of all groups.
    pub all: u64,
    /// Those of each bucket, as one run; `None` where there are none.
    runs: Vec<Option<Blob>>,
}

portable!(Shares { all, runs });

impl Shares {
    /// Whether they are those of so many buckets, of at most `most` particles with so many attributes, in the file of task `part`, which is the
    /// one to blame for them; else what was found and expected.
    pub fn check(&self, buckets: usize, attributes: usize, most: u64, part: Option<u32>) -> Result<(), String> {
        expect("buckets", self.runs.len(), buckets)?;
        expect_within("particles", self.all, 0..=most)?;
        let are_own = self.runs.iter().flatten().all(|run| run.part() == part);
        expect_that(are_own, "runs of particles", "those in the same file")?;
        let each = particle_bytes(attributes);
        let bytes = || self.runs.iter().flatten().map(|run| run.len() as u64);
        expect_that(bytes().all(|bytes| bytes > 0 && bytes.is_multiple_of(each)), "run of particles", "whole ones")?;
        expect_within("particles of a group", total(bytes()) / each, 0..=self.all)
    }
}

/// Bytes that a particle with so many attributes takes in a partition.
pub(super) fn particle_bytes(attributes: usize) -> u64 {
    (size_of::<Place>() + size_of::<f32>() * (3 + attributes)) as u64
}

impl Partition {
    /// Reads the whole family. Particles that wait for company in their buckets may take `waiting` bytes of memory beside `spill`.
    ///
    /// # Errors
    /// When it cannot be read, or is not what was surveyed any more, or its particles cannot be put away.
    pub fn of(
        stream: &dyn ParticleStream,
        survey: &Survey,
        plan: &Plan,
        root: RootCell,
        (spill, waiting): (Spill, u64),
        progress: &dyn Progress,
    ) -> Result<(Partition, Vec<Histogram>), BuildError> {
        let (chunks, room, ranges) = (0..stream.chunks(), (spill, waiting), &survey.ranges);
        let (partition, counts, checksum) = Partition::of_chunks(stream, chunks, ranges, plan, root, room, progress)?;
        match checksum == survey.checksum {
            true => Ok((partition, histograms(ranges, counts))),
            false => Err(BuildError::Changed { family: stream.family() }),
        }
    }

    /// Reads some chunks of a family; gives the counts of [`histograms`], too, and the sum of the chunks' checksums.
    ///
    /// # Errors
    /// When they cannot be read, or their particles not be put away.
    pub fn of_chunks(
        stream: &dyn ParticleStream,
        chunks: std::ops::Range<usize>,
        ranges: &[Range],
        plan: &Plan,
        root: RootCell,
        (spill, waiting): (Spill, u64),
        progress: &dyn Progress,
    ) -> Result<(Partition, Vec<Vec<u64>>, u64), BuildError> {
        let (own, columns) = (stream.attributes().len(), stream.columns());
        let share = chunks.len() as f64 / stream.chunks().max(1) as f64;
        progress.begin(&format!("sorting {}", stream.family()), (stream.particles() as f64 * share) as u64);
        let to = Buckets::new(plan, root, &spill, columns, waiting);
        let bins: Vec<HistogramBins> = ranges.iter().map(HistogramBins::of).collect();
        let (counts, checksum) = chunks
            .into_par_iter()
            .map_init(Default::default, |(chunk, scratch): &mut (Chunk, Scratch), number| {
                stream.read(number, chunk)?;
                let checksum = chunk.checksum(number);
                for (values, range) in chunk.attributes.iter_mut().zip(&ranges[3..]).take(own) {
                    missing_replaced(values, range.mean() as f32);
                }
                let quantities = [&chunk.mass, &chunk.density, &chunk.smoothing_length];
                let columns: Vec<&Vec<f32>> = quantities.into_iter().chain(&chunk.attributes).collect();
                let counts: Vec<Vec<u64>> =
                    columns.iter().zip(&bins).map(|(column, bins)| bins.count(column)).collect();
                to.distribute(&chunk.positions, &columns, scratch)?;
                progress.advance(chunk.positions.len() as u64);
                Ok((counts, checksum))
            })
            .try_reduce_with(|(mut all, checksum): (Vec<Vec<u64>>, u64), (more, other)| {
                all.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(all, more)| *all += more);
                Ok::<_, BuildError>((all, checksum.wrapping_add(other)))
            })
            .unwrap_or_else(|| Ok((bins.iter().map(|bins| bins.count(&[])).collect(), 0)))?;
        let buckets = to.filled();
        Ok((Partition { spill, columns, own, means: Vec::new(), first: 0, buckets }, counts, checksum))
    }

    /// Puts the particles of each bucket away in the file of the task at hand, as one run, bucket after bucket; and behind them what tells of
    /// the runs of each group of buckets. So whoever wants one group reads nothing of others, and everything is where it was when the chunks are
    /// read again. Runs that are sorted have the same order then, too, so that what is found for their particles stays theirs.
    ///
    /// # Errors
    /// When they cannot be read back or put away.
    pub fn hand_on(
        &self,
        groups: impl Iterator<Item = std::ops::Range<usize>>,
        are_sorted: bool,
        to: &Spill,
    ) -> Result<Vec<Blob>, BuildError> {
        let temporary = |error| BuildError::temporary(to, error);
        let mut all = 0_u64;
        let mut starts = Vec::with_capacity(self.buckets.len());
        for bucket in self.numbers() {
            starts.push(all * particle_bytes(self.columns));
            all += self.len(bucket) as u64;
        }
        let first = to.reserve(all * particle_bytes(self.columns)).map_err(temporary)?;
        let hand_on = |(bucket, start): (usize, u64)| {
            let (mut places, mut columns) = self.read_inputs(bucket)?;
            if places.is_empty() {
                return Ok(None);
            }
            if are_sorted {
                let order = columns.order(&places);
                places = order.iter().map(|&i| places[i as usize]).collect();
                columns = columns.gather(&order);
            }
            let run = run(&places, &columns, |parts| to.put_at(first + start, parts));
            run.map(Some).map_err(temporary)
        };
        let runs = self.numbers().into_par_iter().zip(starts).map(hand_on);
        let mut runs = runs.collect::<Result<Vec<_>, BuildError>>()?.into_iter();
        let shares = |group: std::ops::Range<usize>| Shares { all, runs: runs.by_ref().take(group.len()).collect() };
        groups.map(shares).map(|shares| to.put(&[&shares.bytes()]).map_err(temporary)).collect()
    }

    /// Some buckets of a plan, with so many attributes among so many columns, to which nobody has handed anything on yet.
    pub fn of_group(
        spill: Spill,
        (own, columns): (usize, usize),
        plan: &Plan,
        buckets: std::ops::Range<usize>,
    ) -> Partition {
        let first = buckets.start;
        let bucket = |number: usize| Bucket { keys: Some(plan.keys(number)), ..Bucket::default() };
        Partition { spill, columns, own, means: Vec::new(), first, buckets: buckets.map(bucket).collect() }
    }

    /// Adds the particles that an input block has handed on to the buckets.
    pub fn add(&mut self, shares: Shares) {
        self.buckets.iter_mut().zip(shares.runs).for_each(|(bucket, run)| bucket.runs.extend(run));
    }

    /// Where estimated densities and smoothing lengths of a bucket are, and derived attributes; nowhere any more, as far as this partition
    /// knows.
    pub fn take_found(&mut self, bucket: usize) -> [Option<Blob>; 2] {
        let Bucket { estimates, derived, .. } = &mut self.buckets[bucket - self.first];
        [estimates.take(), derived.take()]
    }

    /// Takes note of where estimated densities and smoothing lengths of a bucket are, and derived attributes.
    pub fn found(&mut self, bucket: usize, [estimates, derived]: [Option<Blob>; 2]) {
        let own = &mut self.buckets[bucket - self.first];
        own.estimates = estimates.or(own.estimates.take());
        own.derived = derived.or(own.derived.take());
    }

    /// The numbers of its buckets.
    pub fn numbers(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.buckets.len()
    }

    /// Replaces densities and smoothing lengths of a bucket, two columns in the order of reading.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn put_estimates(&mut self, bucket: usize, columns: &[Vec<f32>]) -> Result<(), BuildError> {
        self.buckets[bucket - self.first].estimates = Some(self.put(columns)?);
        Ok(())
    }

    /// Puts derived attributes of a bucket away, in the order of reading.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn put_derived(&mut self, bucket: usize, columns: &[Vec<f32>]) -> Result<(), BuildError> {
        self.buckets[bucket - self.first].derived = Some(self.put(columns)?);
        Ok(())
    }

    /// Puts columns away, one after the other.
    fn put(&self, columns: &[Vec<f32>]) -> Result<Blob, BuildError> {
        let parts: Vec<&[u8]> = columns.iter().map(|values| bytemuck::cast_slice::<f32, u8>(values)).collect();
        self.spill.put(&parts).map_err(|error| BuildError::temporary(&self.spill, error))
    }

    /// Says what stands for missing values of each derived attribute: from now on they are read, before the others.
    pub fn derived(&mut self, means: Vec<f32>) {
        self.means = means;
    }

    fn bucket(&self, number: usize) -> &Bucket {
        &self.buckets[number - self.first]
    }

    /// Number of particles in a bucket.
    pub fn len(&self, bucket: usize) -> usize {
        let Bucket { runs, places, .. } = self.bucket(bucket);
        runs.iter().map(|run| self.run_len(run)).sum::<usize>() + places.len()
    }

    /// Number of particles in a run.
    fn run_len(&self, run: &Blob) -> usize {
        run.len() / particle_bytes(self.columns) as usize
    }

    /// Some buckets in groups that follow each other, of at most `block` particles each where a group has more than one bucket.
    pub fn blocks(&self, buckets: std::ops::Range<usize>, block: usize) -> Vec<std::ops::Range<usize>> {
        let mut blocks: Vec<std::ops::Range<usize>> = Vec::new();
        let mut held = 0;
        for bucket in buckets {
            held += self.len(bucket);
            match blocks.last_mut() {
                Some(last) if held <= block => last.end = bucket + 1,
                _ => {
                    blocks.push(bucket..bucket + 1);
                    held = self.len(bucket);
                }
            }
        }
        blocks
    }

    /// Bytes in the temporary file.
    pub fn on_disk(&self) -> u64 {
        self.spill.on_disk()
    }

    /// The particles of a bucket, in no particular order.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn read(&self, bucket: usize) -> Result<(Vec<Place>, Columns), BuildError> {
        let (places, mut columns) = self.read_columns(bucket, 3 + self.own)?;
        columns.attributes.truncate(self.own);
        let mut derived: Vec<Vec<f32>> = vec![Vec::new(); self.means.len()];
        if let Some(blob) = self.bucket(bucket).derived.as_ref().filter(|_| !places.is_empty()) {
            let bytes = self.spill.get(blob).map_err(|error| BuildError::temporary(&self.spill, error))?;
            let all = bytes.chunks_exact(places.len() * size_of::<f32>());
            for ((values, bytes), &mean) in derived.iter_mut().zip(all).zip(&self.means) {
                *values = bytemuck::cast_slice::<u8, f32>(bytes).to_vec();
                missing_replaced(values, mean);
            }
        }
        columns.attributes.splice(0..0, derived);
        Ok((places, columns))
    }

    /// The particles of a bucket in no particular order, with the columns that attributes are derived from behind their own attributes.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn read_inputs(&self, bucket: usize) -> Result<(Vec<Place>, Columns), BuildError> {
        self.read_columns(bucket, 3 + self.columns)
    }

    /// Places and masses of the particles of a bucket, in the same order.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn read_masses(&self, bucket: usize) -> Result<(Vec<Place>, Vec<f32>), BuildError> {
        let (places, columns) = self.read_columns(bucket, 1)?;
        Ok((places, columns.mass))
    }

    /// The first `wanted` columns of a bucket; the others stay empty.
    fn read_columns(&self, bucket: usize, wanted: usize) -> Result<(Vec<Place>, Columns), BuildError> {
        let Bucket { runs, places: waiting, columns: rest, keys: own_keys, estimates, .. } = self.bucket(bucket);
        let len = self.len(bucket);
        let mut places = Vec::with_capacity(len);
        let mut columns = Columns::with_capacity(self.columns, 0);
        columns.iter_mut().take(wanted).for_each(|column| column.reserve_exact(len));
        for run in runs {
            let bytes = self.spill.get(run).map_err(|error| BuildError::temporary(&self.spill, error))?;
            let len = self.run_len(run);
            let (keys, values) = bytes.split_at(len * size_of::<Place>());
            let (keys, rests) = keys.split_at(len * size_of::<u64>());
            let (keys, rests): (&[u64], &[u64]) = (bytemuck::cast_slice(keys), bytemuck::cast_slice(rests));
            if own_keys.as_ref().is_some_and(|own| !keys.iter().all(|key| own.contains(key))) {
                let what = "keys: found some of another bucket, expected those of one";
                return Err(BuildError::temporary(&self.spill, self.spill.damaged(run, what)));
            }
            let pairs = keys.iter().zip(rests);
            places.extend(pairs.map(|(&key, &rest)| Place { key, rest }));
            let values = values.chunks_exact(len * size_of::<f32>());
            columns
                .iter_mut()
                .zip(values)
                .take(wanted)
                .for_each(|(column, values)| column.extend_from_slice(bytemuck::cast_slice(values)));
        }
        places.extend(waiting);
        columns.iter_mut().zip(rest.iter()).take(wanted).for_each(|(column, rest)| column.extend(rest));
        if let Some(estimates) = estimates.as_ref().filter(|_| wanted >= 3) {
            let bytes = self.spill.get(estimates).map_err(|error| BuildError::temporary(&self.spill, error))?;
            let (density, lengths) = bytes.split_at(len * size_of::<f32>());
            columns.density.copy_from_slice(bytemuck::cast_slice(density));
            columns.smoothing_length.copy_from_slice(bytemuck::cast_slice(lengths));
        }
        Ok((places, columns))
    }
}

/// The histograms of all columns, whose values were counted in bins of their ranges.
pub(super) fn histograms(ranges: &[Range], counts: Vec<Vec<u64>>) -> Vec<Histogram> {
    // What was replaced for a missing value is no value of the source.
    let finish = |(range, counts): (&Range, Vec<u64>)| HistogramBins::of(range).finish(counts, range.missing);
    ranges.iter().zip(counts).map(finish).collect()
}

/// Has a run of particles put away: keys, the rest of their places, columns.
fn run(places: &[Place], columns: &Columns, put: impl FnOnce(&[&[u8]]) -> io::Result<Blob>) -> io::Result<Blob> {
    let keys: Vec<u64> = places.iter().map(|place| place.key).collect();
    let rests: Vec<u64> = places.iter().map(|place| place.rest).collect();
    let mut parts: Vec<&[u8]> = vec![bytemuck::cast_slice(&keys), bytemuck::cast_slice(&rests)];
    parts.extend(columns.iter().map(|column| bytemuck::cast_slice::<f32, u8>(column)));
    put(&parts)
}
