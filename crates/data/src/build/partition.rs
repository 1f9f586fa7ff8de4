//! The second pass over a family: every particle goes to the bucket that its Morton key says, and into the histograms.

use super::BuildError;
use super::spill::{Blob, Spill};
use crate::hierarchy::attribute_info::{HistogramBins, Range, missing_replaced};
use crate::hierarchy::octree::{Columns, Place, Plan};
use crate::hierarchy::{Histogram, RootCell};
use crate::model::progress::Progress;
use crate::model::{Chunk, ParticleStream};
use rayon::prelude::*;
use std::sync::Mutex;

/// Particles of a bucket that are put away together.
const RUN: usize = 1024;

/// The particles of all buckets.
pub(super) struct Partition {
    spill: Spill,
    /// Attributes, and then the columns that others are derived from.
    columns: usize,
    /// The attributes among them.
    own: usize,
    /// What stands for missing values of each derived attribute.
    means: Vec<f32>,
    buckets: Vec<Bucket>,
}

/// One bucket: runs that have been put away, and the particles that still wait for enough company.
#[derive(Default)]
struct Bucket {
    runs: Vec<Blob>,
    places: Vec<Place>,
    columns: Columns,
    /// Smallest and largest coordinates, fractions of the root cell.
    extent: Option<([f64; 3], [f64; 3])>,
    /// Densities, then smoothing lengths, in the order of reading, where they had to be estimated.
    estimates: Option<Blob>,
    /// Derived attributes, one after the other, in the order of reading.
    derived: Option<Blob>,
}

/// Bytes that a particle with so many attributes takes in a partition.
pub(super) fn particle_bytes(attributes: usize) -> u64 {
    (size_of::<Place>() + size_of::<f32>() * (3 + attributes)) as u64
}

