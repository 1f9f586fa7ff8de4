//! Totals over a page file of which a part is read: an estimate by differences.
//!
//! The tree is split into parts, each of them what lies below a few nodes in pages of its own. Merged particles above a part say about
//! how much it adds to each total. Parts are drawn at random and read down to their leaves: how far these are from what merged particles
//! say tells how far all are from it. With `N` parts, of which `n` were read, and `d` by how much one of these has more of a total
//! than was said of it, the estimate adds `N mean(d)`, whose standard error is `N sqrt((1 - n/N) var(d) / n)` (the difference estimator of
//! survey sampling; Cochran, Sampling Techniques, 7.3). It is right on average whatever merged particles say; the more they are like
//! the leaves, the fewer parts are read. Errors of ratios of totals `R = A / B` are those of `A - R B`, over `B` (6.3 there). Which parts
//! come first depends on the file and a number alone.
//!
//! Where time is short, a large part is not read as a whole: a way is drawn through it, at each step to what lies below with a chance in
//! proportion to its particles, and what is found counts by the inverse of the chances (two stages; 11.7 there). What a part has is then known
//! with an error of its own, which is in `var(d)`, too; without the factor `1 - n/N` the standard error is rather too large.

use super::batch::{Batch, Gather, Work};
use super::binned::Extent;
use super::data::Data;
use super::error::ExploreError;
use super::paged::{Entry, FamilyQuery, Walked, families};
use super::query::Query;
use super::shape::Cover;
use crate::model::mixing::{GOLDEN, as_share, mix_bits};
use crate::store::{Encoding, Node, Page, PageId, Tree};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, HashSet};
use std::time::Instant;

/// Parts that are split or read at a time: a number of its own, so that an answer does not depend on that of the threads.
const AT_ONCE: usize = 16;
/// A file is split until it has a part for so many of its pages, within these bounds.
const PAGES_PER_PART: usize = 4;
const FEWEST_PARTS: usize = 64;
const MOST_PARTS: usize = 1024;
/// It is not split further once so much is held of what merged particles say: 8 bytes each.
const MOST_SHARES: usize = 1 << 24;
/// Totals that a part adds something to up to which its parts have their share of that where nothing nearer is known of them.
const MOST_PASSED_DOWN: usize = 1 << 11;
/// Parts that are read in any case: of fewer, how much they differ is hardly known.
const FEWEST_READ: usize = 48;
/// Where time is short, parts of about so many pages are read as a whole, and a way is drawn through larger ones.
const READ_WHOLE: f64 = 2.0;
/// Standard errors that an error is told as: of bins to which many parts contribute, one in some hundreds is farther off.
const STANDARD_ERRORS: f64 = 3.0;
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

/// Totals over all particles.
pub(super) struct Totals {
    pub values: Vec<f64>,
    /// Three standard errors of them.
    pub errors: Vec<f64>,
    /// The same of [`Estimated::ratios`].
    pub ratio_errors: Vec<f64>,
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

/// What merged particles say that a part adds to a total.
struct Share {
    total: u32,
    value: f32,
}

/// What lies below some nodes in pages that lead to nothing else.
struct Part {
    entries: BTreeMap<PageId, Vec<Entry>>,
    /// Source particles.
    particles: u64,
    shares: Vec<Share>,
}

impl Part {
    /// When its turn comes: anything that has nothing to do with what it holds.
    fn turn(&self, draw: u64) -> u64 {
        let first = self.entries.first_key_value();
        let node = first.and_then(|(_, entries)| entries.first()).map_or(0, |entry| entry.node);
        let page = first.map_or(0, |(page, _)| page.0);
        mix_bits((u64::from(page) << 32 | u64::from(node)).wrapping_add(GOLDEN) ^ mix_bits(draw))
    }

