//! Radial profiles: what is in shells around a centre, and how much of it a page file is not certain of.

use super::batch::{Batch, Gather, Uncertain, Work};
use super::coded::{Coded, add, mass_errors, missing_values};
use super::data::Data;
use super::error::ExploreError;
use super::estimate::{Effort, Estimate, Estimated, Found, LEAST_SHARE, Totals, ask, largest};
use super::farthest::farthest;
use super::profile::{Filled, ProfileOptions, Shell, Shells};
use super::query::{Of, Query, Wanted};
use super::region::Shape;
use super::selection::Members;
use super::several::Several;
use crate::model::Unit;
use glam::DVec3;
use serde::Serialize;

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
    /// How far off it may be beside that, where a part of the page file was read; `None` where all of it was.
    pub estimate: Option<RadialEstimate>,
}

/// How far off a radial profile may be because a part of a page file was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RadialEstimate {
    /// Of masses: densities are off by as much over the volumes of their shells.
    #[serde(flatten)]
    pub of_masses: Estimate,
    /// Three standard errors of each shell's mean; `None` where that is not known, and without a field.
    pub mean_errors: Vec<Option<f64>>,
    /// The same of its mass-weighted mean.
    pub mass_weighted_mean_errors: Vec<Option<f64>>,
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
    effort: Effort,
    periodic: Option<f64>,
    work: Work,
) -> Result<Radial, ExploreError> {
    let query = asked(data, of.into(), std::slice::from_ref(options), periodic)?;
    let gather = Shelling::new(data, &query, options)?;
    Ok(gather.told(data, ask(data, &query, &gather, effort, work)?))
}

/// Most profiles of one pass.
const MOST_AT_ONCE: usize = 256;

/// Several of them, at most 256, from one pass over the data; a part of a page file is enough where it is for each.
///
/// # Errors
/// As [`radial`], and where they are too many.
pub fn radials<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    options: &[ProfileOptions],
    effort: Effort,
    periodic: Option<f64>,
    work: Work,
) -> Result<Vec<Radial>, ExploreError> {
    if options.len() > MOST_AT_ONCE {
        return Err(ExploreError::value("profiles", options.len(), format!("at most {MOST_AT_ONCE} at once")));
    }
    let query = asked(data, of.into(), options, periodic)?;
    let each = options.iter().map(|options| Shelling::new(data, &query, options));
    let several = Several(each.collect::<Result<Vec<_>, ExploreError>>()?);
    let found = several.ask(data, &query, effort, work)?;
    Ok(several.0.iter().zip(found).map(|(gather, found)| gather.told(data, found)).collect())
}

/// The question to the data, with a column for each field.
fn asked<'a>(
    data: Data,
    of: Of<'a>,
    options: &[ProfileOptions],
    periodic: Option<f64>,
) -> Result<Query<'a>, ExploreError> {
    let mut columns: Vec<String> = Vec::new();
    for field in options.iter().filter_map(|options| options.field.as_ref()) {
        if !columns.contains(field) {
            columns.push(field.clone());
        }
    }
    Query::new(data, of, Wanted { columns, ..Wanted::default() }, periodic)
}

struct Shelling<'a> {
    field: Option<&'a str>,
    /// The column of the field's values.
    column: Option<usize>,
    center: DVec3,
    shells: Shells,
    /// By family.
    coded: Vec<Option<Coded>>,
}

impl<'a> Shelling<'a> {
    fn new(data: Data, query: &Query, options: &'a ProfileOptions) -> Result<Shelling<'a>, ExploreError> {
        let Some(region) = query.region() else {
            return Err(ExploreError::value("profile", "of ids", "a region with a sphere"));
        };
        let field = options.field.as_deref();
        Ok(Shelling {
            field,
            column: query.wanted.columns.iter().position(|name| Some(name.as_str()) == field),
            center: region.first_sphere().map_or(DVec3::ZERO, |(center, _)| center),
            shells: Shells::new(options, region, query.shapes.reference())?,
            coded: field.map_or_else(Vec::new, |field| Coded::by_family(data, field)),
        })
    }

    /// The field's values; none where the family lacks it.
    fn values<'b>(&self, batch: &'b Batch) -> &'b [f64] {
        self.column.and_then(|column| batch.columns.get(column)).map_or(&[], Vec::as_slice)
    }

    /// What was found as numbers.
    fn told(&self, data: Data, found: Found<ShellingPart>) -> Radial {
        let Found { part, sampled } = found;
        let mut shells = self.shells.finish(&part.filled);
        let estimate = sampled.map(|(totals, of_masses)| {
            self.correct(&mut shells, &totals.values);
            let [mean_errors, mass_weighted_mean_errors] = self.mean_errors(&totals);
            RadialEstimate { of_masses, mean_errors, mass_weighted_mean_errors }
        });
        let mass: f64 = shells.iter().map(|shell| shell.mass).sum();
        let share = |part: f64| if part > 0.0 { part / mass } else { 0.0 };
        let values_off = |which: usize| {
            let mean = if part.valued > 0.0 { part.values_off[which] / part.valued } else { 0.0 };
            self.field.is_some().then_some(mean)
        };
        let error = (!data.is_exact()).then(|| RadialError {
            other_shells: share(part.other_shells),
            masses: share(part.off[0]),
            masses_by_mean: share(part.off[1]),
            region: share(part.uncertain.mass),
            position: part.uncertain.position,
            values: values_off(0),
            values_by_mean: values_off(1),
            missing_values: self.field.map_or(0, |field| missing_values(data, field)),
        });
        Radial {
            center: self.center.to_array(),
            length_unit: data.length_unit().clone(),
            mass_unit: data.mass_unit().clone(),
            field: self.field.map(str::to_owned),
            field_unit: self.field.and_then(|field| data.unit_of(field)).unwrap_or_default(),
            count: shells.iter().map(|shell| shell.count).sum(),
            mass,
            shells,
            exact: data.is_exact(),
            error,
            estimate,
        }
    }
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

