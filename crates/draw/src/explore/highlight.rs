//! Which of a node's particles are in a selection's region: what renderers need to draw them in its colour, or alone.

use super::data::{Column, column};
use super::error::ExploreError;
use super::paged::{Accepted, LeafFrame, accepted};
use super::places::{PlaceMarks, Places};
use super::region::{Region, ValueRange};
use super::shape::{Cover, Shapes};
use crate::store::{Metadata, NodeParticles, Page, Positions};

/// A selection, ready to be held against nodes. Cheap to ask from many threads.
#[derive(Debug)]
pub struct Highlighter {
    by: By,
}

#[derive(Debug)]
enum By {
    Region(RegionMarks),
    Places(PlaceMarks),
}

/// A region.
#[derive(Debug)]
struct RegionMarks {
    shapes: Shapes,
    /// By family; `None` where no particle of it can be in the region.
    families: Vec<Option<FamilyMarks>>,
}

#[derive(Debug)]
struct FamilyMarks {
    /// By codebook, a bit for each code whose values are in the ranges; empty without ranges.
    codes: Vec<Vec<bool>>,
    ranges: Vec<(Column, ValueRange)>,
}

/// How many of a node's particles are in a selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marked {
    /// None; the bits are empty.
    None,
    /// All; the bits are empty.
    All,
    /// This many, with a bit for each particle.
    Some(u32),
}

impl Highlighter {
    /// A region over a page file, with distances around a periodic box of edge `periodic` or none.
    ///
    /// # Errors
    /// [`ExploreError::Value`] where the region makes no sense.
    pub fn new(region: &Region, metadata: &Metadata, periodic: Option<f64>) -> Result<Highlighter, ExploreError> {
        let shapes = Shapes::new(region, periodic)?;
        let families = metadata.families.iter().map(|family| {
            if region.leaves_out(family.name) {
                return None;
            }
            let inside = |codes: Vec<Accepted>| codes.iter().map(|code| code.inside).collect();
            let codes = accepted(family, &region.ranges)?.into_iter().map(inside).collect();
            let range = |range: &ValueRange| Some((column(family, &range.field)?.0, range.clone()));
            let ranges = region.ranges.iter().map(range).collect::<Option<_>>()?;
            Some(FamilyMarks { codes, ranges })
        });
        let families = families.collect();
        Ok(Highlighter { by: By::Region(RegionMarks { shapes, families }) })
    }

    /// Particles at these places of their source, such as those with certain ids: [`Places::of`].
    pub fn of_places(places: &Places, metadata: &Metadata) -> Highlighter {
        Highlighter::of_marks(PlaceMarks::new(places, metadata))
    }

    pub(super) fn of_marks(marks: PlaceMarks) -> Highlighter {
        Highlighter { by: By::Places(marks) }
    }

    /// Marks the particles of node `node` of a page that are in the selection, by the positions and values that are drawn (of merged
    /// particles: the merged ones) at a time. Where some are, `bits` gets a bit for each particle, particle `i` the bit `i % 64` of word
    /// `i / 64`; its memory is used again. No such node: none.
    pub fn mark(&self, page: &Page, node: usize, time: f64, bits: &mut Vec<u64>) -> Marked {
        bits.clear();
        let marked = match &self.by {
            By::Region(region) => region.mark(page, node, time, bits),
            By::Places(places) => places.mark(page, node, bits),
        };
        if !matches!(marked, Marked::Some(_)) {
            bits.clear();
        }
        marked
    }
}

impl RegionMarks {
    fn mark(&self, page: &Page, node: usize, time: f64, bits: &mut Vec<u64>) -> Marked {
        let family = self.families.get(page.family as usize).and_then(Option::as_ref);
        let (Some(family), Some(record)) = (family, page.nodes.get(node)) else { return Marked::None };
        let cover = self.shapes.cover(record.bounds);
        if cover == Cover::Outside || record.particles == 0 {
            return Marked::None;
        }
        if let Some(content) = page.content(node) {
            let held = content.particles(time);
            bits.resize(held.len().div_ceil(64), 0);
            let is_in = |i: usize, (column, range): &(Column, ValueRange)| {
                column.of(&held.values).get(i).is_some_and(|&value| range.contains(value.into()))
            };
            for (i, &at) in held.positions.iter().enumerate() {
                let pass = self.shapes.contains(at.into()) && family.ranges.iter().all(|range| is_in(i, range));
                bits[i / 64] |= u64::from(pass) << (i % 64);
            }
            return marked(bits, held.len());
        }
        let codes = match family.codes.is_empty() {
            true => None,
            false => Some(family.codes.get(usize::from(record.codebook)).map_or(&[][..], Vec::as_slice)),
        };
        if cover == Cover::Inside && codes.is_none() {
            return Marked::All;
        }
        let particles = page.particles(node);
        let place = LeafFrame::of(record);
        bits.resize(particles.len().div_ceil(64), 0);
        match (cover == Cover::Inside, codes) {
            (true, Some(codes)) => fill(&particles, bits, |_, code| has(codes, code)),
            (_, Some(codes)) => {
                fill(&particles, bits, |fraction, code| has(codes, code) && self.shapes.contains(place.at(fraction)));
            }
            (_, None) => fill(&particles, bits, |fraction, _| self.shapes.contains(place.at(fraction))),
        }
        marked(bits, particles.len())
    }
}

/// How many of so many particles have their bit.
fn marked(bits: &[u64], particles: usize) -> Marked {
    match bits.iter().map(|word| word.count_ones()).sum() {
        0 => Marked::None,
        count if count as usize == particles => Marked::All,
        count => Marked::Some(count),
    }
}

fn has(codes: &[bool], code: u16) -> bool {
    codes.get(usize::from(code)).copied().unwrap_or(false)
}

/// Sets the bits of the particles that pass.
fn fill(particles: &NodeParticles, bits: &mut [u64], pass: impl Fn([f32; 3], u16) -> bool) {
    use crate::codec::coordinates::{unpack_grid, unpack_leaf};
    match particles.positions {
        Positions::Leaf(words) => fill_words(words, particles.codes, bits, unpack_leaf, pass),
        Positions::Grid(words) => fill_words(words, particles.codes, bits, unpack_grid, pass),
    }
}

#[inline]
fn fill_words<W: Copy>(
    words: &[W],
    codes: &[u16],
    bits: &mut [u64],
    unpack: impl Fn(W) -> [f32; 3],
    pass: impl Fn([f32; 3], u16) -> bool,
) {
    for ((words, codes), bits) in words.chunks(64).zip(codes.chunks(64)).zip(bits) {
        for (i, (&word, &code)) in words.iter().zip(codes).enumerate() {
            *bits |= u64::from(pass(unpack(word), code)) << i;
        }
    }
}
