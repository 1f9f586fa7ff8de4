//! Sums of splats, which every backend draws.

use super::{Adapter, Job, Needs, Output, Raw, Technique};
use crate::cpu::volume::VolumeError;
use crate::cpu::{Summation, among, draw_counted};
use crate::mode::{Footprint, Settings};

/// Sums of splats, by every backend.
pub struct SplatSums {
    /// The shape of a particle in the picture.
    pub footprint: fn(&Settings) -> Footprint,
}

/// Sums of splats as wide as their smoothing lengths.
pub static SPLAT_SUMS: SplatSums = SplatSums { footprint: |_| Footprint::Kernel };

impl Technique for SplatSums {
    fn output(&self) -> Output {
        Output::Sums
    }

    fn needs(&self, settings: &Settings) -> Needs {
        Needs { footprint: (self.footprint)(settings), ..Needs::default() }
    }

    fn adapter(&self) -> Adapter {
        Adapter::Splats
    }

    fn meets_surfaces(&self) -> bool {
        true
    }

    fn summation(&self, job: &Job<'_>) -> Option<Summation> {
        job.paths.is_none().then(|| Summation::new(job.view, &job.options))
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let (accumulation, counts) = match job.paths {
            Some(surfaces) => among::draw(job.view, job.batches, &job.options, surfaces)?,
            None => draw_counted(job.view, job.batches, &job.options),
        };
        Ok(Raw::Sums(accumulation, counts))
    }
}
