//! Questions: whose members are looked for, and what of them is wanted. A question is the same for page files and sources.

use super::batch::{Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::ids::IdSet;
use super::region::Region;
use super::selection::Members;
use super::shape::Shapes;

/// Whose particles are looked for.
#[derive(Clone, Copy, Debug)]
pub enum Of<'a> {
    /// Those in a region.
    Region(&'a Region),
    /// Those with these ids; only a source can tell.
    Ids(&'a IdSet),
    /// Those that were in a region of a run at another time; only the run can tell ([`super::Following`]).
    Tracked(&'a Region),
}

impl<'a> From<&'a Members> for Of<'a> {
    fn from(members: &'a Members) -> Of<'a> {
        match members {
            Members::Region(region) => Of::Region(region),
            Members::Ids(ids) => Of::Ids(ids),
            Members::Tracked { region, .. } => Of::Tracked(region),
        }
    }
}

impl<'a> From<&'a Region> for Of<'a> {
    fn from(region: &'a Region) -> Of<'a> {
        Of::Region(region)
    }
}

impl<'a> From<&'a IdSet> for Of<'a> {
    fn from(ids: &'a IdSet) -> Of<'a> {
        Of::Ids(ids)
    }
}

/// What is wanted of the members.
#[derive(Clone, Debug, Default)]
pub(super) struct Wanted {
    /// Scalars by name, which not every family must have.
    pub columns: Vec<String>,
    /// Velocities, where there are any.
    pub velocities: bool,
    /// Ids; an error where a family has none, unless `rows`.
    pub ids: bool,
    /// Whole rows of the source: ids where there are any, and every field.
    pub rows: bool,
    /// The fields of these rows that are read; the others are left empty. Every field where it is `None`.
    pub only: Option<Vec<String>>,
}

/// A question that is ready to be asked.
pub(super) struct Query<'a> {
    pub of: Of<'a>,
    pub shapes: Shapes,
    pub wanted: Wanted,
}

impl<'a> Query<'a> {
    /// A question to `data`, with distances around a periodic box of edge `periodic`.
    pub(super) fn new(
        data: Data,
        of: Of<'a>,
        wanted: Wanted,
        periodic: Option<f64>,
    ) -> Result<Query<'a>, ExploreError> {
        let whole = Region::whole();
        let region = match of {
            Of::Region(region) => region,
            Of::Ids(_) => &whole,
            Of::Tracked(_) => {
                let expected = "a run with tracks: deepfield build of several snapshots makes one";
                return Err(ExploreError::missing(data.path(), "who was in a region at another time", expected));
            }
        };
        let shapes = Shapes::new(region, periodic)?;
        for range in &region.ranges {
            if data.unit_of(&range.field).is_none() {
                return Err(data.no_field(&range.field));
            }
        }
        if let Some(name) = wanted.columns.iter().find(|name| data.unit_of(name).is_none()) {
            return Err(data.no_field(name));
        }
        let families = data.families();
        if let Some(family) = region.families.iter().find(|name| !families.iter().any(|(other, _)| other == *name)) {
            let names: Vec<&str> = families.iter().map(|(name, _)| name.as_str()).collect();
            let expected = format!("one of {}", names.join(", "));
            return Err(ExploreError::missing(data.path(), format!("family {family}"), expected));
        }
        Ok(Query { of, shapes, wanted })
    }

    /// The region's value ranges; none for ids.
    pub(super) fn region(&self) -> Option<&'a Region> {
        match self.of {
            Of::Region(region) => Some(region),
            Of::Ids(_) | Of::Tracked(_) => None,
        }
    }

    /// Asks.
    pub(super) fn ask<G: Gather>(&self, data: Data, gather: &G, work: Work) -> Result<G::Part, ExploreError> {
        match data {
            Data::Pages(file) => super::paged::walk(file, self, gather, work),
            Data::Source(source) => super::sourced::walk(source, self, gather, work),
        }
    }
}
