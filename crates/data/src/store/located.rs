//! Where particles of a family's source lie in the nodes of its tree, to the precision that nodes hold positions in.
//!
//! A leaf holds each particle's place rounded to the centre of a cell, so a particle of it is found where the cell holds one of the
//! places; the same for merged particles and the cells that they were merged in.

use super::metadata::FamilyMetadata;
use super::page::{NodeParticles, Page, Positions};
use crate::codec::coordinates::{CELL_BITS, GRID_BITS, LEAF_BITS, bin};
use crate::codec::{morton, positions};
use crate::hierarchy::NodeKey;
use crate::hierarchy::octree::Place;
use glam::DVec3;
use rayon::prelude::*;

/// A position in a family's tree; 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourcePlace(Place);

impl FamilyMetadata {
    /// Where a position of the family's source, world units, lies in its tree.
    pub fn place(&self, position: DVec3) -> SourcePlace {
        SourcePlace(Place::of(position.to_array(), self.root))
    }
}

/// Positions of particles of one family, ready to be found in its nodes.
#[derive(Debug)]
pub struct Located {
    /// In Morton order.
    places: Vec<SourcePlace>,
}

impl Located {
    /// Sorts the places, which are all of one family.
    pub fn new(mut places: Vec<SourcePlace>) -> Located {
        places.par_sort_unstable();
        Located { places }
    }

    /// How many particles of node `node` of a page of the family are, as far as can be told, at one of the places, with a bit for
    /// each: particle `i` the bit `i % 64` of word `i / 64` of `bits`, which is made as long as that takes unless none is. Panics if
    /// there is no such node.
    pub fn mark(&self, page: &Page, node: usize, bits: &mut Vec<u64>) -> u32 {
        let Some(&key) = page.cells.get(node) else { return 0 };
        // Those in the node's cell follow each other.
        let NodeKey { depth, x, y, z } = key.cell();
        let shift = 3 * (morton::MORTON_BITS - u32::from(depth));
        let cell = morton::encode([x, y, z]);
        let from = self.places.partition_point(|place| place.0.key >> shift < cell);
        let to = self.places.partition_point(|place| place.0.key >> shift <= cell);
        if from == to {
            return 0;
        }
        // The same arithmetic as where leaves are made, so that bins are the same.
        let cells = f64::from(depth).exp2();
        let corner = [x, y, z].map(f64::from);
        let fine = |place: &SourcePlace| {
            let unit = place.0.unit();
            morton::encode(std::array::from_fn(|axis| bin(unit[axis] * cells - corner[axis], LEAF_BITS)))
        };
        let mut selected: Vec<u64> = self.places[from..to].iter().map(fine).collect();
        selected.sort_unstable();
        let particles = page.particles(node);
        bits.resize(particles.len().div_ceil(64), 0);
        let mut count = 0;
        for i in 0..particles.len() {
            let (first, last) = cell_of(&particles, i);
            let after = selected.partition_point(|&key| key < first);
            if selected.get(after).is_some_and(|&key| key <= last) {
                bits[i / 64] |= 1 << (i % 64);
                count += 1;
            }
        }
        count
    }
}

/// First and last fine key of the cell that a particle's place was rounded to, or that it was merged in.
fn cell_of(particles: &NodeParticles, i: usize) -> (u64, u64) {
    let (key, levels) = match particles.positions {
        Positions::Leaf(words) => {
            let levels = positions::leaf_levels(words[i]);
            (positions::leaf_key(words[i]) >> (3 * levels), levels)
        }
        Positions::Grid(words) => {
            let within = 3 * (GRID_BITS - CELL_BITS);
            (positions::grid_key(words[i]) >> within, LEAF_BITS - CELL_BITS)
        }
    };
    let first = key << (3 * levels);
    (first, first | ((1 << (3 * levels)) - 1))
}
