//! What a bucket adds to the tree: a node, or its part of one that reaches beyond the bucket.

use super::block::Block;
use super::merge::is_point;
use super::plan::END;
use super::sorted::Columns;
use super::{Context, Encoding, Purpose, thin};
use crate::codec::coordinates::{CELL_BITS, GRID_BITS};
use crate::codec::positions::grid_key;
use crate::hierarchy::NodeKey;
use crate::model::Bounds;
use crate::model::portable::{expect, expect_that, expect_within, portable};
use glam::DVec3;

/// Packed positions and quantities of the particles to draw, in the order in which they are stored.
#[derive(Clone, Debug)]
pub enum Words {
    /// Of a grid node, and whether they are all of it.
    Grid(Vec<u32>, Columns, bool),
    /// Of a leaf.
    Leaf(Vec<u64>, Columns),
}

/// A node as far as one bucket knows it; `data` is what it draws, or wherever that has been put.
#[derive(Clone, Debug)]
pub struct Piece<Data> {
    /// The node.
    pub key: NodeKey,
    /// Morton key of the piece's first source particle, over the root cell or a small one that the node lies in: a node's pieces are put
    /// together in this order.
    pub first: u64,
    /// How it holds its particles. Whether a node of several pieces is a relay is only known when all are there; its pieces
    /// say that it is a grid.
    pub encoding: Encoding,
    /// Whether this is all of the node.
    pub whole: bool,
    /// Particles to draw.
    pub particles: u64,
    /// Points among them.
    pub points: u64,
    /// Source particles, of leaves only.
    pub sources: u64,
    /// Particles of the children before merging.
    pub input: u64,
    /// Particles after merging, before thinning.
    pub merged: u64,
    /// Largest distance of a source particle from the one drawn for it, in root fractions; of relays too.
    pub delta: f64,
    /// Box around the drawn positions, and the source positions of leaves; root fractions.
    pub bounds: Bounds,
    /// Largest smoothing length, of leaves only.
    pub smoothing_length_max: f32,
    /// Sum of masses, of leaves only.
    pub mass: f64,
    /// Sum of `m rho`, of leaves only.
    pub mass_density: f64,
    /// What it draws.
    pub data: Data,
}

portable!(Piece<Data> where Data {
    key,
    first,
    encoding,
    whole,
    particles,
    points,
    sources,
    input,
    merged,
    delta,
    bounds,
    smoothing_length_max,
    mass,
    mass_density,
    data,
});

impl<A> Piece<A> {
    /// Whether its cell and its counts can be those of a family of so many particles; else what was found and expected.
    pub fn check(&self, most: u64) -> Result<(), String> {
        let Piece { key, first, encoding, particles, points, sources, input, merged, .. } = *self;
        expect_that(key.is_valid(), "key of a node", "a cell of a tree")?;
        expect_within("first key of a node", first, 0..=END - 1)?;
        expect_within("points of a node", points, 0..=particles)?;
        expect_within("particles of a node", particles, 0..=merged)?;
        match encoding {
            Encoding::Leaf => {
                expect_within("particles of a leaf", particles, 0..=most)?;
                expect("merged particles of a leaf", merged, particles)?;
                expect("sources of a leaf", sources, particles)?;
                expect("input of a leaf", input, 0)
            }
            Encoding::Grid | Encoding::Relay => {
                expect_within("input of a node", input, merged..=most)?;
                expect("sources of a node", sources, 0)
            }
            Encoding::Clusters | Encoding::LeafClusters => expect_that(false, "encoding of a node", "none of clusters"),
        }
    }

    /// The same piece with its data put elsewhere.
    pub fn map<B, E>(self, put: impl FnOnce(A) -> Result<B, E>) -> Result<Piece<B>, E> {
        let about = self.with(());
        Ok(about.with(put(self.data)?))
    }

    /// The same piece with other data.
    pub fn with<B>(&self, data: B) -> Piece<B> {
        let Piece { key, first, encoding, whole, particles, points, sources, input, merged, delta, bounds, .. } = *self;
        let Piece { smoothing_length_max, mass, mass_density, .. } = *self;
        Piece {
            key,
            first,
            encoding,
            whole,
            particles,
            points,
            sources,
            input,
            merged,
            delta,
            bounds,
            smoothing_length_max,
            mass,
            mass_density,
            data,
        }
    }
}

impl Piece<Words> {
    /// The piece that draws what was merged, or nothing if it is a relay.
    pub(super) fn merged(
        context: &Context,
        levels: Purpose,
        key: NodeKey,
        block: &Block,
        input: u64,
        whole: bool,
        is_relay: bool,
    ) -> Piece<Words> {
        let drawn = if is_relay {
            None
        } else {
            // What is faint among splats may be all that a volume has in a region.
            let budget = if levels == Purpose::Splats { context.options.thinning_budget } else { 0.0 };
            let kept = thin::thin(&block.columns.mass, &block.columns.density, budget);
            let mut order: Vec<(u64, u32)> = (block.words.iter().zip(0..))
                .filter(|&(_, i)| kept.as_ref().is_none_or(|kept| kept[i as usize]))
                .map(|(&word, i)| (grid_key(word), i))
                .collect();
            // Cells are in order; what lies in one cell is not, nor is there much of it.
            let cell = 3 * (GRID_BITS - CELL_BITS);
            order.chunk_by_mut(|a, b| a.0 >> cell == b.0 >> cell).for_each(|run| run.sort_unstable());
            Some(order.into_iter().map(|(_, i)| i).collect::<Vec<u32>>())
        }
        .unwrap_or_default();
        let words: Vec<u32> = drawn.iter().map(|&i| block.words[i as usize]).collect();
        Piece {
            key,
            first: block.keys.first().copied().unwrap_or(0),
            encoding: if is_relay { Encoding::Relay } else { Encoding::Grid },
            whole,
            particles: words.len() as u64,
            points: words.iter().filter(|&&word| is_point(word)).count() as u64,
            sources: 0,
            input,
            merged: block.len() as u64,
            delta: block.delta_squared.sqrt(),
            bounds: drawn_bounds(&words, key),
            smoothing_length_max: 0.0,
            mass: 0.0,
            mass_density: 0.0,
            data: Words::Grid(words, block.columns.gather(&drawn), whole),
        }
    }
}

/// The box around decoded grid words, in root fractions.
fn drawn_bounds(words: &[u32], key: NodeKey) -> Bounds {
    if words.is_empty() {
        return Bounds::EMPTY;
    }
    let mask = (1 << GRID_BITS) - 1;
    let (mut low, mut high) = ([mask; 3], [0; 3]);
    for &word in words {
        for axis in 0..3 {
            let bin = word >> (GRID_BITS * axis as u32) & mask;
            low[axis] = low[axis].min(bin);
            high[axis] = high[axis].max(bin);
        }
    }
    let NodeKey { depth, x, y, z } = key.cell();
    let bins = (f64::from(depth) + f64::from(GRID_BITS)).exp2();
    let cell = [x, y, z];
    let place = |bin: [u32; 3]| {
        DVec3::from_array(std::array::from_fn(|axis| {
            (f64::from(cell[axis]) * f64::from(1 << GRID_BITS) + f64::from(bin[axis]) + 0.5) / bins
        }))
    };
    Bounds { min: place(low), max: place(high) }
}
