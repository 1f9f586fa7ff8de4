//! Questions to a tree: it is walked from the roots, nodes outside the region are left aside by their boxes, nodes inside
//! count as a whole where sums are enough, and leaves are decoded otherwise. Pages are read and decoded in parallel, a few at a time.

use super::batch::{Batch, Gather, Work};
use super::data::{Column, column, error_scale};
use super::error::ExploreError;
use super::query::{Of, Query};
use super::region::ValueRange;
use super::shape::Cover;
use crate::codec::{Codebook, CodebookScope};
use crate::store::{Content, FamilyMetadata, Node, NodeRef, Page, PageId, Positions, Tree};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};

/// Pages of a thread that are in memory at once.
const AHEAD: usize = 2;

/// Asks a tree.
pub(super) fn walk<G: Gather>(tree: &dyn Tree, query: &Query, gather: &G, work: Work) -> Result<G::Part, ExploreError> {
    if matches!(query.of, Of::Ids(_)) || query.wanted.ids || query.wanted.rows {
        let expected = "the source that the file was built from";
        return Err(ExploreError::missing(tree.path(), "particle ids", expected));
    }
    let metadata = tree.metadata();
    let families = families(tree, query);
    let asked = || metadata.families.iter().zip(&families).filter(|(_, family)| family.is_some());
    let total = asked().map(|(family, _)| family.count).fold(0, u64::saturating_add);
    work.progress.begin("reading pages", total);

    let mut whole = gather.part();
    let mut open: BTreeMap<PageId, Vec<Entry>> = BTreeMap::new();
    for (family, _) in asked() {
        open.entry(family.root_page).or_default().push(Entry { node: 0, inside: query.shapes.are_everywhere() });
    }
    // Every node of a sound file is reached once; a file that was made to harm may lead to one many times.
    let mut seen: HashSet<NodeRef> = HashSet::new();
    let mut dealt_with = 0_u64;
    while !open.is_empty() {
        work.go_on()?;
        let mut wave = Vec::new();
        while wave.len() < AHEAD * rayon::current_num_threads() {
            let Some(next) = open.pop_first() else { break };
            wave.push(next);
        }
        let walked: Vec<Result<Walked<G::Part>, ExploreError>> = wave
            .into_par_iter()
            .map(|(id, entries)| {
                work.go_on()?;
                let page = tree.read_page(id)?;
                let family = families.get(page.family as usize).and_then(Option::as_ref);
                let Some(family) = family else { return Ok(Walked::new(gather.part())) };
                let walked = family.page(&page, entries, gather);
                work.progress.advance(walked.dealt_with);
                Ok(walked)
            })
            .collect();
        for walked in walked {
            let walked = walked?;
            gather.join(&mut whole, walked.part)?;
            dealt_with = dealt_with.saturating_add(walked.dealt_with);
            for (child, inside) in walked.elsewhere {
                if seen.insert(child) {
                    open.entry(child.page).or_default().push(Entry { node: child.node, inside });
                }
            }
        }
    }
    // Children outside the region were not even read.
    work.progress.advance(total.saturating_sub(dealt_with));
    Ok(whole)
}

/// The question to each family of a tree; `None` to one that the region leaves out.
pub(super) fn families<'a>(tree: &'a dyn Tree, query: &'a Query<'a>) -> Vec<Option<FamilyQuery<'a>>> {
    let families = tree.metadata().families.iter().enumerate();
    families.map(|(index, family)| FamilyQuery::new(query, index, family)).collect()
}

/// A node to look at.
pub(super) struct Entry {
    pub node: u32,
    /// Whether all of it is known to be inside the region's shapes.
    pub inside: bool,
}

/// What came of a page.
pub(super) struct Walked<P> {
    pub part: P,
    pub elsewhere: Vec<(NodeRef, bool)>,
    pub dealt_with: u64,
}

impl<P> Walked<P> {
    fn new(part: P) -> Walked<P> {
        Walked { part, elsewhere: Vec::new(), dealt_with: 0 }
    }
}

/// How a code of a codebook stands to the value ranges.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Accepted {
    /// Whether its values are in every range.
    pub inside: bool,
    /// Whether the source's values may be on the other side of an end.
    pub uncertain: bool,
}

