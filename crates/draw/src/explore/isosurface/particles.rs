//! The particles that make a density field: where the leaves are that hold them, and their particles leaf by leaf,
//! through a cache of pages that has a budget.

use crate::explore::batch::Work;
use crate::explore::data::{Column, Data, column};
use crate::explore::error::ExploreError;
use crate::explore::paged::{Accepted, LeafFrame, accepted};
use crate::explore::query::{Of, Query, Wanted};
use crate::explore::region::{Region, ValueRange};
use crate::explore::shape::{Cover, Shapes};
use crate::model::{Bounds, Kernel};
use crate::store::{FamilyMetadata, NodeRef, Page, PageId, Positions, Tree};
use glam::DVec3;
use lru::LruCache;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, Mutex, PoisonError};

/// Pages of a thread that are in memory at once while the leaves are listed.
const AHEAD: usize = 2;

/// A particle of the field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Particle {
    pub position: DVec3,
    pub mass: f64,
    /// The kernel's radius; positive.
    pub smoothing_length: f64,
    pub density: f32,
    /// The attribute whose mean is wanted; 0 where the particle has none.
    pub attribute: f64,
}

/// A leaf with particles of the field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    node: NodeRef,
    bounds: Bounds,
    /// Its particles' kernels reach at most this far out of its bounds.
    reach: f64,
    /// Whether all its particles are in the region's shapes.
    inside: bool,
}

impl Leaf {
    /// The box that its particles' kernels may reach.
    pub fn reached(&self) -> Bounds {
        Bounds { min: self.bounds.min - self.reach, max: self.bounds.max + self.reach }
    }

    /// Whether a kernel may reach a box.
    pub fn reaches(&self, bounds: &Bounds) -> bool {
        let grown = self.reached();
        grown.min.cmple(bounds.max).all() && grown.max.cmpge(bounds.min).all()
    }
}

/// What is known of all particles of the field.
#[derive(Clone, Debug)]
pub(super) struct Survey {
    /// The box around their kernels.
    pub bounds: Bounds,
    pub count: u64,
    /// The largest of their densities.
    pub densest: f32,
    /// The largest of their smoothing lengths.
    pub longest: f64,
    /// How many have a smoothing length in each bin.
    all: Vec<u64>,
    /// Those among them whose density is near the isovalue.
    near: Vec<u64>,
}

/// How far from the isovalue a density is near it, as a factor.
const NEAR: f64 = 2.0;

/// Bits of a single-precision number that a bin of smoothing lengths leaves out: 16 bins have the same exponent.
const BIN_BITS: u32 = 19;

impl Survey {
    fn new() -> Survey {
        let bins = 1 << (31 - BIN_BITS);
        let (all, near) = (vec![0; bins], vec![0; bins]);
        Survey { bounds: Bounds::EMPTY, count: 0, densest: 0.0, longest: 0.0, all, near }
    }

    fn take(&mut self, particle: &Particle, isovalue: f64) {
        let reach = DVec3::splat(particle.smoothing_length);
        self.bounds = self.bounds.with(particle.position - reach).with(particle.position + reach);
        self.count += 1;
        self.densest = self.densest.max(particle.density);
        self.longest = self.longest.max(particle.smoothing_length);
        let bin = ((particle.smoothing_length as f32).to_bits() >> BIN_BITS) as usize;
        self.all[bin] += 1;
        let ratio = f64::from(particle.density) / isovalue;
        self.near[bin] += u64::from((1.0 / NEAR..=NEAR).contains(&ratio));
    }

    fn add(&mut self, other: &Survey) {
        self.bounds = self.bounds.union(other.bounds);
        self.count += other.count;
        self.densest = self.densest.max(other.densest);
        self.longest = self.longest.max(other.longest);
        self.all.iter_mut().zip(&other.all).for_each(|(sum, count)| *sum += count);
        self.near.iter_mut().zip(&other.near).for_each(|(sum, count)| *sum += count);
    }

    /// The median smoothing length of particles with a density near the isovalue, of all where there are none; to 3 %.
    pub fn median_smoothing_length(&self) -> Option<f64> {
        let median = |bins: &[u64]| {
            let half = bins.iter().sum::<u64>().div_ceil(2);
            let mut below = 0_u64;
            let bin = bins.iter().position(|count| {
                below += count;
                below >= half && half > 0
            })?;
            let middle = (bin as u32) << BIN_BITS | 1 << (BIN_BITS - 1);
            Some(f64::from(f32::from_bits(middle)))
        };
        median(&self.near).or_else(|| median(&self.all))
    }
}

/// A family whose particles are of the field.
struct Chosen<'a> {
    family: &'a FamilyMetadata,
    attribute: Option<Column>,
    ranges: Vec<(Column, &'a ValueRange)>,
    /// By codebook and code; empty where there are no ranges.
    accepted: Vec<Vec<Accepted>>,
}

/// Pages that were read, the one that was used longest ago first out.
struct Pages {
    held: LruCache<PageId, Arc<Page>>,
    bytes: u64,
}

