//! Totals over a page file of which a part is read: an estimate by differences.
//!
//! The tree is split into parts, each of them what lies below a few nodes in pages of its own. Merged particles above a part say about
//! how much it adds to each total: those that are nearer to it than to others. Parts are drawn at random and read down to their leaves: how
//! far these are from what merged particles say tells how far all are from it. With `N` parts, of which `n` were read, and `d` by how much
//! one of these has more of a total than was said of it, the estimate adds `N mean(d)`, whose standard error is
//! `N sqrt((1 - n/N) var(d) / n)` (the difference estimator of survey sampling; Cochran, Sampling Techniques, 7.3). It is right on average
//! whatever merged particles say; the more they are like the leaves, the fewer parts are read. Errors of ratios of totals `R = A / B` are
//! those of `A - R B`, over `B` (6.3 there). Which parts come first depends on the file and a number alone.
//!
//! Where time is short, a large part is not read as a whole: a way is drawn through it, at each step to what lies below with a chance in
//! proportion to its particles, and what is found counts by the inverse of the chances (two stages; 11.7 there). What a part has is then known
//! with an error of its own, which is in `var(d)`, too; without the factor `1 - n/N` the standard error is rather too large.

use super::batch::{Batch, Gather, Work};
use super::binned::Extent;
use super::data::Data;
use super::error::ExploreError;
use super::paged::{FamilyQuery, families};
use super::query::Query;
use crate::store::{PageId, Tree};
use parts::{Drawn, Part, Split, descend, read, split};
use rayon::prelude::*;
use sample::Sample;
use serde::Serialize;
use std::collections::{BTreeMap, HashSet};
use std::time::Instant;

mod parts;
mod sample;

pub(super) use sample::Totals;

/// Parts that are split or read at a time: a number of its own, so that an answer does not depend on that of the threads.
const AT_ONCE: usize = 16;
/// A file is split until it has a part for so many of its pages, within these bounds.
const PAGES_PER_PART: usize = 4;
const FEWEST_PARTS: usize = 64;
const MOST_PARTS: usize = 1024;
/// It is not split further once so much is held of what merged particles say: 8 bytes each.
const MOST_SHARES: usize = 1 << 24;
/// Merged particles that are held for what parts are split into: some 64 bytes each. Those of the smallest parts are not beyond that.
const MOST_MERGED: usize = 1 << 21;
/// Parts that are read in any case: of fewer, how much they differ is hardly known.
const FEWEST_READ: usize = 48;
/// Where time is short, parts of about so many pages are read as a whole, and a way is drawn through larger ones.
const READ_WHOLE: f64 = 2.0;
/// Bins with less than this share of the weight may be off by as much as one that has this share.
pub(super) const LEAST_SHARE: f64 = 0.01;

/// How much of a page file is read for an answer. Sources are read as a whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    enough: Enough,
    draw: u64,
}

/// When a part of a page file is enough.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Enough {
    Never,
    /// Errors are at most so large.
    Error(f64),
    /// It is so late; it is not split any more before that.
    Time {
        split: Instant,
        read: Instant,
    },
}

impl Effort {
    /// All is read.
    pub const ALL: Effort = Effort { enough: Enough::Never, draw: 0 };

    /// As much as keeps errors to what is allowed ([`Estimate::allowed`]); all for 0.
    pub fn within(allowed: f64) -> Effort {
        Effort { enough: if allowed > 0.0 { Enough::Error(allowed) } else { Enough::Never }, draw: 0 }
    }

    /// As much as there is time for, and in any case as much as tells the error.
    pub fn until(deadline: Instant) -> Effort {
        let now = Instant::now();
        let split = now + deadline.saturating_duration_since(now) / 2;
        Effort { enough: Enough::Time { split, read: deadline }, draw: 0 }
    }

    /// The same with the parts that another number draws.
    pub fn drawn(self, draw: u64) -> Effort {
        Effort { draw, ..self }
    }

    /// What may be read in part.
    pub(super) fn part_of<'a>(&self, data: Data<'a>) -> Option<&'a dyn Tree> {
        match data {
            Data::Pages(tree) if self.enough != Enough::Never => Some(tree),
            Data::Pages(_) | Data::Source(_) => None,
        }
    }
}

