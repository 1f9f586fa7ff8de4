//! Which pages are in memory: reading what a view misses and will miss soon, keeping what was used last, forgetting the
//! rest within a budget, and doing without what cannot be read.
//!
//! [`Streamer`] is a frame's view of all that, and never waits; [`Scene`] serves single pictures, which may.

pub mod ahead;
pub mod copies;
pub mod fitting;
pub mod frame;
pub mod listing;
pub mod loader;
pub mod outline;
pub mod pace;
pub mod residency;
pub mod scene;
pub mod streamer;

pub(crate) mod patience;
pub(crate) mod report;

mod recency;

pub use ahead::{Ahead, LookAhead};
pub use copies::{Copies, CopyOptions, CopyPlan};
pub use frame::first_frame;
pub use listing::{Listing, Visited};
pub use residency::{Failure, PageState, Residency, ResidencyStatistics};
pub use scene::{IN_FLIGHT, Scene, SceneNode, SceneSelection, first_nodes};
pub use streamer::{Arrivals, Served, StreamOptions, Streamer};
