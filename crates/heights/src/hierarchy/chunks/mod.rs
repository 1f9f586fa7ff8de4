//! The quadtree of chunks: level k takes every 2^k-th sample with the same diagonal, so that coarse edges are unions of fine ones.
//!
//! A field whose size is no multiple of 2^k ends with a shorter cell: its last row and its last column belong to every level, so the border of
//! every level is the border of T, and where two levels meet, the finer border lies on the coarser one's edges there, too. Only the diagonals of
//! shorter cells are no unions of fine edges; what T does along them is looked at where fine edges cross them ([`deviation`]).

pub mod cells;
pub mod coarse;
pub mod compact;
pub mod deviation;
pub mod far;
pub mod lattice;
pub mod leaf;
pub mod node;
pub mod rows;
pub mod sums;

pub use lattice::{ChunkKey, Lattice, Part};
pub use node::{ChunkNode, Coverage};
