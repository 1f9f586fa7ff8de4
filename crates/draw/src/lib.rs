//! deepfield's pictures, as far as the processor makes them: views and the pages they need, colours, modes, pictures,
//! questions to the data, tours. Nothing here knows of a graphics adapter.
//!
//! Data flows one way through the rooms: those of `deepfield_data`, then `view`, `stream`, `color`, `cpu`, `mode`,
//! `modes`, `annotate`, `explore`, `look`, `picture`, `tour`.

pub use deepfield_data::{build, codec, columnar, hierarchy, import, model, store, synth};
pub use deepfield_heights as heights;

pub mod annotate;
pub mod color;
pub mod cpu;
pub mod explore;
pub mod look;
pub mod mode;
pub mod modes;
pub mod picture;
pub mod stream;
pub mod tour;
pub mod view;

#[cfg(test)]
#[path = "../../../tests/support/cases.rs"]
mod cases;