impl Gather for Shelling<'_> {
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
        let values = self.values(batch);
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

/// Totals of each shell, and where they begin: the number of particles and their mass.
const COUNT: usize = 0;
const MASS: usize = 1;
/// With a field: the number of values, or their mass, and after it the sums of values and of their squares, each as often or with its mass.
const VALUES: [usize; 2] = [2, 5];
const WITH_FIELD: usize = 8;
const WITHOUT_FIELD: usize = 2;

impl Shelling<'_> {
    /// The place of a total of a shell.
    fn total(&self, total: usize, shell: usize) -> usize {
        total * self.shells.len() + shell
    }

    /// Puts estimates in the place of what was read.
    fn correct(&self, shells: &mut [Shell], totals: &[f64]) {
        for (index, shell) in shells.iter_mut().enumerate() {
            let of = |total: usize| totals[self.total(total, index)];
            // No shell has less than nothing.
            shell.count = of(COUNT).round().max(0.0) as u64;
            shell.set_mass(of(MASS).max(0.0));
            if self.field.is_none() {
                continue;
            }
            let moments = VALUES.map(|first| {
                let (weight, sum, squares) = (of(first), of(first + 1), of(first + 2));
                let mean = sum / weight;
                (weight > 0.0).then(|| (mean, (squares / weight - mean * mean).max(0.0).sqrt()))
            });
            let [plain, weighted] = moments.map(|moments| moments.filter(|_| shell.count > 0));
            (shell.mean, shell.dispersion) = plain.unzip();
            (shell.mass_weighted_mean, shell.mass_weighted_dispersion) = weighted.unzip();
        }
    }

    /// Errors of the means of all shells, plain and weighted.
    fn mean_errors(&self, totals: &Totals) -> [Vec<Option<f64>>; 2] {
        let known = |error: f64| Some(error).filter(|error| error.is_finite());
        [0, 1].map(|which| match self.field {
            Some(_) => self.errors_of_means(totals, which).into_iter().map(known).collect(),
            None => Vec::new(),
        })
    }

    /// Errors of plain means, or of weighted ones: those of the ratios, and at least what the mean is off by where those that the shell has more or
    /// fewer of than was found, by the error of its weight, are any of it.
    fn errors_of_means(&self, totals: &Totals, which: usize) -> Vec<f64> {
        let n = self.shells.len();
        let place = |total: usize, shell: usize| self.total(VALUES[which] + total, shell);
        let of_ratios =
            totals.mean_errors_of(which * n..(which + 1) * n, |shell| [0, 1, 2].map(|total| place(total, shell)));
        let of_weights = totals.errors_of(place(0, 0)..place(1, 0));
        let error = |(shell, (error, of_weight)): (usize, (f64, f64))| {
            let of = |total: usize| totals.values[place(total, shell)];
            let (weight, mean) = (of(0), of(1) / of(0));
            let dispersion = (of(2) / weight - mean * mean).max(0.0).sqrt();
            let least = of_weight / weight * dispersion;
            if weight > 0.0 && least.is_finite() { error.max(least) } else { error }
        };
        of_ratios.into_iter().zip(of_weights).enumerate().map(error).collect()
    }

    /// The largest error of a mean relative to the root mean square of its shell's values, of shells with less than the least share of the weight
    /// as much less as they have less.
    fn largest_of_means(&self, totals: &Totals) -> f64 {
        let n = self.shells.len();
        let of = |total: usize| &totals.values[total * n..][..n];
        let largest = VALUES.iter().enumerate().map(|(which, &first)| {
            let least = LEAST_SHARE * of(first).iter().map(|weight| weight.abs()).sum::<f64>();
            let shells = of(first).iter().zip(of(first + 2)).zip(self.errors_of_means(totals, which));
            let relative = |((&weight, &squares), error): ((&f64, &f64), f64)| {
                // A shell without values has no mean.
                if weight <= 0.0 || error <= 0.0 {
                    return 0.0;
                }
                error * (weight / least).min(1.0) / (squares / weight).max(0.0).sqrt()
            };
            shells.map(relative).fold(0.0, f64::max)
        });
        largest.fold(0.0, f64::max)
    }
}

