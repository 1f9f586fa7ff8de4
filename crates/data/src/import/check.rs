//! Which particles can be drawn: one rule for [`super::load`] and [`super::summarize`].

use super::{FamilyInfo, FieldKind, ImportError, Source};
use crate::model::{Bounds, Skipped};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Particles that are read at a time.
const CHUNK: u64 = 1 << 16;

/// `0..count` in ranges of bounded length.
pub(super) fn chunks(count: u64) -> Vec<Range<u64>> {
    (0..count).step_by(CHUNK as usize).map(|start| start..count.min(start + CHUNK)).collect()
}

/// Length of every range of [`chunks`] but the last.
pub(super) const CHUNK_LENGTH: usize = CHUNK as usize;

/// The flaws of a particle, one bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Flaws(u8);

impl Flaws {
    const POSITION: u8 = 1;
    const MASS: u8 = 2;
    const SMOOTHING: u8 = 4;
    const KINDS: usize = 8;

    /// Looks at one particle; what its source does not have counts as flawless.
    pub(super) fn of(position: [f64; 3], mass: Option<f32>, smoothing_length: Option<f32>) -> Flaws {
        let drawable = |value: Option<f32>| value.is_none_or(|value| value > 0.0 && value.is_finite());
        let position = if position.iter().all(|x| x.is_finite()) { 0 } else { Flaws::POSITION };
        let mass = if drawable(mass) { 0 } else { Flaws::MASS };
        let smoothing = if drawable(smoothing_length) { 0 } else { Flaws::SMOOTHING };
        Flaws(position | mass | smoothing)
    }

    /// Whether the particle is kept.
    pub(super) fn none(self) -> bool {
        self.0 == 0
    }
}

/// How many particles are left out, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LeftOut {
    position: u64,
    mass: u64,
    smoothing: u64,
}

impl LeftOut {
    /// Counts one particle under its first flaw.
    pub(super) fn count(&mut self, flaws: Flaws, particles: u64) {
        if flaws.0 & Flaws::POSITION != 0 {
            self.position += particles;
        } else if flaws.0 & Flaws::MASS != 0 {
            self.mass += particles;
        } else if flaws.0 & Flaws::SMOOTHING != 0 {
            self.smoothing += particles;
        }
    }

    /// Adds the counts of another family.
    pub(super) fn add(&mut self, other: &LeftOut) {
        self.position += other.position;
        self.mass += other.mass;
        self.smoothing += other.smoothing;
    }

    /// The counts that are not zero.
    pub(super) fn into_skipped(self) -> Vec<Skipped> {
        let reasons = [
            ("non-finite position", self.position),
            ("mass not positive", self.mass),
            ("smoothing length not positive", self.smoothing),
        ];
        let counted = reasons.into_iter().filter(|(_, count)| *count > 0);
        counted.map(|(reason, count)| Skipped { reason: reason.into(), count }).collect()
    }
}

/// What one pass over positions, masses and smoothing lengths of a family shows.
#[derive(Clone, Debug)]
pub(super) struct Survey {
    /// Particles, mass and box by kind of flaw.
    tally: [Tally; Flaws::KINDS],
    has_mass: bool,
    has_smoothing: bool,
}

#[derive(Clone, Copy, Debug)]
struct Tally {
    particles: u64,
    mass: f64,
    bounds: Bounds,
}

impl Survey {
    /// Reads the family once, in parallel; the sums do not depend on the number of threads.
    pub(super) fn of(source: &dyn Source, family: usize, info: &FamilyInfo) -> Result<Survey, ImportError> {
        let nothing = [Tally { particles: 0, mass: 0.0, bounds: Bounds::EMPTY }; Flaws::KINDS];
        let position = info.find(FieldKind::Position);
        let mass = info.find(FieldKind::Mass);
        let smoothing = info.find(FieldKind::SmoothingLength);
        let tallies: Result<Vec<_>, ImportError> = chunks(info.count)
            .into_par_iter()
            .map_init(
                || [Vec::new(), Vec::new(), Vec::new()],
                |[positions, masses, lengths]: &mut [Vec<f64>; 3], range| {
                    let length = (range.end - range.start) as usize;
                    read(source, family, position, range.clone(), 3 * length, positions)?;
                    read(source, family, mass, range.clone(), length, masses)?;
                    read(source, family, smoothing, range, length, lengths)?;
                    let mut tally = nothing;
                    for (index, at) in positions.as_chunks::<3>().0.iter().enumerate() {
                        let mass = masses.get(index).copied();
                        let length = lengths.get(index).copied();
                        let flaws = Flaws::of(*at, mass.map(|m| m as f32), length.map(|h| h as f32));
                        let kind = &mut tally[flaws.0 as usize];
                        kind.particles += 1;
                        kind.mass += mass.unwrap_or(1.0);
                        kind.bounds = kind.bounds.with(DVec3::from_array(*at));
                    }
                    Ok(tally)
                },
            )
            .collect();
        let tally = tallies?.iter().fold(nothing, |mut all, chunk| {
            for (sum, part) in all.iter_mut().zip(chunk) {
                sum.particles += part.particles;
                sum.mass += part.mass;
                sum.bounds = sum.bounds.union(part.bounds);
            }
            all
        });
        Ok(Survey { tally, has_mass: mass.is_some(), has_smoothing: smoothing.is_some() })
    }

    fn particles_with(&self, flaw: u8) -> u64 {
        (0..Flaws::KINDS).filter(|kind| kind & flaw as usize != 0).map(|kind| self.tally[kind].particles).sum()
    }

    fn particles(&self) -> u64 {
        self.tally.iter().map(|tally| tally.particles).sum()
    }

    /// Whether the family has masses: a field of which at least one value is positive.
    pub(super) fn mass_is_usable(&self) -> bool {
        self.has_mass && self.particles_with(Flaws::MASS) < self.particles()
    }

    /// Whether the family has smoothing lengths: a field of which at least one value is positive.
    pub(super) fn smoothing_is_usable(&self) -> bool {
        self.has_smoothing && self.particles_with(Flaws::SMOOTHING) < self.particles()
    }

    /// The kinds of flaws that lead to a particle being left out, with their tallies.
    fn judged(&self) -> impl Iterator<Item = (Flaws, &Tally)> {
        let ignored = if self.mass_is_usable() { 0 } else { Flaws::MASS }
            | if self.smoothing_is_usable() { 0 } else { Flaws::SMOOTHING };
        self.tally.iter().enumerate().map(move |(kind, tally)| (Flaws(kind as u8 & !ignored), tally))
    }

    /// Particles left out.
    pub(super) fn left_out(&self) -> LeftOut {
        let mut left_out = LeftOut::default();
        self.judged().for_each(|(flaws, tally)| left_out.count(flaws, tally.particles));
        left_out
    }

    /// Mass of the particles that are kept; their number where the family has no masses.
    pub(super) fn mass(&self) -> f64 {
        let kept = self.judged().filter(|(flaws, _)| flaws.none());
        kept.map(|(_, tally)| if self.mass_is_usable() { tally.mass } else { tally.particles as f64 }).sum()
    }

    /// The box around the particles that are kept; none if there are none.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        let kept = self.judged().filter(|(flaws, _)| flaws.none());
        let bounds = kept.fold(Bounds::EMPTY, |bounds, (_, tally)| bounds.union(tally.bounds));
        (!bounds.is_empty()).then_some(bounds)
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
