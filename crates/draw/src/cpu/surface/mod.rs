//! Measured height fields on the processor: points far away, triangles near by, rays as the reference, and what was not measured stays open.
//!
//! [`source`] is what is read, [`select`] chooses chunks for a view, [`stitch`] makes one surface of them, [`raster`] and [`rays`] find what each
//! pixel shows, [`resolve`] where that is, [`shade`] what it looks like, and [`labels`] writes heights along lines; [`picture`] does it all, and
//! [`fragments`] does it for what lies among other things. `means` has coarse levels and a rule of another kind, to compare with.

pub(crate) mod channels;
mod closed;
pub mod coverage;
pub(crate) mod darken;
pub mod fragments;
pub mod holes;
pub mod horizon;
pub mod labels;
pub mod lambert;
pub(crate) mod lettering;
pub mod look;
pub(crate) mod means;
mod membrane;
#[cfg(test)]
pub mod memory;
pub mod paged;
pub mod photo;
pub mod picture;
mod pieces;
pub mod placed;
pub mod raster;
pub mod rays;
pub mod resolve;
pub mod rims;
pub mod samples;
pub mod select;
pub mod shade;
pub mod sight;
pub mod since;
pub mod source;
pub mod stitch;
mod walls;

#[cfg(test)]
mod tests;

pub use picture::{SurfaceOptions, SurfacePicture, SurfaceReport, draw, draw_lettered};
