//! The probe: sums over everything in a region, of the whole data and not of what happens to be in memory.

use super::batch::{Batch, Gather, Uncertain, Work};
use super::center::CenterSums;
use super::data::{Data, column, error_scale};
use super::error::ExploreError;
use super::moments::Moments;
use super::profile::{Filled, ProfileOptions, Shell, Shells};
use super::query::{Of, Query, Wanted};
use crate::model::{FamilyName, Unit};
use glam::DVec3;
use serde::Serialize;

/// What a probe is to find out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProbeOptions {
    /// Whose statistics.
    pub fields: Fields,
    /// Shells, for regions with a sphere.
    pub profile: Option<ProfileOptions>,
    /// Edge of the periodic box around which distances are taken: [`Data::periodic_edge`], or none.
    pub periodic: Option<f64>,
}

/// Whose statistics a probe takes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Fields {
    /// Of no field: count and mass alone, which a page file answers from its nodes' exact sums.
    None,
    /// Of every scalar field.
    #[default]
    All,
    /// Of these.
    Named(Vec<String>),
}

/// What is in a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Probe {
    /// Whether every particle of the source was looked at, in its own precision; otherwise a page file was, and `families` say how
    /// far off the answer may be.
    pub exact: bool,
    /// Number of particles.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Their centre of mass, within the periodic box where there is one.
    pub center_of_mass: Option<[f64; 3]>,
    /// Unit of lengths.
    pub length_unit: Unit,
    /// Unit of masses.
    pub mass_unit: Unit,
    /// Edge of the periodic box around which distances were taken.
    pub periodic_edge: Option<f64>,
    /// By family; families without a particle in the region are left out.
    pub families: Vec<FamilyProbe>,
    /// Shells around the centre of the region's sphere, of all families together.
    pub profile: Option<Profile>,
}

/// What is in a region, of one family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FamilyProbe {
    /// Which family.
    pub name: FamilyName,
    /// Number of particles.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Their centre of mass, within the periodic box where there is one.
    pub center_of_mass: Option<[f64; 3]>,
    /// Their velocities, where the data has them.
    pub velocity: Option<VelocityStatistics>,
    /// Their fields.
    pub fields: Vec<FieldStatistics>,
    /// Of a page file: what may or may not belong to the region, because positions and values are rounded.
    pub uncertain: Option<Uncertain>,
}

/// Statistics of one field.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldStatistics {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Unit,
    /// Values that are finite numbers; the others are left out.
    pub count: u64,
    /// Mean; `None` without a value.
    pub mean: Option<f64>,
    /// Root of the mean squared deviation.
    pub dispersion: Option<f64>,
    /// Mean, weighted with mass.
    pub mass_weighted_mean: Option<f64>,
    /// Dispersion about it, weighted with mass.
    pub mass_weighted_dispersion: Option<f64>,
    /// Smallest value.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Smallest positive value, where logarithmic axes begin.
    pub min_positive: Option<f64>,
    /// Of a page file: how far coded values are from the source's.
    pub error: Option<CodingError>,
}

/// How far the values of a page file are from the source's, as measured when it was built, over the codebooks that came up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CodingError {
    /// Mean error of a particle's value.
    pub mean: f64,
    /// Largest error.
    pub max: f64,
    /// What errors are relative to: the value itself where `None`, else this range of values.
    pub of_range: Option<f64>,
    /// Values of the whole family that the source does not have; the page file has their mean instead.
    pub missing: u64,
}

/// Velocities, weighted with mass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct VelocityStatistics {
    /// Mean velocity.
    pub mean: [f64; 3],
    /// Dispersion about it along each axis.
    pub dispersion: [f64; 3],
    /// Dispersion along a line of sight, the mean over all directions: root of the mean of the squares of `dispersion`.
    pub dispersion_1d: f64,
}

