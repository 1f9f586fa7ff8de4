//! Histograms of a selection, of one field or of two together, and samples of it for scatter plots.

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::probe::{Fields, ProbeOptions, probe};
use super::query::{Of, Query, Wanted};
use crate::model::Unit;
use serde::Serialize;
use std::collections::BinaryHeap;

/// Most bins of an axis.
pub const MOST_BINS: usize = 4096;

/// An axis that is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisOptions {
    /// The field along it.
    pub field: String,
    /// Bins of equal width, 1 to [`MOST_BINS`].
    pub bins: usize,
    /// Whether bins are equal in the logarithm. None: where all values are positive and span more than a decade.
    pub logarithmic: Option<bool>,
    /// Lower edge of the first and upper edge of the last bin. None: smallest and largest value of the selection (smallest positive
    /// value on a logarithmic axis).
    pub range: Option<(f64, f64)>,
}

impl AxisOptions {
    /// An axis that is laid out by the selection's values.
    pub fn new(field: impl Into<String>, bins: usize) -> AxisOptions {
        AxisOptions { field: field.into(), bins, logarithmic: None, range: None }
    }
}

/// An axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// The field along it.
    pub field: String,
    /// Its unit.
    pub unit: Unit,
    /// Whether bins are equal in the logarithm.
    pub logarithmic: bool,
    /// Lower edge of the first bin.
    pub min: f64,
    /// Upper edge of the last bin.
    pub max: f64,
    /// Number of bins.
    pub bins: usize,
}

impl Axis {
    fn coordinate(&self, value: f64) -> f64 {
        if self.logarithmic { value.log2() } else { value }
    }

    /// The bin of a value; the last one has both its edges. `None` outside.
    pub fn bin(&self, value: f64) -> Option<usize> {
        if !(self.min..=self.max).contains(&value) {
            return None;
        }
        let (low, high) = (self.coordinate(self.min), self.coordinate(self.max));
        let share = if high > low { (self.coordinate(value) - low) / (high - low) } else { 0.0 };
        // The cast saturates.
        Some(((share * self.bins as f64) as usize).min(self.bins - 1))
    }

    /// Lower edge of bin `bin`; of one past the last: its upper edge.
    pub fn edge(&self, bin: usize) -> f64 {
        if bin >= self.bins {
            return self.max;
        }
        let (low, high) = (self.coordinate(self.min), self.coordinate(self.max));
        let at = low + (high - low) * bin as f64 / self.bins as f64;
        if self.logarithmic { at.exp2() } else { at }
    }
}

/// A histogram of one field, or of two together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldHistogram {
    /// One axis or two.
    pub axes: Vec<Axis>,
    /// Particles in each bin; of two axes row by row, the first axis along a row.
    pub counts: Vec<u64>,
    /// Their masses.
    pub masses: Vec<f64>,
    /// Particles with values beyond the axes' ends.
    pub outside: u64,
    /// Particles without a value: of families that lack a field, or not a finite number.
    pub missing: u64,
}

/// Counts a selection along one axis or two.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, a field is not there, or an axis makes no sense.
pub fn histogram<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    axes: &[AxisOptions],
    periodic: Option<f64>,
    work: Work,
) -> Result<FieldHistogram, ExploreError> {
    let of = of.into();
    if !(1..=2).contains(&axes.len()) {
        return Err(ExploreError::value("histogram", format!("of {} axes", axes.len()), "one axis or two"));
    }
    let axes = lay_out(data, of, axes, periodic, work)?;
    let columns: Vec<String> = axes.iter().map(|axis| axis.field.clone()).collect();
    let query = Query::new(data, of, Wanted { columns, ..Wanted::default() }, periodic)?;
    query.ask(data, &Binning { axes }, work)
}

/// Decides scale and range of axes.
fn lay_out(
    data: Data,
    of: Of,
    axes: &[AxisOptions],
    periodic: Option<f64>,
    work: Work,
) -> Result<Vec<Axis>, ExploreError> {
    for (i, axis) in axes.iter().enumerate() {
        let here = |name: &str| format!("axes[{i}].{name}");
        if !(1..=MOST_BINS).contains(&axis.bins) {
            return Err(ExploreError::value(here("bins"), axis.bins, format!("1 to {MOST_BINS}")));
        }
        if let Some((min, max)) = axis.range {
            let sound = min.is_finite() && max.is_finite() && min <= max;
            if !sound || axis.logarithmic == Some(true) && min <= 0.0 {
                let expected = "two numbers in ascending order, positive on a logarithmic axis";
                return Err(ExploreError::value(here("range"), format!("{min}..{max}"), expected));
            }
        }
    }
    let mut names: Vec<String> = axes.iter().map(|axis| axis.field.clone()).collect();
    names.dedup();
    let is_open = axes.iter().any(|axis| axis.range.is_none());
    let found = match is_open {
        true => Some(probe(data, of, &ProbeOptions { fields: Fields::Named(names), profile: None, periodic }, work)?),
        false => None,
    };
    let all = |field: &str, of: &dyn Fn(&super::probe::FieldStatistics) -> Option<f64>, join: fn(f64, f64) -> f64| {
        let families = found.iter().flat_map(|probe| &probe.families);
        families.flat_map(|family| &family.fields).filter(|f| f.name == field).filter_map(of).reduce(join)
    };
    let axis = |options: &AxisOptions| {
        let least = all(&options.field, &|field| field.min, f64::min);
        let (min, max) = match options.range {
            Some(range) => range,
            None => (least.unwrap_or(0.0), all(&options.field, &|field| field.max, f64::max).unwrap_or(1.0)),
        };
        let logarithmic = options.logarithmic.unwrap_or(min > 0.0 && max > 10.0 * min);
        let positive = || all(&options.field, &|field| field.min_positive, f64::min);
        let min = if logarithmic && min <= 0.0 { positive().unwrap_or(1.0).min(max.max(1.0)) } else { min };
        let unit = data.unit_of(&options.field).unwrap_or_default();
        Axis { field: options.field.clone(), unit, logarithmic, min, max: max.max(min), bins: options.bins }
    };
    Ok(axes.iter().map(axis).collect())
}