/// How far off an answer may be because a part of a page file was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// What was allowed: relative to the weight of a bin, or to [`Estimate::least_share`] of all weight where it has less; `None` where as much
    /// was read as there was time for.
    pub allowed: Option<f64>,
    /// Share of all weight below which bins may be off by as much as one that has it.
    pub least_share: f64,
    /// Three standard errors: of each bin's weight; of each shell's mass; of a scatter plot of the share of the particles that each of 16 by 16
    /// equal cells has, row by row.
    pub errors: Vec<f64>,
    /// The largest of them, relative as what is allowed; of a profile also of the means, relative to the root mean square of their shell's
    /// values.
    pub largest: f64,
    /// Pages that were read.
    pub pages_read: u64,
    /// Pages of the file.
    pub pages: u64,
    /// Parts that were read, beside what was read of the file before it was split into them.
    pub parts_read: usize,
    /// Parts.
    pub parts: usize,
}

/// A question that a part of a page file may answer: totals over particles, of which merged particles may say something beforehand.
pub(super) trait Estimated: Gather {
    /// How many totals; fewer than 2^32.
    fn totals(&self) -> usize;

    /// Ratios whose errors are wanted: the total above, and that below.
    fn ratios(&self) -> Vec<[usize; 2]>;

    /// Adds what some particles amount to.
    fn count(&self, part: &Self::Part, totals: &mut [f64]);

    /// Tells what merged particles add to totals; `per_mass`: how many particles their mass stands for.
    fn merged(&self, batch: &Batch, per_mass: f64, say: &mut dyn FnMut(usize, f64));

    /// As though each particle had been there so many times, at least once.
    fn scaled(&self, part: Self::Part, factor: f64) -> Self::Part;

    /// The errors that are told, and the largest relative to what it may be relative to.
    fn errors(&self, totals: &Totals) -> (Vec<f64>, f64);
}

/// The largest error relative to its value, or to the least share of all.
pub(super) fn largest(errors: &[f64], values: &[f64]) -> f64 {
    let least = LEAST_SHARE * values.iter().map(|value| value.abs()).sum::<f64>();
    let relative = |(&error, value): (&f64, &f64)| if error > 0.0 { error / value.abs().max(least) } else { 0.0 };
    errors.iter().zip(values).map(relative).fold(0.0, f64::max)
}

/// What was found.
pub(super) struct Found<P> {
    /// Of all particles; where a part was read, of those that were, each as many times as it stands for others.
    pub part: P,
    /// Totals and how far off they may be, where a part was read.
    pub sampled: Option<(Totals, Estimate)>,
}

/// From where to where the values of leaves reach that are in the ranges of the question, wherever they lie; `None` where values are not
/// coded.
pub(super) fn extents(tree: &dyn Tree, query: &Query, columns: usize) -> Option<Vec<Extent>> {
    let families = coded(tree, query)?;
    let mut extents = vec![Extent::NONE; columns];
    for family in families.iter().flatten() {
        family.leaf_values(|column, value| {
            // A weight's column has no axis.
            if let Some(extent) = extents.get_mut(column) {
                *extent = extent.with(value);
            }
        });
    }
    Some(extents)
}

/// The question to each family; `None` where it is of ids, or where particles are not coded.
fn coded<'a>(tree: &'a dyn Tree, query: &'a Query<'a>) -> Option<Vec<Option<FamilyQuery<'a>>>> {
    query.region()?;
    let families = families(tree, query);
    let is_coded = families.iter().flatten().all(|family| !family.family.codebooks.is_empty());
    is_coded.then_some(families)
}

/// Asks as much of the data as is wanted; all of it where only that can be read.
///
/// # Errors
/// [`ExploreError`] where the data cannot be read.
pub(super) fn ask<G: Estimated>(
    data: Data,
    query: &Query,
    gather: &G,
    effort: Effort,
    work: Work,
) -> Result<Found<G::Part>, ExploreError> {
    if let Some(tree) = effort.part_of(data)
        && let Some(families) = coded(tree, query)
    {
        return estimate(tree, &families, gather, effort, work);
    }
    Ok(Found { part: query.ask(data, gather, work)?, sampled: None })
}

