//! Compares the tracks of a run with the snapshots that it was built from: every particle at every step.

use super::BuildError;
use crate::hierarchy::spacetime::Interpolation;
use crate::import::{FieldKind, LoadOptions, Source, StateChunk, find_source, open, streams};
use crate::model::{FamilyName, Moment, ParticleStream, Progress};
use crate::store::StoreError;
use crate::store::run::{RunFile, RunSnapshot, Step};
use std::sync::Arc;

/// How much farther than told a place may be, for rounding in the comparison itself.
const SLACK: f64 = 1e-9;

/// A particle to be compared.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
struct Placed {
    id: u64,
    position: [f64; 3],
}

/// Compares every particle of every step with its snapshot: who is there, and that nobody is farther away than the run says. Particles
/// of one step are held in memory at a time. Returns how many were compared.
///
/// # Errors
/// Where the run or a snapshot cannot be read, and for the first particle that is not where it should be.
pub fn compare_with_sources(run: &Arc<RunFile>, progress: &dyn Progress) -> Result<u64, BuildError> {
    let layout = run.tracks()?;
    let mut compared = 0;
    for (number, step) in run.directory().steps.iter().enumerate() {
        progress.begin(&format!("step {number}: comparing"), step.particles);
        let own = run.at(Moment { step: number, u: 0.0 }, Interpolation::Auto)?;
        let there = find_source(&step.source, run.path(), step.source_bytes);
        let source = open(there.as_deref().unwrap_or(&step.source))?;
        let wrong = |what: String| {
            BuildError::Store(StoreError::Damaged {
                path: run.path().to_owned(),
                place: format!("step {number}"),
                expected: what,
            })
        };
        for (index, family) in layout.families.iter().enumerate() {
            let stated = |interval: usize| {
                let interval = run.directory().intervals.get(interval);
                interval.map_or(0.0, |interval| interval.families[index].matches.position_error[1])
            };
            let most = stated(number).max(number.checked_sub(1).map_or(0.0, stated)) * (1.0 + SLACK);
            let mut there = of_source(source.as_ref(), family.name, !family.has_ids, step)?;
            let mut here = of_run(&own, family.name)?;
            let name = family.name;
            if here.len() != there.len() {
                return Err(wrong(format!(
                    "{} particles of {name} as in {}, found {}",
                    there.len(),
                    step.source.display(),
                    here.len()
                )));
            }
            let order = |a: &Placed, b: &Placed| {
                a.id.cmp(&b.id).then(a.position.partial_cmp(&b.position).unwrap_or(std::cmp::Ordering::Equal))
            };
            there.sort_unstable_by(order);
            here.sort_unstable_by(order);
            compared += here.len() as u64;
            progress.advance(here.len() as u64);
            let mut at = 0;
            while at < there.len() {
                let id = there[at].id;
                let end = at + there[at..].iter().take_while(|other| other.id == id).count();
                let (theirs, mine) = (&there[at..end], &here[at..end]);
                let far = theirs.iter().find(|wanted| {
                    !mine.iter().any(|found| {
                        found.id == id && distance(found.position, wanted.position, layout.box_size) <= most
                    })
                });
                if let Some(Placed { id, position: [x, y, z] }) = far {
                    return Err(wrong(format!(
                        "particle {id} of {name} within {most:.3e} of {x}, {y}, {z} as in {}",
                        step.source.display()
                    )));
                }
                at = end;
            }
        }
    }
    Ok(compared)
}

/// How far apart two places are; of a periodic box, their nearest images: what is rounded over a face is at the other one.
fn distance(a: [f64; 3], b: [f64; 3], edge: Option<f64>) -> f64 {
    let along = |axis: usize| {
        let difference = a[axis] - b[axis];
        edge.map_or(difference, |edge| difference - edge * (difference / edge).round())
    };
    (0..3).map(|axis| along(axis).powi(2)).sum::<f64>().sqrt()
}

/// The particles of a snapshot that a build keeps, in the run's units.
fn of_source(source: &dyn Source, family: FamilyName, by_row: bool, step: &Step) -> Result<Vec<Placed>, BuildError> {
    let has_family = source.description().families.iter().any(|info| info.name == family);
    if !has_family {
        return Ok(Vec::new());
    }
    let options = LoadOptions { families: vec![family], ..LoadOptions::default() };
    let streams = streams(source, &options, &|_| Vec::new())?;
    let mut all = Vec::new();
    let mut chunk = StateChunk::default();
    for stream in &streams.families {
        for number in 0..stream.chunks() {
            stream.read_states(number, by_row, &mut chunk)?;
            let positions = chunk.chunk.positions.iter().map(|position| position.map(|x| x * step.length_scale));
            all.extend(chunk.ids.iter().zip(positions).map(|(id, position)| Placed { id: *id, position }));
        }
    }
    Ok(all)
}

/// The particles that the run has.
fn of_run(source: &RunSnapshot, family: FamilyName) -> Result<Vec<Placed>, BuildError> {
    let families = &source.description().families;
    let Some(index) = families.iter().position(|info| info.name == family) else { return Ok(Vec::new()) };
    let info = &families[index];
    let (Some(position), count) = (info.find(FieldKind::Position), info.count) else { return Ok(Vec::new()) };
    let mut positions = vec![0.0; 3 * count as usize];
    source.read(index, position, 0..count, &mut positions)?;
    let positions = positions.as_chunks::<3>().0;
    Ok(source.ids(index)?.iter().zip(positions).map(|(id, position)| Placed { id: *id, position: *position }).collect())
}
