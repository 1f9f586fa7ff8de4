//! What plots show: histograms of one field or of two together, weighted with mass, number or a field, and radial profiles, each with
//! how much of it a page file is not certain of. Where axes have no ranges, particles are looked at twice.

use super::batch::{Batch, Gather, Uncertain, Work};
use super::data::{Data, column, error_scale};
use super::error::ExploreError;
use super::histogram::{Axis, MOST_BINS};
use super::paged::around;
use super::profile::{Filled, ProfileOptions, Shell, Shells};
use super::query::{Of, Query, Wanted};
use crate::model::Unit;
use glam::DVec3;
use serde::{Serialize, Serializer};
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

/// How the values of a family's column are coded.
#[derive(Clone, Copy, Debug)]
struct Coded {
    index: usize,
    scale: Option<f64>,
}

impl Coded {
    /// By family; `None` where the family lacks the field. Nothing of a source, whose values are not coded.
    fn by_family(data: Data, field: &str) -> Vec<Option<Coded>> {
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
    fn around(coded: Option<Coded>, value: f64, batch: &Batch) -> [(f64, f64); 2] {
        let error = coded.and_then(|coded| Some((batch.errors.get(coded.index)?, coded.scale)));
        error.map_or([(value, value); 2], |(error, scale)| {
            [error.max, error.mean].map(|error| around(value, error, scale))
        })
    }

    /// By how much a value may be off: at most, and usually.
    fn off(coded: Option<Coded>, value: f64, batch: &Batch) -> [f64; 2] {
        Coded::around(coded, value, batch).map(|(low, high)| (high - value).max(value - low))
    }
}

/// By how much masses of a batch are off relative to them, at most and usually. The masses of a node are scaled to its exact sum, which
/// may double the error of a single one.
fn mass_errors(batch: &Batch) -> [f64; 2] {
    let error = batch.errors.first().copied().unwrap_or_default();
    let most = if error.max < 1.0 { 2.0 * error.max / (1.0 - error.max) } else { f64::INFINITY };
    [most, error.mean]
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
    let extents = match axes.iter().all(|axis| axis.range.is_some()) {
        true => vec![Extent::NONE; axes.len()],
        false => query.ask(data, &Extents { columns: axes.len() }, work)?,
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
    let part = query.ask(data, &gather, work)?;
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
    })
}

/// Values of a field that the source of a page file does not have.
fn missing_values(data: Data, field: &str) -> u64 {
    let Data::Pages(file) = data else { return 0 };
    let of = file.metadata().families.iter().filter_map(|family| family.attribute(field));
    of.map(|(_, info)| info.missing).fold(0, u64::saturating_add)
}

/// The smallest, the largest and the smallest positive one of finite values.
#[derive(Clone, Copy, Debug)]
struct Extent {
    min: f64,
    max: f64,
    min_positive: f64,
}

impl Extent {
    const NONE: Extent = Extent { min: f64::INFINITY, max: f64::NEG_INFINITY, min_positive: f64::INFINITY };

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
            *extent = values.iter().filter(|value| value.is_finite()).fold(*extent, |extent, &value| {
                let min_positive = if value > 0.0 { value } else { f64::INFINITY };
                extent.join(Extent { min: value, max: value, min_positive })
            });
        }
    }

    fn join(&self, whole: &mut Vec<Extent>, next: Vec<Extent>) -> Result<(), ExploreError> {
        whole.iter_mut().zip(next).for_each(|(whole, next)| *whole = whole.join(next));
        Ok(())
    }
}

