//! Columns that a source lacks, bucket by bucket: how they are found, and what is known of them: extremes, sums and a sample, and then how
//! often which values are.

use super::BuildError;
use super::partition::Partition;
use crate::hierarchy::attribute_info::{HistogramBins, Range};
use crate::hierarchy::octree::{Columns, Place};
use crate::model::portable::{expect, portable};
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

    /// Nothing yet of so many columns.
    pub fn none(columns: usize) -> Seen {
        Seen { ranges: vec![Range::EMPTY; columns], samples: vec![Vec::new(); columns] }
    }

    /// With what is known of the bucket that comes next.
    pub fn with(mut self, bucket: Seen) -> Seen {
        self.ranges.iter_mut().zip(bucket.ranges).for_each(|(own, next)| *own = own.with(next));
        self.samples.iter_mut().zip(bucket.samples).for_each(|(own, next)| own.extend(next));
        self
    }

    /// Whether it is of so many columns; else what was found and expected.
    pub fn check(&self, columns: usize) -> Result<(), String> {
        expect("ranges", self.ranges.len(), columns)?;
        expect("samples", self.samples.len(), columns)
    }

    /// The mean of each column.
    pub fn means(&self) -> Vec<f32> {
        self.ranges.iter().map(|range| range.mean() as f32).collect()
    }
}

/// The particles of a bucket in an order that depends on them alone.
pub(super) struct Ordered<P> {
    /// Which one of those that are read comes first, and so on.
    pub order: Vec<u32>,
    /// What was made of their places.
    pub places: Vec<P>,
    /// Their quantities.
    pub columns: Columns,
}

/// The particles of some buckets, which `read` reads, with what `of` makes of the place of each.
///
/// # Errors
/// When particles cannot be read back.
pub(super) fn ordered<P: Send>(
    buckets: std::ops::Range<usize>,
    read: impl Fn(usize) -> Result<(Vec<Place>, Columns), BuildError> + Sync,
    of: impl Fn(Place) -> P + Sync,
    progress: &dyn Progress,
) -> Result<Vec<Ordered<P>>, BuildError> {
    buckets
        .into_par_iter()
        .map(|bucket| {
            progress.go_on();
            let (places, columns) = read(bucket)?;
            let order = columns.order(&places);
            let places = order.iter().map(|&i| of(places[i as usize])).collect();
            let columns = columns.gather(&order);
            Ok(Ordered { order, places, columns })
        })
        .collect()
}

/// Columns of the particles of a block of buckets.
pub(super) struct Block {
    /// The order of the particles of each bucket ([`Ordered::order`]).
    pub orders: Vec<Vec<u32>>,
    /// The columns, in these orders, one bucket after the other.
    pub columns: Vec<Vec<f32>>,
}

/// How columns that a source lacks are found: a block of buckets at a time, since the neighbours of their particles lie in others too.
pub(super) trait Finding {
    /// What progress calls it.
    const STAGE: &'static str;

    /// The columns of some buckets.
    ///
    /// # Errors
    /// When particles cannot be read back.
    fn of_block(
        &self,
        partition: &Partition,
        buckets: std::ops::Range<usize>,
        progress: &dyn Progress,
    ) -> Result<Block, BuildError>;

    /// Puts the columns of a bucket away, in the order of reading.
    ///
    /// # Errors
    /// When the disk takes no more.
    fn put(partition: &mut Partition, bucket: usize, columns: &[Vec<f32>]) -> Result<(), BuildError>;

    /// Finds the columns of some buckets, of about `block` particles at a time, and puts them away: what is known of each bucket.
    ///
    /// # Errors
    /// As [`Finding::of_block`] and [`Finding::put`].
    fn of_buckets(
        &self,
        partition: &mut Partition,
        buckets: std::ops::Range<usize>,
        block: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<Seen>, BuildError> {
        let particles: usize = buckets.clone().map(|bucket| partition.len(bucket)).sum();
        progress.begin(Self::STAGE, particles as u64);
        let mut seen = Vec::with_capacity(buckets.len());
        for buckets in partition.blocks(buckets, block) {
            let Block { orders, columns } = self.of_block(partition, buckets.clone(), progress)?;
            let mut at = 0;
            for (bucket, order) in buckets.zip(&orders) {
                let own = at..at + order.len();
                at = own.end;
                let sorted: Vec<&[f32]> = columns.iter().map(|values| &values[own.clone()]).collect();
                seen.push(Seen::of(&sorted));
                let read: Vec<Vec<f32>> = sorted.iter().map(|sorted| in_reading_order(order, sorted)).collect();
                Self::put(partition, bucket, &read)?;
            }
        }
        Ok(seen)
    }
}

/// Values in the order in which a bucket's particles are read, of those in another order.
fn in_reading_order(order: &[u32], sorted: &[f32]) -> Vec<f32> {
    let mut read = vec![0.0; order.len()];
    order.iter().zip(sorted).for_each(|(&i, &value)| read[i as usize] = value);
    read
}

/// What is known of a number of columns of all buckets, in their order.
pub(super) fn sum(buckets: impl IntoIterator<Item = Seen>, columns: usize) -> Seen {
    buckets.into_iter().fold(Seen::none(columns), Seen::with)
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
    // Counts that were forged do not add up.
    let add = |(sum, more): (&mut u64, &u64)| *sum = sum.saturating_add(*more);
    sum.iter_mut().flatten().zip(more.iter().flatten()).for_each(add);
    sum
}
