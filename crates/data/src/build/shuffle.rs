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
        let mut records = Vec::with_capacity(bucket.words());
        for run in &bucket.runs {
            self.append(run, &mut records)?;
        }
        records.extend_from_slice(&bucket.waiting);
        Ok(records)
    }

    /// The same for the last time: the bucket is empty then, and the memory that it took is free while others are still to be read.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn take(&self, bucket: usize) -> Result<Vec<u32>, BuildError> {
        let bucket = std::mem::take(&mut *self.buckets[bucket].lock().unwrap_or_else(PoisonError::into_inner));
        let mut records = Vec::with_capacity(bucket.words());
        for run in bucket.runs {
            self.append(&run, &mut records)?;
            self.spill.forget(run);
        }
        records.extend_from_slice(&bucket.waiting);
        Ok(records)
    }

    /// Reads a run back.
    fn append(&self, run: &Blob, records: &mut Vec<u32>) -> Result<(), BuildError> {
        let bytes = self.spill.get(run).map_err(|error| BuildError::temporary(&self.spill, error))?;
        records.extend_from_slice(bytemuck::cast_slice(&bytes));
        Ok(())
    }
}

impl Bucket {
    /// Words of its records.
    fn words(&self) -> usize {
        self.runs.iter().map(|run| run.len() / 4).sum::<usize>() + self.waiting.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ReadMethod;

    #[test]
    fn what_is_taken_is_what_was_put_and_is_there_once() {
        let folder = tempfile::tempdir().unwrap();
        let spill = Spill::new(&folder.path().join("out"), folder.path(), 1 << 16, ReadMethod::default());
        let shuffle = Shuffle::new(3, 2, spill);
        let records: Vec<u32> = (0..60_000).flat_map(|i| [i % 3, i]).collect();
        records.chunks(5000).for_each(|some| shuffle.put(some, |record| record[0] as usize).unwrap());
        assert!(shuffle.on_disk() > 0);
        for bucket in 0..3 {
            let known = shuffle.get(bucket).unwrap();
            assert_eq!(known.len(), 40_000);
            assert!(known.chunks(2).all(|record| record[0] as usize == bucket));
            assert_eq!(shuffle.take(bucket).unwrap(), known);
            assert!(shuffle.take(bucket).unwrap().is_empty());
        }
    }
}
