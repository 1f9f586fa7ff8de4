//! The space-time hierarchy of trajectories (F12 chapter 6): particles as tracks from step to step.

pub mod chains;
pub mod differences;
pub mod flow;
pub mod lattice;
pub mod merge;
pub mod motion;
pub mod spline;
pub mod tracks;

pub use chains::{Chains, Links, LongTrack, Stretch, recorded_error};
pub use differences::{chord, difference_at};
pub use flow::{Before, ClusterList, Flow, Gathered, Traveller, flow_errors};
pub use lattice::Lattice;
pub use merge::{Clusters, Merged, merge};
pub use motion::Motion;
pub use spline::HermiteSpline;
pub use tracks::{Interpolation, Interval, Moving, TrackEnd, TrackFlags, Tracks};
