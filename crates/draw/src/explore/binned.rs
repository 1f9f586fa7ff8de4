//! What plots show of fields: histograms of one field or of two together, weighted with mass, number or a field, each with how much of it
//! a page file is not certain of. Where axes have no ranges, particles are looked at twice; not so of a page file of which a part is
//! enough, where codebooks tell from where to where values go.

use super::batch::{Batch, Gather, Uncertain, Work};
use super::bins::Bins;
use super::coded::{Coded, add, mass_errors, missing_values};
use super::data::Data;
use super::error::ExploreError;
use super::estimate::{Effort, Estimate, Estimated, Found, Totals, ask, extents, largest};
use super::histogram::{Axis, MOST_BINS};
use super::query::{Of, Query, Wanted};
use crate::model::Unit;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::convert::Infallible;

/// Most bins of two axes together: each page that is read at once has a table of its own.
pub const MOST_CELLS: usize = 1 << 18;

/// What a particle counts for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Weight {
    /// Its mass.
    #[default]
    Mass,
    /// One.
    Count,
    /// Its value of this field.
    Field(String),
}

impl std::str::FromStr for Weight {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Weight, Infallible> {
        Ok(match text {
            "mass" => Weight::Mass,
            "count" => Weight::Count,
            field => Weight::Field(field.to_owned()),
        })
    }
}

impl std::fmt::Display for Weight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Weight::Mass => "mass",
            Weight::Count => "count",
            Weight::Field(field) => field,
        })
    }
}

impl Serialize for Weight {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Weight {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Weight, D::Error> {
        String::deserialize(deserializer)?.parse::<Weight>().map_err(serde::de::Error::custom)
    }
}

/// An axis that is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct BinnedAxis {
    /// The field along it.
    pub field: String,
    /// Bins of equal width, 1 to [`MOST_BINS`]; of two axes at most [`MOST_CELLS`] together.
    pub bins: usize,
    /// Whether bins are equal in the logarithm. None: where all values are positive and span more than a decade.
    pub logarithmic: Option<bool>,
    /// Lower edge of the first and upper edge of the last bin. None: smallest and largest value of the selection (smallest positive
    /// value on a logarithmic axis).
    pub range: Option<[f64; 2]>,
}

/// A weighted histogram of one field, or of two together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Binned {
    /// One axis or two.
    pub axes: Vec<Axis>,
    /// What particles count for.
    pub weight: Weight,
    /// Its unit.
    pub weight_unit: Unit,
    /// Sum of the weights in each bin; of two axes row by row, the first axis along a row.
    pub weights: Vec<f64>,
    /// Particles in each bin.
    pub counts: Vec<u64>,
    /// Sum of all weights in bins.
    pub total: f64,
    /// Particles in bins.
    pub count: u64,
    /// Particles that a logarithmic axis has no place for: values of zero or below.
    pub not_positive: u64,
    /// Particles with values beyond the ends of an axis whose range was set.
    pub outside: u64,
    /// Particles without a value or weight: of families that lack a field, or not a finite number.
    pub missing: u64,
    /// Whether every particle of the source was looked at, in its own precision; otherwise a page file was.
    pub exact: bool,
    /// How far off the answer of a page file may be.
    pub error: Option<BinnedError>,
    /// How far off it may be beside that, where a part of the page file was read; `None` where all of it was.
    pub estimate: Option<Estimate>,
}

/// How far off a histogram of a page file may be, by the errors of its codebooks as measured when it was built. Shares are of the sum of
/// the weights' sizes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BinnedError {
    /// Share of the weight that may belong to another bin, by the largest error of each codebook: not more does. What lies beyond an
    /// axis's end is of its last bin, unless the axis's range was set.
    pub other_bins: f64,
    /// The same by the mean error of each codebook: what is usual.
    pub other_bins_by_mean: f64,
    /// By how much weights themselves may be off at most.
    pub weights: f64,
    /// The same by the mean error.
    pub weights_by_mean: f64,
    /// Share of the weight that may be in or out of the region; `None` where weights are a field's and some may be.
    pub region: Option<f64>,
    /// Values of whole families that the source does not have, for which the family's mean stands.
    pub missing_values: u64,
}

