//! Pathlines on the processor (F12 6.4): tracks become strokes, and strokes a list of fragments for each pixel, sorted by depth.
//!
//! Tracks come as Bézier curves ([`curves`]). Each is projected and divided into chords that stay within a quarter of a pixel of it
//! ([`chords`]); the chords of all tracks are gathered by the tiles of the picture that they reach, and drawn tile by tile from front
//! to back ([`raster`]), with antialiased edges and a dark rim ([`stroke`]). Where a pixel has become opaque, what lies behind is left
//! out, so that the work does not grow with the depth of a scene; of very many curves what some of them hide is not even divided
//! ([`hidden`]). Nothing depends on the order of tracks or the number of threads.

pub mod chords;
pub mod curves;
pub mod fragments;
mod hidden;
mod lens;
pub mod palette;
pub mod raster;
pub mod stroke;
pub mod style;
#[cfg(test)]
mod tests;

pub use chords::{Drawn, Part};
pub use curves::Curves;
pub use fragments::{PathFragment, PathFragments};
pub use palette::{Palette, Quantity};
pub use raster::Canvas;
pub use style::{PathShape, Style};