/// Shells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Profile {
    /// Their centre.
    pub center: [f64; 3],
    /// The field whose means are in them.
    pub field: Option<String>,
    /// From the centre outwards.
    pub shells: Vec<Shell>,
}

/// Sums up what is in a region, or of particles with certain ids.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, a field or family is not there, or the region makes no sense.
pub fn probe<'a>(data: Data, of: impl Into<Of<'a>>, options: &ProbeOptions, work: Work) -> Result<Probe, ExploreError> {
    let of = of.into();
    let mut columns: Vec<String> = match &options.fields {
        Fields::None => Vec::new(),
        Fields::Named(names) => names.clone(),
        Fields::All => {
            let mut names: Vec<String> = Vec::new();
            for family in 0..data.families().len() {
                names.extend(data.fields(family).into_iter().map(|about| about.name));
            }
            names
        }
    };
    let mut known = std::collections::HashSet::new();
    columns.retain(|name| known.insert(name.clone()));
    let fields = columns.len();
    let in_shells = options.profile.as_ref().and_then(|profile| profile.field.clone());
    let shell_column = in_shells.as_ref().map(|name| {
        columns.iter().position(|other| other == name).unwrap_or_else(|| {
            columns.push(name.clone());
            columns.len() - 1
        })
    });
    let sums_alone = options.fields == Fields::None && options.profile.is_none();
    let wanted = Wanted { columns, velocities: options.fields != Fields::None, ..Wanted::default() };
    let query = Query::new(data, of, wanted, options.periodic)?;
    let shells = match (&options.profile, query.region()) {
        (None, _) => None,
        (Some(profile), Some(region)) => Some(Shells::new(profile, region, query.shapes.reference())?),
        (Some(_), None) => return Err(ExploreError::value("profile", "of ids", "a region with a sphere")),
    };
    let gather = Sums {
        families: data.families().len(),
        columns: query.wanted.columns.len(),
        shells,
        shell_column,
        sums_alone,
        // Around what has no centre of its own, such as particles with certain ids, distances cannot be taken before it is known.
        wraps: options.periodic.filter(|_| query.shapes.edge().is_none()),
    };
    let sums = query.ask(data, &gather, work)?;
    Ok(report(data, &query, fields, &gather, &sums, options))
}

/// What is summed up.
struct Sums {
    families: usize,
    columns: usize,
    shells: Option<Shells>,
    shell_column: Option<usize>,
    sums_alone: bool,
    /// Edge of the periodic box in which the centre of mass is yet to be found.
    wraps: Option<f64>,
}

/// Sums so far.
struct SumsPart {
    families: Vec<FamilyPart>,
    shells: Option<Filled>,
}

#[derive(Clone, Default)]
struct FamilyPart {
    count: u64,
    mass: f64,
    /// Sum of mass times offset from the reference.
    moment: DVec3,
    /// Mass that `moment` is about: all but that of whole nodes.
    placed: f64,
    /// The same mass by its places, where the reference is none.
    center: Option<CenterSums>,
    columns: Vec<Moments>,
    velocity: [Moments; 3],
    uncertain: Uncertain,
    /// By entry of the codebooks' errors: sum of the mean errors times particles, particles, largest error.
    errors: Vec<(f64, u64, f64)>,
}

impl Gather for Sums {
    type Part = SumsPart;

    fn part(&self) -> SumsPart {
        let family = FamilyPart {
            columns: vec![Moments::NONE; self.columns],
            center: self.wraps.map(|edge| CenterSums::new(Some(edge))),
            ..FamilyPart::default()
        };
        SumsPart { families: vec![family; self.families], shells: self.shells.as_ref().map(Shells::empty) }
    }