/// A question to one family.
pub(super) struct FamilyQuery<'a> {
    pub query: &'a Query<'a>,
    index: usize,
    pub family: &'a FamilyMetadata,
    columns: Vec<Option<Column>>,
    velocity: Option<[Column; 3]>,
    /// By codebook and code; empty where there are no ranges.
    accepted: Vec<Vec<Accepted>>,
}

impl<'a> FamilyQuery<'a> {
    /// `None` where the region leaves out the family.
    pub(super) fn new(query: &'a Query<'a>, index: usize, family: &'a FamilyMetadata) -> Option<FamilyQuery<'a>> {
        let region = query.region()?;
        if region.leaves_out(family.name) {
            return None;
        }
        let columns = query.wanted.columns.iter().map(|name| Some(column(family, name)?.0)).collect();
        let axis = |name: &str| Some(column(family, name)?.0);
        let velocity = || Some([axis("velocity-x")?, axis("velocity-y")?, axis("velocity-z")?]);
        let accepted = accepted(family, &region.ranges)?;
        Some(FamilyQuery {
            query,
            index,
            family,
            columns,
            velocity: query.wanted.velocities.then(velocity).flatten(),
            accepted,
        })
    }

    /// Walks the nodes of a page from its entries.
    pub(super) fn page<G: Gather>(&self, page: &Page, entries: Vec<Entry>, gather: &G) -> Walked<G::Part> {
        let mut walked = Walked::new(gather.part());
        let mut batch = Batch::default();
        let mut reached = vec![false; page.nodes.len()];
        let whole_nodes = gather.takes_nodes() && self.accepted.is_empty();
        let mut stack = entries;
        while let Some(Entry { node: index, inside }) = stack.pop() {
            let Some(node) = page.nodes.get(index as usize) else { continue };
            if std::mem::replace(&mut reached[index as usize], true) {
                continue;
            }
            let cover = if inside { Cover::Inside } else { self.query.shapes.cover(node.bounds) };
            let inside = cover == Cover::Inside;
            if cover == Cover::Outside {
                walked.dealt_with = walked.dealt_with.saturating_add(node.source_particles);
            } else if inside && whole_nodes {
                gather.take_node(&mut walked.part, self.index, node.source_particles, node.mass);
                walked.dealt_with = walked.dealt_with.saturating_add(node.source_particles);
            } else if node.is_leaf() {
                self.leaf(page, index as usize, node, inside, &mut batch);
                gather.take(&mut walked.part, &batch);
                walked.dealt_with = walked.dealt_with.saturating_add(node.source_particles);
            } else {
                // Pushed in reverse, so that the particles come in Morton order.
                let children = page.children(index as usize).iter().zip(page.child_bounds(index as usize));
                for (child, &bounds) in children.rev() {
                    if child.page == page.id {
                        stack.push(Entry { node: child.node, inside });
                    } else if inside || self.query.shapes.cover(bounds) != Cover::Outside {
                        walked.elsewhere.push((*child, inside));
                    }
                }
            }
        }
        walked
    }

    /// Fills the batch with the members in a leaf whose values are not coded: they are what the tree has, when the leaf begins.
    fn own<'b>(&self, content: &dyn Content, (page, index): (&Page, usize), inside: bool, batch: &mut Batch<'b>) {
        let held = content.particles(page.nodes[index].start());
        let Some(region) = self.query.region() else { return };
        let value =
            |column: Column, i: usize| column.of(&held.values).get(i).map_or(f64::NAN, |&value| f64::from(value));
        let ranges: Vec<_> = region.ranges.iter().map(|range| (column(self.family, &range.field), range)).collect();
        let key = (u64::from(page.id.0) << 32 | index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let is_member = |i: &usize| {
            let is_in = |(column, range): &(Option<(Column, _)>, &ValueRange)| {
                column.as_ref().is_some_and(|&(column, _)| range.contains(value(column, *i)))
            };
            (inside || self.query.shapes.contains(DVec3::from(held.positions[*i]))) && ranges.iter().all(is_in)
        };
        let members: Vec<usize> = (0..held.len()).filter(is_member).collect();
        batch.positions.extend(members.iter().map(|&i| DVec3::from(held.positions[i])));
        batch.keys.extend(members.iter().map(|&i| key.wrapping_add(i as u64)));
        batch.relative.extend(batch.positions.iter().map(|&at| self.query.shapes.relative(at)));
        batch.mass.extend(members.iter().map(|&i| f64::from(held.values.mass[i])));
        for (column, out) in self.columns.iter().zip(&mut batch.columns) {
            if let Some(column) = column {
                out.extend(members.iter().map(|&i| value(*column, i)));
            }
        }
        if let Some([x, y, z]) = self.velocity {
            batch.velocities.extend(members.iter().map(|&i| DVec3::new(value(x, i), value(y, i), value(z, i))));
        }
    }

    /// Fills places, masses and columns of the batch with those of the merged particles of a node that are members by what their means say. Their
    /// masses add up to the node's, where all are members.
    pub(super) fn merged(&self, page: &Page, index: usize, node: &Node, inside: bool, batch: &mut Batch) {
        batch.clear(self.columns.len());
        batch.family = self.index;
        batch.errors = &[];
        let Some(codebook) = self.family.codebooks.get(usize::from(node.codebook)) else { return };
        let particles = page.particles(index);
        let Positions::Grid(_) = particles.positions else { return };
        let (place, scale) = (LeafFrame::of(node), f64::from(node.mass_scale));
        let is_member = |i: usize, code: u16| {
            let is_accepted = self.is_accepted(usize::from(node.codebook), usize::from(code));
            is_accepted && (inside || self.query.shapes.contains(place.at(particles.fraction(i))))
        };
        let mut codes = Vec::with_capacity(particles.len());
        for (i, &code) in particles.codes.iter().enumerate().filter(|&(i, &code)| is_member(i, code)) {
            codes.push(code);
            batch.positions.push(place.at(particles.fraction(i)));
        }
        batch.relative.extend(batch.positions.iter().map(|&at| self.query.shapes.relative(at)));
        let value =
            |values: &[f32], code: u16| values.get(usize::from(code)).map_or(f64::NAN, |&value| f64::from(value));
        batch.mass.extend(codes.iter().map(|&code| value(&codebook.mass, code) * scale));
        for (column, out) in self.columns.iter().zip(&mut batch.columns) {
            if let Some(column) = column {
                out.extend(codes.iter().map(|&code| value(column.of(codebook), code)));
            }
        }
    }

    /// Whether the values of a code are in every range.
    fn is_accepted(&self, codebook: usize, code: usize) -> bool {
        self.accepted.get(codebook).is_none_or(|codes| codes.get(code).is_some_and(|code| code.inside))
    }

    /// Hands over, by column, what particles of leaves are coded with whose values are in every range.
    pub(super) fn leaf_values(&self, mut take: impl FnMut(usize, f64)) {
        let of_leaves = |(_, codebook): &(usize, &Codebook)| codebook.scope == CodebookScope::Leaves;
        for (number, codebook) in self.family.codebooks.iter().enumerate().filter(of_leaves) {
            for (index, column) in self.columns.iter().enumerate() {
                let Some(column) = column else { continue };
                let values = column.of(codebook).iter().enumerate();
                let accepted = values.filter(|&(code, _)| self.is_accepted(number, code));
                accepted.for_each(|(_, &value)| take(index, f64::from(value)));
            }
        }
    }

    /// Fills the batch with the members in a leaf.
    pub(super) fn leaf<'b>(&self, page: &Page, index: usize, node: &Node, inside: bool, batch: &mut Batch<'b>)
    where
        'a: 'b,
    {
        batch.clear(self.columns.len());
        batch.family = self.index;
        if let Some(content) = page.content(index) {
            return self.own(content, (page, index), inside, batch);
        }
        let Some(codebook) = self.family.codebooks.get(usize::from(node.codebook)) else { return };
        batch.errors = &codebook.errors;
        let accepted = self.accepted.get(usize::from(node.codebook));
        let particles = page.particles(index);
        let Positions::Leaf(_) = particles.positions else { return };
        let scale = f64::from(node.mass_scale);
        let place = LeafFrame::of(node);
        let mass_of = |code: u16| codebook.mass.get(usize::from(code)).map_or(0.0, |&mass| f64::from(mass)) * scale;
        let mut codes = Vec::with_capacity(particles.len());
        let key = (u64::from(page.id.0) << 32 | index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        for (i, &code) in particles.codes.iter().enumerate() {
            let by_value = accepted.and_then(|codes| codes.get(usize::from(code)).copied());
            let by_value = by_value.unwrap_or(Accepted { inside: true, uncertain: false });
            if !by_value.inside && !by_value.uncertain {
                continue;
            }
            let at = place.at(particles.fraction(i));
            let reach = particles.rounding(i) * place.size + place.ulp;
            let contained = inside || self.query.shapes.contains(at);
            let near = !inside && self.query.shapes.is_near_surface(at, reach);
            if near || by_value.uncertain && contained {
                batch.uncertain.count += 1;
                batch.uncertain.mass += mass_of(code);
            }
            batch.uncertain.position = batch.uncertain.position.max(reach);
            if contained && by_value.inside {
                codes.push(code);
                batch.positions.push(at);
                batch.keys.push(key.wrapping_add(i as u64));
            }
        }
        batch.relative.extend(batch.positions.iter().map(|&at| self.query.shapes.relative(at)));
        batch.mass.extend(codes.iter().map(|&code| mass_of(code)));
        let gather = |column: Column, out: &mut Vec<f64>| {
            let values = column.of(codebook);
            out.extend(codes.iter().map(|&code| values.get(usize::from(code)).map_or(f64::NAN, |&v| f64::from(v))));
        };
        for (column, out) in self.columns.iter().zip(&mut batch.columns) {
            if let Some(column) = column {
                gather(*column, out);
            }
        }
        if let Some(axes) = self.velocity {
            let mut columns = [Vec::new(), Vec::new(), Vec::new()];
            axes.into_iter().zip(&mut columns).for_each(|(axis, out)| gather(axis, out));
            let [x, y, z] = columns;
            batch.velocities.extend(x.iter().zip(&y).zip(&z).map(|((&x, &y), &z)| DVec3::new(x, y, z)));
        }
    }
}

/// A leaf's frame in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct LeafFrame {
    corner: DVec3,
    /// Edge of the frame, world units.
    pub size: f64,
    /// Rounding of world coordinates here.
    pub ulp: f64,
}