/// Counts a selection along one axis or two.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, a field is not there, no particle has a place on an axis, or there are too many bins.
pub fn binned<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    axes: &[BinnedAxis],
    weight: &Weight,
    effort: Effort,
    periodic: Option<f64>,
    work: Work,
) -> Result<Binned, ExploreError> {
    let of = of.into();
    if !(1..=2).contains(&axes.len()) {
        return Err(ExploreError::value("plot", format!("of {} axes", axes.len()), "one axis or two"));
    }
    if let Some(axis) = axes.iter().find(|axis| !(1..=MOST_BINS).contains(&axis.bins)) {
        return Err(ExploreError::value("bins", axis.bins, format!("1 to {MOST_BINS}")));
    }
    let cells: usize = axes.iter().map(|axis| axis.bins).product();
    if axes.len() == 2 && cells > MOST_CELLS {
        return Err(ExploreError::value(
            "bins",
            format!("{cells} of two axes together"),
            format!("at most {MOST_CELLS}"),
        ));
    }
    for BinnedAxis { logarithmic, range, .. } in axes {
        if let Some([min, max]) = range
            && !(min < max && (max - min).is_finite() && (*logarithmic != Some(true) || *min > 0.0))
        {
            let expected = "two finite numbers in ascending order, positive on a logarithmic axis";
            return Err(ExploreError::value("range", format!("{min},{max}"), expected));
        }
    }
    let mut columns: Vec<String> = axes.iter().map(|axis| axis.field.clone()).collect();
    if let Weight::Field(field) = weight {
        columns.push(field.clone());
    }
    let query = Query::new(data, of, Wanted { columns: columns.clone(), ..Wanted::default() }, periodic)?;
    let held = || effort.part_of(data).and_then(|tree| extents(tree, &query, axes.len()));
    let extents = match axes.iter().all(|axis| axis.range.is_some()) {
        true => vec![Extent::NONE; axes.len()],
        false => match held() {
            Some(held) => held,
            None => query.ask(data, &Extents { columns: axes.len() }, work)?,
        },
    };
    let asked = axes;
    let axes: Vec<Axis> =
        asked.iter().zip(&extents).map(|(axis, extent)| laid_out(data, axis, *extent)).collect::<Result<_, _>>()?;
    let gather = Binning {
        bins: asked.iter().zip(&axes).map(|(asked, axis)| Bins::of(axis, asked.range.is_some())).collect(),
        cells,
        is_count: *weight == Weight::Count,
        weight_column: matches!(weight, Weight::Field(_)).then_some(axes.len()),
        coded: columns.iter().map(|field| Coded::by_family(data, field)).collect(),
    };
    let Found { mut part, sampled } = ask(data, &query, &gather, effort, work)?;
    let estimate = sampled.map(|(totals, estimate)| {
        gather.correct(&mut part, &totals);
        estimate
    });
    let total: f64 = part.weights.iter().sum();
    let share = |weight: f64| if weight > 0.0 { weight / part.size } else { 0.0 };
    let uncertain = match weight {
        Weight::Mass => Some(part.uncertain.mass),
        Weight::Count => Some(part.uncertain.count as f64),
        Weight::Field(_) => (part.uncertain.count == 0).then_some(0.0),
    };
    let error = (!data.is_exact()).then(|| BinnedError {
        other_bins: share(part.other_bins[0]).min(1.0),
        other_bins_by_mean: share(part.other_bins[1]).min(1.0),
        weights: share(part.off[0]),
        weights_by_mean: share(part.off[1]),
        region: uncertain.map(share),
        missing_values: columns.iter().map(|field| missing_values(data, field)).fold(0, u64::saturating_add),
    });
    let weight_unit = match weight {
        Weight::Mass => data.mass_unit().clone(),
        Weight::Count => Unit::default(),
        Weight::Field(field) => data.unit_of(field).unwrap_or_default(),
    };
    Ok(Binned {
        axes,
        weight: weight.clone(),
        weight_unit,
        total,
        count: part.counts.iter().sum(),
        weights: part.weights,
        counts: part.counts,
        not_positive: part.not_positive,
        outside: part.outside,
        missing: part.missing,
        exact: data.is_exact(),
        error,
        estimate,
    })
}

/// The smallest, the largest and the smallest positive one of finite values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    min: f64,
    max: f64,
    min_positive: f64,
}

impl Extent {
    pub(super) const NONE: Extent = Extent { min: f64::INFINITY, max: f64::NEG_INFINITY, min_positive: f64::INFINITY };

    /// With one more value; one that is not finite does not count.
    pub(super) fn with(self, value: f64) -> Extent {
        if !value.is_finite() {
            return self;
        }
        let min_positive = if value > 0.0 { value } else { f64::INFINITY };
        self.join(Extent { min: value, max: value, min_positive })
    }

    fn join(self, other: Extent) -> Extent {
        Extent {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            min_positive: self.min_positive.min(other.min_positive),
        }
    }
}

struct Extents {
    columns: usize,
}

impl Gather for Extents {
    type Part = Vec<Extent>;

    fn part(&self) -> Vec<Extent> {
        vec![Extent::NONE; self.columns]
    }

    fn take(&self, part: &mut Vec<Extent>, batch: &Batch) {
        for (extent, values) in part.iter_mut().zip(&batch.columns) {
            *extent = values.iter().fold(*extent, |extent, &value| extent.with(value));
        }
    }