struct Binning {
    axes: Vec<Axis>,
}

impl Gather for Binning {
    type Part = FieldHistogram;

    fn part(&self) -> FieldHistogram {
        let bins = self.axes.iter().map(|axis| axis.bins).product();
        FieldHistogram {
            axes: self.axes.clone(),
            counts: vec![0; bins],
            masses: vec![0.0; bins],
            outside: 0,
            missing: 0,
        }
    }

    fn take(&self, part: &mut FieldHistogram, batch: &Batch) {
        if batch.columns.iter().any(Vec::is_empty) {
            part.missing += batch.len() as u64;
            return;
        }
        for (i, &mass) in batch.mass.iter().enumerate() {
            let mut place = Some(0);
            let mut stride = 1;
            let mut is_missing = false;
            for (axis, column) in self.axes.iter().zip(&batch.columns) {
                is_missing |= !column[i].is_finite();
                place = place.zip(axis.bin(column[i])).map(|(place, bin)| place + stride * bin);
                stride *= axis.bins;
            }
            match place {
                _ if is_missing => part.missing += 1,
                None => part.outside += 1,
                Some(place) => {
                    part.counts[place] += 1;
                    part.masses[place] += mass;
                }
            }
        }
    }

    fn join(&self, whole: &mut FieldHistogram, next: FieldHistogram) -> Result<(), ExploreError> {
        whole.counts.iter_mut().zip(&next.counts).for_each(|(a, b)| *a += b);
        whole.masses.iter_mut().zip(&next.masses).for_each(|(a, b)| *a += b);
        whole.outside += next.outside;
        whole.missing += next.missing;
        Ok(())
    }
}

/// A sample of a selection: pairs of values.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scatter {
    /// Values of the first field.
    pub x: Vec<f64>,
    /// Values of the second field, of the same particles.
    pub y: Vec<f64>,
    /// Particles with both values, of which these are a sample.
    pub of: u64,
}

/// A sample of at most `most` particles, each as likely as any other, the same every time.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read or a field is not there.
pub fn scatter<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    fields: [&str; 2],
    most: usize,
    periodic: Option<f64>,
    work: Work,
) -> Result<Scatter, ExploreError> {
    let columns = fields.map(str::to_owned).to_vec();
    let query = Query::new(data, of.into(), Wanted { columns, ..Wanted::default() }, periodic)?;
    let Sample { kept, of } = query.ask(data, &Sampling { most }, work)?;
    let kept = kept.into_sorted_vec();
    Ok(Scatter { x: kept.iter().map(|kept| kept.x).collect(), y: kept.iter().map(|kept| kept.y).collect(), of })
}

struct Sampling {
    most: usize,
}

/// The particles with the smallest hashes.
struct Sample {
    kept: BinaryHeap<Kept>,
    of: u64,
}

struct Kept {
    hash: u64,
    x: f64,
    y: f64,
}

impl PartialEq for Kept {
    fn eq(&self, other: &Kept) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Kept {}

impl PartialOrd for Kept {
    fn partial_cmp(&self, other: &Kept) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Kept {
    fn cmp(&self, other: &Kept) -> std::cmp::Ordering {
        let values = || self.x.total_cmp(&other.x).then(self.y.total_cmp(&other.y));
        self.hash.cmp(&other.hash).then_with(values)
    }
}

impl Sample {
    fn offer(&mut self, most: usize, kept: Kept) {
        if self.kept.len() < most {
            self.kept.push(kept);
        } else if self.kept.peek().is_some_and(|largest| kept < *largest) {
            self.kept.pop();
            self.kept.push(kept);
        }
    }
}

impl Gather for Sampling {
    type Part = Sample;

    fn part(&self) -> Sample {
        Sample { kept: BinaryHeap::new(), of: 0 }
    }

    fn take(&self, part: &mut Sample, batch: &Batch) {
        let [x, y] = [0, 1].map(|column| batch.columns.get(column).map_or(&[][..], Vec::as_slice));
        for ((&key, &x), &y) in batch.keys.iter().zip(x).zip(y) {
            if x.is_finite() && y.is_finite() {
                part.of += 1;
                part.offer(self.most, Kept { hash: mixed(key ^ (batch.family as u64) << 56), x, y });
            }
        }
    }

    fn join(&self, whole: &mut Sample, next: Sample) -> Result<(), ExploreError> {
        whole.of += next.of;
        next.kept.into_iter().for_each(|kept| whole.offer(self.most, kept));
        Ok(())
    }
}

/// SplitMix64's finisher: numbers that follow each other become numbers that do not.
fn mixed(key: u64) -> u64 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
