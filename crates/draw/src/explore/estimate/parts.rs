//! Parts of a tree: what merged particles above them say of them, and what is found where they are read.

use super::Estimated;
use crate::explore::batch::{Batch, Work};
use crate::explore::error::ExploreError;
use crate::explore::paged::{Entry, FamilyQuery, Walked};
use crate::explore::shape::Cover;
use crate::model::Bounds;
use crate::model::mixing::{GOLDEN, as_share, mix_bits};
use crate::store::{Encoding, Page, PageId, Tree};
use std::collections::{BTreeMap, HashSet};

/// Totals that a part adds something to up to which its parts have their share of that where nothing nearer is known of them.
const MOST_PASSED_DOWN: usize = 1 << 11;

/// What merged particles say that a part adds to a total.
pub(super) struct Share {
    pub total: u32,
    pub value: f32,
}

/// Merged particles of a node, as far as they are nearest to what lies below.
struct Merged {
    batch: Batch<'static>,
    /// How many source particles their mass stands for.
    per_mass: f64,
}

impl Merged {
    /// Those that are nearest to each of the boxes.
    fn among(&self, boxes: &[Bounds]) -> Vec<Merged> {
        let Batch { family, positions, relative, mass, columns, .. } = &self.batch;
        let none = || {
            let columns = vec![Vec::new(); columns.len()];
            Merged { batch: Batch { family: *family, columns, ..Batch::default() }, per_mass: self.per_mass }
        };
        let mut all: Vec<Merged> = boxes.iter().map(|_| none()).collect();
        for (i, &at) in positions.iter().enumerate() {
            let squared = |bounds: &Bounds| (at.max(bounds.min).min(bounds.max) - at).length_squared();
            let nearest = boxes.iter().zip(&mut all).min_by(|a, b| squared(a.0).total_cmp(&squared(b.0)));
            let Some((_, Merged { batch: near, .. })) = nearest else { break };
            near.positions.push(at);
            near.relative.push(relative[i]);
            near.mass.push(mass[i]);
            for (near, column) in near.columns.iter_mut().zip(columns) {
                near.extend(column.get(i));
            }
        }
        all
    }
}

/// Where a part begins.
struct Way {
    entry: Entry,
    /// What is there of the nearest node above that has merged particles; `None` where that is not known.
    merged: Option<Merged>,
}

/// What lies below some nodes in pages that lead to nothing else.
pub(super) struct Part {
    ways: BTreeMap<PageId, Vec<Way>>,
    /// Source particles.
    pub particles: u64,
    pub shares: Vec<Share>,
}

impl Part {
    /// All that is below the root on a page.
    pub fn root(page: PageId, inside: bool, particles: u64) -> Part {
        let way = Way { entry: Entry { node: 0, inside }, merged: None };
        Part { ways: BTreeMap::from([(page, vec![way])]), particles, shares: Vec::new() }
    }

    /// What is below these, with what merged particles say of it.
    fn below<G: Estimated>(ways: BTreeMap<PageId, Vec<Way>>, particles: u64, gather: &G) -> Part {
        let mut found: BTreeMap<u32, f64> = BTreeMap::new();
        for Merged { batch, per_mass } in ways.values().flatten().filter_map(|way| way.merged.as_ref()) {
            // Totals are fewer than 2^32.
            gather.merged(batch, *per_mass, &mut |total, value| *found.entry(total as u32).or_default() += value);
        }
        let said = found.into_iter().map(|(total, value)| Share { total, value: value as f32 });
        // Whatever is said, the answer is right on average; what has no place in single precision says nothing.
        Part { ways, particles, shares: said.filter(|share| share.value.is_finite()).collect() }
    }

    /// How many merged particles are held for the parts of this one.
    pub fn held(&self) -> usize {
        self.ways.values().flatten().filter_map(|way| way.merged.as_ref()).map(|merged| merged.batch.len()).sum()
    }

    /// Lets go of them: what is said of this part is said of its parts, each its share.
    pub fn let_go(&mut self) {
        self.ways.values_mut().flatten().for_each(|way| way.merged = None);
    }

    /// Whether merged particles say something of it by their places.
    fn is_told(&self) -> bool {
        self.ways.values().flatten().any(|way| way.merged.is_some())
    }

    /// Leaves out pages that were seen; whether anything is left.
    pub fn is_left(&mut self, seen: &mut HashSet<PageId>) -> bool {
        self.ways.retain(|page, _| seen.insert(*page));
        !self.ways.is_empty()
    }

    /// When its turn comes: anything that has nothing to do with what it holds.
    pub fn turn(&self, draw: u64) -> u64 {
        let first = self.ways.first_key_value();
        let node = first.and_then(|(_, ways)| ways.first()).map_or(0, |way| way.entry.node);
        let page = first.map_or(0, |(page, _)| page.0);
        mix_bits((u64::from(page) << 32 | u64::from(node)).wrapping_add(GOLDEN) ^ mix_bits(draw))
    }

    /// What its chance to be drawn is in proportion to.
    fn size(&self) -> f64 {
        self.particles.max(1) as f64
    }
}

/// A part, split.
pub(super) struct Split<P> {
    /// Of its pages.
    pub known: P,
    /// Source particles of the leaves in them.
    pub particles: u64,
    /// Below them.
    pub parts: Vec<Part>,
    pub pages: u64,
}

