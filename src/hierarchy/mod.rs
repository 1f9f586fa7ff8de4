//! Multi-resolution hierarchies: the model in, nodes out. This room knows no files and no cameras.

pub mod cell;

pub use cell::{NodeKey, RootCell};