    /// What its chance to be drawn is in proportion to.
    fn size(&self) -> f64 {
        self.particles.max(1) as f64
    }
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
    let root = |(page, particles): (PageId, u64)| {
        let entries = BTreeMap::from([(page, vec![Entry { node: 0, inside }])]);
        Part { entries, particles, shares: Vec::new() }
    };
    let mut parts: Vec<Part> = roots.into_iter().map(root).collect();

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
                part.entries.retain(|page, _| seen.insert(*page));
                if !part.entries.is_empty() {
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

/// A part, split.
struct Split<P> {
    /// Of its pages.
    known: P,
    /// Source particles of the leaves in them.
    particles: u64,
    /// Below them.
    parts: Vec<Part>,
    pages: u64,
}

/// Reads the pages of a part alone.
fn split<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: &mut Part,
    gather: &G,
) -> Result<Split<G::Part>, ExploreError> {
    let mut split = Split { known: gather.part(), particles: 0, parts: Vec::new(), pages: 0 };
    for (id, entries) in std::mem::take(&mut part.entries) {
        let page = tree.read_page(id)?;
        split.pages += 1;
        if let Some(family) = families.get(page.family as usize).and_then(Option::as_ref) {
            split_page(family, &page, entries, gather, &mut split);
        }
    }
    let are_few = part.shares.len() <= MOST_PASSED_DOWN;
    for below in split.parts.iter_mut().filter(|below| are_few && below.shares.is_empty()) {
        let share = (below.particles as f64 / part.size()).min(1.0) as f32;
        below.shares = part.shares.iter().map(|of| Share { total: of.total, value: share * of.value }).collect();
    }
    Ok(split)
}

/// Takes the leaves of a page from its entries on, and parts of what is below.
fn split_page<G: Estimated>(
    family: &FamilyQuery,
    page: &Page,
    entries: Vec<Entry>,
    gather: &G,
    split: &mut Split<G::Part>,
) {
    let mut batch = Batch::default();
    let mut reached = vec![false; page.nodes.len()];
    let mut below = Below::default();
    // With the nearest node at or above that has merged particles.
    let mut stack: Vec<(Entry, Option<usize>)> = entries.into_iter().map(|entry| (entry, None)).collect();
    while let Some((Entry { node: index, inside }, above)) = stack.pop() {
        let index = index as usize;
        let Some(node) = page.nodes.get(index) else { continue };
        if std::mem::replace(&mut reached[index], true) {
            continue;
        }
        let cover = if inside { Cover::Inside } else { family.query.shapes.cover(node.bounds) };
        if cover == Cover::Outside {
            split.particles = split.particles.saturating_add(node.source_particles);
            continue;
        }
        let inside = cover == Cover::Inside;
        if node.is_leaf() {
            family.leaf(page, index, node, inside, &mut batch);
            gather.take(&mut split.known, &batch);
            split.particles = split.particles.saturating_add(node.source_particles);
            continue;
        }
        let merged = if node.encoding == Encoding::Grid { Some(index) } else { above };
        let mut elsewhere: BTreeMap<PageId, Vec<Entry>> = BTreeMap::new();
        let mut here = 0_u64;
        for (child, &bounds) in page.children(index).iter().zip(page.child_bounds(index)) {
            if child.page == page.id {
                let particles = page.nodes.get(child.node as usize).map_or(0, |child| child.source_particles);
                here = here.saturating_add(particles);
                stack.push((Entry { node: child.node, inside }, merged));
            } else if inside || family.query.shapes.cover(bounds) != Cover::Outside {
                elsewhere.entry(child.page).or_default().push(Entry { node: child.node, inside });
            }
        }
        if !elsewhere.is_empty() {
            let particles = node.source_particles.saturating_sub(here);
            let merged = merged.map(|merged| (merged, &page.nodes[merged]));
            let shares = merged.map_or_else(Vec::new, |(merged, of)| {
                // What of the node is below, where not all of it is.
                let share = (particles as f64 / of.source_particles.max(1) as f64).min(1.0);
                family.merged(page, merged, of, inside, &mut batch);
                shares(gather, &batch, of, share)
            });
            below.add(Part { entries: elsewhere, particles, shares });
        }
    }
    split.parts.extend(below.parts.into_iter().flatten());
}

/// What merged particles of a node say of this share of it.
fn shares<G: Estimated>(gather: &G, batch: &Batch, node: &Node, share: f64) -> Vec<Share> {
    let per_mass = if node.mass > 0.0 { node.source_particles as f64 / node.mass } else { 0.0 };
    let mut found: BTreeMap<u32, f64> = BTreeMap::new();
    // Totals are fewer than 2^32.
    gather.merged(batch, per_mass, &mut |total, value| *found.entry(total as u32).or_default() += share * value);
    let said = found.into_iter().map(|(total, value)| Share { total, value: value as f32 });
    // Whatever is said, the answer is right on average; what has no place in single precision says nothing.
    said.filter(|share| share.value.is_finite()).collect()
}

/// Parts below a page, joined where they have a page in common, so that each page is of one of them.
#[derive(Default)]
struct Below {
    parts: Vec<Option<Part>>,
    of_page: BTreeMap<PageId, usize>,
}

impl Below {
    fn add(&mut self, mut part: Part) {
        let own = self.parts.len();
        let others: HashSet<usize> = part.entries.keys().filter_map(|page| self.of_page.get(page).copied()).collect();
        let mut others: Vec<usize> = others.into_iter().collect();
        others.sort_unstable();
        for other in others.into_iter().filter_map(|other| self.parts[other].take()) {
            part.particles = part.particles.saturating_add(other.particles);
            part.shares.extend(other.shares);
            for (page, entries) in other.entries {
                part.entries.entry(page).or_default().extend(entries);
            }
        }
        self.of_page.extend(part.entries.keys().map(|page| (*page, own)));
        self.parts.push(Some(part));
    }
}

/// A part that was drawn.
struct Drawn<P> {
    /// Its leaves; of a way through it, each as many times as it stands for others.
    found: P,
    /// What was said of it.
    said: Vec<Share>,
    /// What was said of what lies beside the way, and what the way says of that: to be added to totals.
    beside: Vec<(u32, f64)>,
    /// Whether what was found is among that already, as it was before numbers of particles were rounded.
    is_counted: bool,
    particles: u64,
    pages: u64,
    is_whole: bool,
}

impl<P> Drawn<P> {
    fn new(found: P, part: &Part) -> Drawn<P> {
        let particles = part.particles;
        Drawn { found, said: Vec::new(), beside: Vec::new(), is_counted: false, particles, pages: 0, is_whole: true }
    }
}

/// Reads all of a part.
fn read<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: Part,
    gather: &G,
    work: Work,
) -> Result<Drawn<G::Part>, ExploreError> {
    let mut drawn = Drawn::new(gather.part(), &part);
    let mut open = part.entries;
    let mut seen = HashSet::new();
    while let Some((id, entries)) = open.pop_first() {
        work.go_on()?;
        let page = tree.read_page(id)?;
        drawn.pages += 1;
        let Some(family) = families.get(page.family as usize).and_then(Option::as_ref) else { continue };
        let Walked { part: own, elsewhere, .. } = family.page(&page, entries, gather);
        gather.join(&mut drawn.found, own)?;
        for (child, inside) in elsewhere {
            if seen.insert(child) {
                open.entry(child.page).or_default().push(Entry { node: child.node, inside });
            }
        }
    }
    drawn.said = part.shares;
    Ok(drawn)
}

/// Reads a way through a part: at each step one of the parts below is drawn, with a chance in proportion to its particles.
fn descend<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: Part,
    gather: &G,
    draw: u64,
    work: Work,
) -> Result<Drawn<G::Part>, ExploreError> {
    let mut drawn = Drawn { is_counted: true, ..Drawn::new(gather.part(), &part) };
    let mut own = vec![0.0; gather.totals()];
    let mut seen: HashSet<PageId> = part.entries.keys().copied().collect();
    let mut turn = part.turn(draw);
    // One over the chance to get here.
    let mut factor = 1.0;
    let mut said = None;
    let mut here = part;
    loop {
        work.go_on()?;
        let Split { known, mut parts, pages, .. } = split(tree, families, &mut here, gather)?;
        drawn.pages += pages;
        // Of the part itself, which was split first.
        said.get_or_insert_with(|| std::mem::take(&mut here.shares));
        own.fill(0.0);
        gather.count(&known, &mut own);
        let counted = (0_u32..).zip(&own).filter(|(_, value)| **value != 0.0);
        drawn.beside.extend(counted.map(|(total, value)| (total, factor * value)));
        gather.join(&mut drawn.found, gather.scaled(known, factor))?;
        turn = mix_bits(turn.wrapping_add(GOLDEN));
        let size: f64 = parts.iter().map(Part::size).sum();
        let mut place = size * as_share(turn);
        let chosen = parts.iter().position(|part| {
            place -= part.size();
            place < 0.0
        });
        let Some(chosen) = chosen.or(parts.len().checked_sub(1)) else { break };
        let times = |factor: f64| move |share: &Share| (share.total, factor * f64::from(share.value));
        drawn.beside.extend(parts.iter().flat_map(|part| &part.shares).map(times(factor)));
        drawn.is_whole &= parts.len() == 1;
        here = parts.swap_remove(chosen);
        factor *= size / here.size();
        drawn.beside.extend(here.shares.iter().map(times(-factor)));
        here.entries.retain(|page, _| seen.insert(*page));
        if here.entries.is_empty() {
            break;
        }
    }
    drawn.said = said.unwrap_or_default();
    Ok(drawn)
}

