//! The particles that make a field: where the leaves are that hold them, and their particles leaf by leaf,
//! through a cache of pages that has a budget.

use crate::cpu::volume::attributes::LEAST_FILLED;
use crate::cpu::volume::particles::{is_usable, scale_of_median};
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
    /// Its mass, or the volume `m / rho` that it stands for in the mean of a column; positive.
    pub weight: f64,
    /// The kernel's radius; positive.
    pub smoothing_length: f64,
    /// Its density, or its value of the column whose mean the field is.
    pub quantity: f64,
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
    /// The largest of their quantities.
    pub largest: f64,
    /// The largest of their smoothing lengths.
    pub longest: f64,
    /// How many have a smoothing length in each bin.
    all: Vec<u64>,
    /// Those among them that the spacing goes by: with a density near the isovalue, or with a value that is not below it.
    near: Vec<u64>,
    /// How many particles of a mean have a usable `rho h^3 / m` in each bin.
    ratios: Vec<u64>,
}

/// How far from the isovalue a density is near it, as a factor.
const NEAR: f64 = 2.0;

/// Bits of a single-precision number that a bin leaves out: 16 bins have the same exponent.
const BIN_BITS: u32 = 19;

/// The bin of a number that is not negative.
fn bin_of(number: f64) -> usize {
    ((number as f32).to_bits() >> BIN_BITS) as usize
}

/// The median of the numbers in bins, to 3 %.
fn median(bins: &[u64]) -> Option<f32> {
    let half = bins.iter().sum::<u64>().div_ceil(2);
    let mut below = 0_u64;
    let bin = bins.iter().position(|count| {
        below += count;
        below >= half && half > 0
    })?;
    Some(f32::from_bits((bin as u32) << BIN_BITS | 1 << (BIN_BITS - 1)))
}

impl Survey {
    fn new() -> Survey {
        let bins = || vec![0; 1 << (31 - BIN_BITS)];
        let (bounds, largest) = (Bounds::EMPTY, f64::NEG_INFINITY);
        Survey { bounds, count: 0, largest, longest: 0.0, all: bins(), near: bins(), ratios: bins() }
    }

    fn take(&mut self, particle: &Particle, isovalue: f64, is_mean: bool) {
        let reach = DVec3::splat(particle.smoothing_length);
        self.bounds = self.bounds.with(particle.position - reach).with(particle.position + reach);
        self.count += 1;
        self.largest = self.largest.max(particle.quantity);
        self.longest = self.longest.max(particle.smoothing_length);
        let bin = bin_of(particle.smoothing_length);
        self.all[bin] += 1;
        let is_near = match is_mean {
            true => particle.quantity >= isovalue,
            false => (1.0 / NEAR..=NEAR).contains(&(particle.quantity / isovalue)),
        };
        self.near[bin] += u64::from(is_near);
        if is_mean {
            let ratio = particle.smoothing_length.powi(3) / particle.weight;
            self.ratios[bin_of(ratio)] += u64::from(is_usable(&(ratio as f32)));
        }
    }

    fn add(&mut self, other: &Survey) {
        self.bounds = self.bounds.union(other.bounds);
        self.count += other.count;
        self.largest = self.largest.max(other.largest);
        self.longest = self.longest.max(other.longest);
        let bins = [(&mut self.all, &other.all), (&mut self.near, &other.near), (&mut self.ratios, &other.ratios)];
        for (sums, counts) in bins {
            sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        }
    }

    /// The median smoothing length of particles with a density near the isovalue, or with a value that is not below it; of
    /// all where there are none; to 3 %.
    pub fn median_smoothing_length(&self) -> Option<f64> {
        median(&self.near).or_else(|| median(&self.all)).map(f64::from)
    }

    /// The sum `m / rho W` below which a mean is not known: what is [`LEAST_FILLED`] of space in the unit of the densities.
    pub fn least_filled(&self) -> f64 {
        f64::from(LEAST_FILLED * median(&self.ratios).map_or(1.0, scale_of_median))
    }
}

