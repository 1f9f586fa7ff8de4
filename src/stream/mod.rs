//! Which pages are in memory: loading on request, keeping what was used last, forgetting the rest within a budget.
//! Nothing here waits for a disk; who loads pages, and on which threads, is the caller's business ([`Scene::converge_blocking`]
//! serves those that may wait).
//!
//! Prefetching (F12 4.8.2) will enter as further, less urgent calls of [`Residency::request`].

pub mod frame;
pub mod residency;
pub mod scene;

pub use frame::first_frame;
pub use residency::{PageState, Residency, ResidencyStatistics};
pub use scene::{Scene, SceneNode, SceneSelection};
