//! Radial profiles: what is in shells around a centre, and how much of it a page file is not certain of.

use super::batch::{Batch, Gather, Uncertain, Work};
use super::coded::{Coded, add, mass_errors, missing_values};
use super::data::Data;
use super::error::ExploreError;
use super::profile::{Filled, ProfileOptions, Shell, Shells};
use super::query::{Of, Query, Wanted};
use super::region::Shape;
use super::selection::Members;
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
