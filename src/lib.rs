//! deepfield: interactive exploration of huge point data.
//!
//! Data flows one way: a room uses the rooms before it, never those after it. The rooms below adapters and windows are
//! packages of their own ([`deepfield_data`], [`deepfield_draw`]) and stand here again, so that this is all a user of
//! the library names. `crates/data/tests/rooms.rs` holds all of them, and the rooms within `window`, to their order.

pub use deepfield_data::{build, codec, columnar, hierarchy, import, model, store, synth};
pub use deepfield_draw::heights;
pub use deepfield_draw::{annotate, color, cpu, explore, look, mode, modes, picture, stream, tour, view};

pub mod bench;
pub mod command_line;
pub mod commands;
#[cfg(feature = "viewer")]
pub mod gpu;
pub mod program;
#[cfg(feature = "remote")]
pub mod serve;
pub mod show;
#[cfg(feature = "viewer")]
pub mod window;

pub use program::Program;

#[cfg(test)]
#[path = "../tests/support/cases.rs"]
mod cases;
