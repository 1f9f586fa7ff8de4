//! Weights in bins of a page file of which a part is read: an estimate by differences.
//!
//! The tree is split into parts, each of them what lies below a few nodes in pages of its own. Merged particles above a part say about
//! how much it has in each bin. Parts are drawn at random and read down to their leaves: how far these are from what merged particles
//! say tells how far all are from it. With `N` parts, of which `n` were read, and `d` by how much one of these has more weight in a bin
//! than was said of it, the estimate adds `N mean(d)`, whose standard error is `N sqrt((1 - n/N) var(d) / n)` (the difference estimator of
//! survey sampling; Cochran, Sampling Techniques, 7.3). It is right on average whatever merged particles say; the more they are like
//! the leaves, the fewer parts are read. Which parts come first depends on the file alone.

use super::batch::{Batch, Gather, Uncertain, Work};
use super::binned::{Binning, BinningPart, Extent};
use super::error::ExploreError;
use super::paged::{Entry, FamilyQuery, Walked, families};
use super::query::Query;
use super::shape::Cover;
use crate::store::{Encoding, Node, Page, PageId, Tree};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, HashSet};

/// Parts that are split or read at a time: a number of its own, so that an answer does not depend on that of the threads.
const AT_ONCE: usize = 16;
/// A file is split until it has a part for so many of its pages, within these bounds.
const PAGES_PER_PART: usize = 4;
const FEWEST_PARTS: usize = 64;
const MOST_PARTS: usize = 1024;
/// It is not split further once so much is held of what merged particles say: 16 bytes each.
const MOST_SHARES: usize = 1 << 23;
/// Bins that a part has something in up to which its parts have their share of that where nothing nearer is known of them.
const MOST_PASSED_DOWN: usize = 1 << 10;
/// Parts that are read in any case: of fewer, how much they differ is hardly known.
const FEWEST_READ: usize = 48;
/// Standard errors that an error is told as: of bins to which many parts contribute, one in some hundreds is farther off.
const STANDARD_ERRORS: f64 = 3.0;
/// Bins with less than this share of the weight may be off by as much as one that has this share.
const LEAST_SHARE: f64 = 0.01;

/// How far off bins may be because a part of a page file was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// What was allowed: relative to the weight of a bin, or to [`Estimate::least_share`] of all weight where it has less.
    pub allowed: f64,
    /// Share of all weight below which bins may be off by as much as one that has it.
    pub least_share: f64,
    /// Three standard errors of each bin's weight.
    pub errors: Vec<f64>,
    /// The largest of them, relative as what is allowed.
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

/// What merged particles say that a part has in a bin.
struct Share {
    place: u32,
    count: f32,
    weight: f64,
}

/// What lies below some nodes in pages that lead to nothing else.
struct Part {
    entries: BTreeMap<PageId, Vec<Entry>>,
    /// Source particles.
    particles: u64,
    shares: Vec<Share>,
}

