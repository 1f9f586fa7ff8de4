//! Histograms of a selection, of one field or of two together, and samples of it for scatter plots.

use super::batch::{Batch, Gather, Work};
use super::binned::{BinnedAxis, Extent, laid_out, place};
use super::bins::Bins;
use super::data::Data;
use super::error::ExploreError;
use super::estimate::{Effort, Estimate, Estimated, Found, Totals, ask, extents, largest};
use super::probe::{Fields, ProbeOptions, probe};
use super::query::{Of, Query, Wanted};
use crate::model::Unit;
use crate::model::mixing::{GOLDEN, as_share, mix_bits};
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
    /// How far off shares of the sample may be, where a part of a page file was read; `None` where all of it was.
    pub estimate: Option<Estimate>,
}

/// A sample of at most `most` particles, each as likely as any other, the same every time. Where a part of a page file is read, errors are
/// those of the share of the particles that each of 16 by 16 equal cells over all values has ([`Estimate::errors`]).
///
/// # Errors
/// [`ExploreError`] when the data cannot be read or a field is not there.
pub fn scatter<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    fields: [&str; 2],
    most: usize,
    effort: Effort,
    periodic: Option<f64>,
    work: Work,
) -> Result<Scatter, ExploreError> {
    let columns = fields.map(str::to_owned).to_vec();
    let query = Query::new(data, of.into(), Wanted { columns, ..Wanted::default() }, periodic)?;
    let held = effort.part_of(data).and_then(|tree| extents(tree, &query, fields.len()));
    let cell_axis = |(field, extent): (&str, Extent)| {
        let axis = BinnedAxis { field: field.to_owned(), bins: CELLS, logarithmic: None, range: None };
        Some(Bins::of(&laid_out(data, &axis, extent).ok()?, false))
    };
    let cells = held.and_then(|held| fields.into_iter().zip(held).map(cell_axis).collect::<Option<Vec<Bins>>>());
    // Without cells there is nothing that errors could be told of.
    let effort = if cells.is_some() { effort } else { Effort::ALL };
    let gather = Sampling { most, cells: cells.unwrap_or_default() };
    let Found { part, sampled } = ask(data, &query, &gather, effort, work)?;
    let of = sampled.as_ref().map_or(part.of, |(totals, _)| totals.values[gather.of()]);
    // A particle that stands for few others is left out as often as makes it as likely as the one that stands for most.
    let is_as_likely = |kept: &Kept| kept.rank * part.heaviest < 1.0;
    let (mut x, mut y) = (Vec::with_capacity(part.kept.len()), Vec::with_capacity(part.kept.len()));
    for kept in part.kept.into_sorted_vec().into_iter().filter(is_as_likely) {
        x.push(kept.x);
        y.push(kept.y);
    }
    Ok(Scatter { x, y, of: of.round() as u64, estimate: sampled.map(|(_, estimate)| estimate) })
}

/// Cells to the right and upwards of whose shares errors are told.
const CELLS: usize = 16;

struct Sampling {
    most: usize,
    /// Cells of whose shares errors are told: along both axes; none where all is read.
    cells: Vec<Bins>,
}

/// The particles with the smallest ranks.
struct Sample {
    kept: BinaryHeap<Kept>,
    /// Particles with both values.
    of: f64,
    /// How many others the particle stands for that stands for most.
    heaviest: f64,
    /// Particles in cells.
    in_cells: Vec<f64>,
}

struct Kept {
    /// A number from 0 to below 1 that has nothing to do with the particle, over how many particles it stands for: those below any bound are as
    /// likely as that number says.
    rank: f64,
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
        self.rank.total_cmp(&other.rank).then_with(values)
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
        let cells = if self.cells.is_empty() { 0 } else { CELLS * CELLS };
        Sample { kept: BinaryHeap::new(), of: 0.0, heaviest: 0.0, in_cells: vec![0.0; cells] }
    }

    fn take(&self, part: &mut Sample, batch: &Batch) {
        let [x, y] = [0, 1].map(|column| batch.columns.get(column).map_or(&[][..], Vec::as_slice));
        for (i, ((&key, &x), &y)) in batch.keys.iter().zip(x).zip(y).enumerate() {
            if !(x.is_finite() && y.is_finite()) {
                continue;
            }
            part.of += 1.0;
            part.heaviest = part.heaviest.max(1.0);
            let hash = mix_bits((key ^ (batch.family as u64) << 56).wrapping_add(GOLDEN));
            part.offer(self.most, Kept { rank: as_share(hash), x, y });
            if !self.cells.is_empty()
                && let Some(cell) = place(&self.cells, batch, i)
            {
                part.in_cells[cell] += 1.0;
            }
        }
    }

    fn join(&self, whole: &mut Sample, next: Sample) -> Result<(), ExploreError> {
        whole.of += next.of;
        whole.heaviest = whole.heaviest.max(next.heaviest);
        whole.in_cells.iter_mut().zip(&next.in_cells).for_each(|(whole, next)| *whole += next);
        next.kept.into_iter().for_each(|kept| whole.offer(self.most, kept));
        Ok(())
    }
}

impl Sampling {
    /// The total of particles with both values, as those that were read tell it. Shares are of it, for the sample knows no other.
    fn of_those_read(&self) -> usize {
        CELLS * CELLS
    }

    /// The same total, of which merged particles say something, too.
    fn of(&self) -> usize {
        CELLS * CELLS + 1
    }
}

/// Totals are the numbers of particles in all cells, of which merged particles say nothing: a sample has none of them.
impl Estimated for Sampling {
    fn totals(&self) -> usize {
        CELLS * CELLS + 2
    }

    fn ratios(&self) -> Vec<[usize; 2]> {
        (0..CELLS * CELLS).map(|cell| [cell, self.of_those_read()]).collect()
    }

    fn count(&self, part: &Sample, totals: &mut [f64]) {
        totals.iter_mut().zip(&part.in_cells).for_each(|(sum, count)| *sum += count);
        totals[self.of_those_read()] += part.of;
        totals[self.of()] += part.of;
    }

    fn merged(&self, batch: &Batch, per_mass: f64, say: &mut dyn FnMut(usize, f64)) {
        let [x, y] = [0, 1].map(|column| batch.columns.get(column).map_or(&[][..], Vec::as_slice));
        let valued = batch.mass.iter().zip(x).zip(y).filter(|((_, x), y)| x.is_finite() && y.is_finite());
        say(self.of(), valued.map(|((mass, _), _)| mass * per_mass).sum());
    }

    fn scaled(&self, mut part: Sample, factor: f64) -> Sample {
        let times = |kept: Kept| Kept { rank: kept.rank / factor, ..kept };
        part.in_cells.iter_mut().for_each(|count| *count *= factor);
        Sample {
            kept: part.kept.into_iter().map(times).collect(),
            of: factor * part.of,
            heaviest: factor * part.heaviest,
            in_cells: part.in_cells,
        }
    }

    fn errors(&self, totals: &Totals) -> (Vec<f64>, f64) {
        let all = totals.values[self.of_those_read()];
        let shares: Vec<f64> =
            totals.values[..CELLS * CELLS].iter().map(|count| if all > 0.0 { count / all } else { 0.0 }).collect();
        (totals.ratio_errors().to_vec(), largest(totals.ratio_errors(), &shares))
    }
}