    fn take(&self, part: &mut SumsPart, batch: &Batch) {
        let Some(family) = part.families.get_mut(batch.family) else { return };
        family.uncertain.add(&batch.uncertain);
        if batch.is_empty() {
            return;
        }
        let mass: f64 = batch.mass.iter().sum();
        family.count += batch.len() as u64;
        family.mass += mass;
        family.placed += mass;
        family.moment += batch.relative.iter().zip(&batch.mass).fold(DVec3::ZERO, |sum, (at, mass)| sum + *at * *mass);
        if let Some(center) = &mut family.center {
            batch.positions.iter().zip(&batch.mass).for_each(|(&at, &mass)| center.add(at, mass));
        }
        for (moments, values) in family.columns.iter_mut().zip(&batch.columns).filter(|(_, values)| !values.is_empty())
        {
            moments.join(&Moments::of(values, &batch.mass));
        }
        for (axis, moments) in family.velocity.iter_mut().enumerate() {
            let values: Vec<f64> = batch.velocities.iter().map(|velocity| velocity[axis]).collect();
            moments.join(&Moments::of(&values, &batch.mass));
        }
        family.errors.resize(family.errors.len().max(batch.errors.len()), (0.0, 0, 0.0));
        for ((sum, count, max), error) in family.errors.iter_mut().zip(batch.errors) {
            *sum += error.mean * batch.len() as f64;
            *count += batch.len() as u64;
            *max = max.max(error.max);
        }
        if let (Some(shells), Some(filled)) = (&self.shells, &mut part.shells) {
            let values = self.shell_column.and_then(|column| batch.columns.get(column));
            shells.fill(filled, batch, values.map_or(&[], Vec::as_slice));
        }
    }

    fn take_node(&self, part: &mut SumsPart, family: usize, count: u64, mass: f64) {
        let family = &mut part.families[family];
        family.count = family.count.saturating_add(count);
        family.mass += mass;
    }

    fn takes_nodes(&self) -> bool {
        self.sums_alone
    }

    fn join(&self, whole: &mut SumsPart, next: SumsPart) -> Result<(), ExploreError> {
        for (family, next) in whole.families.iter_mut().zip(next.families) {
            family.count = family.count.saturating_add(next.count);
            family.mass += next.mass;
            family.moment += next.moment;
            family.placed += next.placed;
            if let (Some(center), Some(next)) = (&mut family.center, &next.center) {
                center.join(next);
            }
            family.columns.iter_mut().zip(&next.columns).for_each(|(a, b)| a.join(b));
            family.velocity.iter_mut().zip(&next.velocity).for_each(|(a, b)| a.join(b));
            family.uncertain.add(&next.uncertain);
            family.errors.resize(family.errors.len().max(next.errors.len()), (0.0, 0, 0.0));
            for (own, next) in family.errors.iter_mut().zip(&next.errors) {
                *own = (own.0 + next.0, own.1 + next.1, own.2.max(next.2));
            }
        }
        if let (Some(shells), Some(next)) = (&mut whole.shells, &next.shells) {
            shells.join(next);
        }
        Ok(())
    }
}

