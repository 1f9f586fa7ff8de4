//! Codebooks of the leaves: leaves of similar density share one.
//!
//! Densities of a simulation span many decades, those inside one leaf few. With one codebook for all leaves most of its entries
//! are of no use to any one leaf; with several, each of its own range of densities, the same bits give much smaller
//! errors. Each costs `entries * (3 + attributes) * 4` bytes once.

use super::sorted::Sorted;
use super::topology::Shape;
use crate::codec::{Codebook, CodebookScope, Quantities, Scaling, VqBits, quantize};
use rayon::prelude::*;
use std::ops::Range;

/// Particles for each codebook at least: with 8 bits the entries of one take a fortieth of the space of so many particles.
const PARTICLES: usize = 1 << 14;

/// Entries of all leaf codebooks of a family at most, for bits that allow several; they stay in the GPU's memory.
const ENTRIES: usize = 1 << 12;

/// How many codebooks the leaves of so many particles share.
fn books(particles: usize, bits: VqBits) -> usize {
    (particles / PARTICLES).clamp(1, (ENTRIES / bits.entries()).max(1))
}

/// The coded leaves of a family.
pub(super) struct LeafBooks {
    /// The codebooks, those of the thinnest leaves first.
    pub codebooks: Vec<Codebook>,
    /// The code of each particle in sorted order.
    codes: Vec<u16>,
    /// First particle and codebook of each leaf, in order.
    leaves: Vec<(usize, u16)>,
}

impl LeafBooks {
    /// Codes the particles of all leaves.
    pub(super) fn of(sorted: &Sorted, shapes: &[Vec<Shape>], scaling: &Scaling, bits: VqBits) -> LeafBooks {
        let mut leaves: Vec<(Range<usize>, f32)> = shapes
            .par_iter()
            .flatten()
            .filter(|shape| shape.is_leaf())
            .map(|shape| (shape.sources.clone(), scaling.mean_density(&sorted.columns.density[shape.sources.clone()])))
            .collect();
        leaves.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.start.cmp(&b.0.start)));
        // Shares of about the same number of particles.
        let count = books(sorted.len(), bits);
        let mut before = 0;
        let shares: Vec<usize> = leaves
            .iter()
            .map(|(range, _)| {
                let middle = before + range.len() / 2;
                before += range.len();
                (middle * count / sorted.len().max(1)).min(count - 1)
            })
            .collect();
        let mut groups: Vec<Vec<Range<usize>>> = vec![Vec::new(); count];
        leaves.iter().zip(shares).for_each(|((range, _), share)| groups[share].push(range.clone()));
        groups.retain(|group| !group.is_empty());
        let coded: Vec<(Codebook, Vec<Vec<u16>>)> = groups
            .par_iter()
            .map(|group| {
                let batches: Vec<Quantities> = group.iter().map(|range| quantities(sorted, range.clone())).collect();
                quantize(&batches, scaling, bits, CodebookScope::Leaves, groups.len())
            })
            .collect();
        let mut all = LeafBooks { codebooks: Vec::new(), codes: vec![0; sorted.len()], leaves: Vec::new() };
        for (book, (group, (codebook, codes))) in groups.iter().zip(coded).enumerate() {
            for (range, codes) in group.iter().zip(codes) {
                all.leaves.push((range.start, book as u16));
                all.codes[range.clone()].copy_from_slice(&codes);
            }
            all.codebooks.push(codebook);
        }
        all.leaves.sort_unstable();
        all
    }

    /// The codes of the leaf of these particles and its codebook.
    pub(super) fn leaf(&self, sources: Range<usize>) -> (Vec<u16>, u16) {
        let leaf = self.leaves.partition_point(|(start, _)| *start < sources.start);
        (self.codes[sources].to_vec(), self.leaves.get(leaf).map_or(0, |(_, book)| *book))
    }
}

/// A run of the source particles.
fn quantities(sorted: &Sorted, range: Range<usize>) -> Quantities<'_> {
    let columns = &sorted.columns;
    Quantities {
        mass: &columns.mass[range.clone()],
        density: &columns.density[range.clone()],
        smoothing_length: &columns.smoothing_length[range.clone()],
        attributes: columns.attributes.iter().map(|values| &values[range.clone()]).collect(),
        skipped: &[],
    }
}