/// An axis over all values, of some width.
fn laid_out(data: Data, options: &BinnedAxis, extent: Extent) -> Result<Axis, ExploreError> {
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

/// The bins of an axis, in which a value is found at once.
struct Bins {
    logarithmic: bool,
    /// Whether values beyond the ends are of no bin; of the last ones otherwise.
    has_ends: bool,
    low: f64,
    per_unit: f64,
    edges: Vec<f64>,
}

impl Bins {
    fn of(axis: &Axis, has_ends: bool) -> Bins {
        let place = |value: f64| if axis.logarithmic { value.log2() } else { value };
        let (low, high) = (place(axis.min), place(axis.max));
        let per_unit = axis.bins as f64 / (high - low);
        Bins { logarithmic: axis.logarithmic, has_ends, low, per_unit, edges: edges(axis) }
    }

    /// Whether something from `low` to `high` has a bin.
    #[inline]
    fn reaches(&self, (low, high): (f64, f64)) -> bool {
        !self.has_ends || high >= self.edges[0] && low <= self.edges[self.edges.len() - 1]
    }

    /// The bin of a value, which has its lower edge; one beyond the ends is of the last bin there.
    #[inline]
    fn bin(&self, value: f64) -> usize {
        let last = self.edges.len() - 2;
        let at = if self.logarithmic { value.log2() } else { value };
        // The cast saturates. What the logarithm's rounding puts beside its bin goes where the edges say.
        let mut bin = (((at - self.low) * self.per_unit) as usize).min(last);
        while bin > 0 && value < self.edges[bin] {
            bin -= 1;
        }
        while bin < last && value >= self.edges[bin + 1] {
            bin += 1;
        }
        bin
    }

    /// Whether all from `low` to `high` is of a bin.
    #[inline]
    fn holds(&self, bin: usize, (low, high): (f64, f64)) -> bool {
        let last = self.edges.len() - 2;
        let is_placed = !self.logarithmic || low > 0.0;
        let is_above = low >= self.edges[bin] || bin == 0 && !self.has_ends;
        let is_below = high < self.edges[bin + 1] || bin == last && (!self.has_ends || high <= self.edges[last + 1]);
        is_placed && is_above && is_below
    }
}

/// The edges of an axis's bins, ascending: one more than it has bins.
pub fn edges(axis: &Axis) -> Vec<f64> {
    // The ends as they are, not as the logarithm rounds them.
    let edge = |bin: usize| if bin == 0 { axis.min } else { axis.edge(bin).clamp(axis.min, axis.max) };
    (0..=axis.bins).map(edge).collect()
}

fn add(sums: &mut [f64; 2], next: [f64; 2]) {
    sums.iter_mut().zip(next).for_each(|(sum, next)| *sum += next);
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

/// A radial profile.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Radial {
    /// The centre of the shells.
    pub center: [f64; 3],
    /// Unit of lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// The field whose means are in the shells.
    pub field: Option<String>,
    /// Its unit.
    pub field_unit: Unit,
    /// From the centre outwards.
    pub shells: Vec<Shell>,
    /// Particles in all shells.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Whether every particle of the source was looked at, in its own precision; otherwise a page file was.
    pub exact: bool,
    /// How far off the answer of a page file may be.
    pub error: Option<RadialError>,
}

/// How far off a radial profile of a page file may be. Shares are of the mass in all shells.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RadialError {
    /// Share of the mass that may belong to the shell beside its own.
    pub other_shells: f64,
    /// By how much masses themselves may be off at most.
    pub masses: f64,
    /// The same by the mean error of each codebook.
    pub masses_by_mean: f64,
    /// Share of the mass that may be in or out of the region.
    pub region: f64,
    /// Largest rounding of a coordinate, in the unit of lengths.
    pub position: f64,
    /// The largest error of the field's values, in its unit, as a mean weighted with mass; `None` without a field.
    pub values: Option<f64>,
    /// The same of the mean error.
    pub values_by_mean: Option<f64>,
    /// Values of whole families that the source does not have, for which the family's mean stands.
    pub missing_values: u64,
}

/// Sums up what is in shells around the centre of a region's first sphere.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, the field is not there, or the region has no sphere.
pub fn radial<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    options: &ProfileOptions,
    periodic: Option<f64>,
    work: Work,
) -> Result<Radial, ExploreError> {
    let columns: Vec<String> = options.field.iter().cloned().collect();
    let query = Query::new(data, of.into(), Wanted { columns, ..Wanted::default() }, periodic)?;
    let Some(region) = query.region() else {
        return Err(ExploreError::value("profile", "of ids", "a region with a sphere"));
    };
    let gather = Shelling {
        shells: Shells::new(options, region, query.shapes.reference())?,
        coded: options.field.as_ref().map_or_else(Vec::new, |field| Coded::by_family(data, field)),
    };
    let part = query.ask(data, &gather, work)?;
    let shells = gather.shells.finish(&part.filled);
    let mass: f64 = shells.iter().map(|shell| shell.mass).sum();
    let share = |part: f64| if part > 0.0 { part / mass } else { 0.0 };
    let field = options.field.as_deref();
    let values_off = |which: usize| {
        let mean = if part.valued > 0.0 { part.values_off[which] / part.valued } else { 0.0 };
        field.is_some().then_some(mean)
    };
    let error = (!data.is_exact()).then(|| RadialError {
        other_shells: share(part.other_shells),
        masses: share(part.off[0]),
        masses_by_mean: share(part.off[1]),
        region: share(part.uncertain.mass),
        position: part.uncertain.position,
        values: values_off(0),
        values_by_mean: values_off(1),
        missing_values: field.map_or(0, |field| missing_values(data, field)),
    });
    Ok(Radial {
        center: region.first_sphere().map_or([0.0; 3], |(center, _)| center.to_array()),
        length_unit: data.length_unit().clone(),
        mass_unit: data.mass_unit().clone(),
        field: options.field.clone(),
        field_unit: field.and_then(|field| data.unit_of(field)).unwrap_or_default(),
        count: shells.iter().map(|shell| shell.count).sum(),
        mass,
        shells,
        exact: data.is_exact(),
        error,
    })
}