impl Estimated for Shelling<'_> {
    fn totals(&self) -> usize {
        self.shells.len() * if self.field.is_some() { WITH_FIELD } else { WITHOUT_FIELD }
    }

    /// The means of all shells, then the weighted ones.
    fn ratios(&self) -> Vec<[usize; 2]> {
        let of = |first: usize| {
            (0..self.shells.len()).map(move |shell| [first + 1, first].map(|total| self.total(total, shell)))
        };
        VALUES.into_iter().filter(|_| self.field.is_some()).flat_map(of).collect()
    }

    fn count(&self, part: &ShellingPart, totals: &mut [f64]) {
        let Filled { counts, masses, values } = &part.filled;
        for (shell, ((&count, mass), values)) in counts.iter().zip(masses).zip(values).enumerate() {
            totals[self.total(COUNT, shell)] += count as f64;
            totals[self.total(MASS, shell)] += mass;
            if self.field.is_none() {
                continue;
            }
            let plain = (values.count as f64, values.mean(), values.dispersion());
            let weighted = (values.weight, values.weighted_mean(), values.weighted_dispersion());
            for (first, (weight, mean, dispersion)) in VALUES.into_iter().zip([plain, weighted]) {
                let (mean, dispersion) = (mean.unwrap_or_default(), dispersion.unwrap_or_default());
                let sums = [weight, weight * mean, weight * (mean * mean + dispersion * dispersion)];
                for (total, sum) in (first..).zip(sums) {
                    totals[self.total(total, shell)] += sum;
                }
            }
        }
    }

    fn merged(&self, batch: &Batch, per_mass: f64, say: &mut dyn FnMut(usize, f64)) {
        let values = self.values(batch);
        for (i, (&at, &mass)) in
            batch.relative.iter().zip(&batch.mass).enumerate().filter(|(_, (_, mass))| mass.is_finite())
        {
            let shell = self.shells.shell(at);
            let count = mass * per_mass;
            say(self.total(COUNT, shell), count);
            say(self.total(MASS, shell), mass);
            let Some(&value) = values.get(i).filter(|value| value.is_finite()) else { continue };
            for (first, weight) in VALUES.into_iter().zip([count, mass]) {
                for (total, sum) in (first..).zip([weight, weight * value, weight * value * value]) {
                    say(self.total(total, shell), sum);
                }
            }
        }
    }

    fn scaled(&self, part: ShellingPart, factor: f64) -> ShellingPart {
        let times = |pair: [f64; 2]| pair.map(|value| factor * value);
        ShellingPart {
            filled: part.filled.scaled(factor),
            other_shells: factor * part.other_shells,
            off: times(part.off),
            values_off: times(part.values_off),
            valued: factor * part.valued,
            uncertain: part.uncertain.scaled(factor),
        }
    }

    fn errors(&self, totals: &Totals) -> (Vec<f64>, f64) {
        let masses = self.total(MASS, 0)..self.total(MASS + 1, 0);
        let errors = totals.errors_of(masses.clone());
        let of_means = if self.field.is_some() { self.largest_of_means(totals) } else { 0.0 };
        let largest = largest(&errors, &totals.values[masses]).max(of_means);
        (errors, largest)
    }
}

/// The members within a sphere about the centre of a profile, which is the first of their shapes from then on; `radius`: that of the sphere,
/// up to the farthest of them where it is `None`, in a periodic box half its edge. Members by ids are as they were.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read.
pub fn members_about(
    data: Data,
    members: Members,
    (center, radius): (DVec3, Option<f64>),
    periodic: Option<f64>,
    work: Work,
) -> Result<Members, ExploreError> {
    match members {
        Members::Region(mut region) => {
            let radius = match (radius, periodic) {
                (Some(radius), _) => radius,
                (None, Some(edge)) => 0.5 * edge,
                // What rounding puts a hair outside belongs to it.
                (None, None) => (1.0 + 1e-9) * farthest(data, &region, center, work)?,
            };
            region.shapes.insert(0, Shape::Sphere { center, radius });
            Ok(Members::Region(region))
        }
        members => Ok(members),
    }
}