/// The particles of a tree in a region.
pub(super) struct Particles<'a> {
    tree: &'a dyn Tree,
    work: Work<'a>,
    shapes: Shapes,
    /// By family of the tree; `None` for those that the region leaves out.
    families: Vec<Option<Chosen<'a>>>,
    pages: Mutex<Pages>,
    /// Bytes of pages in memory.
    most_bytes: u64,
}

impl<'a> Particles<'a> {
    /// Those in a region, with distances around a periodic box or none, with an attribute or none. Pages take
    /// `most_bytes` of memory, or one page where it takes more.
    pub fn new(
        tree: &'a dyn Tree,
        (region, periodic): (&'a Region, Option<f64>),
        attribute: Option<&str>,
        most_bytes: u64,
        work: Work<'a>,
    ) -> Result<Particles<'a>, ExploreError> {
        let wanted = Wanted { columns: attribute.into_iter().map(str::to_owned).collect(), ..Wanted::default() };
        let shapes = Query::new(Data::Pages(tree), Of::Region(region), wanted, periodic)?.shapes;
        let chosen = |family: &'a FamilyMetadata| {
            if region.leaves_out(family.name) {
                return None;
            }
            let ranges = region.ranges.iter().map(|range| Some((column(family, &range.field)?.0, range)));
            Some(Chosen {
                family,
                attribute: attribute.and_then(|name| Some(column(family, name)?.0)),
                ranges: ranges.collect::<Option<_>>()?,
                accepted: accepted(family, &region.ranges)?,
            })
        };
        let families = tree.metadata().families.iter().map(chosen).collect();
        let pages = Mutex::new(Pages { held: LruCache::unbounded(), bytes: 0 });
        Ok(Particles { tree, work, shapes, families, pages, most_bytes })
    }

    /// The kernel that the smoothing lengths belong to.
    pub fn kernel(&self) -> Kernel {
        self.tree.metadata().kernel
    }

    /// # Errors
    /// [`ExploreError::Stopped`] where whoever asked no longer wants the answer.
    pub fn go_on(&self) -> Result<(), ExploreError> {
        self.work.go_on()
    }

    /// Reads every page once: the leaves, in the order of their pages, and what is known of their particles.
    pub fn survey(&self, isovalue: f64) -> Result<(Vec<Leaf>, Survey), ExploreError> {
        let families = &self.tree.metadata().families;
        let asked = || families.iter().zip(&self.families).filter(|(_, chosen)| chosen.is_some());
        let total = asked().map(|(family, _)| family.count).fold(0, u64::saturating_add);
        self.work.progress.begin("reading pages", total);
        let (mut leaves, mut survey) = (Vec::new(), Survey::new());
        let mut open: BTreeMap<PageId, Vec<(u32, bool)>> = BTreeMap::new();
        for (family, _) in asked() {
            open.entry(family.root_page).or_default().push((0, self.shapes.are_everywhere()));
        }
        // Every node of a sound file is reached once; a file that was made to harm may lead to one many times.
        let mut seen: HashSet<NodeRef> = HashSet::new();
        while !open.is_empty() {
            let mut wave = Vec::new();
            while wave.len() < AHEAD * rayon::current_num_threads() {
                let Some(next) = open.pop_first() else { break };
                wave.push(next);
            }
            let listed: Vec<Result<Listed, ExploreError>> =
                wave.into_par_iter().map(|(id, entries)| self.list(id, entries, isovalue)).collect();
            for listed in listed {
                let listed = listed?;
                leaves.extend(listed.leaves);
                survey.add(&listed.survey);
                for (child, inside) in listed.elsewhere {
                    if seen.insert(child) {
                        open.entry(child.page).or_default().push((child.node, inside));
                    }
                }
            }
        }
        leaves.sort_unstable_by_key(|leaf| leaf.node);
        Ok((leaves, survey))
    }

    /// The leaves of a page below some of its nodes.
    fn list(&self, id: PageId, mut stack: Vec<(u32, bool)>, isovalue: f64) -> Result<Listed, ExploreError> {
        self.work.go_on()?;
        let page = self.page(id)?;
        let mut listed = Listed { leaves: Vec::new(), survey: Survey::new(), elsewhere: Vec::new() };
        let mut reached = vec![false; page.nodes.len()];
        let mut dealt_with = 0_u64;
        while let Some((index, inside)) = stack.pop() {
            let Some(node) = page.nodes.get(index as usize) else { continue };
            if std::mem::replace(&mut reached[index as usize], true) {
                continue;
            }
            let cover = if inside { Cover::Inside } else { self.shapes.cover(node.bounds) };
            let inside = cover == Cover::Inside;
            if cover == Cover::Outside {
                dealt_with = dealt_with.saturating_add(node.source_particles);
            } else if node.is_leaf() {
                let place = NodeRef { page: id, node: index };
                let reach = f64::from(node.smoothing_length_max);
                let leaf = Leaf { node: place, bounds: node.bounds, reach, inside };
                let before = listed.survey.count;
                let mut largest = reach;
                self.visit(&leaf, &page, &mut |particle: &Particle| {
                    listed.survey.take(particle, isovalue);
                    largest = largest.max(particle.smoothing_length);
                });
                if listed.survey.count > before {
                    listed.leaves.push(Leaf { reach: largest, ..leaf });
                }
                dealt_with = dealt_with.saturating_add(node.source_particles);
            } else {
                for (child, &bounds) in page.children(index as usize).iter().zip(page.child_bounds(index as usize)) {
                    if child.page == page.id {
                        stack.push((child.node, inside));
                    } else if inside || self.shapes.cover(bounds) != Cover::Outside {
                        listed.elsewhere.push((*child, inside));
                    }
                }
            }
        }
        self.work.progress.advance(dealt_with);
        Ok(listed)
    }

    /// Calls `take` for each particle of these leaves, in their order.
    pub fn each<'l>(
        &self,
        leaves: impl IntoIterator<Item = &'l Leaf>,
        mut take: impl FnMut(&Particle),
    ) -> Result<(), ExploreError> {
        let mut held: Option<Arc<Page>> = None;
        for leaf in leaves {
            let page = match held.take() {
                Some(page) if page.id == leaf.node.page => page,
                _ => self.page(leaf.node.page)?,
            };
            self.visit(leaf, &page, &mut take);
            held = Some(page);
        }
        Ok(())
    }

    /// A page, from memory where it is there.
    fn page(&self, id: PageId) -> Result<Arc<Page>, ExploreError> {
        let known = self.pages.lock().unwrap_or_else(PoisonError::into_inner).held.get(&id).cloned();
        if let Some(page) = known {
            return Ok(page);
        }
        // Others may read it at the same time; nobody waits for a disk with the lock.
        let page = Arc::new(self.tree.read_page(id)?);
        let mut pages = self.pages.lock().unwrap_or_else(PoisonError::into_inner);
        pages.bytes += page.memory();
        if let Some(same) = pages.held.put(id, Arc::clone(&page)) {
            pages.bytes -= same.memory();
        }
        while pages.bytes > self.most_bytes && pages.held.len() > 1 {
            let Some((_, oldest)) = pages.held.pop_lru() else { break };
            pages.bytes -= oldest.memory();
        }
        Ok(page)
    }

    /// Calls `take` for each particle of a leaf that is of the field.
    fn visit(&self, leaf: &Leaf, page: &Page, take: &mut impl FnMut(&Particle)) {
        let Some(chosen) = self.families.get(page.family as usize).and_then(Option::as_ref) else { return };
        let index = leaf.node.node as usize;
        let Some(node) = page.nodes.get(index) else { return };
        let mut offer = |particle: Particle| {
            let is_whole =
                particle.mass > 0.0 && particle.smoothing_length > 0.0 && particle.smoothing_length.is_finite();
            if is_whole && particle.position.is_finite() && (leaf.inside || self.shapes.contains(particle.position)) {
                take(&particle);
            }
        };
        let attribute = |of: &[f32], i: usize| {
            let value = of.get(i).map_or(0.0, |&value| f64::from(value));
            if value.is_finite() { value } else { 0.0 }
        };
        if let Some(content) = page.content(index) {
            let held = content.particles(node.start());
            let values = &held.values;
            let column = chosen.attribute.map_or(&[] as &[f32], |column| column.of(values));
            for (i, &position) in held.positions.iter().enumerate() {
                let is_in = |(column, range): &(Column, &ValueRange)| {
                    range.contains(column.of(values).get(i).map_or(f64::NAN, |&value| f64::from(value)))
                };
                if !chosen.ranges.iter().all(is_in) {
                    continue;
                }
                offer(Particle {
                    position: DVec3::from(position),
                    mass: f64::from(values.mass[i]),
                    smoothing_length: f64::from(values.smoothing_length[i]),
                    density: values.density[i],
                    attribute: attribute(column, i),
                });
            }
            return;
        }
        let Some(codebook) = chosen.family.codebooks.get(usize::from(node.codebook)) else { return };
        let accepted = chosen.accepted.get(usize::from(node.codebook));
        let particles = page.particles(index);
        let Positions::Leaf(_) = particles.positions else { return };
        let column = chosen.attribute.map_or(&[] as &[f32], |column| column.of(codebook));
        let (scale, frame) = (f64::from(node.mass_scale), LeafFrame::of(node));
        for (i, &code) in particles.codes.iter().enumerate() {
            let code = usize::from(code);
            if accepted.is_some_and(|codes| codes.get(code).is_some_and(|code| !code.inside)) {
                continue;
            }
            let entry = (codebook.mass.get(code), codebook.smoothing_length.get(code), codebook.density.get(code));
            let (Some(&mass), Some(&smoothing_length), Some(&density)) = entry else { continue };
            offer(Particle {
                position: frame.at(particles.fraction(i)),
                mass: f64::from(mass) * scale,
                smoothing_length: f64::from(smoothing_length),
                density,
                attribute: attribute(column, code),
            });
        }
    }
}

/// What a page's leaves are.
struct Listed {
    leaves: Vec<Leaf>,
    survey: Survey,
    /// Nodes of other pages, and whether all of each is inside.
    elsewhere: Vec<(NodeRef, bool)>,
}
