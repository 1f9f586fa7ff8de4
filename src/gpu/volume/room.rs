//! How a picture shares the adapter's memory out.

use super::bindings::BATCH_BYTES;
use super::constants::{FACE_WORDS, PARTICLE_BITS};
use super::layout::MOST_BINS;
use super::view::VolumeJob;

/// Bytes that surfaces take for each pixel: places, colours, and directions twice.
const FACE_BYTES: u64 = 4 * 16;

/// How much may be used at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Bytes of cells.
    pub cells: u64,
    /// Bytes of one buffer.
    pub limit: u64,
    /// Particles of a batch.
    pub batch: u32,
    /// Bytes of the samples of a field.
    pub samples: u64,
}

impl Room {
    /// Least room that is tried, bytes.
    pub const LEAST: u64 = 1 << 23;
    /// Most particles that are binned at once. Each may have a block of its own, which has a place more.
    const MOST_BATCH: u64 = 1 << (PARTICLE_BITS - 1);
    const LEAST_BATCH: u64 = 1 << 14;

    /// Bytes of cells of each column that a job resamples by itself, and of one of their buffers, beside the cells of four values that rays go
    /// through; of other jobs all that there is.
    pub fn of_column(&self, job: &VolumeJob) -> [u64; 2] {
        match job.columns() {
            Some(march) => [self.cells / (march.columns.len() as u64 + 2), self.limit / 2],
            None => [self.cells, self.limit],
        }
    }

    /// Bytes that a pixel takes of the ends of rays, with its surface where that is kept.
    pub fn of_progress(job: &VolumeJob) -> u64 {
        4 * u64::from(1 + if job.keeps_faces() { FACE_WORDS } else { 0 })
    }

    /// Bytes that pixels take whatever the room: light twice, and slab by slab the ends of rays twice; where surfaces are kept these, too.
    pub fn of_pixels(job: &VolumeJob) -> u64 {
        let view = job.seen_from();
        let bytes = if job.cartesian().is_some() { 32 } else { 36 + Room::of_progress(job) };
        let faces = if job.keeps_faces() { FACE_BYTES } else { 0 };
        (bytes + faces) * u64::from(view.width) * u64::from(view.height)
    }

    /// Shares memory out where cells may take no more than `cells` bytes and one buffer `limit`.
    pub fn of(memory: u64, cells: u64, limit: u64) -> Room {
        let batch = (memory / 3 / BATCH_BYTES).min(limit / (4 * MOST_BINS)).clamp(Room::LEAST_BATCH, Room::MOST_BATCH);
        Room { cells: cells.min(memory / 2).min(limit), limit, batch: batch as u32, samples: 0 }
    }

    /// The same beside the samples of a field, which may take most of it.
    pub fn beside_samples(memory: u64, cells: u64, limit: u64) -> Room {
        Room { samples: memory - memory / 4, ..Room::of(memory / 4, cells, limit) }
    }

    /// Shares memory out where all cells of a grid are held, which take the most of it.
    pub fn of_whole(memory: u64, limit: u64) -> Room {
        Room { cells: (memory - memory / 4).min(limit), ..Room::of(memory / 2, 0, limit) }
    }
}
