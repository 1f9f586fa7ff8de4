//! Screens and projectors: what each output of a show displays, where its picture is bent to, and how it blends into its neighbours.
//!
//! An output is a map from its points to directions around the show's camera ([`Projector`]). A flat picture that covers these
//! directions is drawn ([`Cover`]) and bent by a mesh ([`Mesh`]); a mask darkens what overlaps and what no light may reach
//! ([`mask`]). Rigs are described in RON ([`OutputsFile`]) or measured by others ([`mpcdi`]).

mod cover;
mod file;
pub mod mask;
mod mesh;
pub mod mpcdi;
mod pfm;
mod projector;

pub use cover::{Cover, CoverError};
pub use file::{Area, Frustum, Monitor, Output, OutputError, OutputsFile, Rows, Shows, VERSION};
pub use mask::Mask;
pub use mesh::Mesh;
pub use pfm::Pfm;
pub use projector::{Projector, Sheet};
