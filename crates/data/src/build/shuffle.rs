//! Records of 32-bit words, sent to buckets by several threads, and given back bucket by bucket.

use super::BuildError;
use super::spill::{Blob, Spill};
use std::sync::{Mutex, PoisonError};

/// Words of a bucket that are put away together.
const RUN: usize = 1 << 13;

/// Records by bucket.
pub(super) struct Shuffle {
    spill: Spill,
    words: usize,
    buckets: Vec<Mutex<Bucket>>,
}

#[derive(Default)]
struct Bucket {
    runs: Vec<Blob>,
    waiting: Vec<u32>,
}

impl Shuffle {
    /// No record yet, of `words` words each.
    pub fn new(buckets: usize, words: usize, spill: Spill) -> Shuffle {
        Shuffle { spill, words, buckets: (0..buckets).map(|_| Mutex::default()).collect() }
    }

    /// Bytes in the temporary file.
    pub fn on_disk(&self) -> u64 {
        self.spill.on_disk()
    }

    /// Sends records to the buckets that `bucket_of` names.
    ///
    /// # Errors
    /// When they cannot be put away.
    pub fn put(&self, records: &[u32], bucket_of: impl Fn(&[u32]) -> usize) -> Result<(), BuildError> {
        let count = records.len() / self.words;
        let record = |i: usize| &records[i * self.words..(i + 1) * self.words];
        let buckets: Vec<u32> = (0..count).map(|i| bucket_of(record(i)) as u32).collect();
        let mut order: Vec<u32> = (0..count as u32).collect();
        order.sort_by_key(|i| buckets[*i as usize]);
        for group in order.chunk_by(|a, b| buckets[*a as usize] == buckets[*b as usize]) {
            let bucket = &self.buckets[buckets[group[0] as usize] as usize];
            let mut bucket = bucket.lock().unwrap_or_else(PoisonError::into_inner);
            for i in group {
                bucket.waiting.extend_from_slice(record(*i as usize));
                // However many come at once, no more of them wait: in each bucket there is room for a run.
                if bucket.waiting.len() >= RUN {
                    let blob = self.spill.put(&[bytemuck::cast_slice(&bucket.waiting)]);
                    let blob = blob.map_err(|error| BuildError::temporary(&self.spill, error))?;
                    bucket.runs.push(blob);
                    bucket.waiting.clear();
                }
            }
        }
        Ok(())
    }

    /// The records of a bucket, in no particular order.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn get(&self, bucket: usize) -> Result<Vec<u32>, BuildError> {
        let bucket = self.buckets[bucket].lock().unwrap_or_else(PoisonError::into_inner);
        let len = bucket.runs.iter().map(|run| run.len() / 4).sum::<usize>() + bucket.waiting.len();
        let mut records = Vec::with_capacity(len);
        for run in &bucket.runs {
            let bytes = self.spill.get(run).map_err(|error| BuildError::temporary(&self.spill, error))?;
            records.extend_from_slice(bytemuck::cast_slice(&bytes));
        }
        records.extend_from_slice(&bucket.waiting);
        Ok(records)
    }
}
