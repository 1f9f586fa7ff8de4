//! The pyramid of a photo that lies over a field: its pixels, and levels of means of 2 x 2 texels, in tiles.
//!
//! It has the photo's own resolution and knows nothing of the levels of heights: which texels a place needs depends on the size of a pixel there.

pub mod lattice;
pub mod means;
pub mod shares;

pub use lattice::{PhotoLattice, TILE, TileKey};
