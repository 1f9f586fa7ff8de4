//! Oriented points of images and volumes.

mod bound;
pub mod cut;
pub mod error;
pub mod fit;
pub mod grid;
pub mod kinds;
mod planes;
pub mod pyramid;
pub mod ranges;
pub mod reconstruct;
pub mod sets;
mod tables;
pub mod tree;

pub use cut::{Cut, Drawn};
pub use error::{Errors, Metric, Options, Types};
pub use grid::{Samples, Shape};
pub use kinds::{LevelKinds, NodeKind};
pub use planes::Planes;
pub use ranges::Ranges;
pub use reconstruct::errors;
pub use sets::Set;
pub use tree::{Hierarchy, Level};
