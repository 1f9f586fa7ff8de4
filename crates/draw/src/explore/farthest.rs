//! The farthest particle from a place. Of a tree only what may hold it is read: what is farthest by its box comes first, until no other
//! box reaches beyond what was found.

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::paged::{Entry, FamilyQuery, families};
use super::query::{Of, Query, Wanted};
use super::shape::Cover;
use crate::model::Bounds;
use crate::store::{NodeRef, PageId, Tree};
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap, HashSet};

/// Pages that are read at a time.
const AT_ONCE: usize = 8;

/// Distance from a place to the farthest particle; 0 of none.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read.
pub fn farthest<'a>(data: Data, of: impl Into<Of<'a>>, center: DVec3, work: Work) -> Result<f64, ExploreError> {
    let query = Query::new(data, of.into(), Wanted::default(), None)?;
    let squared = match data {
        Data::Pages(tree) if query.region().is_some() => in_tree(tree, &query, center, work)?,
        _ => query.ask(data, &Farthest { center }, work)?,
    };
    Ok(squared.sqrt())
}

struct Farthest {
    center: DVec3,
}

impl Gather for Farthest {
    /// The squared distance.
    type Part = f64;

    fn part(&self) -> f64 {
        0.0
    }

    fn take(&self, part: &mut f64, batch: &Batch) {
        *part = batch.positions.iter().map(|at| at.distance_squared(self.center)).fold(*part, f64::max);
    }

    fn join(&self, whole: &mut f64, next: f64) -> Result<(), ExploreError> {
        *whole = whole.max(next);
        Ok(())
    }
}

/// Nodes of a page to look at.
struct Open {
    /// Nothing there is farther: a squared distance.
    bound: f64,
    page: PageId,
    entries: Vec<Entry>,
}

impl PartialEq for Open {
    fn eq(&self, other: &Open) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Open) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Open) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

/// The squared distance of the farthest corner of a box.
fn reach(bounds: Bounds, center: DVec3) -> f64 {
    (center - bounds.min).abs().max((bounds.max - center).abs()).length_squared()
}

/// The squared distance of the farthest particle of a tree.
fn in_tree(tree: &dyn Tree, query: &Query, center: DVec3, work: Work) -> Result<f64, ExploreError> {
    let families = families(tree, query);
    let gather = Farthest { center };
    work.progress.begin("looking for the farthest particle", 0);
    let inside = query.shapes.are_everywhere();
    let root = |family: &FamilyQuery| Open {
        bound: f64::INFINITY,
        page: family.family.root_page,
        entries: vec![Entry { node: 0, inside }],
    };
    let mut open: BinaryHeap<Open> = families.iter().flatten().map(root).collect();
    let mut found = 0.0_f64;
    // Every node of a sound file is reached once; a file that was made to harm may lead to one many times.
    let mut seen: HashSet<NodeRef> = HashSet::new();
    loop {
        work.go_on()?;
        let next = || open.pop().filter(|open| open.bound > found);
        let wave: Vec<Open> = std::iter::from_fn(next).take(AT_ONCE).collect();
        if wave.is_empty() {
            return Ok(found);
        }
        let looked: Vec<Result<(f64, Vec<Open>), ExploreError>> =
            wave.into_par_iter().map(|open| look(tree, &families, open, &gather, found)).collect();
        for looked in looked {
            let (farthest, below) = looked?;
            found = found.max(farthest);
            for mut below in below {
                let page = below.page;
                below.entries.retain(|entry| seen.insert(NodeRef { page, node: entry.node }));
                if !below.entries.is_empty() {
                    open.push(below);
                }
            }
        }
    }
}

/// The farthest particle of a page from its entries on, where one is farther than `found`; and what may have a farther one below.
fn look(
    tree: &dyn Tree,
    families: &[Option<FamilyQuery>],
    open: Open,
    gather: &Farthest,
    mut found: f64,
) -> Result<(f64, Vec<Open>), ExploreError> {
    let page = tree.read_page(open.page)?;
    let Some(family) = families.get(page.family as usize).and_then(Option::as_ref) else {
        return Ok((found, Vec::new()));
    };
    let shapes = &family.query.shapes;
    let mut batch = Batch::default();
    let mut reached = vec![false; page.nodes.len()];
    let mut below: BTreeMap<PageId, Open> = BTreeMap::new();
    let mut stack = open.entries;
    while let Some(Entry { node: index, inside }) = stack.pop() {
        let index = index as usize;
        let Some(node) = page.nodes.get(index) else { continue };
        if std::mem::replace(&mut reached[index], true) || reach(node.bounds, gather.center) <= found {
            continue;
        }
        let cover = if inside { Cover::Inside } else { shapes.cover(node.bounds) };
        if cover == Cover::Outside {
            continue;
        }
        let inside = cover == Cover::Inside;
        if node.is_leaf() {
            family.leaf(&page, index, node, inside, &mut batch);
            gather.take(&mut found, &batch);
            continue;
        }
        for (child, &bounds) in page.children(index).iter().zip(page.child_bounds(index)) {
            let entry = Entry { node: child.node, inside };
            if child.page == page.id {
                stack.push(entry);
            } else if inside || shapes.cover(bounds) != Cover::Outside {
                let none = || Open { bound: 0.0, page: child.page, entries: Vec::new() };
                let open = below.entry(child.page).or_insert_with(none);
                open.bound = open.bound.max(reach(bounds, gather.center));
                open.entries.push(entry);
            }
        }
    }
    Ok((found, below.into_values().collect()))
}