    fn join(&self, whole: &mut Vec<Extent>, next: Vec<Extent>) -> Result<(), ExploreError> {
        whole.iter_mut().zip(next).for_each(|(whole, next)| *whole = whole.join(next));
        Ok(())
    }
}

/// An axis over all values, of some width.
pub(super) fn laid_out(data: Data, options: &BinnedAxis, extent: Extent) -> Result<Axis, ExploreError> {
    let BinnedAxis { field, bins, logarithmic, range } = options;
    let unit = data.unit_of(field).unwrap_or_default();
    if let Some([min, max]) = *range {
        let logarithmic = logarithmic.unwrap_or(min > 0.0 && max > 10.0 * min);
        return Ok(Axis { field: field.clone(), unit, logarithmic, min, max, bins: *bins });
    }
    let absent = |what: &str, expected: &str| {
        Err(ExploreError::missing(data.path(), format!("{what} value of {field} in the selection"), expected))
    };
    if extent.min > extent.max {
        return absent("any", "particles with one");
    }
    let logarithmic = logarithmic.unwrap_or(extent.min > 0.0 && extent.max > 10.0 * extent.min);
    if logarithmic && extent.max <= 0.0 {
        return absent("a positive", "some on a logarithmic axis");
    }
    let (mut min, mut max) = (if logarithmic { extent.min_positive } else { extent.min }, extent.max);
    if min == max && logarithmic {
        (min, max) = (min / 2.0, max * 2.0);
    } else if min == max {
        let half = if min == 0.0 { 0.5 } else { 0.5 * min.abs() };
        (min, max) = (min - half, max + half);
    }
    Ok(Axis { field: field.clone(), unit, logarithmic, min, max, bins: *bins })
}

struct Binning {
    bins: Vec<Bins>,
    cells: usize,
    is_count: bool,
    weight_column: Option<usize>,
    /// By column and family.
    coded: Vec<Vec<Option<Coded>>>,
}

/// Bins so far.
struct BinningPart {
    weights: Vec<f64>,
    counts: Vec<u64>,
    /// Sum of the weights' sizes.
    size: f64,
    /// Of it, what may belong to other bins: at most, and usually.
    other_bins: [f64; 2],
    /// By how much weights may be off.
    off: [f64; 2],
    not_positive: u64,
    outside: u64,
    missing: u64,
    uncertain: Uncertain,
}

/// The place of one of a batch among bins, of which it has the columns; `None` where it has none.
pub(super) fn place(bins: &[Bins], batch: &Batch, i: usize) -> Option<usize> {
    let (mut place, mut stride) = (0, 1);
    for (bins, values) in bins.iter().zip(&batch.columns) {
        let value = *values.get(i)?;
        let has_place = value.is_finite() && !(bins.logarithmic && value <= 0.0) && bins.reaches((value, value));
        if !has_place {
            return None;
        }
        place += stride * bins.bin(value);
        stride *= bins.edges.len() - 1;
    }
    Some(place)
}

impl Binning {
    /// Puts estimates in the place of what was read.
    fn correct(&self, part: &mut BinningPart, totals: &Totals) {
        let (weights, counts) = totals.values.split_at(self.cells);
        let is_field = self.weight_column.is_some();
        // No bin has less than nothing of a mass or a number.
        part.weights = weights.iter().map(|&weight| if is_field { weight } else { weight.max(0.0) }).collect();
        part.counts = counts.iter().map(|count| count.round().max(0.0) as u64).collect();
    }
}

/// Totals are the weights of all bins, and the numbers in them.
impl Estimated for Binning {
    fn totals(&self) -> usize {
        2 * self.cells
    }

    fn ratios(&self) -> Vec<[usize; 2]> {
        Vec::new()
    }

    fn count(&self, part: &BinningPart, totals: &mut [f64]) {
        let (weights, counts) = totals.split_at_mut(self.cells);
        weights.iter_mut().zip(&part.weights).for_each(|(sum, weight)| *sum += weight);
        counts.iter_mut().zip(&part.counts).for_each(|(sum, &count)| *sum += count as f64);
    }

    fn merged(&self, batch: &Batch, per_mass: f64, say: &mut dyn FnMut(usize, f64)) {
        let weights = self.weight_column.map_or(Some(&batch.mass), |column| batch.columns.get(column));
        for (i, (&mass, &weight)) in batch.mass.iter().zip(weights.into_iter().flatten()).enumerate() {
            let is_told = weight.is_finite() && mass.is_finite();
            let Some(place) = place(&self.bins, batch, i).filter(|_| is_told) else { continue };
            let count = mass * per_mass;
            let weight = match self.weight_column {
                Some(_) => count * weight,
                None if self.is_count => count,
                None => mass,
            };
            say(place, weight);
            say(self.cells + place, count);
        }
    }