/// Reads the pages of a part alone.
pub(super) fn split<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: &mut Part,
    gather: &G,
) -> Result<Split<G::Part>, ExploreError> {
    let mut split = Split { known: gather.part(), particles: 0, parts: Vec::new(), pages: 0 };
    for (id, ways) in std::mem::take(&mut part.ways) {
        let page = tree.read_page(id)?;
        split.pages += 1;
        if let Some(family) = families.get(page.family as usize).and_then(Option::as_ref) {
            split_page(family, &page, ways, gather, &mut split);
        }
    }
    let are_few = part.shares.len() <= MOST_PASSED_DOWN;
    for below in split.parts.iter_mut().filter(|below| are_few && !below.is_told()) {
        let share = (below.particles as f64 / part.size()).min(1.0) as f32;
        below.shares = part.shares.iter().map(|of| Share { total: of.total, value: share * of.value }).collect();
    }
    Ok(split)
}

/// Whether merged particles of each node of a page, or of the nearest node above that has some, tell of parts below it. Children come
/// after their parents.
fn tell_of_parts(page: &Page) -> Vec<bool> {
    let mut tell = vec![false; page.nodes.len()];
    for index in (0..tell.len()).rev() {
        let is_asked = |below: usize| tell[below] && page.nodes[below].encoding != Encoding::Grid;
        let mut children = page.children(index).iter().map(|child| (child.page == page.id, child.node as usize));
        let is_told = children.any(|(is_here, child)| !is_here || child < page.nodes.len() && is_asked(child));
        tell[index] = is_told;
    }
    tell
}

/// Takes the leaves of a page from where a part begins, and parts of what is below.
fn split_page<G: Estimated>(family: &FamilyQuery, page: &Page, ways: Vec<Way>, gather: &G, split: &mut Split<G::Part>) {
    let mut batch = Batch::default();
    let mut reached = vec![false; page.nodes.len()];
    let tell = tell_of_parts(page);
    let mut below = Below::default();
    let mut stack = ways;
    while let Some(Way { entry: Entry { node: index, inside }, merged }) = stack.pop() {
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
        let merged = match node.encoding {
            _ if !tell[index] => None,
            Encoding::Grid => {
                let per_mass = if node.mass > 0.0 { node.source_particles as f64 / node.mass } else { 0.0 };
                let mut own = Merged { batch: Batch::default(), per_mass };
                family.merged(page, index, node, inside, &mut own.batch);
                Some(own)
            }
            _ => merged,
        };
        let mut merged = merged.map(|merged| merged.among(page.child_bounds(index)).into_iter());
        let mut elsewhere: BTreeMap<PageId, Vec<Way>> = BTreeMap::new();
        let mut here = 0_u64;
        for (child, &bounds) in page.children(index).iter().zip(page.child_bounds(index)) {
            let way =
                Way { entry: Entry { node: child.node, inside }, merged: merged.as_mut().and_then(Iterator::next) };
            if child.page == page.id {
                let particles = page.nodes.get(child.node as usize).map_or(0, |child| child.source_particles);
                here = here.saturating_add(particles);
                stack.push(way);
            } else if inside || family.query.shapes.cover(bounds) != Cover::Outside {
                elsewhere.entry(child.page).or_default().push(way);
            }
        }
        if !elsewhere.is_empty() {
            below.add(Part::below(elsewhere, node.source_particles.saturating_sub(here), gather));
        }
    }
    split.parts.extend(below.parts.into_iter().flatten());
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
        let others: HashSet<usize> = part.ways.keys().filter_map(|page| self.of_page.get(page).copied()).collect();
        let mut others: Vec<usize> = others.into_iter().collect();
        others.sort_unstable();
        for other in others.into_iter().filter_map(|other| self.parts[other].take()) {
            part.particles = part.particles.saturating_add(other.particles);
            part.shares.extend(other.shares);
            for (page, ways) in other.ways {
                part.ways.entry(page).or_default().extend(ways);
            }
        }
        self.of_page.extend(part.ways.keys().map(|page| (*page, own)));
        self.parts.push(Some(part));
    }
}

/// A part that was drawn.
pub(super) struct Drawn<P> {
    /// Its leaves; of a way through it, each as many times as it stands for others.
    pub found: P,
    /// What was said of it.
    pub said: Vec<Share>,
    /// What was said of what lies beside the way, and what the way says of that: to be added to totals.
    pub beside: Vec<(u32, f64)>,
    /// Whether what was found is among that already, as it was before numbers of particles were rounded.
    pub is_counted: bool,
    pub particles: u64,
    pub pages: u64,
    pub is_whole: bool,
}

impl<P> Drawn<P> {
    fn new(found: P, part: &Part) -> Drawn<P> {
        let particles = part.particles;
        Drawn { found, said: Vec::new(), beside: Vec::new(), is_counted: false, particles, pages: 0, is_whole: true }
    }
}

/// Reads all of a part.
pub(super) fn read<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: Part,
    gather: &G,
    work: Work,
) -> Result<Drawn<G::Part>, ExploreError> {
    let mut drawn = Drawn::new(gather.part(), &part);
    let entries = |ways: Vec<Way>| ways.into_iter().map(|way| way.entry).collect::<Vec<Entry>>();
    let mut open: BTreeMap<PageId, Vec<Entry>> =
        part.ways.into_iter().map(|(page, ways)| (page, entries(ways))).collect();
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
pub(super) fn descend<G: Estimated>(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    part: Part,
    gather: &G,
    draw: u64,
    work: Work,
) -> Result<Drawn<G::Part>, ExploreError> {
    let mut drawn = Drawn { is_counted: true, ..Drawn::new(gather.part(), &part) };
    let mut own = vec![0.0; gather.totals()];
    let mut seen: HashSet<PageId> = part.ways.keys().copied().collect();
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
        if !here.is_left(&mut seen) {
            break;
        }
    }
    drawn.said = said.unwrap_or_default();
    Ok(drawn)
}
