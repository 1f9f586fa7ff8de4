//! From a particle of a page file to its row in the source: the same particle at full precision, with its id.
//!
//! A leaf knows where its particles are to within its own quantisation. So the source is searched for the rows within that reach of
//! the particle's place; the nearest is the one. In dense data several may be that near: how many is told.

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::ids::IdSet;
use super::paged::LeafFrame;
use super::query::{Of, Query, Wanted};
use super::region::Region;
use crate::import::{FieldKind, Source};
use crate::model::{FamilyName, Unit};
use crate::store::{Metadata, Page};
use glam::DVec3;
use serde::Serialize;

/// A particle of a page file, with all that the file knows of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PageParticle {
    /// Its family.
    pub family: FamilyName,
    /// Where it is, world units.
    pub position: [f64; 3],
    /// How far each coordinate may be from the source's; 0 for merged particles, whose place is a mean.
    pub reach: f64,
    /// Whether it stands for several particles of the source.
    pub merged: bool,
    /// Name, unit and value of mass, density, smoothing length and each attribute, as coded.
    pub fields: Vec<(String, Unit, f64)>,
}

impl PageParticle {
    /// Particle `particle` of node `node` of a page; `None` if there is no such.
    pub fn of(metadata: &Metadata, page: &Page, node: usize, particle: usize) -> Option<PageParticle> {
        let family = metadata.families.get(page.family as usize)?;
        let record = page.nodes.get(node)?;
        let particles = page.block(node, family, record.start())?;
        let code = particles.entry(particle)?;
        let codebook = particles.table()?;
        let place = LeafFrame::of(record);
        let merged = !record.is_leaf();
        let columns = [&codebook.mass, &codebook.density, &codebook.smoothing_length];
        let about = family.quantities.iter().chain(&family.attributes);
        let fields = about
            .zip(columns.into_iter().chain(&codebook.attributes))
            .filter_map(|(info, column)| Some((info.name.clone(), info.unit.clone(), f64::from(*column.get(code)?))));
        Some(PageParticle {
            family: family.name,
            position: particles.position(particle).to_array(),
            reach: if merged { 0.0 } else { particles.rounding(particle) + place.ulp },
            merged,
            fields: fields.collect(),
        })
    }
}

/// A row of a source.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identified {
    /// Its family.
    pub family: FamilyName,
    /// Its number in the family, from 0, all files together.
    pub row: u64,
    /// Its id, where the source has ids.
    pub id: Option<u64>,
    /// Its position.
    pub position: [f64; 3],
    /// From the place that was asked about.
    pub distance: f64,
    /// How many rows are within reach, this one included.
    pub candidates: u64,
    /// Every field with its values, in the source's own precision.
    pub fields: Vec<SourceValue>,
}

/// What a source says of one particle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SourceValue {
    /// The field's name.
    pub name: String,
    /// The source's own name for it.
    pub stored_as: String,
    /// Its unit.
    pub unit: Unit,
    /// Its values, one for each component.
    pub values: Vec<f64>,
}

/// The row of `family` nearest to `position`, of those whose coordinates are each within `reach` of it; `None` if there is none.
///
/// # Errors
/// [`ExploreError`] when the source cannot be read or has no such family.
pub fn identify(
    source: &dyn Source,
    family: FamilyName,
    position: DVec3,
    reach: f64,
    work: Work,
) -> Result<Option<Identified>, ExploreError> {
    let region = Region::cuboid(position - reach, position + reach).with_family(family);
    Ok(nearest(source, Of::Region(&region), position, work)?.best)
}

/// The first row with that id; `None` if there is none.
///
/// # Errors
/// [`ExploreError`] when the source cannot be read or has no ids.
pub fn find_id(source: &dyn Source, id: u64, work: Work) -> Result<Option<Identified>, ExploreError> {
    let ids = IdSet::new(vec![id]);
    Ok(nearest(source, Of::Ids(&ids), DVec3::ZERO, work)?.best)
}

fn nearest(source: &dyn Source, of: Of, position: DVec3, work: Work) -> Result<Found, ExploreError> {
    let data = Data::Source(source);
    let query = Query::new(data, of, Wanted { rows: true, ..Wanted::default() }, None)?;
    query.ask(data, &Nearest { source, position, by_id: matches!(of, Of::Ids(_)) }, work)
}

struct Nearest<'a> {
    source: &'a dyn Source,
    position: DVec3,
    by_id: bool,
}

#[derive(Default)]
struct Found {
    best: Option<Identified>,
}

impl Gather for Nearest<'_> {
    type Part = Found;

    fn part(&self) -> Found {
        Found::default()
    }

    fn take(&self, part: &mut Found, batch: &Batch) {
        let distance = |i: usize| if self.by_id { 0.0 } else { batch.positions[i].distance(self.position) };
        let Some(i) = (0..batch.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b))) else { return };
        let info = &self.source.description().families[batch.family];
        let scalars = info.fields.iter().zip(&batch.rows).filter(|(field, _)| field.kind != FieldKind::Id);
        let fields = scalars.map(|(field, values)| SourceValue {
            name: field.name.clone(),
            stored_as: field.stored_as.clone(),
            unit: field.unit.clone(),
            values: values.get(i * field.components..(i + 1) * field.components).unwrap_or_default().to_vec(),
        });
        let found = Identified {
            family: info.name,
            row: batch.keys[i],
            id: batch.ids.get(i).copied(),
            position: batch.positions[i].to_array(),
            distance: distance(i),
            candidates: batch.len() as u64,
            fields: fields.collect(),
        };
        // Runs of other families cannot come here but for ids, of which the first counts.
        self.keep(part, found);
    }

    fn join(&self, whole: &mut Found, next: Found) -> Result<(), ExploreError> {
        if let Some(next) = next.best {
            self.keep(whole, next);
        }
        Ok(())
    }
}

impl Nearest<'_> {
    fn keep(&self, part: &mut Found, next: Identified) {
        let Some(best) = &mut part.best else {
            part.best = Some(next);
            return;
        };
        let candidates = best.candidates + next.candidates;
        if next.distance < best.distance {
            *best = next;
        }
        best.candidates = candidates;
    }
}

/// The ids of a selection, sorted.
///
/// # Errors
/// [`ExploreError`] when the source cannot be read or has no ids.
pub fn ids_of<'a>(
    source: &dyn Source,
    of: impl Into<Of<'a>>,
    periodic: Option<f64>,
    work: Work,
) -> Result<IdSet, ExploreError> {
    let data = Data::Source(source);
    let query = Query::new(data, of.into(), Wanted { ids: true, ..Wanted::default() }, periodic)?;
    Ok(IdSet::new(query.ask(data, &Listing, work)?))
}

struct Listing;

impl Gather for Listing {
    type Part = Vec<u64>;

    fn part(&self) -> Vec<u64> {
        Vec::new()
    }

    fn take(&self, part: &mut Vec<u64>, batch: &Batch) {
        part.extend_from_slice(&batch.ids);
    }

    fn join(&self, whole: &mut Vec<u64>, next: Vec<u64>) -> Result<(), ExploreError> {
        whole.extend(next);
        Ok(())
    }
}
