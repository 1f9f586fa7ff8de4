//! What is shown where nothing was measured.

use super::photo::PhotoTiles;
use super::placed::Placed;
use super::source::{NodeFacts, NodeSamples, SurfaceNodes};
use deepfield_heights::hierarchy::chunks::{ChunkKey, Lattice};
use std::sync::Arc;

/// What holes look like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Holes {
    /// They are open.
    #[default]
    Open,
    /// Their rim is a line of so many pixels, on the surface.
    Outlined(f64),
    /// There is a membrane over those that are not too large: hatched, and no data.
    Filled(Gap),
}

/// How large a hole may be that has a membrane: how far what was measured on both sides of it, along a row or along a column, is apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gap {
    /// Any.
    Any,
    /// So many cells.
    Cells(f64),
    /// A length in the unit of x and y.
    Lengths(f64),
}

impl Holes {
    /// Most cells of full resolution from row to row, and from column to column, that a membrane spans; 0 where there is none.
    pub fn spans(&self, placed: &Placed) -> [f64; 2] {
        match self {
            Holes::Open | Holes::Outlined(_) => [0.0; 2],
            Holes::Filled(Gap::Any) => [f64::INFINITY; 2],
            Holes::Filled(Gap::Cells(cells)) => [*cells; 2],
            Holes::Filled(Gap::Lengths(length)) => {
                let [across, along] = placed.file_step.map(f64::abs);
                [length / along, length / across]
            }
        }
    }
}

/// A field whose holes grow with distance: a sample of a coarse level counts as not measured if any that it stands for was not.
pub struct Grown<'a>(pub &'a dyn SurfaceNodes);

impl SurfaceNodes for Grown<'_> {
    fn lattice(&self) -> Lattice {
        self.0.lattice()
    }

    fn facts(&self, key: ChunkKey) -> Option<NodeFacts> {
        self.0.facts(key)
    }

    fn samples(&self, key: ChunkKey) -> Option<Arc<NodeSamples>> {
        let samples = self.0.samples(key)?;
        if key.level == 0 || samples.coverage.is_empty() {
            return Some(samples);
        }
        let mut grown = NodeSamples::clone(&samples);
        for (index, coverage) in grown.coverage.iter_mut().enumerate().filter(|(_, coverage)| **coverage < u8::MAX) {
            grown.heights.open(index);
            *coverage = 0;
        }
        Some(Arc::new(grown))
    }

    fn is_there(&self, key: ChunkKey) -> bool {
        self.0.is_there(key)
    }

    fn room(&self) -> u64 {
        self.0.room()
    }

    fn bytes(&self, key: ChunkKey) -> u64 {
        self.0.bytes(key)
    }

    fn photo(&self) -> Option<&dyn PhotoTiles> {
        self.0.photo()
    }
}

#[cfg(test)]
mod tests;