impl Part {
    /// When its turn comes: anything that has nothing to do with what it holds (the finaliser of SplitMix64).
    fn turn(&self) -> u64 {
        let first = self.entries.first_key_value();
        let node = first.and_then(|(_, entries)| entries.first()).map_or(0, |entry| entry.node);
        let page = first.map_or(0, |(page, _)| page.0);
        let mut turn = (u64::from(page) << 32 | u64::from(node)).wrapping_add(0x9e37_79b9_7f4a_7c15);
        turn = (turn ^ (turn >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        turn = (turn ^ (turn >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        turn ^ (turn >> 31)
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

/// Bins of a tree, each within the allowed relative error; `None` where only all of it can be read. Without an [`Estimate`] all of it was.
///
/// # Errors
/// [`ExploreError`] where a page cannot be read.
pub(super) fn estimate(
    tree: &dyn Tree,
    query: &Query,
    binning: &Binning,
    allowed: f64,
    work: Work,
) -> Result<Option<(BinningPart, Option<Estimate>)>, ExploreError> {
    let Some(families) = coded(tree, query) else { return Ok(None) };
    let asked: Vec<_> = families.iter().flatten().map(|family| family.family).collect();
    let total = asked.iter().map(|family| family.count).fold(0, u64::saturating_add);
    work.progress.begin("reading pages", total);
    let mut roots: BTreeMap<PageId, u64> = BTreeMap::new();
    for family in &asked {
        let particles = roots.entry(family.root_page).or_default();
        *particles = particles.saturating_add(family.count);
    }
    let inside = query.shapes.are_everywhere();
    let root = |(page, particles): (PageId, u64)| {
        let entries = BTreeMap::from([(page, vec![Entry { node: 0, inside }])]);
        Part { entries, particles, shares: Vec::new() }
    };
    let mut parts: Vec<Part> = roots.into_iter().map(root).collect();

    let wanted = (tree.page_count() as usize / PAGES_PER_PART).clamp(FEWEST_PARTS, MOST_PARTS);
    let mut known = binning.part();
    let (mut pages_read, mut dealt_with) = (0, 0_u64);
    let held = |parts: &[Part]| parts.iter().map(|part| part.shares.len()).sum::<usize>();
    // Every page of a sound file is reached from one other; a file that was made to harm may lead to one many times.
    let mut seen: HashSet<PageId> = HashSet::new();
    while !parts.is_empty() && parts.len() < wanted && held(&parts) < MOST_SHARES {
        work.go_on()?;
        // The largest ones: what parts differ in size they differ in error.
        parts.sort_by_key(|part| part.particles);
        let largest = parts.split_off(parts.len().saturating_sub(AT_ONCE));
        let split: Vec<Result<Split, ExploreError>> =
            largest.into_par_iter().map(|part| split(tree, &families, part, binning)).collect();
        for split in split {
            let split = split?;
            binning.join(&mut known, split.known)?;
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
    parts.sort_by_cached_key(Part::turn);
    let mut sample = Sample::new(binning, known, &parts);
    let mut waiting = parts.into_iter();
    loop {
        let is_enough = sample.read >= FEWEST_READ && sample.largest_error() <= allowed;
        if sample.read == sample.parts || is_enough {
            break;
        }
        work.go_on()?;
        let next: Vec<Part> = waiting.by_ref().take(AT_ONCE).collect();
        let found: Vec<Result<(BinningPart, u64, Part), ExploreError>> =
            next.into_par_iter().map(|part| read(tree, &families, part, binning, work)).collect();
        for found in found {
            let (own, pages, part) = found?;
            pages_read += pages;
            dealt_with = dealt_with.saturating_add(part.particles);
            work.progress.advance(part.particles);
            sample.add(binning, own, &part.shares)?;
        }
    }
    // What merged particles stand for, and what is outside the region.
    work.progress.advance(total.saturating_sub(dealt_with));
    let estimate = (sample.read < sample.parts).then(|| Estimate {
        allowed,
        least_share: LEAST_SHARE,
        errors: sample.errors(),
        largest: sample.largest_error(),
        pages_read,
        pages: tree.page_count().into(),
        parts_read: sample.read,
        parts: sample.parts,
    });
    Ok(Some((sample.found(binning)?, estimate)))
}

/// A part, split.
struct Split {
    /// Of its pages.
    known: BinningPart,
    /// Source particles of the leaves in them.
    particles: u64,
    /// Below them.
    parts: Vec<Part>,
    pages: u64,
}

/// Reads the pages of a part alone.
fn split(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: Part,
    binning: &Binning,
) -> Result<Split, ExploreError> {
    let mut split = Split { known: binning.part(), particles: 0, parts: Vec::new(), pages: 0 };
    let Part { entries, particles, shares } = part;
    for (id, entries) in entries {
        let page = tree.read_page(id)?;
        split.pages += 1;
        if let Some(family) = families.get(page.family as usize).and_then(Option::as_ref) {
            split_page(family, &page, entries, binning, &mut split);
        }
    }
    let are_few = shares.len() <= MOST_PASSED_DOWN;
    for below in split.parts.iter_mut().filter(|below| are_few && below.shares.is_empty()) {
        let share = (below.particles as f64 / particles.max(1) as f64).min(1.0);
        let of = |of: &Share| {
            let count = (share * f64::from(of.count)) as f32;
            Share { place: of.place, count, weight: share * of.weight }
        };
        below.shares = shares.iter().map(of).collect();
    }
    Ok(split)
}

/// Takes the leaves of a page from its entries on, and parts of what is below.
fn split_page(family: &FamilyQuery, page: &Page, entries: Vec<Entry>, binning: &Binning, split: &mut Split) {
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
            binning.take(&mut split.known, &batch);
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
                shares(binning, &batch, of, share)
            });
            below.add(Part { entries: elsewhere, particles, shares });
        }
    }
    split.parts.extend(below.parts.into_iter().flatten());
}

/// What merged particles of a node say of this share of it.
fn shares(binning: &Binning, batch: &Batch, node: &Node, share: f64) -> Vec<Share> {
    let weights = binning.weight_column.map_or(Some(&batch.mass), |column| batch.columns.get(column));
    let Some(weights) = weights.filter(|weights| weights.len() == batch.mass.len()) else { return Vec::new() };
    // How many particles a mass stands for.
    let per_mass = if node.mass > 0.0 { node.source_particles as f64 / node.mass } else { 0.0 };
    let mut found: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for (i, (&mass, &weight)) in batch.mass.iter().zip(weights).enumerate() {
        let Some(place) = binning.place(batch, i).filter(|_| weight.is_finite() && mass.is_finite()) else { continue };
        let count = share * mass * per_mass;
        let weight = match binning.weight_column {
            Some(_) => count * weight,
            None if binning.is_count => count,
            None => share * mass,
        };
        // Bins are fewer than 2^32.
        let (counts, weights) = found.entry(place as u32).or_default();
        (*counts, *weights) = (*counts + count, *weights + weight);
    }
    found.into_iter().map(|(place, (count, weight))| Share { place, count: count as f32, weight }).collect()
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

/// Reads all of a part; how many pages that were, and the part without what led to them.
fn read(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    mut part: Part,
    binning: &Binning,
    work: Work,
) -> Result<(BinningPart, u64, Part), ExploreError> {
    let mut whole = binning.part();
    let mut open = std::mem::take(&mut part.entries);
    let mut seen = HashSet::new();
    let mut pages = 0;
    while let Some((id, entries)) = open.pop_first() {
        work.go_on()?;
        let page = tree.read_page(id)?;
        pages += 1;
        let Some(family) = families.get(page.family as usize).and_then(Option::as_ref) else { continue };
        let Walked { part: own, elsewhere, .. } = family.page(&page, entries, binning);
        binning.join(&mut whole, own)?;
        for (child, inside) in elsewhere {
            if seen.insert(child) {
                open.entry(child.page).or_default().push(Entry { node: child.node, inside });
            }
        }
    }
    Ok((whole, pages, part))
}

/// What is known of all parts by those that were read.
struct Sample {
    /// What is in no part.
    known: BinningPart,
    /// What those that were read hold together.
    inside: BinningPart,
    /// What merged particles say of all parts: weights and numbers.
    said: [Vec<f64>; 2],
    /// By how much parts that were read have more than was said of them: sums, sums of squares, and sums of the same of numbers.
    differences: [Vec<f64>; 3],
    read: usize,
    parts: usize,
}

impl Sample {
    fn new(binning: &Binning, known: BinningPart, parts: &[Part]) -> Sample {
        let none = || vec![0.0; binning.cells];
        let mut said = [none(), none()];
        for share in parts.iter().flat_map(|part| &part.shares) {
            said[0][share.place as usize] += share.weight;
            said[1][share.place as usize] += f64::from(share.count);
        }
        let differences = [none(), none(), none()];
        Sample { known, inside: binning.part(), said, differences, read: 0, parts: parts.len() }
    }

    /// Adds a part that was read, and what was said of it.
    fn add(&mut self, binning: &Binning, own: BinningPart, shares: &[Share]) -> Result<(), ExploreError> {
        let mut weights = own.weights.clone();
        let mut counts: Vec<f64> = own.counts.iter().map(|&count| count as f64).collect();
        for share in shares {
            weights[share.place as usize] -= share.weight;
            counts[share.place as usize] -= f64::from(share.count);
        }
        let [sums, squares, numbers] = &mut self.differences;
        sums.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum += weight);
        squares.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum += weight * weight);
        numbers.iter_mut().zip(&counts).for_each(|(sum, count)| *sum += count);
        self.read += 1;
        binning.join(&mut self.inside, own)
    }

    /// Parts for one that was read.
    fn factor(&self) -> f64 {
        if self.read > 0 { self.parts as f64 / self.read as f64 } else { 0.0 }
    }

    fn weight(&self, bin: usize) -> f64 {
        self.known.weights[bin] + self.said[0][bin] + self.factor() * self.differences[0][bin]
    }

    /// Errors of all bins' weights.
    fn errors(&self) -> Vec<f64> {
        let [sums, squares, _] = &self.differences;
        let (read, parts) = (self.read as f64, self.parts as f64);
        let error = |(sum, squares): (&f64, &f64)| {
            let variance = ((squares - sum * sum / read) / (read - 1.0)).max(0.0);
            STANDARD_ERRORS * parts * ((1.0 - read / parts) * variance / read).sqrt()
        };
        match self.read {
            0 | 1 => vec![f64::INFINITY; sums.len()],
            _ => sums.iter().zip(squares).map(error).collect(),
        }
    }

    /// The largest error, relative to the weight of a bin or to the least share.
    fn largest_error(&self) -> f64 {
        let weights: Vec<f64> = (0..self.said[0].len()).map(|bin| self.weight(bin).abs()).collect();
        let least = LEAST_SHARE * weights.iter().sum::<f64>();
        let relative = |(error, weight): (f64, &f64)| if error > 0.0 { error / weight.max(least) } else { 0.0 };
        self.errors().into_iter().zip(&weights).map(relative).fold(0.0, f64::max)
    }

    /// All bins: exact where all parts were read.
    fn found(mut self, binning: &Binning) -> Result<BinningPart, ExploreError> {
        if self.read == self.parts {
            binning.join(&mut self.known, self.inside)?;
            return Ok(self.known);
        }
        let factor = self.factor();
        let is_field = binning.weight_column.is_some();
        // No bin has less than nothing of a mass or a number.
        let weight = |bin: usize| if is_field { self.weight(bin) } else { self.weight(bin).max(0.0) };
        let count = |bin: usize| {
            let of_parts = self.said[1][bin] + factor * self.differences[2][bin];
            (self.known.counts[bin] as f64 + of_parts).round().max(0.0) as u64
        };
        let (known, inside) = (&self.known, &self.inside);
        let sum = |known: f64, inside: f64| known + factor * inside;
        let number = |known: u64, inside: u64| sum(known as f64, inside as f64).round() as u64;
        let both = |known: [f64; 2], inside: [f64; 2]| [sum(known[0], inside[0]), sum(known[1], inside[1])];
        Ok(BinningPart {
            weights: (0..known.weights.len()).map(weight).collect(),
            counts: (0..known.counts.len()).map(count).collect(),
            size: sum(known.size, inside.size),
            other_bins: both(known.other_bins, inside.other_bins),
            off: both(known.off, inside.off),
            not_positive: number(known.not_positive, inside.not_positive),
            outside: number(known.outside, inside.outside),
            missing: number(known.missing, inside.missing),
            uncertain: Uncertain {
                count: number(known.uncertain.count, inside.uncertain.count),
                mass: sum(known.uncertain.mass, inside.uncertain.mass),
                position: known.uncertain.position.max(inside.uncertain.position),
            },
        })
    }
}
