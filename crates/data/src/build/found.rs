//! What is found out of columns that a source lacks, bucket by bucket: extremes, sums and a sample, and then how often which values are.

use super::BuildError;
use super::partition::Partition;
use crate::hierarchy::attribute_info::{HistogramBins, Range};
use crate::hierarchy::octree::Columns;
use crate::model::portable::portable;
use crate::model::progress::Progress;
use rayon::prelude::*;

/// Values of each column in the sample of a bucket at most, for the quantiser's scaling.
const SAMPLE: usize = 1 << 10;

/// What is known of some columns of one bucket, or of several.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    /// Extremes and means.
    pub ranges: Vec<Range>,
    /// A sample of each.
    pub samples: Vec<Vec<f32>>,
}

portable!(Seen { ranges, samples });

impl Seen {
    /// Of the columns of a bucket, in an order that depends on its particles alone.
    pub fn of<C: AsRef<[f32]>>(columns: &[C]) -> Seen {
        let sample = |values: &[f32]| values.iter().copied().step_by(values.len().div_ceil(SAMPLE).max(1)).collect();
        Seen {
            ranges: columns.iter().map(|values| Range::of(values.as_ref())).collect(),
            samples: columns.iter().map(|values| sample(values.as_ref())).collect(),
        }
    }

    /// The mean of each column.
    pub fn means(&self) -> Vec<f32> {
        self.ranges.iter().map(|range| range.mean() as f32).collect()
    }
}

/// What is known of a number of columns of all buckets, in their order.
pub(super) fn sum(buckets: impl IntoIterator<Item = Seen>, columns: usize) -> Seen {
    let mut all = Seen { ranges: vec![Range::EMPTY; columns], samples: vec![Vec::new(); columns] };
    for bucket in buckets {
        all.ranges.iter_mut().zip(bucket.ranges).for_each(|(all, own)| *all = all.with(own));
        all.samples.iter_mut().zip(bucket.samples).for_each(|(all, own)| all.extend(own));
    }
    all
}

/// Counts the values of some columns of some buckets for their histograms ([`super::partition::histograms`]).
///
/// # Errors
/// When particles cannot be read back.
pub(super) fn counts(
    partition: &Partition,
    buckets: std::ops::Range<usize>,
    ranges: &[Range],
    columns: impl Fn(Columns) -> Vec<Vec<f32>> + Sync,
    progress: &dyn Progress,
) -> Result<Vec<Vec<u64>>, BuildError> {
    let bins: Vec<HistogramBins> = ranges.iter().map(HistogramBins::of).collect();
    let none = || -> Vec<Vec<u64>> { bins.iter().map(|bins| bins.count(&[])).collect() };
    buckets
        .into_par_iter()
        .map(|bucket| {
            progress.go_on();
            let (_, own) = partition.read(bucket)?;
            Ok(bins.iter().zip(columns(own)).map(|(bins, values)| bins.count(&values)).collect())
        })
        .try_reduce(none, |sum, more| Ok(added(sum, more)))
}

/// Counts of the same columns, added up; none are none of any.
pub(super) fn added(mut sum: Vec<Vec<u64>>, more: Vec<Vec<u64>>) -> Vec<Vec<u64>> {
    if sum.is_empty() {
        return more;
    }
    sum.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(sum, more)| *sum += more);
    sum
}
