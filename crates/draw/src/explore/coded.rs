//! How far off the coded values of a page file may be, particle by particle, for answers that say it.

use super::batch::Batch;
use super::data::{Data, column, error_scale};
use super::paged::around;

/// How the values of a family's column are coded.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coded {
    index: usize,
    scale: Option<f64>,
}

impl Coded {
    /// By family; `None` where the family lacks the field. Nothing of a source, whose values are not coded.
    pub(super) fn by_family(data: Data, field: &str) -> Vec<Option<Coded>> {
        let Data::Pages(file) = data else { return Vec::new() };
        let families = file.metadata().families.iter();
        families
            .map(|family| {
                let (own, _) = column(family, field)?;
                Some(Coded { index: own.error_index(), scale: error_scale(family, own) })
            })
            .collect()
    }

    /// What a value may have been before it was coded: by the largest error, and by the mean one.
    pub(super) fn around(coded: Option<Coded>, value: f64, batch: &Batch) -> [(f64, f64); 2] {
        let error = coded.and_then(|coded| Some((batch.errors.get(coded.index)?, coded.scale)));
        error.map_or([(value, value); 2], |(error, scale)| {
            [error.max, error.mean].map(|error| around(value, error, scale))
        })
    }

    /// By how much a value may be off: at most, and usually.
    pub(super) fn off(coded: Option<Coded>, value: f64, batch: &Batch) -> [f64; 2] {
        Coded::around(coded, value, batch).map(|(low, high)| (high - value).max(value - low))
    }
}

/// By how much masses of a batch are off relative to them, at most and usually. The masses of a node are scaled to its exact sum, which
/// may double the error of a single one.
pub(super) fn mass_errors(batch: &Batch) -> [f64; 2] {
    let error = batch.errors.first().copied().unwrap_or_default();
    let most = if error.max < 1.0 { 2.0 * error.max / (1.0 - error.max) } else { f64::INFINITY };
    [most, error.mean]
}

/// Values of a field that the source of a page file does not have.
pub(super) fn missing_values(data: Data, field: &str) -> u64 {
    let Data::Pages(file) = data else { return 0 };
    let of = file.metadata().families.iter().filter_map(|family| family.attribute(field));
    of.map(|(_, info)| info.missing).fold(0, u64::saturating_add)
}

/// Adds what is off at most, and usually.
pub(super) fn add(sums: &mut [f64; 2], next: [f64; 2]) {
    sums.iter_mut().zip(next).for_each(|(sum, next)| *sum += next);
}
