//! Where flow levels are sought: the tracks of an interval sorted by regions of one of their ends.

use super::BuildError;
use super::flow::FlowStep;
use super::matching::{TrackRecord, track_words};
use super::shuffle::Shuffle;
use super::states::StepStates;
use crate::hierarchy::octree::Plan;
use crate::hierarchy::spacetime::lattice::morton_key;

/// Particles of a region.
const REGION: usize = 1 << 16;

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

    /// The regions of a family.
    pub fn of(&self, family: usize) -> Vec<usize> {
        let first = self.starts[family];
        (first..first + self.plans[family].len()).collect()
    }

    /// The tracks of a region; asked for once.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn records(&self, region: usize) -> Result<Vec<u32>, BuildError> {
        self.tracks.take(region)
    }
}