/// Totals over a tree, from as much as is enough; what is found is of all of it where all of it was read.
fn estimate<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    gather: &G,
    effort: Effort,
    work: Work,
) -> Result<Found<G::Part>, ExploreError> {
    let asked: Vec<&FamilyQuery> = families.iter().flatten().collect();
    let total = asked.iter().map(|asked| asked.family.count).fold(0, u64::saturating_add);
    work.progress.begin("reading pages", total);
    let mut roots: BTreeMap<PageId, u64> = BTreeMap::new();
    for asked in &asked {
        let particles = roots.entry(asked.family.root_page).or_default();
        *particles = particles.saturating_add(asked.family.count);
    }
    // The same of all families.
    let inside = asked.first().is_some_and(|asked| asked.query.shapes.are_everywhere());
    let mut parts: Vec<Part> = roots.into_iter().map(|(page, particles)| Part::root(page, inside, particles)).collect();

    let wanted = (tree.page_count() as usize / PAGES_PER_PART).clamp(FEWEST_PARTS, MOST_PARTS);
    let mut known = gather.part();
    let (mut pages_read, mut dealt_with) = (0, 0_u64);
    let held = |parts: &[Part]| parts.iter().map(|part| part.shares.len()).sum::<usize>();
    let is_late = |parts: &[Part]| match effort.enough {
        Enough::Time { split, .. } => parts.len() >= FEWEST_PARTS && Instant::now() >= split,
        Enough::Never | Enough::Error(_) => false,
    };
    // Every page of a sound file is reached from one other; a file that was made to harm may lead to one many times.
    let mut seen: HashSet<PageId> = HashSet::new();
    while !parts.is_empty() && parts.len() < wanted && held(&parts) < MOST_SHARES && !is_late(&parts) {
        work.go_on()?;
        // The largest ones: what parts differ in size they differ in error.
        parts.sort_by_key(|part| part.particles);
        let mut merged: usize = parts.iter().map(Part::held).sum();
        for part in &mut parts {
            if merged <= MOST_MERGED {
                break;
            }
            merged -= part.held();
            part.let_go();
        }
        let largest = parts.split_off(parts.len().saturating_sub(AT_ONCE));
        let split: Vec<Result<Split<G::Part>, ExploreError>> =
            largest.into_par_iter().map(|mut part| split(tree, families, &mut part, gather)).collect();
        for split in split {
            let split = split?;
            gather.join(&mut known, split.known)?;
            pages_read += split.pages;
            dealt_with = dealt_with.saturating_add(split.particles);
            work.progress.advance(split.particles);
            for mut part in split.parts {
                if part.is_left(&mut seen) {
                    parts.push(part);
                }
            }
        }
    }
    parts.sort_by_cached_key(|part| part.turn(effort.draw));
    let pages_of = |part: &Part| f64::from(tree.page_count()) * (part.particles as f64 / total.max(1) as f64);
    let is_read_whole = |part: &Part| match effort.enough {
        Enough::Time { .. } => pages_of(part) <= READ_WHOLE,
        Enough::Never | Enough::Error(_) => true,
    };
    let mut sample = Sample::new(gather, known, &parts);
    let mut waiting = parts.into_iter();
    loop {
        let is_enough = sample.read >= FEWEST_READ
            && match effort.enough {
                Enough::Never => false,
                Enough::Error(allowed) => gather.errors(&sample.totals()).1 <= allowed,
                Enough::Time { read, .. } => Instant::now() >= read,
            };
        if sample.read == sample.parts || is_enough {
            break;
        }
        work.go_on()?;
        let next: Vec<Part> = waiting.by_ref().take(AT_ONCE).collect();
        let drawn: Vec<Result<Drawn<G::Part>, ExploreError>> = next
            .into_par_iter()
            .map(|part| match is_read_whole(&part) {
                true => read(tree, families, part, gather, work),
                false => descend(tree, families, part, gather, effort.draw, work),
            })
            .collect();
        for drawn in drawn {
            let drawn = drawn?;
            pages_read += drawn.pages;
            dealt_with = dealt_with.saturating_add(drawn.particles);
            work.progress.advance(drawn.particles);
            sample.add(drawn)?;
        }
    }
    // What merged particles stand for, and what is outside the region.
    work.progress.advance(total.saturating_sub(dealt_with));
    let sampled = (!sample.is_all()).then(|| {
        let totals = sample.totals();
        let (errors, largest) = gather.errors(&totals);
        let estimate = Estimate {
            allowed: match effort.enough {
                Enough::Error(allowed) => Some(allowed),
                Enough::Never | Enough::Time { .. } => None,
            },
            least_share: LEAST_SHARE,
            errors,
            largest,
            pages_read,
            pages: tree.page_count().into(),
            parts_read: sample.read,
            parts: sample.parts,
        };
        (totals, estimate)
    });
    Ok(Found { part: sample.found()?, sampled })
}