impl Partition {
    /// Reads the whole family; `extents` says whether [`Partition::extent`] will be asked for.
    ///
    /// # Errors
    /// When it cannot be read, or its particles not be put away.
    pub fn of(
        stream: &dyn ParticleStream,
        ranges: &[Range],
        plan: &Plan,
        root: RootCell,
        extents: bool,
        spill: Spill,
        progress: &dyn Progress,
    ) -> Result<(Partition, Vec<Histogram>), BuildError> {
        let (own, columns) = (stream.attributes().len(), stream.columns());
        progress.begin(&format!("sorting {}", stream.family()), stream.particles());
        let empty = || Bucket { columns: Columns::with_capacity(columns, 0), ..Bucket::default() };
        let buckets: Vec<Mutex<Bucket>> = (0..plan.len()).map(|_| Mutex::new(empty())).collect();
        let bins: Vec<HistogramBins> = ranges.iter().map(HistogramBins::of).collect();
        let counts = (0..stream.chunks())
            .into_par_iter()
            .map_init(Default::default, |(chunk, scratch): &mut (Chunk, Scratch), number| {
                stream.read(number, chunk)?;
                for (values, range) in chunk.attributes.iter_mut().zip(&ranges[3..]).take(own) {
                    missing_replaced(values, range.mean() as f32);
                }
                let quantities = [&chunk.mass, &chunk.density, &chunk.smoothing_length];
                let columns: Vec<&Vec<f32>> = quantities.into_iter().chain(&chunk.attributes).collect();
                let counts: Vec<Vec<u64>> =
                    columns.iter().zip(&bins).map(|(column, bins)| bins.count(column)).collect();
                let to = Buckets { plan, root, extents, buckets: &buckets, spill: &spill };
                to.distribute(&chunk.positions, &columns, scratch)?;
                progress.advance(chunk.positions.len() as u64);
                Ok(counts)
            })
            .try_reduce_with(|mut all, more| {
                all.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(all, more)| *all += more);
                Ok::<_, BuildError>(all)
            })
            .unwrap_or_else(|| Ok(bins.iter().map(|bins| bins.count(&[])).collect()))?;
        // What was replaced for a missing value is no value of the source.
        let histograms = bins.into_iter().zip(counts).zip(ranges);
        let histograms = histograms.map(|((bins, counts), range)| bins.finish(counts, range.missing)).collect();
        let buckets =
            buckets.into_iter().map(|bucket| bucket.into_inner().unwrap_or_else(|e| e.into_inner())).collect();
        Ok((Partition { spill, columns, own, means: Vec::new(), buckets }, histograms))
    }

    /// Number of buckets.
    pub fn buckets(&self) -> usize {
        self.buckets.len()
    }

    /// Number of particles.
    pub fn particles(&self) -> usize {
        (0..self.buckets()).map(|bucket| self.len(bucket)).sum()
    }

    /// Smallest and largest coordinates of a bucket's particles, fractions of the root cell; `None` if it is empty.
    pub fn extent(&self, bucket: usize) -> Option<([f64; 3], [f64; 3])> {
        self.buckets[bucket].extent
    }

    /// Replaces densities and smoothing lengths of a bucket, in the order of reading.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn put_estimates(&mut self, bucket: usize, density: &[f32], lengths: &[f32]) -> Result<(), BuildError> {
        let blob = self.spill.put(&[bytemuck::cast_slice(density), bytemuck::cast_slice(lengths)]);
        self.buckets[bucket].estimates = Some(blob.map_err(|error| BuildError::temporary(&self.spill, error))?);
        Ok(())
    }

    /// Puts derived attributes of a bucket away, in the order of reading.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn put_derived(&mut self, bucket: usize, attributes: &[Vec<f32>]) -> Result<(), BuildError> {
        let parts: Vec<&[u8]> = attributes.iter().map(|values| bytemuck::cast_slice::<f32, u8>(values)).collect();
        let blob = self.spill.put(&parts).map_err(|error| BuildError::temporary(&self.spill, error))?;
        self.buckets[bucket].derived = Some(blob);
        Ok(())
    }

    /// Says what stands for missing values of each derived attribute: from now on they are read, before the others.
    pub fn derived(&mut self, means: Vec<f32>) {
        self.means = means;
    }

    /// Number of particles in a bucket.
    pub fn len(&self, bucket: usize) -> usize {
        self.buckets[bucket].runs.len() * RUN + self.buckets[bucket].places.len()
    }

    /// The buckets in groups that follow each other, of at most `block` particles each where a group has more than one bucket.
    pub fn blocks(&self, block: usize) -> Vec<std::ops::Range<usize>> {
        let mut blocks: Vec<std::ops::Range<usize>> = Vec::new();
        let mut held = 0;
        for bucket in 0..self.buckets() {
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
        if let Some(blob) = self.buckets[bucket].derived.as_ref().filter(|_| !places.is_empty()) {
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
        let Bucket { runs, places: waiting, columns: rest, estimates, .. } = &self.buckets[bucket];
        let len = self.len(bucket);
        let mut places = Vec::with_capacity(len);
        let mut columns = Columns::with_capacity(self.columns, 0);
        columns.iter_mut().take(wanted).for_each(|column| column.reserve_exact(len));
        for run in runs {
            let bytes = self.spill.get(run).map_err(|error| BuildError::temporary(&self.spill, error))?;
            let (keys, values) = bytes.split_at(RUN * size_of::<Place>());
            let (keys, rests) = keys.split_at(RUN * size_of::<u64>());
            let pairs = bytemuck::cast_slice(keys).iter().zip(bytemuck::cast_slice(rests));
            places.extend(pairs.map(|(&key, &rest)| Place { key, rest }));
            let values = values.chunks_exact(RUN * size_of::<f32>());
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

/// Memory for distributing chunks.
#[derive(Default)]
struct Scratch {
    places: Vec<Place>,
    /// Bucket of each particle.
    buckets: Vec<u32>,
    /// Where each bucket's particles end in `order`.
    ends: Vec<u32>,
    /// Particles by bucket.
    order: Vec<u32>,
}

/// Where particles go.
struct Buckets<'a> {
    plan: &'a Plan,
    root: RootCell,
    extents: bool,
    buckets: &'a [Mutex<Bucket>],
    spill: &'a Spill,
}

impl Buckets<'_> {
    /// Sends the particles of a chunk to their buckets.
    fn distribute(
        &self,
        positions: &[[f64; 3]],
        columns: &[&Vec<f32>],
        scratch: &mut Scratch,
    ) -> Result<(), BuildError> {
        let Scratch { places, buckets, ends, order } = scratch;
        places.clear();
        places.extend(positions.iter().map(|&position| Place::of(position, self.root)));
        buckets.clear();
        buckets.extend(places.iter().map(|place| self.plan.bucket(place.key) as u32));
        ends.clear();
        ends.resize(self.buckets.len(), 0);
        buckets.iter().for_each(|&bucket| ends[bucket as usize] += 1);
        let mut end = 0;
        for count in &mut *ends {
            end += std::mem::replace(count, end);
        }
        order.resize(places.len(), 0);
        for (&bucket, i) in buckets.iter().zip(0..) {
            let end = &mut ends[bucket as usize];
            order[*end as usize] = i;
            *end += 1;
        }
        let mut start = 0;
        for (bucket, &end) in self.buckets.iter().zip(&*ends).filter(|(_, end)| **end > 0) {
            let mut rest = &order[start as usize..end as usize];
            start = end;
            if rest.is_empty() {
                continue;
            }
            let mut bucket = bucket.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            while !rest.is_empty() {
                let (now, after) = rest.split_at(rest.len().min(RUN - bucket.places.len()));
                bucket.places.extend(now.iter().map(|&i| places[i as usize]));
                for (own, column) in bucket.columns.iter_mut().zip(columns) {
                    own.extend(now.iter().map(|&i| column[i as usize]));
                }
                if self.extents {
                    now.iter().for_each(|&i| bucket.reach(places[i as usize].unit()));
                }
                rest = after;
                if bucket.places.len() == RUN {
                    bucket.put_away(self.spill)?;
                }
            }
        }
        Ok(())
    }
}

impl Bucket {
    fn reach(&mut self, at: [f64; 3]) {
        let (low, high) = self.extent.get_or_insert((at, at));
        low.iter_mut().zip(at).for_each(|(low, x)| *low = low.min(x));
        high.iter_mut().zip(at).for_each(|(high, x)| *high = high.max(x));
    }

    fn put_away(&mut self, spill: &Spill) -> Result<(), BuildError> {
        let keys: Vec<u64> = self.places.iter().map(|place| place.key).collect();
        let rests: Vec<u64> = self.places.iter().map(|place| place.rest).collect();
        let mut parts: Vec<&[u8]> = vec![bytemuck::cast_slice(&keys), bytemuck::cast_slice(&rests)];
        parts.extend(self.columns.iter().map(|column| bytemuck::cast_slice::<f32, u8>(column)));
        let blob = spill.put(&parts).map_err(|error| BuildError::temporary(spill, error))?;
        self.runs.push(blob);
        self.places.clear();
        self.columns.iter_mut().for_each(Vec::clear);
        Ok(())
    }
}