struct Shelling {
    shells: Shells,
    /// By family.
    coded: Vec<Option<Coded>>,
}

struct ShellingPart {
    filled: Filled,
    other_shells: f64,
    off: [f64; 2],
    /// Mass times the errors of values, and the mass of those that have one.
    values_off: [f64; 2],
    valued: f64,
    uncertain: Uncertain,
}

impl Gather for Shelling {
    type Part = ShellingPart;

    fn part(&self) -> ShellingPart {
        ShellingPart {
            filled: self.shells.empty(),
            other_shells: 0.0,
            off: [0.0; 2],
            values_off: [0.0; 2],
            valued: 0.0,
            uncertain: Uncertain::default(),
        }
    }

    fn take(&self, part: &mut ShellingPart, batch: &Batch) {
        part.uncertain.add(&batch.uncertain);
        let values = batch.columns.first().map_or(&[][..], Vec::as_slice);
        self.shells.fill(&mut part.filled, batch, values);
        // Along all three axes at once.
        let reach = 3.0_f64.sqrt() * batch.uncertain.position;
        if reach > 0.0 {
            part.other_shells += self.shells.near_edges(batch, reach);
        }
        let mass: f64 = batch.mass.iter().sum();
        if mass > 0.0 {
            add(&mut part.off, mass_errors(batch).map(|error| mass * error));
        }
        let coded = self.coded.get(batch.family).copied().flatten();
        for (&value, &mass) in values.iter().zip(&batch.mass).filter(|(value, _)| value.is_finite()) {
            add(&mut part.values_off, Coded::off(coded, value, batch).map(|off| mass * off));
            part.valued += mass;
        }
    }

    fn join(&self, whole: &mut ShellingPart, next: ShellingPart) -> Result<(), ExploreError> {
        whole.filled.join(&next.filled);
        whole.other_shells += next.other_shells;
        add(&mut whole.off, next.off);
        add(&mut whole.values_off, next.values_off);
        whole.valued += next.valued;
        whole.uncertain.add(&next.uncertain);
        Ok(())
    }
}

/// Distance from a place to the farthest particle; 0 of none.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read.
pub fn farthest<'a>(data: Data, of: impl Into<Of<'a>>, center: DVec3, work: Work) -> Result<f64, ExploreError> {
    let query = Query::new(data, of.into(), Wanted::default(), None)?;
    Ok(query.ask(data, &Farthest { center }, work)?.sqrt())
}

struct Farthest {
    center: DVec3,
}

impl Gather for Farthest {
    /// The squared distance.
    type Part = f64;

    fn part(&self) -> f64 {
        0.0
    }

    fn take(&self, part: &mut f64, batch: &Batch) {
        *part = batch.positions.iter().map(|at| at.distance_squared(self.center)).fold(*part, f64::max);
    }

    fn join(&self, whole: &mut f64, next: f64) -> Result<(), ExploreError> {
        *whole = whole.max(next);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_value_is_in_the_bin_between_whose_edges_it_is(
            low in 1e-6..1e3_f64, span in 1e-3..1e9_f64, bins in 1..300_usize, share in 0.0..=1.0_f64, logarithmic: bool, has_ends: bool
        ) {
            let axis = Axis {
                field: "mass".into(), unit: Unit::default(), logarithmic, min: low, max: low + span, bins,
            };
            let edges = edges(&axis);
            prop_assert_eq!((edges[0], edges[bins], edges.len()), (axis.min, axis.max, bins + 1));
            prop_assert!(edges.windows(2).all(|pair| pair[0] <= pair[1]));
            let found = Bins::of(&axis, has_ends);
            for value in [low + share * span, edges[(share * bins as f64) as usize], axis.min, axis.max] {
                let bin = found.bin(value);
                prop_assert!(edges[bin] <= value && (value < edges[bin + 1] || bin == bins - 1), "{bin} {value}");
                prop_assert!(found.holds(bin, (value, value)) && found.reaches((value, value)));
            }
            let beyond = 2.0 * axis.max;
            prop_assert_eq!(found.reaches((beyond, beyond)), !has_ends);
            prop_assert_eq!(found.bin(beyond), bins - 1);
        }
    }
}
