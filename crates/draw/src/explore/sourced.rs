//! Questions to a source: every row is looked at, chunk by chunk, in parallel. Positions are read first; what else is needed is
//! read of chunks alone that have a particle in the region.

use super::batch::{Batch, Gather, Work};
use super::data::scalars;
use super::error::ExploreError;
use super::query::{Of, Query};
use super::region::ValueRange;
use crate::import::{FamilyRows, FieldKind, ImportError, Scalar, Source};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Chunks of a thread that are in memory at once.
const AHEAD: usize = 4;

/// Asks a source.
pub(super) fn walk<G: Gather>(
    source: &dyn Source,
    query: &Query,
    gather: &G,
    work: Work,
) -> Result<G::Part, ExploreError> {
    let about = source.description();
    let mut families = Vec::new();
    for (index, info) in about.families.iter().enumerate() {
        let ranges = query.region().map_or(&[][..], |region| &region.ranges);
        let lacks = |range: &ValueRange| Scalar::named(about, info, &range.field).is_none();
        if query.region().is_some_and(|region| region.leaves_out(info.name)) || ranges.iter().any(lacks) {
            continue;
        }
        let rows = FamilyRows::new(source, index)?;
        if !rows.has_ids() && (matches!(query.of, Of::Ids(_)) || query.wanted.ids && !query.wanted.rows) {
            // Another family may have some.
            if about.families.iter().any(|info| info.find(FieldKind::Id).is_some()) {
                continue;
            }
            return Err(ExploreError::missing(&about.path, format!("ids of {}", info.name), "particle ids"));
        }
        families.push(FamilyQuery {
            query,
            index,
            columns: scalars(source, info, &query.wanted.columns),
            ranges: ranges
                .iter()
                .filter_map(|range| Some((range.clone(), Scalar::named(about, info, &range.field)?)))
                .collect(),
            velocity: info.find(FieldKind::Velocity).filter(|_| query.wanted.velocities),
            rows,
        });
    }
    let total = families.iter().map(|family| family.rows.info().count).sum();
    work.progress.begin("reading particles", total);
    let mut whole = gather.part();
    for family in &families {
        for wave in family.rows.ranges().chunks(AHEAD * rayon::current_num_threads()) {
            work.go_on()?;
            let parts: Vec<Result<G::Part, ExploreError>> = wave
                .par_iter()
                .map_init(Scratch::default, |scratch, range| {
                    work.go_on()?;
                    let mut part = gather.part();
                    family.chunk(range.clone(), scratch)?;
                    if !scratch.batch.is_empty() {
                        gather.take(&mut part, &scratch.batch);
                    }
                    work.progress.advance(range.end - range.start);
                    Ok(part)
                })
                .collect();
            for part in parts {
                gather.join(&mut whole, part?)?;
            }
        }
    }
    Ok(whole)
}

/// A question to one family.
struct FamilyQuery<'a> {
    query: &'a Query<'a>,
    index: usize,
    rows: FamilyRows<'a>,
    columns: Vec<Option<Scalar>>,
    ranges: Vec<(ValueRange, Scalar)>,
    velocity: Option<usize>,
}

/// Room to work in, kept from chunk to chunk.
#[derive(Default)]
struct Scratch {
    positions: Vec<[f64; 3]>,
    ids: Vec<u64>,
    rows: Vec<u32>,
    mass: Vec<f64>,
    buffer: Vec<f64>,
    values: Vec<f64>,
    batch: Batch<'static>,
}

impl FamilyQuery<'_> {
    /// Fills the batch with the members in a range of rows.
    fn chunk(&self, range: Range<u64>, scratch: &mut Scratch) -> Result<(), ImportError> {
        let Scratch { positions, ids, rows, mass, buffer, values, batch } = scratch;
        let Query { of, shapes, wanted } = self.query;
        batch.clear(self.columns.len());
        batch.family = self.index;
        rows.clear();
        let count = (range.end - range.start) as usize;
        if let Of::Ids(set) = of {
            self.rows.ids(range.clone(), ids)?;
            rows.extend((0..).zip(&*ids).filter(|(_, id)| set.contains(**id)).map(|(row, _)| row));
            if rows.is_empty() {
                return Ok(());
            }
        }
        self.rows.positions(range.clone(), positions)?;
        if matches!(of, Of::Region(_)) {
            let inside = |at: &[f64; 3]| shapes.contains(DVec3::from_array(*at));
            match shapes.are_everywhere() {
                true => rows.extend(0..count as u32),
                false => rows.extend((0..).zip(&*positions).filter(|(_, at)| inside(at)).map(|(row, _)| row)),
            }
            if rows.is_empty() {
                return Ok(());
            }
        }
        self.rows.masses(range.clone(), positions, rows, mass)?;
        for (limits, scalar) in &self.ranges {
            self.rows.scalar(scalar, range.clone(), rows, buffer, values)?;
            let mut values = values.iter();
            rows.retain(|_| values.next().is_some_and(|&value| limits.contains(value)));
        }
        if rows.is_empty() {
            return Ok(());
        }
        batch.positions.extend(rows.iter().map(|&row| DVec3::from_array(positions[row as usize])));
        batch.relative.extend(batch.positions.iter().map(|&at| shapes.relative(at)));
        batch.mass.extend(rows.iter().map(|&row| mass[row as usize]));
        batch.keys.extend(rows.iter().map(|&row| range.start + u64::from(row)));
        for (scalar, out) in self.columns.iter().zip(&mut batch.columns) {
            if let Some(scalar) = scalar {
                self.rows.scalar(scalar, range.clone(), rows, buffer, out)?;
            }
        }
        if let Some(field) = self.velocity {
            self.rows.vector(field, range.clone(), rows, buffer, values)?;
            batch.velocities.extend(values.as_chunks::<3>().0.iter().map(|&v| DVec3::from_array(v)));
        }
        if (wanted.ids || wanted.rows) && self.rows.has_ids() {
            if !matches!(of, Of::Ids(_)) {
                self.rows.ids(range.clone(), ids)?;
            }
            batch.ids.extend(rows.iter().map(|&row| ids[row as usize]));
        }
        if wanted.rows {
            for (field, info) in self.rows.info().fields.iter().enumerate() {
                let mut out = Vec::new();
                let is_wanted = wanted.only.as_ref().is_none_or(|only| only.contains(&info.name));
                if info.kind != FieldKind::Id && is_wanted {
                    self.rows.vector(field, range.clone(), rows, buffer, &mut out)?;
                }
                batch.rows.push(out);
            }
        }
        Ok(())
    }
}