impl LeafFrame {
    pub(super) fn of(node: &Node) -> LeafFrame {
        let (corner, size) = (node.frame.min, node.frame.size);
        LeafFrame { corner, size, ulp: (corner.abs().max_element() + size) * 4.0 * f64::EPSILON }
    }

    /// The world position of a fraction of the frame.
    #[inline]
    pub(super) fn at(&self, fraction: [f32; 3]) -> DVec3 {
        self.corner + DVec3::from_array(fraction.map(f64::from)) * self.size
    }
}

/// How each code of each codebook stands to the ranges; empty for no ranges, `None` where the family lacks one of the fields.
pub(super) fn accepted(family: &FamilyMetadata, ranges: &[ValueRange]) -> Option<Vec<Vec<Accepted>>> {
    let columns: Vec<(Column, &ValueRange)> =
        ranges.iter().map(|range| Some((column(family, &range.field)?.0, range))).collect::<Option<_>>()?;
    if columns.is_empty() {
        return Some(Vec::new());
    }
    let of_codebook = |codebook: &Codebook| {
        let of_code = |code: usize| {
            let mut accepted = Accepted { inside: true, uncertain: false };
            for &(column, range) in &columns {
                let value = column.of(codebook).get(code).map_or(f64::NAN, |&value| f64::from(value));
                let error = codebook.errors.get(column.error_index()).map_or(0.0, |error| error.max);
                let (low, high) = around(value, error, error_scale(family, column));
                let inside = range.contains(value);
                let certain =
                    if inside { range.contains(low) && range.contains(high) } else { lies_apart(range, low, high) };
                if !inside && certain {
                    return Accepted { inside: false, uncertain: false };
                }
                accepted.inside &= inside;
                accepted.uncertain |= !certain;
            }
            accepted
        };
        (0..codebook.len()).map(of_code).collect()
    };
    Some(family.codebooks.iter().map(of_codebook).collect())
}

/// What a value may have been before it was coded, by the largest error, relative to it or to `scale`.
pub(super) fn around(value: f64, error: f64, scale: Option<f64>) -> (f64, f64) {
    // Values are single precision, and so is the codebook.
    let error = error + 1e-6;
    match scale {
        Some(scale) => (value - error * scale, value + error * scale),
        None => (value / (1.0 + error), if error < 1.0 { value / (1.0 - error) } else { f64::INFINITY }),
    }
}

fn lies_apart(range: &ValueRange, low: f64, high: f64) -> bool {
    range.min.is_some_and(|min| high < min) || range.max.is_some_and(|max| low > max)
}