    fn scaled(&self, mut part: BinningPart, factor: f64) -> BinningPart {
        let number = |number: u64| (factor * number as f64).round() as u64;
        let times = |pair: [f64; 2]| pair.map(|value| factor * value);
        part.weights.iter_mut().for_each(|weight| *weight *= factor);
        part.counts.iter_mut().for_each(|count| *count = number(*count));
        BinningPart {
            size: factor * part.size,
            other_bins: times(part.other_bins),
            off: times(part.off),
            not_positive: number(part.not_positive),
            outside: number(part.outside),
            missing: number(part.missing),
            uncertain: part.uncertain.scaled(factor),
            ..part
        }
    }

    fn errors(&self, totals: &Totals) -> (Vec<f64>, f64) {
        let errors = totals.errors_of(0..self.cells);
        let largest = largest(&errors, &totals.values[..self.cells]);
        (errors, largest)
    }
}

impl Gather for Binning {
    type Part = BinningPart;

    fn part(&self) -> BinningPart {
        BinningPart {
            weights: vec![0.0; self.cells],
            counts: vec![0; self.cells],
            size: 0.0,
            other_bins: [0.0; 2],
            off: [0.0; 2],
            not_positive: 0,
            outside: 0,
            missing: 0,
            uncertain: Uncertain::default(),
        }
    }

    fn take(&self, part: &mut BinningPart, batch: &Batch) {
        part.uncertain.add(&batch.uncertain);
        if batch.columns.iter().any(Vec::is_empty) {
            part.missing += batch.len() as u64;
            return;
        }
        let coded = |column: usize| self.coded[column].get(batch.family).copied().flatten();
        let axes: [Option<(&Bins, &[f64], Option<Coded>)>; 2] = [0, 1].map(|axis| {
            let bins = self.bins.get(axis)?;
            Some((bins, batch.columns.get(axis)?.as_slice(), coded(axis)))
        });
        let weights = match self.weight_column {
            Some(column) => batch.columns[column].as_slice(),
            None => batch.mass.as_slice(),
        };
        let weight_coded = self.weight_column.and_then(coded);
        let mass_errors = mass_errors(batch);
        for (i, &weight) in weights.iter().enumerate() {
            let weight = if self.is_count { 1.0 } else { weight };
            let (mut place, mut stride) = (0, 1);
            let (mut is_missing, mut is_positive, mut is_inside) = (!weight.is_finite(), true, true);
            // By the largest error, and by the mean one.
            let (mut is_certain, mut may_be_placed) = ([true; 2], [true; 2]);
            for (bins, values, coded) in axes.iter().flatten() {
                let value = values[i];
                is_missing |= !value.is_finite();
                let ends = Coded::around(*coded, value, batch);
                let has_logarithm = !bins.logarithmic || value > 0.0;
                is_positive &= has_logarithm;
                is_inside &= bins.reaches((value, value));
                for (may_be, ends) in may_be_placed.iter_mut().zip(ends) {
                    *may_be &= (!bins.logarithmic || ends.1 > 0.0) && bins.reaches(ends);
                }
                if has_logarithm {
                    let bin = bins.bin(value);
                    is_certain.iter_mut().zip(ends).for_each(|(is_certain, ends)| *is_certain &= bins.holds(bin, ends));
                    place += stride * bin;
                    stride *= bins.edges.len() - 1;
                }
            }
            if is_missing {
                part.missing += 1;
                continue;
            }
            let is_placed = is_positive && is_inside;
            let strays = if is_placed { is_certain.map(|is_certain| !is_certain) } else { may_be_placed };
            let size = weight.abs();
            part.other_bins.iter_mut().zip(strays).for_each(|(sum, strays)| *sum += if strays { size } else { 0.0 });
            if !is_placed {
                part.not_positive += u64::from(!is_positive);
                part.outside += u64::from(is_positive);
                continue;
            }
            part.weights[place] += weight;
            part.counts[place] += 1;
            part.size += size;
            let off = match self.weight_column {
                Some(_) => Coded::off(weight_coded, weight, batch),
                None if self.is_count => [0.0; 2],
                None => mass_errors.map(|error| weight * error),
            };
            add(&mut part.off, off);
        }
    }

    fn join(&self, whole: &mut BinningPart, next: BinningPart) -> Result<(), ExploreError> {
        whole.weights.iter_mut().zip(&next.weights).for_each(|(a, b)| *a += b);
        whole.counts.iter_mut().zip(&next.counts).for_each(|(a, b)| *a += b);
        whole.size += next.size;
        add(&mut whole.other_bins, next.other_bins);
        add(&mut whole.off, next.off);
        whole.not_positive += next.not_positive;
        whole.outside += next.outside;
        whole.missing += next.missing;
        whole.uncertain.add(&next.uncertain);
        Ok(())
    }
}
