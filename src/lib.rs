//! deepfield: interactive exploration of huge point data.
//!
//! Data flows one way through the rooms below: a room uses the rooms before it, never those after it.

pub mod annotate;
#[cfg(feature = "viewer")]
pub mod app;
pub mod build;
#[cfg(test)]
#[path = "../tests/support/cases.rs"]
mod cases;
pub mod codec;
pub mod commands;
pub mod explore;
#[cfg(feature = "viewer")]
pub mod gpu;
pub mod hierarchy;
pub mod import;
pub mod model;
pub mod modes;
pub mod network;
pub mod outputs;
pub mod raster;
pub mod scene_file;
pub mod store;
pub mod stream;
pub mod supervisor;
pub mod synth;
pub mod tour;
pub mod view;