/// What is known of all parts by those that were read.
struct Sample<'a, G: Estimated> {
    gather: &'a G,
    /// What is in no part.
    known: G::Part,
    /// What those that were read hold together.
    inside: G::Part,
    /// Totals of what is in no part, and of what merged particles say of all parts.
    said: Vec<f64>,
    /// By how much parts that were read have more than was said of them: sums, and sums of squares.
    differences: [Vec<f64>; 2],
    ratios: Vec<[usize; 2]>,
    /// Sums of the products of these differences of each ratio.
    products: Vec<f64>,
    /// Those of a part.
    own: Vec<f64>,
    read: usize,
    parts: usize,
    /// Whether parts were read as a whole.
    are_whole: bool,
}

impl<'a, G: Estimated> Sample<'a, G> {
    fn new(gather: &'a G, known: G::Part, parts: &[Part]) -> Sample<'a, G> {
        let none = vec![0.0; gather.totals()];
        let mut said = none.clone();
        gather.count(&known, &mut said);
        for share in parts.iter().flat_map(|part| &part.shares) {
            said[share.total as usize] += f64::from(share.value);
        }
        let ratios = gather.ratios();
        Sample {
            gather,
            known,
            inside: gather.part(),
            said,
            differences: [none.clone(), none.clone()],
            products: vec![0.0; ratios.len()],
            ratios,
            own: none,
            read: 0,
            parts: parts.len(),
            are_whole: true,
        }
    }

    /// Adds a part that was read.
    fn add(&mut self, drawn: Drawn<G::Part>) -> Result<(), ExploreError> {
        let own = &mut self.own;
        own.fill(0.0);
        if !drawn.is_counted {
            self.gather.count(&drawn.found, own);
        }
        drawn.beside.iter().for_each(|&(total, value)| own[total as usize] += value);
        drawn.said.iter().for_each(|share| own[share.total as usize] -= f64::from(share.value));
        let [sums, squares] = &mut self.differences;
        sums.iter_mut().zip(&*own).for_each(|(sum, own)| *sum += own);
        squares.iter_mut().zip(&*own).for_each(|(sum, own)| *sum += own * own);
        let products = self.products.iter_mut().zip(&self.ratios);
        products.for_each(|(sum, &[above, below])| *sum += own[above] * own[below]);
        self.read += 1;
        self.are_whole &= drawn.is_whole;
        self.gather.join(&mut self.inside, drawn.found)
    }

    /// Whether there is nothing that was not read.
    fn is_all(&self) -> bool {
        self.read == self.parts && self.are_whole
    }

    /// Parts for one that was read.
    fn factor(&self) -> f64 {
        if self.read > 0 { self.parts as f64 / self.read as f64 } else { 0.0 }
    }

    /// The error of a total of which parts have this much in sum, and the squares of which have this sum.
    fn error(&self, sum: f64, squares: f64) -> f64 {
        if self.read < 2 {
            return f64::INFINITY;
        }
        let (read, parts) = (self.read as f64, self.parts as f64);
        let variance = ((squares - sum * sum / read) / (read - 1.0)).max(0.0);
        let left = if self.are_whole { 1.0 - read / parts } else { 1.0 };
        STANDARD_ERRORS * parts * (left * variance / read).sqrt()
    }

    fn totals(&self) -> Totals {
        let [sums, squares] = &self.differences;
        let factor = self.factor();
        let values: Vec<f64> = self.said.iter().zip(sums).map(|(said, sum)| said + factor * sum).collect();
        let errors = sums.iter().zip(squares).map(|(&sum, &squares)| self.error(sum, squares)).collect();
        let ratio_error = |(&[above, below], product): (&[usize; 2], &f64)| {
            if values[below] <= 0.0 {
                return f64::INFINITY;
            }
            let ratio = values[above] / values[below];
            let sum = sums[above] - ratio * sums[below];
            let squares = squares[above] - 2.0 * ratio * product + ratio * ratio * squares[below];
            self.error(sum, squares) / values[below]
        };
        let ratio_errors = self.ratios.iter().zip(&self.products).map(ratio_error).collect();
        Totals { values, errors, ratio_errors }
    }

    /// All particles that were read, each as many times as it stands for others; exact where all were.
    fn found(self) -> Result<G::Part, ExploreError> {
        let factor = self.factor();
        let Sample { gather, mut known, inside, .. } = self;
        let inside = if factor > 1.0 { gather.scaled(inside, factor) } else { inside };
        gather.join(&mut known, inside)?;
        Ok(known)
    }
}