/// The sums as numbers.
fn report(data: Data, query: &Query, fields: usize, gather: &Sums, sums: &SumsPart, options: &ProbeOptions) -> Probe {
    let edge = query.shapes.edge();
    let place = |moment: DVec3, placed: f64, mass: f64, center: Option<&CenterSums>| {
        // Of nodes that were taken as a whole, nobody knows where their mass is.
        let known = placed > 0.0 && placed == mass;
        let found = center.filter(|_| known).and_then(|sums| Some(sums.finish()?.position.to_array()));
        found.or_else(|| {
            known.then(|| {
                let at = query.shapes.reference() + moment / placed;
                edge.map_or(at, |edge| at - edge * (at / edge).floor()).to_array()
            })
        })
    };
    let names = data.families();
    let families = sums.families.iter().zip(&names).enumerate();
    let families: Vec<FamilyProbe> = families
        .filter(|(_, (sums, _))| sums.count > 0 || sums.uncertain.count > 0)
        .map(|(index, (sums, (name, _)))| FamilyProbe {
            name: *name,
            count: sums.count,
            mass: sums.mass,
            center_of_mass: place(sums.moment, sums.placed, sums.mass, sums.center.as_ref()),
            velocity: velocity(&sums.velocity),
            fields: field_statistics(data, index, *name, sums, &query.wanted.columns[..fields]),
            uncertain: (!data.is_exact()).then_some(sums.uncertain),
        })
        .collect();
    let total = |of: &dyn Fn(&FamilyPart) -> f64| sums.families.iter().map(of).sum::<f64>();
    let moment = sums.families.iter().fold(DVec3::ZERO, |sum, family| sum + family.moment);
    let mass = total(&|family| family.mass);
    let center = gather.wraps.map(|edge| {
        let mut whole = CenterSums::new(Some(edge));
        sums.families.iter().filter_map(|family| family.center.as_ref()).for_each(|family| whole.join(family));
        whole
    });
    let profile = gather.shells.as_ref().zip(sums.shells.as_ref()).zip(query.region().and_then(|r| r.first_sphere()));
    Probe {
        exact: data.is_exact(),
        count: sums.families.iter().fold(0, |sum, family| sum.saturating_add(family.count)),
        mass,
        center_of_mass: place(moment, total(&|family| family.placed), mass, center.as_ref()),
        length_unit: data.length_unit().clone(),
        mass_unit: data.mass_unit().clone(),
        periodic_edge: edge,
        families,
        profile: profile.map(|((shells, filled), (center, _))| Profile {
            center: center.to_array(),
            field: options.profile.as_ref().and_then(|profile| profile.field.clone()),
            shells: shells.finish(filled),
        }),
    }
}

fn velocity(axes: &[Moments; 3]) -> Option<VelocityStatistics> {
    let mean = axes.each_ref().map(Moments::weighted_mean);
    let dispersion = axes.each_ref().map(Moments::weighted_dispersion);
    let ([Some(x), Some(y), Some(z)], [Some(dx), Some(dy), Some(dz)]) = (mean, dispersion) else { return None };
    let dispersion_1d = ((dx * dx + dy * dy + dz * dz) / 3.0).sqrt();
    Some(VelocityStatistics { mean: [x, y, z], dispersion: [dx, dy, dz], dispersion_1d })
}

/// The statistics of the fields that the family has.
fn field_statistics(
    data: Data,
    index: usize,
    family: FamilyName,
    sums: &FamilyPart,
    columns: &[String],
) -> Vec<FieldStatistics> {
    let mut all = Vec::new();
    for (name, moments) in columns.iter().zip(&sums.columns) {
        let (unit, error) = match data {
            Data::Pages(file) => {
                let Some(family) = file.metadata().families.get(index) else { continue };
                let Some((column, unit)) = column(family, name) else { continue };
                let (sum, count, max) = sums.errors.get(column.error_index()).copied().unwrap_or_default();
                let missing = family.attribute(name).map_or(0, |(_, info)| info.missing);
                let mean = if count > 0 { sum / count as f64 } else { 0.0 };
                (unit.clone(), Some(CodingError { mean, max, of_range: error_scale(family, column), missing }))
            }
            Data::Source(source) => {
                let about = source.description();
                let Some(info) = about.families.iter().find(|info| info.name == family) else { continue };
                let Some(scalar) = crate::import::Scalar::named(about, info, name) else { continue };
                (scalar.unit, None)
            }
        };
        let some = moments.count > 0;
        all.push(FieldStatistics {
            name: name.clone(),
            unit,
            count: moments.count,
            mean: moments.mean(),
            dispersion: moments.dispersion(),
            mass_weighted_mean: moments.weighted_mean(),
            mass_weighted_dispersion: moments.weighted_dispersion(),
            min: some.then_some(moments.min),
            max: some.then_some(moments.max),
            min_positive: moments.min_positive.is_finite().then_some(moments.min_positive),
            error,
        });
    }
    all
}
