//! Oriented points of images and volumes.

mod analyse;
mod bank;
mod bound;
pub mod brick;
pub mod bricks;
mod cells;
mod choose;
pub mod cut;
pub mod error;
mod feed;
mod fields;
mod fit;
pub mod grid;
mod holes;
pub mod kinds;
mod level;
mod planes;
mod pyramid;
pub mod reconstruct;
pub mod sets;
mod survey;
mod tables;
pub mod tree;

pub use brick::{Root, Top};
pub use bricks::{Bricks, Part};
pub use cut::{Cut, Drawn};
pub use error::{Errors, Metric, Options, Types};
pub use feed::Feed;
pub use fields::{InMemory, Shelf};
pub use grid::{Samples, Shape};
pub use kinds::{LevelKinds, NodeKind};
pub use planes::Planes;
pub use reconstruct::errors;
pub use sets::Set;
pub use survey::{Fault, FaultOf, Survey, shelf_len};
pub use tree::{Hierarchy, Level};
