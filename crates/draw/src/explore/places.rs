//! Particles of a page file by the places that they have in their source: how a selection by ids, which page files do not hold, is
//! shown.
//!
//! A leaf holds each particle's place rounded to the centre of a cell, so a particle is marked if the place of a selected one lies in
//! that cell; the same for merged particles and the cells that they were merged in. Where cells hold more than one particle, more than
//! the selected ones are marked.

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::highlight::{Highlighter, Marked};
use super::query::{Of, Query, Wanted};
use crate::import::Source;
use crate::model::FamilyName;
use crate::store::{FamilyMetadata, Located, Metadata, Page};
use glam::DVec3;
use std::sync::Arc;

/// Where selected particles are, by family.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places {
    families: Vec<(FamilyName, Vec<DVec3>)>,
}

impl Places {
    /// The places of a selection in its source; 24 bytes of memory for each particle.
    ///
    /// # Errors
    /// [`ExploreError`] when the source cannot be read.
    pub fn of<'a>(
        source: &dyn Source,
        of: impl Into<Of<'a>>,
        periodic: Option<f64>,
        work: Work,
    ) -> Result<Places, ExploreError> {
        let families: Vec<FamilyName> = source.description().families.iter().map(|family| family.name).collect();
        let found = collect(source, of.into(), periodic, |_, at| Some(at), work)?;
        Ok(Places { families: families.into_iter().zip(found).collect() })
    }

    /// Places that are known, by family.
    pub fn new(families: Vec<(FamilyName, Vec<DVec3>)>) -> Places {
        Places { families }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.families.iter().map(|(_, places)| places.len()).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The places of a family.
    pub fn family(&self, family: FamilyName) -> &[DVec3] {
        self.families.iter().find(|(name, _)| *name == family).map_or(&[], |(_, places)| places)
    }
}

/// What `keep` makes of the position of each particle of a selection, by family of the source; `keep` is told the family's index.
fn collect<T: Send + Clone>(
    source: &dyn Source,
    of: Of,
    periodic: Option<f64>,
    keep: impl Fn(usize, DVec3) -> Option<T> + Sync,
    work: Work,
) -> Result<Vec<Vec<T>>, ExploreError> {
    let data = Data::Source(source);
    let query = Query::new(data, of, Wanted::default(), periodic)?;
    query.ask(data, &Collecting { families: source.description().families.len(), keep }, work)
}

struct Collecting<K> {
    families: usize,
    keep: K,
}

impl<T: Send + Clone, K: Fn(usize, DVec3) -> Option<T> + Sync> Gather for Collecting<K> {
    type Part = Vec<Vec<T>>;

    fn part(&self) -> Vec<Vec<T>> {
        vec![Vec::new(); self.families]
    }

    fn take(&self, part: &mut Vec<Vec<T>>, batch: &Batch) {
        part[batch.family].extend(batch.positions.iter().filter_map(|&at| (self.keep)(batch.family, at)));
    }

    fn join(&self, whole: &mut Vec<Vec<T>>, next: Vec<Vec<T>>) -> Result<(), ExploreError> {
        whole.iter_mut().zip(next).for_each(|(whole, next)| whole.extend(next));
        Ok(())
    }
}

/// A selection found in the source of a page file, ready to be shown; 16 bytes of memory for each particle.
#[derive(Debug)]
pub struct FoundIds {
    /// What marks its particles in the page file's nodes.
    pub highlighter: Arc<Highlighter>,
    /// How many particles of the source it has.
    pub count: u64,
}

impl FoundIds {
    /// Looks a selection up in the source of the page file that `metadata` describes. Particles of families that the page file
    /// does not have are left out.
    ///
    /// # Errors
    /// [`ExploreError`] when the source cannot be read, or has no ids where they are asked for.
    pub fn of<'a>(
        source: &dyn Source,
        of: impl Into<Of<'a>>,
        metadata: &Metadata,
        work: Work,
    ) -> Result<FoundIds, ExploreError> {
        let own: Vec<Option<&FamilyMetadata>> = source
            .description()
            .families
            .iter()
            .map(|family| metadata.family(family.name).map(|(_, family)| family))
            .collect();
        let place = |family: usize, at: DVec3| Some((*own.get(family)?)?.place(at));
        let mut found = collect(source, of.into(), None, place, work)?;
        let count = found.iter().map(|places| places.len() as u64).sum();
        let of_family = |name: FamilyName| {
            let index = source.description().families.iter().position(|family| family.name == name);
            Located::new(index.map_or_else(Vec::new, |index| std::mem::take(&mut found[index])))
        };
        let families = metadata.families.iter().map(|family| family.name).map(of_family).collect();
        Ok(FoundIds { highlighter: Arc::new(Highlighter::of_marks(PlaceMarks { families })), count })
    }
}

/// Places, ready to be held against nodes.
#[derive(Debug)]
pub(super) struct PlaceMarks {
    /// By family of the page file.
    families: Vec<Located>,
}

impl PlaceMarks {
    pub(super) fn new(places: &Places, metadata: &Metadata) -> PlaceMarks {
        let families = metadata.families.iter().map(|family| {
            let places = places.family(family.name).iter();
            Located::new(places.map(|&at| family.place(at)).collect())
        });
        PlaceMarks { families: families.collect() }
    }

    /// As [`super::Highlighter::mark`].
    pub(super) fn mark(&self, page: &Page, node: usize, bits: &mut Vec<u64>) -> Marked {
        let (Some(family), Some(record)) = (self.families.get(page.family as usize), page.nodes.get(node)) else {
            return Marked::None;
        };
        if record.particles == 0 {
            return Marked::None;
        }
        let count = family.mark(page, node, bits);
        match count {
            0 => Marked::None,
            count if count == record.particles => Marked::All,
            count => Marked::Some(count),
        }
    }
}
