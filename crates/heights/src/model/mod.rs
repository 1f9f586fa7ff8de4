//! What a height field is, before anything is done with it: where its samples are, in which units, which of them were measured, and
//! the surface T that they stand for.

pub mod cell;
pub mod facts;
pub mod globe;
pub mod grid;
pub mod lengths;
pub mod light;
pub mod photo;
pub mod samples;
pub mod units;

pub use cell::{Cell, Triangle};
pub use facts::{Facts, Invalid, facts_of};
pub use globe::Globe;
pub use grid::{HeightGrid, Plane};
pub use lengths::Lengths;
pub use photo::{PhotoAbout, PhotoPlace, PhotoRows};
pub use samples::{HeightError, HeightField, Heights, Window};
