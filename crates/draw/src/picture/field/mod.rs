//! Pictures of images and volumes: which points stand for the samples, and what a mode draws of them.

pub mod in_time;
mod names;
mod opened;
mod painting;
mod perception;
mod report;
mod session;
mod sketch;
#[cfg(test)]
mod tests;

pub use in_time::InTime;
pub use names::{GRADIENT, attributes_of};
pub use opened::{OpenField, Shown, Wanted};
pub use report::{ErrorValue, PointsReport};
pub use session::{FieldSession, MEMORY, PreparedField};
