//! deepfield's data: what it is, how it is read, coded, ordered in a hierarchy and kept in a page file.
//!
//! Data flows one way through the rooms: `lanes`, `model`, `codec`, `columnar`, `import`, `hierarchy`, `store`, `build`, `synth`.

pub mod build;
pub mod codec;
pub mod columnar;
pub mod hierarchy;
pub mod import;
pub mod lanes;
pub mod model;
pub mod store;
pub mod synth;

#[cfg(test)]
#[path = "../../../tests/support/cases.rs"]
mod cases;