/// A family whose particles are of the field.
struct Chosen<'a> {
    family: &'a FamilyMetadata,
    /// The column whose mean the field is; its density where there is none.
    field: Option<Column>,
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
    /// Those in a region, with distances around a periodic box or none, with a column or the density as the field, with an
    /// attribute or none. Pages take `most_bytes` of memory, or one page where it takes more.
    pub fn new(
        tree: &'a dyn Tree,
        (region, periodic): (&'a Region, Option<f64>),
        (field, attribute): (Option<&str>, Option<&str>),
        most_bytes: u64,
        work: Work<'a>,
    ) -> Result<Particles<'a>, ExploreError> {
        let columns = field.into_iter().chain(attribute).map(str::to_owned).collect();
        let wanted = Wanted { columns, ..Wanted::default() };
        let shapes = Query::new(Data::Pages(tree), Of::Region(region), wanted, periodic)?.shapes;
        let chosen = |family: &'a FamilyMetadata| {
            if region.leaves_out(family.name) {
                return None;
            }
            let field = match field {
                None => None,
                // Particles without a value are not there for its field.
                Some(name) => Some(column(family, name)?.0),
            };
            let ranges = region.ranges.iter().map(|range| Some((column(family, &range.field)?.0, range)));
            Some(Chosen {
                family,
                field,
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
        let chosen = self.families.get(page.family as usize).and_then(Option::as_ref);
        let is_mean = chosen.is_some_and(|chosen| chosen.field.is_some());
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
                    listed.survey.take(particle, isovalue, is_mean);
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
        let is_mean = chosen.field.is_some();
        let weight = |mass: f64, density: f32| if is_mean { mass / f64::from(density) } else { mass };
        let mut offer = |particle: Particle| {
            let is_size = |number: f64| number > 0.0 && number.is_finite();
            let is_known = !is_mean || particle.quantity.is_finite();
            let is_whole = is_size(particle.weight) && is_size(particle.smoothing_length) && is_known;
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
            let quantities = chosen.field.unwrap_or(Column::Density).of(values);
            for (i, &position) in held.positions.iter().enumerate() {
                let is_in = |(column, range): &(Column, &ValueRange)| {
                    range.contains(column.of(values).get(i).map_or(f64::NAN, |&value| f64::from(value)))
                };
                if !chosen.ranges.iter().all(is_in) {
                    continue;
                }
                offer(Particle {
                    position: DVec3::from(position),
                    weight: weight(f64::from(values.mass[i]), values.density[i]),
                    smoothing_length: f64::from(values.smoothing_length[i]),
                    quantity: quantities.get(i).map_or(f64::NAN, |&value| f64::from(value)),
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
        let quantities = chosen.field.unwrap_or(Column::Density).of(codebook);
        let (scale, frame) = (f64::from(node.mass_scale), LeafFrame::of(node));
        let scale_of = |column: Option<Column>| if column == Some(Column::Mass) { scale } else { 1.0 };
        let (of_quantity, of_attribute) = (scale_of(chosen.field), scale_of(chosen.attribute));
        for (i, &code) in particles.codes.iter().enumerate() {
            let code = usize::from(code);
            if accepted.is_some_and(|codes| codes.get(code).is_some_and(|code| !code.inside)) {
                continue;
            }
            let entry = (codebook.mass.get(code), codebook.smoothing_length.get(code), codebook.density.get(code));
            let (Some(&mass), Some(&smoothing_length), Some(&density)) = entry else { continue };
            offer(Particle {
                position: frame.at(particles.fraction(i)),
                weight: weight(f64::from(mass) * scale, density),
                smoothing_length: f64::from(smoothing_length),
                quantity: quantities.get(code).map_or(f64::NAN, |&value| f64::from(value)) * of_quantity,
                attribute: attribute(column, code) * of_attribute,
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(crate::cases::cases(128))]

        /// Whatever single precision has, and ratios that it has not.
        #[test]
        fn any_particles_have_a_filling_below_which_their_mean_is_not_known(
            particles in prop::collection::vec(prop::array::uniform3(1..f32::INFINITY.to_bits()), 1..4),
        ) {
            let mut survey = Survey::new();
            for numbers in particles {
                let [smoothing_length, mass, density] = numbers.map(|bits| f64::from(f32::from_bits(bits)));
                let position = DVec3::ZERO;
                let particle =
                    Particle { position, weight: mass / density, smoothing_length, quantity: 1.0, attribute: 0.0 };
                survey.take(&particle, 1.0, true);
            }
            let least = survey.least_filled();
            prop_assert!(least > 0.0 && least.is_finite(), "{least}");
        }
    }
}
