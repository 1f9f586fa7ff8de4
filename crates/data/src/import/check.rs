//! Which particles can be drawn: one rule for loads, streams, rows and summaries.

use super::choice::Chosen;
use super::{FamilyInfo, ImportError, Source};
use crate::model::portable::portable;
use crate::model::{Bounds, Skipped};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Particles that are read at a time; in tests few, so that small sources have several such runs.
const CHUNK: u64 = if cfg!(test) { 1 << 12 } else { 1 << 16 };

/// `0..count` in ranges of bounded length.
pub(super) fn chunks(count: u64) -> Vec<Range<u64>> {
    (0..count).step_by(CHUNK as usize).map(|start| start..count.min(start + CHUNK)).collect()
}

/// Length of every range of [`chunks`] but the last.
pub(super) const CHUNK_LENGTH: usize = CHUNK as usize;

/// Whether a particle can be drawn with this mass, smoothing length or density.
pub(super) fn drawable(value: f32) -> bool {
    value > 0.0 && value.is_finite()
}

/// The flaws of a particle, one bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Flaws(u8);

impl Flaws {
    const POSITION: u8 = 1;
    const MASS: u8 = 2;
    const SMOOTHING: u8 = 4;

    /// Looks at one particle; what its source does not have counts as flawless.
    pub(super) fn of(position: [f64; 3], mass: Option<f32>, smoothing_length: Option<f32>) -> Flaws {
        let position = if position.iter().all(|x| x.is_finite()) { 0 } else { Flaws::POSITION };
        let mass = if mass.is_none_or(drawable) { 0 } else { Flaws::MASS };
        let smoothing = if smoothing_length.is_none_or(drawable) { 0 } else { Flaws::SMOOTHING };
        Flaws(position | mass | smoothing)
    }

    /// Whether the particle is kept.
    pub(super) fn none(self) -> bool {
        self.0 == 0
    }
}

/// How many particles are left out, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    position: u64,
    mass: u64,
    smoothing: u64,
}

portable!(LeftOut { position, mass, smoothing });

impl LeftOut {
    /// No particle.
    pub(super) const NONE: LeftOut = LeftOut { position: 0, mass: 0, smoothing: 0 };

    /// Counts one particle under its first flaw.
    pub(super) fn count(&mut self, flaws: Flaws) {
        if flaws.0 & Flaws::POSITION != 0 {
            self.position += 1;
        } else if flaws.0 & Flaws::MASS != 0 {
            self.mass += 1;
        } else if flaws.0 & Flaws::SMOOTHING != 0 {
            self.smoothing += 1;
        }
    }

    /// All counts together.
    pub fn sum(all: impl IntoIterator<Item = LeftOut>) -> LeftOut {
        all.into_iter().fold(LeftOut::NONE, |mut sum, one| {
            sum.add(&one);
            sum
        })
    }

    /// Adds the counts of another family.
    pub(super) fn add(&mut self, other: &LeftOut) {
        // Counts that were forged do not add up.
        self.position = self.position.saturating_add(other.position);
        self.mass = self.mass.saturating_add(other.mass);
        self.smoothing = self.smoothing.saturating_add(other.smoothing);
    }

    /// The counts that are not zero.
    pub fn into_skipped(self) -> Vec<Skipped> {
        let reasons = [
            ("non-finite position", self.position),
            ("mass not positive, or beyond single precision", self.mass),
            ("smoothing length not positive, or beyond single precision", self.smoothing),
        ];
        let counted = reasons.into_iter().filter(|(_, count)| *count > 0);
        counted.map(|(reason, count)| Skipped { reason: reason.into(), count }).collect()
    }
}

/// What one pass over positions, masses and smoothing lengths of a family shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Survey {
    /// Mass of the particles that are kept; their number where the family has no masses.
    pub mass: f64,
    /// The box around the particles that are kept; empty if there are none.
    pub bounds: Bounds,
    /// Particles left out.
    pub left_out: LeftOut,
}

impl Survey {
    const NOTHING: Survey = Survey { mass: 0.0, bounds: Bounds::EMPTY, left_out: LeftOut::NONE };

    /// Reads the family once, in parallel; the sums do not depend on the number of threads.
    pub(super) fn of(
        source: &dyn Source,
        family: usize,
        info: &FamilyInfo,
        chosen: &Chosen,
    ) -> Result<Survey, ImportError> {
        let surveys: Result<Vec<_>, ImportError> = chunks(info.count)
            .into_par_iter()
            .map_init(
                || [Vec::new(), Vec::new(), Vec::new()],
                |[positions, masses, lengths]: &mut [Vec<f64>; 3], range| {
                    let length = (range.end - range.start) as usize;
                    read(source, family, Some(chosen.position), range.clone(), 3 * length, positions)?;
                    read(source, family, chosen.mass, range.clone(), length, masses)?;
                    read(source, family, chosen.smoothing_length, range, length, lengths)?;
                    let mut survey = Survey::NOTHING;
                    for (index, at) in positions.as_chunks::<3>().0.iter().enumerate() {
                        let mass = masses.get(index).copied();
                        let length = lengths.get(index).map(|&h| h as f32);
                        let flaws = Flaws::of(*at, mass.map(|m| m as f32), length);
                        survey.left_out.count(flaws);
                        if flaws.none() {
                            survey.mass += mass.unwrap_or(1.0);
                            survey.bounds = survey.bounds.with(DVec3::from_array(*at));
                        }
                    }
                    Ok(survey)
                },
            )
            .collect();
        Ok(surveys?.iter().fold(Survey::NOTHING, |mut all, part| {
            all.mass += part.mass;
            all.bounds = all.bounds.union(part.bounds);
            all.left_out.add(&part.left_out);
            all
        }))
    }
}

/// Reads a range of a field into `out`, which becomes `values` long; empty when there is no such field.
fn read(
    source: &dyn Source,
    family: usize,
    field: Option<usize>,
    range: Range<u64>,
    values: usize,
    out: &mut Vec<f64>,
) -> Result<(), ImportError> {
    match field {
        Some(field) => {
            out.resize(values, 0.0);
            source.read(family, field, range, out)
        }
        None => {
            out.clear();
            Ok(())
        }
    }
}
