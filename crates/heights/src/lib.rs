//! deepfield's measured height fields: grids of heights with samples that were not measured.
//!
//! Data flows one way through the rooms: `model` (what a field and its surface T are), `import` (one file a format), `codec`,
//! `hierarchy` (nested levels of chunks), `store` (their page file), `build`, `measure` (numbers, lines and differences), `export`, `synth`.

pub mod build;
pub mod codec;
pub mod export;
pub mod hierarchy;
pub mod import;
pub mod measure;
pub mod model;
pub mod opened;
pub mod store;
pub mod synth;

pub use opened::{OpenHeights, is_heights};
